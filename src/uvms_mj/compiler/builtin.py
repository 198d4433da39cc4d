"""The functions of Python, ``math`` and NumPy that are part of the language.

Each is an entry of a table, from the function to what writes its code. To add one, add an entry: a function of C in
``_ONE`` or ``_TWO``, another one of numbers in ``_ELEMENTWISE``, a reduction in ``_REDUCTIONS``; of arrays a function
with ``@entry``, with its loop in :mod:`.library`.
"""

from __future__ import annotations  # the binding of arguments reads the names of types

import ast
import math
from collections.abc import Callable, Sequence
from functools import partial, reduce
from typing import Any

import numpy as np
from llvmlite import ir

from . import library, matrices, reductions, shapes  # noqa: F401  # they add their functions
from .arrays import Arrays
from .calls import (
    FUNCTIONS,
    METHODS,
    PROPERTIES,
    Array,
    Flag,
    Floats,
    Known,
    Node,
    Parts,
    Sizes,
    Type,
    Whole,
    entry,
    stored,
)
from .values import BOOL, DOUBLE, FLOAT, INT, WORD, Value, bundle, contiguous, items_of, scalar, whole

__all__ = ["FUNCTIONS", "METHODS", "PROPERTIES"]


# functions of numbers, applied to each entry


def _c(name: str) -> Callable[..., Value]:
    return lambda at, *values: at.c_function(name, values)


def _operator(name: str) -> Callable[..., Value]:
    return lambda at, a, b: at.operation(name, a, b)


def _scaled(factor: float) -> Callable[..., Value]:
    return lambda at, x: at.operation("Mult", x, at.constant(factor))


def _compared(sign: str) -> Callable[..., Value]:
    return lambda at, a, b: at.comparison(sign, a, b)


def _of_library(function: Any) -> Callable[..., Value]:
    """A function of floats."""
    return lambda at, *values: at.written(function, [scalar(at.float_of(each), FLOAT) for each in values])


def _kept(name: str) -> Callable[..., Value]:
    """A rounding that leaves integers as they are."""
    return lambda at, x: at.c_function(name, [x]) if x.kind.base == FLOAT else x


def _whole(name: str) -> Callable[..., Value]:
    return lambda at, x: at.fits_python(name, x) if x.kind.base == FLOAT else x


def _size_is(sign: str) -> Callable[..., Value]:
    """Whether a number is finite, ``<``, or infinite, ``==``."""
    infinite = DOUBLE(math.inf)
    return lambda at, x: scalar(at.at.fcmp_ordered(sign, at.c_function("fabs", [x]).llvm[0], infinite), BOOL)


def _extreme(sign: str) -> Callable[..., Value]:
    """The lesser (greater) number. Of 0.0 and -0.0 NumPy takes the second one, and a shipped kernel the first one."""
    return lambda at, a, b: at.extreme(sign, b, a) if at.unit.checked else at.extreme(sign, a, b)


def _fmin(sign: str) -> Callable[..., Value]:
    """The lesser (greater) number; the other one if one is NaN."""
    return lambda at, a, b: at.chosen(at.is_nan(b), a, at.chosen(at.is_nan(a), b, _extreme(sign)(at, a, b)))


def _logical(name: str) -> Callable[..., Value]:
    return lambda at, a, b: scalar(getattr(at.at, name)(at.truth(a), at.truth(b)), BOOL)


