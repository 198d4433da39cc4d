"""The stages of a run: each compiled, with its memory, and all of them in their order."""

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...actuation.thrusters import Inflow
from ...compiler.refusals import CONVERSION, DIVISION, INDEX, OVERFLOW, RAISED, SMEARED, STOPPED, place
from ...control.base import Controller, Delay
from ...control.model import (
    UP_TO_ESTIMATES,
    ModelAtBody,
    ModelAtTool,
    ResolveAtBody,
    ResolveAtTool,
    ToolAttitude,
    Tracking,
    Truth,
)
from ...control.posture import PostureBelowTool, PostureBesideBase
from ...control.task import NaturalInertia, Schedule
from ...errors import Fault, InputError
from ...navigation import Perfect
from ...navigation.observer import MotionOnly
from ...navigation.wrist import WristCompensation, WristLoad
from ...physics.frames import BODY
from ...physics.random import key_of, owned
from ...plant.effect import Surroundings, numbers_of
from ...scenario import Scenario
from ...setup.base import Setup
from ...setup.changes import ANYTHING, Change
from ...stages.base import Stage
from ...stages.foreign import C_FILE, SHARED, UNIT
from ...stages.signals import (
    CLOCK,
    DELAYED,
    EFFECT_WRENCH,
    ERRORS,
    IMPEDANCE,
    MEASURED,
    MEASURED_MOTION,
    OBSERVER_GIVEN,
    REFERENCE,
    SCHEDULED,
    TASK,
    TASK_GIVEN,
    TAU_LOST,
    TRUTH,
    WRIST_READING,
    WRIST_TRUE,
    Signal,
    commanded_signal,
    encoder_signals,
    joint_command_signal,
    pulse_signal,
    record_dtype,
)
from .compilation import PLAIN, NativeFunction, NotCompiled, native_function, plain_python
from .memory import OwnMemory, at_address, layout
from .net import account
from .plain_stage import PlainStage, StageFault, called
from .record import Field, Image, Shape, with_numbers
from .shared_library import Library
from .unit_instance import UnitInstance
from .user_stage import compile_user_stage, is_check

LIBRARIES: dict[str, Callable[..., Any]] = {**dict.fromkeys((C_FILE, *SHARED), Library), UNIT: UnitInstance}
"""The class that holds the machine code of a stage that is not in Python, by the suffix of its file."""


