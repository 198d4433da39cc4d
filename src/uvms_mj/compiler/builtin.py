"""The functions of Python, ``math`` and NumPy that are part of the language.

Each is an entry of a table, from the function to what writes its code. To add one, add an entry: a function of C in
``_ONE`` or ``_TWO``, another one of numbers in ``_ELEMENTWISE``, a reduction in ``_REDUCTIONS``; of arrays a function
with ``@entry``, with its loop in :mod:`.library`.
"""

from __future__ import annotations  # the binding of arguments reads the names of types

import math
from collections.abc import Callable
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
    Floats,
    Node,
    Sizes,
    Type,
    Whole,
    entry,
    stored,
)
from .values import BOOL, DOUBLE, FLOAT, INT, WORD, Value, contiguous, items_of, scalar, whole

__all__ = ["FUNCTIONS", "METHODS", "PROPERTIES"]


# functions of numbers, applied to each entry


def _c(name: str) -> Callable[..., Value]:
    return lambda at, *values: at.c_function(name, values)


def _operator(name: str) -> Callable[..., Value]:
    return lambda at, a, b: at.operation(name, a, b)


def _scaled(factor: float) -> Callable[..., Value]:
    return lambda at, x: at.operation("Mult", x, at.constant(factor))


def _kept(name: str) -> Callable[..., Value]:
    """A rounding that leaves integers as they are."""
    return lambda at, x: at.c_function(name, [x]) if x.kind.base == FLOAT else x


def _whole(name: str) -> Callable[..., Value]:
    return lambda at, x: at.fits_python(name, x) if x.kind.base == FLOAT else x


def _size_is(sign: str) -> Callable[..., Value]:
    """Whether a number is finite, ``<``, or infinite, ``==``."""
    infinite = DOUBLE(math.inf)
    return lambda at, x: scalar(at.at.fcmp_ordered(sign, at.c_function("fabs", [x]).llvm[0], infinite), BOOL)


def _fmin(sign: str) -> Callable[..., Value]:
    """The lesser (greater) number; the other one if one is NaN."""
    return lambda at, a, b: at.chosen(at.is_nan(b), a, at.chosen(at.is_nan(a), b, at.extreme(sign, a, b)))


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
    (np.rint,): (1, _kept("rint")),
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
    (np.minimum,): (2, lambda at, a, b: at.extreme("<", a, b)),
    (np.maximum,): (2, lambda at, a, b: at.extreme(">", a, b)),
    (np.fmin,): (2, _fmin("<")),
    (np.fmax,): (2, _fmin(">")),
    (np.add,): (2, _operator("Add")),
    (np.subtract,): (2, _operator("Sub")),
    (np.multiply,): (2, _operator("Mult")),
    (np.divide, np.true_divide): (2, _operator("Div")),
    (np.floor_divide,): (2, _operator("FloorDiv")),
    (np.mod, np.remainder): (2, _operator("Mod")),
    (np.power, pow): (2, _operator("Pow")),
    (np.logical_and,): (2, _logical("and_")),
    (np.logical_or,): (2, _logical("or_")),
    (np.less,): (2, lambda at, a, b: at.comparison("<", a, b)),
    (np.greater,): (2, lambda at, a, b: at.comparison(">", a, b)),
}


def _elementwise(count: int, function: Callable[..., Value], out: bool) -> Callable:
    def one(at: Arrays, x: Value, out: Node | None = None) -> Value:
        return stored(at, out, at.elementwise(partial(function, at), x))

    def two(at: Arrays, x: Value, y: Value, out: Node | None = None) -> Value:
        return stored(at, out, at.elementwise(partial(function, at), x, y))

    def one_number(at: Arrays, x: Value) -> Value:
        return at.elementwise(partial(function, at), x)

    def two_numbers(at: Arrays, x: Value, y: Value) -> Value:
        return at.elementwise(partial(function, at), x, y)

    return {(1, True): one, (2, True): two, (1, False): one_number, (2, False): two_numbers}[count, out]


for _functions, (_count, _function) in _ELEMENTWISE.items():
    for _each in _functions:  # only NumPy's have a parameter out
        entry(_each)(_elementwise(_count, _function, isinstance(_each, np.ufunc)))


# numbers


@entry(math.log)
def _log(at: Arrays, x: Value, base: Value | None = None) -> Value:
    logarithm = at.c_function("log", [x])
    return logarithm if base is None else at.operation("Div", logarithm, at.c_function("log", [base]))


@entry(float, np.float64)
def _float(at: Arrays, x: Value) -> Value:
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


@entry(np.round, method="round")
def _round_array(at: Arrays, a: Value, decimals: Whole = 0) -> Value:
    scale, (there, back) = at.constant(10.0 ** abs(decimals)), ("Mult", "Div") if decimals > 0 else ("Div", "Mult")

    def rounded(value: Value) -> Value:
        if value.kind.base != FLOAT or not decimals:
            return _kept("rint")(at, value)
        return at.operation(back, at.c_function("rint", [at.operation(there, value, scale)]), scale)

    return at.elementwise(rounded, a)


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