_ONE: dict[str, tuple[Any, ...]] = {  # name in C: the functions
    "sqrt": (math.sqrt, np.sqrt),
    "exp": (math.exp, np.exp),
    "log": (np.log,),
    "log10": (math.log10, np.log10),
    "log2": (math.log2, np.log2),
    "log1p": (math.log1p, np.log1p),
    "expm1": (math.expm1, np.expm1),
    "exp2": (math.exp2, np.exp2),
    "cbrt": (math.cbrt, np.cbrt),
    "sin": (math.sin, np.sin),
    "cos": (math.cos, np.cos),
    "tan": (math.tan, np.tan),
    "asin": (math.asin, np.arcsin),
    "acos": (math.acos, np.arccos),
    "atan": (math.atan, np.arctan),
    "sinh": (math.sinh, np.sinh),
    "cosh": (math.cosh, np.cosh),
    "tanh": (math.tanh, np.tanh),
    "asinh": (math.asinh, np.arcsinh),
    "acosh": (math.acosh, np.arccosh),
    "atanh": (math.atanh, np.arctanh),
    "erf": (math.erf,),
    "erfc": (math.erfc,),
    "fabs": (math.fabs, np.fabs),
}
_TWO: dict[str, tuple[Any, ...]] = {
    "atan2": (math.atan2, np.arctan2),
    "hypot": (math.hypot, np.hypot),
    "copysign": (math.copysign, np.copysign),
    "fmod": (math.fmod, np.fmod),
    "pow": (math.pow,),
}
OF_C: dict[Any, tuple[str, int]] = {
    function: (name, n) for n, table in ((1, _ONE), (2, _TWO)) for name, of in table.items() for function in of
}
"""The name in C, and the number of arguments, of a function that is one of the C library."""
_ELEMENTWISE: dict[tuple[Any, ...], tuple[int, Callable[..., Value]]] = {
    **{functions: (1, _c(name)) for name, functions in _ONE.items()},
    **{functions: (2, _c(name)) for name, functions in _TWO.items()},
    (abs, np.abs): (1, Arrays.magnitude),
    (np.sign,): (1, Arrays.sign),
    (np.floor,): (1, _kept("floor")),
    (np.ceil,): (1, _kept("ceil")),
    (np.trunc,): (1, _kept("trunc")),
    (np.rint,): (1, _c("rint")),
    (math.floor,): (1, _whole("floor")),
    (math.ceil,): (1, _whole("ceil")),
    (math.trunc,): (1, _whole("trunc")),
    (np.isnan, math.isnan): (1, lambda at, x: scalar(at.is_nan(x), BOOL)),
    (np.isfinite, math.isfinite): (1, _size_is("<")),
    (np.isinf, math.isinf): (1, _size_is("==")),
    (np.square,): (1, lambda at, x: at.operation("Mult", x, x)),
    (np.reciprocal,): (1, Arrays.reciprocal),
    (np.negative,): (1, Arrays.negative),
    (np.deg2rad, np.radians, math.radians): (1, _scaled(math.pi / 180.0)),
    (np.rad2deg, np.degrees, math.degrees): (1, _scaled(180.0 / math.pi)),
    (np.logical_not,): (1, Arrays.negation),
    (np.minimum,): (2, _extreme("<")),
    (np.maximum,): (2, _extreme(">")),
    (np.fmin,): (2, _fmin("<")),
    (np.fmax,): (2, _fmin(">")),
    (np.add,): (2, _operator("Add")),
    (np.subtract,): (2, _operator("Sub")),
    (np.multiply,): (2, _operator("Mult")),
    (np.divide, np.true_divide): (2, _operator("Div")),
    (np.floor_divide,): (2, _operator("FloorDiv")),
    (np.mod, np.remainder): (2, _operator("Mod")),
    (np.power,): (2, Arrays.power),
    (np.logical_and,): (2, _logical("and_")),
    (np.logical_or,): (2, _logical("or_")),
    (np.logical_xor,): (2, lambda at, a, b: scalar(at.at.xor(at.truth(a), at.truth(b)), BOOL)),
    (np.less,): (2, _compared("<")),
    (np.greater,): (2, _compared(">")),
    (np.less_equal,): (2, _compared("<=")),
    (np.greater_equal,): (2, _compared(">=")),
    (np.equal,): (2, _compared("==")),
    (np.not_equal,): (2, _compared("!=")),
    (np.bitwise_and,): (2, _operator("BitAnd")),
    (np.bitwise_or,): (2, _operator("BitOr")),
    (np.bitwise_xor,): (2, _operator("BitXor")),
    (np.invert,): (1, Arrays.inverted),
    (np.positive,): (1, lambda at, x: x),
    (np.float_power,): (2, _c("pow")),
    (np.heaviside,): (2, _of_library(library.heaviside)),
    (np.logaddexp,): (2, _of_library(library.logaddexp)),
}