class CompiledStage:
    """One stage of the loop with its records (1,). Its input, and its output where it is no array, are parts of
    the record of the run; settings, states and memory are behind it (:attr:`layout`).

    Args:
        stage, settings: the stage, and its constants as a record (1,).
        state: its states at the start as a record (1,), or None for a stage that works on the whole record of the run.
        given, out: parts of the record of the run.
        states: how many numbers of ``state`` advance.
        run: the dtype of the record of the run, as kernels have it.
        fused: whether sums of products may be rounded once.
    """

    def __init__(
        self, stage: Stage, settings: np.ndarray, state: np.ndarray | None, given: Field, out: Field, states: int,
        run: np.dtype, fused: bool,
    ) -> None:  # fmt: skip
        self.stage, self._given, self._out, self.states = stage, given, out, states
        self._start = {"settings": settings} | ({} if state is None else {"state": state})
        self.shapes = {name: settings.dtype[name].shape for name in settings.dtype.names or () if name != "_"}
        self.users = not stage.is_shipped
        self._fused = fused
        self.kinds = settings.dtype, run if state is None else state.dtype, given.dtype, out.dtype
        self.code, self.not_compiled = None, ""
        loaded = LIBRARIES.get(stage.file_suffix())
        self.library: Any = loaded(stage, self.kinds) if loaded else None
        try:
            self.code = self._compiled()
        except NotCompiled as reason:
            self.not_compiled = str(reason)
        self.apart = self.users or self.code is None

    @property
    def layout(self) -> np.dtype:
        """The records of the stage behind the record of the run."""
        own = [(name, each.dtype) for name, each in self._start.items()]
        own += [("state_dot", self._start["state"].dtype)] if "state" in self._start else []
        foreign = self.library.kind if self.library else None
        own += [("own", layout(*self.kinds, foreign))] if self.apart and "state" in self._start else []
        return np.dtype(own, align=True)

    def bind(self, image: Image, record: np.ndarray) -> None:
        """Take the memory of a run: an image, and the stage's record (1,) of :attr:`layout` in it."""
        for name, start in self._start.items():
            record[name] = start
        self.settings, self.given, self.out = record["settings"], image.view(self._given), image.view(self._out)
        self.state = record["state"] if "state" in self._start else image.record("run")
        self.state_dot = record["state_dot"] if "state" in self._start else self.state
        arguments = ("settings", "state", "given", "state_dot", "out")
        self.places = {name: image.place(getattr(self, name)) for name in arguments}
        self.own = None
        if "own" in (record.dtype.names or ()):
            self.own = OwnMemory(self.stage.room, record["own"], self.settings)
            if self.users:
                self.places["settings"] = image.place(record["own"])
            if self.library:
                self.foreign_record = record["own"]["foreign"]
                self.library.fill(self.foreign_record)

    def _compiled(self) -> NativeFunction:
        """The machine code. Raises InputError if the stage is wrong, and NotCompiled if the language lacks what it
        uses."""
        function = type(self.stage).function()
        kinds = self.kinds
        if not self.users:
            if plain_python():
                raise NotCompiled(f"{PLAIN} is set")
            return native_function(function, [*kinds[:3], kinds[1], kinds[3]], self._fused)
        from ...compiler.refusals import Mistake

        try:
            before = getattr(self.stage, "get_before_step", False) if self.library else False
            of = self.library.kind if self.library else function
            code = compile_user_stage(of, self.stage.room, kinds, before)
            if account(code.name).differs:
                raise NotCompiled(account(code.name).differs)
            return code
        except Mistake as mistake:
            where = f"{Path(mistake.file).name}, line {mistake.line}"
            if mistake.forbidden or self._raises_in(mistake.file, mistake.line):
                said = f"{called(self.stage)} is wrong in {where}: {mistake.words}: {mistake.reason}"
                raise InputError(said) from mistake
            raise NotCompiled(f"Python may refuse it: {mistake.reason} ({where}: {mistake.words})") from mistake

    def _raises_in(self, file: str, line: int) -> bool:
        """Whether plain Python raises in this line, too, if it is called with zeros."""
        memory = np.zeros(1, layout(*self.kinds))
        own = OwnMemory(self.stage.room, memory, self._start["settings"])
        own.fill(memory["given"], self._start["state"])
        return PlainStage(self.stage, own).raises_in(file, line)

    @functools.cached_property
    def _plain(self) -> PlainStage:
        assert self.own is not None
        return PlainStage(self.stage, self.own, self.library)

    @property
    def compared(self) -> bool:
        """Whether it is machine code of a user's Python, which the net compares with plain Python."""
        return self.users and self.code is not None and self.library is None

    def linked(self) -> int:
        """The address of its machine code, for which it waits; 0 if it runs as plain Python, as it does from now on if
        LLVM has failed meanwhile."""
        if self.code is None:
            return 0
        try:
            return self.code.address
        except NotCompiled as reason:
            self.code, self.not_compiled = None, str(reason)
            return 0

    @property
    def words(self) -> list[int]:
        """The arguments of its machine code."""
        start = self.state.ctypes.data - 8 * self.places["state"]
        return [start + 8 * self.places[name] for name in ("settings", "state", "given", "state_dot", "out")]

    def distrust(self, reason: str) -> None:
        """Run as plain Python from now on, also in the next runs of this process."""
        assert self.code is not None
        account(self.code.name).differs, self.code, self.not_compiled = reason, None, reason

    def ends_alone(self, code: int) -> str:
        """Why machine code ended early with this number, if Python goes on with the same numbers; otherwise empty."""
        assert self.own is not None
        assert self.code is not None
        if not self.compared or is_check(place(code, self.code.files)[1]):
            return ""
        kept = OwnMemory(self.stage.room, np.zeros_like(self.own.memory), self.settings)
        kept.take_over(self.own)
        self.own.fill(self.given, self.state)
        with np.errstate(all="ignore"):
            fault = self._plain.fault_of(self._plain.function)
        self.own.take_over(kept)
        return "" if fault else self.place_of(code)

    def place_of(self, code: int) -> str:
        """Where and why machine code ended early with this number."""
        assert self.code is not None
        why, file, line = place(code, self.code.files)
        return f"{Path(file).name}, line {line}: {WHY[why]}"

    def fill(self, row: np.void) -> None:
        """Set the places of a STAGE record."""
        row["states"] = self.states
        for name, its_place in self.places.items():
            row[name] = its_place

    def call_plain(self) -> None:
        """Run the stage as plain Python. Raises StageFault if the stage raised or violated its contract."""
        if self.own is None:
            self._on_the_run()
            return
        self.own.fill(self.given, self.state)
        self._plain()
        self.own.take(self.state, self.state_dot, self.out)
        self._plain.rest()

    def begin_plain(self, function: Callable, key: int) -> None:
        """Begin a run of a user's stage as plain Python, with its function and the key of its random numbers."""
        assert self.own is not None
        self.own.take_settings(self.settings)
        self._plain.begin(function, key)

    def _on_the_run(self) -> None:
        """Run a shipped stage that works on the whole record of the run as plain Python."""
        places = (self.settings, self.state, self.given, self.state_dot, self.out)
        kinds = (*self.kinds[:3], self.kinds[1], self.kinds[3])
        words = (int(each.ctypes.data) for each in places)
        type(self.stage).function()(*(at_address(word, kind) for word, kind in zip(words, kinds, strict=True)))

    def explain(self, code: int) -> StageFault:
        """The exception for a compiled stage that stopped the run with this return code."""
        assert self.code is not None
        _, file, _ = place(code, self.code.files)
        assert self.own is not None
        fault = self.own.wrong() if is_check(file) else ""
        if self.library:  # to call it again would change what it keeps
            return self._plain.fault(self.library.said(self.foreign_record) or fault)
        self.own.clear()
        self.own.fill(self.given, self.state)
        return self._plain.explain(fault, "" if is_check(file) else self.place_of(code))

    @property
    def slow(self) -> str:
        """A note on a stage that runs as plain Python; empty for a compiled one."""
        if self.code is not None:
            return ""
        return f"{self.stage.label()} runs as plain Python, which is slow: {self.not_compiled}"

    @property
    def silent(self) -> str:
        """A note on a compiled stage that would print as plain Python; empty for another one."""
        from ...compiler.changes import line_of_print

        line = line_of_print(type(self.stage).function()) if self.compared else 0
        said = f"{self.stage.label()} prints nothing where it is compiled (line {line}); with {PLAIN}=1 it prints"
        return said if line else ""


