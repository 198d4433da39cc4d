"""The library of our own: the same bits as machine code and as plain Python, and how far it is from the true values."""

import math
import re
from decimal import Decimal, localcontext

import llvmlite.binding as llvm
import numpy as np
import pytest

from compiled import Compiled, assert_equal, function_of
from uvms_mj.compiler import builtin, libm
from uvms_mj.compiler.targets import PTX, inline_libm
from uvms_mj.compiler.unit import Unit, translate

TWO = ("atan2", "pow", "hypot", "fmod")
INSTRUCTIONS = {"sqrt", "fabs", "copysign"}
NUMPYS = {
    name: functions[-1] if isinstance(functions[-1], np.ufunc) else np.vectorize(functions[-1], otypes=[float])
    for name, functions in (builtin._ONE | builtin._TWO).items()
} | {"pow": np.power}
SPECIAL = [0.0, 1.0, math.inf, 5e-324, 1e-310, 2.0**-1022, 0.5, 2.0, 2.5, 3.0, 1.7976931348623157e308, 1e300, 2.0**53]
SPECIAL += [2.0**53 + 2.0, 2.0**52 + 1.0, 709.79, 710.4, 745.2, 1.0 - 2.0**-53, 1.0 + 2.0**-52, math.pi / 2, 22.0, 1e6]
SPECIAL += [math.nan, *(-x for x in SPECIAL)]
BOUNDS = {"sin": 0.83, "cos": 0.83, "tan": 1.0, "acos": 0.77, "expm1": 0.67}
"""Errors [ulp] that no argument of these tests exceeds. Of all the others 0.6."""


def call(name, x="x[i]", y="y[i]"):
    return f"math.{name}({x}, {y})" if name in TWO else f"math.{name}({x})"


def compiled(expression, n, **options):
    """Machine code of an expression of the entries of two arrays."""
    body = f"for i in range({n}):\n    out[i] = {expression}"
    function = function_of("x, y, out", body, {"math": math, "np": np})
    return Compiled(function, [("f8", (n,))] * 3, **options)


def plainly(name, x, y):
    function = libm.FUNCTIONS[name]
    pairs = zip(x.tolist(), y.tolist(), strict=True)
    return np.array([function(a, b) if name in TWO else function(a) for a, b in pairs])


def numbers(random, n):
    """Of all exponents, and some that most functions do something with."""
    every = random.integers(-(2**63), 2**63, n).view(float)
    some = np.choose(random.integers(0, 3, n), [random.uniform(-1, 1, n), random.normal(0, 30, n), 1 + every % 1e-3])
    return np.where(random.random(n) < 0.4, every, some)


@pytest.fixture(scope="module")
def arguments():
    random = np.random.default_rng(3)
    pairs = np.array([(a, b) for a in SPECIAL for b in SPECIAL])
    with np.errstate(all="ignore"):
        return [np.concatenate([part, numbers(random, 1500)]) for part in pairs.T]


@pytest.mark.parametrize("name", libm.FUNCTIONS)
def test_machine_code_gives_the_bits_of_plain_python(name, arguments):
    """And values that are not finite, or 0, are NumPy's; all others are close to them."""
    x, y = arguments
    mine = np.zeros(len(x))
    assert compiled(call(name), len(x))(x, y, mine) == 0
    assert_equal(mine, plainly(name, x, y), True)
    with np.errstate(all="ignore"):
        theirs = NUMPYS[name](x, y) if name in TWO else NUMPYS[name](x)
    np.testing.assert_allclose(mine, theirs, rtol=0.0 if name == "fmod" else 2e-15, atol=1e-323)
    sure = (theirs == 0.0) | np.isinf(theirs)
    assert_equal(mine[sure], theirs[sure], True)
    assert (np.signbit(mine) == np.signbit(theirs))[~np.isnan(theirs)].all()


# true values, by decimal numbers


def arctangent(x):
    """By halving the angle until a series is short."""
    halvings = 0
    while abs(x) > Decimal("0.05"):
        x, halvings = x / (1 + (1 + x * x).sqrt()), halvings + 1
    term, total, k = x, Decimal(0), 1
    while abs(term) > abs(x).scaleb(-45):
        total, term, k = total + term / k, -term * x * x, k + 2
    return total * 2**halvings


def pi(places):
    with localcontext(prec=places + 10):

        def inverse(n):
            term, total, k = 1 / Decimal(n), Decimal(0), 1
            while term.adjusted() > -places - 10:
                total += term / k if k % 4 == 1 else -term / k
                term, k = term / (n * n), k + 2
            return total

        return 16 * inverse(5) - 4 * inverse(239)


