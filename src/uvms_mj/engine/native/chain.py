"""The control system of a run without its plant: the stages from the measurements to the commands of the thrusters,
with a record of their own and one function that takes a period of them.

A stage is the function that the run calls, with records of the same layout. The record of the chain has those parts of
the record of a run that its stages see, by the same names, and the stages' own records behind them. What the engine
and the sensors set in a run, its caller sets.
"""

import ctypes
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from ...actuation.propeller import commands_alone
from ...compiler.apart import Apart, join, joined
from ...compiler.targets import libm_text, optimize
from ...compiler.values import INT
from ...errors import Fault, InputError
from ...guidance import Guidance
from ...navigation.ekf import ALONE, KEPT, Ekf, estimate_alone, estimate_with_force
from ...stages.signals import CLOCK, GIVEN, MEASURED, record_dtype
from .compilation import compiling, target_machine
from .compilation import link as linked
from .intrinsics import kernel_module, linked_stage_module
from .loop import take_period
from .objects import object_name, recall, remember
from .pipeline import CompiledStage
from .record import STAGE, STOP_NONE, with_numbers
from .run_memory import RunMemory
from .translation import parts_of
from .user_stage import between_copies

OF_THE_PLANT = ("tool", "navigation", "sensed", "encoder", "felt", "wrist", "truth", "inflow", "surroundings")
"""The stages that stand for the vehicle and its sensors: they are given the truth, which a real vehicle has not."""
_ALWAYS = ("address", "tau_bound", "next", "tau_cmd", "step", "t", "stop", "stop_index", "stop_value")
_BLOCKS = ("command", "delayed", "allocation", "commands", "columns", "columns_hat", "low", "high", "believed")
SENSORS = np.dtype(
    [
        *((each.name, each.kind) for each in CLOCK),
        *((name, "f8") for name in ("start", "inertial", "interval")),
        ("present", "f8", (4,)),
    ]
)
"""The inputs of a filter besides the samples: which of them are new, and the time since the last inertial one [s]."""
_OF_MODEL = ("model", "joints", "encoded", "frames_m", "tau_q_demand", "wrist")
_WORD = 8


@dataclass(frozen=True)
class Link:
    """A stage of a chain: its name, what the run has of it, the function that the chain calls, and the dtypes of that
    function's records."""

    name: str
    compiled: CompiledStage
    function: Callable
    kinds: tuple[np.dtype, np.dtype, np.dtype, np.dtype]
    period_steps: int

    @property
    def fixed(self) -> bool:
        """Whether its settings are constants of the library: the settings of the law and of users' stages are in the
        record."""
        return not self.compiled.users and self.name != "controller"

    @property
    def filters(self) -> bool:
        """Whether it is the Kalman filter, whose sensors stay behind. It runs in each period of the chain."""
        return self.name == "navigation"

    @property
    def in_c(self) -> bool:
        return self.compiled.stage.file_suffix() == ".c"

    @property
    def symbol(self) -> str:
        """The name of its function in C."""
        return type(self.compiled.stage).__name__


