"""Sums, means, extremes, orders: one number of many, or of each row, and numbers so far."""

from __future__ import annotations  # the binding of arguments reads the names of types

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir

from . import library
from .arrays import Arrays
from .calls import Array, Flag, Known, entry
from .refusals import RAISED
from .values import BOOL, FLAG, FLOAT, INT, WORD, Value, bundle, items_of, scalar, shown, whole

Reduce = Callable[[Arrays, int, Callable[[ir.Value], Value], bool], Value]


def reduced(at: Arrays, a: Value, axis: Any, keepdims: bool, function: Reduce) -> Value:
    """``function(at, n, term, in_order)`` of all entries or along an axis; ``keepdims`` as NumPy's."""
    a = at.as_array(a)
    shape = at.shape_of(a)
    if isinstance(axis, tuple) and len({each % max(len(shape), 1) for each in axis}) == len(axis) == len(shape):
        axis = None
    if axis is not None and type(axis) is not int:
        at.lack("axis is one integer here, or all axes; write one sum of another")
    result = at.reduced(a, axis, partial(function, at))
    if not keepdims or not shape:
        return result
    if axis is None:
        return at.gathered([result], np.ones([1] * len(shape), int))
    if not result.kind.is_array:
        return at.stacked([result])
    return at.arranged(result, lambda like: np.expand_dims(like, axis))


def _full(at: Arrays, a: Value) -> Value:
    """An array with entries."""
    a = at.as_array(a)
    if not math.prod(at.shape_of(a)):
        at.lack("this array has no numbers; write the result")
    return a


def _reduction(function: Reduce, of_floats: bool = False) -> Callable:
    def write(at: Arrays, a: Array, axis: Known | None = None, keepdims: Flag = False) -> Value:
        if not of_floats or a.kind.base != FLOAT or a.kind.shape != (0,):
            a = _full(at, a)
        return reduced(at, a, axis, keepdims, function)

    return write


def _mean(at: Arrays, n: int, term: Callable, in_order: bool) -> Value:
    return at.operation("Div", at.total(n, term, in_order), at.constant(float(n))) if n else at.constant(math.nan)


def _in_turn(step: Callable[..., Value]) -> Reduce:
    return lambda at, n, term, _: at.in_turn(n, term, partial(step, at))


def _product(at: Arrays, a: Value, b: Value) -> Value:
    return at.operation("Mult", a, b)


def _least(at: Arrays, a: Value, b: Value) -> Value:
    return at.extreme("<", a, b)


def _greatest(at: Arrays, a: Value, b: Value) -> Value:
    return at.extreme(">", a, b)


def _tested(name: str) -> Reduce:
    def step(at: Arrays, a: Value, b: Value) -> Value:
        return scalar(getattr(at.at, name)(at.truth(a), at.truth(b)), BOOL)

    return lambda at, n, term, _: at.in_turn(n, lambda i: scalar(at.truth(term(i)), BOOL), partial(step, at))


def _range(at: Arrays, n: int, term: Callable, in_order: bool) -> Value:
    greatest, least = (at.in_turn(n, term, partial(step, at)) for step in (_greatest, _least))
    return at.operation("Sub", greatest, least)


_REDUCTIONS: dict[str, tuple[tuple[Any, ...], Reduce]] = {
    "sum": ((np.sum,), Arrays.total),
    "mean": ((np.mean,), _mean),
    "prod": ((np.prod,), _in_turn(_product)),
    "min": ((np.min, np.amin), _in_turn(_least)),
    "max": ((np.max, np.amax), _in_turn(_greatest)),
    "any": ((np.any, any), _tested("or_")),
    "all": ((np.all, all), _tested("and_")),
    "argmin": ((np.argmin,), lambda at, n, term, _: at.place_of(n, term, "<")),
    "argmax": ((np.argmax,), lambda at, n, term, _: at.place_of(n, term, ">")),
}
for _name, (_functions, _reduce) in _REDUCTIONS.items():
    entry(*_functions, method=_name)(_reduction(_reduce, _name in ("sum", "mean")))
entry(np.ptp)(_reduction(_range))


@entry(np.count_nonzero)
def _count_nonzero(at: Arrays, a: Array, axis: Known | None = None, keepdims: Flag = False) -> Value:
    tests = at.elementwise(lambda each: scalar(at.truth(each), BOOL), _full(at, a))
    return reduced(at, tests, axis, keepdims, Arrays.total)


def _variance(at: Arrays, a: Value, axis: Any, ddof: Any, keepdims: bool) -> Value:
    if not isinstance(ddof, int | float):
        at.lack("ddof is a number here")

    def of(at: Arrays, n: int, term: Callable, in_order: bool) -> Value:
        mean = _mean(at, n, term, in_order)

        def square(i: ir.Value) -> Value:
            off = at.operation("Sub", term(i), mean)
            return at.operation("Mult", off, off)

        return at.operation("Div", at.total(n, square, in_order), at.constant(float(max(n - ddof, 0))))

    return reduced(at, _full(at, a), axis, keepdims, of)


