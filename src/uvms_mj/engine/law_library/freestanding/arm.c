/* Helper functions of the ABI of ARM with 32 bits, which a compiler's own library has: conversions between 64 bits and
   double, and division. A shared library has its own ones. */
#define SOFT __attribute__((pcs("aapcs"))) /* numbers in the registers of integers */
typedef union {
    double number;
    unsigned long long bits;
} both;

SOFT long long __aeabi_d2lz(double x)
{
    both x_;
    int shift;
    unsigned long long whole;
    x_.number = x;
    shift = (int)(x_.bits >> 52 & 0x7ff) - 1075;
    whole = (x_.bits & 0xfffffffffffffull) | 0x10000000000000ull;
    if (shift < -52)
        return 0;
    whole = shift < 0 ? whole >> -shift : whole << shift;
    return x < 0.0 ? -(long long)whole : (long long)whole;
}

SOFT double __aeabi_l2d(long long n)
{
    unsigned long long whole = n < 0 ? 0ull - (unsigned long long)n : (unsigned long long)n;
    double high = (double)(unsigned)(whole >> 32), x = high * 4294967296.0 + (double)(unsigned)whole;
    return n < 0 ? -x : x;
}

__attribute__((used)) static long long divided(long long n, long long d, long long *rest)
{
    unsigned long long left = n < 0 ? 0ull - (unsigned long long)n : (unsigned long long)n, result = 0;
    unsigned long long by = d < 0 ? 0ull - (unsigned long long)d : (unsigned long long)d, part = 0;
    int k;
    for (k = 63; k >= 0; k--) {
        part = part << 1 | (left >> k & 1);
        if (part >= by) {
            part -= by;
            result |= 1ull << k;
        }
    }
    *rest = n < 0 ? -(long long)part : (long long)part;
    return (n < 0) != (d < 0) ? -(long long)result : (long long)result;
}

__asm__(".syntax unified\n.globl __aeabi_ldivmod\n.hidden __aeabi_ldivmod\n.type __aeabi_ldivmod, %function\n__aeabi_ldivmod:\n"
        " push {r11, lr}\n sub sp, sp, #16\n add r12, sp, #8\n str r12, [sp]\n bl divided\n"
        " ldr r2, [sp, #8]\n ldr r3, [sp, #12]\n add sp, sp, #16\n pop {r11, pc}\n");
