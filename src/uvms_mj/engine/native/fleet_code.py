"""The code of a fleet: many runs of one scenario, each with numbers of its own, one thread a run.

It is the loop of free_body with its stages, translated for the record that the runs begin with
(:mod:`uvms_mj.compiler.cells`). A thread copies the words that are its run's own from a table to cells, takes all
steps, and copies back the words that the next step needs. Word k of run i is at k * stride + i in the table, so that
neighbouring threads read neighbouring words.

An entry of the code is a function of the table, of the rooms behind the record, of a table for the signals, of the
number of runs, of the stride and of a number: of steps, or whether to evaluate the whole instant. On a GPU it is a
kernel. For this processor it is a function of the first run and of the run behind the last one, too: it computes the
same numbers as the GPU, and needs none.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir

from ...compiler.cells import Cells, Region
from ...compiler.emission import Emission
from ...compiler.targets import Target, inline_libm
from ...compiler.unit import Unit
from ...compiler.values import BYTE, INT, POINTER, WORD, Kind, Place, Value, argument_kind, scalar, view, whole
from . import memory
from .intrinsics import INTRINSICS, records_of
from .loop import (
    finish_step,
    finished,
    fleet_look,
    fleet_steps,
    observe,
    observe_anew,
    run_every_stage,
    run_stages,
)
from .pipeline import CompiledStage
from .record import STOP_NONE, Shape, with_numbers
from .user_stage import between_copies

STEPS, LOOK = "uvms_mj_fleet_steps", "uvms_mj_fleet_look"
"""The entries: take steps; give the signals of the instant in hand, with the row of this instant or without."""
_UNROLLED = 64
_FEW = 128
"""Words of a region that a thread copies one by one. A larger one stays in the table."""


_INSTEAD = {run_stages: run_every_stage, observe: observe_anew, finish_step: finished}
"""The fleet's counterpart of functions that look for changes by Python between two steps."""
ENTRIES: Mapping[str, int] = {STEPS: 1, LOOK: 0}
"""How much LLVM optimizes each entry. A look is called seldom, and its code is as long as a step's."""


@dataclass
class FleetCode:
    """The code of a fleet for a target.

    Attributes:
        code: of the target: PTX, or an object file.
        kept: the words of the record that the table has, in its order.
        carried: how many of them, the first ones, change in a step; the others are only read.
        apart: how many of them, the last ones, lie one after the other for each run, behind the rows of the others:
            regions, and as much memory again for an instant in hand.
        signals: the words of the record that the table of signals has.
        constants, words: how many words of the record are constants of the code, of how many that it uses.
    """

    code: bytes
    kept: list[int]
    carried: int
    apart: int
    signals: list[int]
    constants: int
    words: int


def without_addresses(template: np.ndarray, shape: Shape, stages: int) -> np.ndarray:
    """A copy of the bytes of a run's records, which begin at 0, with the numbers of the stages, 1 for the first one, in
    place of the addresses of their code."""
    template = template.copy()
    kind = shape.layout
    record = template[: kind.itemsize].view(kind)
    record["address"] = 0
    record["stages"]["code_at"][0, :stages] = range(1, stages + 1)
    return template