@entry(np.var, method="var")
def _var(at: Arrays, a: Array, axis: Known | None = None, ddof: Known = 0, keepdims: Flag = False) -> Value:
    return _variance(at, a, axis, ddof, keepdims)


@entry(np.std, method="std")
def _std(at: Arrays, a: Array, axis: Known | None = None, ddof: Known = 0, keepdims: Flag = False) -> Value:
    return at.elementwise(lambda each: at.c_function("sqrt", [each]), _variance(at, a, axis, ddof, keepdims))


@entry(np.average)
def _average(at: Arrays, a: Array, axis: Known | None = None, weights: Array | None = None) -> Value:
    if weights is None:
        return reduced(at, _full(at, a), axis, False, _mean)
    if at.shape_of(weights) != at.shape_of(a):
        at.lack("weights have the shape of what they weigh here; write a sum of products")
    total = reduced(at, _full(at, weights), axis, False, Arrays.total)
    if total.kind.is_array:
        at.lack("the weights are of one vector here; write a sum of products")
    at.demand(at.comparison("!=", total, at.constant(0.0)).llvm[0], RAISED)
    weighed = at.elementwise(partial(at.operation, "Mult"), a, weights)
    return at.operation("Div", reduced(at, weighed, axis, False, Arrays.total), total)


@entry(sum)
def _sum(at: Arrays, iterable: Value, start: Value | None = None) -> Value:
    """Python's own sum, one after the other."""
    if iterable.kind.items is not None:
        values = items_of(iterable)
    elif len(at.shape_of(iterable)) == 1 and iterable.kind.size <= 64:
        values = [at.element(iterable, [WORD(i)]) for i in range(iterable.kind.size)]
    else:
        at.lack("write np.sum(x)")
    result = whole(0) if start is None else start
    for value in values:
        result = at.binary("Add", result, value)
    return result


# numbers so far


def _accumulated(at: Arrays, a: Value, axis: Any, step: Callable[..., Value]) -> Value:
    if axis is None:
        a, axis = at.flat(a) if a.kind.is_array else at.stacked([a]), 0
    shape = at.shape_of(a)
    if type(axis) is not int or not -len(shape) <= axis < len(shape):
        at.mistake(f"an array of shape {shown(shape)} has no axis {axis}")
    axis %= len(shape)
    n, rest = shape[axis], (*shape[:axis], *shape[axis + 1 :])
    out = at.made(FLOAT if a.kind.base == FLOAT else INT, shape, at.axes_in_memory([a], shape))

    def body(indices: list[ir.Value]) -> None:
        def place(i: ir.Value) -> list[ir.Value]:
            return [*indices[:axis], i, *indices[axis:]]

        at.put(at.converted(at.element(a, place(WORD(0))), out.kind.base), out, place(WORD(0)))

        def further(before: ir.Value, i: ir.Value) -> None:
            result = step(at, at.element(out, place(before)), at.element(a, place(i)))
            at.put(at.converted(result, out.kind.base), out, place(i))

        if out.kind.size <= at.unit.unrolled:
            for k in range(1, n):
                further(WORD(k - 1), WORD(k))
        else:
            at.turns(WORD(n - 1), lambda i: further(i, at.at.add(i, WORD(1))))

    if out.kind.size:
        at.each(rest, body)
    return out


@entry(np.cumsum, method="cumsum")
def _cumsum(at: Arrays, a: Array, axis: Known | None = None) -> Value:
    return _accumulated(at, a, axis, lambda at, x, y: at.operation("Add", x, y))


@entry(np.cumprod, method="cumprod")
def _cumprod(at: Arrays, a: Array, axis: Known | None = None) -> Value:
    return _accumulated(at, a, axis, _product)


def _ends(at: Arrays, a: Value, axis: int, first: int, behind: int) -> Value:
    """The entries along an axis without some at the beginning and at the end."""

    def part(like: np.ndarray) -> np.ndarray:
        return np.moveaxis(np.moveaxis(like, axis, 0)[first : like.shape[axis] - behind], 0, axis)

    return at.arranged(a, part)


@entry(np.diff)
def _diff(
    at: Arrays, a: Array, n: Known = 1, axis: Known = -1, prepend: Array | None = None, append: Array | None = None
) -> Value:
    shape = at.shape_of(a)
    if type(n) is not int or type(axis) is not int or n < 0 or not -len(shape) <= axis < len(shape):
        at.mistake(f"there are no differences number {n} along axis {axis} of an array of shape {shown(shape)}")
    if a.kind.base == BOOL:
        at.lack("NumPy gives truth values as differences of truth values; write 1.0 * x")
    axis %= len(shape)
    parts = [each for each in (prepend, a, append) if each is not None]
    if len(parts) > 1:
        one = (*shape[:axis], 1, *shape[axis + 1 :])
        a = at.joined([each if each.kind.is_array else at.gathered([each], np.ones(one, int)) for each in parts], axis)
    for _ in range(n):
        a = at.elementwise(partial(at.operation, "Sub"), _ends(at, a, axis, 1, 0), _ends(at, a, axis, 0, 1))
    return a