WHY = {
    INDEX: "an index is out of bounds",
    DIVISION: "an integer is divided by zero",
    CONVERSION: "a number that is not finite, or too large, can't become an integer",
    OVERFLOW: "an integer has more than 64 bits",
    SMEARED: "an array is filled from a part of itself with another step, which NumPy overwrites as it goes",
    RAISED: "it raises",
    STOPPED: "it was interrupted",
}
"""Why a compiled stage ended early."""


def _shape(value: Any) -> tuple[int, ...]:
    return value.shape if isinstance(value, np.ndarray) else (len(value),) if isinstance(value, tuple) else ()


Recorded = Iterable[tuple[Signal, np.ndarray]]
"""Signals, each with its memory in the record of a run."""


@dataclass(frozen=True)
class Place:
    """The place of a stage in an instant.

    Attributes:
        name: its name in the loop: the table of a scenario that chooses it, if there is one.
        when: in which runs it is, in words.
        chosen: the stage of a run, the stages of a list, or None, from its setup.
        given, out: its inputs and its output, parts of the record of the run.
        records: the signals that a run with the stage records besides its states, each with its memory.
        whole: whether its function has the record of the run in place of states.
        term: its name in the field, if that is another one.
    """

    name: str
    when: str
    chosen: Callable[[Setup], Stage | tuple[Stage, ...] | None]
    given: "Callable[[Pipeline], Field]"
    out: "Callable[[Pipeline], Field]"
    records: "Callable[[Pipeline, np.ndarray], Recorded]" = lambda loop, run: ()
    whole: bool = False
    term: str = ""


