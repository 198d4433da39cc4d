"""The memory of one run: its record, the records of its stages, its tables and its rows, with the numbers of a scenario
in them; and the signals that a row records, with where each of them lies."""

import functools
import itertools
from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ...control.base import Controller
from ...control.model import estimate
from ...control.task import ImpedanceTask
from ...errors import Fault, InputError
from ...physics.effects import EFFECTS
from ...physics.frames import BODY
from ...physics.spanned_axes import pseudoinverse
from ...plant.hull import WIDTH
from ...plant.sea import MOST_WAVES
from ...records.trace import Trace
from ...setup.base import Setup
from ...setup.changes import ANYTHING, Change
from ...stages.base import Stage
from ...stages.signals import (
    BAND,
    BANDED,
    CLOCK,
    FINAL_WINDOW_S,
    IN_TASK_FRAME,
    MEASURED,
    OWN_UNIT,
    PUSH,
    RECORDED,
    Signal,
    band_signals,
    effect_given,
    names_taken,
)
from .bodies import (
    fill_joints,
    fill_model,
    fill_wrist,
    motion_room,
    place_carriers,
    recorded_of_plant,
    swell_room,
    tilt_room,
    write_contacts,
    write_wrist,
)
from .callback import advance, finish
from .compilation import begin_module, made_once, native_functions, short_run
from .loop import POSITION_BOUND, SPEED_BOUND, TAU_BOUND
from .memory import stopped
from .pipeline import Pipeline
from .record import MOST_ROWS, STOP_STAGE, Image, Shape, room_for, water_rooms, with_numbers

_ATTRIBUTES = {*dir(np.recarray), *dir(Trace), *(field.name for field in fields(Trace)), "file", "allow_pickle"}
"""Attributes of a trace, and of the formats to which it is exported."""
_OF_THE_TASK = ("s", "zeta", "tau_nom", "boundary_layer_time")


def recorded(run: np.ndarray, stages: Pipeline, setup: Setup) -> list[tuple[Signal, np.ndarray]]:
    """The signals of a row in order, each with its memory in the record of a run: the signals of every run, of its
    plant, of its stages, and the states. Raises InputError if two states have one name, or a state's name is taken
    or is not an identifier."""
    contact = run["pairs"][0][:1]["contact"] if setup.contacts.paper else run["no_contact"]
    records = [run["row"], run["true"], contact, stages.signals, run[stages.law]]
    places = {name: record[name] for record in reversed(records) for name in record.dtype.names or ()}
    found = [
        (signal, places[signal.name])
        for signal in RECORDED
        if "task" in stages.stages or signal.name not in _OF_THE_TASK
    ]
    found += [*recorded_of_plant(run, setup), *stages.recorded(run)]
    own = [each for each in stages.states() if each[1] != "zeta" or not isinstance(each[0], ImpedanceTask)]
    check_states([(stage, in_row) for stage, _, in_row, _ in own], {signal.name for signal, _ in found})
    found += [
        (replace(state_signal(stage, name, memory.size), name=in_row), memory) for stage, name, in_row, memory in own
    ]
    if not stages.at_tool:
        return found
    at_tool = {*IN_TASK_FRAME, *(name for stage, name, *_ in own if isinstance(stage, Controller))}
    return [(replace(each, frame="T") if each.name in at_tool else each, memory) for each, memory in found]


def banded(recorded: Sequence[tuple[Signal, np.ndarray]], run: np.ndarray) -> list[tuple[Signal, np.ndarray]]:
    """The signals with a band, each with its memory, of the recorded ones."""
    found = {signal.name: (signal, memory) for signal, memory in (*recorded, (PUSH, run["push"]))}
    return [found[name] for name in BANDED if name in found]


def check_states(states: Sequence[tuple[Stage, str]], names: Set[str]) -> None:
    """Refuse states that can't be recorded under their names, beside the signals ``names``. Raises InputError if two
    states have one name, or a state's name is taken or is not an identifier."""
    taken = names | names_taken() | {*itertools.chain(*BAND.values())} | _ATTRIBUTES
    faults: dict[Stage, list[Fault]] = {}
    for stage, name in states:
        if name in taken:
            wrong = "is the name of a recorded signal or of an attribute; choose another"
        elif not name.isidentifier():
            wrong = "is not an identifier"
        else:
            others = [other.label() for other, same in states if same == name and other is not stage]
            wrong = f"is also the name of a state of {others[0]}; choose another" if others else ""
        if wrong:
            faults.setdefault(stage, []).append(Fault(f"states[{name!r}]", wrong))
    for stage, found in faults.items():
        raise InputError(found, f"the {stage.room.noun} {stage.label()}")


