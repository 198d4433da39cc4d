"""Division by zero, NaN, overflow, rounding and signed zeros: as NumPy does them in plain Python, a table."""

import math

import numpy as np
import pytest

from compiled import Compiled, as_python, assert_equal, function_of

ODD = [0.0, -0.0, 1.0, -1.0, 2.5, -2.5, 0.5, 1.5, -0.5, 3.7, -7.3, 1e308, 1e-310, math.inf, -math.inf, math.nan]
WHOLE = [0, 1, -1, 2, -2, 3, 7, -7, 8, 2**62, -(2**62), 2**63 - 1, -(2**63)]
OF_FLOATS = [
    "a / b",
    "a // b",
    "a % b",
    "np.sign(a)",
    "np.abs(a)",
    "a**2",
    "np.sqrt(a) + a**0.5",
    "np.floor(a)",
    "np.ceil(a)",
    "np.round(a)",
    "np.copysign(a, b)",
    "1.0 * np.isnan(a) + 2.0 * np.isinf(a) + 4.0 * np.isfinite(a)",
    "1.0 * (a < b) + 2.0 * (a <= b) + 4.0 * (a == b) + 8.0 * (a != b) + 16.0 * (a >= b)",
    "np.where(a, 1.0, b)",
    "a.min() + 0.0 * b",
    "b[:7].min() + 0.0 * b",
    "a[:5].max() + 0.0 * b",
    "np.argmin(a) + 100.0 * np.argmax(b) + 0.0 * np.sign(a)",
    "min(b[2], b[15]) + 0.0 * a",
    "max(b[15], b[2]) + 0.0 * a",
    "np.fmin(a, 1.0) + np.fmax(b, 0.5)",
]
OF_ANY_ZERO = ["np.minimum(a, b) * 2.0", "np.maximum(a, b) * 2.0", "np.clip(a, -1.0, 2.0)", "np.clip(b, a, 3.0)"]
"""NumPy's own sign of zero depends on the length."""
OF_INTEGERS = ["a + b", "a * b - a", "a // c", "a % c", "a**3 + b**0", "np.sign(a) * np.abs(b)"]


def both_ways(expressions, numbers):
    """The results of expressions of all pairs of numbers, as machine code and as plain Python. c is b without 0."""
    n, kind = len(numbers), np.asarray(numbers).dtype
    out = np.dtype([(f"r{k}", kind, (n,)) for k in range(len(expressions))], align=True)
    body = "\n".join(f"o.r{k}[:] = {text}" for k, text in enumerate(expressions))
    function = function_of("a, b, c, o", body, globals())
    code = Compiled(function, [(kind, (n,))] * 3 + [out])
    for shift in range(n):
        a, b = np.array(numbers), np.roll(numbers, shift)
        c = np.where(b == 0, 5, b)
        mine, theirs = np.zeros(1, out), np.zeros(1, out)
        assert code(a, b, c, mine) == 0
        with np.errstate(all="ignore"):
            function(a, b, c, as_python(theirs))
        for k, text in enumerate(expressions):
            yield text, mine[f"r{k}"], theirs[f"r{k}"]


@pytest.mark.parametrize(
    ("expressions", "numbers"), [(OF_FLOATS, ODD), (OF_INTEGERS, WHOLE)], ids=["floats", "integers wrap around"]
)
def test_odd_numbers_give_what_numpy_gives(expressions, numbers):
    for text, mine, theirs in both_ways(expressions, numbers):
        assert_equal(mine, theirs, True, text)


def test_extremes_give_what_numpy_gives_whatever_the_sign_of_zero():
    for text, mine, theirs in both_ways(OF_ANY_ZERO, ODD):
        assert_equal(mine + 0.0, theirs + 0.0, True, text)


def test_a_sum_along_an_axis_is_numpys_bit_for_bit():
    def totals(x, out):
        out[:3] = x.sum(axis=0)
        out[3:] = x.T.copy().sum(axis=1)

    x, mine, theirs = np.random.default_rng(4).normal(size=(20, 3)) * 1e3, np.zeros(6), np.zeros(6)
    assert Compiled(totals, [("f8", (20, 3)), ("f8", (6,))])(x, mine) == 0
    totals(x, theirs)
    np.testing.assert_array_equal(mine, theirs)


def test_a_sum_is_numpys_bit_for_bit_whatever_its_length():
    def total(x, out):
        out[0] = x.sum()
        out[1] = np.mean(x)

    random = np.random.default_rng(3)
    for n in (1, 7, 8, 9, 17, 127, 128, 129, 200, 1000):
        x, mine, theirs = random.normal(size=n) * 10.0 ** random.integers(-8, 8, n), np.zeros(2), np.zeros(2)
        assert Compiled(total, [("f8", (n,)), ("f8", (2,))])(x, mine) == 0
        total(x, theirs)
        np.testing.assert_array_equal(mine, theirs)