def _elementwise(count: int, function: Callable[..., Value], of_numpy: Any) -> Callable:
    def applied(at: Arrays, values: list[Value], out: ast.expr | None, where: Value | None) -> Value:
        result = at.raised(*values) if of_numpy is np.power else at.elementwise(partial(function, at), *values)
        if of_numpy is not None:
            _agree(at, of_numpy, [at.as_array(each).kind.base for each in values], result.kind.base)
        if where is None:
            return stored(at, out, result)
        if out is None:
            at.lack("without out=, NumPy sets no numbers where it is not; write np.where")
        target = at.value(out)
        return at.stored_in(
            target, at.elementwise(lambda test, a, b: at.chosen(at.truth(test), a, b), where, result, target)
        )

    def one(at: Arrays, x: Value, out: Node | None = None, *, where: Value | None = None) -> Value:
        return applied(at, [x], out, where)

    def two(at: Arrays, x: Value, y: Value, out: Node | None = None, *, where: Value | None = None) -> Value:
        return applied(at, [x, y], out, where)

    def one_number(at: Arrays, x: Value) -> Value:
        return applied(at, [x], None, None)

    def two_numbers(at: Arrays, x: Value, y: Value) -> Value:
        return applied(at, [x, y], None, None)

    takes_out = of_numpy is not None
    return {(1, True): one, (2, True): two, (1, False): one_number, (2, False): two_numbers}[count, takes_out]


def _agree(at: Arrays, function: Any, given: list[np.dtype], found: np.dtype) -> None:
    """Refuse a type that is not NumPy's."""
    with np.errstate(all="ignore"):
        try:
            wanted = function(*(np.ones(1, base) for base in given)).dtype
        except TypeError as error:
            at.mistake(str(error))
    if wanted != found:
        at.lack(f"NumPy's result is {wanted} here; write 1.0 * x, or int(x)")


for _functions, (_count, _function) in _ELEMENTWISE.items():
    for _each in _functions:  # only NumPy's have a parameter out
        entry(_each)(_elementwise(_count, _function, _each if isinstance(_each, np.ufunc) else None))

_REDUCED = {
    np.add: (np.sum, np.cumsum),
    np.multiply: (np.prod, np.cumprod),
    np.minimum: (np.min, None),
    np.maximum: (np.max, None),
    np.logical_and: (np.all, None),
    np.logical_or: (np.any, None),
}


def _of_operation(which: int) -> Callable:
    """``np.add.reduce``, ``np.add.accumulate`` and their like."""

    def write(at: Arrays, function: Node, array: Node, axis: Known = 0) -> Value | None:
        function_of = _REDUCED.get(at.known(function), (None, None))[which]
        if function_of is None:
            at.lack(f"the language has no {ast.unparse(function)}.{('reduce', 'accumulate')[which]}")
        return FUNCTIONS[function_of](at, [array, ast.Constant(axis)], {})

    return write


entry("reduce", method="reduce")(_of_operation(0))
entry("accumulate", method="accumulate")(_of_operation(1))


@entry("outer", method="outer")
def _outer(at: Arrays, function: Node, A: Array, B: Array) -> Value:
    known: Any = next((of for functions, of in _ELEMENTWISE.items() if at.known(function) in functions), (0, None))
    if known[0] != 2 or at.known(function) is np.power or not A.kind.is_array or not B.kind.is_array:
        at.lack(f"the language has no {ast.unparse(function)}.outer of these")
    column = at.arranged(A, lambda like: like.reshape(*like.shape, *[1] * len(at.shape_of(B))))
    result = at.elementwise(partial(known[1], at), column, B)
    _agree(at, at.known(function), [A.kind.base, B.kind.base], result.kind.base)
    return result


# numbers


@entry(math.log)
def _log(at: Arrays, x: Value, base: Value | None = None) -> Value:
    logarithm = at.c_function("log", [x])
    return logarithm if base is None else at.operation("Div", logarithm, at.c_function("log", [base]))


@entry(math.isclose)
def _isclose_numbers(
    at: Arrays, a: Value, b: Value, *, rel_tol: Value | None = None, abs_tol: Value | None = None
) -> Value:
    tolerances = [at.constant(usual) if each is None else each for each, usual in ((rel_tol, 1e-9), (abs_tol, 0.0))]
    return at.written(library.isclose, [scalar(at.float_of(each), FLOAT) for each in (a, b, *tolerances)])


@entry(math.prod)
def _prod(at: Arrays, iterable: Value, *, start: Value | None = None) -> Value:
    result = whole(1) if start is None else start
    for each in _items(at, iterable):
        result = at.binary("Mult", result, each)
    return result


def _items(at: Arrays, value: Value) -> list[Value]:
    """The numbers of a tuple or of a vector."""
    if value.kind.items is not None:
        return items_of(value)
    if len(at.shape_of(value)) != 1 or value.kind.size > 64:
        at.lack("up to 64 numbers of a vector are needed here")
    return [at.element(value, [WORD(i)]) for i in range(value.kind.size)]