def _filled(at: Arrays, shape: tuple[int, ...], base: np.dtype, number: Value) -> Value:
    out = at.temporary(base, shape)
    at.fill(out, at.as_integer(number) if base == INT else scalar(at.converted(number, base), base))
    return out


def _of_number(number: int) -> tuple[Callable, Callable]:
    """``np.zeros`` and ``np.zeros_like``, and so on."""

    def new(at: Arrays, shape: Sizes, dtype: Type = FLOAT) -> Value:
        return _filled(at, shape, dtype, at.constant(number))

    def like(at: Arrays, a: Array, dtype: Type | None = None) -> Value:
        return _filled(at, at.shape_of(a), a.kind.base if dtype is None else dtype, at.constant(number))

    return new, like


for _number, _new, _like in (
    (0, (np.zeros, np.empty), (np.zeros_like, np.empty_like)),  # np.empty, too: so that nothing is unset
    (1, (np.ones,), (np.ones_like,)),
):
    for _functions, _writer in zip((_new, _like), _of_number(_number), strict=True):
        entry(*_functions)(_writer)


@entry(np.full)
def _full(at: Arrays, shape: Sizes, fill_value: Value, dtype: Type | None = None) -> Value:
    return _filled(at, shape, fill_value.kind.base if dtype is None else dtype, fill_value)


@entry(np.full_like)
def _full_like(at: Arrays, a: Array, fill_value: Value) -> Value:
    return _filled(at, at.shape_of(a), a.kind.base, fill_value)


@entry(np.eye, np.identity)
def _eye(at: Arrays, N: Sizes, M: Whole | None = None) -> Value:
    (n,) = N
    m = n if M is None else M
    out = _filled(at, (n, m), FLOAT, at.constant(0.0))
    at.each((min(n, m),), lambda i: at.store(DOUBLE(1.0), at.pointer(out, [*i, *i])))
    return out


@entry(np.arange)
def _arange(at: Arrays, *numbers: Whole) -> Value:
    if not 1 <= len(numbers) <= 3:
        at.lack("np.arange takes up to three integers here")
    bounds = range(*numbers)
    out = at.temporary(INT, (len(bounds),))

    def body(i: list[ir.Value]) -> None:
        at.store(at.at.add(at.at.mul(i[0], WORD(bounds.step)), WORD(bounds.start)), at.pointer(out, i))

    at.each((len(bounds),), body)
    return out


def _as_type(at: Arrays, value: Value, base: np.dtype | None) -> Value:
    """A new array with these numbers, of another type if one is given."""
    kind = value.kind.base if base is None else base
    if kind == value.kind.base:
        return at.copied(value) if not value.fresh else value

    def typed(number: Value) -> Value:
        return at.as_integer(number) if kind == INT else scalar(at.converted(number, kind), kind)

    return at.elementwise(typed, value)


@entry(np.array)
def _array(at: Arrays, object: Array, dtype: Type | None = None) -> Value:
    return _as_type(at, object, dtype)


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


@entry(np.copy, method="copy")
def _copy(at: Arrays, a: Array) -> Value:
    return at.copied(a)


# elements of several arrays


@entry(np.clip, method="clip")
def _clip(
    at: Arrays, a: Value, a_min: Value | None = None, a_max: Value | None = None, out: Node | None = None
) -> Value:
    if all(bound is None or bound.kind.is_none for bound in (a_min, a_max)):
        at.lack("np.clip without bounds; write x.copy()")
    for sign, bound in ((">", a_min), ("<", a_max)):
        if bound is not None and not bound.kind.is_none:
            a = at.elementwise(partial(at.extreme, sign), a, bound)
    return stored(at, out, a)


@entry(np.where)
def _where(at: Arrays, condition: Value, x: Value, y: Value) -> Value:
    return at.elementwise(lambda test, a, b: at.chosen(at.truth(test), a, b), condition, x, y)


@entry(np.interp)
def _interp(at: Arrays, x: Value, xp: Floats, fp: Floats) -> Value:
    if at.shape_of(xp) != at.shape_of(fp) or len(at.shape_of(xp)) != 1:
        at.mistake("the tables of np.interp have one length")
    return at.elementwise(lambda v: at.written(library.interp, [scalar(at.float_of(v), FLOAT), xp, fp]), x)


@entry("fill", method="fill")
def _fill(at: Arrays, a: Value, value: Value) -> None:
    at.store_all(a, value)


PROPERTIES |= {
    "T": lambda at, value: at.transposed(value),
    "shape": lambda at, value: at.shape_tuple(value),
    "size": lambda at, value: whole(int(np.prod(at.shape_of(value), dtype=int))),
    "ndim": lambda at, value: whole(len(value.kind.shape or ())),
}
