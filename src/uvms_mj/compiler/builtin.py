"""The functions of Python, ``math`` and NumPy that are part of the language.

Each is an entry of a table, from the function to what writes its code. To add one, add an entry: a function of C in
``_ONE`` or ``_TWO``, another one of numbers in ``_ELEMENTWISE``, a reduction in ``_REDUCTIONS``; of arrays a function
below, with its loop in :mod:`.library`.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir

from . import library
from .indexing import Indexing
from .values import BOOL, DOUBLE, FLOAT, INT, WORD, Kind, Value, contiguous, items_of, scalar, shown, whole

Nodes = Sequence[ast.expr]
Keywords = Mapping[str, ast.expr]
Writer = Callable[["Indexing", Nodes, Keywords], "Value | None"]
FUNCTIONS: dict[Any, Writer] = {}
"""What writes the code of a call, by the function that is called."""
METHODS: dict[str, Any] = {}
"""NumPy's function for a method of an array, whose first argument is the array."""
PROPERTIES: dict[str, Callable[[Indexing, Value], Value]] = {}
"""What writes the code of an attribute of an array."""


def entry(*functions: Any, method: str = "") -> Callable[[Writer], Writer]:
    """Mark what writes the code of a call of these functions; of a method, too, the first one's."""

    def mark(writer: Writer) -> Writer:
        FUNCTIONS.update(dict.fromkeys(functions, writer))
        if method:
            METHODS[method] = functions[0]
        return writer

    return mark


def given(at: Indexing, nodes: Nodes, keywords: Keywords, *names: str) -> list[ast.expr | None]:
    """The arguments in the order of their names; None for one that is not given."""
    if len(nodes) > len(names):
        at.mistake(f"it takes at most {len(names)} arguments, not {len(nodes)}")
    found: dict[str, ast.expr | None] = dict(zip(names, nodes, strict=False))
    for name, node in keywords.items():
        if name not in names:
            at.lack(f"the language has no argument {name} here")
        if name in found:
            at.mistake(f"argument {name} is given twice")
        found[name] = node
    return [found.get(name) for name in names]


def needed(at: Indexing, nodes: Nodes, keywords: Keywords, *names: str) -> list[Value]:
    """The values of arguments that must all be given."""
    return [
        at.value(node) if node is not None else at.mistake("an argument is missing")
        for node in given(at, nodes, keywords, *names)
    ]


def optional_integer(at: Indexing, node: ast.expr | None, what: str) -> int | None:
    if node is None or (isinstance(node, ast.Constant) and node.value is None):
        return None
    return at.constant_integer(node, what)


def is_true(at: Indexing, node: ast.expr | None) -> bool:
    return isinstance(node, ast.Constant) and bool(node.value)


# functions of numbers, applied to each entry


def _c(name: str) -> Callable[..., Callable[..., Value]]:
    return lambda at: lambda *values: at.c_function(name, values)


def _operator(name: str) -> Callable[..., Callable[..., Value]]:
    return lambda at: partial(at.operation, name)


def _scaled(factor: float) -> Callable[..., Callable[..., Value]]:
    return lambda at: lambda x: at.operation("Mult", x, at.constant(factor))


def _kept(name: str) -> Callable[..., Callable[..., Value]]:
    """A rounding that leaves integers as they are."""
    return lambda at: lambda x: at.c_function(name, [x]) if x.kind.base == FLOAT else x


def _whole(name: str) -> Callable[..., Callable[..., Value]]:
    return lambda at: lambda x: at.fits_python(name, x) if x.kind.base == FLOAT else x


def _compared(sign: str) -> Callable[..., Callable[..., Value]]:
    return lambda at: partial(at.comparison, sign)


def _is_finite(at: Indexing, x: Value) -> Value:
    size = at.c_function("fabs", [x]).llvm[0]
    return scalar(at.at.fcmp_ordered("<", size, DOUBLE(math.inf)), BOOL)


