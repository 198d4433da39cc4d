"""Functions that put the numbers of arrays into another shape or order.

NumPy itself says what each of them does: it is asked with arrays of integers, the numbers of the entries. The result is
a view where NumPy's is one, and a new array otherwise.
"""

from __future__ import annotations  # the binding of arguments reads the names of types

import ast
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from .arrays import Arrays
from .calls import FUNCTIONS, METHODS, Array, Known, Node, Parts, entry, given_names, known_as
from .values import INT, Value, bundle, items_of


def arranged(at: Arrays, value: Value, arrange: Callable[[np.ndarray], Any]) -> Value:
    """An array, or a number, whose entries NumPy puts in another order."""
    if value.kind.is_array:
        return _without_axes(at, at.arranged(value, arrange))
    with at.refused_by_numpy():
        order = arrange(np.array(1))
    return at.gathered([value], order) if order.shape else value


def _without_axes(at: Arrays, value: Value) -> Value:
    """An array of shape () as its number."""
    if value.kind.shape != ():
        return value
    if not value.fresh:
        at.lack("NumPy gives a view of one number here; write x[0], or x.item()")
    return at.element(value, [])


# of one array


def _arranging(function: Any, method: str = "") -> None:
    """Add a function of NumPy's that arranges one array, its first argument; all others are known when compiling."""

    def write(at: Arrays, nodes: Sequence[ast.expr], keywords: Mapping[str, ast.expr]) -> Value:
        first, *names = given_names(function)
        if len(nodes) > 1 + len(names) or set(keywords) & set(names[: max(len(nodes) - 1, 0)]):
            at.mistake(f"np.{function.__name__} takes {', '.join([first, *names])}, each once")
        found = dict(zip([first, *names], nodes, strict=False)) | dict(keywords)
        if first not in found:
            at.lack(f"argument {first} is missing")
        for name in set(found) - {first, *names}:
            at.lack(f"the language has no argument {name} here")
        value = at.as_array(at.value(found.pop(first)))
        known = {name: known_as(at, node) for name, node in found.items()}
        return arranged(at, value, lambda like: function(like, **known))

    FUNCTIONS[function] = write
    if method:
        METHODS[method] = function


for _function in (np.transpose, np.reshape, np.expand_dims, np.moveaxis, np.flip, np.fliplr, np.flipud, np.rot90):
    _arranging(_function)
for _function in (np.roll, np.tile, np.delete, np.triu, np.tril, np.diag, np.diagflat, np.broadcast_to, np.resize):
    _arranging(_function)
for _function in (np.split, np.array_split, np.hsplit, np.vsplit):
    _arranging(_function)
for _function in (np.ravel, np.squeeze, np.swapaxes, np.repeat, np.diagonal):
    _arranging(_function, method=_function.__name__)


@entry("reshape", method="reshape")
def _reshape(at: Arrays, a: Array, *shape: Known, order: Known = "C") -> Value:
    sizes = shape[0] if len(shape) == 1 and isinstance(shape[0], tuple) else shape
    return arranged(at, a, lambda like: like.reshape(sizes, order=order))


@entry("transpose", method="transpose")
def _transpose(at: Arrays, a: Array, *axes: Known) -> Value:
    return arranged(at, a, lambda like: like.transpose(*axes))


@entry("flatten", method="flatten")
def _flatten(at: Arrays, a: Array, order: Known = "C") -> Value:
    new = at.arranged(a, lambda like: like.ravel(order=order))
    return new if new.fresh else at.copied(new)


@entry(np.pad)
def _pad(at: Arrays, array: Array, pad_width: Known, mode: Known = "constant") -> Value:
    if mode not in ("constant", "edge", "reflect", "symmetric", "wrap"):
        at.lack(f"the language has no mode {mode!r} here; write np.concatenate")
    return arranged(at, array, lambda like: np.pad(like, pad_width, mode))


@entry(np.take, method="take")
def _take(at: Arrays, a: Array, indices: Known, axis: Known = None) -> Value:
    return arranged(at, a, lambda like: np.take(like, indices, axis))


def _at_least(function: Callable) -> None:
    def write(at: Arrays, *arys: Array) -> Value:
        found = [arranged(at, each, function) for each in arys]
        return found[0] if len(found) == 1 else bundle(found)

    entry(function)(write)


for _function in (np.atleast_1d, np.atleast_2d, np.atleast_3d):
    _at_least(_function)


# of several arrays


@entry(np.concatenate)
def _concatenate(at: Arrays, arrays: Parts, axis: Known = 0) -> Value:
    return at.joined(arrays, axis)


