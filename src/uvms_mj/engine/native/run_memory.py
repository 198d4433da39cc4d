"""The memory of one run: its record, those of its stages, its tables and its rows, with the numbers of a scenario in
them."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ...setup.base import Setup
from ...stages.signals import FINAL_WINDOW_S, MEASURED, band_signals
from .bodies import (
    estimate,
    fill_joints,
    fill_model,
    fill_wrist,
    motion_room,
    place_carriers,
    write_contacts,
    write_wrist,
)
from .callback import entry_points
from .memory import stopped
from .pipeline import Pipeline
from .record import MOST_ROWS, STOP_STAGE, Image, Shape, room_for, run_dtype, water_rooms
from .rows import banded, recorded, spans
from .stop_reason import POSITION_BOUND, SPEED_BOUND, TAU_BOUND

DEFAULT_EPSILON = 1e-3
"""Width of the boundary layer for controllers without a gain of that name: the paper's value."""
ROWS_ROOM, BANDS_ROOM = 1 << 20, 4096
"""Numbers for the rows of a chunk, and for the bands of a row."""


def shape_of(setup: Setup) -> Shape:
    """The shape of a run's record."""
    scenario, contacts, n = setup.scenario, setup.contacts, len(setup.vehicle.arm.links)
    return Shape(
        joints=n,
        thrusters=len(setup.vehicle.thrusters),
        carriers=len(contacts.carriers),
        carried=not all(carrier.is_B for carrier in contacts.carriers),
        surfaces=room_for(len(contacts.surfaces) + (contacts.paper is not None)),
        pairs=room_for(len(contacts.pairs) + (contacts.paper is not None)),
        resolves=setup.at_tool or n > 0,
        encoded=n > 0 and scenario.encoder.runs,
        wrist=scenario.wrist.runs,
    )


def tables_of(setup: Setup) -> dict[str, tuple[str, np.ndarray]]:
    """The tables of a scenario that a run reads, by their rooms: their keys, and their rows (n, width)."""
    scenario = setup.scenario
    tables: dict[str, tuple[str, Any]] = {
        "current.table": ("current.table", scenario.current.table),
        "current.shear": ("current.shear", scenario.current.shear),
        "disturbance.table": ("disturbance.table", scenario.disturbance.table),
    }
    tables |= {motion_room(k): (f"{key}.motion", wall.motion) for k, (key, wall) in enumerate(setup.contacts.walls)}
    return {room: (key, np.array(table, float)) for room, (key, table) in tables.items() if table}