@entry(math.modf)
def _modf(at: Arrays, x: Value) -> Value:
    return at.written(library.modf, [scalar(at.float_of(x), FLOAT)])


@entry(math.gcd)
def _gcd(at: Arrays, *integers: Value) -> Value:
    result = whole(0)
    for each in integers:
        if each.kind.base == FLOAT:
            at.mistake("integers are needed here, not a float")
        result = at.written(library.gcd, [scalar(at.converted(part, INT), INT) for part in (result, each)])
    return result


def _of_known(function: Callable) -> None:
    """Add a function of numbers that are known when compiling: Python computes it then."""

    def write(at: Arrays, *numbers: Known) -> Value:
        with at.refused_by_numpy():
            result = function(*numbers)
        return at.literal(result) if isinstance(result, np.ndarray) else at.constant(result)

    entry(function)(write)


for _function in (math.comb, math.perm, math.factorial, math.lcm):
    _of_known(_function)


@entry(pow)
def _pow(at: Arrays, base: Value, exp: Value) -> Value:
    return at.binary("Pow", base, exp)


@entry(divmod)
def _divmod(at: Arrays, x: Value, y: Value) -> Value:
    return bundle([at.binary(name, x, y) for name in ("FloorDiv", "Mod")])


@entry(np.divmod)
def _divmod_of_arrays(at: Arrays, x: Value, y: Value) -> Value:
    return bundle([at.elementwise(partial(at.operation, name), x, y) for name in ("FloorDiv", "Mod")])


@entry(float, np.float64)
def _float(at: Arrays, x: Value) -> Value:
    if x.kind.shape == ():
        x = at.element(x, [])
    return scalar(at.float_of(x), FLOAT)


@entry(int, np.int64)
def _int(at: Arrays, x: Value) -> Value:
    return at.as_integer(x)


@entry(bool, np.bool_)
def _bool(at: Arrays, x: Node) -> Value:
    return scalar(at.test(x), BOOL)


@entry(round)
def _round(at: Arrays, number: Value, ndigits: Node | None = None) -> Value:
    if ndigits is not None:
        at.lack("round(x, n) rounds decimal digits; write np.round(x, n)")
    return at.as_integer(_kept("rint")(at, number))


@entry(np.round, np.around, method="round")
def _round_array(at: Arrays, a: Value, decimals: Whole = 0, out: Node | None = None) -> Value:
    scale, (there, back) = at.constant(10.0 ** abs(decimals)), ("Mult", "Div") if decimals > 0 else ("Div", "Mult")

    def rounded(value: Value) -> Value:
        if value.kind.base != FLOAT or not decimals:
            return _kept("rint")(at, value)
        return at.operation(back, at.c_function("rint", [at.operation(there, value, scale)]), scale)

    result = at.elementwise(rounded, a)
    return stored(at, out, at.laid(result, np.round(at.like(a), decimals)) if a.kind.is_array else result)


def _best(sign: str, name: str) -> Callable:
    """``min`` and ``max`` of Python: of several numbers, or of one array or tuple."""

    def write(at: Arrays, *values: Value) -> Value:
        if len(values) == 1:
            (only,) = values
            if only.kind.items is None:
                if len(at.shape_of(only)) != 1:
                    at.mistake(f"Python's own {name} takes numbers; write x.min() or x.max()")
                return at.reduced(only, None, lambda n, term, _: at.in_turn(n, term, partial(at.better, sign)))
            values = tuple(items_of(only))
        return reduce(partial(at.better, sign), values)

    return write


entry(min)(_best("<", "min"))
entry(max)(_best(">", "max"))


@entry(len)
def _len(at: Arrays, x: Value) -> Value:
    if x.kind.items is not None:
        return whole(len(x.kind.items))
    if not x.kind.shape:
        at.mistake(f"{x.kind.described()} has no length")
    return items_of(at.shape_tuple(x))[0]


# arrays from nothing


def _filled(at: Arrays, shape: tuple[int, ...], base: np.dtype, number: Value, axes: Sequence[int] = ()) -> Value:
    out = at.temporary(base, shape, axes)
    at.fill(out, at.as_integer(number) if base == INT else scalar(at.converted(number, base), base))
    return out