@dataclass
class FleetSource:
    """The parts of a fleet's code.

    Attributes:
        shape, stages: of the runs.
        template: the bytes of the records of one of them at its start.
        varying: the words in which the others differ from it.
        signals: the words of the record to give.
        given: words that the caller sets between steps.
        control: index of the law among the stages.
    """

    shape: Shape
    stages: Sequence[CompiledStage]
    template: np.ndarray
    varying: Sequence[int]
    signals: Sequence[int]
    control: int
    given: Sequence[int] = ()
    cells: Cells = field(init=False)
    _trees: dict = field(default_factory=dict, init=False)  # each function is translated some times

    def __post_init__(self) -> None:
        self.run = self.shape.layout
        template = without_addresses(self.template, self.shape, len(self.stages))
        self.cells = Cells(template, {*self.varying, *self.given})
        self.cells.used |= {*self.signals}

    # translation

    def functions(self) -> llvm.ModuleRef:
        """The entries as functions of the pointers of the cells and of a number, in one module. Raises Untranslatable
        for a stage that uses what they lack."""
        parts = list[_Part]()
        while not parts or self.cells.grown:  # what grows is bounded by the record
            if self.cells.begin() or not parts:
                parts = self._parts()
            for part in parts:
                part.unit.forget()
            for part in parts:
                part.unit.done(part.function, part.kinds, fused=False)
        for part in parts:
            self._enter(part)
        modules = dict.fromkeys(part.unit.module for part in parts)
        module, *others = (llvm.parse_assembly(str(each)) for each in modules)
        for other in others:
            module.link_in(other)
        inline_libm(module)
        return module

    def _parts(self) -> list["_Part"]:
        """The entries and the users' stages that they call. Nothing is translated yet."""
        symbols = [f"uvms_mj_stage_{k}" for k in range(len(self.stages))]
        unit = self._unit("kernels", INTRINSICS | {memory.call_code: self._call_stage(symbols)})
        run, law = Value(Kind(with_numbers(self.run)), (Place(0),)), whole(self.control)
        entries = [_Part(unit, STEPS, fleet_steps, [run], 1), _Part(unit, LOOK, fleet_look, [run, law], 1)]
        users = [(symbol, stage) for symbol, stage in zip(symbols, self.stages, strict=True) if stage.users]
        return [*entries, *(self._users_stage(symbol, stage) for symbol, stage in users)]

    def _unit(self, name: str, intrinsics: Mapping[Any, Any], checked: bool = False) -> Unit:
        unit = Unit(
            name, checked, intrinsics, cells=self.cells, unrolled=_UNROLLED,
            instead=_INSTEAD,
        )  # fmt: skip
        unit.trees = self._trees
        return unit

    def _enter(self, part: "_Part") -> None:
        """Write the function of the pointers of the cells, and of numbers, that calls a part."""
        kind = ir.FunctionType(WORD, [POINTER] * self.cells.pointers + [WORD] * part.numbers)
        code = ir.Function(part.unit.module, kind, part.symbol)
        code.attributes.add("alwaysinline")
        at = Emission(part.unit, part.function, [""], fused=False)
        at.at = at.entry = ir.IRBuilder(code.append_basic_block())
        at.given = code.args[: self.cells.pointers]
        numbers = [scalar(each, INT) for each in code.args[self.cells.pointers :]]
        part.unit.call(at, part.function, [*part.known, *numbers])
        at.at.ret(WORD(0))

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

    def _users_stage(self, symbol: str, stage: CompiledStage) -> "_Part":
        function, records = between_copies(type(stage.stage).function(), stage.stage.room, stage.kinds)
        unit = self._unit(symbol, INTRINSICS | records_of(records), checked=True)
        places = [stage.places[name] for name in ("settings", "state", "given", "state_dot", "out")]
        return _Part(unit, symbol, function, [whole(8 * place) for place in places])

    # threads

    def emitted(self, target: Target) -> FleetCode:
        """The code for a target, a kernel if it is a GPU. Raises Untranslatable as :meth:`functions`."""
        functions, cells = str(self.functions()), self.cells
        apart = cells.words_of_regions(self.is_apart)
        carried = sorted(self._carried(functions) - apart)
        used = cells.used | cells.words_of_regions(lambda region: True)
        varying = sorted((cells.varying & used) - {*carried, *apart}) + sorted(set(self.given) - used)
        kept = [*carried, *varying]
        threads = _Threads(self, kept, len(carried), target.assembly)
        module, look = (
            target.optimized(_around(functions, threads.text(name)), level) for name, level in ENTRIES.items()
        )
        module.link_in(look)
        constants = len(used - cells.written - cells.varying - cells.words_of_regions(lambda region: region.written))
        rooms = 2 * sorted(apart)
        return FleetCode(
            target.emitted(module), kept + rooms, len(carried), len(rooms), [*self.signals], constants, len(used)
        )

    def is_apart(self, region: Region) -> bool:
        """Whether a region is each run's own, and too large to be copied."""
        return region.end - region.first > _FEW and self.cells.is_own(region)

    def _carried(self, module: str) -> set[int]:
        """The words that a step needs from the step before, or the signals need from the last step."""
        cells = self.cells
        regions = cells.words_of_regions(lambda region: region.written)
        own = cells.written | regions
        known = cells.written | cells.words_of_regions(lambda region: region.written and not self.is_apart(region))
        flows = _flows(self, module, known)
        stops = {self._word(name) for name in ("stop", "stop_index", "stop_value", "step")}
        needed = flows[LOOK].needs({*self.signals} | stops) | stops
        while True:
            more = (needed | flows[STEPS].needs(needed)) & own
            if more == needed:
                return needed | regions
            needed = more

    def _word(self, name: str) -> int:
        """The word of a field of the record of a run."""
        fields: Any = self.run.fields
        return fields[name][1] // 8

    @property
    def stop(self) -> int:
        """The word that says why a run has stopped."""
        return self._word("stop")