@entry(np.stack)
def _stack(at: Arrays, arrays: Parts, axis: Known = 0) -> Value:
    return at.laid(at.stacked(arrays, axis), np.stack([*map(at.like, arrays)], axis))


def _with_axes(at: Arrays, parts: Sequence[Value], arrange: Callable) -> list[Value]:
    return [arranged(at, each, arrange) for each in parts]


@entry(np.hstack)
def _hstack(at: Arrays, tup: Parts) -> Value:
    parts = _with_axes(at, tup, np.atleast_1d)
    return at.joined(parts, 0 if len(at.shape_of(parts[0])) == 1 else 1)


@entry(np.vstack)
def _vstack(at: Arrays, tup: Parts) -> Value:
    return at.joined(_with_axes(at, tup, np.atleast_2d))


@entry(np.dstack)
def _dstack(at: Arrays, tup: Parts) -> Value:
    return at.joined(_with_axes(at, tup, np.atleast_3d), 2)


@entry(np.column_stack)
def _column_stack(at: Arrays, tup: Parts) -> Value:
    def column(like: np.ndarray) -> np.ndarray:
        return np.atleast_1d(like).reshape(-1, 1) if like.ndim < 2 else like

    return at.joined(_with_axes(at, tup, column), 1)


@entry(np.append)
def _append(at: Arrays, arr: Array, values: Array, axis: Known = None) -> Value:
    if axis is not None:
        return at.joined([arr, values], axis)
    return at.joined(_with_axes(at, [arr, values], np.ravel))


@entry(np.insert)
def _insert(at: Arrays, arr: Array, obj: Known, values: Array, axis: Known = None) -> Value:
    if at.base_of([arr, values]) != arr.kind.base:
        at.lack("np.insert turns the new numbers into the array's type; write np.concatenate")
    with at.refused_by_numpy():
        old, new = at.numbered([arr, values])
        order = np.insert(old, obj, new, axis)
    return at.gathered([arr, values], order)


@entry(np.block)
def _block(at: Arrays, arrays: Node) -> Value:
    found: list[Value] = []

    def nested(value: Value) -> Any:
        if value.kind.items is not None:
            return [nested(each) for each in items_of(value)]
        found.append(value)
        return len(found) - 1

    places = nested(at.value(arrays))
    numbers = at.numbered(found)

    def filled(place: Any, of: Sequence[np.ndarray]) -> Any:
        return [filled(each, of) for each in place] if isinstance(place, list) else of[place]

    with at.refused_by_numpy():
        order = np.block(filled(places, numbers))
    return at.laid(at.gathered(found, order), np.block(filled(places, [*map(at.like, found)])))


@entry(np.meshgrid)
def _meshgrid(at: Arrays, *xi: Array, indexing: Known = "xy") -> Value:
    with at.refused_by_numpy():
        orders = np.meshgrid(*at.numbered(xi), indexing=indexing)
    return bundle([at.gathered(xi, order, value.kind.base) for order, value in zip(orders, xi, strict=True)])


@entry(np.kron)
def _kron(at: Arrays, a: Array, b: Array) -> Value:
    left, right = (np.ones(at.shape_of(each), INT) for each in (a, b))
    numbers = (np.kron(at.numbered([a])[0], right), np.kron(left, at.numbered([b])[0]))
    factors = [at.gathered([each], order) for each, order in zip((a, b), numbers, strict=True)]
    return at.laid(at.elementwise(partial(at.operation, "Mult"), *factors), np.kron(at.like(a), at.like(b)))


# as Python's own


@entry("tolist", method="tolist")
def _tolist(at: Arrays, a: Array) -> Value:
    if not a.kind.is_array:
        return a
    n, *rest = at.shape_of(a)
    rows = [arranged(at, a, lambda like, i=i: like[i]) if rest else _entry(at, a, i) for i in range(n)]
    return bundle([_tolist(at, row) if rest else row for row in rows])


def _entry(at: Arrays, a: Value, number: int) -> Value:
    """The number of an array with this number in C order."""
    with at.refused_by_numpy():
        order = at.numbered([a])[0].flat[number] - 1
    return at.element(a, [at.constant(int(i)).llvm[0] for i in np.unravel_index(order, at.shape_of(a))])


@entry("item", method="item")
def _item(at: Arrays, a: Array, *args: Known) -> Value:
    if not a.kind.is_array:
        return a
    with at.refused_by_numpy():
        number = at.numbered([a])[0].item(*args)
    return _entry(at, a, number - 1)
