/* Helper functions of the ABI of ARM with 32 bits, which a compiler's own library has: conversions between 64 bits and
   double, and division. A shared library has its own ones. */
#define SOFT __attribute__((pcs("aapcs"))) /* numbers in the registers of integers */
typedef union {
    double number;
    unsigned long long bits;
} both;

SOFT unsigned long long __aeabi_d2ulz(double x)
{
    both x_;
    int shift;
    unsigned long long whole;
    x_.number = x;
    shift = (int)(x_.bits >> 52 & 0x7ff) - 1075;
    whole = (x_.bits & 0xfffffffffffffull) | 0x10000000000000ull;
    if (shift < -52)
        return 0;
    return shift < 0 ? whole >> -shift : whole << shift;
}

SOFT long long __aeabi_d2lz(double x)
{
    return x < 0.0 ? -(long long)__aeabi_d2ulz(-x) : (long long)__aeabi_d2ulz(x);
}

SOFT double __aeabi_ul2d(unsigned long long n)
{
    return (double)(unsigned)(n >> 32) * 4294967296.0 + (double)(unsigned)n; /* only the sum is rounded */
}

SOFT double __aeabi_l2d(long long n)
{
    return n < 0 ? -__aeabi_ul2d(0ull - (unsigned long long)n) : __aeabi_ul2d((unsigned long long)n);
}

__attribute__((used)) static unsigned long long whole_divided(unsigned long long n, unsigned long long by,
                                                              unsigned long long *rest)
{
    unsigned long long result = 0, part = 0;
    int k;
    for (k = 63; k >= 0; k--) {
        unsigned long long over = part >> 63;
        part = part << 1 | (n >> k & 1);
        if (over || part >= by) {
            part -= by;
            result |= 1ull << k;
        }
    }
    *rest = part;
    return result;
}

__attribute__((used)) static long long divided(long long n, long long d, long long *rest)
{
    unsigned long long left = n < 0 ? 0ull - (unsigned long long)n : (unsigned long long)n, part;
    unsigned long long by = d < 0 ? 0ull - (unsigned long long)d : (unsigned long long)d;
    unsigned long long result = whole_divided(left, by, &part);
    *rest = n < 0 ? -(long long)part : (long long)part;
    return (n < 0) != (d < 0) ? -(long long)result : (long long)result;
}

#define DIVISION(name, function)                                                                                        \
    __asm__(".syntax unified\n.globl " name "\n.hidden " name "\n.type " name ", %function\n" name ":\n"                 \
            " push {r11, lr}\n sub sp, sp, #16\n add r12, sp, #8\n str r12, [sp]\n bl " function "\n"                  \
            " ldr r2, [sp, #8]\n ldr r3, [sp, #12]\n add sp, sp, #16\n pop {r11, pc}\n")
DIVISION("__aeabi_ldivmod", "divided");
DIVISION("__aeabi_uldivmod", "whole_divided");
