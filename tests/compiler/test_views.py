"""Which array may share memory with which: machine code changes what plain Python changes, or there is none."""

import itertools
import math
from random import Random

import numpy as np
import pytest

from compiled import Compiled, compare, defined
from uvms_mj.compiler.refusals import SMEARED, Lacking

GIVEN = np.dtype([("k", "f8"), ("x", "f8", (6,)), ("y", "f8", (6,)), ("A", "f8", (6, 6))], align=True)
OUT = np.dtype([("x", "f8", (6,)), ("y", "f8", (6,)), ("A", "f8", (6, 6)), ("seen", "f8", (12,))], align=True)
NAMES = {"np": np, "math": math, "TABLE": np.arange(6.0), "WHOLE": np.arange(6), "TRUE": np.array([True, False] * 3)}

VECTORS = ["x", "y", "x[::-1]", "A[0]", "A[:, 1]", "A.T[2]", "x + 1.0", "x.copy()", "same(x)", "TABLE", "WHOLE", "TRUE"]
MATRICES = ["A", "A.T", "A[::-1]", "A * 2.0", "(A * 2.0).T", "np.outer(x, y)", "A.reshape(6, 6)", "A[:, ::-1]"]
PARTS = ["x[:3]", "x[3:]", "x[::2]", "A[0, :3]", "A[:3, 0]", "x[:3] * 2.0", "A[0][::-2]", "np.array([k, 1.0, 2.0])"]
BUNDLES = ["(x, 1.0)", "(y, 2.0)", "(x + 1.0, k)", "(x[::-1], k)", "(y, x[0])", "(TABLE, 0.5)"]

SAME = "def same(z):\n    return z\n\n"
RETURNS = "def picked(x, y, A, k):\n    if k > 0.0:\n        return {}\n    return {}\n\n"
CHOOSES = "def picked(x, y, A, k):\n    return {} if k > 0.0 else {}\n\n"
BINDS = "def picked(x, y, A, k):\n    z = {}\n    if k > 0.0:\n        z = {}\n    return z\n\n"
USE = """
def used(g, o):
    r = picked(o.x, o.y, o.A, g.k)
    {took}
    o.seen[0] = 1.0 * z.sum()
    o.x[1] += 5.0
    o.A[0, 1] -= 3.0
    o.seen[1] = 1.0 * z.sum()
    {stored}
    o.seen[2] = 1.0 * z.sum()
"""
PLACES = {"vectors": (VECTORS, "z[0] = 7.0"), "matrices": (MATRICES, "z[0, 2] = 7.0"), "parts": (PARTS, "z[1] = 7.0")}


def same_or_lacking(source, kinds=(GIVEN, OUT)):
    """Whether there is machine code; then it must do as plain Python does."""
    try:
        compare(defined(source, dict(NAMES)), kinds, runs=4, exact=False)  # NumPy's sums have orders of their own
    except Lacking:
        return False
    return True


def program(template, pair, took, stored):
    return SAME + template.format(*pair) + USE.format(took=took, stored=stored)


def programs(template, forms, took, stored):
    for pair in itertools.combinations_with_replacement(forms, 2):
        yield program(template, pair, took, stored)


@pytest.mark.parametrize("template", [RETURNS, CHOOSES, BINDS], ids=["returns", "chooses", "binds"])
@pytest.mark.parametrize("kind", PLACES)
def test_one_of_two_arrays_is_the_array_that_python_takes(kind, template):
    """Every pair in one order, stored into if both may be, and only read if a store is refused; constants are only
    read."""
    forms, stored = PLACES[kind]
    read = "o.seen[3] = z[0, 1]" if kind == "matrices" else "o.seen[3] = z[1]"
    compiled = []
    for pair in itertools.combinations_with_replacement(forms, 2):
        own = program(template, pair, "z = r", stored)
        may = not {*pair} & {"TABLE", "WHOLE", "TRUE"}
        compiled.append((may and same_or_lacking(own)) or same_or_lacking(program(template, pair, "z = r", read)))
    assert sum(compiled) >= len(forms)  # each with itself, at least


@pytest.mark.parametrize("template", [RETURNS, CHOOSES], ids=["returns", "chooses"])
def test_an_array_in_one_of_two_tuples_is_the_array_that_python_takes(template):
    compiled = [same_or_lacking(each) for each in programs(template, BUNDLES, "z, n = r", "o.seen[4] = n")]
    compiled += [same_or_lacking(each) for each in programs(template, BUNDLES[:-1], "z, n = r", "z[0] = n")]
    assert sum(compiled) >= len(BUNDLES)


HELPERS = """
def view_and_number(x):
    return x[:3], x.sum()

def both(x):
    return x, x[:2]

def one_of(x, y, k):
    return x if k > 0.0 else y

def shifted(x):
    return x[:-1]

def swapped(x, y):
    return y, x

def limited(x, most):
    n = np.abs(x).max()
    if n <= most:
        return x
    return x * (most / n)

"""