def _of_number(number: int) -> tuple[Callable, Callable]:
    """``np.zeros`` and ``np.zeros_like``, and so on."""

    def new(at: Arrays, shape: Sizes, dtype: Type = FLOAT) -> Value:
        return _filled(at, shape, dtype, at.constant(number))

    def like(at: Arrays, a: Array, dtype: Type | None = None) -> Value:
        shape, base = at.shape_of(a), a.kind.base if dtype is None else dtype
        return _filled(at, shape, base, at.constant(number), at.axes_in_memory([a], shape))

    return new, like


for _number, _new, _like in (
    (0, (np.zeros, np.empty), (np.zeros_like, np.empty_like)),  # np.empty, too: so that nothing is unset
    (1, (np.ones,), (np.ones_like,)),
):
    for _functions, _writer in zip((_new, _like), _of_number(_number), strict=True):
        entry(*_functions)(_writer)


@entry(np.full)
def _full(at: Arrays, shape: Sizes, fill_value: Array, dtype: Type | None = None) -> Value:
    if not fill_value.kind.is_array:
        return _filled(at, shape, fill_value.kind.base if dtype is None else dtype, fill_value)
    out = at.temporary(fill_value.kind.base, shape)
    at.fill(out, fill_value)
    return out if dtype is None else _as_type(at, out, dtype)


@entry(np.full_like)
def _full_like(at: Arrays, a: Array, fill_value: Value) -> Value:
    shape = at.shape_of(a)
    return _filled(at, shape, a.kind.base, fill_value, at.axes_in_memory([a], shape))


def _eye_of(at: Arrays, n: int, m: int, k: int, dtype: np.dtype) -> Value:
    out = _filled(at, (n, m), dtype, at.constant(0))
    one = at.converted(at.constant(1), dtype)
    first, size = (max(0, -k), max(0, k)), len(np.eye(n, m, k).diagonal(k)) if -n <= k <= m else 0

    def body(i: list[ir.Value]) -> None:
        at.store(one, at.pointer(out, [at.at.add(i[0], WORD(each)) if each else i[0] for each in first]))

    if k and size:  # by constants, where the loop is written out
        for i in range(size):
            at.store(one, at.pointer(out, [WORD(i + each) for each in first]))
    elif size:
        at.each((size,), body)
    return out


@entry(np.eye)
def _eye(at: Arrays, N: Whole, M: Whole | None = None, k: Whole = 0, dtype: Type = FLOAT) -> Value:
    if min(N, N if M is None else M) < 0:
        at.mistake("the sizes of an array are not negative")
    return _eye_of(at, N, N if M is None else M, k, dtype)


@entry(np.identity)
def _identity(at: Arrays, n: Whole, dtype: Type = FLOAT) -> Value:
    return _eye(at, n, None, 0, dtype)


@entry(np.tri)
def _tri(at: Arrays, N: Whole, M: Whole | None = None, k: Whole = 0) -> Value:
    with at.refused_by_numpy():
        return at.literal(np.tri(N, M, k))


@entry(np.arange)
def _arange(at: Arrays, *numbers: Known, dtype: Type | None = None) -> Value:
    with at.refused_by_numpy():
        array = np.arange(*numbers, dtype=dtype)
    if array.dtype != INT or array.ndim != 1:
        return at.literal(array) if array.dtype == FLOAT else at.lack("np.arange is of integers or of floats here")
    out = at.temporary(INT, array.shape)
    first, step = (int(array[0]), int(array[1] - array[0])) if len(array) > 1 else (int(array.sum()), 1)

    def body(i: list[ir.Value]) -> None:
        at.store(at.at.add(at.at.mul(i[0], WORD(step)), WORD(first)), at.pointer(out, i))

    at.each(array.shape, body)
    return out


@entry(np.linspace)
def _linspace(at: Arrays, start: Floats, stop: Floats, num: Whole = 50, endpoint: Flag = True) -> Value:
    known: Any = [start.constant, stop.constant]
    if num < 0:
        at.mistake("the number of samples is not negative")
    if all(each is not None for each in known):
        return at.literal(np.linspace(known[0], known[1], num=num, endpoint=endpoint))
    if start.kind.is_array or stop.kind.is_array:
        at.lack("np.linspace is between two numbers here; write a loop")
    out = at.temporary(FLOAT, (num,))
    div, delta = num - 1 if endpoint else num, at.operation("Sub", stop, start)
    step = at.operation("Div", delta, at.constant(float(div))) if div > 0 else delta
    flat = at.comparison("==", step, at.constant(0.0)).llvm[0]

    def body(i: list[ir.Value]) -> None:
        k = scalar(at.float_of(scalar(i[0], INT)), FLOAT)
        number = at.operation("Mult", k, step)
        if div > 0:
            small = at.operation("Mult", at.operation("Div", k, at.constant(float(div))), delta)
            number = at.chosen(flat, small, number)
        at.store(at.operation("Add", number, start).llvm[0], at.pointer(out, i))

    at.each((num,), body)
    if endpoint and num > 1:
        at.store(stop.llvm[0], at.pointer(out, [WORD(num - 1)]))
    return out


