"""Python as strangers write it is compiled to what Python computes, or is left to Python."""

import math
import types

import numpy as np
import pytest

from compiled import Compiled, arguments, as_python, assert_equal, compare, defined
from uvms_mj.compiler.refusals import Lacking, Mistake
from uvms_mj.engine.native.twin import twin

GIVEN = np.dtype([("k", "f8"), ("n", "i8"), ("x", "f8", (6,)), ("y", "f8", (6,)), ("A", "f8", (6, 6))], align=True)
OUT = np.dtype([("x", "f8", (6,)), ("s", "f8", (40,)), ("A", "f8", (6, 6))], align=True)
HELPERS = """
def pushed(x, e):
    x[-1] += e
    return x[0] + e

def stepped(x):
    x += 1.0
    return x

def raised(x, a):
    return x**a

def raised_by_numpy(x, a):
    return np.power(x, a)

class Proportional:
    def __init__(self, gain):
        self.gain = gain
    def update(self, e):
        return self.gain * e

LAW = Proportional(2.0)
POINTS = [(0.0, 0.5), (10.0, 1.0), (10.0, 10.0)]
ROWS = ([1, 2.5], [3.0, 4.0], [5, 6])

def predicted(x, P):
    x = x + 1.0
    P = P @ P
    return x, P

def the_one_before(x):
    y = x
    x = x + 1.0
    x[0] = 3.0
    return y

def one_of_two(x, is_first):
    x = 1.0 * x
    y = x if is_first else x + 1.0
    y[0] = 9.0
    return x

def perhaps_doubled(x, is_doubled):
    z = is_doubled and (x := 2.0 * x) is None
    return x

def total(x):
    x = x[:3]
    x = x.sum()
    return x
"""


def program(body: str) -> types.FunctionType:
    lines = "".join(f"    {line}\n" for line in body.replace(" ;; ", "\n").splitlines())
    return defined(f"{HELPERS}\ndef program(g, o):\n{lines}", {"np": np, "math": math})


SAME = [
    # in place, on what the list holds
    "w = [g.x.copy()] ;; a = w[0] ;; w[0] += 1.0 ;; o.x[:] = a",
    "w = [g.x.copy(), 2.0] ;; a = w[0] ;; w[0] *= w[1] ;; w[1] += 1.0 ;; o.x[:] = a + w[1]",
    "d = {'a': g.x.copy()} ;; b = d['a'][:3] ;; d['a'] -= g.y ;; o.x[:3] = b",
    "w = [o.x, o.x] ;; w[0] += g.x ;; w[1] += w[0]",
    "w = [np.arange(3)] ;; a = w[0] ;; w[0] = w[0] + 1.5 ;; o.x[:3] = a + w[0]",
    # each value is made at its turn
    "z = g.x.copy() ;; for e in reversed(z): ;;     z[0] = 5.0 ;;     o.s[0] += e",
    "z = g.x.copy() ;; for e in (2.0 * a for a in z): ;;     z[5] = 5.0 ;;     o.s[0] += e",
    "z = g.x.copy() ;; for e in map(abs, z): ;;     z[5] = 5.0 ;;     o.s[0] += e",
    "z = g.x.copy() ;; for a, b in zip(z, reversed(z)): ;;     z[0] = 5.0 ;;     o.s[0] += a * b",
    "z = g.x.copy() ;; o.x[:] = sum(stepped(z) for _ in range(3))",
    "z = g.x.copy() ;; o.x[:] = [pushed(z, e) for e in z]",
    "z = g.x.copy() ;; o.s[0] = any(pushed(z, 3.0) > 100.0 or e > 6.0 for e in z) ;; o.x[:] = z",
    "for i in reversed(range(g.n % 6)): ;;     o.s[i] = g.x[i] + 0.5 * o.s[i + 1]",
    "a = 3.0 ;; o.s[0] = sum(a * e for e in (2.0 * a for a in g.x))",
    "o.x[:] = list(map(float, g.x)) ;; o.s[0] = sum((e for e in g.x), start=1.0)",
    "o.x[:] = list(map(np.tanh, g.x))",
    # a part of a list is a list
    "v = [1.0, 2.0, 3.0] ;; v = v[-2:] + [g.k] ;; o.s[0] = sum(v) + isinstance(v[:1], list)",
    "o.s[0] = 1.0 * ([1, 2, 3][:2] == [1, 2])",
    # names and arguments bound anew
    "a = g.x.copy() ;; b, P = predicted(a, g.A) ;; a[0] = 7.0 ;; o.x[:] = b ;; o.A[:] = P",
    "a = g.x.copy() ;; b = the_one_before(a) ;; b[1] = 7.0 ;; o.x[:] = a",
    "a = g.x.copy() ;; b = one_of_two(a, g.k > 0.0) ;; b[1] = 7.0 ;; o.x[:] = a ;; o.s[:6] = b",
    "o.s[0] = total(g.x)",
    # an entry of a table of tuples is a tuple
    "a, b = POINTS[g.n % 3] ;; o.s[0] = a - b ;; o.s[1] = len(POINTS[g.n % 3] * 2)",
    "o.s[0] = isinstance(ROWS[g.n % 3], list) ;; o.s[1] = sum(ROWS[g.n % 3])",
    "o.s[2] = POINTS[g.n % 3] == (10.0, 1.0)",
    # what is tried, and does not raise
    "try: ;;     o.x[:] = np.linalg.solve(g.A, g.x) ;; except np.linalg.LinAlgError: ;;     o.x[:] = 0.0",
    "for e in g.x: ;;     try: ;;         o.s[0] += 1.0 / e ;;     except ZeroDivisionError: ;;         continue",
    # what is known of an object
    "o.s[0] = hasattr(g, 'k') + 2.0 * hasattr(g, 'kk') ;; o.s[1] = getattr(g, 'kk', 3.0) * getattr(g, 'k')",
    "o.s[0] = LAW.update(g.k) + getattr(LAW, 'gain')",
    "o.s[0] = np.size(g.A, 0) + np.size(g.A) + np.ndim(g.k) + np.shape(g.A)[1] + len(np.shape(g.k))",
    "o.x[:] = np.r_[g.x[:3], 0.0, g.n, g.k] ;; o.A[:] = np.c_[g.A[:, :5], g.x]",
    "o.s[:6] = np.c_[g.x[:3], g.y[:3]].T.ravel()",
    # numbers of NumPy
    "o.s[0] = g.x[2].item() + g.x.sum().item() + np.abs(g.k).sum() + g.k.item() + (g.x @ g.y).mean()",
]