def _is_infinite(at: Indexing, x: Value) -> Value:
    size = at.c_function("fabs", [x]).llvm[0]
    return scalar(at.at.fcmp_ordered("==", size, DOUBLE(math.inf)), BOOL)


def _fmin(at: Indexing, sign: str, a: Value, b: Value) -> Value:
    """The lesser (greater) number; the other one if one is NaN."""
    return at.chosen(at.is_nan(b), a, at.chosen(at.is_nan(a), b, at.extreme(sign, a, b)))


def _logical(at: Indexing, name: str, a: Value, b: Value) -> Value:
    return scalar(getattr(at.at, name)(at.truth(a), at.truth(b)), BOOL)


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
_ELEMENTWISE: dict[tuple[Any, ...], tuple[int, Callable[..., Callable[..., Value]]]] = {
    **{functions: (1, _c(name)) for name, functions in _ONE.items()},
    **{functions: (2, _c(name)) for name, functions in _TWO.items()},
    (abs, np.abs): (1, lambda at: at.magnitude),
    (np.sign,): (1, lambda at: at.sign),
    (np.floor,): (1, _kept("floor")),
    (np.ceil,): (1, _kept("ceil")),
    (np.trunc,): (1, _kept("trunc")),
    (np.rint,): (1, _kept("rint")),
    (math.floor,): (1, _whole("floor")),
    (math.ceil,): (1, _whole("ceil")),
    (math.trunc,): (1, _whole("trunc")),
    (np.isnan, math.isnan): (1, lambda at: lambda x: scalar(at.is_nan(x), BOOL)),
    (np.isfinite, math.isfinite): (1, lambda at: partial(_is_finite, at)),
    (np.isinf, math.isinf): (1, lambda at: partial(_is_infinite, at)),
    (np.square,): (1, lambda at: lambda x: at.operation("Mult", x, x)),
    (np.reciprocal,): (1, lambda at: lambda x: at.operation("Div", at.constant(1.0), x)),
    (np.negative,): (1, lambda at: at.negative),
    (np.deg2rad, np.radians, math.radians): (1, _scaled(math.pi / 180.0)),
    (np.rad2deg, np.degrees, math.degrees): (1, _scaled(180.0 / math.pi)),
    (np.logical_not,): (1, lambda at: at.negation),
    (np.minimum,): (2, lambda at: partial(at.extreme, "<")),
    (np.maximum,): (2, lambda at: partial(at.extreme, ">")),
    (np.fmin,): (2, lambda at: partial(_fmin, at, "<")),
    (np.fmax,): (2, lambda at: partial(_fmin, at, ">")),
    (np.add,): (2, _operator("Add")),
    (np.subtract,): (2, _operator("Sub")),
    (np.multiply,): (2, _operator("Mult")),
    (np.divide, np.true_divide): (2, _operator("Div")),
    (np.floor_divide,): (2, _operator("FloorDiv")),
    (np.mod, np.remainder): (2, _operator("Mod")),
    (np.power, pow): (2, _operator("Pow")),
    (np.logical_and,): (2, lambda at: partial(_logical, at, "and_")),
    (np.logical_or,): (2, lambda at: partial(_logical, at, "or_")),
    (np.less,): (2, _compared("<")),
    (np.greater,): (2, _compared(">")),
}


