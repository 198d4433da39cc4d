"""Each function of the language, once: machine code gives what NumPy, ``math`` and Python give."""

import inspect
import math
import types

import numpy as np
import pytest

from compiled import compare
from uvms_mj.compiler.builtin import _ELEMENTWISE, FUNCTIONS

GIVEN = np.dtype([("k", "f8"), ("x", "f8", (6,)), ("y", "f8", (6,)), ("A", "f8", (6, 6))], align=True)
OUT = np.dtype([("x", "f8", (6,)), ("A", "f8", (6, 6)), ("s", "f8", (12,)), ("whole", "i8", (6,))], align=True)
F = None  # each of the functions in turn


def inside(x):
    """0.06 to 0.94 for any number: a value in the domain of most functions."""
    return 0.5 + 0.44 * x / (1.0 + abs(x))


def one(g, o):
    for i in range(6):
        o.x[i] = F(inside(g.x[i]))


def one_beyond(g, o):
    for i in range(6):
        o.x[i] = F(1.0 + inside(g.x[i]))


def one_array(g, o):
    o.x[:] = F(inside(g.x))


def one_array_beyond(g, o):
    o.x[:] = F(1.0 + inside(g.x))


def two(g, o):
    for i in range(6):
        o.x[i] = F(inside(g.x[i]), inside(g.y[i]))


def two_arrays(g, o):
    o.x[:] = F(inside(g.x), inside(g.y))


def reduced(g, o):
    o.s[0] = F(g.x)


def whole_number(g, o):
    o.whole[0] = F(7.0 * g.k)


def number(g, o):
    o.s[0] = F(7.0 * g.k)


def of_a_base(g, o):
    o.s[0] = F(inside(g.k), 3.0)
    o.s[1] = F(inside(g.k))


def of_size(g, o):
    o.x[:] = F(6)


def unset(g, o):
    o.whole[0] = len(F(6))


def unset_like(g, o):
    o.whole[0] = len(F(g.x))


def square(g, o):
    o.A[:] = F(6)


def filled(g, o):
    o.x[:] = F(6, g.k)


def like(g, o):
    o.x[:] = F(g.x)


def filled_like(g, o):
    o.x[:] = F(g.x, g.k)


def joined(g, o):
    o.s[:] = F((g.x, g.y)).reshape(12)


def of_two(g, o):
    o.s[0] = F(g.x, g.y)


def table_of_two(g, o):
    o.A[:] = F(g.x, g.y)


def crossed(g, o):
    o.x[:3] = F(g.x[:3], g.y[:3])


def product(g, o):
    o.A[:] = F(g.A, g.A)


def definite(g):
    return g.A @ g.A.T + 6.0 * np.eye(6)


def of_matrix(g, o):
    o.s[0] = F(definite(g))


def matrix(g, o):
    o.A[:] = F(definite(g))


def diagonal(g, o):
    o.x[:] = F(g.A)


def solved(g, o):
    o.x[:] = F(definite(g), g.x)


def chosen(g, o):
    o.x[:] = F(g.x > g.y, g.x, g.y)


def clipped(g, o):
    o.x[:] = F(g.x, -0.5, 0.5)


def between(g, o):
    o.x[:] = F(g.x, np.array([-1.0, 0.0, 2.0]), np.array([1.0, 3.0, -2.0]))


def reshaped(g, o):
    o.s[:] = F(g.A[:2], 12)


def retyped(g, o):
    o.x[:] = F(g.x, np.int64)


CASES = {
    reduced: [np.sum, np.prod, np.mean, np.min, np.max, np.any, np.all, np.argmin, np.argmax, np.linalg.norm]
    + [sum, min, max, any, all, len],
    whole_number: [int, bool, np.int64, np.bool_, math.floor, math.ceil, math.trunc],
    number: [float, np.float64, round, np.round],
    of_a_base: [math.log],
    of_size: [np.zeros, np.ones, np.arange],
    unset: [np.empty],
    unset_like: [np.empty_like],
    square: [np.eye, np.identity],
    filled: [np.full],
    like: [np.zeros_like, np.ones_like, np.copy, np.array, np.asarray, np.ascontiguousarray, np.ravel],
    filled_like: [np.full_like],
    joined: [np.concatenate, np.stack, np.hstack, np.vstack, np.column_stack],
    of_two: [np.inner, np.vdot],
    table_of_two: [np.outer],
    crossed: [np.cross],
    product: [np.dot, np.matmul],
    of_matrix: [np.trace, np.linalg.det],
    matrix: [np.linalg.inv, np.linalg.cholesky, np.transpose],
    diagonal: [np.diag, np.diagonal],
    solved: [np.linalg.solve],
    chosen: [np.where],
    clipped: [np.clip],
    between: [np.interp],
    reshaped: [np.reshape],
    retyped: [np.astype] if hasattr(np, "astype") else [],
}
ELEMENTWISE = [(function, count) for functions, (count, _) in _ELEMENTWISE.items() for function in functions]
_BEYOND = {math.acosh, np.arccosh}  # of 1 and more


def with_function(template, function):
    return types.FunctionType(template.__code__, globals() | {"F": function}, template.__name__)


@pytest.mark.parametrize(("function", "count"), ELEMENTWISE)
def test_a_function_of_numbers(function, count):
    arrays = isinstance(function, np.ufunc) or function is abs
    template = two if count == 2 else one_beyond if function in _BEYOND else one
    compare(with_function(template, function), [GIVEN, OUT], exact=False)
    if arrays:
        template = two_arrays if count == 2 else one_array_beyond if function in _BEYOND else one_array
        compare(with_function(template, function), [GIVEN, OUT], exact=False)


@pytest.mark.parametrize(
    ("template", "function"), [(template, each) for template, functions in CASES.items() for each in functions]
)
def test_a_function_of_arrays(template, function):
    compare(with_function(template, function), [GIVEN, OUT], exact=False)


def test_no_function_is_left_out():
    tried = {function for functions in CASES.values() for function in functions} | {each for each, _ in ELEMENTWISE}
    called = {each for each in FUNCTIONS if not inspect.ismethoddescriptor(each) and not isinstance(each, str)}
    assert called <= tried