PI = pi(380)


def sine_and_cosine(x):
    with localcontext(prec=380):
        quarters = (x / (PI / 2)).to_integral_value()
        r = x - quarters * PI / 2
    r, turned = +r, int(quarters) % 4
    results = []
    for first in (r, Decimal(1)):
        term, total, k = first, Decimal(0), 2 if first is r else 1
        while term and term.adjusted() > first.adjusted() - 42:
            total, term, k = total + term, -term * r * r / (k * (k + 1)), k + 2
        results.append(total)
    s, c = results
    return [(s, c), (c, -s), (-s, -c), (-c, s)][turned]


def error_function(x):
    with localcontext(prec=420):
        term, total, n = x, Decimal(0), 0
        while term and term.adjusted() > -400:
            total, n = total + term / (2 * n + 1), n + 1
            term = -term * x * x / n
        return 2 * total / PI.sqrt()


def angle(y, x):
    t = arctangent(abs(y) / abs(x))
    return (PI - t if x < 0 else t).copy_sign(y)


TRUE = {
    "exp": lambda x: x.exp(),
    "exp2": lambda x: (x * Decimal(2).ln()).exp(),
    "expm1": lambda x: x.exp() - 1,
    "log": lambda x: x.ln(),
    "log2": lambda x: x.ln() / Decimal(2).ln(),
    "log10": lambda x: x.log10(),
    "log1p": lambda x: (1 + x).ln(),
    "pow": lambda x, y: (y * x.ln()).exp(),
    "cbrt": lambda x: (abs(x).ln() / 3).exp().copy_sign(x),
    "hypot": lambda x, y: (x * x + y * y).sqrt(),
    "sin": lambda x: sine_and_cosine(x)[0],
    "cos": lambda x: sine_and_cosine(x)[1],
    "tan": lambda x: sine_and_cosine(x)[0] / sine_and_cosine(x)[1],
    "asin": lambda x: arctangent(x / (1 - x * x).sqrt()),
    "acos": lambda x: angle((1 - x * x).sqrt(), x),
    "atan": arctangent,
    "atan2": angle,
    "sinh": lambda x: (x.exp() - (-x).exp()) / 2,
    "cosh": lambda x: (x.exp() + (-x).exp()) / 2,
    "tanh": lambda x: 1 - 2 / ((2 * x).exp() + 1),
    "asinh": lambda x: (x + (x * x + 1).sqrt()).ln(),
    "acosh": lambda x: (x + (x * x - 1).sqrt()).ln(),
    "erf": lambda x: error_function(x),
    "erfc": lambda x: 1 - error_function(x),
    "atanh": lambda x: ((1 + x) / (1 - x)).ln() / 2,
}
RANGES = {
    **dict.fromkeys(("exp", "sinh", "cosh"), (1e-6, 700.0)),
    **dict.fromkeys(("log", "log2", "log10", "cbrt"), (1e-300, 1e300)),
    **dict.fromkeys(("sin", "cos", "tan"), (1e-6, 1e300)),
    **dict.fromkeys(("atan2", "hypot", "atan"), (1e-5, 1e5)),
    **dict.fromkeys(("asin", "acos", "atanh"), (1e-6, 1.0)),
    **{"exp2": (1e-6, 1000.0), "pow": (1e-3, 1e3), "expm1": (1e-6, 30.0), "tanh": (1e-6, 20.0)},
    **{"erf": (1e-6, 6.0), "erfc": (1e-6, 12.0)},
    **{"log1p": (1e-6, 1e6), "asinh": (1e-6, 1e6), "acosh": (1.0, 1e6)},
}
POSITIVE = ("log", "log2", "log10", "log1p", "pow", "acosh")


def errors(name, arguments):
    """How far the results are from the true ones [ulp]."""
    for given in arguments:
        mine = libm.FUNCTIONS[name](*given)
        with localcontext(prec=60):
            true = TRUE[name](*map(Decimal, given))
            yield float(abs(Decimal(mine) - true) / Decimal(math.ulp(float(true))))


