"""The code of a fleet: many runs of one scenario, each with numbers of its own, one thread a run.

It is the loop of free_body with its stages, translated for the record that the runs begin with
(:mod:`uvms_mj.compiler.cells`). A thread copies the words that are its run's own from a table to cells, takes all steps,
and copies back those that the next step needs. Word k of run i is at k * stride + i in the table, so that neighbouring
threads read neighbouring words.

An entry of the code is a function of the table, of the rooms behind the record, of a table for the signals, of the
number of runs, of the stride and of the number of steps. On a GPU it is a kernel. For this processor it is a function
that has the number of the run as a last argument: it computes what the GPU computes, and needs none.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir

from ...compiler.cells import Cells
from ...compiler.emission import Emission
from ...compiler.targets import Target, optimize
from ...compiler.unit import Unit
from ...compiler.values import INT, POINTER, WORD, Kind, Place, Value, scalar, view, whole
from ...physics.kernels import kernel
from . import memory
from .intrinsics import INTRINSICS, records_of
from .loop import complete_step, finish_step, flow_again, free_step, observe, observe_anew, run_every_stage, run_stages
from .pipeline import CompiledStage
from .record import STOP_NONE, Shape, run_dtype, with_numbers
from .user_stage import between_copies

STEPS, AHEAD, END = "uvms_mj_fleet_steps", "uvms_mj_fleet_ahead", "uvms_mj_fleet_end"
"""The entries: take steps; give the signals of the instant in hand; give them with the row of this instant."""
_UNROLLED = 64
_PASSES = 12


@kernel
def _steps(run, n):
    for _ in range(n):
        if not free_step(run, 1):
            return
        complete_step(run)


@kernel
def _ahead(run, control):
    observe(run)
    if run.stop == STOP_NONE:
        flow_again(run)
        run_stages(run, control)


@kernel
def _end(run, control):
    if free_step(run, 0):
        complete_step(run)


@kernel
def _finished(run):
    """Each step of a fleet is complete when the next one begins."""


_INSTEAD = {run_stages: run_every_stage, observe: observe_anew, finish_step: _finished}
"""What a fleet has in place of functions that look what Python has done between two steps."""
_ENTRIES: Mapping[str, Callable] = {STEPS: _steps, AHEAD: _ahead, END: _end}


@dataclass
class FleetCode:
    """The code of a fleet for a target.

    Attributes:
        code: of the target: PTX, or an object file.
        kept: the words of the record that the table has, in its order.
        carried: how many of them, the first ones, change in a step; the others are only read.
        signals: the words of the record that the table of signals has.
        constants, words: how many words of the record are constants of the code, of how many that it reads.
        rooms: whether it reads the tables behind the record.
    """

    code: bytes
    kept: list[int]
    carried: int
    signals: list[int]
    constants: int
    words: int
    rooms: bool


@dataclass
class FleetSource:
    """What the code of a fleet is made of.

    Attributes:
        shape, stages: of the runs.
        template: the bytes of the records of one of them at its start.
        varying: the words in which the others differ from it.
        signals: the words of the record to give.
        control: index of the law among the stages.
        library: functions of the C library, as in :class:`uvms_mj.compiler.emission.Module`.
    """

    shape: Shape
    stages: Sequence[CompiledStage]
    template: np.ndarray
    varying: Sequence[int]
    signals: Sequence[int]
    control: int
    library: str = ""
    cells: Cells = field(init=False)

    def __post_init__(self) -> None:
        self.run = run_dtype(self.shape)
        template = self.template.copy()
        record = template[: self.run.itemsize].view(self.run)
        record["address"] = 0
        for number in range(len(self.stages)):
            record["stages"]["code_at"][0, number] = number + 1
        self.cells = Cells(template, self.varying)

    # translation

    def functions(self) -> llvm.ModuleRef:
        """The entries as functions of the pointers of the cells and of a number, in one module. Raises Untranslatable
        for a stage that uses what they lack."""
        for _ in range(_PASSES):
            self.cells.begin()
            texts = self._translated()
            if not self.cells.grown:
                break
        module = llvm.parse_assembly(texts[0])
        for text in texts[1:]:
            module.link_in(llvm.parse_assembly(text))
        for function in module.functions:
            if not function.is_declaration and function.name not in _ENTRIES:
                function.linkage = "internal"
        return module

    def _translated(self) -> list[str]:
        symbols = [f"uvms_mj_stage_{k}" for k in range(len(self.stages))]
        calls = {memory.call_code: self._call_stage(symbols)}
        unit = self._unit("kernels", INTRINSICS | calls)
        run = Kind(with_numbers(self.run))
        for name, function in _ENTRIES.items():
            at = self._entry(unit, function, name, [WORD])
            n = scalar(at.at.function.args[-1], INT) if name == STEPS else whole(self.control)
            unit.call(at, function, [Value(run, (Place(0),)), n])
            at.at.ret(WORD(0))
        texts = [str(unit.module)]
        for symbol, stage in zip(symbols, self.stages, strict=True):
            if stage.users:
                texts.append(self._users_stage(symbol, stage))
        return texts

    def _unit(self, name: str, intrinsics: Mapping[Any, Any], checked: bool = False) -> Unit:
        return Unit(
            name, checked, intrinsics, library=self.library, cells=self.cells, unrolled=_UNROLLED,
            instead=_INSTEAD,
        )  # fmt: skip

    def _entry(self, unit: Unit, function: Any, name: str, further: Sequence[ir.Type]) -> Emission:
        """Where to write the code of a function of the pointers of the cells."""
        kind = ir.FunctionType(WORD, [POINTER] * self.cells.pointers + [*further])
        code = ir.Function(unit.module, kind, name)
        code.attributes.add("alwaysinline")
        at = Emission(unit, function, [""], fused=False)
        at.at = at.entry = ir.IRBuilder(code.append_basic_block())
        at.given = code.args[: self.cells.pointers]
        return at

    def _call_stage(self, symbols: Sequence[str]) -> Any:
        """A call of a stage by its number, 1 for the first one."""

        def call(at: Emission, arguments: Sequence[ir.Value]) -> Value:
            number, *addresses = (argument.constant for argument in arguments)
            stage = self.stages[number - 1]
            if stage.users:
                kind = ir.FunctionType(WORD, [POINTER] * self.cells.pointers)
                symbol = symbols[number - 1]
                code = at.at.module.globals.get(symbol) or ir.Function(at.at.module, kind, symbol)
                return scalar(at.at.call(code, at.given), INT)
            settings, state, given, out = stage.kinds
            kinds = (settings, state, given, state, out)
            places = [view(Place(address), kind) for address, kind in zip(addresses, kinds, strict=True)]
            at.unit.call(at, type(stage.stage).function(), places)
            return whole(0)

        return call

    def _users_stage(self, symbol: str, stage: CompiledStage) -> str:
        function, records = between_copies(type(stage.stage).function(), stage.stage.room, stage.kinds)
        unit = self._unit(symbol, INTRINSICS | records_of(records), checked=True)
        at = self._entry(unit, function, symbol, [])
        places = [stage.places[name] for name in ("settings", "state", "given", "state_dot", "out")]
        unit.call(at, function, [whole(8 * place) for place in places])
        at.at.ret(WORD(0))
        return str(unit.module)

    # threads

    def emitted(self, target: Target, ptx: bool) -> FleetCode:
        """The code for a target."""
        module = self.functions()
        cells = self.cells
        carried = sorted(self._carried(module))
        of_regions = {word for region in cells.regions for word in range(region.first, region.end)}
        varying = sorted(word for word in cells.varying if (word in cells.used or word in of_regions))
        kept = carried + [word for word in varying if word not in set(carried)]
        threads = _Threads(self, module.name, kept, len(carried), ptx)
        module.link_in(llvm.parse_assembly(threads.text()))
        for function in module.functions:
            if not function.is_declaration and function.name in _ENTRIES:
                function.linkage = "internal"
        words = cells.used | of_regions
        constants = len(words - cells.written - cells.varying - of_regions)
        return FleetCode(target.code(module), kept, len(carried), [*self.signals], constants, len(words), cells.rooms)

    def _carried(self, module: llvm.ModuleRef) -> set[int]:
        """The words that a step needs from the step before, or the signals need."""
        cells = self.cells
        own = cells.written | {word for r in cells.regions if r.written for word in range(r.first, r.end)}
        flows = {name: _Flow(self, module, name, own) for name in _ENTRIES}
        needed = {word for name in (AHEAD, END) for word in flows[name].needs({*self.signals} | self._stop())}
        needed = (needed | self._stop()) & own
        while True:
            more = (needed | flows[STEPS].needs(needed)) & own
            if more == needed:
                return needed | {word for r in cells.regions if r.written for word in range(r.first, r.end)}
            needed = more

    def _stop(self) -> set[int]:
        """The words that say whether a run has stopped, and at which step."""
        fields: Any = self.run.fields
        return {fields[name][1] // 8 for name in ("stop", "stop_index", "stop_value", "step", "pending")}


class _Threads:
    """The entries with a thread's way from and to the tables around them, as LLVM's text."""

    def __init__(self, source: FleetSource, name: str, kept: Sequence[int], carried: int, ptx: bool) -> None:
        self.source, self.kept, self.carried, self.ptx = source, kept, carried, ptx
        self.module = ir.Module(f"{name} threads")

    def text(self) -> str:
        for name in _ENTRIES:
            self._thread(name)
        text = str(self.module)
        if self.ptx:
            text = text.replace("define void @", "define ptx_kernel void @")
        return text

    def _thread(self, name: str) -> None:
        cells = self.source.cells
        last = [] if self.ptx else [WORD]
        kind = ir.FunctionType(ir.VoidType(), [POINTER, POINTER, POINTER, WORD, WORD, WORD, *last])
        code = ir.Function(self.module, kind, f"{name}_threads")
        for argument in code.args[:3]:
            argument.add_attribute("noalias")
        at = ir.IRBuilder(code.append_basic_block())
        table, rooms, signals, runs, stride, n = code.args[:6]
        i = self._index(at) if self.ptx else code.args[6]
        inner = ir.Function(
            self.module, ir.FunctionType(WORD, [POINTER] * cells.pointers + [WORD]), name
        )
        place = prepared(at, self.module, cells)  # where LLVM moves memory to registers: in the first block
        with at.if_then(at.icmp_signed("<", i, runs)):

            def of_table(k: int, base: ir.Value) -> ir.Value:
                index = at.add(at.mul(stride, WORD(k)), i)
                return at.gep(base, [index], source_etype=WORD)

            for k, word in enumerate(self.kept):
                at.store(at.load(of_table(k, table), align=8, typ=WORD), place.of(at, word), align=8)
            at.call(inner, [*place.pointers(rooms), n])
            if name == STEPS:
                for k, word in enumerate(self.kept[: self.carried]):
                    at.store(at.load(place.of(at, word), typ=WORD, align=8), of_table(k, table), align=8)
            else:
                stop = at.load(place.of(at, stop_word(self.source)), typ=WORD)
                with at.if_then(at.icmp_signed("==", stop, WORD(STOP_NONE))):
                    for k, word in enumerate(self.source.signals):
                        at.store(at.load(place.of(at, word), typ=WORD, align=8), of_table(k, signals), align=8)
        at.ret_void()

    def _index(self, at: ir.IRBuilder) -> ir.Value:
        """The number of a thread."""
        read = []
        for register in ("ctaid.x", "ntid.x", "tid.x"):
            kind = ir.FunctionType(ir.IntType(32), [])
            symbol = f"llvm.nvvm.read.ptx.sreg.{register}"
            function = self.module.globals.get(symbol) or ir.Function(self.module, kind, symbol)
            read.append(at.zext(at.call(function, []), WORD))
        return at.add(at.mul(read[0], read[1]), read[2])


def stop_word(source: FleetSource) -> int:
    """The word that says why a run has stopped."""
    fields: Any = source.run.fields
    return fields["stop"][1] // 8


@dataclass
class prepared:  # noqa: N801  # made where the code is
    """The cells and the regions of a thread, with the numbers of the template."""

    at: ir.IRBuilder
    module: ir.Module
    cells: Cells

    def __post_init__(self) -> None:
        at, cells = self.at, self.cells
        words = cells.template[: len(cells.template) // 8 * 8].view(np.int64)
        self.memory = at.alloca(ir.ArrayType(WORD, len(words)))
        self.memory.type = POINTER
        self.regions = list[ir.Value]()
        for k, region in enumerate(cells.regions):
            kind = ir.ArrayType(WORD, region.end - region.first)
            numbers = words[region.first : region.end].tolist()
            name = f"uvms_mj_region_{k}"
            constant = self.module.globals.get(name) or ir.GlobalVariable(self.module, kind, name)
            if constant.initializer is None:
                constant.linkage, constant.global_constant, constant.initializer = "internal", True, kind(numbers)
                constant.type = POINTER
            if region.written or any(region.first <= word < region.end for word in cells.varying):
                own = at.alloca(kind)
                own.type = POINTER
                for j, number in enumerate(numbers):
                    at.store(WORD(number), at.gep(own, [WORD(8 * j)], source_etype=ir.IntType(8)))
                self.regions.append(own)
            else:
                self.regions.append(constant)
        inside = {word for region in cells.regions for word in range(region.first, region.end)}
        for word in sorted((cells.written | (cells.varying & cells.used)) - inside):
            at.store(WORD(int(words[word])), self.of(at, word))

    def of(self, at: ir.IRBuilder, word: int) -> ir.Value:
        """The pointer to a word."""
        for region, pointer in zip(self.cells.regions, self.regions, strict=True):
            if region.first <= word < region.end:
                return at.gep(pointer, [WORD(8 * (word - region.first))], source_etype=ir.IntType(8))
        return at.gep(self.memory, [WORD(8 * word)], source_etype=ir.IntType(8))

    def pointers(self, rooms: ir.Value) -> list[ir.Value]:
        return [self.memory, rooms, *self.regions]


class _Flow:
    """Which words at the end of an entry depend on which words at its begin, from its optimized code."""

    def __init__(self, source: FleetSource, module: llvm.ModuleRef, name: str, own: set[int]) -> None:
        probe = ir.Module("probe")
        kind = ir.FunctionType(ir.VoidType(), [POINTER, POINTER, POINTER, WORD])
        code = ir.Function(probe, kind, "probe")
        for argument in code.args[:3]:
            argument.add_attribute("noalias")
        at = ir.IRBuilder(code.append_basic_block())
        inner = ir.Function(probe, ir.FunctionType(WORD, [POINTER] * source.cells.pointers + [WORD]), name)
        place = prepared(at, probe, source.cells)
        before, after, rooms, n = code.args
        for word in sorted(own):
            at.store(at.load(_at(at, before, word), typ=WORD), place.of(at, word))
        at.call(inner, [*place.pointers(rooms), n])
        end = code.append_basic_block()
        if name == STEPS:
            at.branch(end)
        else:  # signals are given only by a run that has not stopped
            given = code.append_basic_block()
            stop = at.load(place.of(at, stop_word(source)), typ=WORD)
            at.cbranch(at.icmp_signed("==", stop, WORD(STOP_NONE)), given, end)
            at.position_at_end(given)
        for word in sorted(own):
            if name == STEPS:
                at.position_at_end(end)
            at.store(at.load(place.of(at, word), typ=WORD), _at(at, after, word))
        if name != STEPS:
            at.branch(end)
            at.position_at_end(end)
        at.ret_void()
        whole_module = llvm.parse_assembly(str(module))
        whole_module.link_in(llvm.parse_assembly(str(probe)))
        for function in whole_module.functions:
            if not function.is_declaration and function.name != "probe":
                function.linkage = "internal"
        here = llvm.Target.from_default_triple().create_target_machine()
        optimize(whole_module, here, llvm.get_default_triple(), 2)
        self._read(str(whole_module.get_function("probe")))

    def _read(self, text: str) -> None:
        self._uses: dict[str, set[str]] = {}
        self._roots: set[str] = set()
        self._loads: dict[str, int] = {}
        self._stores: dict[int, set[str]] = {}
        places: dict[str, tuple[str, int]] = {"%0": ("in", 0), "%1": ("out", 0)}
        names = re.search(r"define .*?@probe\(([^)]*(?:\([^)]*\)[^)]*)*)\)", text)
        assert names is not None
        given = re.findall(r"%[\w.\"]+(?=[,)]|$)", names[1])
        places = {given[0]: ("in", 0), given[1]: ("out", 0)}
        for line in text.splitlines():
            line = line.split(" !")[0].strip()
            made = re.match(r"(%[\w.\"]+) = (.*)", line)
            what = made[2] if made else line
            operands = set(re.findall(r"%[\w.\"]+", what))
            if made and (found := re.match(r"getelementptr .*?i8, ptr (%[\w.\"]+), i64 (-?\d+)$", what)) and (
                found[1] in places
            ):
                side, offset = places[found[1]]
                places[made[1]] = side, offset + int(found[2])
            elif made and (found := re.match(r"load \w+, ptr (%[\w.\"]+)", what)) and found[1] in places:
                self._loads[made[1]] = places[found[1]][1] // 8
            elif (found := re.match(r"store \w+ ([^,]+), ptr (%[\w.\"]+)", what)) and found[2] in places:
                if found[1].startswith("%"):
                    self._stores.setdefault(places[found[2]][1] // 8, set()).add(found[1])
            elif made:
                self._uses[made[1]] = operands
                if " call " in f" {what}" or what.startswith(("load", "call", "tail call")):
                    self._roots |= operands
            elif not line.startswith(("define", "br label")):
                self._roots |= operands

    def why(self, word, words):
        for w in sorted(words):
            if word in self.needs_of(self._stores.get(w, ())): return w
        return "roots" if word in self.needs_of(self._roots) else None

    def needs_of(self, names):
        todo, seen, found = list(names), set(), set()
        while todo:
            name = todo.pop()
            if name in seen: continue
            seen.add(name)
            if name in self._loads: found.add(self._loads[name])
            todo += self._uses.get(name, ())
        return found

    def needs(self, words: set[int]) -> set[int]:
        """The words at the begin of which those at the end, and the way of the code, depend on."""
        todo = [*self._roots, *(name for word in words for name in self._stores.get(word, ()))]
        seen, found = set[str](), set[int]()
        while todo:
            name = todo.pop()
            if name in seen:
                continue
            seen.add(name)
            if name in self._loads:
                found.add(self._loads[name])
            todo += self._uses.get(name, ())
        return found


def _at(at: ir.IRBuilder, pointer: ir.Value, word: int) -> ir.Value:
    return at.gep(pointer, [WORD(8 * word)], source_etype=ir.IntType(8))
