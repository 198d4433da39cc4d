"""Faults that the compiler had, each put back by hand, and a law that meets it, by the numbers of the findings.

A5, a text that is not the function's any more, needs a file that changes, and is a test of its own.
"""

import ast
import inspect

import numpy as np

from uvms_mj.compiler import builtin, unit
from uvms_mj.compiler.arrays import Arrays
from uvms_mj.compiler.expressions import Expressions
from uvms_mj.compiler.forms import Forms
from uvms_mj.compiler.function import Function
from uvms_mj.compiler.lifetimes import Lifetimes
from uvms_mj.compiler.scalars import Scalars
from uvms_mj.compiler.values import BOOL, FLOAT, INT, Kind, Value, bundle, contiguous, items_of, scalar


def put(owner, name, make):
    """A fault in a method, made of the right one."""
    return lambda patch: patch.setattr(owner, name, make(getattr(owner, name)))


def of(function, writer):
    """A fault in what writes a call of NumPy's function."""
    return lambda patch: patch.setitem(builtin.FUNCTIONS, function, writer)


def one_layout(old):
    def unified(self, values):
        kinds = [value.kind for value in values]
        if all(kind.is_array and kind.shape == kinds[0].shape for kind in kinds):
            return contiguous(self.base_of(values), kinds[0].sizes)
        return old(self, values)

    return unified


def truth_as_number(old):
    def unified(self, values):
        bases = {value.kind.base for value in values}
        return Kind(INT) if bases == {BOOL, INT} else old(self, values)

    return unified


def product(old):
    def reduced(self, name, left, right):
        if name == "Mult" and (self._in_order(left) or self._in_order(right)):
            return self.elementwise(lambda a, b: self.operation("Mult", a, b), left, right)
        return old(self, name, left, right)

    return reduced


def from_zero(old):
    def iteration(self, node):
        if isinstance(node, ast.Call) and self.known(node.func) is enumerate:
            node = ast.copy_location(ast.Call(node.func, node.args[:1], []), node)
        return old(self, node)

    return iteration


def value_of(at, node):
    return at.as_array(at.value(node))


def as_view():
    return lambda at, nodes, keywords: at.value(nodes[0])


def arranged_copy(old):
    return lambda self, value, arrange: self.copied(old(self, value, arrange))


def result_copied(old):
    def result(self, at, memory, arguments):
        found = old(self, at, memory, arguments)
        if found is not None and found.kind.items is not None:
            return bundle(
                [at.copied(each) if each.kind.is_array else each for each in items_of(found)], found.kind.form
            )
        return found

    return result


def copied_at_binding(old):
    def bind(self, name, value, once=False):
        if not once and value.kind.is_array and not value.fresh and self.turning is None:
            value = self.copied(value)
        old(self, name, value, once)

    return bind


def merged_copies(old):
    def merged(self, found, end):
        kind = self.unified([v for v, _ in found])
        if kind.is_array and any(value.fresh for value, _ in found):
            return self._merged_copies(found, end, kind)
        return old(self, found, end)

    return merged


def twice(old):
    def mask(self, target):
        found = old(self, target)
        self.evaluated.pop(id(target.slice), None)
        return found

    return mask


def any_constant(old):
    def frozen(self, array):
        return old(self, np.asarray(np.ma.getdata(array), {"f": float, "i": int, "b": bool}[array.dtype.kind]))

    return frozen


def any_number(old):
    return lambda self, value: old(self, value.item() if isinstance(value, np.generic) else value)


def wrapped(old):
    def arguments(self, function, node, captured=()):
        values = [self.value(each) for each in node.args]
        bound = inspect.signature(function).bind(*values)
        bound.apply_defaults()
        return [each if isinstance(each, Value) else self.frozen(each) for each in bound.arguments.values()]

    return arguments


def called_by_llvm(old):
    def c_function(self, name, values):
        if name != "fmod":
            return old(self, name, values)
        return scalar(self.at.frem(*map(self.float_of, values), flags=("nnan",)), FLOAT)

    return c_function


def shifted_by(old):
    def bits(self, name, left, right):
        if name == "LShift":
            return scalar(self.at.shl(self.converted(left, INT), self.converted(right, INT)), INT)
        return old(self, name, left, right)

    return bits


def root(old):
    def power(self, left, right, of_arrays=False):
        if right.constant == 0.5:
            return self.c_function("sqrt", [scalar(self.float_of(left), FLOAT)])
        return old(self, left, right, of_arrays)

    return power