@entry(np.logspace)
def _logspace(
    at: Arrays, start: Known, stop: Known, num: Known = 50, endpoint: Flag = True, base: Known = 10.0
) -> Value:
    with at.refused_by_numpy():
        return at.literal(np.logspace(start, stop, num, endpoint, base))


@entry(np.vander)
def _vander(at: Arrays, x: Known, N: Known = None, increasing: Flag = False) -> Value:
    with at.refused_by_numpy():
        array = np.vander(x, N, increasing)
    return at.literal(array) if array.dtype in (FLOAT, INT) else at.lack("np.vander is of numbers here")


def _as_type(at: Arrays, value: Value, base: np.dtype | None) -> Value:
    """A new array with these numbers, of another type if one is given."""
    kind = value.kind.base if base is None else base
    if kind == value.kind.base:
        return at.copied(value, keeps_order=True) if not value.fresh else value

    def typed(number: Value) -> Value:
        return at.as_integer(number) if kind == INT else scalar(at.converted(number, kind), kind)

    return at.elementwise(typed, value)


@entry(np.array)
def _array(at: Arrays, object: Array, dtype: Type | None = None, *, ndmin: Whole = 0) -> Value:
    missing = ndmin - len(at.shape_of(object))
    if not object.kind.is_array and missing <= 0:
        at.lack("an array of one number has no axes; write the number, or np.array([x])")
    new = _as_type(at, object, dtype) if object.kind.is_array else at.stacked([object])
    return new if missing <= 0 else at.arranged(new, lambda like: like.reshape(*[1] * (ndmin - like.ndim), *like.shape))


@entry(np.asarray)
def _asarray(at: Arrays, a: Array, dtype: Type | None = None) -> Value:
    if not a.kind.is_array:
        at.lack("an array of a number has no axes")
    return a if dtype in (None, a.kind.base) else _as_type(at, a, dtype)


@entry(np.ascontiguousarray)
def _ascontiguousarray(at: Arrays, a: Array, dtype: Type | None = None) -> Value:
    array = _asarray(at, a, dtype)
    return array if array.kind.strides == contiguous(array.kind.base, at.shape_of(array)).strides else at.copied(array)


@entry(np.astype, method="astype")
def _astype(at: Arrays, x: Value, dtype: Type) -> Value:
    return _as_type(at, x, dtype)


@entry(np.copy)
def _copy(at: Arrays, a: Array) -> Value:
    return at.copied(a, keeps_order=True)


@entry("copy", method="copy")
def _copy_as_usual(at: Arrays, a: Array) -> Value:
    return at.copied(a)


# elements of several arrays


@entry(np.shape)
def _shape(at: Arrays, a: Array) -> Value:
    return at.shape_tuple(a)


@entry(np.ndim)
def _ndim(at: Arrays, a: Array) -> Value:
    return whole(len(at.shape_of(a)))


@entry(np.size)
def _size(at: Arrays, a: Array, axis: Known = None) -> Value:
    shape = at.shape_of(a)
    if axis is None:
        return whole(math.prod(shape))
    with at.refused_by_numpy():
        return whole(int(np.size(np.zeros(shape), axis)))


@entry(np.clip)
def _clip(
    at: Arrays,
    a: Value,
    a_min: Value | None = None,
    a_max: Value | None = None,
    out: Node | None = None,
    *,
    min: Value | None = None,
    max: Value | None = None,
) -> Value:
    bounds = (min if a_min is None else a_min, max if a_max is None else a_max)
    given = [
        (sign, each) for sign, each in zip("><", bounds, strict=True) if each is not None and not each.kind.is_none
    ]
    if not given:
        at.lack("np.clip without bounds; write x.copy()")
    for sign, bound in given:  # by one bound it is np.maximum, or np.minimum
        a = at.elementwise(partial(at.extreme, sign) if len(given) == 2 else partial(_extreme(sign), at), a, bound)
    return stored(at, out, a)