class RunMemory:
    """The record of a run, its stages and its rows, and the :class:`uvms_mj.engine.base.Engine` that moves its body.

    Attributes:
        image: all memory of the run.
        run: its record (1,).
        stages: its stages.
        code: its entry points by name.
        recorded: the recorded signals in the order of a row, each with its memory.
        rows: (capacity, width) rows.
        chunk_steps: largest number of steps before the rows must be taken.
    """

    def __init__(self, setup: Setup, engine: Any) -> None:
        self.engine, self.shape = engine, shape_of(setup)
        self.code, self.stages = entry_points(self.shape, engine.code), Pipeline(setup, self.shape)
        self._setup = setup
        self._tables, self._has_other_tables = tables_of(setup), False
        rooms = water_rooms() | {motion_room(k): MOST_ROWS * 4 for k in range(len(setup.contacts.walls))}
        rooms |= {room: max(rooms[room], table.size) for room, (_, table) in self._tables.items()}
        rooms |= {"bands": BANDS_ROOM, "rows": ROWS_ROOM}
        self.image = Image({"run": run_dtype(self.shape), "stages": self.stages.layout}, rooms)
        self.run = self.image.record("run")
        self.address = self.image.address
        self._fill(setup)
        self.stages.bind(self.image)
        engine.enter(self.image, self.run, setup, self.code)
        self.recorded = recorded(self.run, self.stages, setup)
        self._without_bands = len(self.recorded)
        engine.write_time(setup)
        engine.write_wall(setup)
        for write in (write_time, write_initial, *WRITERS):
            write(self, setup)
        self._start = self.image.fixed.copy()
        self.chunk_steps = engine.chunk_steps
        self.record(row_steps=1, rows=False)

    def _fill(self, setup: Setup) -> None:
        """Set what no reset changes."""
        run, vehicle, nominal = self.run, setup.vehicle, setup.nominal
        run["address"] = self.address
        run["speed_bound"], run["position_bound"], run["tau_bound"] = SPEED_BOUND, POSITION_BOUND, TAU_BOUND
        run["row"]["first_contact"] = -1.0
        run["columns"], run["columns_hat"] = vehicle.B.T, nominal.B.T
        run["low"], run["high"], run["thrust_of_ctrl"] = vehicle.u_min, vehicle.u_max, vehicle.thrust_of_ctrl
        run["ctrl_index"] = vehicle.actuator_ids
        run["allocation"]["B"], run["allocation"]["B_pinv"] = nominal.B, np.linalg.pinv(nominal.B)
        real = setup.scenario.thrusters.runs
        run["ideal"], run["believed"] = not real, real or not np.array_equal(vehicle.B, nominal.B)
        place_carriers(run, setup.contacts)
        if self.shape.joints:
            fill_joints(run, setup)
        fill_model(run["model"], setup)
        if self.shape.wrist:
            fill_wrist(run["wrist"], setup)

    def record(self, row_steps: int, rows: bool = True) -> None:
        """Record a row every so many time steps, or none; with the bands of the signals that may alternate, if there
        are steps between rows."""
        self.recorded, sources = self.recorded[: self._without_bands], []
        if row_steps > 1:
            sources = banded(self.recorded, self.run)
        place, bands = self.image.room("bands")
        at = 0
        for signal, memory in sources:
            for edge in band_signals(signal):
                self.recorded.append((edge, bands[at : at + memory.size]))
                at += memory.size
        width = sum(signal.size for signal, _ in self.recorded)
        parts = list(spans(self.image, [memory for _, memory in self.recorded]))
        first, room = self.image.room("rows")
        capacity = room.size // width if rows else 0
        self.rows = room[: capacity * width].reshape(capacity, width)
        if rows:
            self.chunk_steps = min(self.engine.chunk_steps, (capacity - 2) * row_steps)
        for run in (self.run, self._start[: self.run.itemsize].view(self.run.dtype)):
            run["row_steps"], run["row_capacity"], run["row_width"] = row_steps, capacity, width
            run["rows"], run["bands"] = first, place
            run["spans"][0, : len(parts)], run["span_count"] = parts, len(parts)
            run["banded_count"] = len(sources)
            for k, (_, memory) in enumerate(sources):
                run["banded"][0, k] = self.image.place(memory), memory.size

    def taken(self) -> np.ndarray:
        """The rows (n, width) written since :meth:`clear`, the last step's included. A view."""
        self.code["finish"].ctypes(self.address)
        return self.rows[: int(self.run["row_count"][0])]

    def clear(self) -> None:
        """Discard the rows, to make room for the next chunk."""
        self.run["row_count"] = 0

    def restart(self, setup: Setup) -> None:
        """Return to the start, with the numbers of a setup.

        Raises:
            InputError: a stage has other constants than its memory has room for, or a table is too long. Nothing is
                changed then.
        """
        constants = {} if setup is self._setup else self._fitting(setup)
        self.engine.clear()
        drawn = self.engine.water.drawn()
        self.image.fixed[:] = self._start
        self.engine.water.keep(drawn)
        self.engine.write_time(setup)
        self.engine.write_wall(setup)
        if setup is not self._setup:
            write_time(self, setup)
            write_initial(self, setup)
            self._write(setup, constants)
        elif self._has_other_tables:
            for room, (_, table) in self._tables.items():
                self.image.put(room, table)
            self._has_other_tables = False

    def rewrite(self, setup: Setup) -> None:
        """Set the numbers of another setup with the same time and start, while the run goes on. Raises InputError as
        :meth:`restart` does."""
        constants = self._fitting(setup)
        self.engine.write_wall(setup)
        self._write(setup, constants)

    def _fitting(self, setup: Setup) -> dict[str, dict[str, Any]]:
        """The constants of all stages. Raises InputError if they or a table do not fit into this memory."""
        for room, (key, table) in tables_of(setup).items():
            self.image.check_room(room, key, table)
        return self.stages.constants(setup)

    def _write(self, setup: Setup, constants: dict[str, dict[str, Any]]) -> None:
        self._has_other_tables = True
        for write in WRITERS:
            write(self, setup)
        self.stages.write(constants)

    def check_stages(self) -> None:
        """Report a failure of a user's stage.

        Raises:
            StageFault: a stage raised or violated its contract.
            KeyboardInterrupt: a signal arrived during a loop of the stage.
        """
        failed = self.run["stop"][0] == STOP_STAGE
        if failed:
            if stopped[0]:
                stopped[0] = 0
                raise KeyboardInterrupt
            raise self.stages.running[int(self.run["next"][0])].explain(int(self.run["stop_index"][0]))

    def views(self) -> dict[str, np.ndarray]:
        """Every signal by name as a read-only view: those that the law is given, and the recorded ones."""
        found = {signal.name: memory.reshape(signal.shape) for signal, memory in self.recorded}
        signals, base = self.stages.signals, self.run[self.stages.base]
        names = [signal.name for signal in type(self.stages.controller).given()]
        given = {name: signals[name] for name in names} | {s.name: base[s.name] for s in MEASURED}
        found = {name: each[0:1].reshape(each.shape[1:]) for name, each in given.items()} | found
        found["t"] = self.run["t"].reshape(())  # of the instant in hand; the row in memory is that of the step before
        for view in found.values():
            view.flags.writeable = False
        return found