@pytest.mark.parametrize(
    ("body", "compiles"),
    [
        ("a, n = view_and_number(o.x)\na[0] = n", True),
        ("a, b = both(o.x)\na[0] = 9.0\no.seen[0] = b[0]", True),
        ("a, b = both(o.x + 1.0)\na[0] = 9.0\no.seen[0] = b[0]", True),
        ("for i in range(3):\n    a, b = both(o.x + i)\n    a[0] = 9.0\n    o.seen[i] = b[0]", True),
        ("z = one_of(o.x, o.y + 1.0, g.k)\nz[0] = 3.0\no.seen[0] = z.sum()", True),
        ("o.x[1:] = one_of(o.x[:-1], o.x[1:] + 1.0, 1.0)", True),
        ("o.x[1:] = shifted(o.x)", True),
        ("o.x[1:] = o.x[:-1]\no.y[:-1] += o.y[1:]", True),
        ("a, b = o.x, o.y\nfor i in range(5):\n    a, b = b, a\n    a[i] += 1.0", True),
        ("a, b = o.x, o.y\nfor i in range(5):\n    a, b = swapped(a, b)\n    a[i] += 1.0", True),
        ("a, b, c = o.x, o.y, o.A[0]\nfor i in range(4):\n    a, b, c = b, c, a + 1.0\no.seen[:6] = a + b - c", True),
        (
            "a, b, c = o.x, o.y, o.A[0]\nfor i in range(4):\n"
            "    b, a = a, a + 1.0\n    b, a, c = c * 0.5, a * 0.5, b\n    o.seen[:6] += c",
            True,
        ),
        ("z = o.x\nif g.k > 0.0:\n    z = z + 1.0\no.x[0] = 8.0\no.seen[:6] = z", True),
        ("z = o.x\nfor i in range(3):\n    z = limited(z, 2.0 - i)\n    o.x[0] += 1.0\n    o.seen[i] = z[0]", None),
        (
            "before = o.x * 1.0\nz = before\nfor i in range(3):\n    before = z\n    z = z + 1.0\no.seen[:6] = before",
            True,
        ),
        ("pair = (o.x, o.y)\nz = pair[1] if g.k > 0.0 else pair[0]\nz[2] = 4.0", True),
        ("o.A[0], o.A[1] = o.A[1], o.A[0]", True),
        ("o.x[0], o.x[1] = o.x[1], o.x[0]", True),
        ("z = o.A.T.ravel()\nz[1] = 3.0", True),
        ("z = o.A[:, 0].reshape(2, 3)\nz[0, 1] = 3.0", True),
        ("z = o.A[:, 0].ravel()\nz[1] = 3.0", True),
        ("z = np.ascontiguousarray(o.A[:, 0])\nz[1] = 3.0", True),
        ("z = np.ascontiguousarray(o.x)\nz[1] = 3.0", True),
        ("z = np.asarray(o.x)\nz[1] = 3.0", True),
        ("z = np.zeros(6)\nfor row in o.A:\n    z, row[0] = row, z[0]\no.seen[:6] = z", None),
    ],
)
def test_names_stand_for_arrays_as_in_python(body, compiles):
    source = HELPERS + "def program(g, o):\n" + "".join(f"    {line}\n" for line in body.splitlines())
    try:
        done = same_or_lacking(source)
    except ValueError:  # of Python itself, too: the truth value of an array
        done = None
    assert compiles in (None, done)


@pytest.mark.parametrize(
    "body",
    [
        "o.x[int(o.push(1.0))] = 2.0",
        "o.seen[pushed(o.y)] = 2.0",
        "o.seen[pushed(o.y)] += 2.0",
        "o.A[pushed(o.y), pushed(o.y)] += 2.0",
        "i = 0\no.seen[i + pushed(o.y)] = o.y[0]",
        "o.seen[:6][o.x > pushed(o.y)] = 1.0",
    ],
)
def test_an_index_is_evaluated_once(body):
    helper = "def pushed(y):\n    y[0] += 1.0\n    y[1] = 0.0\n    return int(y[1]) + 1\n\n"
    body = body.replace("o.push(1.0)", "pushed(o.y)")
    assert same_or_lacking(helper + "def program(g, o):\n" + "".join(f"    {line}\n" for line in body.splitlines()))


STEPS = ["[:3]", "[::2]", "[3:]", "[1::2]", "[::-2]", "[2::-1]", "[-1:2:-1]", "[2:5]"]


@pytest.mark.parametrize("part", STEPS)
def test_an_array_filled_from_itself_is_what_numpy_makes_of_it_or_the_call_ends(part):
    """NumPy copies forward where the steps are of one sign and differ; machine code leaves that to it."""
    ended = []
    for other in STEPS:
        function = defined(f"def used(o):\n    o.x{part} = o.x{other}\n", dict(NAMES))
        mine = np.zeros(1, OUT)
        mine["x"] = np.arange(6.0)
        theirs = mine.copy()
        code = Compiled(function, [OUT])
        why = code(mine) & 255
        function(theirs.view(np.recarray)[0])
        assert why in (0, SMEARED)
        ended.append(why == SMEARED)
        if why == 0:
            np.testing.assert_array_equal(mine["x"], theirs["x"])
    assert any(ended)
    assert not all(ended)


