"""The stages of a run in the order of an instant, as the loop calls them."""

import functools
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from ...control.natural import NaturalInertia
from ...control.schedule import Schedule
from ...errors import Fault, InputError
from ...scenario import STAGES, Scenario
from ...setup.base import Setup
from ...stages.base import Stage, random_key
from ...stages.joint_signals import encoder_signals
from ...stages.signals import (
    CLOCK,
    ERRORS,
    ESTIMATES,
    IMPEDANCE,
    MEASURED,
    OBSERVER_GIVEN,
    REFERENCE,
    SCHEDULED,
    TASK,
    TASK_GIVEN,
    TAU_LOST,
    TRUTH,
    Signal,
    commanded_signal,
    pulse_signal,
    record_dtype,
)
from .entry import Entry, part
from .inner_stages import Delay, Inflow, Sensed, Tracking, Truth
from .joints import Joints
from .layouts import STAGE
from .model_memory import TaskFrame
from .task_frame import UP_TO_ESTIMATES, Errors, ToolAttitude
from .wrist_memory import WristMemory


def _shape(value: Any) -> tuple[int, ...]:
    return value.shape if isinstance(value, np.ndarray) else (len(value),) if isinstance(value, tuple) else ()


class StageTable:
    """The stages of a run and their memory. ``true`` is the record (1,) given to navigation, ``water`` the vehicle's,
    ``joints`` the memory of its joints, ``wrist`` that of their force sensor or None, ``carriers`` the CARRIER records
    of its contacts.

    Attributes:
        signals: the record of the signals that the law is given (1,); each stage fills its part.
        sensed: the clock and the measurements (1,) that navigation sets if an observer replaces its force.
        frame: the stages and the memory of a vehicle with joints or a tool.
        allocation: the record that actuation is given (1,).
        command: the record with the law's command tau_cmd (1,): that of the actuation, or of the delay or the
            resolution before it.
        delayed: the record with the command behind the delay (1,).
        commands: the record that the thrusters are given (1,).
        u_cmd: (n,) thrusts that actuation sets, in ``commands``.
        thrust: (n,) thrusts that the thrusters produce; ``u_cmd`` itself if they are ideal.
        tau_lost: (6,) part of tau_cmd that u_cmd does not produce.
        commanded: the recorded signals of the commands, each with its memory.
        rows: the table (n,) of STAGE records.
        running: its stages; ``apart`` are those with memory of their own.
        control: index of the law, or of the stage that would follow it.
        actuation: index of the first stage that is given the law's command.
    """

    def __init__(
        self,
        setup: Setup,
        true: np.ndarray,
        water: np.ndarray,
        joints: Joints,
        wrist: WristMemory | None,
        carriers: np.ndarray,
    ) -> None:
        scenario, n = setup.scenario, len(setup.vehicle.thrusters)
        controller = scenario.controller
        self.signals = np.zeros(1, record_dtype(type(controller).given()))
        self.sensed = np.zeros(1, record_dtype(CLOCK + MEASURED))
        self.allocation = np.zeros(1, record_dtype(type(scenario.actuation).given(n)))
        thrusters = scenario.thrusters
        self.commands = np.zeros(1, record_dtype(type(thrusters).given(n)))
        self.u_cmd, self.tau_lost = self.commands["u_cmd"][0], np.zeros(6)
        self.thrust = np.zeros(n) if thrusters.runs else self.u_cmd
        self.entries: dict[str, Entry] = {}

        def add(table: str, stage: Stage, given: np.ndarray, out: np.ndarray, state: np.ndarray | None = None) -> None:
            if stage.external or not stage.runs:
                return
            counted = joints.n if stage.room.counts == "joints" else n
            own = type(stage).start_record(counted)
            states = type(stage).state_size(counted) if state is None else 0
            self.entries[table] = Entry(stage, stage.record(setup), own if state is None else state, given, out, states)

        self.wrist, frame = wrist, TaskFrame(setup, self.signals, joints, carriers)
        self.frame = frame
        late = controller.delay is not None
        behind = np.zeros(1, record_dtype(Delay.given())) if frame.model else self.allocation
        self.command, self.delayed = np.zeros(1, record_dtype(Delay.given())) if late else behind, behind
        self._measure(add, scenario, true, joints)
        add("reference", scenario.reference, part(self.signals, CLOCK + MEASURED), part(self.signals, REFERENCE))
        known = part(self.signals, CLOCK + MEASURED + REFERENCE)
        add("tracking", Errors() if frame.model else Tracking(), known, part(self.signals, ERRORS + ESTIMATES))
        add("observer", scenario.observer, part(self.signals, OBSERVER_GIVEN), part(self.signals, MEASURED[4:]))
        if scenario.impedance.schedule:
            add("schedule", Schedule(), part(self.signals, CLOCK), part(self.signals, SCHEDULED))
        if scenario.impedance.natural:
            add("natural", NaturalInertia(), part(self.signals, TASK_GIVEN), part(self.signals, IMPEDANCE[:2]))
        if type(controller).uses_task:
            add("task", scenario.task, part(self.signals, TASK_GIVEN), part(self.signals, TASK))
        if type(controller).uses_truth:
            add("truth", Truth(), true, part(self.signals, TRUTH), water)
        self.control = len(self.entries)
        add("controller", controller, self.signals, self.tau_cmd)
        self.actuation = len(self.entries)
        if late:
            add("delay", Delay(), self.command, self.delayed["tau_cmd"][0])
        if frame.model is not None:
            add("resolve", frame.resolution, self.delayed, self.allocation["tau_cmd"][0], frame.model.record)
        self._actuate(add, scenario, true, joints)
        self.rows = np.zeros(len(self.entries), STAGE)
        for row, entry in zip(self.rows, self.entries.values(), strict=True):
            entry.fill(row)
        self.running = tuple(self.entries.values())
        self.apart = [entry for entry in self.running if entry.users or entry.code is None]
        self._concerned = functools.lru_cache(maxsize=64)(self._entries_of)

    def _actuate(self, add: Callable[..., None], scenario: Scenario, true: np.ndarray, joints: Joints) -> None:
        """Add the stages behind the command: allocation, joints and thrusters."""
        add("actuation", scenario.actuation, self.allocation, self.u_cmd)
        if joints.interface is not None:
            add("joints", joints.interface, joints.given, joints.wanted)
        self.commanded: list[tuple[Signal, np.ndarray]] = []
        thrusters = scenario.thrusters
        if thrusters.runs or scenario.actuation.records_loss:
            self.commanded.append((TAU_LOST, self.tau_lost))
        if thrusters.runs:
            add("inflow", Inflow(), true, self.commands["inflow"][0])
            add("thrusters", thrusters, self.commands, self.thrust)
            self.commanded.append((commanded_signal(len(self.u_cmd)), self.u_cmd))
            if getattr(thrusters, "takes_pulses", False):
                self.commanded.append((pulse_signal(len(self.u_cmd)), self.entries["thrusters"].state["command"][0]))

    def _measure(self, add: Callable[..., None], scenario: Scenario, true: np.ndarray, joints: Joints) -> None:
        """Add the stages that measure, and the law's model of what they measure."""
        frame, observed = self.frame, scenario.observer.runs
        if len(frame.probe):
            add("tool", ToolAttitude(), true, frame.quat[0], frame.probe)
        add("navigation", scenario.navigation, true, part(self.sensed if observed else frame.base, MEASURED))
        if observed:
            add("sensed", Sensed(), self.sensed, part(self.signals, MEASURED[:4]))
        if joints.interface is not None:
            add("encoder", scenario.encoder, joints.true, part(joints.given, encoder_signals(joints.n)))
        if self.wrist is not None:
            self.wrist.add(add, true, frame.base)
        if frame.model is not None:
            out = part(self.signals, UP_TO_ESTIMATES)
            add("model", frame.estimation, part(frame.base, CLOCK + MEASURED), out, frame.model.record)
            if joints.interface is not None and type(joints.interface).torque_controlled:
                torques = frame.model.arrays["tau_posture"]
                add("below", frame.posture, part(frame.base, CLOCK + MEASURED), torques, frame.model.record)

    @property
    def tau_cmd(self) -> np.ndarray:
        """(6,) wrench that the law commands."""
        return self.command["tau_cmd"][0]

    def constants(self, setup: Setup, touched: frozenset[str]) -> dict[str, dict[str, Any]]:
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
        for table, entry in self._concerned(touched):
            stage = getattr(setup.scenario, table, entry.stage)
            constants = stage.constants(setup).items()
            now = {name: value for name, value in constants if value is not None and name != "period"}
            found[table] = new = entry.new(now)
            if now.keys() != entry.shapes.keys() or any(_shape(new[name]) != entry.shapes[name] for name in new):
                faults.append(Fault(table, "reset can't change which settings are given, nor their lengths"))
        if faults:
            raise InputError(faults, "a new Simulation is needed")
        return found

    def _entries_of(self, touched: frozenset[str]) -> list[tuple[str, Entry]]:
        """The stages, by table, whose constants depend on the tables and keys in ``touched``."""
        return [
            (table, entry)
            for table, entry in self.entries.items()
            if table in touched or entry.needs is None or not touched.isdisjoint(entry.needs)
        ]

    def write(self, constants: Mapping[str, Mapping[str, Any]]) -> None:
        """Set the constants of stages, by table."""
        for table, values in constants.items():
            entry = self.entries[table]
            for name, value in values.items():
                entry.settings[name] = value
            entry.constants.update(values)
            if entry in self.apart:
                entry.own.take_settings(entry.settings)

    def write_periods(self, scenario: Scenario) -> None:
        """Set the periods of all stages."""
        h, control = scenario.simulation.timestep, scenario.control_period
        periods = {"actuation": h}
        periods["delay"] = Delay.steps(scenario)[2] * h if "delay" in self.entries else h
        periods |= {"tool": h, "resolve": periods["delay"] if "delay" in self.entries else control}
        periods["below"] = control * max(1, round(scenario.posture.period / control))
        periods |= {table: h for table, entry in self.entries.items() if type(entry.stage).every_step}
        chosen = {table: getattr(scenario, table).period for table in STAGES}
        periods |= {table: period for table, period in chosen.items() if period is not None}
        periods["sensed"] = periods.get("navigation", control)
        periods["felt"], periods["derived"] = periods.get("wrist", control), periods["sensed"]
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
