"""Forms that reduce to numbers, arrays and tuples: machine code gives what plain Python gives, bit for bit."""

import enum
import functools
import math
from collections import namedtuple
from dataclasses import dataclass

import numpy as np
import pytest

from compiled import compare, defined
from uvms_mj.compiler.refusals import Lacking
from uvms_mj.compiler.unit import Unit, translate

GIVEN = np.dtype([("k", "f8"), ("n", "i8"), ("x", "f8", (6,)), ("y", "f8", (6,)), ("A", "f8", (6, 6))], align=True)
OUT = np.dtype([("x", "f8", (6,)), ("s", "f8", (40,)), ("whole", "i8", (8,))], align=True)

KP = [2.0, 1.5, 3.0, 0.5, 0.25, 4.0]
ROWS = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
LAYERS = [(np.arange(48.0).reshape(8, 6) / 30.0, np.ones(8)), (np.arange(48.0).reshape(6, 8) / -40.0, np.zeros(6))]
PID = {"surge": {"kp": 2.0, "ki": 0.5}, "heave": {"kp": 3.0, "ki": [0.25, 0.75]}}
AXES = ["surge", "heave"]
MODE = "smooth"
SHAPES = {"square": lambda a: a * a, "cube": lambda a: a * a * a}
ON = frozenset((0, 3))
Pair = namedtuple("Pair", ["first", "second"])
PAIR = Pair(1.5, np.array([1.0, -2.0]))


class Mode(enum.Enum):
    IDLE = 0
    PUSH = 2


class Axis(enum.IntEnum):
    X = 0
    Z = 2


@dataclass(frozen=True)
class Gains:
    kp: float
    limit: float = 2.0

    def force(self, e):
        return max(-self.limit, min(self.limit, -self.kp * e))


STIFF = Gains(40.0)


class Sheet:
    MASS = 11.5
    DRAG = np.array([4.0, 6.2, 5.2, 0.1, 0.2, 0.3])

    @staticmethod
    def drag(v):
        return Sheet.DRAG * v


def constant_lists(g, o):
    o.x[:] = np.array(KP) * g.x + KP[1] * g.k
    for i, k in enumerate(KP):
        o.s[i] = k * g.x[i] + KP[i]
    o.s[6] = KP[g.n % 6]
    o.s[7] = len(KP) + sum(KP) + max(KP) + ROWS[1][2]
    o.s[8:11] = np.array(ROWS)[1] * g.x[:3]
    o.s[11] = np.interp(g.k, [0.0, 1.0, 2.0], [3.0, 4.0, -5.0])
    o.s[12:15] = ROWS[0][::-1]
    o.s[15] = KP == [2.0, 1.5]


def dicts_and_texts(g, o):
    for i, axis in enumerate(AXES):
        o.s[i] = PID[axis]["kp"] * g.x[i]
    o.s[2] = PID["heave"]["ki"][1] + PID["surge"].get("kd", 7.0)
    local = {"a": g.k, "b": g.x}
    local["c"] = 3.0
    local["a"] += 1.0
    o.x[:] = local["b"] * local["a"]
    o.s[3] = sum(v for v in PID["surge"].values()) + len(local) + ("a" in local) + ("z" in PID)
    for k, (key, value) in enumerate({"p": 1.0, "q": g.k}.items()):
        o.s[4 + k] = value if key == "q" else -value
    if MODE == "smooth" and MODE in ("sharp", "smooth") and MODE.upper().startswith("SM"):
        o.s[6] = 1.0
    match MODE:
        case "sharp":
            o.s[7] = undefined  # noqa: F821
        case "flat" | "smooth":
            o.s[7] = 2.0
    match g.n % 3:
        case 0:
            o.s[8] = 4.0
        case 1 | 2 if g.k > 0.0:
            o.s[8] = 5.0
        case _:
            o.s[8] = 6.0
    o.s[9] = {"k" + AXES[0]: 1.0, f"k{AXES[1]}": 2.0}["kheave"] + float("inf")
    o.s[10] = SHAPES["cube"](g.k) + switched(g.k, mode="square") + switched(g.k, **{"mode": "cube"})