def _true(loop: "Pipeline") -> Field:
    return loop.field("true")


def _signals(signals: tuple[Signal, ...]) -> "Callable[[Pipeline], Field]":
    """Consecutive signals of the record that the law is given."""
    return lambda loop: loop.part("signals", signals)


def _base(signals: tuple[Signal, ...]) -> "Callable[[Pipeline], Field]":
    """Consecutive signals of the record of what is known at B."""
    return lambda loop: loop.part(loop.base, signals)


def _field(*names: str) -> "Callable[[Pipeline], Field]":
    return lambda loop: loop.field(*names)


def _tool(setup: Setup) -> Stage | None:
    return ToolAttitude() if setup.at_tool and not setup.contacts.carriers[0].is_B else None


def _posture(setup: Setup) -> Stage | None:
    if not setup.vehicle.arm.links or not type(setup.interface).torque_controlled:
        return None
    return PostureBelowTool() if setup.at_tool else PostureBesideBase()


def _resolution(setup: Setup) -> Stage | None:
    if setup.at_tool:
        return ResolveAtTool()
    return ResolveAtBody() if setup.vehicle.arm.links else None


def _measured(loop: "Pipeline") -> Field:
    """Where navigation sets the measurements."""
    return loop.part("sensed" if loop.observed else loop.base, MEASURED)


def _encoded(loop: "Pipeline") -> Field:
    return loop.part("joints", encoder_signals(loop.shape.joints))


def _motion(loop: "Pipeline", run: np.ndarray) -> Recorded:
    """The measured motion, unless navigation is perfect."""
    if not isinstance(loop.scenario.navigation, Perfect):
        yield from ((signal, run[loop.base][signal.name.removesuffix("_m")]) for signal in MEASURED_MOTION)


def _coordinates(loop: "Pipeline", run: np.ndarray) -> Recorded:
    """The measured coordinates of the joints."""
    given = run["joints"]
    return zip(encoder_signals(loop.shape.joints), (given["q_m"], given["q_dot_m"]), strict=True)


def _readings(loop: "Pipeline", run: np.ndarray) -> Recorded:
    """The true wrench of the wrist sensor, and its reading."""
    return (WRIST_TRUE, run["wrist"]["given"]["wrench_S"]), (WRIST_READING, run["wrist"]["reading"])


def _lost(loop: "Pipeline", run: np.ndarray) -> Recorded:
    """The shortfall of the allocation, where the thrusts may differ from the command."""
    if loop.scenario.thrusters.runs or loop.scenario.actuation.records_loss:
        yield TAU_LOST, run["tau_lost"]


def _torques(loop: "Pipeline", run: np.ndarray) -> Recorded:
    """The commanded torques of joints whose motors obey them."""
    if loop.interface is not None and type(loop.interface).torque_controlled:
        yield joint_command_signal(loop.shape.joints), run["joints"]["tau_q_cmd"]


def _commands(loop: "Pipeline", run: np.ndarray) -> Recorded:
    """The commands of the thrusters, which a load has not."""
    if not loop.shape.thrusters:
        return
    yield commanded_signal(loop.shape.thrusters), loop.u_cmd
    if loop.scenario.thrusters.takes_pulses:
        yield pulse_signal(loop.shape.thrusters), loop.stages["thrusters"].state["command"][0]


