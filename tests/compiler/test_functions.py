"""Each function of the language, once: machine code gives what NumPy, ``math`` and Python give."""

import inspect
import math

import numpy as np
import pytest

from compiled import compare, function_of
from uvms_mj.compiler.builtin import _ELEMENTWISE, FUNCTIONS

GIVEN = np.dtype([("k", "f8"), ("x", "f8", (6,)), ("y", "f8", (6,)), ("A", "f8", (6, 6))], align=True)
SHAPES = {"s": (), "v": (3,), "x": (6,), "twelve": (12,), "A": (6, 6)}
"""Shapes of results. Those of ``n`` are integers."""


def inside(x):
    """0.06 to 0.94 for any number: a value in the domain of most functions."""
    return 0.5 + 0.44 * x / (1.0 + abs(x))


def definite(A):
    return A @ A.T + 6.0 * np.eye(6)


CASES = {
    ("s", "F(g.x)"): [np.sum, np.prod, np.mean, np.min, np.max, np.any, np.all, np.argmin, np.argmax, np.linalg.norm]
    + [sum, min, max, any, all, len],
    ("n", "F(7.0 * g.k)"): [int, bool, np.int64, np.bool_, math.floor, math.ceil, math.trunc],
    ("s", "F(7.0 * g.k)"): [float, np.float64, round, np.round],
    ("s", "F(700.0 * g.k, -2) + F(g.k, 1)"): [np.round],
    ("s", "F(inside(g.k), 3.0) + F(inside(g.k))"): [math.log],
    ("x", "F(6)"): [np.zeros, np.ones, np.arange],
    ("n", "len(F(6))"): [np.empty],
    ("n", "len(F(g.x))"): [np.empty_like],
    ("A", "F(6)"): [np.eye, np.identity],
    ("x", "F(6, g.k)"): [np.full],
    ("x", "F(g.x)"): [np.zeros_like, np.ones_like, np.copy, np.array, np.asarray, np.ascontiguousarray, np.ravel],
    ("x", "F(g.x, g.k)"): [np.full_like],
    ("twelve", "F((g.x, g.y)).reshape(12)"): [np.concatenate, np.stack, np.hstack, np.vstack, np.column_stack],
    ("A", "F((g.A[:, :2], g.A[:, 2:]), axis=1)"): [np.concatenate],
    ("A", "F((g.x, g.y, g.x, g.x, g.y, g.y), 1)"): [np.stack],
    ("s", "F(g.x, g.y)"): [np.inner, np.vdot],
    ("A", "F(g.x, g.y)"): [np.outer],
    ("v", "F(g.x[:3], g.y[:3])"): [np.cross],
    ("A", "F(g.A, g.A)"): [np.dot, np.matmul],
    ("s", "F(definite(g.A))"): [np.trace, np.linalg.det],
    ("s", "F(g.A[:3, :3]) + F(g.A[:2, :2])"): [np.linalg.det],
    ("A", "F(definite(g.A)[::-1])"): [np.linalg.inv],
    ("A", "F(definite(g.A))"): [np.linalg.inv, np.linalg.cholesky, np.transpose],
    ("x", "F(g.A)"): [np.diag, np.diagonal],
    ("x", "F(definite(g.A), g.x) + F(definite(g.A)[::-1], g.x)"): [np.linalg.solve],
    ("x", "F(g.x > g.y, g.x, g.y)"): [np.where],
    ("x", "F(g.x, -0.5, 0.5)"): [np.clip],
    ("x", "F(g.x, np.array([-1.0, 0.0, 2.0]), np.array([1.0, 3.0, -2.0]))"): [np.interp],
    ("twelve", "F(g.A[:2], 12) + F(g.A[:2].T, 12)"): [np.reshape],
    ("twelve", "F(g.A[:, :2])"): [np.ravel],
    ("x", "F(g.x, np.int64)"): [np.astype] if hasattr(np, "astype") else [],
}
"""A result's shape and an expression with a function F: the functions."""
ELEMENTWISE = [(function, count) for functions, (count, _) in _ELEMENTWISE.items() for function in functions]
_BEYOND = {math.acosh, np.arccosh}  # of 1 and more


def of_numbers(function, count):
    """The expressions of a function of numbers: of one number, and of an array if it takes one."""
    plus = "1.0 + " if function in _BEYOND else ""
    of = ", ".join(f"{plus}inside(g.{name}{{i}})" for name in "xy"[:count])
    arrays = isinstance(function, np.ufunc) or function is abs
    return [("s", f"F({of.format(i='[2]')})"), *([("x", f"F({of.format(i='')})")] if arrays else [])]


EXPRESSIONS = [(*case, function) for case, functions in CASES.items() for function in functions]
EXPRESSIONS += [(*case, function) for function, count in ELEMENTWISE for case in of_numbers(function, count)]
_AT_ONCE = 24


@pytest.mark.parametrize("first", range(0, len(EXPRESSIONS), _AT_ONCE))
def test_a_function_of_the_language(first):
    """Several functions in one, each with a result of its own."""
    lines, fields, names = [], [], dict(globals())
    for k, (shape, expression, function) in enumerate(EXPRESSIONS[first : first + _AT_ONCE]):
        names[f"F{k}"], result = function, f"{function.__name__}_{k}"
        fields.append((result, "i8" if shape == "n" else "f8", SHAPES.get(shape, ())))
        lines.append(f"o.{result}{'[:]' if SHAPES.get(shape) else ''} = {expression.replace('F(', f'F{k}(')}")
    compare(function_of("g, o", "\n".join(lines), names), [GIVEN, np.dtype(fields, align=True)], exact=False)


def test_no_function_is_left_out():
    tried = {function for *_, function in EXPRESSIONS}
    called = {each for each in FUNCTIONS if not inspect.ismethoddescriptor(each) and not isinstance(each, str)}
    library = {each for each in called if getattr(each, "__module__", "") == "uvms_mj.compiler.libm"}  # not users'
    assert called - library <= tried