def write_time(memory: RunMemory, setup: Setup) -> None:
    scenario = setup.scenario
    h = scenario.simulation.timestep
    memory.run["timestep"], memory.run["steps"] = h, scenario.steps
    memory.run["window_step"] = max(0, scenario.steps - round(FINAL_WINDOW_S / h))


def write_contact(memory: RunMemory, setup: Setup) -> None:
    write_contacts(memory.image, memory.run, setup)


def write_initial(memory: RunMemory, setup: Setup) -> None:
    memory.engine.write_initial(setup)
    memory.run["qpos_safe"] = memory.engine.qpos
    memory.run["q_safe"] = setup.plant.initial_joints(setup.scenario.initial)


def write_impedance(memory: RunMemory, setup: Setup) -> None:
    stages, design, impedance = memory.stages, setup.design, setup.scenario.impedance
    stages.signals["K_d"] = impedance.K_d
    natural = "natural" in stages.stages  # which sets M_d at its instants, and D_d where none is given
    if not natural:
        stages.signals["M_d"] = design.M_d
    if not natural or impedance.D_d is not None:
        stages.signals["D_d"] = design.D_d
    if "schedule" not in stages.stages:
        stages.signals["K_f"], stages.signals["F_d"] = impedance.K_f, impedance.F_d


def write_estimates(memory: RunMemory, setup: Setup) -> None:
    model = memory.run["model"]
    estimate(model, setup.nominal, setup.scenario.estimates)
    if not memory.shape.resolves:  # the inertia of a rigid vehicle at B is constant
        model["M"] = setup.design.M_hat.reshape(1, -1)


def write_sensor(memory: RunMemory, setup: Setup) -> None:
    if memory.shape.wrist:
        write_wrist(memory.run["wrist"], setup)


def write_epsilon(memory: RunMemory, setup: Setup) -> None:
    memory.run["epsilon"] = getattr(setup.scenario.controller, "epsilon", DEFAULT_EPSILON)  # of each axis


def write_limits(memory: RunMemory, setup: Setup) -> None:
    memory.stages.allocation["u_min"], memory.stages.allocation["u_max"] = setup.scenario.thrusters.command_limits(
        setup
    )


def write_water(memory: RunMemory, setup: Setup) -> None:
    water, scenario = memory.engine.water, setup.scenario
    water.flow(scenario.current)
    water.push(scenario.disturbance)
    water.pull(scenario.tether)
    water.seed(scenario.simulation.seed)


def write_stages(memory: RunMemory, setup: Setup) -> None:
    memory.stages.write_keys(setup.scenario)
    memory.stages.write_periods(setup.scenario)


WRITERS: tuple[Callable[[RunMemory, Setup], None], ...] = (
    *(write_water, write_contact, write_impedance, write_estimates, write_sensor),
    *(write_epsilon, write_limits, write_stages),
)
"""What sets the numbers of a setup that may change during a run."""
