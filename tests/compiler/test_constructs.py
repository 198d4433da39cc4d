"""Each construct of the language: machine code gives what plain Python gives, bit for bit."""

import ast
import math
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from compiled import compare
from uvms_mj.files import function_tree

PART = np.dtype([("m", "f8"), ("v", "f8", (3,)), ("on", "?")], align=True)
GIVEN = np.dtype(
    [
        ("k", "f8"),
        ("n", "i8"),
        ("flag", "?"),
        ("x", "f8", (6,)),
        ("y", "f8", (6,)),
        ("v", "f8", (3,)),
        ("A", "f8", (6, 6)),
        ("B", "f8", (3, 4)),
        ("parts", PART, (3,)),
        ("inner", PART),
        ("whole", "i8", (4,)),
    ],
    align=True,
)
OUT = np.dtype([("x", "f8", (6,)), ("A", "f8", (6, 6)), ("s", "f8", (40,)), ("whole", "i8", (8,))], align=True)

WEIGHTS = np.arange(24.0).reshape(4, 6) / 7.0
TABLE = (0.0, 1.5, 4.0, 9.5)
GAINS = ((1.0, 2.0), (3.0, 4.0))
LIMIT = 2.5
N = 4


def arithmetic(g, o):
    x, k = g.x, g.k
    o.x[:] = (x + g.y * 2.0 - k) / (1.0 + x * x) - -x
    o.A[:] = g.A - g.x + 3 * g.A.T
    o.s[0] = k + 3
    o.s[1] = k - g.n
    o.s[2] = 7 / 2
    o.s[3] = k**2 + 2**5
    o.s[4] = +k
    o.s[5:11] = x**2
    o.whole[0] = 7 // 2 - -7 // 2 + 7 % 3 - (-7) % 3
    o.whole[1] = (g.n << 2) ^ (g.n & 3) | (g.n >> 1)


def in_place(g, o):
    o.x[:] = 0.0
    o.x += g.x
    o.x *= 2.0
    o.x[2] -= g.k
    o.x[1:3] /= 3.0
    o.A[0] += g.x
    o.A[:, 1] = g.y
    x = g.x.copy()
    x += x[::-1]
    x[1:] = x[:-1]
    o.s[0:6] = x
    total = 0
    for each in g.y:
        total += each
    o.s[6] = total
    a = b = 1.0
    b += a
    o.s[7] = a + b


def slicing(g, o):
    o.x[:3] = g.x[3:]
    o.x[-1] = g.x[-2]
    o.x[3:5] = g.A[1, 2:4]
    o.s[0:3] = g.x[::2]
    o.s[3:9] = g.A[:, 2]
    o.s[9:12] = g.A[-1, 1::2]
    o.A[1:3, 1:3] = g.A[:2, :2].T
    o.A[3] = g.A[g.whole[0] % 6]
    o.A[..., 5] = g.x
    o.s[12:15] = g.B[:, 1:2][:, 0]
    o.s[15:18] = (g.v[:, None] * g.v[None, :])[1]
    o.s[20:23] = (g.B[:, 1:2] * g.v)[1]
    o.s[18] = g.A[g.n % 6, -1]
    o.s[19] = g.x[g.n]
    o.whole[:2] = g.B.shape
    o.whole[2] = len(g.B) + len(g.B.T) + g.B.size + g.B.ndim + g.B.shape[0]


def making(g, o):
    n = len(g.x)
    a = np.zeros(n)
    a[2] = g.k
    b = np.ones((2, 3))
    c = np.full(3, g.k)
    d = np.array([[g.k, 1.0], [2, g.x[0]]])
    e = np.concatenate((g.v, c))
    f = np.stack((g.v, c, b[0]))
    h = np.empty((n, n))
    h[:] = np.eye(n)
    m = np.zeros_like(g.A)
    m += h
    o.x[:] = a + e
    o.A[:] = m
    o.s[0:2] = d[1]
    o.s[2:5] = f[1] + b[1]
    o.s[5:11] = np.array([1, 2, 3, 4.5, g.k, g.n])
    o.s[11:17] = np.hstack((g.v, g.v * 2.0))
    o.s[17:20] = np.vstack((g.v, g.v + 1.0))[1]
    o.s[20:23] = np.column_stack((g.v, g.v - 1.0))[:, 1]
    o.s[23:26] = np.diag(g.A[:3, :3])
    o.s[26:29] = np.diag(g.v)[2]
    o.s[29:35] = np.arange(6)
    o.s[35:38] = g.x.reshape(2, 3)[1]
    o.whole[:4] = np.array([1, 2, 3, 4]) * g.whole