def _wrenches(loop: "Pipeline", run: np.ndarray) -> Recorded:
    """The wrench of each effect."""
    return zip(effect_signals(loop.scenario.effects), run["plant"]["tau_effects"][0], strict=True)


def effect_signals(effects: Sequence[Stage]) -> list[Signal]:
    """The wrenches of effects as recorded signals, named by their classes, and by their numbers if several are of one
    class."""
    found = []
    for number, effect in zip(numbers_of(effects), effects, strict=True):
        name = "".join(c if c.isalnum() else "_" for c in f"tau_{type(effect).__name__}{number}")
        at = getattr(effect, "at", BODY)
        where, frame = ("B's origin", "B") if at == BODY else (f"the origin of {at}, in its axes", "-")
        meaning = f"wrench of the effect {effect.label()} at {where}"
        found.append(replace(EFFECT_WRENCH, name=name, frame=frame, meaning=meaning))
    return found


INSTANT = (
    Place("tool", "with a task at a tool", _tool, _true, _field("quat_WT"), whole=True),
    Place("navigation", "always", lambda setup: setup.scenario.navigation, _true, _measured, _motion),
    Place("sensed", "with an observer", lambda setup: MotionOnly() if setup.scenario.observer.runs else None,
          _field("sensed"), _signals(MEASURED[:4])),
    Place("encoder", "with joints and an encoder that is not perfect",
          lambda setup: setup.scenario.encoder if setup.vehicle.arm.links else None, _field("encoder"), _encoded,
          _coordinates),
    Place("felt", "with a wrist sensor", lambda setup: WristLoad() if setup.scenario.wrist.runs else None,
          _true, _field("wrist", "given", "wrench_S"), whole=True),
    Place("wrist", "with a wrist sensor", lambda setup: setup.scenario.wrist,
          _field("wrist", "given"), _field("wrist", "reading"), _readings),
    Place("derived", "with a wrist sensor", lambda setup: WristCompensation() if setup.scenario.wrist.runs else None,
          _base(CLOCK + MEASURED[:4]), _base(MEASURED[4:]), whole=True),
    Place("model", "always", lambda setup: ModelAtTool() if setup.at_tool else ModelAtBody(),
          _base(CLOCK + MEASURED), _signals(UP_TO_ESTIMATES), whole=True),
    Place("posture", "with joints whose motors obey torques", _posture,
          _base(CLOCK + MEASURED), _field("model", "tau_posture"), whole=True),
    Place("reference", "always", lambda setup: setup.scenario.reference,
          _signals(CLOCK + MEASURED), _signals(REFERENCE), term="guidance"),
    Place("tracking", "always", lambda setup: Tracking(), _signals(CLOCK + MEASURED + REFERENCE), _signals(ERRORS)),
    Place("observer", "if `observer.name` is not `none`", lambda setup: setup.scenario.observer,
          _signals(OBSERVER_GIVEN), _signals(MEASURED[4:])),
    Place("schedule", "with `[[impedance.schedule]]`",
          lambda setup: Schedule() if setup.scenario.impedance.schedule else None,
          _signals(CLOCK), _signals(SCHEDULED),
          lambda loop, run: ((signal, loop.signals[signal.name]) for signal in SCHEDULED)),
    Place("natural", 'with `impedance.M_d = "natural"`',
          lambda setup: NaturalInertia() if setup.scenario.impedance.natural else None,
          _signals(TASK_GIVEN), _signals(IMPEDANCE[:2])),
    Place("task", "unless the law sets `uses_task = False`",
          lambda setup: setup.scenario.task if type(setup.scenario.controller).uses_task else None,
          _signals(TASK_GIVEN), _signals(TASK)),
    Place("truth", "for the yardstick `ideal`",
          lambda setup: Truth() if type(setup.scenario.controller).uses_truth else None,
          _true, _signals(TRUTH), whole=True),
    Place("controller", "always; `external`: the caller", lambda setup: setup.scenario.controller,
          lambda loop: loop.given_to(loop.controller), lambda loop: loop.field(loop.law, "tau_cmd"), term="law"),
    Place("delay", "with `controller.delay`",
          lambda setup: Delay() if setup.scenario.controller.delay is not None else None,
          _field("command"), lambda loop: loop.field(loop.behind, "tau_cmd"),
          lambda loop, run: ((signal, run[loop.behind]["tau_cmd"]) for signal in DELAYED)),
    Place("resolution", "with joints or a tool", _resolution,
          _field("delayed"), _field("allocation", "tau_cmd"), whole=True),
    Place("actuation", "always; `external`: the caller", lambda setup: setup.scenario.actuation,
          _field("allocation"), _field("commands", "u_cmd"), _lost, term="allocation"),
    Place("joints", "with joints", lambda setup: setup.interface if setup.vehicle.arm.links else None,
          _field("joints"), _field("tau_q_demand"), _torques),
    Place("inflow", "with real thrusters", lambda setup: Inflow() if setup.scenario.thrusters.runs else None,
          _true, _field("commands", "inflow")),
    Place("thrusters", "if `thrusters.name` is not `ideal`", lambda setup: setup.scenario.thrusters,
          _field("commands"), _field("thrust"), _commands),
    Place("surroundings", "with `effects`", lambda setup: Surroundings() if setup.scenario.effects else None,
          lambda loop: loop.field("around").entry(0), _field("plant", "tau_effects"), whole=True),
    Place("effects", "with `effects`", lambda setup: setup.scenario.effects,
          _field("around"), _field("plant", "tau_effects"), _wrenches),
)  # fmt: skip
"""The stages in the order of an instant. A run has the stages that are chosen, run and are not set from outside; each
says its period (:meth:`uvms_mj.stages.base.Stage.period_in`)."""


