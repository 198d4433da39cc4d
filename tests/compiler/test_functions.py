"""Each function of the language, once: machine code gives what NumPy, ``math`` and Python give."""

import inspect
import math
import re

import numpy as np
import pytest

from compiled import Compiled, arguments, as_python, compare, function_of
from uvms_mj.compiler.builtin import _ELEMENTWISE, FUNCTIONS

GIVEN = np.dtype(
    [
        *(("k", "f8"), ("i", "i8"), ("x", "f8", (6,)), ("y", "f8", (6,)), ("z", "f8", (20,)), ("A", "f8", (6, 6))),
        *(("B", "f8", (3, 4)), ("U", "f8", (2, 3, 4)), ("n", "i8", (5,)), ("N", "i8", (3, 3)), ("b", "?", (5,))),
    ],
    align=True,
)
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
_OF_BITS = {np.bitwise_and, np.bitwise_or, np.bitwise_xor, np.invert}
_BEYOND = {math.acosh, np.arccosh}  # of 1 and more


def of_numbers(function, count):
    """The expressions of a function of numbers: of one number, and of an array if it takes one."""
    if function in _OF_BITS:  # they are below
        return []
    plus = "1.0 + " if function in _BEYOND else ""
    of = ", ".join(f"{plus}inside(g.{name}{{i}})" for name in "xy"[:count])
    arrays = isinstance(function, np.ufunc) or function is abs
    return [("s", f"F({of.format(i='[2]')})"), *([("x", f"F({of.format(i='')})")] if arrays else [])]


EXPRESSIONS = [(*case, function) for case, functions in CASES.items() for function in functions]
EXPRESSIONS += [(*case, function) for function, count in ELEMENTWISE for case in of_numbers(function, count)]
_AT_ONCE = 24