def reducing(g, o):
    o.s[0] = g.x.sum()
    o.s[1] = np.sum(g.A)
    o.s[2] = np.prod(g.x)
    o.s[3] = g.x.min() + g.A.max()
    o.s[4] = np.mean(g.v)
    o.s[5:11] = g.A.sum(axis=0)
    o.s[11:17] = np.sum(g.A, axis=1)
    o.s[17:23] = g.A.min(axis=1)
    o.s[23] = np.argmin(g.x) + 10 * g.x.argmax()
    o.s[24] = np.trace(g.A)
    o.s[25] = max(g.k, g.n, 2) + min(g.x) + max(1.0, 2.0)
    o.s[26] = sum(g.v)
    o.whole[0] = (g.x > 0).sum()
    o.whole[1] = np.any(g.x > 1.0) + 2 * (g.x > -1.0).all()
    o.whole[2] = g.whole.sum() + g.whole.max()


def choosing(g, o):
    o.x[:] = np.where(g.x > 0.0, g.y, -g.y)
    o.x[:] = np.clip(o.x, -1.0, g.v[0])
    o.s[:6] = np.maximum(np.minimum(g.x, 0.5), np.abs(g.y) - 1.0)
    o.s[6:12] = np.sign(g.x) * np.floor(g.y) + np.ceil(g.x) - np.round(g.y, 1)
    o.s[12] = g.k if g.flag else -g.k
    o.s[13] = 1.0 if 0.0 < g.k < 1.0 <= g.v[0] else 2.0
    o.s[14] = 3.0 if (g.flag and g.k > 0.0) or not g.flag else 4.0
    o.s[15] = abs(g.k) + abs(g.n) + round(g.k)
    o.s[16] = int(g.k) + float(g.n) + bool(g.n)
    mask = g.x > 0.2
    o.s[17:23] = g.x
    o.s[17:23][mask] = 0.0
    o.s[23:29] = 1.0 * (mask & ~(g.y > 0.0) | (g.x < -1.0))
    o.s[29] = math.copysign(2.0, g.k) + np.isnan(g.k) + math.isfinite(g.k)
    v = g.v if g.flag else 2.0 * g.v
    o.s[30:33] = v
    if g.k > 1.0:
        w = g.v
    elif g.k > 0.0:
        w = -g.v
    else:
        w = np.zeros(3)
    o.s[33:36] = w


def deciding(g, o):
    """The value of `and` and `or` is that of the operand that decides."""
    n = g.n % 3
    o.s[0] = g.k or 3.0
    o.s[1] = n and 2
    o.s[2] = (n and g.k) or 7.0
    o.s[3] = g.flag and g.k
    o.s[4] = 0 or n or 5
    o.s[5] = 1.0 and g.k
    o.s[6] = (g.flag and n == 1) + 1
    o.whole[0] = 2 if n and g.flag else 3
    o.whole[1] = not (n or g.flag)


def looping(g, o):
    total = 0
    for i in range(len(g.x)):
        if i == 1:
            continue
        total += g.x[i] * i
        if total > 3.0:
            break
    o.s[0] = total
    for i, x in enumerate(g.x):
        o.x[i] = x + i
    for a, b, c in zip(g.x, g.y, range(6)):
        o.s[1] += a * b + c
    for row in g.A:
        o.s[2] += row[0]
    for i in range(5, -1, -2):
        o.s[3] = o.s[3] * 0.5 + g.x[i]
    k = 0
    while k < 4 and g.x[k] < 1.0:
        k += 1
    o.whole[0] = k
    while True:
        k += 1
        if k > 7:
            break
    o.whole[1] = k
    for kp, kd in GAINS:
        o.s[4] += kp * g.k + kd
    for i, a in zip(range(abs(g.n) % 4), g.x):
        o.s[16 + i] = a
    for i, k in enumerate(range(1, abs(g.n) % 7 + 2, 2)):
        o.s[20 + i] = k
    for i, k in enumerate(range(abs(g.n) % 7, 0, -3)):
        o.s[30 + i] = k
    for name in (g.k, g.v[0], 3.0):
        o.s[5] += name
    for i in range(2):
        o.s[6 + 3 * i : 9 + 3 * i] = g.v * (i + 1)
    for i, each in enumerate((g.x, g.y)):
        o.s[12 + i] = each[0]
    for part in g.parts:
        o.s[14] += part.m * part.v[1]


