"""Functions of a record whose numbers are constants of the code, cells or regions give what plain Python gives."""

import ctypes
import random
import types
from collections.abc import Collection
from typing import Any

import llvmlite.binding as llvm
import numpy as np
import pytest
from llvmlite import ir

from compiled import arguments, as_python, assert_equal, defined, function_of
from random_programs import GIVEN, OUT, Writer
from uvms_mj.compiler.cells import Cells
from uvms_mj.compiler.emission import Emission
from uvms_mj.compiler.refusals import Lacking
from uvms_mj.compiler.targets import optimize
from uvms_mj.compiler.unit import Unit
from uvms_mj.compiler.values import POINTER, WORD, Place, Value, argument_kind, view
from uvms_mj.engine.native.compilation import target_machine

_engines: list[Any] = []
STATE = np.dtype(
    [("a", "f8", (3,)), ("b", "f8", (3,)), ("c", "f8", (3,)), ("n", "i8"), ("rows", "f8", (4, 3))], align=True
)
G = np.dtype([("on", "i8"), ("k", "f8"), ("x", "f8", (3,)), ("i", "i8"), ("w", "f8", (4,)), ("flag", "?")], align=True)


class InCells:
    """A function of two records, one behind the other, as code for the numbers that they begin with.

    ``varying`` are the words whose numbers may be others in a call.
    """

    def __init__(
        self, function: types.FunctionType, kinds: tuple[Any, Any], start: list[np.ndarray], varying: Collection[int]
    ):
        self.kinds = [np.dtype(kind) for kind in kinds]
        self.cells = Cells(self.words(start), varying)
        places = Place(0), Place(self.kinds[0].itemsize)
        given = [view(place, kind) for place, kind in zip(places, self.kinds, strict=True)]
        unit: Unit | None = None
        while unit is None or self.cells.grown:
            if self.cells.begin() or unit is None:
                unit = Unit("tested", True, cells=self.cells, unrolled=64)
            unit.forget()
            unit.done(function, tuple(map(argument_kind, given)), fused=False)
        self.text = str(self._called(unit, function, given))
        code = llvm.parse_assembly(self.text)
        machine = target_machine()
        optimize(code, machine, llvm.get_process_triple())
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        engine.add_object_file(llvm.ObjectFileRef.from_data(machine.emit_object(code)))
        engine.finalize_object()
        _engines.append(engine)
        self.code = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * self.cells.pointers)(
            engine.get_function_address("tested")
        )

    def _called(self, unit: Unit, function: types.FunctionType, given: list[Value]) -> ir.Module:
        kind = ir.FunctionType(WORD, [POINTER] * self.cells.pointers)
        code = ir.Function(unit.module, kind, "tested")
        at = Emission(unit, function, [""], fused=False)
        at.at = at.entry = ir.IRBuilder(code.append_basic_block())
        at.given = code.args
        unit.call(at, function, given)
        at.at.ret(WORD(0))
        return unit.module

    @staticmethod
    def words(memory: list[np.ndarray]) -> np.ndarray:
        return np.concatenate([np.frombuffer(each.tobytes(), np.int64) for each in memory])

    def __call__(self, memory: list[np.ndarray]) -> int:
        """Call it; records that are no constants change. The others are hidden from it."""
        words, cells = self.words(memory), self.cells
        inside = np.full(len(words), -1)
        for word in range(len(words)):
            if cells.changes(word):
                inside[word] = words[word]
        regions = [words[each.first : each.end].copy() for each in cells.regions]
        before = [each.copy() for each in regions]
        code = self.code(inside.ctypes.data, 0, *(each.ctypes.data for each in regions))
        for word in cells.written:
            words[word] = inside[word]
        for region, now, then in zip(cells.regions, regions, before, strict=True):
            words[region.first : region.end] = now
            assert region.written or (now == then).all()
        at = 0
        for each in memory:
            each.view(np.int64).reshape(-1)[:] = words[at : at + each.nbytes // 8]
            at += each.nbytes // 8
        return code


def compare(
    function: types.FunctionType, kinds: tuple[Any, Any] = (G, STATE), runs: int = 8, vary: bool = True
) -> InCells:
    """Code for one start must leave what plain Python leaves, bit for bit, also of other numbers if they ``vary``, but
    for the integers of the first record, which are constants. Otherwise all is a constant but what is stored."""
    source = np.random.default_rng(3)
    start = arguments(kinds, source)
    fields: Any = start[0].dtype.fields
    n, whole = start[0].nbytes // 8, {fields[name][1] // 8 for name in fields if fields[name][0].kind in "ib"}
    varying = set(range(n + start[1].nbytes // 8)) - whole if vary else set()
    code = InCells(function, kinds, start, varying)
    for _ in range(runs):
        mine = arguments(kinds, source) if vary else [each.copy() for each in start]
        for name in fields:
            if fields[name][1] // 8 in whole:
                mine[0][name] = start[0][name]
        theirs = [each.copy() for each in mine]
        assert code(mine) == 0
        with np.errstate(all="ignore"):
            function(*(as_python(each) for each in theirs))
        for a, b in zip(mine, theirs, strict=True):
            for name in a.dtype.names or ():  # whatever the signs of zeros
                assert_equal(a[name] + 0, b[name] + 0, exact=True, name=name)
    return code


BODIES = {
    "a name bound in a branch": """
x = s.a
if g.k > 0.0:
    x = s.b
x[0] += 1.0
s.c[:] = x
""",
    "a name bound in a branch, all of one": """
if g.x[0] > g.x[1]:
    y = s.a
else:
    y = s.c
y *= 2.0
s.b[1] = y[2]
""",
    "one of three": """
x = s.a if g.k > 0.5 else (s.b if g.k > -0.5 else s.c)
x[:] = g.x
""",
    "names swapped in a loop": """
x, y = s.a, s.b
for _ in range(3):
    x, y = y, x
    x[1] += y[0]
s.c[:] = x - y
""",
    "a name bound in a loop that turns": """
x = s.a
for j in range(abs(g.i) + int(abs(g.k) * 3.0)):
    x[0] += 1.0
    x = s.b if x[0] > 1.0 else s.a
x[2] = 5.0
""",
    "a row in a written-out loop": """
for j in range(4):
    row = s.rows[j]
    row += g.x * g.w[j]
    if row[0] > 2.0:
        break
    s.n += j
""",
    "a row in a loop that turns": """
j = 0
while j < 4:
    row = s.rows[j]
    row[1] = g.w[j]
    j += 1
""",
    "rows of an array": """
for row in s.rows:
    row[0] = row[1] + 1.0
for k, row in enumerate(s.rows):
    if k == 2:
        continue
    s.a += row
""",
    "an early return in a written-out loop": """
for j in range(3):
    if g.x[j] > 0.7:
        return
    s.a[j] = g.x[j]
s.b[0] = 7.0
""",
    "an index at run time": """
j = int(abs(g.k) * 10.0) % 4
s.rows[j, 1] += 1.0
s.rows[j] *= g.w[3 - j]
s.a[j % 3] = s.rows[(j + 1) % 4, 2]
""",
    "an index at run time only to read": """
s.a[0] = g.w[int(abs(g.k) * 10.0) % 4] + g.w[2]
""",
    "a store through a view": """
part = s.rows[1:3]
column = part[:, 1]
column[:] = g.x[:2]
part[1, 2] = 4.0
s.rows[:, 0] = g.w
""",
    "a store in a view after a read at run time": """
j = int(abs(g.k) * 10.0) % 3
s.c[0] = s.a[j]
x = s.a
x[1] = 9.0
s.c[1] = s.a[j]
""",
    "records and places in tuples": """
x, y = chosen(s, g.k)
x[0] = y[1] + g.k
x, y = both(s)
x[2], y[2] = y[1], x[1]
""",
    "a returned place of two": """
x = larger(s.a, s.b)
x[0] += 3.0
larger(s.a, s.c)[1] = 2.0
""",
    "what is off": """
if g.on == 0:
    s.a[0] = 1.0
elif g.flag:
    s.a[1] = 2.0
for _ in range(abs(g.on)):
    s.b[0] += 1.0
""",
    "a number that is first read, then stored": """
s.a[0] += s.b[0]
s.b[0] = s.n
s.n += 1
if s.n > 2:
    s.c[0] = s.n
""",
    "a number that functions read and store": """
s.a[0] = first(s)
advance(s)
s.a[1] = first(s)
""",
    "a mask, and copies": """
x = s.a.copy()
s.a[s.a > 0.0] = 0.5
s.b[:] = s.b[::-1]
s.c[:] = np.where(x > g.x, x, s.c)
""",
}
NAMES = """import numpy as np

def chosen(s, k):
    if k > 0.0:
        return s.a, s.b
    return s.c, s.a

def both(s):
    return s.a, s.b

def first(s):
    return s.b[0]

def advance(s):
    s.b[0] += 1.0

def larger(x, y):
    if x[0] > y[0]:
        return x
    return y

"""


def of_body(body: str) -> types.FunctionType:
    indented = "\n".join(f"    {line}" for line in body.strip().splitlines())
    return defined(f"{NAMES}def tested(g, s):\n{indented}\n", {})


@pytest.mark.parametrize("vary", [True, False])
@pytest.mark.parametrize("what", BODIES)
def test_it_is_what_plain_python_gives(what, vary):
    compare(of_body(BODIES[what]), vary=vary)


def test_a_number_that_nobody_changes_is_a_constant():
    code = compare(function_of("g, s", "s.a[0] = g.k * 3.0\nif g.k < 1e9:\n    s.b[0] = 1.0", {}), vary=False)
    assert "load" not in code.text
    assert code.cells.written == {G.itemsize // 8, G.itemsize // 8 + 3}


def test_an_array_that_is_only_read_by_an_index_stays_as_it_is():
    code = compare(of_body(BODIES["an index at run time only to read"]))
    assert [each.written for each in code.cells.regions] == [False]


def test_an_index_out_of_bounds_ends_early():
    function = function_of("g, s", "s.a[int(g.k)] = 1.0", {})
    memory = [np.zeros(1, G), np.zeros(1, STATE)]
    memory[0]["k"] = 2.0
    code = InCells(function, (G, STATE), memory, {1})
    assert code(memory) == 0
    assert memory[1]["a"][0].tolist() == [0.0, 0.0, 1.0]
    memory[0]["k"] = 3.0
    assert code(memory) != 0


def random_programs(seeds: range) -> None:
    some = 0
    for seed in seeds:
        program = defined(Writer(random.Random(seed)).program(), {})
        try:
            compare(program, (GIVEN, OUT), runs=3, vary=seed % 2 == 0)
        except Lacking:  # the language has not all of it
            continue
        some += 1
    assert some > len(seeds) // 3


def test_a_random_program_is_what_plain_python_gives():
    random_programs(range(4))


@pytest.mark.slow
def test_random_programs_are_what_plain_python_gives():
    random_programs(range(4, 40))
