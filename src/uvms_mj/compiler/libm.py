"""Functions of the C library, written in the language itself.

They use nothing but +, -, * and / of doubles, square roots, comparisons and integers, and no product and sum is rounded
once. So they give the same bits on every processor, and as plain Python. ``FUNCTIONS`` has them by their names in C.

A number in two parts is an unrounded sum: the second part is at most about half of the last place of the first one.
"""

from __future__ import annotations  # the binding of arguments reads the names of types

import math
import struct
import types
from itertools import accumulate

import numpy as np

from .arrays import Arrays
from .builtin import entry
from .values import DOUBLE, FLOAT, INT, WORD, Value, scalar

INF, NAN = math.inf, math.nan
TINY = 2.0**-1022
"""The least number that is not subnormal."""
MANTISSA = (1 << 52) - 1
LIMB = (1 << 32) - 1
MAGIC = 1.5 * 2.0**52
"""Adding it rounds a number to a whole one."""
MAGIC_BITS = 0x4338000000000000
UPPER = -(1 << 27)
"""The bits of the upper half of a number, whose products with other halves are exact."""


def bits(x: float) -> int:
    """The 64 bits of a number."""
    return struct.unpack("<q", struct.pack("<d", x))[0]


def from_bits(n: int) -> float:
    """The number with these 64 bits."""
    return struct.unpack("<d", struct.pack("<q", n))[0]


@entry(bits)
def _bits(at: Arrays, x: Value) -> Value:
    return scalar(at.at.bitcast(at.float_of(x), WORD), INT)


@entry(from_bits)
def _from_bits(at: Arrays, n: Value) -> Value:
    return scalar(at.at.bitcast(at.converted(n, INT), DOUBLE), FLOAT)


# Constants, by integers: a number times 2^_PLACES, or times 2^_MANY.

_PLACES, _MANY = 200, 1400
_ONE = 1 << _PLACES


def _arctangent(p: int, q: int, sign: int, one: int = _ONE) -> int:
    """The arctangent of p / q < 1, with sign -1; with sign 1, its inverse hyperbolic tangent."""
    term, total, k = one * p // q, 0, 1
    while term not in (0, -1):
        total += term // k
        term, k = sign * term * p * p // (q * q), k + 2
    return total


def _logarithm(p: int, q: int) -> int:
    """The logarithm of p / q."""
    return 2 * _arctangent(p - q, p + q, 1) if p >= q else -_logarithm(q, p)


def _cut(number: int, places: int) -> float:
    """A constant without what is beyond so many binary places."""
    return float(number >> (_PLACES - places)) * 2.0**-places


def _double(number: int) -> float:
    """The double next to a constant."""
    return number / _ONE


