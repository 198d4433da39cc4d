/* A C library of some functions, for programs that qemu-user runs, and for a Cortex-M7 without an operating system in
   qemu-system-arm, which hears calls at a breakpoint (semihosting): ziglang needs minutes to build a whole one. */
#include <stdarg.h>
#ifdef __arm__
#include "arm.c"
#endif
typedef __SIZE_TYPE__ size_t;

int main(int count, char **arguments);

#if defined(__ARM_ARCH_PROFILE) && __ARM_ARCH_PROFILE == 'M'
#define BARE
#endif
#if defined(__x86_64__)
enum { WRITE = 1, EXIT = 231, SOCKET = 41, BIND = 49, SEND_TO = 44, RECEIVE_FROM = 45 };
enum { READ = 0, OPEN_AT = 257, CONTROL = 16, POLL = 271 };
#elif defined(__aarch64__)
enum { WRITE = 64, EXIT = 94, SOCKET = 198, BIND = 200, SEND_TO = 206, RECEIVE_FROM = 207 };
enum { READ = 63, OPEN_AT = 56, CONTROL = 29, POLL = 73 };
#elif defined(BARE)
enum { WRITE = 0x04, EXIT = 0x20, SOCKET, BIND, SEND_TO, RECEIVE_FROM, READ, OPEN_AT, CONTROL, POLL };
#else
enum { WRITE = 4, EXIT = 248, SOCKET = 281, BIND = 282, SEND_TO = 290, RECEIVE_FROM = 292 };
enum { READ = 3, OPEN_AT = 322, CONTROL = 54, POLL = 336 };
#endif

void *memset(void *to, int c, size_t n)
{
    volatile unsigned char *p = to;
    while (n--)
        *p++ = (unsigned char)c;
    return to;
}

void *memmove(void *to, const void *from, size_t n)
{
    volatile unsigned char *p = to;
    const unsigned char *q = from;
    size_t i;
    if (p < q)
        for (i = 0; i < n; i++)
            p[i] = q[i];
    else
        for (i = n; i-- > 0;)
            p[i] = q[i];
    return to;
}

void *memcpy(void *to, const void *from, size_t n)
{
    return memmove(to, from, n);
}

#if defined(__arm__)
/* helper functions of the ABI, which every compiler's own library has */
void __aeabi_memclr(void *to, size_t n) { memset(to, 0, n); }
void __aeabi_memclr4(void *to, size_t n) { memset(to, 0, n); }
void __aeabi_memclr8(void *to, size_t n) { memset(to, 0, n); }
void __aeabi_memset(void *to, size_t n, int c) { memset(to, c, n); }
void __aeabi_memmove(void *to, const void *from, size_t n) { memmove(to, from, n); }
void __aeabi_memmove4(void *to, const void *from, size_t n) { memmove(to, from, n); }
void __aeabi_memmove8(void *to, const void *from, size_t n) { memmove(to, from, n); }
void __aeabi_memcpy(void *to, const void *from, size_t n) { memmove(to, from, n); }
void __aeabi_memcpy4(void *to, const void *from, size_t n) { memmove(to, from, n); }
void __aeabi_memcpy8(void *to, const void *from, size_t n) { memmove(to, from, n); }
#endif

/* The rest runs seldom, and its stack is no part of a step's. */
#pragma clang optimize off

static long call(long number, long a, long b, long c, long d, long e, long f)
{
#if defined(__x86_64__)
    long result;
    register long r10 __asm__("r10") = d, r8 __asm__("r8") = e, r9 __asm__("r9") = f;
    __asm__ volatile("syscall"
                     : "=a"(result)
                     : "a"(number), "D"(a), "S"(b), "d"(c), "r"(r10), "r"(r8), "r"(r9)
                     : "rcx", "r11", "memory");
    return result;
#elif defined(__aarch64__)
    register long x8 __asm__("x8") = number, x0 __asm__("x0") = a, x1 __asm__("x1") = b, x2 __asm__("x2") = c;
    register long x3 __asm__("x3") = d, x4 __asm__("x4") = e, x5 __asm__("x5") = f;
    __asm__ volatile("svc 0" : "+r"(x0) : "r"(x8), "r"(x1), "r"(x2), "r"(x3), "r"(x4), "r"(x5) : "memory");
    return x0;
#elif defined(BARE)
    long words[2];
    register long r0 __asm__("r0") = number, r1 __asm__("r1") = number == WRITE ? b : (long)words; /* ends with a zero */
    words[0] = 0x20026; /* the program has ended, with this status */
    words[1] = a;
    (void)c, (void)d, (void)e, (void)f;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
#else
    register long r0 __asm__("r0") = a, r1 __asm__("r1") = b, r2 __asm__("r2") = c, r3 __asm__("r3") = d;
    register long r4 __asm__("r4") = e, r5 __asm__("r5") = f; /* r7 may be the frame's */
    __asm__ volatile("push {r7}\n mov r7, %1\n svc 0\n pop {r7}"
                     : "+r"(r0)
                     : "r"(number), "r"(r1), "r"(r2), "r"(r3), "r"(r4), "r"(r5)
                     : "memory");
    return r0;
#endif
}

/* Sockets. A result below zero is the negative of the error's number. */
int socket(int family, int kind, int protocol)
{
    return (int)call(SOCKET, family, kind, protocol, 0, 0, 0);
}

