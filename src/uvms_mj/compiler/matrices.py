"""Products, norms and linear equations of vectors and matrices."""

from __future__ import annotations  # the binding of arguments reads the names of types

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from . import library
from .arrays import Arrays
from .calls import Array, Floats, Node, Square, entry, stored
from .values import Kind, Value, shown


@entry(np.inner, np.vdot)
def _inner(at: Arrays, a: Array, b: Array) -> Value:
    if len(at.shape_of(a)) != 1 or len(at.shape_of(b)) != 1:
        at.lack("np.inner and np.vdot are of vectors here; write @")
    return at.binary("MatMult", a, b)


@entry(np.dot, np.matmul, method="dot")
def _dot(at: Arrays, a: Array, b: Array, out: Node | None = None) -> Value:
    name = "Mult" if not at.shape_of(a) or not at.shape_of(b) else "MatMult"
    return stored(at, out, at.binary(name, a, b))


@entry(np.outer)
def _outer(at: Arrays, a: Array, b: Array) -> Value:
    if not a.kind.is_array or not b.kind.is_array:
        at.lack("np.outer is of arrays here; write *")
    a, b = at.flat(a), at.flat(b)
    column = Kind(a.kind.base, (*a.kind.sizes, 1), (*a.kind.strides, 0))
    return at.elementwise(partial(at.operation, "Mult"), replace(a, kind=column), b)


@entry(np.cross)
def _cross(at: Arrays, a: Array, b: Array) -> Value:
    if at.shape_of(a) != (3,) or at.shape_of(b) != (3,):
        at.mistake(f"a cross product is of two vectors (3,), not {shown(at.shape_of(a))} and {shown(at.shape_of(b))}")
    return at.written(library.cross, [a, b])


def _diagonal(at: Arrays, value: Value) -> Value:
    return at.arranged(value, np.diagonal)


@entry(np.trace, method="trace")
def _trace(at: Arrays, a: Array) -> Value:
    diagonal = _diagonal(at, a)
    return at.total(diagonal.kind.size, lambda i: at.element(diagonal, [i]), False)


@entry(np.linalg.norm)
def _norm(at: Arrays, x: Array) -> Value:
    if not x.kind.is_array:
        at.lack("np.linalg.norm is of arrays here; write abs(x)")
    flat = at.flat(x)
    return at.c_function("sqrt", [at.product(flat, flat)])


@entry(np.linalg.solve)
def _solve(at: Arrays, a: Square, b: Floats) -> Value:
    shape, right = at.shape_of(a), at.shape_of(b)
    if right[:1] != shape[:1] or len(right) > 2:
        at.mistake(f"shapes {shown(shape)} and {shown(right)} do not fit in linear equations")
    return at.written(library.solve if len(right) == 1 else library.solve_all, [a, b])


def _of_matrix(function: Callable) -> Callable:
    def write(at: Arrays, a: Square) -> Value:
        return at.written(function, [a])

    return write


entry(np.linalg.inv)(_of_matrix(library.inv))
entry(np.linalg.det)(_of_matrix(library.det))
entry(np.linalg.cholesky)(_of_matrix(library.cholesky))