@dataclass
class _Part:
    """A function that is called from outside of its unit.

    Attributes:
        known: its first arguments, which are known when compiling.
        numbers: how many whole numbers it is given behind them.
    """

    unit: Unit
    symbol: str
    function: Any
    known: Sequence[Value]
    numbers: int = 0

    @property
    def kinds(self) -> tuple[Kind, ...]:
        return (*map(argument_kind, self.known), *[Kind(INT)] * self.numbers)


class _Threads:
    """A thread's way from and to the tables around an entry, as LLVM's text."""

    def __init__(self, source: FleetSource, kept: Sequence[int], carried: int, ptx: bool) -> None:
        self.source, self.kept, self.carried, self.ptx = source, kept, carried, ptx

    def text(self, name: str) -> str:
        """The module of an entry."""
        self.module = ir.Module(name)
        self._thread(name) if self.ptx else self._all(name)
        text = str(self.module)
        return text.replace("define void @", "define ptx_kernel void @") if self.ptx else text

    def _thread(self, name: str) -> None:
        """The kernel of a GPU: the run of this thread."""
        code, at = self._begun(name, [])
        memory = _Memory(at, self.module, self.source)
        run = self._number(at)
        with at.if_then(at.icmp_signed("<", run, code.args[3])):
            self._run(at, name, memory, run, code.args)
        at.ret_void()

    def _all(self, name: str) -> None:
        """The function of this processor: the runs from one to another, one after the other."""
        code, at = self._begun(name, [WORD, WORD])
        memory, entry = _Memory(at, self.module, self.source), at.block
        test, inside, end = (at.append_basic_block() for _ in range(3))
        at.branch(test)
        at.position_at_end(test)
        run = at.phi(WORD)
        run.add_incoming(code.args[6], entry)
        at.cbranch(at.icmp_signed("<", run, code.args[7]), inside, end)
        at.position_at_end(inside)
        self._run(at, name, memory, run, code.args)
        run.add_incoming(at.add(run, WORD(1)), at.block)
        at.branch(test)
        at.position_at_end(end)
        at.ret_void()

    def _begun(self, name: str, further: Sequence[ir.Type]) -> tuple[ir.Function, ir.IRBuilder]:
        kind = ir.FunctionType(ir.VoidType(), [POINTER, POINTER, POINTER, WORD, WORD, WORD, *further])
        code = ir.Function(self.module, kind, symbol_of(name))
        for argument in code.args[:3]:
            argument.add_attribute("noalias")
        return code, ir.IRBuilder(code.append_basic_block())

    def _run(self, at: ir.IRBuilder, name: str, memory: "_Memory", run: ir.Value, given: Sequence[ir.Value]) -> None:
        """One run: from the table, the entry, and to the table of its results."""
        table, rooms, signals, _, stride, n = given[:6]
        memory.place_apart(at, table, at.mul(stride, WORD(len(self.kept))), run)
        if name != STEPS:
            memory.copy_apart(at)
        memory.start(at)

        def of_table(k: int, base: ir.Value) -> ir.Value:
            return at.gep(base, [at.add(at.mul(stride, WORD(k)), run)], source_etype=WORD)

        for k, word in enumerate(self.kept):
            at.store(at.load(of_table(k, table), align=8, typ=WORD), memory.of(at, word), align=8)
        kind = ir.FunctionType(WORD, [POINTER] * self.source.cells.pointers + [WORD])
        inner = self.module.globals.get(name) or ir.Function(self.module, kind, name)
        at.call(inner, [*memory.pointers(rooms), n])
        if name == STEPS:
            results = [(k, table, word) for k, word in enumerate(self.kept[: self.carried])]
            self._store(at, memory, results, of_table)
            return
        stop = at.load(memory.of(at, self.source.stop), typ=WORD, align=8)
        with at.if_then(at.icmp_signed("==", stop, WORD(STOP_NONE))):
            self._store(at, memory, [(k, signals, w) for k, w in enumerate(self.source.signals)], of_table)

    @staticmethod
    def _store(at: ir.IRBuilder, memory: "_Memory", results: Sequence[tuple], of_table: Callable) -> None:
        for k, base, word in results:
            at.store(at.load(memory.of(at, word), typ=WORD, align=8), of_table(k, base), align=8)

    def _number(self, at: ir.IRBuilder) -> ir.Value:
        """The number of this thread."""
        read = []
        for register in ("ctaid.x", "ntid.x", "tid.x"):
            kind = ir.FunctionType(ir.IntType(32), [])
            symbol = f"llvm.nvvm.read.ptx.sreg.{register}"
            function = self.module.globals.get(symbol) or ir.Function(self.module, kind, symbol)
            read.append(at.zext(at.call(function, []), WORD))
        return at.add(at.mul(read[0], read[1]), read[2])


