"""The stages of a run in the order of an instant, as the loop calls them."""

import functools
import time
from collections.abc import Iterator, Mapping, Set
from typing import Any

import numpy as np

from ...analysis.setup import Setup
from ...control.natural import NaturalInertia
from ...control.schedule import Schedule
from ...errors import Fault, InputError
from ...scenario import STAGES, Scenario
from ...stages.base import Stage, is_shipped, packs_itself, random_key
from ...stages.joint_signals import encoder_signals
from ...stages.signals import (
    CLOCK,
    ERRORS,
    ESTIMATES,
    IMPEDANCE,
    KNOWN,
    OBSERVER_GIVEN,
    REFERENCE,
    SCHEDULED,
    TASK,
    TASK_GIVEN,
    TAU_LOST,
    TRUTH,
    Signal,
    commanded_signal,
    record_dtype,
)
from .arena import MARGIN, NEARBY, Arena
from .compilation import NotCompiled
from .inner_stages import Delay, Inflow, Sensed, Tracking, Truth
from .joints import Joints
from .layouts import STAGE
from .plain_stage import PlainStage, StageFault
from .stage_code import RAISED, compile_stage

SEARCH_S = 0.25
"""Wall time from one search of a stage's margins to the next [s]. A search takes a few milliseconds."""


class Entry:
    """One stage of the loop with its records (1,). ``given`` and ``out``, a record or an array, are in the loop's
    memory; ``states`` is how many numbers of ``state`` advance."""

    def __init__(
        self, stage: Stage, settings: np.ndarray, state: np.ndarray, given: np.ndarray, out: np.ndarray, states: int
    ) -> None:
        self.stage, self.settings, self.state = stage, settings, state
        self.given, self.out, self.states = given, out, states
        needs = type(stage).needs
        self.needs = () if needs is None and not packs_itself(type(stage)) else needs
        self.shapes = {name: settings.dtype[name].shape for name in settings.dtype.names or () if name != "_"}
        self.state_dot = np.zeros_like(state)
        self.constants: dict[str, Any] = {}
        self.guarded, self._searched = not is_shipped(stage), time.monotonic()
        self._out_kind = out.dtype if out.dtype.names else np.dtype(("f8", out.shape))
        self.code, self.not_compiled = None, ""
        try:
            kinds = settings.dtype, state.dtype, given.dtype, self._out_kind
            self.code = compile_stage(type(stage).function(), *kinds, guarded=self.guarded)
        except NotCompiled as reason:
            self.not_compiled = str(reason)

    def new(self, constants: Mapping[str, Any]) -> dict[str, Any]:
        """The constants that may differ from those in memory."""
        old = self.constants
        return {name: value for name, value in constants.items() if value is not old.get(name) or _mutable(value)}

    @functools.cached_property
    def arena(self) -> Arena:
        return Arena(self.stage.room, self.settings, self.state, self.given.dtype, self._out_kind)

    @functools.cached_property
    def _plain(self) -> PlainStage:
        return PlainStage(self.stage, self.arena)

    def fill(self, row: np.void) -> None:
        """Set the addresses of a STAGE record."""
        row["code_at"] = self.code.address if self.code is not None else 0
        row["settings_at"] = self.arena.address if self.guarded else self.settings.ctypes.data
        row["state_at"], row["state_dot_at"] = self.state.ctypes.data, self.state_dot.ctypes.data
        row["given_at"], row["out_at"], row["states"] = self.given.ctypes.data, self.out.ctypes.data, self.states

    def call_plain(self) -> None:
        """Run the stage as plain Python. Raises StageFault if the stage raised or violated its contract."""
        self.arena.fill(self.given, self.state)
        self._plain()
        self.arena.take(self.state, self.state_dot, self.out)

    def check(self, everything: bool) -> None:
        """Search the arena's margins, all of them from time to time or if ``everything`` is true. Raises StageFault if
        the stage wrote beyond one of its arrays."""
        now = time.monotonic()
        everything = everything or now - self._searched > SEARCH_S
        if everything:
            self._searched = now
        fault = self.arena.overrun(MARGIN if everything else NEARBY)
        if fault:
            raise self._plain.fault(fault)

    def explain(self, code: int) -> StageFault:
        """The exception for a compiled stage that stopped the run with this return code."""
        fault = self.arena.fault() if code != RAISED else ""
        self.arena.reset()
        self.arena.fill(self.given, self.state)
        return self._plain.explain(fault)

    @property
    def slow(self) -> str:
        """A note on a stage that runs as plain Python; empty for a compiled one."""
        if self.code is not None:
            return ""
        slow = "runs as plain Python, which is slow, because numba can't compile it"
        hint = "; mark the called function with numba.njit" if "<class 'function'>" in str(self.not_compiled) else ""
        return f"{self.stage.label()} {slow}: {self.not_compiled}{hint}"