def state_signal(stage: Stage, name: str, size: int) -> Signal:
    """A state of a stage as a recorded signal. A state with a number of each thruster or joint has no frame."""
    frame = "-" if isinstance(type(stage).states[name], str) else "B"
    return Signal(name, (size,), type(stage).units.get(name, OWN_UNIT), frame, f"state {name} of {stage.label()}")


def spans(image: Image, memories: Sequence[np.ndarray]) -> Iterator[tuple[int, int]]:
    """Place and size [numbers] of each part of a row; neighbours in memory are one part."""
    place, size = 0, 0
    for memory in memories:
        here = image.place(memory)
        if size and here == place + size:
            size += memory.size
            continue
        if size:
            yield place, size
        place, size = here, memory.size
    yield place, size


DEFAULT_EPSILON = 1e-3
"""Width of the boundary layer for controllers without a gain of that name: the paper's value."""
ROWS_ROOM, BANDS_ROOM = 1 << 20, 4096
"""Numbers for the rows of a chunk, and for the bands of a row."""


def shape_of(setup: Setup) -> Shape:
    """The shape of a run's record. A vehicle with joints has room for walls, a tool on any link and a wrist sensor also
    where it has none, so that one machine code serves more scenarios."""
    contacts, n = setup.contacts, len(setup.vehicle.arm.links)
    least = int(n > 0)
    return Shape(
        joints=n,
        thrusters=len(setup.vehicle.thrusters),
        carriers=len(contacts.carriers),
        carried=n > 0 or not all(carrier.is_B for carrier in contacts.carriers),
        surfaces=room_for(max(len(contacts.walls), least)),
        pairs=room_for(max(len(contacts.pairs), least)),
        resolves=setup.at_tool or n > 0,
        effects=setup.effects.dtype,
        own_effects=len(effects := setup.scenario.effects),
        own_frames=len(effects) if any(effect.at != BODY for effect in effects) else 0,
    )


def tables_of(setup: Setup) -> dict[str, tuple[str, np.ndarray]]:
    """The tables of a scenario that a run reads, by their rooms: their keys, and their rows (n, width)."""
    walls = [(motion_room(k), f"{key}.motion", wall.motion) for k, (key, wall) in enumerate(setup.contacts.walls)]
    of_walls = {room: (key, np.array(table, float)) for room, key, table in walls if table}
    swells = {
        room(k): (f"{key}.{name}", setup.swells[k][i])
        for k, (key, wall) in enumerate(setup.contacts.walls)
        for i, (room, name) in enumerate([(swell_room, "heave"), (tilt_room, "roll")])
        if (wall.turns if i else wall.follows_sea)
    }
    return {key: (key, rows) for key, rows in setup.effect_rows.items()} | of_walls | swells


@made_once
def entry_points(shape: Shape, step: Any, short: bool) -> dict[str, Any]:
    """The machine code for runs of a shape, loaded or compiled at first use: the step of an engine,
    :func:`.callback.evaluate` in MuJoCo's callback or :func:`.loop.free_steps`, and what Python calls between
    chunks. They share most of their code, and are one module. ``short`` is :data:`.compilation.short_run`."""
    run = with_numbers(shape.layout)
    parts: dict[Any, list[Any]] = {step: [run, "i8", "i8"], advance: [run, "i8"], finish: [run]}
    return {each.__name__: code for each, code in zip(parts, native_functions(parts, shape.joints > 0), strict=True)}


