"""Machine code of kernels against the same functions as plain Python."""

import math

import numpy as np
import pytest

from compiled import Compiled
from traces import assert_rounded_alike
from uvms_mj.compiler.libm import exp, sin
from uvms_mj.compiler.refusals import Mistake
from uvms_mj.control import BUILT_IN
from uvms_mj.engine.native.compilation import native_function
from uvms_mj.scenario import Scenario
from uvms_mj.setup.base import set_up
from uvms_mj.stages.signals import record_dtype

PART = np.dtype([("flag", "?"), ("n", "i8"), ("x", "f8"), ("v", "f8", (4,))], align=True)
DATA = np.dtype([("i", "i8", (4,)), ("a", "f8", (5,)), ("A", "f8", (2, 3)), ("parts", PART, (2,))], align=True)
OUT = np.dtype([("i", "i8", (12,)), ("x", "f8", (16,)), ("flag", "?")], align=True)
ODD = [0.0, -0.0, 1.5, -2.25, math.inf, -math.inf, math.nan]


def integers(data, out):
    a, b = data.i[0], data.i[1]
    out.i[0], out.i[1], out.i[2], out.i[3] = a + b, a - b, a * b, -a
    if b != 0:
        out.i[4] = a // b
        out.i[5] = a % b
    out.i[6] = (a & b) ^ (a << 3) ^ (b >> 2)
    out.i[7], out.i[8] = min(a, b, data.i[2]), max(a, b, data.i[2])
    out.i[9] = int(data.parts[1].x)
    total = 0
    for i in range(b, a, 3):
        if i == 7:
            continue
        total += i
        if total > 40:
            break
    for i in range(a, -3, -2):
        total -= i
    out.i[10] = total
    out.i[11] = data.a.shape[0] if a > b and not (b == 3 or a == 4) else -1


def numbers(data, out):
    x, y = data.a[0], data.a[1]
    x, y = y, x
    out.x[0], out.x[1], out.x[2] = x + y, x - y, x * y / 3.0
    out.x[3], out.x[4] = min(x, y), max(x, y)
    out.x[5], out.x[6] = abs(x), np.sign(y)
    out.x[7] = math.sqrt(data.parts[1].v[2]) + exp(-data.parts[1].v[2]) * sin(0.5 * data.parts[1].v[3])
    chosen = data.parts[0]
    if x < y or x != x:
        chosen = data.parts[1]
    out.x[8] = chosen.v[3] if chosen.flag else -chosen.x
    for i in range(2):
        for j in range(3):
            out.x[9 + i] += data.A[i, j] * data.a[j + 2]
    out.x[11] = first_above(data.a, 1.0)
    out.x[12] = 1.0 if x == y else (2.0 if x <= y else (3.0 if x >= y else 4.0))
    out.x[13] = data.i[3]
    out.flag = is_inside(x, -2.0, 2.0)


def is_inside(x, low, high) -> bool:
    if x < low:
        return False
    return x <= high


def first_above(values, limit) -> float:
    for i in range(values.shape[0]):
        if values[i] > limit:
            return values[i]
    return 0.0


@pytest.mark.parametrize("kernel", [integers, numbers])
def test_machine_code_is_plain_python_bit_for_bit(kernel):
    native = native_function(kernel, [DATA, OUT])
    random = np.random.default_rng(1)
    for _ in range(500):
        data, out, expected = np.zeros(1, DATA), np.zeros(1, OUT), np.zeros(1, OUT)
        data["i"], data["a"] = random.integers(-20, 20, 4), random.normal(size=5)
        data["a"][0, :2] = random.choice(ODD, 2) if random.random() < 0.5 else random.normal(size=2)
        data["A"] = random.normal(size=(2, 3))
        for part in data["parts"][0]:
            part["flag"], part["n"], part["x"] = random.random() < 0.5, 3, 100.0 * random.normal()
            part["v"] = random.random(4)
        native.ctypes(data.ctypes.data, out.ctypes.data)
        with np.errstate(all="ignore"):
            kernel(data.view(np.recarray)[0], expected.view(np.recarray)[0])
        for name in OUT.names:
            np.testing.assert_array_equal(out[name], expected[name])
            if name == "x":
                np.testing.assert_array_equal(np.signbit(out[name]), np.signbit(expected[name]), str(data))


def sum_of_parts(data, out):
    for k in range(data.parts.shape[0]):
        out[0] += first_above(data.parts[k].v, 0.5)


def sum_of_unknown(data, out):
    for k in range(data.parts.shape[0]):
        out[0] += data.parts[k].unknown


def test_a_kernel_is_translated_without_the_loops_over_its_empty_arrays():
    """What a plant has not costs its machine code nothing, not even the time of the compiler. A user's loop, which may
    be wrong, is looked at in any case."""
    texts = []
    for n in (2, 0):
        data = np.zeros(1, np.dtype([("parts", PART, (n,))], align=True))
        data["parts"]["v"], out, expected = 1.5, np.array([0.25]), np.array([0.25])
        kernel = Compiled(sum_of_parts, [data.dtype, (float, (1,))], checked=False)
        kernel(data, out)
        sum_of_parts(data.view(np.recarray)[0], expected)
        assert out == expected == 0.25 + 1.5 * n
        texts.append(kernel.text)
    assert [text.count("first_above") > 0 for text in texts] == [True, False]
    with pytest.raises(Mistake, match="unknown"):
        Compiled(sum_of_unknown, [data.dtype, (float, (1,))])


@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_each_shipped_law_gives_the_same_as_machine_code_and_as_plain_python(name):
    scenario, law = Scenario.load("push_wall", {}, name), BUILT_IN[name]
    gains = scenario.controller.record(set_up(scenario))
    state = law.state_record()
    kind = record_dtype(law.given())
    native = native_function(law.law, [gains.dtype, state.dtype, kind, state.dtype, np.dtype(("f8", (6,)))])
    random = np.random.default_rng(2)
    for _ in range(50):
        signals = random.normal(size=kind.itemsize // 8).view(kind)
        state.view(float)[:] = random.normal(size=state.nbytes // 8)
        made = []
        for run in (native.ctypes, law.law):
            state_dot, tau_cmd = np.zeros(1, state.dtype), np.zeros(6)
            given = (gains, state, signals, state_dot)
            if run is law.law:
                run(*(each.view(np.recarray)[0] for each in given), tau_cmd)
            else:
                assert run(*(each.ctypes.data for each in (*given, tau_cmd))) == 0
            made.append((state_dot, tau_cmd))
        for native_made, plain_made in zip(*made, strict=True):
            assert_rounded_alike(native_made.view(float), plain_made.view(float))
