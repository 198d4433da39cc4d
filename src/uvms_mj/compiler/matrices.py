"""Products, norms and linear equations of vectors and matrices."""

from __future__ import annotations  # the binding of arguments reads the names of types

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial, reduce
from typing import Any

import numpy as np
from llvmlite import ir

from . import library
from .arrays import Arrays
from .calls import Array, Flag, Floats, Known, Node, Parts, Square, Whole, entry, stored
from .reductions import reduced
from .values import FLOAT, WORD, Kind, Value, bundle, items_of, scalar, shown, whole


@entry(np.inner)
def _inner(at: Arrays, a: Array, b: Array) -> Value:
    if len(at.shape_of(a)) == 0 or len(at.shape_of(b)) == 0:
        return _times(at, a, b)
    return at.product(a, at.transposed(b))


def _times(at: Arrays, a: Value, b: Value) -> Value:
    """The product with a number: a new array in the order of memory that np.dot gives it."""
    return at.laid(at.elementwise(partial(at.operation, "Mult"), a, b), np.dot(at.like(a), at.like(b)))


@entry(np.vdot)
def _vdot(at: Arrays, a: Array, b: Array) -> Value:
    if not a.kind.is_array or not b.kind.is_array:
        at.lack("np.vdot is of arrays here; write *")
    return at.product(at.flat(a), at.flat(b))


@entry(np.dot, np.matmul, method="dot")
def _dot(at: Arrays, a: Array, b: Array, out: Node | None = None) -> Value:
    of_numbers = not at.shape_of(a) or not at.shape_of(b)
    return stored(at, out, _times(at, a, b) if of_numbers else at.binary("MatMult", a, b))


@entry(np.outer)
def _outer(at: Arrays, a: Array, b: Array) -> Value:
    rows, columns = (at.flat(each) if each.kind.is_array else at.stacked([each]) for each in (a, b))
    column = Kind(rows.kind.base, (*rows.kind.sizes, 1), (*rows.kind.strides, 0))
    return at.elementwise(partial(at.operation, "Mult"), replace(rows, kind=column), columns)


@entry(np.cross)
def _cross(at: Arrays, a: Array, b: Array) -> Value:
    if at.shape_of(a) == at.shape_of(b) == (3,):
        return at.written(library.cross, [a, b])
    if at.shape_of(a)[-1:] != (3,) or at.shape_of(b)[-1:] != (3,):
        at.mistake(f"a cross product is of vectors of 3, not {shown(at.shape_of(a))} and {shown(at.shape_of(b))}")
    x, y = ([at.arranged(each, lambda like, k=k: like[..., k : k + 1]) for k in range(3)] for each in (a, b))

    def entry_of(i: int, k: int) -> Value:
        products = [at.elementwise(partial(at.operation, "Mult"), x[m], y[n]) for m, n in ((i, k), (k, i))]
        return at.elementwise(partial(at.operation, "Sub"), *products)

    return at.joined([entry_of(1, 2), entry_of(2, 0), entry_of(0, 1)], -1)


@entry(np.trace, method="trace")
def _trace(at: Arrays, a: Array, offset: Whole = 0) -> Value:
    if len(at.shape_of(a)) != 2:
        at.mistake(f"a matrix is needed here, not shape {shown(at.shape_of(a))}")
    diagonal = at.arranged(a, lambda like: np.diagonal(like, offset))
    if not diagonal.kind.size:
        at.lack("this diagonal has no numbers; write the result")
    return at.total(diagonal.kind.size, lambda i: at.element(diagonal, [i]), False)


