"""A twin in plain Python gives the bits of machine code, so that a difference of both is a fault."""

import math
import types

import numpy as np
import pytest

from compiled import Compiled, arguments, as_python, defined
from uvms_mj.engine.native.twin import twin
from uvms_mj.files import SourceChanged, function_tree

GIVEN = np.dtype(
    [("k", "f8"), ("x", "f8", (6,)), ("y", "f8", (6,)), ("A", "f8", (6, 6)), ("B", "f8", (9, 9))], align=True
)
OUT = np.dtype([("x", "f8", (6,)), ("A", "f8", (6, 6)), ("B", "f8", (9, 9)), ("s", "f8", (6,))], align=True)
HELPERS = """
from math import exp
from numpy import linalg as la

def turned(A, x, n=2):
    return A.T @ x**n

def cost(A, x):
    return x @ A @ x - (A @ x).dot(x)

class Helpers:
    @staticmethod
    def energy(A, x):
        return 0.5 * (x @ (A @ x))

"""
BODIES = [
    "o.x[:] = g.A @ g.x\no.B[:] = g.B @ g.B.T @ g.B",
    "o.x[:] = np.sin(g.x) * np.exp(g.y) + np.tanh(g.x) ** 3 + np.arctan2(g.x, g.y)",
    "o.x[:] = np.linalg.solve(g.A, g.x)\no.A[:] = np.linalg.inv(g.A)\no.s[0] = np.linalg.det(g.A)",
    "o.s[0] = cost(g.A, g.x)\no.s[1] = cost(g.A, g.y) > 0.0\no.x[:] = turned(g.A, g.x)",
    "o.s[0] = Helpers.energy(g.A, g.x)\no.s[1] = np.linalg.norm(g.x)\no.s[2] = la.norm(g.A[1])",
    "o.x[:] = g.x\no.x **= 3\no.A[:] = g.A\no.A @= g.A",
    "o.s[0] = g.A.sum()\no.s[1] = g.A.T.sum()\no.s[2] = g.B.mean()\no.x[:] = g.A.T.sum(axis=0)",
    "o.x[:] = np.cos(g.x, out=o.x) + np.dot(g.A, g.y)\no.s[0] = np.dot(g.x, g.y) + math.hypot(g.k, g.x[0])",
    "o.s[0] = exp(g.k) + g.k ** g.x[0] + pow(abs(g.k), 0.3) + np.hypot(g.k, g.x[1])",
]


@pytest.mark.parametrize("body", BODIES)
def test_a_twin_has_the_bits_of_machine_code_where_numpy_has_its_own(body):
    source = HELPERS + "def program(g, o):\n" + "".join(f"    {line}\n" for line in body.splitlines())
    program = defined(source, {"np": np, "math": math})
    code, random, differed = Compiled(program, [GIVEN, OUT]), np.random.default_rng(5), False
    for _ in range(200):
        mine = arguments([GIVEN, OUT], random)
        pythons, twins = [each.copy() for each in mine], [each.copy() for each in mine]
        assert code(*mine) == 0
        with np.errstate(all="ignore"):
            program(*map(as_python, pythons))
            twin(program)(*map(as_python, twins))
        for a, b in zip(mine, twins, strict=True):
            assert a.tobytes() == b.tobytes()
        differed |= any(a.tobytes() != b.tobytes() for a, b in zip(mine, pythons, strict=True))
    assert differed or "sum" in body or "exp(" in body  # otherwise this body needs no twin


def test_a_twin_raises_where_python_raises_in_the_same_line():
    program = defined("def program(A, b):\n    x = 1.0\n    return np.linalg.solve(A, b)\n", {"np": np})
    with pytest.raises(np.linalg.LinAlgError, match="Singular") as caught:
        twin(program)(np.zeros((2, 2)), np.zeros(2))
    lines = [each.lineno for each in caught.traceback[:] if str(each.path) == program.__code__.co_filename]
    assert [line + 1 for line in lines] == [3]


def test_a_twin_follows_closures_defaults_and_globals_that_change():
    names = {"np": np, "GAIN": 2.0}
    make = defined(
        "def make(b):\n    def inner(x, a=3.0):\n        return GAIN * (x @ x) + a * b\n    return inner\n", names
    )
    inner, x = make(10.0), np.arange(3.0)
    assert twin(inner)(x) == 2.0 * 5.0 + 30.0
    inner.__globals__["GAIN"] = 4.0
    assert twin(inner)(x, 1.0) == 4.0 * 5.0 + 10.0


def test_a_text_that_changed_since_it_was_loaded_is_not_the_functions(tmp_path):
    file = tmp_path / "helper.py"
    file.write_text("def gain(x):\n    return 2.0 * x\n")
    module = types.ModuleType("helper")
    exec(compile(file.read_text(), str(file), "exec"), vars(module))
    assert function_tree(module.gain)[1][1].strip() == "return 2.0 * x"
    for text in (
        "def gain(x):\n    return 3.0 * x\n",
        "def other(x):\n    return x\n\n\ndef gain(x):\n    return 2.0 * x\n",
    ):
        file.write_text(text)
        with pytest.raises(SourceChanged, match="changed since it was loaded"):
            function_tree(module.gain)