def _elementwise(count: int, make: Callable[..., Callable[..., Value]]) -> Writer:
    def write(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
        names = ["x", "y"][:count]
        *nodes_, out = given(at, nodes, keywords, *names, "out")
        values = [at.value(node) if node is not None else at.mistake("an argument is missing") for node in nodes_]
        result = at.elementwise(make(at), *values)
        return result if out is None else stored(at, out, result)

    return write


for _functions, (_count, _make) in _ELEMENTWISE.items():
    entry(*_functions)(_elementwise(_count, _make))


def stored(at: Indexing, out: ast.expr, result: Value) -> Value:
    """A result in the array that the caller gives for it."""
    target = at.value(out)
    at.store_all(target, result, in_place=True)
    return target


# numbers


@entry(math.log)
def _log(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    x, base = given(at, nodes, keywords, "x", "base")
    assert x is not None
    logarithm = at.c_function("log", [at.value(x)])
    return logarithm if base is None else at.operation("Div", logarithm, at.c_function("log", [at.value(base)]))


@entry(float, np.float64)
def _float(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (x,) = needed(at, nodes, keywords, "x")
    return scalar(at.float_of(x), FLOAT)


@entry(int, np.int64)
def _int(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (x,) = needed(at, nodes, keywords, "x")
    return at.as_integer(x)


@entry(bool, np.bool_)
def _bool(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (node,) = nodes
    return scalar(at.test(node), BOOL)


@entry(round)
def _round(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    x, digits = given(at, nodes, keywords, "number", "ndigits")
    assert x is not None
    if digits is not None:
        at.lack("round(x, n) rounds decimal digits; write np.round(x, n)")
    value = at.value(x)
    return at.as_integer(at.c_function("rint", [value])) if value.kind.base == FLOAT else value


@entry(np.round, method="round")
def _round_array(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    x, digits = given(at, nodes, keywords, "a", "decimals")
    assert x is not None
    n = optional_integer(at, digits, "the number of decimals") or 0
    scale = at.constant(10.0 ** abs(n))

    def rounded(value: Value) -> Value:
        if value.kind.base != FLOAT or not n:
            return value if value.kind.base != FLOAT else at.c_function("rint", [value])
        there, back = ("Mult", "Div") if n > 0 else ("Div", "Mult")
        return at.operation(back, at.c_function("rint", [at.operation(there, value, scale)]), scale)

    return at.elementwise(rounded, at.value(x))


@entry(min)
def _min(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    return _best(at, "<", nodes, keywords)


@entry(max)
def _max(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    return _best(at, ">", nodes, keywords)


def _best(at: Indexing, sign: str, nodes: Nodes, keywords: Keywords) -> Value:
    """``min`` and ``max`` of Python: of several numbers, or of one array or tuple."""
    if keywords:
        at.lack("the language has no named arguments here")
    values = [at.value(node) for node in nodes]
    if len(values) == 1:
        (only,) = values
        if only.kind.items is None:
            if len(at.shape_of(only)) != 1:
                at.mistake(f"Python's own {'min' if sign == '<' else 'max'} takes numbers; write x.min() or x.max()")
            return at.reduced(only, None, lambda n, term, _: at.in_turn(n, term, partial(at.better, sign)))
        values = items_of(only)
    best, *others = values
    for other in others:
        best = at.better(sign, best, other)
    return best


@entry(len)
def _len(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (x,) = needed(at, nodes, keywords, "x")
    if x.kind.items is not None:
        return whole(len(x.kind.items))
    if not x.kind.shape:
        at.mistake(f"{x.kind.described()} has no length")
    return items_of(at.shape_tuple(x))[0]


# arrays from nothing


def _shape(at: Indexing, node: ast.expr | None) -> tuple[int, ...]:
    if node is None:
        at.mistake("a shape is missing")
    value = at.value(node)
    sizes = items_of(value) if value.kind.items is not None else [value]
    found = []
    for size in sizes:
        if size.constant is None or size.kind.base != INT:
            at.needs_constant("the shape of an array")
        if size.constant < 0:
            at.mistake("the sizes of an array are not negative")
        found.append(int(size.constant))
    return tuple(found)


def _dtype(at: Indexing, node: ast.expr | None, default: np.dtype = FLOAT) -> np.dtype:
    """The type of an array's numbers."""
    if node is None:
        return default
    known = node.value if isinstance(node, ast.Constant) else at.known(node)
    names = {float: FLOAT, int: INT, bool: BOOL, np.float64: FLOAT, np.int64: INT, np.bool_: BOOL, None: default}
    if known not in names:
        at.lack("an array has numbers of float, int or bool")
    return names[known]


def filled(at: Indexing, shape: tuple[int, ...], base: np.dtype, number: Value) -> Value:
    out = at.temporary(base, shape)
    at.fill(out, number)
    return out


def _constant_array(number: int) -> tuple[Writer, Writer]:
    """``np.zeros`` and ``np.zeros_like``, and so on."""

    def new(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
        shape, dtype = given(at, nodes, keywords, "shape", "dtype")
        return filled(at, _shape(at, shape), _dtype(at, dtype), at.constant(number))

    def like(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
        model, dtype = given(at, nodes, keywords, "a", "dtype")
        assert model is not None
        value = at.as_array(at.value(model))
        return filled(at, at.shape_of(value), _dtype(at, dtype, value.kind.base), at.constant(number))

    return new, like


def _filled(at: Indexing, shape: tuple[int, ...], base: np.dtype, number: Value) -> Value:
    if base != FLOAT and number.kind.base == FLOAT:
        number = at.as_integer(number)
    return filled(at, shape, base, scalar(at.converted(number, base), base))


FUNCTIONS[np.zeros], FUNCTIONS[np.zeros_like] = _constant_array(0)
FUNCTIONS[np.ones], FUNCTIONS[np.ones_like] = _constant_array(1)
FUNCTIONS[np.empty], FUNCTIONS[np.empty_like] = _constant_array(0)  # so that nothing is unset


@entry(np.full)
def _full(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    shape, value, dtype = given(at, nodes, keywords, "shape", "fill_value", "dtype")
    assert value is not None
    number = at.value(value)
    return _filled(at, _shape(at, shape), _dtype(at, dtype, number.kind.base), number)


@entry(np.full_like)
def _full_like(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    model, number = needed(at, nodes, keywords, "a", "fill_value")
    return _filled(at, at.shape_of(at.as_array(model)), model.kind.base, number)


@entry(np.eye, np.identity)
def _eye(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    node, columns = given(at, nodes, keywords, "N", "M")
    (n,), m = _shape(at, node), optional_integer(at, columns, "the shape of an array")
    out = filled(at, (n, m or n), FLOAT, at.constant(0.0))
    at.each((min(n, m or n),), lambda i: at.store(DOUBLE(1.0), at.pointer(out, [*i, *i])))
    return out


@entry(np.arange)
def _arange(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    if keywords or not 1 <= len(nodes) <= 3:
        at.lack("np.arange takes up to three integers here")
    bounds = range(*(at.constant_integer(node, "the length of np.arange") for node in nodes))
    out = at.temporary(INT, (len(bounds),))

    def body(i: list[ir.Value]) -> None:
        at.store(at.at.add(at.at.mul(i[0], WORD(bounds.step)), WORD(bounds.start)), at.pointer(out, i))

    at.each((len(bounds),), body)
    return out


@entry(np.array)
def _array(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    node, dtype = given(at, nodes, keywords, "object", "dtype")
    assert node is not None
    return _as_type(at, at.as_array(at.value(node)), _dtype(at, dtype, NO_TYPE))


@entry(np.asarray, np.ascontiguousarray)
def _asarray(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    node, dtype = given(at, nodes, keywords, "a", "dtype")
    assert node is not None
    value, base = at.as_array(at.value(node)), _dtype(at, dtype, NO_TYPE)
    return value if base in (NO_TYPE, value.kind.base) and value.kind.is_array else _as_type(at, value, base)


NO_TYPE = np.dtype("V1")


def _as_type(at: Indexing, value: Value, base: np.dtype) -> Value:
    """A new array with these numbers, of another type if one is given."""
    if base in (NO_TYPE, value.kind.base):
        return at.copied(value) if not value.fresh else value

    def typed(number: Value) -> Value:
        return at.as_integer(number) if base == INT else scalar(at.converted(number, base), base)

    return at.elementwise(typed, value)


@entry(np.astype, method="astype")
def _astype(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    node, dtype = given(at, nodes, keywords, "x", "dtype")
    assert node is not None
    return _as_type(at, at.value(node), _dtype(at, dtype))


@entry(np.copy, method="copy")
def _copy(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (x,) = needed(at, nodes, keywords, "a")
    return at.copied(at.as_array(x))


@entry(np.concatenate)
def _concatenate(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    parts, axis = given(at, nodes, keywords, "arrays", "axis")
    return at.joined(_parts(at, parts), optional_integer(at, axis, "an axis") or 0)


@entry(np.hstack)
def _hstack(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (parts,) = given(at, nodes, keywords, "tup")
    values = [value if value.kind.is_array else at.stacked([value]) for value in _parts(at, parts)]
    return at.joined(values, 0 if len(at.shape_of(values[0])) == 1 else 1)


@entry(np.stack)
def _stack(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    parts, axis = given(at, nodes, keywords, "arrays", "axis")
    return at.stacked(_parts(at, parts), optional_integer(at, axis, "an axis") or 0)


@entry(np.vstack)
def _vstack(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (parts,) = given(at, nodes, keywords, "tup")
    return at.joined([at.stacked([v]) if len(at.shape_of(v)) == 1 else v for v in _parts(at, parts)])


@entry(np.column_stack)
def _column_stack(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (parts,) = given(at, nodes, keywords, "tup")
    return at.stacked(_parts(at, parts), 1)


def _parts(at: Indexing, node: ast.expr | None) -> list[Value]:
    assert node is not None
    value = at.value(node)
    if value.kind.items is None:
        at.lack("a tuple of arrays is needed here")
    return [at.as_array(item) for item in items_of(value)]


# reductions


def _reduction(reduce: Callable[[Indexing], Callable[..., Value]]) -> Writer:
    def write(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
        x, axis = given(at, nodes, keywords, "a", "axis")
        assert x is not None
        return at.reduced(at.value(x), optional_integer(at, axis, "an axis"), reduce(at))

    return write


def _mean(at: Indexing) -> Callable[..., Value]:
    def reduce(n: int, term: Callable, in_order: bool) -> Value:
        if not n:
            return at.constant(math.nan)
        return at.operation("Div", at.total(n, term, in_order), at.constant(float(n)))

    return reduce


def _turn(step: Callable[..., Callable[..., Value]]) -> Callable[[Indexing], Callable[..., Value]]:
    return lambda at: lambda n, term, _: at.in_turn(n, term, step(at))


def _any(name: str) -> Callable[[Indexing], Callable[..., Value]]:
    def start(at: Indexing) -> Callable[..., Value]:
        def reduce(n: int, term: Callable, _: bool) -> Value:
            return at.in_turn(n, lambda i: scalar(at.truth(term(i)), BOOL), partial(_logical, at, name))

        return reduce

    return start


_REDUCTIONS: dict[str, tuple[tuple[Any, ...], Callable[[Indexing], Callable[..., Value]]]] = {
    "sum": ((np.sum,), lambda at: at.total),
    "mean": ((np.mean,), _mean),
    "prod": ((np.prod,), _turn(_operator("Mult"))),
    "min": ((np.min, np.amin), _turn(lambda at: partial(at.extreme, "<"))),
    "max": ((np.max, np.amax), _turn(lambda at: partial(at.extreme, ">"))),
    "any": ((np.any, any), _any("or_")),
    "all": ((np.all, all), _any("and_")),
    "argmin": ((np.argmin,), lambda at: lambda n, term, _: at.place_of(n, term, "<")),
    "argmax": ((np.argmax,), lambda at: lambda n, term, _: at.place_of(n, term, ">")),
}
for _name, (_functions, _reduce) in _REDUCTIONS.items():
    entry(*_functions, method=_name)(_reduction(_reduce))


@entry(sum)
def _sum(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    """Python's own sum, one after the other."""
    (x,) = needed(at, nodes, keywords, "iterable")
    values = (
        items_of(x)
        if x.kind.items is not None
        else [at.element(x, [WORD(i)]) for i in range(at.shape_of(x)[0])]
        if len(at.shape_of(x)) == 1 and x.kind.size <= 64
        else at.lack("write np.sum(x)")
    )
    result = whole(0)
    for value in values:
        result = at.binary("Add", result, value)
    return result


# elements of several arrays


@entry(np.clip, method="clip")
def _clip(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    x, low, high, out = given(at, nodes, keywords, "a", "a_min", "a_max", "out")
    assert x is not None
    result = at.value(x)
    bounds = [Value(Kind(np.dtype("V0")), ()) if node is None else at.value(node) for node in (low, high)]
    if not bounds[0].kind.is_none:
        result = at.elementwise(partial(at.extreme, ">"), result, bounds[0])
    if not bounds[1].kind.is_none:
        result = at.elementwise(partial(at.extreme, "<"), result, bounds[1])
    return result if out is None else stored(at, out, result)


@entry(np.where)
def _where(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    test, yes, no = needed(at, nodes, keywords, "condition", "x", "y")
    return at.elementwise(lambda t, a, b: at.chosen(at.truth(t), a, b), test, yes, no)


@entry(np.interp)
def _interp(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    x, xp, fp = needed(at, nodes, keywords, "x", "xp", "fp")
    table = [at.elementwise(lambda v: scalar(at.float_of(v), FLOAT), at.as_array(each)) for each in (xp, fp)]
    if at.shape_of(table[0]) != at.shape_of(table[1]) or len(at.shape_of(table[0])) != 1:
        at.mistake("the tables of np.interp have one length")
    return at.elementwise(lambda v: at.written(library.interp, [scalar(at.float_of(v), FLOAT), *table]), x)


# matrices


@entry(np.dot, np.matmul, np.inner, np.vdot, method="dot")
def _dot(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    a, b, out = given(at, nodes, keywords, "a", "b", "out")
    assert a is not None
    assert b is not None
    left, right = at.as_array(at.value(a)), at.as_array(at.value(b))
    result = at.binary("Mult" if not at.shape_of(left) or not at.shape_of(right) else "MatMult", left, right)
    return result if out is None else stored(at, out, result)


@entry(np.outer)
def _outer(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    a, b = (at.flat(at.as_array(value)) for value in needed(at, nodes, keywords, "a", "b"))
    column = Kind(a.kind.base, (*a.kind.sizes, 1), (*a.kind.strides, 0))
    return at.elementwise(partial(at.operation, "Mult"), replace(a, kind=column), b)


@entry(np.cross)
def _cross(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    a, b = (at.as_array(value) for value in needed(at, nodes, keywords, "a", "b"))
    if at.shape_of(a) != (3,) or at.shape_of(b) != (3,):
        at.mistake(f"a cross product is of two vectors (3,), not {shown(at.shape_of(a))} and {shown(at.shape_of(b))}")
    return at.written(library.cross, [a, b])


def _square(at: Indexing, value: Value) -> Value:
    value = at.as_array(value)
    shape = at.shape_of(value)
    if len(shape) != 2 or shape[0] != shape[1]:
        at.mistake(f"a square matrix is needed here, not shape {shown(shape)}")
    if value.kind.base != FLOAT:
        value = at.elementwise(lambda v: scalar(at.float_of(v), FLOAT), value)
    return value


@entry(np.trace, method="trace")
def _trace(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (value,) = needed(at, nodes, keywords, "a")
    diagonal = _diagonal(at, at.as_array(value))
    return at.total(diagonal.kind.size, lambda i: at.element(diagonal, [i]), False)


def _diagonal(at: Indexing, value: Value) -> Value:
    if len(at.shape_of(value)) != 2:
        at.mistake(f"a matrix is needed here, not shape {shown(at.shape_of(value))}")
    kind = Kind(value.kind.base, (min(value.kind.sizes),), (sum(value.kind.strides),), readonly=value.kind.readonly)
    return replace(value, kind=kind)


@entry(np.diag, np.diagonal)
def _diag(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (given_value,) = needed(at, nodes, keywords, "v")
    value = at.as_array(given_value)
    shape = at.shape_of(value)
    if len(shape) == 2:
        part = _diagonal(at, value)
        return replace(part, kind=replace(part.kind, readonly="lacks: np.diag(A) is a view that is only read"))
    out = at.temporary(value.kind.base, (*shape, *shape))
    at.fill(out, at.constant(0))
    at.each(shape, lambda i: at.store(at.element(value, i).llvm[0], at.pointer(out, [*i, *i])))
    return out


@entry(np.linalg.norm)
def _norm(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (value,) = needed(at, nodes, keywords, "x")
    flat = at.flat(at.as_array(value))
    return at.c_function("sqrt", [at.product(flat, flat)])


@entry(np.linalg.solve)
def _solve(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    A, b = needed(at, nodes, keywords, "a", "b")
    A, b = _square(at, A), at.elementwise(lambda v: scalar(at.float_of(v), FLOAT), at.as_array(b))
    if at.shape_of(b)[:1] != at.shape_of(A)[:1] or len(at.shape_of(b)) > 2:
        at.mistake(f"shapes {shown(at.shape_of(A))} and {shown(at.shape_of(b))} do not fit in linear equations")
    return at.written(library.solve if len(at.shape_of(b)) == 1 else library.solve_all, [A, b])


def _of_matrix(function: Callable) -> Writer:
    def write(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
        (A,) = needed(at, nodes, keywords, "a")
        return at.written(function, [_square(at, A)])

    return write


FUNCTIONS |= {
    np.linalg.inv: _of_matrix(library.inv),
    np.linalg.det: _of_matrix(library.det),
    np.linalg.cholesky: _of_matrix(library.cholesky),
}


# shapes


@entry(np.transpose, method="transpose")
def _transpose(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (value,) = needed(at, nodes, keywords, "a")
    return at.transposed(at.as_array(value))


@entry(np.ravel, method="ravel")
def _ravel(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (value,) = needed(at, nodes, keywords, "a")
    return at.flat(at.as_array(value))


@entry("flatten", method="flatten")
def _flatten(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    (value,) = needed(at, nodes, keywords, "a")
    return at.flat(at.copied(value))


@entry(np.reshape, method="reshape")
def _reshape(at: Indexing, nodes: Nodes, keywords: Keywords) -> Value:
    if keywords or not nodes:
        at.lack("reshape takes a shape without names here")
    value = at.as_array(at.value(nodes[0]))
    sizes = nodes[1:] if len(nodes) > 2 else _tuple_nodes(at, nodes[1])
    wanted = [
        at.constant_integer(node, "the shape of an array") if isinstance(node, ast.expr) else node for node in sizes
    ]
    size = int(np.prod(at.shape_of(value), dtype=int))
    try:
        shape = np.empty(size, bool).reshape(wanted).shape
    except ValueError:
        at.mistake(f"an array of {size} numbers can't have shape {shown(tuple(wanted))}")
    flat = at.flat(value)
    return replace(flat, kind=contiguous(flat.kind.base, shape, flat.kind.readonly))


def _tuple_nodes(at: Indexing, node: ast.expr) -> list[Any]:
    if isinstance(node, ast.UnaryOp):
        return [node]
    return list(_shape_or_minus(at, node))


def _shape_or_minus(at: Indexing, node: ast.expr) -> tuple[int, ...]:
    value = at.value(node)
    sizes = items_of(value) if value.kind.items is not None else [value]
    if any(size.constant is None for size in sizes):
        at.needs_constant("the shape of an array")
    return tuple(int(size.constant) for size in sizes)


@entry("fill", method="fill")
def _fill(at: Indexing, nodes: Nodes, keywords: Keywords) -> None:
    target, number = needed(at, nodes, keywords, "a", "value")
    at.store_all(target, number)


PROPERTIES |= {
    "T": lambda at, value: at.transposed(value),
    "shape": lambda at, value: at.shape_tuple(value),
    "size": lambda at, value: whole(int(np.prod(at.shape_of(value), dtype=int))),
    "ndim": lambda at, value: whole(len(value.kind.shape or ())),
}