def switched(a, mode="cube"):
    return SHAPES[mode](a) if mode in SHAPES else 0.0


def lists(g, o):
    y = [0.0, g.k, 2.0]
    o.s[:3] = y
    o.s[3:9] = [1.0] * 2 + [g.k] * 3 + [5.0]
    o.x[:] = np.concatenate([[g.k], g.x[:4], [1.0]])
    grown = []
    for i in range(4):
        grown.append(g.x[i] * i)
    grown += [7.0, 8.0]
    grown[1] = 2.5
    grown[0] += 1.0
    o.s[9:15] = np.array(grown)
    rows = [g.x]
    rows.append(g.y * 2.0)
    rows.insert(0, g.x + g.y)
    o.s[15:21] = np.stack(rows)[2] + rows[0] + sum(rows)
    first, *rest = grown
    o.s[21] = first + len(rest) + rest[-1]
    flags = [0, 0, 0]
    for i in range(3):
        if g.x[i] > 0.0:
            flags[i] = 1
    o.whole[:3] = flags
    o.s[22] = g.n in [1, 2, 40] or g.n not in (3, 4, 5)
    o.s[23] = 1 + (g.n % 7 in ON) + (g.n in range(2, 5))
    o.s[24] = sum([g.k, g.k, 1.0]) + max(grown) + total(*grown) + total(*g.x[:2])


def total(*values):
    result = 0.0
    for value in values:
        result += value
    return result