EXACT = """
np.roll(g.x, 1)
np.roll(g.x, -2)
np.roll(g.A, 1, axis=0)
np.roll(g.A, (1, 2), axis=(0, 1))
np.roll(g.A.T, 1)
np.tile(g.x, 2)
np.tile(g.x, (2, 1))
np.tile(g.k, 3)
np.tile(g.A, (2, 2))
np.tile(g.n, 3)
np.repeat(g.x[:3], 2)
np.repeat(g.x[None, :], 3, axis=0)
np.repeat(0.5, 6)
g.x.repeat(3)
g.b.repeat(3)
np.flip(g.x)
np.fliplr(g.A)
np.flipud(g.A)[0]
np.rot90(g.B)
np.rot90(g.B, k=3)
np.triu(g.A)
np.tril(g.A, -1)
np.triu(g.B, 1)
np.tril(g.N)
np.diag(g.x)
np.diag(g.x[:5], 1)
np.diag(g.x, k=-2)
np.diag(g.A)
np.diag(g.A, 1)
np.diagonal(g.A, offset=-1)
g.A.diagonal()
np.diagflat(g.x)
np.split(g.x, 2)
np.split(g.x, [1, 3])
np.array_split(g.x, 4)
np.hsplit(g.A, 2)
np.vsplit(g.A, 3)
np.append(g.x, g.k)
np.append(g.x, g.y)
np.append(g.A, g.A, axis=0)
np.append(g.A, g.A)
np.append(g.n, 1.5)
np.insert(g.x, 0, g.k)
np.insert(g.x, 2, g.y[:2])
np.insert(g.x, [1, 3], (g.k, 2.0))
np.insert(g.A, 1, g.x, axis=0)
np.delete(g.x, 2)
np.delete(g.x, [0, -1])
np.delete(g.A, 1, axis=1)
np.pad(g.x, 1)
np.pad(g.x, (1, 2), mode="edge")
np.pad(g.A, ((1, 0), (0, 2)))
np.resize(g.x, 10)
np.take(g.x, [0, 2, 5])
np.take(g.A, [0, 1], axis=1)
g.x.take((1, 1))
np.expand_dims(g.x, 0)
np.expand_dims(g.x, axis=1)
np.squeeze(g.x[None, :])
g.x[:, None].squeeze()
np.squeeze(g.x[:, None], axis=1)
np.squeeze(g.x[:1] * 2)
np.swapaxes(g.U, 0, 2)
g.U.swapaxes(1, 2)
np.moveaxis(g.U, -1, 0)
np.transpose(g.U, (2, 0, 1))
g.U.transpose(2, 0, 1)
g.U.transpose((1, 0, 2))
g.A.transpose()
np.reshape(g.A, (4, 9))
np.reshape(g.A, -1)
np.reshape(g.A, (4, 9), order="F")
np.reshape(g.A, shape=(9, 4))
g.A.reshape(4, 9, order="F")
g.A.reshape(-1)
g.A.reshape((3, 12))
g.A.T.reshape(36)
g.A.ravel("F")
g.A.flatten("F")
np.ravel(g.A, order="F")
g.A.flatten()
np.atleast_1d(g.k)
np.atleast_2d(g.x)
np.atleast_2d(g.k)
np.atleast_1d(g.x, g.k)
np.concatenate([g.x, g.y])
np.concatenate([[g.k], g.x])
np.concatenate((g.A, g.A), axis=-1)
np.stack([g.x, g.y], axis=-1)
np.hstack([g.x, g.k])
np.hstack([g.A, g.A])
np.hstack((g.k, 1, 2.0))
np.vstack([g.A, g.x])
np.vstack([g.x, g.y])
np.dstack([g.A, g.A])
np.dstack([g.x, g.y])
np.column_stack([g.A, g.x])
np.column_stack([g.x, g.y])
np.block([[np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), 2.0 * np.eye(3)]])
np.block([g.x[:3], g.y[3:]])
np.block([[g.A, g.x[:, None]], [g.y, 1.0]])
np.block([[g.k, 1.0], [2.0, g.k]])
np.meshgrid(g.x[:2], g.y[:3])
np.meshgrid(g.x[:2], g.n, indexing="ij")
np.kron(np.eye(2), g.A[:3, :3])
np.kron(g.x[:2], g.y[:3])
np.kron(g.n, g.n)
np.kron(g.A, g.x)
g.x.tolist()
g.n.tolist()
g.B.tolist()
g.B.tolist()[1][2]
g.x[:1].item()
g.x.item(3)
g.B.item(1, 2)
g.k.item()
np.zeros((0, 3)).T
np.roll(np.zeros(0), 1)
np.concatenate((g.x, np.zeros(0)))
np.tile(g.x, 0)
np.sum(g.A, axis=0, keepdims=True)
g.A / (1.0 + np.abs(g.A).sum(axis=1, keepdims=True))
np.sum(g.x, keepdims=True)
np.sum(g.x, 0, None, None, True)
np.sum(g.x, axis=0, keepdims=True)
np.sum(g.A, axis=(0, 1))
np.sum(g.z)
np.sum(g.z[:9])
np.sum(g.A[:, :1], axis=0)
np.sum(g.b)
np.sum(g.n)
np.sum(g.k)
np.sum(g.i)
np.mean(g.n)
np.mean(g.i)
np.mean(g.B, axis=1)
np.any(g.k)
np.all(g.x > 0.0)
np.any(g.B > 0.0, axis=0)
np.all(g.B > 0.0, axis=1, keepdims=True)
np.argmax(g.B, axis=1)
np.argmin(g.B, axis=0)
np.argmax(g.k)
np.max(g.b)
np.min(g.b, axis=0)
np.max(g.B, axis=-1)
np.prod(g.n)
np.prod(g.B, axis=0)
np.prod(g.z)
np.ptp(g.x)
np.ptp(g.B, axis=0)
np.ptp(g.n)
np.count_nonzero(g.x > 0.0)
np.count_nonzero(g.B > 0.0, axis=1)
np.count_nonzero(g.n)
np.std(g.x)
np.var(g.x) + g.x.var()
g.x.std()
np.std(g.x, ddof=1)
np.std(g.z)
np.std(g.B, axis=0)
np.std(g.B, axis=1)
np.std(g.B)
np.var(g.n)
np.var(g.b)
np.var(g.U, axis=1)
np.var(g.B, axis=1, ddof=1, keepdims=True)
np.std(g.A, 0)
np.average(g.x)
np.average(g.B, axis=0)
np.average(g.x, weights=np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
np.average(g.z, weights=np.arange(20))
sum(g.x, 5.0)
sum(g.x, start=g.k)
sum((g.x, g.y))
sum(g.n)
np.cumsum(g.x)
g.x.cumsum()
np.cumsum(g.z)
np.cumsum(g.B, axis=0)
np.cumsum(g.B, axis=1)
np.cumsum(g.B)
np.cumsum(g.n)
np.cumsum(g.b)
np.cumsum(g.k)
np.cumprod(g.x)
np.cumprod(g.n)
np.cumprod(g.A, axis=1)
np.cumsum(g.A, axis=0)
np.cumsum(g.A.T)
np.diff(g.x)
np.diff(g.x, n=2)
np.diff(g.x, prepend=0.0)
np.diff(g.x, prepend=g.k, append=g.y)
np.diff(g.B, axis=0)
np.diff(g.B)
np.diff(g.n)
np.diff(g.z)
np.sort(g.n)
np.sort(g.b)
np.argsort(g.x, kind="stable")
g.z.argsort(kind="stable")
np.argsort(g.n, stable=True)
np.searchsorted(np.array([-1.0, 0.0, 0.0, 1.0]), g.k)
np.searchsorted(np.array([-1.0, 0.0, 0.0, 1.0]), g.x)
np.searchsorted(np.array([-1.0, 0.0, 0.0, 1.0]), g.x, side="right")
np.searchsorted(np.array([-2, 0, 1, 1]), g.n, "right")
np.array([-1.0, 0.0, 0.0, 1.0]).searchsorted(g.x)
np.digitize(g.k, [-1.0, 0.0, 1.0])
np.digitize(g.x, [-1.0, 0.0, 1.0], right=True)
np.median(g.x)
np.median(g.x[:5])
np.median(g.B, axis=0)
np.median(g.B)
np.median(g.n)
np.quantile(g.x, 0.25)
np.quantile(g.z, 0.7)
np.quantile(g.x, 0.0)
np.quantile(g.x, 1.0)
np.percentile(g.x, 12.5)
np.percentile(g.z, 95)
np.percentile(g.B, 30, axis=0)
sorted(g.n)
np.sum(np.zeros(0))
np.mean(g.A, axis=(0, 1), keepdims=True)
np.sort(g.x + 0.0) + 0.0
np.percentile(g.x, 37) + 0.0
np.linspace(0.0, 1.0, 6)
np.linspace(0.0, 1.0, 6, endpoint=False)
np.linspace(-1, 1, num=6)
np.linspace(g.x[0], g.x[1], 6)
np.linspace(g.k, g.k, 5)
np.linspace(g.i, 3, 30)
np.linspace(g.k, 1.0, 1)
np.linspace(g.k, 1.0, 0)
np.linspace(g.k, 7.0, 4, endpoint=False)
np.linspace(0, 5e-324, 4) + g.k
np.logspace(-1, 1, 3)
np.arange(0.0, 0.6, 0.1)
np.arange(6)
np.arange(2, 20, 3)
np.arange(30)
np.arange(3, -3, -1)
np.arange(4.0)
np.arange(4, dtype=float)
np.arange(5, 2)
np.eye(6, k=1)
np.eye(3, 4)
np.eye(3, 4, -1)
np.eye(3, k=7)
np.eye(4, dtype=int)
np.identity(3)
np.tri(3, 4, 1)
np.vander([2.0, 3.0], 3)
np.full((6, 6), g.x)
np.full(3, g.i)
np.full((2, 3), (1, 2, 3))
np.full(3, 1.5, dtype=int)
np.full((2, 2), g.k)
np.array([1.0, 2.0, g.k], ndmin=2)
np.array(g.k, ndmin=1)
np.full_like(g.n, 1.7)
np.clip(g.x, None, 0.5)
g.x.clip(min=0.0)
g.x.clip(max=0.0)
g.x.clip(-0.5, 0.5)
np.clip(g.x, min=-0.5, max=0.5)
np.clip(g.n, -1, 2)
np.clip(g.n, -1.5, 2)
np.isclose(g.x, 0.3, atol=0.2)
np.isclose(g.x, g.y, equal_nan=True)
np.isclose(g.k, g.k + 1e-9)
np.isclose(g.n, 2)
np.allclose(g.x, g.y)
np.allclose(g.x, g.x + 1e-7, rtol=1e-5, atol=1e-6)
np.allclose(g.k, 0.0)
np.array_equal(g.x, g.x)
np.array_equal(g.x, g.y)
np.array_equal(g.x, g.x, equal_nan=True)
np.array_equal(g.x, g.n)
np.nan_to_num(g.x / 0.0)
np.nan_to_num(g.x, nan=1.0, posinf=2.0, neginf=-2.0)
np.nan_to_num(g.k)
np.nan_to_num(g.n)
np.fix(g.x)
np.select([g.x > 1.0, g.x < -1.0], [1.0, -1.0], default=0.0)
np.select([g.x > 1.0, g.x < -1.0], [g.x, 2.0 * g.y])
np.select([g.x > 1.0, g.x < -1.0], [1, 2])
np.trapezoid(g.x, dx=0.1)
np.trapezoid(g.z)
np.trapezoid(g.x, g.y)
np.gradient(g.x)
np.gradient(g.z, 0.1)
np.polyval([1.0, -2.0, 0.5], g.k)
np.polyval([1.0, -2.0, 0.5], g.x)
np.polyval(g.x, g.y)
np.polyval([1, 2, 3], g.n)
np.polyval([1, 2, 3], g.i)
np.polyval([1.5, 2], g.n)
np.unwrap(g.x * 5)
np.unwrap(g.z * 10)
np.interp(g.x, [-1.0, 0.0, 1.0], [0.0, 1.0, 4.0], left=0.0, right=9.0)
np.interp(g.k, [-1.0, 0.0, 1.0], [0.0, 1.0, 4.0])
np.interp(g.x, g.y, g.x)
np.interp(g.x, g.z, np.arange(20.0))
np.interp(g.B, np.linspace(-2.0, 2.0, 20), g.z)
np.interp(g.x, (3.0, 1.0, 2.0), (1.0, 2.0, 3.0))
np.interp(g.i, [0, 1, 2, 3, 4, 5], [3, 4, 9, 1, 2, 3])
np.interp(g.x, np.arange(6), g.y)
np.where(g.b, g.b, g.b)
np.where(g.x > 0, 1, 0)
math.isclose(g.k, g.k + 1e-12)
math.isclose(g.k, 0.3, abs_tol=0.5)
math.isclose(g.k, 0.3, rel_tol=0.5)
math.isclose(g.x[2], g.y[3])
math.prod([g.k, 2.0, g.x[1]])
math.prod(g.n)
math.prod(g.x, start=2)
math.modf(g.k * 3)
math.modf(-g.y[3])
math.gcd(12, g.i + 1)
math.gcd(-12, 18)
math.comb(5, 2)
math.perm(5, 2)
math.factorial(4)
math.lcm(4, 6)
divmod(g.i, 4)
divmod(g.k, 0.3)
np.divmod(g.x, 0.3)
np.divmod(g.n, 3)
np.around(g.x, decimals=1)
np.round(g.n)
np.logical_xor(g.x > 0, g.y > 0)
np.bitwise_and(g.x > 0, g.y > 0)
np.bitwise_or(g.n, 3)
np.bitwise_xor(g.n, g.i)
np.invert(g.b)
np.invert(g.n)
np.positive(g.x)
np.heaviside(g.x, 0.5)
np.equal(g.x, g.y)
np.less_equal(g.n, 2)
np.greater_equal(g.n, g.k)
np.not_equal(g.n, 0)
np.divide(g.x, g.y, out=np.zeros(6), where=g.y != 0)
np.sqrt(g.x, where=g.x > 0, out=np.ones(6))
np.maximum.reduce(g.x)
np.add.reduce(g.B)
np.add.reduce(g.B, axis=1)
np.multiply.reduce(g.x)
np.add.accumulate(g.x)
np.add.outer(g.x, g.y)
np.multiply.outer(g.n, g.n)
np.subtract.outer(g.x, g.B)
np.logical_or.reduce(g.b)
np.rint(g.n)
np.floor(g.n)
np.sqrt(g.n)
np.square(g.n)
np.minimum(g.b, g.b)
np.power(g.n, 2)
np.floor_divide(g.n, 2)
np.mod(g.n, 3)
np.deg2rad(g.n)
np.logical_not(g.n)
np.clip(g.b, 0, 1)
np.isnan(g.n)
np.maximum(g.x, 0.0)
np.minimum(0.0, g.x)
float(np.squeeze(g.x[None, :] * g.k)[0])
np.empty((2, 0)).shape
np.add.outer(g.x, g.y)
np.trace(g.A, 1)
g.A.trace()
np.trace(g.N)
np.trace(g.B, offset=-1)
np.outer(2.0, g.x)
np.outer(g.A[:2], g.y)
np.outer(g.n, g.n)
np.cross(g.A[:, :3], g.x[:3])
np.cross(g.x[:3], g.B.T)
np.cross(g.N, g.N)
np.linalg.norm(g.A, axis=1)
np.linalg.norm(g.A, axis=0)
np.linalg.norm(g.A, axis=1, keepdims=True)
np.linalg.norm(g.z.reshape(2, 10), axis=1)
np.linalg.norm(g.x, np.inf)
np.linalg.norm(g.x, -np.inf)
np.linalg.norm(g.x, 1)
np.linalg.norm(g.z, 1)
np.linalg.norm(g.A, 1)
np.linalg.norm(g.A, np.inf)
np.linalg.norm(g.x, axis=0)
"""
"""Expressions of which machine code gives each bit, also of NaN, infinity and signed zeros."""
ROUNDED = """
np.linalg.det(g.A)
sorted(g.x)
sorted((g.k, 1.0, float(g.i)), reverse=True)
np.argsort(g.x)
np.sinc(g.x)
np.sinc(g.k)
np.convolve(g.x, [0.25, 0.5, 0.25], mode="same")
np.convolve(g.x, g.y)
np.convolve(g.x[:2], g.y, "valid")
np.convolve(g.z, g.x, "same")
np.float_power(np.abs(g.x), 1.5)
np.float_power(g.n, 2)
np.shape(g.A)[0] + np.ndim(g.A) + np.size(g.x)
np.logaddexp(g.x, g.y)
np.logaddexp(g.k, g.k)
np.hypot(g.n, g.x[:5])
np.exp(g.i)
np.inner(g.A, g.A)
np.inner(g.x, g.y)
np.inner(g.k, g.x)
np.vdot(g.A, g.A)
np.vdot(g.n, g.n)
np.linalg.norm(g.A, "fro")
np.linalg.norm(g.A)
np.linalg.norm(g.x, ord=2)
np.linalg.norm(g.x, ord=2, keepdims=True)
np.linalg.norm(g.n)
np.linalg.norm(g.n, 1)
np.linalg.matrix_power(g.A, 3)
np.linalg.matrix_power(g.A, 0)
np.linalg.matrix_power(g.A, 6)
np.linalg.matrix_power(g.A, -2)
np.linalg.matrix_power(g.N, 5)
np.linalg.multi_dot([g.A, g.A, g.x])
np.tensordot(g.A, g.x, axes=1)
np.einsum("ij,j->i", g.A, g.x)
np.einsum("i,ij,j", g.x, g.A, g.x)
np.einsum("ii", g.A)
np.einsum("ij,kj->ik", g.B, g.B)
np.einsum("i,i->i", g.n, g.n)
np.einsum("ijk->i", g.U)
np.linalg.slogdet(g.A)
np.linalg.pinv(g.B)
np.linalg.pinv(g.B.T)
np.linalg.pinv(g.A)
np.linalg.pinv(g.A, rcond=1e-6)
np.linalg.pinv(g.A[:, :4])
np.linalg.pinv(g.B) @ g.x[:3]
np.linalg.lstsq(g.A[:, :4], g.x, rcond=None)
np.linalg.lstsq(g.A[:, :4], g.x, rcond=None)[0]
np.linalg.lstsq(g.B, g.x[:3], rcond=None)
np.linalg.lstsq(g.A[:, :2], g.A[:, 2:], rcond=None)
np.linalg.svd(g.B, compute_uv=False)
np.linalg.svd(g.A, compute_uv=False)
np.linalg.cond(g.A)
np.linalg.eigvalsh(g.A + g.A.T)
np.linalg.eigvalsh(g.N + g.N.T)
np.linalg.solve(g.A, g.x)
np.linalg.inv(g.A)
"""
"""Expressions of functions of :mod:`.library`, which agree with NumPy to rounding."""
NAMES = {"np": np, "math": math, "definite": definite}