@entry(np.linalg.norm)
def _norm(at: Arrays, x: Array, ord: Known = None, axis: Known = None, keepdims: Flag = False) -> Value:
    n = len(at.shape_of(x))
    if not n:
        at.lack("np.linalg.norm is of arrays here; write abs(x)")
    if not x.kind.size:
        at.lack("this array has no numbers; write the result")
    if axis is None and (ord is None or (ord == "fro" and n == 2) or (ord == 2 and n == 1)):
        flat = at.flat(x)
        root = at.c_function("sqrt", [at.product(flat, flat)])
        return at.gathered([root], np.ones([1] * n, int)) if keepdims else root
    numbers = at.elementwise(lambda each: scalar(at.float_of(each), FLOAT), x)
    if n == 2 and axis is None:
        return _norm_of_matrix(at, numbers, ord, keepdims)
    if (n > 1 and type(axis) is not int) or ord not in (None, 1, 2, np.inf, -np.inf):
        at.lack("np.linalg.norm has ord None, 1, 2, inf or -inf here, and one axis; write the sum")

    def of(at: Arrays, n: int, term: Callable, in_order: bool) -> Value:
        if ord in (None, 2):
            return at.c_function("sqrt", [at.total(n, lambda i: _squared(at, term(i)), in_order)])
        if ord == 1:
            return at.total(n, lambda i: at.magnitude(term(i)), in_order)
        sign = ">" if ord > 0 else "<"
        return at.in_turn(n, lambda i: at.magnitude(term(i)), partial(at.extreme, sign))

    return reduced(at, numbers, axis, keepdims, of)


def _squared(at: Arrays, x: Value) -> Value:
    return at.operation("Mult", x, x)


def _norm_of_matrix(at: Arrays, numbers: Value, ord: Any, keepdims: bool) -> Value:
    if ord not in (1, -1, np.inf, -np.inf) or keepdims:
        at.lack("the norm of a matrix has ord None, 'fro', 1 or inf here; write np.linalg.norm(A)")
    sums = reduced(
        at,
        at.elementwise(at.magnitude, numbers),
        0 if abs(ord) == 1 else 1,
        False,
        Arrays.total,
    )
    sign = ">" if ord > 0 else "<"
    return at.reduced(sums, None, lambda n, term, _: at.in_turn(n, term, partial(at.extreme, sign)))


@entry(np.linalg.matrix_power)
def _matrix_power(at: Arrays, a: Array, n: Whole) -> Value:
    shape = at.shape_of(a)
    if len(shape) != 2 or shape[0] != shape[1]:
        at.mistake(f"a square matrix is needed here, not shape {shown(shape)}")
    if n == 0:
        return at.literal(np.eye(shape[0], dtype=a.kind.base))
    if n == 1:
        return a
    if n < 0:
        a = at.written(library.inv, [at.elementwise(lambda each: scalar(at.float_of(each), FLOAT), a)])
    return library.power_of_matrix(a, abs(n), at.product, at.copied)


@entry(np.linalg.multi_dot)
def _multi_dot(at: Arrays, arrays: Parts) -> Value:
    return reduce(at.product, arrays)


@entry(np.tensordot)
def _tensordot(at: Arrays, a: Array, b: Array, axes: Known = 2) -> Value:
    if axes != 1 or max(len(at.shape_of(each)) for each in (a, b)) > 2:
        at.lack("np.tensordot is of vectors and matrices with axes=1 here; write @, or np.einsum")
    return at.product(a, b)


