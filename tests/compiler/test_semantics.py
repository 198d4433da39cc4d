"""Division by zero, NaN, overflow, rounding and signed zeros: as NumPy does them in plain Python, a table."""

import math

import numpy as np
import pytest

from compiled import Compiled, assert_equal

ODD = [0.0, -0.0, 1.0, -1.0, 2.5, -2.5, 0.5, 1.5, -0.5, 3.7, -7.3, 1e308, 1e-310, math.inf, -math.inf, math.nan]
WHOLE = [0, 1, -1, 2, -2, 3, 7, -7, 8, 2**62, -(2**62), 2**63 - 1, -(2**63)]
FLOATS, NUMBERS = np.dtype(("f8", (16,))), np.dtype(("i8", (13,)))


def quotient(a, b, out):
    out[:] = a / b


def floor_quotient(a, b, out):
    out[:] = a // b


def remainder(a, b, out):
    out[:] = a % b


def minimum(a, b, out):
    out[:] = np.minimum(a, b) * 2.0


def maximum(a, b, out):
    out[:] = np.maximum(a, b) * 2.0


def clipped(a, b, out):
    out[:] = np.clip(a, -1.0, 2.0)


def clipped_by_nan(a, b, out):
    out[:] = np.clip(b, a, 3.0)


def signs(a, b, out):
    out[:] = np.sign(a)


def magnitudes(a, b, out):
    out[:] = np.abs(a)


def squares(a, b, out):
    out[:] = a**2


def roots(a, b, out):
    out[:] = np.sqrt(a) + a**0.5


def floors(a, b, out):
    out[:] = np.floor(a)


def ceilings(a, b, out):
    out[:] = np.ceil(a)


def rounded(a, b, out):
    out[:] = np.round(a)


def copied_sign(a, b, out):
    out[:] = np.copysign(a, b)


def kinds_of_numbers(a, b, out):
    out[:] = 1.0 * np.isnan(a) + 2.0 * np.isinf(a) + 4.0 * np.isfinite(a)


def compared(a, b, out):
    out[:] = 1.0 * (a < b) + 2.0 * (a <= b) + 4.0 * (a == b) + 8.0 * (a != b) + 16.0 * (a >= b)


def chosen(a, b, out):
    out[:] = np.where(a, 1.0, b)


def least(a, b, out):
    out[:] = a.min()
    out[1] = b[:7].min()
    out[2] = np.argmin(a) + 100.0 * np.argmax(b)
    out[3] = a[:5].max()
    out[4] = min(b[2], b[15])
    out[5] = max(b[15], b[2])


def fused_extremes(a, b, out):
    out[:] = np.fmin(a, 1.0) + np.fmax(b, 0.5)


@pytest.mark.parametrize(
    "function",
    [
        quotient, floor_quotient, remainder, minimum, maximum, clipped, clipped_by_nan, signs, magnitudes, squares,
        roots, floors, ceilings, rounded, copied_sign, kinds_of_numbers, compared, chosen, least, fused_extremes,
    ],
    ids=lambda function: function.__name__,
)  # fmt: skip
def test_odd_floats_give_what_numpy_gives(function):
    code = Compiled(function, [FLOATS] * 3)
    for shift in range(16):
        a, b = np.array(ODD), np.roll(ODD, shift)
        mine, theirs = np.zeros(16), np.zeros(16)
        assert code(a, b, mine) == 0
        with np.errstate(all="ignore"):
            function(a, b, theirs)
        if function in (minimum, maximum, clipped, clipped_by_nan):  # NumPy's own sign of zero depends on the length
            mine, theirs = mine + 0.0, theirs + 0.0
        assert_equal(mine, theirs, exact=True)


def sums(a, b, out):
    out[:] = a + b


def products(a, b, out):
    out[:] = a * b - a


def whole_quotients(a, b, out):
    out[:] = a // b


def whole_remainders(a, b, out):
    out[:] = a % b


def powers(a, b, out):
    out[:] = a**3 + b**0


def whole_signs(a, b, out):
    out[:] = np.sign(a) * np.abs(b)


@pytest.mark.parametrize(
    "function",
    [sums, products, whole_quotients, whole_remainders, powers, whole_signs],
    ids=lambda function: function.__name__,
)
def test_integers_wrap_around_as_numpys_do(function):
    code = Compiled(function, [NUMBERS] * 3)
    for shift in range(13):
        a, b = np.array(WHOLE), np.roll(WHOLE, shift)
        if function in (whole_quotients, whole_remainders):
            b = np.where(b == 0, 5, b)
        mine, theirs = np.zeros(13, int), np.zeros(13, int)
        assert code(a, b, mine) == 0
        with np.errstate(all="ignore"):
            function(a, b, theirs)
        np.testing.assert_array_equal(mine, theirs)


def test_a_sum_is_numpys_bit_for_bit_whatever_its_length():
    def total(x, out):
        out[0] = x.sum()
        out[1] = np.mean(x)

    random = np.random.default_rng(3)
    for n in (1, 2, 7, 8, 9, 15, 16, 17, 64, 127, 128, 129, 200, 1000):
        x, mine, theirs = random.normal(size=n) * 10.0 ** random.integers(-8, 8, n), np.zeros(2), np.zeros(2)
        assert Compiled(total, [("f8", (n,)), ("f8", (2,))])(x, mine) == 0
        total(x, theirs)
        np.testing.assert_array_equal(mine, theirs)