@entry("clip", method="clip")
def _clip_method(
    at: Arrays, a: Value, min: Value | None = None, max: Value | None = None, out: Node | None = None
) -> Value:
    return _clip(at, a, min, max, out)


def _closeness(at: Arrays, a: Value, b: Value, rtol: Value | None, atol: Value | None, equal_nan: bool) -> Value:
    tolerances = [at.constant(1e-5) if rtol is None else rtol, at.constant(1e-8) if atol is None else atol]

    def close(*numbers: Value) -> Value:
        x, y, relative, absolute = (scalar(at.float_of(each), FLOAT) for each in numbers)
        off = at.c_function("fabs", [at.operation("Sub", x, y)])
        most = at.operation("Add", absolute, at.operation("Mult", relative, at.c_function("fabs", [y])))
        near = at.at.and_(at.comparison("<=", off, most).llvm[0], _size_is("<")(at, y).llvm[0])
        near = at.at.or_(near, at.comparison("==", x, y).llvm[0])
        if equal_nan:
            near = at.at.or_(near, at.at.and_(at.is_nan(x), at.is_nan(y)))
        return scalar(near, BOOL)

    return at.elementwise(close, a, b, *tolerances)


@entry(np.isclose)
def _isclose(
    at: Arrays, a: Value, b: Value, rtol: Value | None = None, atol: Value | None = None, equal_nan: Flag = False
) -> Value:
    return _closeness(at, a, b, rtol, atol, equal_nan)


@entry(np.allclose)
def _allclose(
    at: Arrays, a: Value, b: Value, rtol: Value | None = None, atol: Value | None = None, equal_nan: Flag = False
) -> Value:
    return at.all_of(_closeness(at, a, b, rtol, atol, equal_nan))


@entry(np.array_equal)
def _array_equal(at: Arrays, a1: Array, a2: Array, equal_nan: Flag = False) -> Value:
    if at.shape_of(a1) != at.shape_of(a2):
        return at.constant(False)

    def same(a: Value, b: Value) -> Value:
        equal = at.comparison("==", a, b).llvm[0]
        if equal_nan:
            equal = at.at.or_(equal, at.at.and_(at.is_nan(a), at.is_nan(b)))
        return scalar(equal, BOOL)

    return at.all_of(at.elementwise(same, a1, a2))


@entry(np.nan_to_num)
def _nan_to_num(
    at: Arrays,
    x: Array,
    copy: Flag = True,
    nan: Value | None = None,
    posinf: Value | None = None,
    neginf: Value | None = None,
) -> Value:
    if not copy:
        at.lack("write x[:] = np.nan_to_num(x)")
    most = float(np.finfo(float).max)
    usual = [(nan, 0.0), (posinf, most), (neginf, -most)]
    instead = [at.constant(number) if each is None else each for each, number in usual]
    if any(not each.kind.is_number for each in instead):
        at.lack("nan, posinf and neginf are numbers here")
    if x.kind.base != FLOAT:
        return at.copied(x, keeps_order=True) if x.kind.is_array else x

    def finite(number: Value) -> Value:
        found = at.chosen(at.is_nan(number), instead[0], number)
        for bound, other in ((math.inf, instead[1]), (-math.inf, instead[2])):
            found = at.chosen(at.comparison("==", number, at.constant(bound)).llvm[0], other, found)
        return found

    return at.elementwise(finite, x)


@entry(np.fix)
def _fix(at: Arrays, x: Array, out: Node | None = None) -> Value:
    if x.kind.base != FLOAT:
        at.lack("np.fix is of floats here; write the integer")
    return stored(at, out, at.elementwise(lambda each: at.c_function("trunc", [each]), x))


@entry(np.sinc)
def _sinc(at: Arrays, x: Floats) -> Value:
    return at.written(library.sinc, [x])


@entry(np.select)
def _select(at: Arrays, condlist: Parts, choicelist: Parts, default: Value | None = None) -> Value:
    if len(condlist) != len(choicelist) or not condlist or any(each.kind.base != BOOL for each in condlist):
        at.mistake("np.select takes as many choices as conditions, which are truth values")
    found = at.constant(0) if default is None else default
    for test, choice in zip(reversed(condlist), reversed(choicelist), strict=True):
        found = _where(at, test, choice, found)
    return found