def part(record: np.ndarray, signals: tuple[Signal, ...]) -> np.ndarray:
    """Consecutive fields of a record (1,) as a record of their own (1,), in the same memory."""
    offset = record.dtype.fields[signals[0].name][1]  # type: ignore[index]  # records have fields
    return np.ndarray(1, record_dtype(signals), record.view(np.uint8), offset)


def _mutable(value: Any) -> bool:
    return value.flags.writeable if isinstance(value, np.ndarray) else not isinstance(value, float | int | tuple)


def _shape(value: Any) -> tuple[int, ...]:
    return value.shape if isinstance(value, np.ndarray) else (len(value),) if isinstance(value, tuple) else ()


class StageTable:
    """The stages of a run and their memory. ``true`` is the record (1,) given to navigation, ``water`` the vehicle's,
    ``joints`` the memory of its joints.

    Attributes:
        signals: the record of the signals that the law is given (1,); each stage fills its part.
        sensed: the clock and the measurements (1,) that navigation sets if an observer replaces its force.
        allocation: the record that actuation is given (1,).
        command: the record with the law's command tau_cmd (1,): that of the actuation, or of the delay before it.
        commands: the record that the thrusters are given (1,).
        u_cmd: (n,) thrusts that actuation sets, in ``commands``.
        thrust: (n,) thrusts that the thrusters produce; ``u_cmd`` itself if they are ideal.
        tau_lost: (6,) part of tau_cmd that u_cmd does not produce.
        commanded: the recorded signals of the commands, each with its memory.
        rows: the table (n,) of STAGE records.
        running: its stages; ``in_arenas`` are those with an arena.
        control: index of the law, or of the stage that would follow it.
        actuation: index of the first stage that is given the law's command.
    """

    def __init__(self, setup: Setup, true: np.ndarray, water: np.ndarray, joints: Joints) -> None:
        scenario, n = setup.scenario, len(setup.vehicle.thrusters)
        controller, actuation = scenario.controller, scenario.actuation
        self.signals = np.zeros(1, record_dtype(type(controller).given()))
        self.sensed = np.zeros(1, record_dtype(CLOCK + KNOWN))
        self.allocation = np.zeros(1, record_dtype(type(actuation).given(n)))
        thrusters = scenario.thrusters
        self.commands = np.zeros(1, record_dtype(type(thrusters).given(n)))
        self.u_cmd, self.tau_lost = self.commands["u_cmd"][0], np.zeros(6)
        self.thrust = np.zeros(n) if thrusters.runs else self.u_cmd
        self.entries: dict[str, Entry] = {}

        def add(table: str, stage: Stage, given: np.ndarray, out: np.ndarray, state: np.ndarray | None = None) -> None:
            if stage.external or not stage.runs:
                return
            counted = joints.n if stage.room.counts == "joints" else n
            own = type(stage).state_record(counted)
            states = type(stage).state_size(counted) if state is None else 0
            self.entries[table] = Entry(stage, stage.record(setup), own if state is None else state, given, out, states)

        observed = scenario.observer.runs
        add("navigation", scenario.navigation, true, part(self.sensed if observed else self.signals, KNOWN))
        if observed:
            add("sensed", Sensed(), self.sensed, part(self.signals, KNOWN[:4]))
        if joints.interface is not None:
            add("encoder", scenario.encoder, joints.true, part(joints.given, encoder_signals(joints.n)))
        add("reference", scenario.reference, part(self.signals, CLOCK + KNOWN), part(self.signals, REFERENCE))
        known = part(self.signals, CLOCK + KNOWN + REFERENCE)
        add("tracking", Tracking(), known, part(self.signals, ERRORS + ESTIMATES))
        add("observer", scenario.observer, part(self.signals, OBSERVER_GIVEN), part(self.signals, KNOWN[4:]))
        if scenario.impedance.schedule:
            add("schedule", Schedule(), part(self.signals, CLOCK), part(self.signals, SCHEDULED))
        if scenario.impedance.natural:
            add("natural", NaturalInertia(), part(self.signals, TASK_GIVEN), part(self.signals, IMPEDANCE[:2]))
        if type(controller).uses_task:
            add("task", scenario.task, part(self.signals, TASK_GIVEN), part(self.signals, TASK))
        if type(controller).uses_truth:
            add("truth", Truth(), true, part(self.signals, TRUTH), water)
        self.control = len(self.entries)
        late = controller.delay is not None
        self.command = np.zeros(1, record_dtype(Delay.given())) if late else self.allocation
        add("controller", controller, self.signals, self.tau_cmd)
        self.actuation = len(self.entries)
        if late:
            add("delay", Delay(), self.command, self.allocation["tau_cmd"][0])
        add("actuation", actuation, self.allocation, self.u_cmd)
        if joints.interface is not None:
            add("joints", joints.interface, joints.given, joints.wanted)
        self.commanded: list[tuple[Signal, np.ndarray]] = []
        if thrusters.runs or actuation.records_loss:
            self.commanded.append((TAU_LOST, self.tau_lost))
        if thrusters.runs:
            add("inflow", Inflow(), true, self.commands["inflow"][0])
            add("thrusters", thrusters, self.commands, self.thrust)
            self.commanded.append((commanded_signal(n), self.u_cmd))
        self.rows = np.zeros(len(self.entries), STAGE)
        for row, entry in zip(self.rows, self.entries.values(), strict=True):
            entry.fill(row)
        self.running = tuple(self.entries.values())
        self.in_arenas = [entry for entry in self.running if entry.guarded or entry.code is None]

    @property
    def tau_cmd(self) -> np.ndarray:
        """(6,) wrench that the law commands."""
        return self.command["tau_cmd"][0]

    def constants(self, setup: Setup, touched: Set[str]) -> dict[str, dict[str, Any]]:
        """The new constants of the stages that depend on the tables and keys in ``touched``, by table. Raises
        InputError if a stage has other constants than its memory has room for."""
        found, faults, scenario = {}, [], setup.scenario
        if (scenario.controller.delay is not None) != ("delay" in self.entries):
            faults.append(Fault("controller.delay", "reset can't add or remove the delay; 0 is a delay too"))
        if bool(scenario.impedance.schedule) != ("schedule" in self.entries):
            faults.append(
                Fault("impedance.schedule", "reset can't add or remove the schedule, only change its entries")
            )
        if scenario.impedance.natural != ("natural" in self.entries):
            faults.append(Fault("impedance.M_d", "reset can't change between a natural and a constant inertia"))
        for table, entry in self.entries.items():
            if table in touched or entry.needs is None or not touched.isdisjoint(entry.needs):
                stage = getattr(setup.scenario, table, entry.stage)
                constants = stage.constants(setup).items()
                now = {name: value for name, value in constants if value is not None and name != "period"}
                found[table] = new = entry.new(now)
                if now.keys() != entry.shapes.keys() or any(_shape(new[name]) != entry.shapes[name] for name in new):
                    faults.append(Fault(table, "reset can't change which settings are given, nor their lengths"))
        if faults:
            raise InputError(faults, "a new Simulation is needed")
        return found

    def write(self, constants: Mapping[str, Mapping[str, Any]]) -> None:
        """Set the constants of stages, by table."""
        for table, values in constants.items():
            entry = self.entries[table]
            for name, value in values.items():
                entry.settings[name] = value
            entry.constants.update(values)
            if entry in self.in_arenas:
                entry.arena.take_settings(entry.settings)

    def write_periods(self, scenario: Scenario) -> None:
        """Set the periods of all stages."""
        h, control = scenario.simulation.timestep, scenario.control_period
        periods = {"actuation": h}
        periods["delay"] = Delay.steps(scenario)[2] * h if "delay" in self.entries else h
        periods |= {table: h for table, entry in self.entries.items() if type(entry.stage).every_step}
        chosen = {table: getattr(scenario, table).period for table in STAGES}
        periods |= {table: period for table, period in chosen.items() if period is not None}
        periods["sensed"] = periods.get("navigation", control)
        periods["inflow"] = periods.get("thrusters", h)
        steps = [round(periods.get(table, control) / h) for table in self.entries]
        self.rows["period_steps"], self.rows["period"] = steps, [n * h for n in steps]

    def write_keys(self, scenario: Scenario) -> None:
        """Set the keys of the random numbers of the stages that a scenario chooses."""
        seed, chosen = scenario.simulation.seed, self.entries.items()
        self.rows["key"] = [random_key(seed, entry.stage) if table in STAGES else 0 for table, entry in chosen]

    def take_back(self, index: int) -> None:
        """Let a stage that was interrupted begin its instant again, without advancing its states twice."""
        self.running[index].state_dot.view(np.uint8)[:] = 0
        self.rows["instant"][index] -= 1

    def states(self) -> Iterator[tuple[Stage, str, np.ndarray]]:
        """The recorded states: their stage, their name and their memory."""
        for table, entry in self.entries.items():
            if table != "truth":
                for name in type(entry.stage).states:
                    yield entry.stage, name, entry.state[name][0]