class RunMemory:
    """The record of a run, its stages and its rows, and the :class:`uvms_mj.engine.engines.Engine` that moves its body.

    Attributes:
        image: all memory of the run.
        run: its record (1,).
        stages: its stages.
        code: its entry points by name.
        recorded: the recorded signals in the order of a row, each with its memory.
        rows: (capacity, width) rows.
        chunk_steps: largest number of steps before the rows must be taken.
    """

    def __init__(self, setup: Setup, engine: Any, meanwhile: Callable[["RunMemory"], None] | None = None) -> None:
        """``meanwhile`` is called before the machine code is waited for, which LLVM makes in other threads, and, with
        an engine that has not asked for it, before the entry points are translated."""
        self.engine, self.shape = engine, shape_of(setup)
        self._entry_points = functools.partial(entry_points, self.shape, engine.code, short_run.get())
        if meanwhile is None:
            _ = self.code  # LLVM has the largest module while the stages are translated
        self.stages = Pipeline(setup, self.shape)
        self._setup = setup
        self._tables, self._has_other_tables = tables_of(setup), False
        rooms = water_rooms() | {motion_room(k): MOST_ROWS * 4 for k in range(len(setup.contacts.walls))}
        of_waves = [room(k) for k in range(len(setup.contacts.walls)) for room in (swell_room, tilt_room)]
        rooms |= dict.fromkeys(of_waves, MOST_WAVES * WIDTH)
        rooms |= {room: max(rooms[room], table.size) for room, (_, table) in self._tables.items()}
        rooms |= {"bands": BANDS_ROOM, "rows": ROWS_ROOM}
        self.image = Image({"run": self.shape.layout, "stages": self.stages.layout}, rooms)
        self.run = self.image.record("run")
        self.address = self.image.address
        self._fill(setup)
        self.stages.bind(self.image)
        engine.enter(self.image, self.run, setup, self._entry_points)
        self.recorded = recorded(self.run, self.stages, setup)
        self._without_bands = len(self.recorded)
        engine.write_time(setup)
        engine.write_wall(setup)
        for write in (write_time, write_initial, *WRITERS):
            write(self, setup)
        if meanwhile is not None:
            if not self.shape.joints:  # LLVM, which works on fused code in threads, would be locked in a copy
                _ = self.code
                begin_module()
            meanwhile(self)
        for each in self.code.values():
            each.wait()  # nobody copies this process while LLVM works in it
        self.stages.link()
        self._start = self.image.fixed.copy()
        self.chunk_steps = engine.chunk_steps
        self.record(row_steps=1, rows=False)

    @functools.cached_property
    def code(self) -> dict[str, Any]:
        return self._entry_points()

    def _fill(self, setup: Setup) -> None:
        """Set what no reset changes."""
        run, vehicle, nominal = self.run, setup.vehicle, setup.nominal
        run["address"] = self.address
        run["speed_bound"], run["position_bound"], run["tau_bound"] = SPEED_BOUND, POSITION_BOUND, TAU_BOUND
        run["row"]["first_contact"] = -1.0
        run["columns"], run["columns_hat"] = vehicle.B.T, nominal.B.T
        run["low"], run["high"], run["thrust_of_ctrl"] = vehicle.u_min, vehicle.u_max, vehicle.thrust_of_ctrl
        run["ctrl_index"] = vehicle.actuator_ids
        run["allocation"]["B"], run["allocation"]["B_pinv"] = nominal.B, pseudoinverse(nominal.B)
        real = setup.scenario.thrusters.runs
        surfaces = bool(run["places"].size)
        run["ideal"], run["believed"] = not real, real or surfaces or not np.array_equal(vehicle.B, nominal.B)
        if surfaces:
            run["places"] = vehicle.places
        place_carriers(run["carriers"][0], setup.contacts.carriers)
        for signal in effect_given(0)[len(CLOCK) :]:
            run["around"][signal.name] = np.nan  # until it is filled, so that none is read that is not
        if self.shape.own_frames:
            frames = [effect.carrier(vehicle) for effect in setup.scenario.effects]
            place_carriers(run["plant"]["effect_frames"][0], frames)
        if self.shape.joints:
            fill_joints(run, setup)
        fill_model(run["model"], setup)
        if setup.scenario.wrist.runs:
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

    def restart(self, setup: Setup, change: Change = ANYTHING) -> None:
        """Return to the start, with the numbers of a setup, which equal the first setup's except where a change of it
        acts.

        Raises:
            InputError: a stage has other constants than its memory has room for, or a table is too long. Nothing is
                changed then.
        """
        constants = {} if setup is self._setup else self._fitting(setup, change)
        self.engine.clear()
        drawn = self.engine.water.drawn()  # noise of the same seed and constants is not drawn again
        self.image.fixed[:] = self._start
        self.engine.write_time(setup)
        self.engine.write_wall(setup)
        if self._has_other_tables:
            for room, (_, table) in self._tables.items():
                self.image.put(room, table)
            self._has_other_tables = False
        if setup is not self._setup:
            write_time(self, setup)
            write_initial(self, setup)
            self._write(setup, constants, change)
        self.engine.water.keep(drawn)
        self.stages.start(setup.scenario)

    def begin(self, setup: Setup) -> None:
        """As :meth:`restart`, also with another vehicle, in an engine that has it in the record. Raises InputError also
        for a setup that the engine can't run, with other stages or contacts, or whose record has another shape."""
        self.engine.refuse(setup)
        self.stages.refuse_others(setup)
        if setup.contacts.kinds != self._setup.contacts.kinds:
            raise InputError("the run has other walls or contacts than the first one")
        if not self._takes(shape_of(setup)):
            raise InputError("the run has another number of thrusters, contact bodies or effects than the first one")
        constants = self._fitting(setup)
        self.image.fixed[:] = self._start
        self._fill(setup)
        self.engine.enter(self.image, self.run, setup, self._entry_points)
        write_time(self, setup)
        write_initial(self, setup)
        self._write(setup, constants)

    def rewrite(self, setup: Setup) -> None:
        """Set the numbers of another setup with the same time and start, while the run goes on. Raises InputError as
        :meth:`restart` does."""
        constants = self._fitting(setup)
        self.stages.check_unchanged(setup.scenario)
        self.engine.write_wall(setup)
        self._write(setup, constants)

    def _takes(self, shape: Shape) -> bool:
        """Whether a run of a shape fits into this memory: it may have fewer effects."""
        room, asked = self.shape.effects, shape.effects
        fewer = all(asked[name].shape <= room[name].shape for name in EFFECTS)
        return fewer and replace(shape, effects=room) == self.shape

    def _fitting(self, setup: Setup, change: Change = ANYTHING) -> dict[str, dict[str, Any]]:
        """The constants of the stages that a change concerns. Raises InputError if they or a table do not fit into this
        memory."""
        if change.concerns(tables_of):
            for room, (key, table) in tables_of(setup).items():
                self.image.check_room(room, key, table)
        return self.stages.constants(setup, change)

    def _write(self, setup: Setup, constants: dict[str, dict[str, Any]], change: Change = ANYTHING) -> None:
        self._has_other_tables = change.concerns(tables_of)
        for write in WRITERS:
            if change.concerns(write, self):
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
        """Every signal by name as a read-only view: the signals that the law is given, and the recorded ones."""
        found = {signal.name: memory.reshape(signal.shape) for signal, memory in self.recorded}
        signals, base = self.stages.signals, self.run[self.stages.base]
        names = [signal.name for signal in type(self.stages.controller).given()]
        given = {name: signals[name] for name in names} | {s.name: base[s.name] for s in MEASURED}
        found = {name: each[0:1].reshape(each.shape[1:]) for name, each in given.items()} | found
        found["t"] = self.run["t"].reshape(())  # of the instant in hand; the row in memory is of the step before
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
    estimate(memory.run["model"], setup.nominal, setup.scenario.estimates)


