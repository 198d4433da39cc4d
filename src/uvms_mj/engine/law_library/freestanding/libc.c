/* A C library of some functions, for programs that qemu-user runs: ziglang needs minutes to build a whole one. */
#include <stdarg.h>
typedef __SIZE_TYPE__ size_t;

int main(void);

static long call(long number, long a, long b, long c)
{
#if defined(__x86_64__)
    long result;
    __asm__ volatile("syscall" : "=a"(result) : "a"(number), "D"(a), "S"(b), "d"(c) : "rcx", "r11", "memory");
    return result;
#elif defined(__aarch64__)
    register long x8 __asm__("x8") = number, x0 __asm__("x0") = a, x1 __asm__("x1") = b, x2 __asm__("x2") = c;
    __asm__ volatile("svc 0" : "+r"(x0) : "r"(x8), "r"(x1), "r"(x2) : "memory");
    return x0;
#else
    register long r0 __asm__("r0") = a, r1 __asm__("r1") = b, r2 __asm__("r2") = c; /* r7 may be the frame's */
    __asm__ volatile("push {r7}\n mov r7, %1\n svc 0\n pop {r7}" : "+r"(r0) : "r"(number), "r"(r1), "r"(r2) : "memory");
    return r0;
#endif
}

#if defined(__x86_64__)
enum { WRITE = 1, EXIT = 231 };
#elif defined(__aarch64__)
enum { WRITE = 64, EXIT = 94 };
#else
enum { WRITE = 4, EXIT = 248 };
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

static void put(const char *text)
{
    size_t n = 0;
    while (text[n])
        n++;
    call(WRITE, 1, (long)text, (long)n);
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

void begin(void)
{
    call(EXIT, main(), 0, 0);
    for (;;)
        ;
}

#if defined(__x86_64__)
__asm__(".globl _start\n_start:\n xor %ebp, %ebp\n and $-16, %rsp\n call begin\n");
#elif defined(__aarch64__)
__asm__(".globl _start\n_start:\n mov x29, #0\n bl begin\n");
#else
__asm__(".globl _start\n.type _start, %function\n_start:\n bl begin\n");
#endif