def chosen(setup: Setup) -> dict[str, type[Stage]]:
    """The classes of the stages of a run by table, with the stages that the caller sets."""
    found = {}
    for each in INSTANT:
        stages = each.chosen(setup)
        listed = isinstance(stages, tuple)
        for i, stage in enumerate(stages if listed else (stages,)):
            if stage is not None and stage.runs:
                found[f"{each.name}[{i}]" if listed else each.name] = type(stage)
    return found


class Pipeline:
    """The stages of a run, chosen and compiled before it has memory, and then bound to it.

    Attributes:
        stages: the stages by table, in the order of an instant; ``running`` are the stages alone, and ``apart`` those
            with memory of their own.
        at_tool: whether the task's frame is a site; ``observed``, whether an observer gives the contact force.
        control: index of the law, or of the stage that would follow it.
        actuation: index of the first stage that is given the law's command.
        scenario, interface: of the run; ``controller`` is its law.
        law: where the law's command is: the record of the actuation, or of the delay or the resolution before it.
        signals, allocation: records (1,) of a run that is bound.
        command, u_cmd: (6,) and (n,) commands of the law and of the actuation.
        rows: the STAGE records (n,) of a run that is bound.
    """

    def __init__(self, setup: Setup, shape: Shape) -> None:
        scenario, self._setup, self.shape = setup.scenario, setup, shape
        self._chosen = chosen(setup)
        self.controller = scenario.controller
        self._run = shape.layout
        self._named = scenario.named_stages.keys()
        self.scenario, self.interface = scenario, setup.interface if shape.joints else None
        self.stages: dict[str, CompiledStage] = {}
        self._places: list[Place] = []
        self.at_tool, self.observed = setup.at_tool, scenario.observer.runs
        self.base = "base" if self.at_tool else "signals"
        self.behind = "delayed" if shape.resolves else "allocation"
        self.law = "command" if scenario.controller.delay is not None else self.behind
        for each in INSTANT:
            if each.name == "controller":
                self.control = len(self.stages)
            self._add(each, each.chosen(setup))
            if each.name == "controller":
                self.actuation = len(self.stages)
        self.running = tuple(self.stages.values())
        self.apart = [stage for stage in self.running if stage.apart]
        self._libraries: list[Any] = [(table, stage) for table, stage in self.stages.items() if stage.library]

    def field(self, *names: str) -> Field:
        """A field of the record of the run."""
        return Field.of(self._run, *names)

    def part(self, name: str, signals: tuple[Signal, ...]) -> Field:
        """Consecutive signals of a record of the run as a record of their own."""
        first = [signal.name for signal in signals[:1]]  # of no signals it is empty, as of a stage with states alone
        return Field(Field.of(self._run, name, *first).offset, record_dtype(signals))

    def given_to(self, controller: Controller) -> Field:
        """The signals that a law is given: the record of signals, or the beginning of it and the truth."""
        signals = type(controller).given()
        whole = self.field("signals")
        fields: Any = whole.dtype.fields
        names = [signal.name for signal in signals]
        formats, offsets = zip(*(fields[name][:2] for name in names), strict=True)
        kind: Any = {"names": names, "formats": list(formats), "offsets": list(offsets)}
        return Field(whole.offset, np.dtype(kind | {"itemsize": whole.dtype.itemsize}))

    def _add(self, at: Place, chosen: Stage | tuple[Stage, ...] | None) -> None:
        """Add the stage of a place, or the stages of a list, whose outputs lie one behind the other."""
        listed = isinstance(chosen, tuple)
        running = [each for each in (chosen if listed else (chosen,)) if each is not None and each.runs]
        self._places += [at] if running else []
        for i, stage in enumerate(running):
            if stage.external:
                continue
            name, given, out = at.name, at.given(self), at.out(self)
            if listed:
                name, given, out = f"{at.name}[{i}]", given.entry(i if self.shape.own_frames else 0), out.entry(i)
            counted = self.shape.joints if stage.room.counts == "joints" else self.shape.thrusters
            kind, run = type(stage), with_numbers(self._run)
            states, start = (0, None) if at.whole else (kind.state_size(counted), kind.start_record(counted))
            settings, fused = stage.record(self._setup), self.shape.joints > 0
            self.stages[name] = CompiledStage(stage, settings, start, given, out, states, run, fused)

    @property
    def layout(self) -> np.dtype:
        """The records of all stages, behind the record of the run."""
        return np.dtype([(table, stage.layout) for table, stage in self.stages.items()], align=True)

    def bind(self, image: Image) -> None:
        """Take the memory of a run: an image with the records ``run`` and ``stages``."""
        run, memory = image.record("run"), image.record("stages")
        self.signals, self.allocation = run["signals"], run["allocation"]
        self.command, self.u_cmd = run[self.law]["tau_cmd"][0], run["commands"]["u_cmd"][0]
        self.rows = run["stages"][0][: len(self.stages)]
        for row, (table, stage) in zip(self.rows, self.stages.items(), strict=True):
            stage.bind(image, memory[table])
            stage.fill(row)
        run["stage_count"], run["actuation"] = len(self.stages), self.actuation
        run["tau_cmd"], run["has_task"] = image.place(self.command), "task" in self.stages

    def link(self) -> None:
        """Set the machine code of the stages of a run that is bound, and wait for what LLVM still makes."""
        self.rows["code_at"] = [stage.linked() for stage in self.running]

    def recorded(self, run: np.ndarray) -> Iterator[tuple[Signal, np.ndarray]]:
        """The recorded signals of the stages besides their states, each with its memory."""
        for at in self._places:
            yield from at.records(self, run)

    @property
    def tau_cmd(self) -> np.ndarray:
        """(6,) wrench that the law commands."""
        return self.command

    def constants(self, setup: Setup, change: Change = ANYTHING) -> dict[str, dict[str, Any]]:
        """The constants of the stages that a change concerns, by table, from another setup. Raises InputError if a
        stage has other constants than its memory has room for."""
        found, faults, scenario = {}, [], setup.scenario
        if (scenario.controller.delay is not None) != ("delay" in self.stages):
            faults.append(Fault("controller.delay", "reset can't add or remove the delay; 0 is a delay too"))
        if bool(scenario.impedance.schedule) != ("schedule" in self.stages):
            faults.append(
                Fault("impedance.schedule", "reset can't add or remove the schedule, only change its entries")
            )
        if scenario.impedance.natural != ("natural" in self.stages):
            faults.append(Fault("impedance.M_d", "reset can't change between a natural and a constant inertia"))
        for table, stage in self.stages.items():
            if not change.concerns_stage(self._constants, table):
                continue
            constants = self._constants(table, setup).items()
            found[table] = new = {name: value for name, value in constants if value is not None and name != "period"}
            if new.keys() != stage.shapes.keys() or any(_shape(new[name]) != stage.shapes[name] for name in new):
                faults.append(Fault(table, "reset can't change which settings are given, nor their lengths"))
        if faults:
            raise InputError(faults, "a new Simulation is needed")
        return found

    def refuse_others(self, setup: Setup) -> None:
        """Raise InputError for a setup with other stages, also where the caller sets a command in place of one."""
        now = chosen(setup)
        tables = [table for table in {**self._chosen, **now} if self._chosen.get(table) is not now.get(table)]
        if named := [table for table in tables if table in self._named or table in setup.scenario.named_stages]:
            raise InputError([Fault(f"{table}.name", "is another one than in the first run") for table in named])

    def _constants(self, table: str, setup: Setup) -> Mapping[str, Any]:
        given = setup.scenario.stage(table) if table in self._named else getattr(setup.scenario, table, None)
        return (given if isinstance(given, Stage) else self.stages[table].stage).constants(setup)

    def start(self, scenario: Scenario) -> None:
        """Begin a run in what stages in libraries and FMUs keep."""
        for table, stage in self._libraries:
            stage.library.start(scenario.named_stages[table])
            stage.library.fill(stage.foreign_record)

    def check_unchanged(self, scenario: Scenario) -> None:
        """Raise InputError for settings of a library or an FMU that can't change during a run."""
        for table, stage in self._libraries:
            stage.library.check_unchanged(scenario.named_stages[table])

    def write(self, constants: Mapping[str, Mapping[str, Any]]) -> None:
        """Set the constants of stages, by table."""
        for table, values in constants.items():
            stage = self.stages[table]
            for name, value in values.items():
                stage.settings[name] = value
            if stage.own is not None:
                stage.own.take_settings(stage.settings)

    def write_periods(self, scenario: Scenario) -> None:
        """Set the periods of all stages."""
        h, named = scenario.simulation.timestep, scenario.named_stages
        stages = (named.get(table, stage.stage) for table, stage in self.stages.items())
        steps = [round(stage.period_in(scenario) / h) for stage in stages]
        self.rows["period_steps"], self.rows["period"] = steps, [n * h for n in steps]

    def write_keys(self, seed_of: Callable[[str], int], vehicle: str) -> None:
        """Set the keys of the random numbers of the stages that a scenario chooses, from the seed of each table and the
        name of the vehicle."""
        self.rows["key"] = [
            key_of(seed_of(table), owned(table, vehicle)) if table in self._named else 0 for table in self.stages
        ]

    def take_back(self, index: int) -> None:
        """Let a stage that was interrupted begin its instant again, without advancing its states twice."""
        self.running[index].state_dot.view(np.uint8)[:] = 0
        self.rows["instant"][index] -= 1

    def states(self) -> Iterator[tuple[Stage, str, str, np.ndarray]]:
        """The recorded states: their stage, their name in it, their name in a row and their memory."""
        for table, stage in self.stages.items():
            if table != "truth":
                for name in type(stage.stage).states:
                    if not stage.state[name].size:  # a state of each thruster, of a load
                        continue
                    yield stage.stage, name, self.scenario.recorded_name(table, name), stage.state[name][0]