@entry(np.trapezoid)
def _trapezoid(at: Arrays, y: Floats, x: Array | None = None, dx: Value | None = None) -> Value:
    if len(at.shape_of(y)) != 1 or (x is not None and at.shape_of(x) != at.shape_of(y)):
        at.lack("np.trapezoid is of one vector here; write a loop over the rows")
    width = at.constant(1.0) if dx is None else dx
    if x is not None:
        width = at.elementwise(partial(at.operation, "Sub"), _behind(at, x), _before(at, x))
    both = at.elementwise(partial(at.operation, "Add"), _behind(at, y), _before(at, y))
    area = at.elementwise(partial(at.operation, "Mult"), width, both)
    halves = at.elementwise(lambda each: at.operation("Div", each, at.constant(2.0)), area)
    return at.reduced(halves, None, partial(Arrays.total, at))


def _behind(at: Arrays, x: Value) -> Value:
    return at.arranged(x, lambda like: like[1:])


def _before(at: Arrays, x: Value) -> Value:
    return at.arranged(x, lambda like: like[:-1])


@entry(np.gradient)
def _gradient(at: Arrays, f: Floats, *varargs: Value) -> Value:
    if len(at.shape_of(f)) != 1 or len(varargs) > 1 or f.kind.size < 2 or any(each.kind.is_array for each in varargs):
        at.lack("np.gradient is of one vector with equal steps here; write the differences")
    return at.written(library.gradient, [f, scalar(at.float_of(varargs[0]), FLOAT) if varargs else at.constant(1.0)])


@entry(np.convolve)
def _convolve(at: Arrays, a: Floats, v: Floats, mode: Known = "full") -> Value:
    n, m = (at.shape_of(each)[0] if len(at.shape_of(each)) == 1 else 0 for each in (a, v))
    if not n or not m or mode not in ("full", "same", "valid"):
        at.lack("np.convolve is of two vectors here, with mode full, same or valid")
    full = at.written(library.convolve_full, [a, v])
    first, size = library.part_of_convolution(n, m, mode)
    return at.arranged(full, lambda like: like[first : first + size].copy())


@entry(np.polyval)
def _polyval(at: Arrays, p: Array, x: Array) -> Value:
    if len(at.shape_of(p)) != 1:
        at.lack("the coefficients are a vector here")
    found = at.elementwise(lambda each: scalar(at.converted(at.constant(0), each.kind.base), each.kind.base), x)
    for i in range(at.shape_of(p)[0]):
        found = at.elementwise(partial(at.operation, "Mult"), found, x)
        found = at.elementwise(partial(at.operation, "Add"), found, at.element(p, [WORD(i)]))
    return found


@entry(np.unwrap)
def _unwrap(at: Arrays, p: Floats) -> Value:
    if len(at.shape_of(p)) != 1:
        at.lack("np.unwrap is of one vector here; write a loop over the rows")
    return at.written(library.unwrap, [p])


@entry(np.where)
def _where(at: Arrays, condition: Value, x: Value | None = None, y: Value | None = None) -> Value:
    if x is None or y is None:
        at.lack("the number of indices is not known when compiling; write np.where(condition, x, y), or a loop")
    return at.elementwise(lambda test, a, b: at.chosen(at.truth(test), a, b), condition, x, y)


@entry(np.interp)
def _interp(
    at: Arrays, x: Floats, xp: Floats, fp: Floats, left: Value | None = None, right: Value | None = None
) -> Value:
    if at.shape_of(xp) != at.shape_of(fp) or len(at.shape_of(xp)) != 1 or not xp.kind.size:
        at.mistake("the tables of np.interp have one length")
    ends = [at.element(fp, [WORD(i)]) for i in (0, fp.kind.size - 1)]
    ends = [
        end if each is None else scalar(at.float_of(each), FLOAT) for each, end in zip((left, right), ends, strict=True)
    ]
    if not x.kind.is_array:
        found = at.written(library.interp, [at.stacked([x]), xp, fp, *ends])
        return at.element(found, [WORD(0)])
    found = at.written(library.interp, [at.flat(x), xp, fp, *ends])
    return at.arranged(found, lambda like: like.reshape(at.shape_of(x)))


@entry("fill", method="fill")
def _fill(at: Arrays, a: Value, value: Value) -> None:
    at.store_all(a, value)


PROPERTIES |= {
    "T": lambda at, value: at.transposed(value),
    "shape": lambda at, value: at.shape_tuple(value),
    "size": lambda at, value: whole(int(np.prod(at.shape_of(value), dtype=int))),
    "ndim": lambda at, value: whole(len(value.kind.shape or ())),
}