def before_and_after(g, o):
    """Names that stand for an array of the turn before."""
    x = g.v.copy()
    before = x
    for _ in range(4):
        before = x
        x = x * 0.5 + 1.0
        last = before
        before[0] += 1.0
        o.s[6:9] = last
    o.s[0:3] = x
    o.s[3:6] = before
    a, b = g.v * 1.0, g.v * 2.0
    for _ in range(3):
        a, b = b, a + b
    o.s[9:12] = a
    o.s[12:15] = b
    y = g.v
    for _ in range(2):
        y = g.A[:3, :3] @ y * 0.0 + y + 1.0
    o.s[15:18] = y


def three_in_turn(g, o):
    """Three names stand for three arrays while a turn makes a fourth."""
    p, q, r = g.v * 1.0, g.v * 2.0, g.v * 3.0
    for _ in range(5):
        p, q, r = q, r, p + q
    o.s[:3] = p
    o.s[3:6] = q
    o.s[6:9] = r


def tuples(g, o):
    a, b = g.k, g.v
    (c, d), e = (a, b), 2.0
    pair = (c, e)
    o.s[0] = pair[0] + pair[-1] + len(pair)
    o.s[1:4] = d * np.array((1.0, 2.0, 3.0))
    o.s[4] = TABLE[1] + GAINS[1][0] + LIMIT
    o.s[5] = TABLE[g.n % 4]
    x, y, z = g.v
    o.s[6] = x * y + z
    q0, q1 = swapped(x, y)
    o.s[7], o.s[8] = q0, q1
    o.s[9:12] = g.v + (1.0, 2.0, 3.0)


def swapped(a, b):
    return b, a


def records(g, o):
    part = g.parts[1]
    o.s[0] = part.m + g.inner.v[2]
    o.s[1:4] = g.parts[g.n % 3].v
    if g.parts[2].on:
        o.s[10] = 1.0
    o.x = g.x
    o.s[11] = weighed(g.inner, scale=2.0)
    o.s[12] = weighed(part)


def weighed(part, scale=1.0, *, offset=0.5):
    return part.m * scale + offset


def helpers(g, o):
    o.x[:] = saturated(g.x, 1.0)
    o.s[0:3] = rotated(np.array([1.0, 0.0, 0.0, 0.0]), g.v)
    w, total = split(g.x)
    o.s[3:6] = w
    o.s[6] = total
    put(o.s, 7, g.k)
    first(o.s)[0] = 5.0
    o.s[8] = factorial(5)
    o.s[9:12] = shifted(g.v) + shifted(g.v, by=2.0)
    o.s[12] = optional(g.v) + optional(g.v, 3.0)


def saturated(x, limit):
    n = np.abs(x).max()
    if n > limit:
        return x * (limit / n)
    return x


def rotated(q, v):
    w, u = q[0], q[1:]
    t = 2.0 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def split(x):
    n = len(x) // 2
    return x[:n], x[n:].sum()


def put(x, i, value):
    x[i] = value


def first(x):
    return x[:1]


def factorial(n):
    result = 1
    for i in range(2, n + 1):
        result *= i
    return result


def shifted(x, by=1.0):
    return x + by


def optional(x, limit=None):
    if limit is None:
        return x[0]
    return min(x[0], limit)


def constants(g, o):
    o.s[0:4] = WEIGHTS @ np.ones(6) * 0.0 + WEIGHTS[:, 1]
    o.s[4] = WEIGHTS[g.n % 4, 2] + math.pi * 0.0 + np.inf * 0.0 * 0.0 if g.flag else LIMIT
    n = N
    a = np.zeros((n, 2))
    a[n - 1] = g.k
    o.s[5:9] = a[:, 0]


def narrowing(g, o):
    x = g.x
    x = x[:3]
    x = x[0]
    o.s[0] = x
    n = 1
    if g.flag:
        n = 2.5
    o.s[1] = n
    if g.k > 0.0:
        e = g.v
    else:
        e = g.A[:3, 0].copy()
    o.s[2:5] = e