def _rest(number: int, *parts: float) -> int:
    """A constant without these parts."""
    for part in parts:
        p, q = part.as_integer_ratio()
        number -= p * (_ONE // q)
    return number


def _in_two(number: int, places: int | None = None) -> tuple[float, float]:
    """A constant in two parts, the first one of so many binary places, or as precise as a double is."""
    first = _double(number) if places is None else _cut(number, places)
    return first, _double(_rest(number, first))


_LN2, _LN10 = _logarithm(2, 1), 3 * _logarithm(2, 1) + _logarithm(5, 4)
_PI_MANY = 16 * _arctangent(1, 5, -1, 1 << _MANY) - 4 * _arctangent(1, 239, -1, 1 << _MANY)
_PI = _PI_MANY >> (_MANY - _PLACES)

LN2, LN2_LOW = _in_two(_LN2, 42)
LN2_DOUBLE = _double(_LN2)
PI, PI_LOW = _in_two(_PI)
HALF_PI, HALF_PI_LOW = _in_two(_PI // 2)
QUARTER_PI = 0.5 * HALF_PI
PI_A = _cut(_PI // 2, 32)
PI_B = _cut(_rest(_PI // 2, PI_A), 65)
PI_C = _double(_rest(_PI // 2, PI_A, PI_B))
"""Half of pi is the sum of these: the first two times a whole number up to 2^20 are exact."""
PER_HALF_PI = _double(2 * _ONE * _ONE // _PI)
PER_LN2, PER_LN2_LOW = _in_two(_ONE * _ONE // _LN2)
PER_LN10, PER_LN10_LOW = _in_two(_ONE * _ONE // _LN10)
_TWO_PER_PI = (2 << (2 * _MANY)) // _PI_MANY >> (_MANY - (39 * 32 - 35))
TWO_PER_PI = tuple((_TWO_PER_PI >> (32 * (38 - k))) & LIMB for k in range(39))
"""2 / pi times 2^-35, by 32 binary places each."""

_root = 2 * _ONE
for _ in range(7):
    _root = math.isqrt(_root << _PLACES)
_POWERS = [_in_two(power) for power in accumulate([_ONE] + [_root] * 127, lambda a, b: a * b >> _PLACES)]
EXP = tuple(first for first, _ in _POWERS)
EXP_LOW = tuple(rest / first for first, rest in _POWERS)
"""2^(j / 128), as EXP (1 + EXP_LOW)."""
STEPS = 128.0 * PER_LN2
STEP = _cut(_LN2 // 128, 41)
STEP_LOW = _double(_rest(_LN2 // 128, STEP))
"""The logarithm of 2^(1 / 128)."""


def _inverse(j: int) -> int:
    """1024 / c, about, with c in the middle of the numbers whose first seven bits are j; above sqrt(2), of half of it.
    Next to 1 it is 1024, so that a logarithm is as precise there as elsewhere."""
    if j in (0, 127):
        return 1024
    return round((1 if j < 53 else 2) * 1024 * 256 / (257 + 2 * j))


_INVERSES = [_inverse(j) for j in range(128)]
_of_whole = {1024: 0}
for _n in sorted({_i for _i in _INVERSES if _i < 1024}, reverse=True):
    _before = min(_of_whole)
    _of_whole[_n] = _of_whole[_before] + _logarithm(_before, _n)
for _n in sorted({_i for _i in _INVERSES if _i > 1024}):
    _before = max(_of_whole)
    _of_whole[_n] = _of_whole[_before] - _logarithm(_n, _before)
_LOGARITHMS = [_in_two(_of_whole[n], 42) for n in _INVERSES]
INVERSE = tuple(n / 1024.0 for n in _INVERSES)
LOG = tuple(first for first, _ in _LOGARITHMS)
LOG_LOW = tuple(rest for _, rest in _LOGARITHMS)
"""The logarithm of 1 / INVERSE in two parts."""

_ANGLES = [*accumulate((_arctangent(64, 4096 + j * (j + 1), -1) for j in range(127)), initial=0)]
ATAN = tuple(_double(angle) for angle in _ANGLES)
ATAN_LOW = tuple(_double(_rest(angle, _double(angle))) for angle in _ANGLES)
"""The arctangent of j / 64 in two parts."""

S_1, S_2, S_3 = -0.16666666666666666, 0.008333333333330948, -0.00019841269836756774
S_4, S_5, S_6 = 2.7557316101617852e-06, -2.5051131650231316e-08, 1.5918115263038246e-10
"""sin(r) / r = 1 + S_1 r^2 + S_2 r^4 + ... up to pi / 4."""
C_1, C_2, C_3 = 0.041666666666666664, -0.0013888888888887398, 2.4801587298764557e-05
C_4, C_5, C_6 = -2.7557317271143657e-07, 2.0876146146316937e-09, -1.1382623633229816e-11
"""cos(r) = 1 - r^2 / 2 + C_1 r^4 + C_2 r^6 + ... up to pi / 4."""


# numbers and their parts


def whole_of(t):
    """The integer in a sum with MAGIC."""
    return (bits(t) & MANTISSA) - (1 << 51)


def float_of(k):
    """An integer of at most 50 bits as a float."""
    return from_bits(k + MAGIC_BITS) - MAGIC


def exact_product(a, b):
    """A product in two parts."""
    p = a * b
    a_u, b_u = from_bits(bits(a) & UPPER), from_bits(bits(b) & UPPER)
    a_v, b_v = a - a_u, b - b_u
    return p, (((a_u * b_u - p) + a_u * b_v) + a_v * b_u) + a_v * b_v


def ratio(a, a_low, b, b_low):
    """The quotient of two numbers, in two parts."""
    q = a / b
    p, rest = exact_product(q, b)
    return q, (((a - p) - rest) + (a_low - q * b_low)) / b


def root(a, a_low):
    """The square root of a number, in two parts."""
    c = math.sqrt(a)
    p, rest = exact_product(c, c)
    return c, (((a - p) - rest) + a_low) / (c + c)


# exponentials


def exp(x):
    """e^x."""
    if x != x:
        return x
    if x > 709.79:
        return INF
    if x < -745.2:
        return 0.0
    t = x * STEPS + MAGIC
    k = t - MAGIC
    r = (x - k * STEP) - k * STEP_LOW
    n = whole_of(t)
    j = n & 127
    e = (n - j) >> 7
    z = r * r
    p = EXP_LOW[j] + (r + z * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0)))))
    s = EXP[j]
    if e > -1022 and e < 1023:
        return (s + s * p) * from_bits((e + 1023) << 52)
    y = s + s * p
    return scaled(y, (s - y) + s * p, e)


def exp_in_parts(x, x_low):
    """e^x as a number in two parts, between 0.99 and 2, and the exponent of a power of two. |x| is less than 800."""
    t = x * STEPS + MAGIC
    k = t - MAGIC
    r = ((x - k * STEP) - k * STEP_LOW) + x_low
    n = whole_of(t)
    j = n & 127
    z = r * r
    p = EXP_LOW[j] + (r + z * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0)))))
    s = EXP[j]
    y = s + s * p
    return y, (s - y) + s * p, (n - j) >> 7


def scaled(y, y_low, e):
    """A number in two parts, about 1, times 2^e, rounded once."""
    if e > -1022:
        if e < 1023:
            return (y + y_low) * from_bits((e + 1023) << 52)
        if e > 1100:
            return INF
        return ((y + y_low) * from_bits(2045 << 52)) * from_bits((e + 1) << 52)
    if e < -1080:
        return 0.0
    scale = from_bits((e + 1023 + 128) << 52)
    y, y_low = y * scale, y_low * scale
    big = 2.0**-894
    if y < big:  # added to a number with the last place of the result
        h = big + y
        return ((h + (((big - h) + y) + y_low)) - big) * 2.0**-128
    return (y + y_low) * 2.0**-128


def exp2(x):
    """2^x."""
    if x != x:
        return x
    if x >= 1024.0:
        return INF
    if x < -1076.0:
        return 0.0
    t = x * 128.0 + MAGIC
    r = (x - (t - MAGIC) * 0.0078125) * LN2_DOUBLE
    n = whole_of(t)
    j = n & 127
    z = r * r
    p = EXP_LOW[j] + (r + z * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0)))))
    s = EXP[j]
    y = s + s * p
    return scaled(y, (s - y) + s * p, (n - j) >> 7)


def expm1_in_parts(x):
    """e^x - 1 of |x| < 0.35, in two parts."""
    z = x * x
    h = 0.5 * z
    p = 1.0 / 362880.0 + x * (1.0 / 3628800.0 + x * (1.0 / 39916800.0 + x * (1.0 / 479001600.0 + x / 6227020800.0)))
    p = 1.0 / 720.0 + x * (1.0 / 5040.0 + x * (1.0 / 40320.0 + x * p))
    p = 1.0 / 6.0 + x * (1.0 / 24.0 + x * (1.0 / 120.0 + x * p))
    hi = x + h
    lo = ((x - hi) + h) + x * z * p
    y = hi + lo
    return y, (hi - y) + lo


def expm1(x):
    """e^x - 1."""
    if abs(x) < 0.35:
        if abs(x) < 2.0**-54:
            return x
        y, y_low = expm1_in_parts(x)
        return y + y_low
    if x != x or x > 60.0:
        return exp(x)
    if x < -40.0:
        return -1.0
    y, y_low, e = exp_in_parts(x, 0.0)
    scale = from_bits((e + 1023) << 52)
    y, y_low = y * scale, y_low * scale
    h = y - 1.0
    if y > 1.0:
        return h + (((y - h) - 1.0) + y_low)
    return h + ((y - (h + 1.0)) + y_low)


def half_exp(x):
    """e^x / 2 and e^-x / 2, both in two parts, of x between 0 and 40."""
    y, y_low, e = exp_in_parts(x, 0.0)
    scale = from_bits((e + 1022) << 52)
    y, y_low = y * scale, y_low * scale
    q, q_low = ratio(0.25, 0.0, y, y_low)
    return y, y_low, q, q_low


def sinh(x):
    """The hyperbolic sine."""
    a = abs(x)
    if a < 0.5:
        z = x * x
        p = 1.0 / 362880.0 + z * (1.0 / 39916800.0 + z * (1.0 / 6227020800.0 + z / 1307674368000.0))
        return x + x * z * (1.0 / 6.0 + z * (1.0 / 120.0 + z * (1.0 / 5040.0 + z * p)))
    if not a < 711.0:
        return x * INF
    if a < 40.0:
        y, y_low, q, q_low = half_exp(a)
        h = y - q
        s = h + (((y - h) - q) + (y_low - q_low))
    else:
        y, y_low, e = exp_in_parts(a, 0.0)
        s = scaled(y, y_low, e - 1)
    return -s if x < 0.0 else s


def cosh(x):
    """The hyperbolic cosine."""
    a = abs(x)
    if a < 40.0:
        y, y_low, q, q_low = half_exp(a)
        h = y + q
        return h + (((y - h) + q) + (y_low + q_low))
    if not a < 711.0:
        return a * INF
    y, y_low, e = exp_in_parts(a, 0.0)
    return scaled(y, y_low, e - 1)


def tanh(x):
    """The hyperbolic tangent."""
    a = abs(x)
    if a < 0.17:
        if a < 2.0**-28:
            return x
        y, y_low = expm1_in_parts(a + a)  # y / (y + 2)
        d = y + 2.0
        t, t_low = ratio(y, y_low, d, ((2.0 - d) + y) + y_low)
        t += t_low
    elif a < 22.0:
        y, y_low, e = exp_in_parts(a + a, 0.0)  # 1 - 2 / (y + 1)
        scale = from_bits((e + 1023) << 52)
        y, y_low = y * scale, y_low * scale
        d = y + 1.0
        q, q_low = ratio(2.0, 0.0, d, ((y - d) + 1.0) + y_low)
        t = 1.0 - q
        t += ((1.0 - t) - q) - q_low
    elif a != a:
        return x
    else:
        t = 1.0
    return -t if x < 0.0 else t


# the error function

_ROOT_PI = math.isqrt(_PI << _PLACES)
SLOPE, SLOPE_LOW = _in_two(2 * _ONE * _ONE // _ROOT_PI)
"""2 / sqrt(pi)."""
PER_ROOT_PI, PER_ROOT_PI_LOW = _in_two(_ONE * _ONE // _ROOT_PI)
_NODES = range(8, 33)


def _error(k: int) -> int:
    """The error function of k / 16, by its series."""
    term, total, n = _ONE * k // 16, 0, 0
    while term:
        total += (-term if n % 2 else term) // (2 * n + 1)
        n += 1
        term = term * k * k // (256 * n)
    return 2 * _ONE * total // _ROOT_PI


def _slope(k: int) -> int:
    """2 / sqrt(pi) exp(-x^2), the slope of the error function, at x = k / 16."""
    term, total, n = 2 * _ONE * _ONE // _ROOT_PI, 0, 0
    while term:
        total += -term if n % 2 else term
        n += 1
        term = term * k * k // (256 * n)
    return total


_AT_NODES = [(_in_two(_ONE - _error(k)), _in_two(_slope(k))) for k in _NODES]
ERFC, ERFC_LOW = (tuple(each[0][k] for each in _AT_NODES) for k in (0, 1))
ERFC_SLOPE, ERFC_SLOPE_LOW = (tuple(each[1][k] for each in _AT_NODES) for k in (0, 1))
"""1 - erf(x) and the slope of erf at x = 1/2, 9/16, ... 2, each in two parts."""


def erf_in_parts(x):
    """The error function of |x| < 0.54, in two parts."""
    z = x * x
    p = 1.0 / 685440.0 + z * (-1.0 / 6894720.0 + z * (1.0 / 76204800.0 - z / 918086400.0))
    p = 1.0 / 216.0 + z * (-1.0 / 1320.0 + z * (1.0 / 9360.0 + z * (-1.0 / 75600.0 + z * p)))
    q = z * (-1.0 / 3.0 + z * (0.1 + z * (-1.0 / 42.0 + z * p)))
    y, rest = exact_product(x, SLOPE)
    return y, rest + x * SLOPE_LOW + y * q


def erfc_in_parts(x):
    """1 - erf(x) of x between 0.5 and 2, in two parts: the nearest number of a table, and the area up to x. Its height
    is exp(-2 c t - t^2) times that at c, and g has the parts of its series."""
    s = x * 16.0 + MAGIC
    j = whole_of(s) - 8
    c = (s - MAGIC) * 0.0625
    t = x - c
    before, g, power, area = 0.0, 1.0, t, 0.0
    for n in range(1, 13):
        before, g = g, -2.0 * (c * g + before) / n
        power *= t
        area += g * power / (n + 1)
    d, rest = exact_product(t, ERFC_SLOPE[j])
    low = rest + t * ERFC_SLOPE_LOW[j] + area * ERFC_SLOPE[j]
    y = ERFC[j] - d
    return y, ((ERFC[j] - y) - d) + (ERFC_LOW[j] - low)


def erfc_far(x):
    """1 - erf(x) of x between 2 and 28: exp(-x^2) / sqrt(pi) / (x + 1/2 / (x + 1 / (x + 3/2 / (x + ...))))."""
    f = x
    for k in range(80, 1, -1):
        f = x + 0.5 * k / f
    q, q_low = ratio(0.5, 0.0, f, 0.0)
    d = x + q
    d_low = ((x - d) + q) + q_low
    p, rest = exact_product(x, x)
    y, y_low, e = exp_in_parts(-p, -rest)
    top, top_low = exact_product(y, PER_ROOT_PI)
    y, y_low = ratio(top, top_low + (y * PER_ROOT_PI_LOW + y_low * PER_ROOT_PI), d, d_low)
    return y, y_low, e


def erf(x):
    """The error function."""
    a = abs(x)
    if a < 0.5:
        y, y_low = erf_in_parts(x)
        return y + y_low if a > 1e-290 else x * SLOPE
    if a != a:
        return x
    if a > 6.0:
        t = 1.0
    elif a < 2.0:
        y, y_low = erfc_in_parts(a)
        h = 1.0 - y
        t = h + (((1.0 - h) - y) - y_low)
    else:
        y, y_low, e = erfc_far(a)
        t = 1.0 - scaled(y, y_low, e)
    return -t if x < 0.0 else t


def erfc(x):
    """1 - erf(x)."""
    a = abs(x)
    if a != a:
        return x
    if a < 0.5:
        y, y_low = erf_in_parts(x)
        h = 1.0 - y
        return h + (((1.0 - h) - y) - y_low)
    if a > 27.5:
        return 2.0 if x < 0.0 else 0.0
    if a < 2.0:
        y, y_low = erfc_in_parts(a)
        if x > 0.0:
            return y + y_low
        h = 2.0 - y
        return h + (((2.0 - h) - y) - y_low)
    y, y_low, e = erfc_far(a)
    t = scaled(y, y_low, e)
    return 2.0 - t if x < 0.0 else t


# logarithms


def log(x):
    """The natural logarithm."""
    if not (x > 0.0 and x < INF):
        return no_logarithm(x)
    k = -1023
    if x < TINY:
        x *= 2.0**54
        k = -1077
    word = bits(x)
    k += word >> 52
    j = (word >> 45) & 127
    half = (j + 75) >> 7  # above sqrt(2), half of it
    k += half
    z = from_bits((word & MANTISSA) | ((1023 - half) << 52))
    inverse = INVERSE[j]
    u = from_bits(bits(z) & UPPER)
    if k == 0 and inverse == 1.0:
        d = z - 1.0
        s = d * d
        p = 0.2 + d * (-1.0 / 6.0 + d * (1.0 / 7.0 + d * (-0.125 + d * (1.0 / 9.0))))
        p = d * s * (1.0 / 3.0 + d * (-0.25 + d * p))
        u = from_bits(bits(d) & UPPER)  # its square is exact
        h = 0.5 * u * u
        hi = d - h
        return hi + ((((d - hi) - h) - 0.5 * ((d - u) * (d + u))) + p)
    a, b = u * inverse - 1.0, (z - u) * inverse
    r = a + b
    s = r * r
    p = s * (-0.5 + r * (1.0 / 3.0 + r * (-0.25 + r * (0.2 + r * (-1.0 / 6.0 + r * (1.0 / 7.0))))))
    f = float_of(k)
    base = f * LN2 + LOG[j]
    hi = base + r
    lo = ((base - hi) + r) + ((a - r) + b)
    return hi + (lo + (f * LN2_LOW + (LOG_LOW[j] + p)))


def no_logarithm(x):
    """The logarithm of a number that is not positive and finite."""
    if x == 0.0:
        return -INF
    return NAN if x < 0.0 else x


def log_in_parts(x):
    """The natural logarithm of a positive finite number, in two parts, to about 2^-66 of it."""
    k = -1023
    if x < TINY:
        x *= 2.0**54
        k = -1077
    word = bits(x)
    k += word >> 52
    j = (word >> 45) & 127
    half = (j + 75) >> 7
    f = float_of(k + half)
    z = from_bits((word & MANTISSA) | ((1023 - half) << 52))
    inverse = INVERSE[j]
    u = from_bits(bits(z) & UPPER)
    a, b = u * inverse - 1.0, (z - u) * inverse
    r = a + b
    r_low = (a - r) + b
    s, s_low = exact_product(r, r)
    p = -1.0 / 6.0 + r * (1.0 / 7.0 + r * (-0.125 + r * (1.0 / 9.0 + r * -0.1)))
    p = r * s * (1.0 / 3.0 + r * (-0.25 + r * (0.2 + r * p)))
    base = f * LN2 + LOG[j]
    first = base + r
    h = 0.5 * s
    hi = first - h
    lo = ((base - first) + r) + ((first - hi) - h)
    lo += (f * LN2_LOW + LOG_LOW[j]) + ((r_low - (0.5 * s_low + r * r_low)) + p)
    y = hi + lo
    return y, (hi - y) + lo


def log_of_base(x, factor, factor_low):
    """The logarithm times a constant in two parts."""
    if not (x > 0.0 and x < INF):
        return no_logarithm(x)
    y, y_low = log_in_parts(x)
    p, rest = exact_product(y, factor)
    return p + (rest + (y * factor_low + y_low * factor))


def log2(x):
    """The logarithm of base 2."""
    return log_of_base(x, PER_LN2, PER_LN2_LOW)


def log10(x):
    """The logarithm of base 10."""
    return log_of_base(x, PER_LN10, PER_LN10_LOW)


def log1p_in_parts(x, x_low):
    """log(1 + x) in two parts, of a number in two parts above -1 and not infinite."""
    u = 1.0 + x
    c = ((1.0 - (u - x)) if x > 1.0 else (x - (u - 1.0))) + x_low
    y, y_low = log_in_parts(u)
    return y, y_low + c / u


def log1p(x):
    """log(1 + x)."""
    if abs(x) < 2.0**-54:
        return x
    if not (x > -1.0 and x < INF):
        return no_logarithm(1.0 + x)
    y, y_low = log1p_in_parts(x, 0.0)
    return y + y_low


def asinh(x):
    """The inverse hyperbolic sine."""
    a = abs(x)
    if not (a > 2.0**-28 and a < INF):
        return x
    if a < 2.0**28:
        p, rest = exact_product(a, a)
        h = 1.0 + p
        low = (((1.0 - h) + p) if p < 1.0 else ((p - h) + 1.0)) + rest
        c, c_low = root(h, low)
        t = c - 1.0  # x + sqrt(x^2 + 1) - 1
        t_low = (c - (t + 1.0)) + c_low
        s = a + t
        y, y_low = log1p_in_parts(s, (((a - s) + t) if a > t else ((t - s) + a)) + t_low)
    else:
        y, y_low = log_in_parts(a)
        y, y_low = plus_log_2(y, y_low)
    y += y_low
    return -y if x < 0.0 else y


def plus_log_2(y, y_low):
    """A number greater than 1 in two parts, plus log(2)."""
    s = y + LN2
    return s, ((y - s) + LN2) + (y_low + LN2_LOW)


def acosh(x):
    """The inverse hyperbolic cosine."""
    if not x >= 1.0:
        return NAN
    if not x < INF:
        return x
    if x == 1.0:
        return 0.0
    if x < 2.0**28:
        p, rest = exact_product(x, x)
        h = p - 1.0
        c, c_low = root(h, ((p - h) - 1.0) + rest)
        t = x - 1.0
        s = c + t  # x + sqrt(x^2 - 1) - 1
        y, y_low = log1p_in_parts(s, ((c - s) + t) + c_low)
    else:
        y, y_low = log_in_parts(x)
        y, y_low = plus_log_2(y, y_low)
    return y + y_low


def atanh(x):
    """The inverse hyperbolic tangent."""
    a = abs(x)
    if a < 2.0**-28:
        return x
    if not a < 1.0:
        return INF * x if a == 1.0 else NAN
    d = 1.0 - a
    q, q_low = ratio(a + a, 0.0, d, (1.0 - d) - a)
    y, y_low = log1p_in_parts(q, q_low)
    y = 0.5 * (y + y_low)
    return -y if x < 0.0 else y


# powers and roots


def pow(x, y):
    """x^y."""
    if x == 1.0 or y == 0.0:
        return 1.0
    if x != x or y != y:
        return NAN
    a, odd = abs(x), False
    if bits(x) < 0:
        half = 0.5 * y
        odd = abs(y) < 2.0**53 and np.floor(y) == y and np.floor(half) != half
    if a == 0.0 or a == INF or abs(y) == INF:
        if a == 1.0:
            return 1.0
        return extreme_power(a > 1.0, y > 0.0, odd)
    if x < 0.0 and np.floor(y) != y:
        return NAN
    g, g_low = log_in_parts(a)
    p, rest = exact_product(y, g)
    if not abs(p) < 750.0:
        return extreme_power(g > 0.0, y > 0.0, odd)
    s, s_low, e = exp_in_parts(p, rest + y * g_low)
    s = scaled(s, s_low, e)
    return -s if odd else s


def extreme_power(large, up, odd):
    """A power that is infinite or 0, of a number greater or less than 1 with an exponent greater or less than 0."""
    s = INF if large == up else 0.0
    return -s if odd else s


def cbrt(x):
    """The cubic root."""
    if not (x != 0.0 and abs(x) < INF):
        return x
    a, back = abs(x), 1.0
    if a > 2.0**900:
        a, back = a * 2.0**-300, 2.0**100
    elif a < 2.0**-600:
        a, back = a * 2.0**600, 2.0**-200
        if a < 2.0**-300:
            a, back = a * 2.0**300, 2.0**-300
    # a third of the exponent, and of the bits at once: five bits of the root
    t = from_bits((((bits(a) >> 32) * 1431655765 >> 32) + 0x2A9F7893) << 32)
    for _ in range(2):
        cube = t * t * t
        t *= (cube + (a + a)) / ((cube + cube) + a)
    p, p_low = exact_product(t, t)
    cube, rest = exact_product(p, t)
    t = (t + (((a - cube) - rest) - p_low * t) / (3.0 * p)) * back
    return -t if x < 0.0 else t


def hypot(x, y):
    """sqrt(x^2 + y^2)."""
    a, b = abs(x), abs(y)
    if a == INF or b == INF:
        return INF
    if a != a or b != b:
        return NAN
    if a < b:
        a, b = b, a
    if b <= a * 2.0**-54:
        return a + b
    back = 1.0
    if a > 2.0**500:
        a, b, back = a * 2.0**-600, b * 2.0**-600, 2.0**600
    elif a < 2.0**-400:
        a, b, back = a * 2.0**600, b * 2.0**600, 2.0**-600
    p, p_low = exact_product(a, a)
    q, q_low = exact_product(b, b)
    s = p + q
    c, c_low = root(s, ((p - s) + q) + (p_low + q_low))
    return (c + c_low) * back


def fmod(x, y):
    """The exact rest of a division of floats, with the sign of x."""
    a, b = abs(x), abs(y)
    if not (a < INF and b > 0.0):
        return NAN
    if a < b:
        return x
    if b < TINY:
        b *= 2.0**100
        a = rest_of(a, b) * 2.0**100
        a = rest_of(a, b) * 2.0**-100
    else:
        a = rest_of(a, b)
    return -a if bits(x) < 0 else a


def rest_of(a, b):
    """The exact rest of a / b, of a >= 0 and b that is not subnormal. Each turn divides by b times a power of two, with
    a quotient of up to 26 bits, whose products with the halves of b are exact."""
    for _ in range(90):
        if not a >= b:
            break
        s = b
        d = (bits(a) >> 52) - (bits(b) >> 52) - 25
        if d > 0:
            if d > 1000:
                s *= 2.0**1000
                d -= 1000
            if d > 1000:
                s *= 2.0**1000
                d -= 1000
            s *= from_bits((d + 1023) << 52)
        q = a / s
        q = float_of(whole_of((q - 0.5) + MAGIC))  # at most one off
        u = from_bits(bits(s) & UPPER)
        a = (a - q * u) - q * (s - u)
        if a < 0.0:
            a += s
        if a >= s:
            a -= s
    return a


# angles


def reduced(x):
    """The quarter of a turn in which x is, and how far it is in it, up to pi / 4, in two parts."""
    if not abs(x) < 1e6:
        return reduced_far(x)
    s = x * PER_HALF_PI + MAGIC
    k = s - MAGIC
    w = x - k * PI_A
    t = k * PI_B
    hi = w - t
    b = hi - w
    lo = ((w - (hi - b)) - (t + b)) - k * PI_C
    r = hi + lo
    return whole_of(s), r, (hi - r) + lo


def reduced_far(x):
    """As :func:`reduced`, of any finite number."""
    word = bits(x)
    m = (word & MANTISSA) | (1 << 52)
    m_0, m_1 = m & LIMB, m >> 32
    # the digits of 2 / pi that give whole turns are left out
    place = ((word >> 52) & 2047) - (1075 - 33)
    at, by = (place >> 5) & 31, 32 - (place & 31)
    w = (((TWO_PER_PI[at + 5] << 32) | TWO_PER_PI[at + 6]) >> by) & LIMB
    c, d = w * m_0, 0
    p_0, p_1, p_2, p_3, p_4 = 0, 0, 0, 0, 0
    for k in range(4, -1, -1):  # the product from its end, two of its parts a turn, of which one goes on
        before = w
        w = (((TWO_PER_PI[at + k] << 32) | TWO_PER_PI[at + k + 1]) >> by) & LIMB
        c = w * m_0 + ((c >> 32) & LIMB)
        d = before * m_1 + (c & LIMB) + ((d >> 32) & LIMB)
        p_0, p_1, p_2, p_3, p_4 = d & LIMB, p_0, p_1, p_2, p_3
    quarter = p_0 >> 30
    f_0 = ((p_0 << 2) | (p_1 >> 30)) & LIMB
    f_1 = ((p_1 << 2) | (p_2 >> 30)) & LIMB
    f_2 = ((p_2 << 2) | (p_3 >> 30)) & LIMB
    f_3 = ((p_3 << 2) | (p_4 >> 30)) & LIMB
    sign = -1.0 if x < 0.0 else 1.0
    if f_0 >= 1 << 31:
        quarter += 1
        sign = -sign
        f_0, f_1, f_2, f_3 = LIMB - f_0, LIMB - f_1, LIMB - f_2, LIMB - f_3
    a, b = float_of(f_0) * 2.0**-32, float_of(f_1) * 2.0**-64
    h = a + b
    low = ((a - h) + b) + (float_of(f_2) * 2.0**-96 + float_of(f_3) * 2.0**-128)
    hi = h + low
    lo = (h - hi) + low
    p, rest = exact_product(hi, HALF_PI)
    rest += hi * HALF_PI_LOW + lo * HALF_PI
    r = p + rest
    return -quarter if x < 0.0 else quarter, sign * r, sign * ((p - r) + rest)


def sine(r, low):
    """The sine up to pi / 4, without r itself."""
    z = r * r
    p = S_1 + z * (S_2 + z * (S_3 + z * (S_4 + z * (S_5 + z * S_6))))
    return r * z * p + low * (1.0 - 0.5 * z)


def cosine(r, low):
    """The cosine up to pi / 4, in two parts."""
    z = r * r
    q = C_1 + z * (C_2 + z * (C_3 + z * (C_4 + z * (C_5 + z * C_6))))
    h = 0.5 * z
    w = 1.0 - h
    return w, ((1.0 - w) - h) + (z * z * q - r * low)


def sincos(x):
    """The sine and the cosine."""
    a = abs(x)
    if a < 2.0**-8:  # the next terms are below a twentieth of the last place
        z = x * x
        return x + x * (z * (S_1 + z * S_2)) if a > 2.0**-27 else x, 1.0 - (0.5 * z - C_1 * (z * z))
    n, r, low = 0, x, 0.0
    if not a < QUARTER_PI:
        if not a < INF:
            return NAN, NAN
        n, r, low = reduced(x)
    s = r + sine(r, low)
    c, c_low = cosine(r, low)
    c += c_low
    if n & 1:
        s, c = c, s
    return -s if n & 2 else s, -c if (n + 1) & 2 else c


def sin(x):
    """The sine."""
    return sincos(x)[0]


def cos(x):
    """The cosine."""
    return sincos(x)[1]


def tan(x):
    """The tangent."""
    a = abs(x)
    if a < 2.0**-27:
        return x
    if not a < INF:
        return NAN
    n, r, low = 0, x, 0.0
    if a >= QUARTER_PI:
        n, r, low = reduced(x)
    _, rest = exact_product(r, r)  # what the square of r lacks
    s_low = sine(r, low) + S_1 * r * rest
    s = r + s_low
    s_low = (r - s) + s_low
    w, w_low = cosine(r, low)
    w_low -= 0.5 * rest
    c = w + w_low
    c_low = (w - c) + w_low
    if n & 1:
        y, y_low = ratio(-c, -c_low, s, s_low)
    else:
        y, y_low = ratio(s, s_low, c, c_low)
    return y + y_low


def angle(small, small_low, large, large_low):
    """The arctangent of a ratio of up to 1, in two parts; so are the two numbers."""
    q = small / large
    if q < 0.0625:
        p, rest = exact_product(q, large)
        low = (((small - p) - rest) + (small_low - q * large_low)) / large
        z = q * q
        p = -1.0 / 11.0 + z * (1.0 / 13.0 + z * (-1.0 / 15.0))
        p = -1.0 / 3.0 + z * (0.2 + z * (-1.0 / 7.0 + z * (1.0 / 9.0 + z * p)))
        return q, (low if q > 1e-150 else 0.0) + q * z * p
    s = q * 64.0 + MAGIC
    j = whole_of(s) & 127
    t = (s - MAGIC) * 0.015625
    p, rest = exact_product(t, large)
    d = (((small - p) - rest) + (small_low - t * large_low)) / (large + t * small)
    z = d * d
    p = d * z * (-1.0 / 3.0 + z * (0.2 + z * (-1.0 / 7.0 + z * (1.0 / 9.0))))
    base = ATAN[j]
    hi = base + d
    return hi, ((base - hi) + d) + (ATAN_LOW[j] + p)


def in_quadrant(hi, lo, steep, negative):
    """An angle in two parts, or if steep what it lacks of pi / 2; and if negative, what that lacks of pi."""
    if steep:
        h = HALF_PI - hi
        hi, lo = h, ((HALF_PI - h) - hi) + (HALF_PI_LOW - lo)
    if negative:
        h = PI - hi
        hi, lo = h, ((PI - h) - hi) + (PI_LOW - lo)
    return hi + lo


def atan2(y, x):
    """The angle of the vector (x, y)."""
    if x != x or y != y:
        return NAN
    negative = bits(x) < 0
    a, b = abs(x), abs(y)
    steep = b > a
    large, small = (b, a) if steep else (a, b)
    if large == INF or small == 0.0:
        t = odd_angle(a, b, negative)
    elif small < large * 2.0**-60 and not steep and not negative:
        t = b / a
    else:
        # into the middle of the range: the ratio is all that counts
        e = (bits(large) >> 52) - 1023
        if e > 400:
            large, small = large * 2.0**-600, small * 2.0**-600
        elif e < -400:
            large, small = large * 2.0**600, small * 2.0**600
        hi, lo = angle(small, 0.0, large, 0.0)
        t = in_quadrant(hi, lo, steep, negative)
    return -t if bits(y) < 0 else t


def odd_angle(a, b, negative):
    """The angle of a vector (a, b) with a part that is 0 or infinite, or of (-a, b)."""
    if a == b and a != 0.0:
        return 0.75 * PI if negative else 0.25 * PI
    if b > a:
        return HALF_PI
    return PI if negative else 0.0


def atan(x):
    """The arctangent."""
    a = abs(x)
    if a < 2.0**-27 or a != a:
        return x
    if a > 2.0**60:
        t = HALF_PI
    else:
        steep = a > 1.0
        hi, lo = angle(1.0 if steep else a, 0.0, a if steep else 1.0, 0.0)
        t = in_quadrant(hi, lo, steep, False)
    return -t if x < 0.0 else t


def leg(a):
    """sqrt(1 - a^2) in two parts."""
    p, rest = exact_product(a, a)
    h = 1.0 - p
    return root(h, ((1.0 - h) - p) - rest)


def asin(x):
    """The arcsine."""
    a = abs(x)
    if a < 2.0**-27:
        return x
    if not a < 1.0:
        return HALF_PI * x if a == 1.0 else NAN
    c, c_low = leg(a)
    if a > c:
        hi, lo = angle(c, c_low, a, 0.0)
    else:
        hi, lo = angle(a, 0.0, c, c_low)
    t = in_quadrant(hi, lo, a > c, False)
    return -t if x < 0.0 else t


def acos(x):
    """The arccosine."""
    a = abs(x)
    if a < 2.0**-60:
        return HALF_PI
    if not a < 1.0:
        return (0.0 if x > 0.0 else PI) if a == 1.0 else NAN
    c, c_low = leg(a)
    if c > a:
        hi, lo = angle(a, 0.0, c, c_low)
    else:
        hi, lo = angle(c, c_low, a, 0.0)
    return in_quadrant(hi, lo, c > a, x < 0.0)


FUNCTIONS: dict[str, types.FunctionType] = {
    each.__name__: each
    for each in (
        *(exp, exp2, expm1, log, log2, log10, log1p, pow, cbrt, hypot, fmod),
        *(erf, erfc),
        *(sin, cos, tan, asin, acos, atan, atan2, sinh, cosh, tanh, asinh, acosh, atanh),
    )
}
"""The functions, by their names in C."""
CODE = {"sincos": sincos} | {name: function for name, function in FUNCTIONS.items() if name not in ("sin", "cos")}
"""The functions that machine code calls."""