@entry(np.einsum)
def _einsum(at: Arrays, subscripts: Known, *operands: Array) -> Value:
    shapes = [at.shape_of(each) for each in operands]
    with at.refused_by_numpy():
        letters, out, sizes = library.read_subscripts(subscripts, shapes)
    summed = [each for each in sizes if each not in out]
    base = at.common(operands)
    count = int(np.prod([sizes[each] for each in summed], dtype=int))
    if not count or base != at.base_of(operands):
        at.lack("np.einsum is of numbers here; write the sums")
    if len(operands) == 1 and not summed:
        at.lack("np.einsum gives a view here; write A.T, np.diagonal(A) or np.transpose")

    def body(indices: Sequence[ir.Value]) -> Value:
        def term(k: ir.Value) -> Value:
            places, left = dict(zip(out, indices, strict=True)), k
            for letter in reversed(summed[1:]):
                size = WORD(sizes[letter])
                if isinstance(left, ir.Constant):
                    places[letter], left = WORD(left.constant % size.constant), WORD(left.constant // size.constant)
                else:
                    places[letter], left = at.at.srem(left, size), at.at.sdiv(left, size)
            if summed:
                places[summed[0]] = left
            factors = [at.element(x, [places[i] for i in of]) for x, of in zip(operands, letters, strict=True)]
            return reduce(partial(at.operation, "Mult"), factors)

        def further(so_far: Sequence[ir.Value], k: ir.Value) -> list[ir.Value]:
            return [at.converted(at.operation("Add", scalar(so_far[0], base), term(k)), base)]

        return scalar(at.folded(count, [at.converted(term(WORD(0)), base)], further)[0], base)

    if not out:
        return body([])
    result = at.made(base, [sizes[each] for each in out])
    at.each(result.kind.sizes, lambda indices: at.put(body(indices).llvm[0], result, indices))
    return at.laid(result, np.einsum(subscripts, *map(at.like, operands)))


@entry(library.raises)
def _raises(at: Arrays) -> Value:
    return at.constant(at.unit.checked)


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


@entry(np.linalg.slogdet)
def _slogdet(at: Arrays, a: Square) -> Value:
    return at.written(library.slogdet, [a])


@entry(np.linalg.pinv)
def _pinv(
    at: Arrays, a: Floats, rcond: Value | None = None, hermitian: Flag = False, *, rtol: Value | None = None
) -> Value:
    if hermitian or (rcond is not None and rtol is not None):
        at.lack("np.linalg.pinv has rcond or rtol here")
    given = rcond if rtol is None else rtol
    return at.written(
        library.pseudo_inverse, [_matrix(at, a), _number(at, at.constant(1e-15) if given is None else given)]
    )


@entry(np.linalg.lstsq)
def _lstsq(at: Arrays, a: Floats, b: Floats, rcond: Value | None = None) -> Value:
    m, n = at.shape_of(_matrix(at, a))
    if at.shape_of(b)[:1] != (m,) or len(at.shape_of(b)) > 2:
        at.mistake(f"shapes {shown((m, n))} and {shown(at.shape_of(b))} do not fit in linear equations")
    usual = at.constant(float(np.finfo(float).eps * max(m, n)))
    columns = b if len(at.shape_of(b)) == 2 else at.arranged(b, lambda like: like.reshape(-1, 1))
    found = at.written(library.least_squares, [a, columns, _number(at, usual if rcond is None else rcond)])
    x, residuals, values = items_of(found)
    if columns is not b:
        x = at.arranged(x, lambda like: like[:, 0].copy())
    if m <= n:
        residuals = at.temporary(FLOAT, (0,))
    return bundle([x, residuals, whole(min(m, n)), values])


def _matrix(at: Arrays, a: Value) -> Value:
    if len(at.shape_of(a)) != 2 or not a.kind.size:
        at.lack(f"one matrix is needed here, not shape {shown(at.shape_of(a))}")
    return a


def _number(at: Arrays, value: Value) -> Value:
    return scalar(at.float_of(value), FLOAT)


@entry(np.linalg.svd)
def _svd(at: Arrays, a: Floats, full_matrices: Flag = True, compute_uv: Flag = True) -> Value:
    if compute_uv:
        at.lack("the signs of singular vectors are not known; write np.linalg.pinv(A), or compute_uv=False")
    return at.written(library.singular_values, [_matrix(at, a)])


@entry(np.linalg.cond)
def _cond(at: Arrays, x: Floats, p: Known = None) -> Value:
    if p not in (None, 2):
        at.lack("np.linalg.cond has p None or 2 here")
    return at.written(library.condition, [_matrix(at, x)])


@entry(np.linalg.eigvalsh)
def _eigvalsh(at: Arrays, a: Square, UPLO: Known = "L") -> Value:
    if UPLO != "L":
        at.lack("np.linalg.eigvalsh reads the lower triangle here; write np.linalg.eigvalsh(A.T)")
    return at.written(library.eigenvalues, [a])