def write_inertia(memory: RunMemory, setup: Setup) -> None:
    if not memory.shape.resolves:  # for a rigid vehicle at B it is constant
        memory.run["model"]["M"] = setup.design.M_hat


def write_sensor(memory: RunMemory, setup: Setup) -> None:
    if setup.scenario.wrist.runs:
        write_wrist(memory.run["wrist"], setup)


def write_epsilon(memory: RunMemory, setup: Setup) -> None:
    memory.run["epsilon"] = getattr(setup.scenario.controller, "epsilon", DEFAULT_EPSILON)  # of each axis


def write_limits(memory: RunMemory, setup: Setup) -> None:
    memory.stages.allocation["u_min"], memory.stages.allocation["u_max"] = setup.scenario.thrusters.command_limits(
        setup
    )


def write_effects(memory: RunMemory, setup: Setup) -> None:
    memory.engine.water.affect(setup.effects, setup.effect_rows)


def write_keys(memory: RunMemory, setup: Setup) -> None:
    memory.stages.write_keys(setup.scenario.simulation.seed_of, setup.scenario.vehicle.name)


def write_periods(memory: RunMemory, setup: Setup) -> None:
    memory.stages.write_periods(setup.scenario)


WRITERS: tuple[Callable[[RunMemory, Setup], None], ...] = (
    *(write_effects, write_contact, write_impedance, write_estimates, write_inertia),
    *(write_sensor, write_epsilon, write_limits, write_keys, write_periods),
)
"""Functions that set the numbers of a setup that may change during a run. Each depends on the setup alone, and on no
number in memory that another one has set from another part of it."""
