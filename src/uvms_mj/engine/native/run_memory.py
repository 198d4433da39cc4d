"""The memory of one run: the records that the loop works on, and the numbers of a scenario in them."""

import functools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ...control.design import ATTITUDE_KEYS
from ...plant.settings import contact_settings
from ...scenario import STAGES
from ...setup.base import Setup
from ...stages.signals import FINAL_WINDOW_S, MEASURED, band_signals
from .callback import entry_point
from .contact_list import ContactList
from .joints import Joints
from .layouts import LOOP, STOP_STAGE
from .memory import stopped
from .rows import banded, recorded, spans
from .stage_table import StageTable
from .verdict import POSITION_BOUND, SPEED_BOUND, TAU_BOUND
from .wrist_memory import WristMemory

DEFAULT_EPSILON = 1e-3
"""Width of the boundary layer for controllers without a gain of that name: the paper's value."""


class RunMemory:
    """The LOOP record of a run, its stages and its rows, in the memory of an :class:`uvms_mj.engine.base.Engine`.

    Attributes:
        loop: the LOOP record (1,).
        stages: the table of stages.
        u: (n,) thrusts within the limits.
        recorded: the recorded signals in the order of a row, each with its memory.
        rows: (capacity, width) rows.
    """

    def __init__(self, setup: Setup, engine: Any) -> None:
        self.engine, self.context, self.loop = engine, engine.context, np.zeros(1, LOOP)
        self.context_at = self.context.ctypes.data
        vehicle, memory = setup.vehicle, engine.memory
        n = len(vehicle.thrusters)
        self.joints = Joints(setup, self.context)
        self.wrist = WristMemory(setup, self.joints, self.context) if setup.scenario.wrist.runs else None
        self.contacts = ContactList(setup)
        outside = self.loop["true"], self.context["water"], self.joints, self.wrist, self.contacts.carriers
        self.stages = stages = StageTable(setup, *outside)
        self.u = np.zeros(n)
        own = setup.scenario, self.context["water"], self.contacts, self.joints
        self.recorded = recorded(self.loop, stages, self.u, *own)
        self._without_bands = len(self.recorded)
        allocation = stages.allocation
        allocation["B"], allocation["B_pinv"] = setup.nominal.B, np.linalg.pinv(setup.nominal.B)
        sizes = {"stages": len(stages.rows), "actuation": stages.actuation, "thrusters": n, "joints": self.joints.n}
        sizes["controls"] = memory["ctrl_at"].size if "ctrl_at" in memory else 0
        bounds = {"speed_bound": SPEED_BOUND, "position_bound": POSITION_BOUND, "tau_bound": TAU_BOUND}
        for name, value in (sizes | bounds).items():
            self.loop[name] = value
        self.loop["row"]["first_contact"] = -1.0
        # _reached keeps every array alive whose address is in the record
        self._reached = {
            "stages_at": stages.rows,
            "tau_cmd_at": stages.tau_cmd,
            "columns_at": np.ascontiguousarray(vehicle.B.T),
            "u_min_at": allocation["u_min"],
            "u_max_at": allocation["u_max"],
            "low_at": vehicle.u_min,
            "high_at": vehicle.u_max,
            "thrust_of_ctrl_at": vehicle.thrust_of_ctrl,
            "ctrl_index_at": np.array(vehicle.actuator_ids, dtype=np.int64),
            "u_cmd_at": stages.u_cmd,
            "thrust_at": stages.thrust,
            "u_at": self.u,
            **self.contacts.reached,
            **self.joints.reached,
            **memory,
        }
        self._reached["tau_hat_at"] = stages.signals["tau_hat"]
        if stages.commanded:
            self._reached["tau_lost_at"], self._reached["tau_given_at"] = stages.tau_lost, allocation["tau_cmd"]
        if setup.scenario.thrusters.runs or not np.array_equal(vehicle.B, setup.nominal.B):
            self._reached["columns_hat_at"] = np.ascontiguousarray(setup.nominal.B.T)
        if "task" in stages.entries:
            self._reached["s_at"] = stages.signals["s"]
        for name, array in self._reached.items():
            self.loop[name] = array.ctypes.data
        for _, write in WRITERS:
            write(self, setup)
        self.context["loop_at"] = self.loop.ctypes.data
        self._start = [(array, array.copy()) for array in self._restored()]  # each has whole numbers of 8 bytes
        self._restores = np.array([(now.ctypes.data, start.ctypes.data, now.nbytes // 8) for now, start in self._start])
        self._restore = self._restores.ctypes.data, len(self._restores)
        self.record(row_steps=1, capacity=0)

    def _restored(self) -> Iterator[np.ndarray]:
        """The arrays that a reset restores, the LOOP record first."""
        stages = self.stages
        yield from (self.loop, self.context, stages.signals, stages.sensed, stages.command, stages.allocation)
        yield from (stages.commands, stages.thrust, stages.tau_lost, self.u, stages.rows)
        yield from (stages.frame.base, stages.frame.quat, stages.delayed)
        for entry in stages.running:
            if entry.states or type(entry.stage).memory:
                yield from (entry.state, entry.state_dot)
        yield from (*self.contacts.state, *self.joints.state, *self.engine.state)
        yield from () if self.wrist is None else self.wrist.state

    def record(self, row_steps: int, capacity: int) -> None:
        """Record a row every so many time steps, at most ``capacity`` of them before they are taken; with the bands of
        the signals that may alternate, if there are steps between rows."""
        self.recorded, sources = self.recorded[: self._without_bands], []
        if row_steps > 1:
            sources = banded(self.recorded, self.loop)
        self._bands = np.zeros(2 * sum(memory.size for _, memory in sources))
        at = 0
        for signal, memory in sources:
            for edge in band_signals(signal):
                self.recorded.append((edge, self._bands[at : at + memory.size]))
                at += memory.size
        self._banded = np.array([(memory.ctypes.data, memory.size) for _, memory in sources], dtype=np.int64)
        self._spans = np.array(list(spans([memory for _, memory in self.recorded])))
        self.rows = np.zeros((capacity, sum(signal.size for signal, _ in self.recorded)))
        sizes = {"row_steps": row_steps, "row_capacity": capacity, "row_width": self.rows.shape[1]}
        sizes |= {"spans": len(self._spans), "banded": len(sources)}
        arrays = {"rows_at": self.rows, "spans_at": self._spans, "banded_at": self._banded, "bands_at": self._bands}
        for loop in self._start[0]:
            for name, value in (sizes | {name: array.ctypes.data for name, array in arrays.items()}).items():
                loop[name] = value

    def taken(self) -> np.ndarray:
        """The rows (n, width) written since :meth:`clear`, the last step's included. A view."""
        entry_point("finish")(self.context_at)
        return self.rows[: int(self.loop["rows"][0])]

    def clear(self) -> None:
        """Discard the rows, to make room for the next chunk."""
        self.loop["rows"] = 0

    def restart(self, setup: Setup, touched: frozenset[str]) -> None:
        """Return to the start, with the numbers of the tables of a scenario that ``touched`` names from ``setup``.

        Raises:
            InputError: a stage has other constants than its memory has room for. Nothing is changed then.
        """
        constants = self.stages.constants(setup, touched)
        self.engine.clear()
        entry_point("restore")(*self._restore)
        self._write(setup, touched, constants)
        for entry in self.stages.apart:
            entry.own.start()

    def rewrite(self, setup: Setup, touched: frozenset[str]) -> None:
        """As :meth:`restart`, but the run goes on."""
        self._write(setup, touched, self.stages.constants(setup, touched))

    def _write(self, setup: Setup, touched: frozenset[str], constants: Any) -> None:
        for write in _writers(touched):
            write(self, setup)
        self.stages.write(constants)

    def check_stages(self) -> None:
        """Report a failure of a user's stage.

        Raises:
            StageFault: a stage raised or violated its contract.
            KeyboardInterrupt: a signal arrived during a loop of the stage.
        """
        failed = self.loop["stop"][0] == STOP_STAGE
        if failed:
            if stopped[0]:
                stopped[0] = 0
                raise KeyboardInterrupt
            raise self.stages.running[int(self.loop["next"][0])].explain(int(self.loop["stop_index"][0]))

    def views(self) -> dict[str, np.ndarray]:
        """Every signal by name as a read-only view: those that the law is given, and the recorded ones."""
        found = {signal.name: memory.reshape(signal.shape) for signal, memory in self.recorded}
        signals, base = self.stages.signals, self.stages.frame.base
        given = {name: signals[name] for name in signals.dtype.names} | {s.name: base[s.name] for s in MEASURED}
        found = {name: each[0:1].reshape(each.shape[1:]) for name, each in given.items()} | found
        found["t"] = self.loop["t"].reshape(())  # of the instant in hand; the row in memory is that of the step before
        for view in found.values():
            view.flags.writeable = False
        return found


def write_time(memory: RunMemory, setup: Setup) -> None:
    memory.engine.write_time(setup)
    scenario = setup.scenario
    h = scenario.simulation.timestep
    memory.loop["timestep"], memory.loop["steps"] = h, scenario.steps
    memory.loop["window_step"] = max(0, scenario.steps - round(FINAL_WINDOW_S / h))


def write_contact(memory: RunMemory, setup: Setup) -> None:
    contact = memory.loop["contact"]
    for name, value in contact_settings(setup.scenario.wall, setup.mass_along_face).items():
        contact[name] = value
    memory.contacts.write(memory.loop, memory.context, setup)


def write_initial(memory: RunMemory, setup: Setup) -> None:
    memory.engine.write_initial(setup)
    memory.loop["qpos_safe"] = memory.engine.qpos
    memory.joints.q_safe[:] = setup.plant.initial_joints(setup.scenario.initial)


def write_impedance(memory: RunMemory, setup: Setup) -> None:
    stages, design, impedance = memory.stages, setup.design, setup.scenario.impedance
    stages.signals["K_d"] = impedance.K_d
    natural = "natural" in stages.entries  # which sets M_d at its instants, and D_d where none is given
    if not natural:
        stages.signals["M_d"] = design.M_d
    if not natural or impedance.D_d is not None:
        stages.signals["D_d"] = design.D_d
    if "schedule" not in stages.entries:
        stages.signals["K_f"], stages.signals["F_d"] = impedance.K_f, impedance.F_d


def write_estimates(memory: RunMemory, setup: Setup) -> None:
    if memory.stages.frame.model is not None:
        memory.stages.frame.model.estimate(setup.nominal, setup.scenario.estimates)


def write_wrist(memory: RunMemory, setup: Setup) -> None:
    if memory.wrist is not None:
        memory.wrist.write(setup)


def write_epsilon(memory: RunMemory, setup: Setup) -> None:
    memory.loop["epsilon"] = getattr(setup.scenario.controller, "epsilon", DEFAULT_EPSILON)  # of each axis


def write_limits(memory: RunMemory, setup: Setup) -> None:
    memory.stages.allocation["u_min"], memory.stages.allocation["u_max"] = setup.scenario.thrusters.command_limits(
        setup
    )


_RANDOM = ("simulation.seed", "current", "disturbance")
_PERIODS = ("simulation.timestep", "controller.delay", "posture.period", *(f"{table}.period" for table in STAGES))
WRITERS: tuple[tuple[tuple[str, ...], Callable[[RunMemory, Setup], None]], ...] = (
    (("simulation.timestep", "simulation.duration"), write_time),
    (("current",), lambda memory, setup: memory.engine.water.flow(setup.scenario.current)),
    (("disturbance",), lambda memory, setup: memory.engine.water.push(setup.scenario.disturbance)),
    (_RANDOM, lambda memory, setup: memory.engine.water.seed(setup.scenario.simulation.seed)),
    (("tether",), lambda memory, setup: memory.engine.water.pull(setup.scenario.tether)),
    (("wall", "walls", "bumper"), lambda memory, setup: memory.engine.write_wall(setup)),
    (("wall", "walls", "bumper", "initial.joints", *ATTITUDE_KEYS), write_contact),
    (("initial",), write_initial),
    (("impedance", "initial.joints"), write_impedance),
    (("estimates",), write_estimates),
    (("estimates", "wrist"), write_wrist),
    (("simulation.seed",), lambda memory, setup: memory.stages.write_keys(setup.scenario)),
    (_PERIODS, lambda memory, setup: memory.stages.write_periods(setup.scenario)),
    (("controller",), write_epsilon),
    (("thrusters",), write_limits),
)
"""Tables or dotted keys of a scenario, and the function that writes the numbers that depend on them."""


@functools.lru_cache(maxsize=64)
def _writers(touched: frozenset[str]) -> list[Callable[[RunMemory, Setup], None]]:
    return [write for keys, write in WRITERS if not touched.isdisjoint(keys)]