# orders


def _row(at: Arrays, a: Value) -> Value:
    if len(at.shape_of(a)) != 1:
        at.lack("this is of one vector here; write a loop over the rows")
    return a


@entry(np.sort)
def _sort(at: Arrays, a: Array, axis: Known = -1) -> Value:
    if axis not in (0, -1):
        at.lack("np.sort is of one vector here; write np.sort(x.ravel())")
    return at.written(library.sort, [_row(at, a)])


@entry("sort", method="sort")
def _sort_in_place(at: Arrays, a: Array, axis: Known = -1) -> None:
    at.store_all(a, _sort(at, a, axis))


@entry(np.argsort, method="argsort")
def _argsort(at: Arrays, a: Array, axis: Known = -1, kind: Known = None, stable: Known = None) -> Value:
    if axis not in (0, -1):
        at.lack("np.argsort is of one vector here; write a loop over the rows")
    in_order = kind == "stable" or stable is True  # otherwise NumPy says nothing of equal numbers
    return at.written(library.argsort if in_order else library.argsort_distinct, [_row(at, a)])


@entry(sorted)
def _sorted(at: Arrays, iterable: Array, reverse: Flag = False) -> Value:
    n = at.shape_of(_row(at, iterable))[0]
    if n > 64:
        at.lack("write np.sort(x)")
    if n == 0:
        return bundle([])
    whole_row = at.written(library.sorted_stable if not reverse else library.sorted_back, [iterable])
    return bundle([at.element(whole_row, [WORD(i)]) for i in range(n)])


@entry(np.searchsorted, method="searchsorted")
def _searchsorted(at: Arrays, a: Array, v: Value, side: Known = "left") -> Value:
    if side not in ("left", "right"):
        at.mistake("side is 'left' or 'right'")
    number = scalar(FLAG(side == "right"), BOOL)
    table = _row(at, a)
    return at.elementwise(lambda each: at.written(library.place, [table, each, number]), v)


@entry(np.digitize)
def _digitize(at: Arrays, x: Value, bins: Array, right: Flag = False) -> Value:
    table, behind = _row(at, bins), scalar(FLAG(not right), BOOL)
    return at.elementwise(lambda each: at.written(library.place_in_bins, [table, each, behind]), x)


def _sorted_rows(at: Arrays, a: Value, axis: Any, keepdims: bool, of: Callable[[int, Value], Value]) -> Value:
    """A number of the sorted entries of all, or along an axis: ``of(n, sorted)``; NaN if one is NaN."""

    def row(at: Arrays, n: int, term: Callable, _: bool) -> Value:
        numbers = at.temporary(FLOAT, (n,))
        at.each((n,), lambda i: at.store(at.float_of(term(i[0])), at.pointer(numbers, i)))
        ordered = at.written(library.sort, [numbers])
        last = at.element(ordered, [WORD(n - 1)])
        return at.chosen(at.is_nan(last), last, of(n, ordered))

    return reduced(at, _full(at, a), axis, keepdims, row)


@entry(np.median)
def _median(at: Arrays, a: Array, axis: Known | None = None, keepdims: Flag = False) -> Value:
    def middle(n: int, ordered: Value) -> Value:
        first, count = (n - 1) // 2, 2 - n % 2
        return _mean(at, count, lambda i: at.element(ordered, [WORD(first + i.constant)]), False)

    return _sorted_rows(at, a, axis, keepdims, middle)


def _quantile_of(at: Arrays, a: Value, q: Any, axis: Any, keepdims: bool) -> Value:
    if type(q) is not float or not 0.0 <= q <= 1.0:
        at.lack("q is one float here, from 0.0 to 1.0, or for percentile to 100.0")

    def between(n: int, ordered: Value) -> Value:
        place = (n - 1) * q
        below = -1 if place >= n - 1 else math.floor(place)
        a, b = (at.element(ordered, [WORD(k % n)]) for k in (below, -1 if below < 0 else below + 1))
        t = place - below
        apart = at.operation("Sub", b, a)
        if t >= 0.5:
            return at.operation("Sub", b, at.operation("Mult", apart, at.constant(float(1 - t))))
        return at.operation("Add", a, at.operation("Mult", apart, at.constant(float(t))))

    return _sorted_rows(at, a, axis, keepdims, between)


@entry(np.quantile)
def _quantile(at: Arrays, a: Array, q: Known, axis: Known | None = None, keepdims: Flag = False) -> Value:
    return _quantile_of(at, a, q, axis, keepdims)


@entry(np.percentile)
def _percentile(at: Arrays, a: Array, q: Known, axis: Known | None = None, keepdims: Flag = False) -> Value:
    return _quantile_of(at, a, q / 100 if type(q) in (int, float) else None, axis, keepdims)