@pytest.mark.parametrize("body", SAME)
def test_equal_bit_for_bit(body):
    function = program(body)
    code, random = Compiled(function, [GIVEN, OUT]), np.random.default_rng(0)
    for _ in range(8):
        mine = arguments([GIVEN, OUT], random)
        theirs = [each.copy() for each in mine]
        assert code(*mine) == 0
        twin(function)(*(as_python(each) for each in theirs))
        assert_equal(mine[1], theirs[1], exact=True)


LEFT_TO_PYTHON = [
    "o.s[0] = math.sin(g.k).mean()",
    "o.x[:] = perhaps_doubled(o.x, g.k > 0.0)",
    "o.s[0] = g.x.item(1).sum()",
    "a = 1.5 ;; o.s[0] = a.size",
    "o.x[:] = np.r_[0:6]",
    "try: ;;     o.s[0] = math.sqrt(g.k) ;; except ValueError: ;;     pass",
    "try: ;;     o.s[0] = float(g.k) ** 1000 ;; except OverflowError: ;;     pass",
    "f = lambda: 1.0 / float(g.k) ;; try: ;;     o.s[0] = f() ;; except ZeroDivisionError: ;;     pass",
    "try: ;;     o.s[0] = 1.0 ;; finally: ;;     o.s[1] = 2.0",
    "o.s[0] = hasattr(g.x, 'sum')",
    "o.x[:] = g.x ** np.full(1, 0.5)",
    "for e in (a for a in g.x if a > 0.0): ;;     o.s[0] += e",
]


@pytest.mark.parametrize("body", LEFT_TO_PYTHON)
def test_left_to_python(body):
    with pytest.raises(Lacking):
        Compiled(program(body), [GIVEN, OUT])


@pytest.mark.parametrize(
    "tried", ["np.linalg.solve(0.0 * g.A, g.x)[0]", "1.0 / (0.0 * float(g.k))", "g.x[6 + g.n * g.n]"]
)
def test_machine_code_ends_where_what_is_tried_raises(tried):
    function = program(f"try: ;;     o.s[0] = {tried} ;; except Exception: ;;     o.s[0] = 3.0")
    mine = arguments([GIVEN, OUT], np.random.default_rng(0))
    assert Compiled(function, [GIVEN, OUT])(*mine) != 0
    function(*(as_python(each) for each in mine))
    assert mine[1]["s"][0, 0] == 3.0


def test_a_sequence_of_more_axes_is_refused_as_numpy_refuses_it():
    function = program("o.x[:3] = (g.x[:3],)")
    with pytest.raises(Mistake):
        Compiled(function, [GIVEN, OUT])
    with pytest.raises(ValueError, match="sequence"):
        function(*(as_python(each) for each in arguments([GIVEN, OUT], np.random.default_rng(0))))


BASES = ["z", "z[0]", "z[1]", "np.abs(g.x)", "abs(g.k)", "np.arange(6)"]


@pytest.mark.parametrize(
    "exponent", ["0.5", "2", "-1.0", "1", "0.0", "3", "0.5 + 0.0 * o.s[1]", "2.0 + 0.0 * o.s[1]", "g.k"]
)
@pytest.mark.parametrize("power", ["({})**({})", "raised({}, {})", "np.power({}, {})", "raised_by_numpy({}, {})"])
def test_a_power_is_that_of_numpy_wherever_its_exponent_is_known(power, exponent):
    """The roots of -inf and -0.0 are NaN and -0.0, their powers of 0.5 inf and 0.0: arrays have roots."""
    lines = ["z = np.array([-np.inf, -0.0, 0.3, -1.5, np.inf, np.nan])", "o.s[1] = 1.0"]
    whole = exponent in ("-1.0", "0.0", "0.5", "g.k") or "+" in exponent
    for base in BASES[: 6 if whole else 5]:
        lines.append(f"o.x[:] = {power.format(base, exponent)}")
        lines.append(
            "o.A[0] = 0.5 * o.A[0] + np.where(np.isfinite(o.x), o.x, 7.0) + np.isnan(o.x) + np.sign(1.0 / o.x)"
        )
    function = program("\n".join(lines))
    code, random = Compiled(function, [GIVEN, OUT]), np.random.default_rng(0)
    mine = arguments([GIVEN, OUT], random)
    mine[0]["x"] = np.abs(mine[0]["x"])
    theirs = [each.copy() for each in mine]
    assert code(*mine) == 0
    with np.errstate(all="ignore"):
        twin(function)(*(as_python(each) for each in theirs))
    assert_equal(mine[1], theirs[1], exact=True)
    with np.errstate(all="ignore"):
        compare(function, [GIVEN, OUT], exact=False, runs=3, code=code)