@pytest.mark.parametrize("name", sorted(set(libm.FUNCTIONS) - {"fmod"}))
def test_results_are_close_to_the_true_ones(name):
    random, (low, high) = np.random.default_rng(8), RANGES[name]
    x, y = np.exp(random.uniform(math.log(low), math.log(high), (2, 120)))
    x[::2] = random.uniform(low, min(high, 8.0 if name in ("sin", "cos", "tan") else high), 60)
    signs = random.choice([-1.0, 1.0], (2, 120))
    x, y = x if name in POSITIVE else signs[0] * x, signs[1] * (y % 60.0 if name == "pow" else y)
    pairs = zip(x.tolist(), y.tolist(), strict=True)
    assert max(errors(name, [(a, b) if name in TWO else (a,) for a, b in pairs])) < BOUNDS.get(name, 0.6)


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_small_angles(name):
    """On both sides of 1/256, below which two terms are taken."""
    beside = [math.nextafter(2.0**-8, 0.0), 2.0**-8, math.nextafter(2.0**-8, 1.0)]
    angles = [*beside, *np.geomspace(2.0**-30, 2.0**-6, 200).tolist(), *np.linspace(2.0**-9, 2.0**-6, 200).tolist()]
    assert max(errors(name, [(sign * x,) for x in angles for sign in (1.0, -1.0)])) < 0.56


NEXT_TO_A_QUARTER_TURN = 6381956970095103 * 2.0**797


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_an_argument_that_is_next_to_a_multiple_of_half_pi(name):
    """No double is closer to one."""
    assert max(errors(name, [(NEXT_TO_A_QUARTER_TURN,), (-NEXT_TO_A_QUARTER_TURN,)])) < BOUNDS[name]


@pytest.mark.parametrize("name", ["exp", "exp2", "pow", "cbrt", "atan2", "sinh", "tanh", "log1p", "log"])
def test_numbers_that_are_almost_too_small(name):
    tiny = [5e-324, 1.5e-323, 2.0**-1030, 1.1e-308, 2.0**-1022, 3e-300]
    given = {
        "exp": [(math.log(x),) for x in tiny],
        "exp2": [(math.log2(x),) for x in tiny],
        "pow": [(0.37, math.log(x) / math.log(0.37)) for x in tiny],
        "atan2": [(x, 1.3) for x in tiny] + [(x, 2.9e-310) for x in tiny] + [(1e-150, 7e130), (2e-12, 3e290)],
    }.get(name, [(x,) for x in tiny])
    if name in ("sinh", "tanh", "log1p"):  # where the true value is the argument, but for what no double has
        assert all(libm.FUNCTIONS[name](*each) == each[0] for each in given)
    else:
        assert max(errors(name, given)) < 0.6


def test_powers_of_two_are_exact():
    """A power in the language may be one of ours."""
    for k in range(-1074, 1024):
        assert libm.pow(2.0, float(k)) == libm.exp2(float(k)) == 2.0**k
        assert libm.log2(2.0**k) == k


def test_operators_of_floats_give_the_bits_of_python(arguments):
    """Their rests are exact, also of numbers whose exponents are far apart."""
    x, y = arguments
    for expression, theirs in (("x[i] % y[i]", np.remainder), ("x[i] // y[i]", np.floor_divide)):
        mine = np.zeros(len(x))
        assert compiled(expression, len(x))(x, y, mine) == 0
        with np.errstate(all="ignore"):
            assert_equal(mine, theirs(x, y), True, expression)


def test_every_function_of_c_is_ours_or_an_instruction():
    called = set(builtin._ONE) | set(builtin._TWO)
    assert called - INSTRUCTIONS == set(libm.FUNCTIONS)


def test_no_library_is_called_and_no_product_and_sum_is_rounded_once():
    """Even where a caller's may be, and in code for a GPU."""
    lines = [call(name, "x[0]", "x[1]") for name in [*libm.FUNCTIONS, *(INSTRUCTIONS - {"copysign"})]]
    lines += ["math.copysign(x[0], x[1])", "math.floor(x[0])", "x[0] % x[1]"]
    body = "\n".join(f"x[{k}] = {line} * x[3] + x[4]" for k, line in enumerate(lines))
    function = function_of("x", body, {"math": math})
    unit = Unit("tested", fused=[function])
    translate(unit, function, [np.dtype(("f8", (len(lines),)))], "tested")
    module = llvm.parse_assembly(str(unit.module))
    inline_libm(module)
    text = str(module)
    assert all(name.startswith("llvm.") for name in re.findall(r'declare .*?@"?([\w.]+)', text))
    parts = {re.match(r'[^@]*@"?([\w.]+)', part)[1]: part for part in text.split("\ndefine ")[1:]}
    assert {name.partition(".")[0] for name, part in parts.items() if "contract" in part} <= {"tested", "remainder"}

    plain = Unit("tested")
    translate(plain, function, [np.dtype(("f8", (len(lines),)))], "tested")
    code = PTX.code(llvm.parse_assembly(str(plain.module))).decode()
    assert {"sqrt.rn.f64", "copysign.f64"} <= set(re.findall(r"[\w.]+", code))
    assert not re.findall(r"\bfma|\.extern|(?:mul|add|sub|div)\.f64", code)