def comprehensions(g, o):
    o.x[:] = np.array([math.sqrt(abs(a)) * i for i, a in enumerate(g.x)])
    o.s[:6] = [a if a > 0.0 else 0.0 for a in g.y]
    o.s[6] = sum(a * b for a, b in zip(g.x, g.y, strict=True))
    o.s[7] = 1.0 + all(abs(a) < 2.0 for a in g.x) + any(a > 1.0 for a in g.x) + all([])
    o.s[8] = any(6 // (g.n - g.n + i) > 5 for i in (1, 0))  # 6 // 0 is not reached
    o.s[9] = max(abs(a) for a in g.x) + min([a * a for a in g.y if True])
    B = np.array([[g.x[i] * j for j in range(3)] for i in range(2)])
    o.s[10:13] = B[1]
    o.s[13] = sum(i * j for i in range(4) for j in range(i) if (i + j) % 2)
    by = {i: g.x[i] for i in range(3)}
    o.s[14] = by[0] + by[2]
    i = 5
    o.s[15] = sum(i for i in range(3)) + i
    o.s[16:19] = list(map(abs, g.x[:3]))
    o.s[19] = list(reversed([1.0, g.k]))[1]


def of_other_shapes(g, o):
    h = g.x
    for W, b in LAYERS:
        h = W[:, 0] * h[0] + W[:, 1] * h[5] + b
    o.x[:] = h
    total_force = 0
    for i in range(3):
        total_force = total_force + g.x * i
    o.s[:6] = total_force
    v = None
    if MODE != "sharp":
        v = g.x[:2] * 2.0
    o.s[6:8] = v
    if v is not None and isinstance(v, np.ndarray) and not isinstance(g.k, (list, np.ndarray)):
        o.s[8] = 1.0


def rk4(f, x, h):
    k1 = f(x)
    k2 = f(x + h / 2 * k1)
    return x + h * f(x + h / 2 * k2)


def functions(g, o):
    rate = g.k * 0.5

    def model(x):
        return -rate * x + g.y

    gain = lambda a, by=2.0: by * a + rate  # noqa: E731
    o.x[:] = rk4(model, g.x, 0.1)
    o.s[:6] = rk4(lambda x: g.A[0] * x * rate, g.x, 0.01)
    o.s[6] = gain(g.k) + gain(g.k, by=3.0)
    half = functools.partial(math.copysign, 0.5)
    o.s[7] = half(g.k) + functools.partial(named, b=2.0)(1.0)
    o.s[8:14] = rk4(Sheet.drag, g.x, 0.1) * Sheet.MASS
    for i in range(3):
        o.s[14 + i] = applied(lambda a: a * i + rate, g.x[i])  # noqa: B023


def named(a, *, b, c=1.0, **more):
    return a + b * c + len(more)


def applied(f, x):
    return f(f(x))


def objects(g, o):
    o.s[0] = STIFF.force(g.k) + STIFF.kp
    pair = Pair(g.x, second=g.k)
    o.x[:] = pair.first * pair.second + PAIR.first
    a, b = pair
    o.s[1:7] = a + b
    o.s[7] = pair._replace(second=3.0).second
    o.s[8:10] = PAIR.second
    o.s[10] = Gains(g.k, limit=1.0).force(g.x[0])
    o.s[11] = Mode.PUSH.value if g.n == Mode.IDLE.value else 1.0
    mode = Mode.PUSH
    o.s[12] = 1 + (mode is Mode.PUSH) + (mode == Mode.IDLE) + (mode in (Mode.IDLE, Mode.PUSH))
    o.s[Axis.Z + 12] = g.x[Axis.X]
    for k, each in enumerate(Mode):
        o.s[15 + k] = each.value


def statements(g, o):
    if (n := g.n % 5) > 2:
        o.whole[0] = n
    for i in range(6):
        if g.x[i] > 1.0:
            o.s[0] = i
            break
    else:
        o.s[0] = -1.0
    for i in range(3):
        o.s[1] += i
    else:
        o.s[1] += 10.0
    k = 0
    while k < 4:
        k += 1
        if k == g.n:
            break
    else:
        k = 40
    o.whole[1] = k
    for W, _ in LAYERS:
        if g.k > W[0, 1] * 100.0:
            break
    else:
        o.s[2] = 3.0
    text = f"k is {g.k:.2f}"
    print(text, "n is {}".format(g.n))  # noqa: UP032
    del text
    o.s[3] = g.k if 1 == 1.0 else undefined  # noqa: F821


@pytest.mark.parametrize(
    "function",
    [
        constant_lists,
        dicts_and_texts,
        lists,
        comprehensions,
        of_other_shapes,
        functions,
        objects,
        statements,
    ],
    ids=lambda function: function.__name__,
)
def test_a_form_gives_the_same_as_machine_code_and_as_plain_python(function):
    compare(function, [GIVEN, OUT])


@pytest.mark.parametrize(
    "body",
    [
        "a = [1.0, 2.0, 3.0]\nfor k, v in enumerate(a):\n    a[2] = a[2] + v\no.x[0] = a[2]",
        "a = [1.0, 2.0, 3.0]\nfor v, w in zip(a, g.x):\n    a[2] = a[2] + v\no.x[0] = a[2]",
        "d = {'a': 1.0, 'b': 2.0}\nfor k, v in d.items():\n    d['b'] = 7.0\n    o.x[0] += v",
        "a = [1.0, 2.0]\nfor k, v in enumerate(a):\n    if k < 2:\n        a.append(v)\no.x[0] = len(a)",
        "for i in range(6):\n    o.x[i] = i\nfs = [lambda a: a * i for i in range(3)]\no.x[0] = fs[0](2.0)",
        "fs = []\nfor i in range(3):\n    fs.append(lambda a: a * i)\no.x[0] = fs[0](2.0)",
        "fs = []\nfor i in range(3):\n    fs.append(given(lambda a: a * i))\no.x[0] = fs[0](2.0)",
    ],
)
def test_what_changes_while_it_is_run_over_or_read_is_left_to_python(body):
    source = "def given(f):\n    return f\n\ndef program(g, o):\n" + "".join(
        f"    {line}\n" for line in body.splitlines()
    )
    with pytest.raises(Lacking):
        translate(Unit("late", checked=True), defined(source, {"np": np}), [GIVEN, OUT], "late")