class Chain:
    """The control system of a run.

    Args:
        memory: the memory of a run that has not begun.
        guided: whether the run's guidance gives the reference; otherwise the caller sets it.

    Attributes:
        links: the stages in their order.
        kind: the dtype of the record.
        image: its bytes before the first period; ``constants`` has the settings that nobody changes.
        steps: time steps of the run in one period of the chain.
        measured: name of the record with the measurements.

    Raises:
        InputError: a stage can't leave this machine.
    """

    def __init__(self, memory: RunMemory, guided: bool = True) -> None:
        self._memory, self.stages = memory, memory.stages
        refuse(memory.stages)
        self.measured = memory.stages.base
        self.links = list(self._links(guided))
        self.steps = math.gcd(*(link.period_steps for link in self.links))
        self._spans: list[tuple[int, int, int]] = []
        self._fixed: dict[str, int] = {}
        self.kind = self._layout()
        self.image = self.image_of(memory)

    # layout

    def _links(self, guided: bool) -> Iterator[Link]:
        pipeline = self.stages
        for (table, compiled), row in zip(pipeline.stages.items(), pipeline.rows, strict=True):
            stage, steps = compiled.stage, int(row["period_steps"])
            kinds, function = compiled.kinds, type(stage).function()
            if isinstance(stage, Ekf) and stage.is_shipped:
                fields: Any = kinds[1].fields
                state = np.dtype([(name, fields[name][0]) for name in ALONE])
                sets_force = not (pipeline.observed or "derived" in pipeline.stages)
                function = estimate_with_force if sets_force else estimate_alone
                steps *= int(compiled.settings["imu_instants"][0])
                yield Link(table, compiled, function, (kinds[0], state, SENSORS, kinds[3]), steps)
                continue
            if table in OF_THE_PLANT or table.startswith("effects") or (table == "reference" and not guided):
                continue
            if table == "thrusters":
                if not stage.is_shipped or pipeline.scenario.thrusters.curves()[1] is None:
                    continue  # their command is the thrust
                function = commands_alone
                kinds = (*kinds[:3], np.dtype(("f8", (pipeline.shape.thrusters,))))
            if isinstance(stage, Guidance) and stage.is_shipped:
                kinds = _ended(stage.ending, compiled.settings), kinds[1], kinds[2], kinds[3]
            held = table in ("actuation", "thrusters") and stage.is_shipped and stage.period is None
            yield Link(table, compiled, function, kinds, 0 if held else steps)  # gcd(0, n) is n

    def _parts(self) -> dict[str, np.dtype]:
        """The parts of the record of a run that the chain has."""
        run: Any = self._memory.run.dtype.fields
        resolves = self._memory.shape.resolves
        names = [*_ALWAYS, *_BLOCKS, *_OF_MODEL, *(("base",) if self.measured == "base" else ())]
        found = {"signals": record_dtype(GIVEN)}
        found |= {name: run[name][0] for name in names if name in run}
        if not resolves:
            found.pop("wrist", None)
        return found

    def _layout(self) -> np.dtype:
        fields: dict[str, tuple[np.dtype, int]] = {}
        run: Any = self._memory.run.dtype.fields
        at = 0

        def add(name: str, kind: np.dtype) -> None:
            nonlocal at
            fields[name] = kind, at
            at += -(-kind.itemsize // _WORD) * _WORD

        for name, kind in self._parts().items():
            start = run[name][1]
            self._spans.append((start, start + kind.itemsize, at))
            add(name, kind)
        plant, start = run["plant"]
        frames, offset = plant.fields["frames"][:2]
        self._spans.append((start + offset, start + offset + frames.itemsize, at))
        add("plant", np.dtype([("frames", frames)]))
        n = len(self.links)
        add("stages", np.dtype((STAGE, (n,))))
        for name in ("actuation", "turns", "saturated"):
            add(name, np.dtype("i8"))
        for name in ("waits", "fixed"):
            add(name, np.dtype(("i8", (n,))))
        add("outputs", np.dtype(("f8", (self._memory.shape.thrusters,))))  # commands of the speed controllers
        constants = list[bytes]()
        for k, link in enumerate(self.links):
            kind, start = link.compiled.layout, self._start_of(link)
            if link.fixed:
                size = link.compiled.kinds[0].itemsize
                self._fixed[link.name] = sum(map(len, constants)) // _WORD
                constants.append(_of_kind(link.kinds[0], link.compiled.settings))
                kind, start = np.dtype(f"V{kind.itemsize - size}"), start + size
            if link.filters:
                self._add_filter(link, add, at)
            elif kind.itemsize:
                self._spans.append((start, start + kind.itemsize, at))
                add(f"stage_{k}", kind)
        self.constants = b"".join(constants)
        fields["measured"] = record_dtype(CLOCK + MEASURED), fields[self.measured][1]
        return np.dtype(
            {
                "names": [*fields],
                "formats": [kind for kind, _ in fields.values()],
                "offsets": [place for _, place in fields.values()],
                "itemsize": at,
            }
        )

    def _add_filter(self, link: Link, add: Callable[[str, np.dtype], None], at: int) -> None:
        """Add the records of the filter from a place on [bytes]. Its states are the states of the stage in the run."""
        own: Any = link.kinds[1].fields
        of_run: Any = link.compiled.kinds[1].fields
        layout: Any = link.compiled.layout.fields
        before = self._start_of(link) + layout["state"][1]
        for name in KEPT:
            (kind, offset), start = own[name][:2], before + of_run[name][1]
            self._spans.append((start, start + kind.itemsize, at + offset))
        add("filter", link.kinds[1])
        add("sensors", SENSORS)
        add("sampled", np.dtype("f8"))  # time of the last sample of the inertial unit [s]
        add("filtering", np.dtype("f8"))  # 1 if there is an estimate

    def _start_of(self, link: Link) -> int:
        """Where the records of a stage begin in the image of the run [bytes]."""
        behind = self._memory.image.record("stages")
        fields: Any = behind.dtype.fields
        return _WORD * self._memory.image.place(behind.view(np.uint8)) + fields[link.name][1]

    def place(self, place: int) -> int:
        """The place in the chain's record of a number that has a place in the image of the run."""
        at = _WORD * place
        for start, end, to in self._spans:
            if start <= at < end:
                return (at - start + to) // _WORD
        raise KeyError(place)

    def place_of(self, *names: str) -> int:
        """The place of the first number of a field."""
        kind, at = self.kind, 0
        for name in names:
            fields: Any = kind.fields
            kind, offset = fields[name][:2]
            at += offset
        return at // _WORD

    # contents

    def image_of(self, memory: RunMemory) -> np.ndarray:
        """The bytes of the record before the next period, from the memory of a run that has not begun its instant."""
        image = np.zeros(self.kind.itemsize, np.uint8)
        raw, chain = memory.image.fixed, image.view(self.kind)[0]
        for start, end, to in self._spans:
            image[to : to + end - start] = raw[start:end]
        for k, link in enumerate(self.links):
            if link.compiled.library:  # the address of its function in this process is no part of an export
                stage = image[8 * self.place_of(f"stage_{k}") :][: link.compiled.layout.itemsize]
                stage.view(link.compiled.layout)["own"]["foreign"]["code_at"] = 0
        rows, order = memory.stages.rows, [*memory.stages.stages]
        done = int(memory.run["step"][0] + memory.run["pending"][0]) // self.steps
        chain["address"], chain["step"], chain["stop"], chain["next"] = 0, done, STOP_NONE, 0
        for name in ("stop_index", "stop_value", "t"):
            chain[name] = 0
        chain["turns"], chain["actuation"] = self.filter is None, -1
        if self.filter is not None and done:
            inertial = self.filter.period_steps
            last = (done - 1) * self.steps // inertial * inertial
            chain["filtering"], chain["sampled"] = 1.0, last * float(memory.run["timestep"][0])
        if self.joints:
            chain["encoded"] = 1  # so that the frames are placed at the measured positions
        chain["tau_cmd"] = self.place(memory.image.place(memory.stages.command))
        first = order[memory.stages.actuation] if memory.stages.actuation < len(order) else ""
        for k, link in enumerate(self.links):
            row = rows[order.index(link.name)]
            stage = chain["stages"][k]
            often = link.filters or not link.period_steps
            states = 0 if link.filters else row["states"]
            stage["code_at"], stage["states"], stage["key"] = k + 1, states, row["key"]
            every = 1 if often else max(1, link.period_steps // self.steps)
            stage["period_steps"] = every
            stage["period"] = self.period if often else row["period"]
            stage["instant"] = row["instant"]
            chain["waits"][k], chain["fixed"][k] = -done % every, link.fixed
            for name in ("settings", "state", "given", "state_dot", "out"):
                stage[name] = self._moved(link, name)
            if link.name == first:
                chain["actuation"] = k
        return image

    def _moved(self, link: Link, name: str) -> int:
        """The place of an argument of a stage."""
        if name == "settings" and link.fixed:
            return self._fixed[link.name]
        if link.filters:
            records = {"given": ("sensors",), "out": ("measured", "p_WB")}
            return self.place_of(*records.get(name, ("filter",)))
        of_states = name in ("state", "state_dot")
        if of_states and ("state" not in (link.compiled.layout.names or ()) or not link.kinds[1].itemsize):
            return 0  # the whole record, or no state
        return (
            self.place_of("outputs")
            if link.function is commands_alone and name == "out"
            else self.place(link.compiled.places[name])
        )

    @property
    def joints(self) -> int:
        return self._memory.shape.joints

    @property
    def thrusters(self) -> int:
        return self._memory.shape.thrusters

    @property
    def law(self) -> str:
        """The record with the law's command."""
        return self.stages.law

    @property
    def pulses(self) -> Link | None:
        """The stage that makes commands of speed controllers of thrusts."""
        return next((link for link in self.links if link.function is commands_alone), None)

    @property
    def filter(self) -> Link | None:
        """The Kalman filter."""
        return next((link for link in self.links if link.filters), None)

    def has(self, name: str) -> bool:
        """Whether a stage is in the chain."""
        return any(link.name == name for link in self.links)

    @property
    def left(self) -> list[str]:
        """The stages of the run, as a scenario names them, that stand for the vehicle and its sensors and are not in
        the chain."""
        there = {link.name for link in self.links if link.function is not commands_alone}
        named, simple = self.stages.scenario.named_stages, ("perfect", "none", "ideal")
        chosen = [table for table in self.stages.stages if table not in there and table.partition("[")[0] in named]
        stages = [(table, self.stages.stages[table].stage) for table in chosen]
        left = [(table, stage.label()) for table, stage in stages if not (stage.is_shipped and stage.name in simple)]
        words = {"thrusters": "lag and losses of thrusters"} if self.pulses else {}
        return [f"{words.get(table, table)} {label}" for table, label in left]

    def settings_place(self, link: Link) -> int:
        """The place of the settings of a stage."""
        return self._moved(link, "settings")

    @property
    def period(self) -> float:
        """Time from one call to the next [s]."""
        return self.steps * float(self._memory.run["timestep"][0])

    # machine code

    def module(self, entry: str, apart: Apart) -> str:
        """LLVM's text of the stages and of :func:`take_period` by the name ``entry``, linked in the process ``apart``.
        No product and sum is rounded once, so that every processor has the same numbers. It is kept on disk if all that
        it is made of is known."""
        parts = self._made_of()
        name = object_name([b"chain", entry.encode(), *parts]) if parts is not None else ""
        if name and (kept := recall(name)) is not None:
            return kept[0].decode()
        with compiling():
            text = self._translated(entry, apart)
        if name:
            remember(name, text.encode(), {})
        return text

    def _made_of(self) -> list[bytes] | None:
        """The sources of the text of the stages, besides the package's own; None if they are not known."""
        found = [repr((self.kind, self._memory.run.dtype)).encode()]
        for link in self.links:
            found.append(repr((link.name, link.kinds, link.compiled.users)).encode())
            if not link.compiled.users:
                source = Path(link.function.__code__.co_filename).read_bytes()
                found += [source, link.function.__qualname__.encode()]
                continue
            found.append(type(link.compiled.stage).__name__.encode())
            parts = parts_of(*self._between_copies(link))
            if parts is None:
                return None
            found += parts
        return found

    @staticmethod
    def _between_copies(link: Link) -> tuple[Any, dict[Any, tuple[np.dtype, str]]]:
        """The function of a user's stage between copies, and its records."""
        library, room = link.compiled.library, link.compiled.stage.room
        return between_copies(library.kind if library else link.function, room, link.kinds)

    def _translated(self, entry: str, apart: Apart) -> str:
        symbols, users = [f"{entry}_{k}" for k in range(1, len(self.links) + 1)], list[str]()
        kernels: dict[str, Any] = {}
        whole, run = with_numbers(self.kind), with_numbers(self._memory.run.dtype)
        for symbol, link in zip(symbols, self.links, strict=True):
            kinds = tuple(whole if kind is run else kind for kind in link.kinds)
            if link.compiled.users:
                word = link.symbol if link.compiled.library else ""
                users.append(linked_stage_module(*self._between_copies(link), symbol, word))
            else:
                settings, state, given, out = kinds
                kernels[symbol] = link.function, [settings, state, given, state, out]
        kernels[entry] = take_period, [whole, INT, INT]
        called = apart.call(join, [str(kernel_module(kernels, linked=symbols)), *users])
        return apart.call(joined, libm_text(called), entry)

    def here(self, text: str, entry: str) -> "Here":
        """The chain on this processor, from its text."""
        return Here(self, text, entry)


def _ended(names: Sequence[str], settings: np.ndarray) -> np.dtype:
    """The dtype of settings (1,) with tables that end where their times, which are the first of the names, are
    infinite. Their rows are a power of two, as searches in them want it."""
    kind: Any = settings.dtype
    if not names:
        return kind
    rows = 1 << max(0, int(np.isfinite(settings[names[0]]).sum()) - 1).bit_length()
    fields = [(name, kind[name].base, kind[name].shape) for name in kind.names]
    return np.dtype(
        [(name, of, (min(rows, shape[0]), *shape[1:]) if name in names else shape) for name, of, shape in fields],
        align=True,
    )


def _of_kind(kind: np.dtype, settings: np.ndarray) -> bytes:
    """The bytes of settings (1,) whose tables may be shorter."""
    found = np.zeros(1, kind)
    for name in kind.names or ():
        part = tuple(slice(n) for n in kind[name].shape)
        found[name] = settings[name][(slice(None), *part)]
    return found.tobytes()


class Here:
    """A chain on this processor.

    Attributes:
        record: its record (1,).
        numbers: the same memory as float64.
    """

    def __init__(self, chain: Chain, text: str, entry: str) -> None:
        module = llvm.parse_assembly(text.replace(" hidden ", " "))
        machine = target_machine()
        optimize(module, machine, machine.triple)
        for link in chain.links:
            if link.in_c:
                llvm.add_symbol(link.symbol, link.compiled.library.address)
        found = linked(machine.emit_object(module), [entry], ["memset", "memmove", "memcpy"])
        assert found is not None
        kind = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)
        self._take, self._constants = kind(found[0]), np.frombuffer(chain.constants or bytes(8), np.uint8)
        self.numbers = np.zeros(chain.kind.itemsize // _WORD)
        self.record = self.numbers.view(np.uint8).view(chain.kind)

    def take(self) -> int:
        """Take a period, as :func:`take_period`."""
        at = int(self.numbers.ctypes.data)
        return int(self._take(at, at, int(self._constants.ctypes.data)))


def refuse(stages: Any) -> None:
    """Raise InputError for stages that can't leave this machine."""
    faults = list[Fault]()
    scenario = stages.scenario
    for stage, key, instead in (
        (scenario.controller, "controller.name", "name a law, as in --controller gsta"),
        (scenario.actuation, "actuation.name", "name an allocation, as in actuation.name=pseudo_inverse"),
    ):
        if stage.external or stage.by_caller:
            faults.append(Fault(key, f"{stage.label()}: there is nothing to export; {instead}"))
    if type(scenario.controller).uses_truth:
        wrong = f"{scenario.controller.label()} is given the truth, which no vehicle has; choose another law"
        faults.append(Fault("controller.name", wrong))
    for table, compiled in stages.stages.items():
        if table in OF_THE_PLANT or table.startswith(("effects", "thrusters")):
            continue
        key, stage = f"{compiled.stage.room.table}.name", compiled.stage
        suffix = stage.file_suffix()
        if suffix == ".fmu":
            faults.append(
                Fault(key, f"{stage.label()} is an FMU, a library for this machine; export a law in Python or C")
            )
        elif suffix not in ("", ".py", ".c"):
            wrong = f"{stage.label()} is machine code for this machine alone; export it from its source, a file in C"
            faults.append(Fault(key, wrong))
        elif compiled.code is None:
            wrong = f"{stage.label()} runs as plain Python, which no library takes: {compiled.not_compiled}"
            faults.append(Fault(key, wrong))
    if faults:
        raise InputError(faults, "export law")