def views_of_new_arrays(g, o):
    """A name stands for a part of an array that the statement has made, while the next turn makes another one."""
    y = g.x[1:]
    before = y
    for i in range(4):
        before = y
        y = (g.x + float(i))[1:]
    o.s[:5] = y
    o.s[5:10] = before
    q = g.x * 1.0
    older = q
    for _ in range(3):
        older = q
        q = same(q + 1.0)
    o.s[10:16] = older
    for _ in range(3):
        older = q
        q = larger(q, q + 1.0)
    o.s[16:22] = older


def same(x):
    return x


def larger(x, y):
    if x[0] > y[0]:
        return x
    return y


def left_early(g, o):
    """A loop that is written out, and left in any of its turns."""
    for i in range(3):
        k = i
        o.s[4 * i : 4 * i + 4] = g.x[:4]
        if g.x[i] > 0.2:
            break
    o.s[20] = k * 10 + i
    last = -1
    for a in (1, 2, 3):
        if g.k * a > 0.5:
            last = a
            break
    o.s[21] = last


def entries_of_new_arrays(g, o):
    """A small array has memory only where it is needed: at an index that is known at run time, in a branch or a loop,
    for a store, for another function."""
    o.s[0] = (g.v + 1.0)[1]
    o.s[1] = (g.v + g.k)[g.n % 3]
    once = g.v * 2.0
    if g.k > 0.0:
        o.s[2:5] = (once - g.v if g.flag else once + g.v) * g.k
        inner = once * once
        o.s[5] = inner[g.n % 3]
    for i in range(g.n):
        o.s[6] += once[i % 3] + (g.v * g.v)[i % 3]
        kept = once + i
        o.s[7:10] = kept - once
    turned = (g.B[:, :3] * 2.0).T
    o.s[10:13] = turned[:, 1] + turned.T[1]
    once[1] = 7.0
    o.s[13:16] = once + (once + 1.0).copy()
    o.s[20:26] = np.concatenate((g.v + once, np.array([g.k, once[0], 3.0])))
    o.s[26] = (g.v > 0.0).sum() + np.max(once - g.v)
    o.s[27:30] = stored_in(once * 3.0)


def of_the_turn_before(g, o):
    """A name for the array of the turn before, beside one that stands for the same memory in every turn."""
    before = g.x
    o.x[:] = 0.0
    for i in range(5):
        now = g.x * (i + 1.0)
        o.x += before
        before = now
        same = g.y
        o.s[i] = same[i]


def stored_in(x):
    x[0] += 1.0
    return x


@pytest.mark.parametrize(
    "function",
    [
        entries_of_new_arrays,
        views_of_new_arrays,
        left_early,
        of_the_turn_before,
        arithmetic,
        in_place,
        slicing,
        making,
        reducing,
        choosing,
        deciding,
        looping,
        before_and_after,
        three_in_turn,
        tuples,
        records,
        helpers,
        constants,
        narrowing,
    ],
    ids=lambda function: function.__name__,
)
def test_a_construct_gives_the_same_as_machine_code_and_as_plain_python(function):
    compare(function, [GIVEN, OUT])


def test_a_functions_tree_is_the_tree_of_its_source():
    """As the whole file is parsed, of all functions in every fourth file of the package that is loaded."""
    found = [each for module in list(sys.modules.values()) for each in [*vars(module).values()]]
    functions = {each for each in found if type(each) is types.FunctionType}  # isinstance asks what a test has broken
    ours = [f for f in functions if str(f.__module__).startswith("uvms_mj.") and f.__code__.co_filename.endswith(".py")]
    assert len(ours) > 300
    trees, files = {}, sorted({function.__code__.co_filename for function in ours})[::4]
    for file in files:
        for node in ast.walk(ast.parse(Path(file).read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                trees[file, min([node.lineno, *(each.lineno for each in node.decorator_list)])] = node
    compared = [each for each in ours if each.__code__.co_filename in files]
    assert len(compared) > 60
    for function in compared:
        if function.__name__ != "<lambda>" and not hasattr(function, "__wrapped__"):
            code = function.__code__
            assert ast.dump(function_tree(function)[0]) == ast.dump(trees[code.co_filename, code.co_firstlineno])