def ignored_out(name):
    return lambda at, nodes, keywords: at.elementwise(lambda x: at.c_function(name, [x]), at.value(nodes[0]))


def both(*each):
    return lambda patch: [one(patch) for one in each]


FAULTS = {
    "A1: returns of two layouts are read as one": (
        put(Expressions, "unified", one_layout),
        "state.seen[:4] = turned(TABLE, signals.t >= 0.0).ravel()",
    ),
    "A1: returns of two orders are written as one": (
        put(Expressions, "unified", one_layout),
        ("y = ordered(state.x[:3], signals.t >= 0.0)\ny[:] = (10.0, 20.0, 30.0)\nstate.seen[:] = state.x"),
    ),
    "A1: a row or a column": (put(Expressions, "unified", one_layout), "state.seen[:2] = part(TABLE, signals.t < 0.0)"),
    "A1: integers or floats": (
        put(Expressions, "unified", one_layout),
        "state.seen[:2] = numbers(signals.t >= 0.0)[0]",
    ),
    "A1: one of two tuples": (
        put(Expressions, "unified", one_layout),
        ("R, sign = (TABLE, 1.0) if signals.t < 0.0 else (TABLE.T, -1.0)\nstate.seen[:2] = R[0] * sign"),
    ),
    "A2: a list times a number is a product": (
        put(Forms, "reduced_operation", product),
        "state.seen[:] = np.array([2.0] * 6)",
    ),
    "A2: a tuple times a number is a product": (
        put(Forms, "reduced_operation", product),
        "state.seen[0] = len((1.0, 2.0) * 3)",
    ),
    "A3: enumerate begins at 0": (
        put(Function, "iteration", from_zero),
        "for i, w in enumerate((1.0, 2.0), start=1):\n    state.seen[0] += i * w",
    ),
    "A3: np.inner is @": (
        of(np.inner, lambda at, nodes, k: at.product(*[value_of(at, n) for n in nodes])),
        "state.seen[:4] = np.inner(TABLE, TABLE).ravel()",
    ),
    "A3: the reciprocal of integers is a float": (
        of(
            np.reciprocal,
            lambda at, nodes, k: at.elementwise(lambda x: at.operation("Div", at.constant(1.0), x), at.value(nodes[0])),
        ),
        "state.seen[:2] = np.reciprocal(np.array([2, 4]))",
    ),
    "A3: matrices are stacked along a new axis": (
        of(
            np.column_stack,
            lambda at, nodes, k: at.stacked([at.as_array(each) for each in items_of(at.value(nodes[0]))], 1),
        ),
        "state.seen[0] = np.column_stack((TABLE, TABLE)).shape[1]",
    ),
    "A3: concatenate ignores axis=None": (
        of(
            np.concatenate,
            lambda at, nodes, k: at.joined([at.as_array(each) for each in items_of(at.value(nodes[0]))], 0),
        ),
        "state.seen[0] = len(np.concatenate((TABLE, TABLE), axis=None))",
    ),
    "A3: clip without bounds is a view": (
        of(np.clip, as_view()),
        "y = np.clip(state.x, None, None)\ny[0] = 9.0\nstate.seen[:] = state.x",
    ),
    "A3: ascontiguousarray is a view": (
        of(np.ascontiguousarray, as_view()),
        "c = np.ascontiguousarray(state.x[::2])\nc *= 0.0\nstate.seen[:] = state.x",
    ),
    "A3: a shift by 64": (
        both(
            put(Scalars, "_bits", shifted_by),
            put(Scalars, "of_python", lambda old: lambda self, name, a, b: self.operation(name, a, b)),
        ),
        "n = 64 + int(signals.t)\nstate.seen[0] = float((1 << n) & 255)",
    ),
    "A3: a truth value is inverted as a number": (
        put(Expressions, "unified", truth_as_number),
        "n = 2 if signals.t < 0.0 else signals.t >= 0.0\nstate.seen[0] = 1.0 if ~n else 2.0",
    ),
    "A3: a power of 0.5 is a root": (
        put(Scalars, "power", root),
        "x = -np.inf * (1.0 + signals.t)\nstate.seen[0] = 1.0 if x ** 0.5 > 0.0 else 2.0",
    ),
    "A3: out by position is ignored": (
        of(np.sqrt, ignored_out("sqrt")),
        "y = np.ones(6)\nnp.sqrt(state.x * state.x, y)\nstate.seen[:] = y",
    ),
    "A4: a view that is returned with a number is a copy": (
        put(unit._Done, "result", result_copied),
        "h, total = head(state.x)\nh[:] = 7.0\nstate.seen[:] = state.x",
    ),
    "A4: a name for a view and a new array is a copy": (
        put(Lifetimes, "bind", copied_at_binding),
        ("y = state.x[:3]\nif signals.t < 0.0:\n    y = y * 2.0\nstate.x[0] = 100.0\nstate.seen[0] = y[0]"),
    ),
    "A4: an array or a new one is a copy": (
        put(Expressions, "merged", merged_copies),
        ("ref = state.x if signals.t >= 0.0 else np.zeros(6)\nstate.x[0] = 5.0\nstate.seen[0] = ref[0]"),
    ),
    "A4: no copy before a store": (
        lambda patch: patch.setattr(Arrays, "apart", lambda self, value: self.as_array(value)),
        "state.x[1:] = old_unless(state.x[:-1], state.x[1:] + 1.0, True)\nstate.seen[:] = state.x",
    ),
    "A4: names that are swapped in a loop share memory": (
        put(Function, "kept", lambda old: lambda self, value: value),
        (
            "a, b, c = state.x * 1.0, state.x * 1.0, state.x * 1.0\n"
            "for i in range(int(5 + signals.t)):\n"
            "    b, a, c = a, a + 1.0, b\n"
            "state.seen[:] = a + 10.0 * b + 100.0 * c"
        ),
    ),
    "A4: reshape of a strided view is a copy": (
        put(Arrays, "arranged", arranged_copy),
        "col = state.x[::2].reshape(3, 1)\ncol[:] = 9.0\nstate.seen[:] = state.x",
    ),
    "A6: an index is evaluated twice": (
        put(Function, "_mask", twice),
        "state.x[:] = 0.0\nstate.seen[1 + push(state.x, 5)] = 9.0\nstate.seen[0] = state.x[0]",
    ),
    "A6: int8 is int64": (put(Forms, "_frozen_array", any_constant), "state.seen[0] = (SMALL * SMALL)[0]"),
    "A6: float32 is float64": (put(Forms, "_frozen_array", any_constant), "state.seen[0] = (SINGLE * SINGLE)[0]"),
    "A6: a masked array is a plain one": (put(Forms, "_frozen_array", any_constant), "state.seen[0] = MASKED.sum()"),
    "A6: a number of float32 is one of float64": (
        put(Scalars, "constant", any_number),
        "state.seen[0] = ONE_SINGLE * ONE_SINGLE",
    ),
    "A6: integers wrap": (
        put(Scalars, "of_python", lambda old: lambda self, name, a, b: self.operation(name, a, b)),
        (
            "s = 123456789\n"
            "for i in range(3):\n"
            "    s = (s * 6364136223846793005 + 1442695040888963407) % 2305843009213693951\n"
            "state.seen[0] = s / 2305843009213693951"
        ),
    ),
    "A6: the signature that functools.wraps shows is bound": (
        put(Expressions, "_arguments", wrapped),
        "state.seen[0] = scaled(1.0 + signals.t)",
    ),
    "A7: LLVM's fmod loses NaN": (
        put(Scalars, "c_function", called_by_llvm),
        (
            "y = (np.inf * (1.0 + float(signals.t)) * 0.0) % 1.3\n"
            "state.seen[0] = 1.0 if y < 1.3 else 2.0\n"
            "state.seen[1] = float(np.isnan(y))"
        ),
    ),
}
"""A fault, as a function of a monkeypatch, and lines of a law."""

MET = """
TABLE = np.array([[1.0, 2.0], [3.0, 4.0]])
WHOLE = np.array([[1, 2], [3, 4]])
SMALL = np.array([100], np.int8)
SINGLE = np.array([0.1], np.float32)
ONE_SINGLE = np.float32(0.1)
MASKED = np.ma.array([1.0, 2.0], mask=[True, False])

def turned(A, back):
    if back:
        return A.T
    return A
def ordered(x, backwards):
    if backwards:
        return x[::-1]
    return x
def part(A, row):
    if row:
        return A[0]
    return A[:, 0]
def numbers(whole):
    if whole:
        return WHOLE
    return TABLE
def head(x):
    return x[:3], x.sum()
def old_unless(old, new, use):
    if use:
        return old
    return old
def push(ring, size):
    ring[0] = (ring[0] + 1.0) % size
    return int(ring[0])
def with_gain(f):
    @functools.wraps(f)
    def g(x, k=7.0):
        return f(x, k)
    return g
@with_gain
def scaled(x, k=2.0):
    return k * x
"""
"""What the laws call."""