def lines_of(table):
    lines = [line for line in table.splitlines() if line]
    return [lines[k : k + _AT_ONCE] for k in range(0, len(lines), _AT_ONCE)]


def results(value):
    """The numbers of a result that may be a tuple, and how each is reached."""
    if not isinstance(value, tuple | list):
        return [("", np.asarray(value))]
    return [(f"[{k}]{path}", each) for k, item in enumerate(value) for path, each in results(item)]


def together(lines):
    """One function of several expressions, and the record of their results."""
    like, fields, body = as_python(arguments([GIVEN], np.random.default_rng(1))[0]), [], []
    for k, line in enumerate(lines):
        body.append(f"v{k} = {line}")
        with np.errstate(all="ignore"):
            found = results(eval(line, NAMES | {"g": like}))
        for j, (path, result) in enumerate(found):
            kind = {"f": "f8", "i": "i8", "b": "?"}[result.dtype.kind]
            fields.append((f"r{k}_{j}", kind, result.shape))
            body.append(f"o.r{k}_{j}{'[...]' if result.ndim else ''} = v{k}{path}")
    return function_of("g, o", "\n".join(body), NAMES), np.dtype(fields, align=True)


def inputs(special):
    """Random arguments, and some with numbers that are special."""
    for seed in range(8):
        given = arguments([GIVEN], np.random.default_rng(seed))[0]
        floats = [given[name] for name in GIVEN.names if GIVEN[name].base.kind == "f"]
        for array in floats if seed and special else ():
            array[...] = {1: 0.0, 2: -0.0, 3: 1.0}.get(seed, array) if seed < 4 else np.round(array)
            if seed > 4:
                array.flat[3 % array.size] = [np.nan, np.inf, -np.inf][seed - 5]
        yield given