int bind(int peer, const void *place, unsigned size)
{
    return (int)call(BIND, peer, (long)place, (long)size, 0, 0, 0);
}

long sendto(int peer, const void *data, size_t n, int flags, const void *place, unsigned size)
{
    return call(SEND_TO, peer, (long)data, (long)n, flags, (long)place, (long)size);
}

long recvfrom(int peer, void *data, size_t n, int flags, void *place, unsigned *size)
{
    return call(RECEIVE_FROM, peer, (long)data, (long)n, flags, (long)place, (long)size);
}

/* A serial line. struct termios begins with four words, the third of which has the baud. */
int open(const char *path, int flags, ...)
{
    return (int)call(OPEN_AT, -100, (long)path, flags, 0, 0, 0);
}

long read(int file, void *data, size_t n)
{
    return call(READ, file, (long)data, (long)n, 0, 0, 0);
}

long write(int file, const void *data, size_t n)
{
    return call(WRITE, file, (long)data, (long)n, 0, 0, 0);
}

int poll(void *files, unsigned long n, int ms)
{
    long wait[2];
    wait[0] = ms < 1000 ? 0 : 1; /* a second at most */
    wait[1] = ms < 1000 ? ms * 1000000l : 0;
    return (int)call(POLL, (long)files, (long)n, (long)wait, 0, 0, 0);
}

int tcgetattr(int file, void *how)
{
    return (int)call(CONTROL, file, 0x5401, (long)how, 0, 0, 0);
}

int tcsetattr(int file, int when, const void *how)
{
    return (int)call(CONTROL, file, 0x5402 + when, (long)how, 0, 0, 0);
}

int cfsetospeed(void *how, unsigned speed)
{
    unsigned *words = how;
    words[2] = (words[2] & ~010017u) | speed;
    return 0;
}

int cfsetispeed(void *how, unsigned speed)
{
    return cfsetospeed(how, speed);
}

unsigned short htons(unsigned short x)
{
    return (unsigned short)(x << 8 | x >> 8);
}

unsigned htonl(unsigned x)
{
    return (unsigned)htons((unsigned short)x) << 16 | htons((unsigned short)(x >> 16));
}

int memcmp(const void *one, const void *other, size_t n)
{
    const unsigned char *p = one, *q = other;
    for (; n; n--, p++, q++)
        if (*p != *q)
            return *p - *q;
    return 0;
}

static void put(const char *text)
{
    size_t n = 0;
    while (text[n])
        n++;
    call(WRITE, 1, (long)text, (long)n, 0, 0, 0);
}

static void put_number(long value)
{
    char text[24];
    int i = 23, negative = value < 0;
    unsigned long left = negative ? 0ul - (unsigned long)value : (unsigned long)value;
    text[i] = 0;
    do {
        unsigned long tenth = 0, rest = left; /* without a division, which 32 bits have in a library */
        while (rest >= 10) {
            unsigned long part = 1;
            while (part * 100 <= rest && part < 100000000ul)
                part *= 10;
            tenth += part;
            rest -= 10 * part;
        }
        text[--i] = (char)('0' + rest);
        left = tenth;
    } while (left);
    if (negative)
        text[--i] = '-';
    put(text + i);
}

int printf(const char *format, ...)
{
    va_list given;
    va_start(given, format);
    for (; *format; format++) {
        char one[2] = {0, 0};
        if (*format != '%') {
            one[0] = *format;
            put(one);
            continue;
        }
        format++;
        if (*format == 's') {
            put(va_arg(given, const char *));
        } else if (*format == 'd') {
            put_number(va_arg(given, int));
        } else { /* %.9g: microseconds are enough here */
            double x = va_arg(given, double);
            format += 2;
            put_number((long)(int)(x * 1e6 + 0.5));
            put("e-6");
        }
    }
    va_end(given);
    return 0;
}

#if defined(BARE)
__attribute__((noreturn)) void _start(void)
{
    *(volatile unsigned *)0xe000ed88 |= 0xfu << 20; /* the floating-point unit is on */
    __asm__ volatile("dsb\n isb");
    call(EXIT, main(0, 0), 0, 0, 0, 0, 0);
    for (;;)
        ;
}
__attribute__((noreturn)) static void fault(void)
{
    put("the processor has stopped at a fault\n");
    call(EXIT, 3, 0, 0, 0, 0, 0);
    for (;;)
        ;
}
/* the stack's end, the start, and what is called at each kind of fault */
__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {
    (void (*)(void))0x400000, _start, fault, fault, fault, fault, fault,
};
#else
void begin(long *stack)
{
    call(EXIT, main((int)stack[0], (char **)(stack + 1)), 0, 0, 0, 0, 0);
    for (;;)
        ;
}

#if defined(__x86_64__)
__asm__(".globl _start\n_start:\n xor %ebp, %ebp\n mov %rsp, %rdi\n and $-16, %rsp\n call begin\n");
#elif defined(__aarch64__)
__asm__(".globl _start\n_start:\n mov x29, #0\n mov x0, sp\n bl begin\n");
#else
__asm__(".globl _start\n.type _start, %function\n_start:\n mov r0, sp\n bl begin\n");
#endif
#endif
