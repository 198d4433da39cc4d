"""Runs of the vehicles of a world, side by side or coupled."""

import contextlib
import itertools
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from ..errors import Fault, InputError
from ..physics.frames import quat_from_euler_deg
from ..plant import encounter
from ..plant.coupling import Coupling
from ..plant.mjcf import mujoco_warnings
from ..records.header import Sink
from ..records.trace import Trace
from ..setup.world import World, each_vehicle
from .coupling import CoupledSimulation, Lockstep, simulation_of
from .vehicle_run import Run, drive, followed, refuse_callers, row_steps_of, told


def simulate_world(
    world: World,
    log_rate: float | str | None,
    progress: Callable[[int, int], None] | bool | None,
    sinks: Sequence[Sink] | Mapping[str, Sequence[Sink]],
    keep_s: float | None,
    engine: str,
) -> dict[str, Trace]:
    """Run the vehicles of a world, a chunk of one after a chunk of the other. The end of one vehicle does not stop the
    others; an interrupt stops all."""
    if not isinstance(sinks, Mapping) or sinks.keys() - world.scenarios.keys():
        if sinks:
            raise InputError(f"sinks: of a world they are a mapping from the names of its vehicles, {world.label}")
        sinks = {}
    timestep = world.simulation.timestep
    row_steps, kept = row_steps_of(timestep, log_rate), np.inf if keep_s is None else keep_s
    each_vehicle(world.scenarios, lambda name: refuse_callers(world.scenarios[name]), "scenario")
    with (
        followed(progress, f"{world.name} · {world.label}", timestep) as advance,
        mujoco_warnings(),
        contextlib.ExitStack() as stack,
    ):
        begun = each_vehicle(
            world.scenarios, lambda name: stack.enter_context(simulation_of(world, name, engine)), "scenario"
        )
        runs = {}
        for name, sim in begun.items():
            notes = told(sim, f"{name}: ", stacklevel=4)
            runs[name] = Run(sim, row_steps, sinks.get(name, ()), kept, notes)
        _couple({name: run for name, run in runs.items() if name in world.coupled}, world.couplings)
        joined = {frozenset(each.vehicles) for each in world.couplings if each.kind in ("joint", "contact")}
        watch = _Encounters(runs, joined)

        def advanced(done: int, total: int) -> None:
            watch.look()
            advance(done, total)

        drive(runs, advanced)
        return {name: run.result(f"{name}: ") for name, run in runs.items()}


def _couple(runs: Mapping[str, Run], couplings: Sequence[Coupling]) -> None:
    """Let runs of coupled vehicles take their steps together, and their rows at the same steps."""
    if not runs:
        return
    sims = {name: run.sim for name, run in runs.items() if isinstance(run.sim, CoupledSimulation)}
    together = Lockstep(sims, couplings)
    most = min(run.most for run in runs.values())
    for name, run in runs.items():
        run.most, run.advance = most, together.of(name)


class EncounterWarning(UserWarning):
    """Two vehicles of a world are in each other's way, and pass through each other."""


class _Motion:
    """The boxes around the vehicle of a run."""

    def __init__(self, run: Run) -> None:
        self._setup = run.sim.setup
        ends = np.cumsum([signal.size for signal in run.sim.recorded])
        places = {s.name: np.arange(end - s.size, end) for s, end in zip(run.sim.recorded, ends, strict=True)}
        self._places = np.concatenate([places[name] for name in ("t", "p_WB", "quat_WB", "q") if name in places])

    def of(self, blocks: Sequence[np.ndarray]) -> np.ndarray:
        """(n, 8 + joints) time, position, attitude and joints of blocks of rows."""
        return np.concatenate([np.zeros((0, self._places.size)), *(block[:, self._places] for block in blocks)])

    def start(self) -> encounter.Boxes:
        """The boxes at the start."""
        initial = self._setup.scenario.initial
        p, quat = np.array([initial.position]), quat_from_euler_deg(*initial.attitude_deg)[None]
        return encounter.boxes(self._setup.plant.geometry, p, quat, np.array([self._setup.initial_joints]))

    def boxes(self, rows: np.ndarray) -> encounter.Boxes:
        """The boxes at some rows of :meth:`of`."""
        return encounter.boxes(self._setup.plant.geometry, rows[:, 1:4], rows[:, 4:8], rows[:, 8:])


class _Encounters:
    """Looks whether the boxes around two vehicles overlap, at some instants of each chunk."""

    _MOST = 20
    """Instants of a chunk at which it looks."""

    def __init__(self, runs: Mapping[str, Run], joined: Collection[frozenset[str]]) -> None:
        """Raises InputError if one vehicle is inside another at the start. Vehicles that are ``joined`` may be."""
        self._runs, self._motions = runs, {name: _Motion(run) for name, run in runs.items()}
        self._new = {name: self._motions[name].of(run.taken_fresh()) for name, run in runs.items()}
        self._pairs = {pair for pair in itertools.combinations(runs, 2) if frozenset(pair) not in joined}
        start = {name: motion.start() for name, motion in self._motions.items()}
        faults = [
            Fault(f"vehicles[{two}].initial", f"is inside {one!r}: the boxes around both overlap by {-gap:.3g} m")
            for one, two in sorted(self._pairs)
            if (gap := float(encounter.gap(start[one], start[two])[0])) < 0.0
        ]
        if faults:
            raise InputError(faults, "scenario")

    def look(self) -> None:
        """Warn of every pair that overlaps for the first time."""
        for name, run in self._runs.items():
            self._new[name] = np.concatenate([self._new[name], self._motions[name].of(run.taken_fresh())])
        ended = {name for name, run in self._runs.items() if run.ended and not len(self._new[name])}
        self._pairs = {pair for pair in self._pairs if ended.isdisjoint(pair)}
        n = min((len(rows) for name, rows in self._new.items() if name not in ended), default=0)
        chosen = np.unique(np.linspace(0, n - 1, self._MOST).astype(int)) if n else []
        there = {name: self._motions[name].boxes(rows[chosen]) for name, rows in self._new.items() if n}
        for one, two in sorted(self._pairs if n else ()):
            if (inside := encounter.overlap(there[one], there[two])).any():
                t = float(self._new[one][chosen[inside.argmax()], 0])
                said = "contact between vehicles is not computed without a coupling, and they pass through each other"
                warnings.warn(
                    f"{one} and {two} meet at t = {t:.4g} s: {said}", EncounterWarning, stacklevel=6
                )  # simulate's caller
                self._pairs.discard((one, two))
        self._new = {name: rows[n:] for name, rows in self._new.items()}