@pytest.mark.parametrize("lines", lines_of(EXACT), ids=lambda lines: lines[0])
def test_equal_bit_for_bit(lines):
    function, kind = together(lines)
    code = Compiled(function, [GIVEN, kind])
    for given in inputs(special=True):
        mine, theirs = np.zeros(1, kind), np.zeros(1, kind)
        assert code(given, mine) == 0
        with np.errstate(all="ignore"):
            function(as_python(given), as_python(theirs))
        for name in kind.names:
            np.testing.assert_array_equal(mine[name], theirs[name], lines[int(name[1:].partition("_")[0])])
            number = ~np.isnan(theirs[name].astype(float))
            assert (np.signbit(mine[name].astype(float)) == np.signbit(theirs[name].astype(float)))[number].all(), name


@pytest.mark.parametrize("lines", lines_of(ROUNDED), ids=lambda lines: lines[0])
def test_equal_to_rounding(lines):
    function, kind = together(lines)
    code = Compiled(function, [GIVEN, kind])
    for given in inputs(special=False):
        mine, theirs = np.zeros(1, kind), np.zeros(1, kind)
        assert code(given, mine) == 0
        function(as_python(given), as_python(theirs))
        for name in kind.names:
            largest = np.abs(theirs[name]).max(initial=1.0)
            line = lines[int(name[1:].partition("_")[0])]
            np.testing.assert_allclose(mine[name], theirs[name], rtol=1e-12, atol=1e-12 * largest, err_msg=line)


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
    names = set(re.findall(r"(?:np|math)(?:\.\w+)+", EXACT + ROUNDED))
    tried = {sorted, divmod, pow, *(function for *_, function in EXPRESSIONS), *(eval(name, NAMES) for name in names)}
    called = {each for each in FUNCTIONS if not inspect.ismethoddescriptor(each) and not isinstance(each, str)}
    ours = ("uvms_mj.compiler.libm", "uvms_mj.compiler.library")  # not users'
    library = {each for each in called if getattr(each, "__module__", "") in ours}
    assert called - library <= tried