MADE = """
-{}; +{}; {} * 2.0; {} + o.A[:3, :2]; np.exp({}); np.clip({}, -1.0, 1.0); np.where({0} > 0.0, {0}, 0.0); {}.copy()
np.copy({}); np.array({}); {}.astype(float); np.zeros_like({}); np.full_like({}, 2.0); np.round({}, 1)
np.nan_to_num({}); np.cumsum({}, axis=0); np.diff({}, axis=0); np.roll({}, 1); np.tile({}, (1, 1))
np.repeat({}, 2, axis=0); np.triu({}); np.flip({}); np.concatenate([{0}, {0}]); np.stack([{0}[0], {0}[1]])
np.vstack([{0}, {0}]); np.column_stack([{0}, {0}]); np.block([[{0}], [{0}]]); np.kron({}, 2.0); np.outer({0}, {0})
{0} @ o.A[:2, :3]; np.dot({}, 2.0); np.inner({}, 2.0); np.einsum('ij,ij->ji', {0}, {0}); twice({})
np.maximum({}, o.A[:3, :2]); ({} if o.x[0] > 0.0 else np.ones((3, 2))) * 2.0; np.linalg.matrix_power({}[:2], 1)
np.linalg.inv({}[:2])
"""
TWICE = "def twice(z):\n    return 2.0 * z\n\n"
"""A new matrix of another one."""


@pytest.mark.parametrize("given", ["o.A[:2, :3].T", "(o.A[:2, :3] * 1.0).T", "(1.0 * o.A[:3]).T[:3, :2][:, ::-1]"])
def test_a_new_array_has_the_axes_of_numpys_in_memory(given):
    """They decide whether a reshaped one is a view: a store into it then changes the array."""
    store = "    r = C.reshape(-1)\n    r[1] = 7.0\n    q = C.T.ravel()\n    q[2] = 9.0\n"
    compiled = [
        same_or_lacking(
            f"{TWICE}def used(o):\n    z = {given}\n    C = {each.format('z')}\n{store}"
            "    o.seen[:4] = [C[0, 0], C[0, 1], C[1, 0], C[1, 1]]\n",
            [OUT],
        )
        for each in MADE.strip().replace("\n", "; ").split("; ")
    ]
    assert sum(compiled) >= len(compiled) - 3


@pytest.mark.parametrize("statement", ["for i in range(3):", "while o.seen[0] < 1.0:"])
def test_a_part_of_a_new_array_in_a_loop_is_the_part(statement):
    """A row of gaps is no view when it is flattened."""
    body = "c = (o.A * 2.0)[:, 0]\n        r = c.ravel()\n        r[0] = 5.0\n        o.seen[1] = c[0]\n"
    same_or_lacking(
        f"def used(o):\n    o.seen[0] = 0.0\n    {statement}\n        {body}        o.seen[0] += 1.0\n", [OUT]
    )


STATEMENTS = [
    "{} = {}",
    "{} = {} * 0.5",
    "{} = {}.copy()",
    "{} += {}",
    "{}[i] += 3.0 + {}[1]",
    "{} = same({})",
    "{}, {} = {} * 0.5, {}",
    "{}, {} = {}.copy(), {} + 1.0",
    "{}, {}, {} = {}, {} * 0.5, {}",
    "{}, {} = both6({} + 1.0)",
    "{}, {} = swapped({}, {})",
    "if {}[0] > {}[1]:\n            {} = {}",
    "for j in range(2):\n            {} = {} * 0.5 + j",
]
BOTH6 = "def both6(x):\n    return x, x[:6]\n\n"


def random_turns(random):
    """A loop of five turns in which four names stand for new arrays, for each other's and for those of a record."""
    lines = ["def program(g, o):", "    a, b, c, d = o.x, o.y + 1.0, o.x * 2.0, o.A[0]", "    for i in range(5):"]
    for _ in range(random.randrange(2, 6)):
        form = random.choice(STATEMENTS)
        lines += ["        " + form.format(*random.choices("abcd", k=form.count("{}")))]
    lines += [f"        o.seen[{k}] += {name}.sum()" for k, name in enumerate("abcd")]
    return HELPERS + BOTH6 + SAME + "\n".join(lines) + "\n"


def test_arrays_that_turns_of_a_loop_make_are_the_arrays_of_python():
    """An array that a name has from an earlier turn keeps its numbers, whichever names take it over."""
    random = Random(5)
    assert sum(same_or_lacking(random_turns(random)) for _ in range(40)) >= 27


def test_one_memory_is_enough_where_no_name_takes_over_an_array():
    """In a loop, a free memory is sought at run time only where a name may stand for an array of another name."""
    alone = "        x, n = o.x.copy(), g.k\n        x[0] += n\n        o.y += x\n"
    shared = "        x, before = o.x.copy(), x\n        x[0] += i\n        o.y += before\n"
    searches = []
    for body in (alone, shared):
        source = "def program(g, o):\n    x = o.y.copy()\n    for i in range(8):\n" + body
        searches.append(Compiled(defined(source, dict(NAMES)), (GIVEN, OUT)).text.count("select"))
    assert searches[0] == 0 < searches[1]