def symbol_of(entry: str) -> str:
    """The symbol of an entry of the code."""
    return f"{entry}_threads"


class _Memory:
    """The cells and the regions of one run, where code begins. ``apart`` are the pointers to the large regions, if they
    are known already."""

    def __init__(
        self, at: ir.IRBuilder, module: ir.Module, source: FleetSource, apart: Mapping[int, ir.Value] | None = None
    ) -> None:
        self.source, self.cells = source, source.cells
        self.words = self.cells.template[: len(self.cells.template) // 8 * 8].view(np.int64)
        self.cells_at = at.alloca(ir.ArrayType(WORD, len(self.words)))
        self.cells_at.align = 8
        self.cells_at.type = POINTER
        given = apart or {}
        self.regions: list[Any] = [given.get(k) or self._region(at, module, k) for k in range(len(self.cells.regions))]

    def _region(self, at: ir.IRBuilder, module: ir.Module, k: int) -> ir.Value | None:
        """The memory of a region: its run's own, or of all if it is only read and the same for all. None of a large
        one, which is in the table."""
        region, name = self.cells.regions[k], f"uvms_mj_region_{k}"
        kind = ir.ArrayType(WORD, region.end - region.first)
        if self.source.is_apart(region):
            return None
        if self.cells.is_own(region):
            own = at.alloca(kind)
            own.align, own.type = 8, POINTER
            return own
        constant = module.globals.get(name)
        if constant is None:
            constant = ir.GlobalVariable(module, kind, name)
            constant.linkage, constant.global_constant, constant.align = "internal", True, 8
            constant.initializer = kind(self.words[region.first : region.end].tolist())
            constant.type = POINTER
        return constant

    def place_apart(self, at: ir.IRBuilder, table: ir.Value, begin: ir.Value, run: ir.Value) -> None:
        """Set the pointers to the large regions of a run, which are in the table from the word ``begin`` on."""
        large = [k for k, region in enumerate(self.cells.regions) if self.source.is_apart(region)]
        sizes = {k: self.cells.regions[k].end - self.cells.regions[k].first for k in large}
        self.size = sum(sizes.values())
        first = at.add(begin, at.mul(run, WORD(2 * self.size)))
        self.apart = at.gep(table, [first], source_etype=WORD)
        for k in large:
            self.regions[k] = at.gep(table, [first], source_etype=WORD)
            first = at.add(first, WORD(sizes[k]))

    def copy_apart(self, at: ir.IRBuilder) -> None:
        """Let what follows change a copy of the large regions."""
        if not self.size:
            return
        begin, test, inside, end = at.block, *(at.append_basic_block() for _ in range(3))
        at.branch(test)
        at.position_at_end(test)
        k = at.phi(WORD)
        k.add_incoming(WORD(0), begin)
        at.cbranch(at.icmp_signed("<", k, WORD(self.size)), inside, end)
        at.position_at_end(inside)
        copy = at.gep(self.apart, [at.add(k, WORD(self.size))], source_etype=WORD)
        at.store(at.load(at.gep(self.apart, [k], source_etype=WORD), typ=WORD, align=8), copy, align=8)
        k.add_incoming(at.add(k, WORD(1)), inside)
        at.branch(test)
        at.position_at_end(end)
        for number, region in enumerate(self.cells.regions):
            if self.source.is_apart(region):
                self.regions[number] = at.gep(self.regions[number], [WORD(self.size)], source_etype=WORD)

    def start(self, at: ir.IRBuilder) -> None:
        """Set all words that are no constants to the words of the template, but not in large regions."""
        cells = self.cells
        own = cells.words_of_regions(lambda region: cells.is_own(region) and not self.source.is_apart(region))
        every = cells.words_of_regions(lambda region: True)
        changing = cells.written | (cells.varying & cells.used)
        for word in sorted(own | ({*changing, *self.source.signals} - every)):
            at.store(WORD(int(self.words[word])), self.of(at, word), align=8)

    def of(self, at: ir.IRBuilder, word: int) -> ir.Value:
        """The pointer to a word."""
        for region, pointer in zip(self.cells.regions, self.regions, strict=True):
            if region.first <= word < region.end:
                return at.gep(pointer, [WORD(8 * (word - region.first))], source_etype=BYTE)
        return at.gep(self.cells_at, [WORD(8 * word)], source_etype=BYTE)

    def pointers(self, rooms: ir.Value) -> list[ir.Value]:
        """The arguments of each function."""
        return [self.cells_at, rooms, *self.regions]


def _flows(source: FleetSource, module: str, own: set[int]) -> dict[str, "_Flow"]:
    """The flow of each entry. Their passes are few: a flow follows the words by itself through what is left."""
    probes = ir.Module("probes")
    for name in ENTRIES:
        _probe(source, probes, name, own)
    every = _around(module, str(probes))
    here = llvm.Target.from_default_triple().create_target_machine()
    every.data_layout = str(here.target_data)
    every.verify()
    passes = llvm.create_new_module_pass_manager()
    passes.add_always_inliner_pass()
    passes.add_global_dead_code_eliminate_pass()
    passes.add_sroa_pass()
    passes.add_simplify_cfg_pass()
    passes.add_instruction_combine_pass()
    passes.add_jump_threading_pass()  # a stage that is due has set what is read where its instant is known
    passes.run(every, llvm.create_pass_builder(here, llvm.create_pipeline_tuning_options()))
    return {name: _Flow(str(every.get_function(_PROBE + name))) for name in ENTRIES}


def _around(functions: str, callers: str) -> llvm.ModuleRef:
    """A module of functions that call the entries, whose functions become parts of them."""
    module = llvm.parse_assembly(callers)
    outer = {each.name for each in module.functions if not each.is_declaration}
    module.link_in(llvm.parse_assembly(functions))
    for function in module.functions:
        if not function.is_declaration and function.name not in outer:
            function.linkage = "internal"
    return module


_PROBE = "probe_of_"


def _probe(source: FleetSource, probes: ir.Module, name: str, own: set[int]) -> None:
    """A function that takes its run's own words from the beginning to the end of an entry."""
    regions = [k for k, region in enumerate(source.cells.regions) if source.is_apart(region)]
    kind = ir.FunctionType(ir.VoidType(), [POINTER, POINTER, POINTER, *[POINTER] * len(regions), WORD])
    code = ir.Function(probes, kind, _PROBE + name)
    for argument in code.args[:-1]:
        argument.add_attribute("noalias")
    at = ir.IRBuilder(code.append_basic_block())
    inner = ir.Function(probes, ir.FunctionType(WORD, [POINTER] * source.cells.pointers + [WORD]), name)
    before, after, rooms, *places, n = code.args
    memory = _Memory(at, probes, source, dict(zip(regions, places, strict=True)))
    memory.start(at)
    for word in sorted(own):
        at.store(at.load(_at(at, before, word), typ=WORD, align=8), memory.of(at, word), align=8)
    at.call(inner, [*memory.pointers(rooms), n])
    end = code.append_basic_block()
    if name == STEPS:
        at.branch(end)
        at.position_at_end(end)
    else:  # only a run that has not stopped gives its signals
        given = code.append_basic_block()
        stop = at.load(memory.of(at, source.stop), typ=WORD, align=8)
        at.cbranch(at.icmp_signed("==", stop, WORD(STOP_NONE)), given, end)
        at.position_at_end(given)
    for word in sorted(own):
        at.store(at.load(memory.of(at, word), typ=WORD, align=8), _at(at, after, word), align=8)
    if name != STEPS:
        at.branch(end)
        at.position_at_end(end)
    at.ret_void()


class _Flow:
    """Which words at the end of an entry depend on which words at its beginning, by the text of its probe."""

    def __init__(self, text: str) -> None:
        """Read LLVM's text: of each name, the names that it is made of; what is loaded and stored; and the roots, on
        which the way of the code depends."""
        self._uses, self._roots = dict[str, set[str]](), set[str]()
        self._loads, self._stores = dict[str, int](), dict[int, set[str]]()
        places: dict[str, tuple[str, int]] = {}
        for line in text.splitlines():
            line = line.split(" !")[0].strip()
            if line.startswith("define"):
                given = re.findall(r"(%[\w.\"]+)(?=[,)])", line)
                places = {given[0]: ("before", 0), given[1]: ("after", 0)}
                continue
            made = re.match(r"(%[\w.\"]+) = (.*)", line)
            what = made[2] if made else line
            operands = set(re.findall(r"%[\w.\"]+", what))
            place = re.match(r"getelementptr .*?i8, ptr (%[\w.\"]+), i64 (-?\d+)$", what)
            load = re.match(r"load \w+, ptr (%[\w.\"]+)", what)
            store = re.match(r"store \w+ ([^,]+), ptr (%[\w.\"]+)", what)
            if made and place and place[1] in places:
                side, offset = places[place[1]]
                places[made[1]] = side, offset + int(place[2])
            elif made and load and load[1] in places:
                self._loads[made[1]] = places[load[1]][1] // 8
            elif store and store[2] in places:
                if store[1].startswith("%"):
                    self._stores.setdefault(places[store[2]][1] // 8, set()).add(store[1])
            elif made:
                self._uses[made[1]] = operands
                if re.match(r"(load|(tail |musttail |notail )?call) ", what) and "@llvm." not in what:
                    self._roots |= operands
            elif not line.startswith("br label"):
                self._roots |= operands

    def needs(self, words: set[int]) -> set[int]:
        """The words at the beginning on which the words at the end, and the way of the code, depend."""
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
    return at.gep(pointer, [WORD(8 * word)], source_etype=BYTE)
