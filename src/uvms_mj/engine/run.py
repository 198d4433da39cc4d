"""``simulate(scenario) -> Trace`` runs a scenario in chunks at native speed."""

import contextlib
import dataclasses
import functools
import itertools
import time
import warnings
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing
from typing import Any, Protocol, overload

import numpy as np
from pydantic import TypeAdapter, ValidationError

from ..control import Controller
from ..control.base import Udp
from ..control.theory.predictions import steady_state
from ..errors import Fault, InputError, shortened
from ..physics.frames import quat_from_euler_deg
from ..plant import encounter
from ..plant.coupling import Coupling
from ..plant.mjcf import Mjcf, mujoco_warnings
from ..quantities import overrides_of
from ..records.header import LIVE_NOTE, Header, Outcome, Sink, Status, Values, sources_of, versions
from ..records.trace import Columns, Trace
from ..records.writing import Writing
from ..scenario import Scenario
from ..setup.checks import SamplingWarning
from ..setup.world import World
from ..views.progress import following
from .coupling import CoupledSimulation, Lockstep, OtherStopped
from .native.plain_stage import StageFault
from .native.record import STOP_THRUST
from .simulation import CHUNK_S, Simulation, valid_scenario
from .udp import UdpLaw

_GUIDED_S = 0.02
"""Wall time after which rows are passed on while a run has guides, for a moving picture [s]."""


def header_of(sim: Simulation, row_steps: int = 1, notes: tuple[str, ...] = ()) -> Header:
    """The header of a record of a Simulation's run, with a row every so many time steps."""
    setup = sim.setup
    counts = {"thrusters": len(setup.vehicle.thrusters), "joints": len(setup.vehicle.arm.links)}
    return Header(
        scenario=sim.scenario,
        signals=sim.recorded,
        row_steps=row_steps,
        rest=functools.partial(steady_state, setup),
        notes=notes,
        mjcf=setup.plant.mjcf,
        geometry=setup.plant.geometry,
        sources=sources_of(sim.scenario, counts),
        versions=versions(),
        engine=sim.engine,
    )


class _Stopped(RuntimeError):
    """An exception that stopped a run after its first step. ``trace`` has the samples kept in memory."""

    def __init__(self, message: str, trace: Trace) -> None:
        super().__init__(message)
        self.trace = trace


class LawError(_Stopped):
    """A law raised, used an index out of bounds or gave a number that is not finite. The message names the law and,
    where it is known, the line; ``trace`` has the samples up to then."""


class SinkError(_Stopped):
    """A sink raised and stopped the run. ``trace`` has the samples kept in memory, ``__cause__`` the exception."""


class Peer(Protocol):
    """Another program that sets the commands of a run, in lockstep."""

    def command(self, sim: Simulation, idle: Callable[[], None]) -> int:
        """Wait for the other program's commands, and set them; while it waits, call ``idle`` several times a second.
        Returns the number of time steps that they are held; 0 ends the run."""

    def measure(self, sim: Simulation) -> None:
        """Give the other program the measurements of the instant in hand."""

    def finish(self, sim: Simulation) -> None:
        """Set the commands of the last instant, from which no step begins."""


class Guide(Protocol):
    """Somebody who watches a run: lets it go on, and changes numbers of its scenario."""

    def go_on(self, sim: Simulation, change: Callable[[Mapping[str, Any]], None]) -> int:
        """Wait until the run may go on. Returns the number of time steps until the next call, at least one.

        ``change`` takes numbers by dotted key, from the next step on; it raises InputError, and changes nothing, if one
        of them is no number or can't change in a run.
        """


Changes = Sequence[tuple[int, Mapping[str, Any]]]
_VALUES = TypeAdapter(Values)


class Again:
    """A guide that makes the changes of another run again, each before the same step.

    Args:
        changes: the changes that the other run's outcome names.
    """

    def __init__(self, changes: Changes) -> None:
        self._left = deque(changes)

    def go_on(self, sim: Simulation, change: Callable[[Mapping[str, Any]], None]) -> int:
        while self._left and self._left[0][0] <= sim.steps:
            change(self._left.popleft()[1])
        return self._left[0][0] - sim.steps if self._left else sim.chunk_steps


class PlainPythonWarning(UserWarning):
    """A law runs as plain Python because the language of the compiler lacks what it uses."""


@overload
def simulate(
    scenario: World,
    controller: None = None,
    *,
    log_rate: float | str | None = None,
    progress: Callable[[int, int], None] | bool | None = None,
    sinks: Mapping[str, Sequence[Sink]] | tuple[()] = (),
    keep_s: float | None = None,
    engine: str = "mujoco",
) -> dict[str, Trace]: ...
@overload
def simulate(
    scenario: Scenario | None = None,
    controller: Controller | None = None,
    *,
    log_rate: float | str | None = None,
    progress: Callable[[int, int], None] | bool | None = None,
    sinks: Sequence[Sink] = (),
    keep_s: float | None = None,
    engine: str = "mujoco",
    mjcf: Mjcf | None = None,
    peer: Peer | None = None,
    guides: Sequence[Guide] = (),
) -> Trace: ...


def simulate(
    scenario: Scenario | World | None = None,
    controller: Controller | None = None,
    *,
    log_rate: float | str | None = None,
    progress: Callable[[int, int], None] | bool | None = None,
    sinks: Sequence[Sink] | Mapping[str, Sequence[Sink]] = (),
    keep_s: float | None = None,
    engine: str = "mujoco",
    mjcf: Mjcf | None = None,
    peer: Peer | None = None,
    guides: Sequence[Guide] = (),
) -> Trace | dict[str, Trace]:
    """Run a scenario.

    Args:
        scenario: the scenario to run, or a world; default: the paper's.
        controller: a controller in place of the scenario's.
        log_rate: samples per second [Hz], which must divide the step rate; ``"full"`` for every step; default: 1 kHz,
            or a rate near it that divides the step rate.
        progress: True for a progress bar, or a function that is called after each chunk with the number of steps done
            and the run's number of steps.
        sinks: receivers of the samples during the run, e.g. ``McapLog("run.mcap")``; called on a separate thread. Of a
            world, a mapping from the names of vehicles to them.
        keep_s: length of the run's end that the trace keeps in memory [s]; default: the whole run.
        engine: "mujoco" or "free_body", as in :class:`Simulation`.
        mjcf: the vehicle's model, e.g. ``trace.header.mjcf``, in place of the file of ``scenario.vehicle.model``.
        peer: another program that sets what a stage leaves to the caller of a Simulation.
        guides: those who let the run go on, and change numbers of it, e.g. ``Again(trace.outcome.changes)``.

    Returns:
        The trace; of a world, the trace of each vehicle by its name. If the run diverged or was interrupted (Ctrl-C),
        the trace has the samples up to then, and ``trace.status`` gives the reason.

    Raises:
        InputError: the input is invalid; raised before the first step.
        LawError: the law raised, used an index out of bounds or gave a number that is not finite.
        SinkError: a sink raised, e.g. because the disk is full; its output up to then is kept.
    """
    if isinstance(scenario, World):
        if controller is not None or mjcf is not None or peer is not None or guides:
            raise InputError("controller, mjcf, peer and guides are of one vehicle; a world has several")
        return _simulate_world(scenario, log_rate, progress, sinks, keep_s, engine)
    if isinstance(sinks, Mapping):
        raise InputError("sinks: of one vehicle they are a list")
    scenario = valid_scenario(scenario)
    if controller is not None and not isinstance(controller, Controller):
        loaded = f'; a name belongs to the scenario: Scenario.load("push_wall", controller={shortened(controller)})'
        hint = loaded if isinstance(controller, str) else ""
        raise InputError(f"controller: expected a Controller, got {controller!r}; use e.g. Gsta(k_1=8.0){hint}")
    if controller is not None:
        scenario = dataclasses.replace(scenario, controller=controller)
    if isinstance(scenario.controller, Udp) and peer is None:
        with closing(UdpLaw.of(scenario)) as law:
            return simulate(
                scenario, log_rate=log_rate, progress=progress, sinks=sinks, keep_s=keep_s, engine=engine, mjcf=mjcf,
                peer=law, guides=guides,
            )  # fmt: skip
    row_steps = row_steps_of(scenario.simulation.timestep, log_rate)
    if peer is None:
        _refuse_callers(scenario)
    label = f"{scenario.name} · {scenario.controller.label()}"
    with (
        _followed(progress, label, scenario.simulation.timestep) as advance,
        mujoco_warnings(),
        Simulation(scenario, engine=engine, mjcf=mjcf, looks=False) as sim,
    ):
        run = _Run(sim, row_steps, sinks, np.inf if keep_s is None else keep_s, _told(sim), peer, guides)
        _drive({"": run}, advance)
        return run.result()


def _simulate_world(
    world: World,
    log_rate: float | str | None,
    progress: Callable[[int, int], None] | bool | None,
    sinks: Sequence[Sink] | Mapping[str, Sequence[Sink]],
    keep_s: float | None,
    engine: str,
) -> dict[str, Trace]:
    """Run the vehicles of a world, a chunk of one after a chunk of the other. What stops one vehicle does not stop the
    others, but for an interrupt, which stops all."""
    if not isinstance(sinks, Mapping) or sinks.keys() - world.scenarios.keys():
        if sinks:
            raise InputError(f"sinks: of a world they are a mapping from the names of its vehicles, {world.label}")
        sinks = {}
    timestep = world.simulation.timestep
    row_steps, kept = row_steps_of(timestep, log_rate), np.inf if keep_s is None else keep_s
    for scenario in world.scenarios.values():
        _refuse_callers(scenario)
    with (
        _followed(progress, f"{world.name} · {world.label}", timestep) as advance,
        mujoco_warnings(),
        contextlib.ExitStack() as stack,
    ):
        runs = {}
        for name, scenario in world.scenarios.items():
            kind = CoupledSimulation if name in world.coupled else Simulation
            sim = stack.enter_context(kind(scenario, engine=engine, looks=False))
            runs[name] = _Run(sim, row_steps, sinks.get(name, ()), kept, _told(sim, f"{name}: "))
        _couple({name: run for name, run in runs.items() if name in world.coupled}, world.couplings)
        joined = {frozenset(each.vehicles) for each in world.couplings if each.kind in ("joint", "contact")}
        watch = _Encounters(runs, joined)

        def advanced(done: int, total: int) -> None:
            watch.look()
            advance(done, total)

        _drive(runs, advanced)
        return {name: run.result() for name, run in runs.items()}


def _couple(runs: "Mapping[str, _Run]", couplings: Sequence[Coupling]) -> None:
    """Let runs take their steps together."""
    if not runs:
        return
    sims = {name: run.sim for name, run in runs.items() if isinstance(run.sim, CoupledSimulation)}
    together = Lockstep(sims, couplings)
    most = min(run.most for run in runs.values())
    for name, run in runs.items():
        run.most, run.advance = most, together.of(name)


class EncounterWarning(UserWarning):
    """Two vehicles of a world are in each other's way, and pass through each other."""


class _Encounters:
    """Looks whether the boxes around two vehicles overlap, at some instants of each chunk."""

    _MOST = 20
    """Instants of a chunk at which it looks."""

    def __init__(self, runs: "Mapping[str, _Run]", joined: Collection[frozenset[str]]) -> None:
        """Raises InputError if one vehicle is inside another at the start. Vehicles that are ``joined`` may be."""
        self._runs = runs
        self._new = {name: run.taken_fresh()[0] for name, run in runs.items()}
        self._pairs = {pair for pair in itertools.combinations(runs, 2) if frozenset(pair) not in joined}
        start = {name: run.start() for name, run in runs.items()}
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
            self._new[name] = np.concatenate([self._new[name], *run.taken_fresh()])
        ended = {name for name, run in self._runs.items() if run.ended and not len(self._new[name])}
        self._pairs = {pair for pair in self._pairs if ended.isdisjoint(pair)}
        n = min((len(rows) for name, rows in self._new.items() if name not in ended), default=0)
        chosen = np.unique(np.linspace(0, n - 1, self._MOST).astype(int)) if n else []
        there = {name: self._runs[name].boxes(rows[chosen]) for name, rows in self._new.items() if n}
        for one, two in sorted(self._pairs if n else ()):
            if (inside := encounter.gap(there[one], there[two]) < 0.0).any():
                t = float(self._new[one][chosen[inside.argmax()], 0])
                said = "contact between vehicles is not computed without a coupling, and they pass through each other"
                warnings.warn(f"{one} and {two} meet at t = {t:.4g} s: {said}", EncounterWarning, stacklevel=4)
                self._pairs.discard((one, two))
        self._new = {name: rows[n:] for name, rows in self._new.items()}


def _drive(runs: "Mapping[str, _Run]", advance: Callable[[int, int], None]) -> None:
    """Go through runs of the same number of steps, and call ``advance`` with the steps that all have done. What is
    raised between two chunks, or interrupts one run, stops them all."""
    going = {name: run.going() for name, run in runs.items()}
    done = dict.fromkeys(going, 0)
    try:
        while going:
            for name in list(going):
                if (now := next(going[name], None)) is None:
                    del going[name], done[name]
                    if runs[name].interrupted:
                        raise KeyboardInterrupt
                else:
                    done[name] = now
            if going:
                advance(min(done.values()), next(iter(runs.values())).scenario.steps)
    except (KeyboardInterrupt, Exception) as error:
        for each in going.values():
            with contextlib.suppress(StopIteration, type(error)):
                each.throw(error)
        if not all(run.ended for run in runs.values()):  # it came before a first step
            raise


def _followed(
    progress: Callable[[int, int], None] | bool | None, label: str, timestep: float
) -> AbstractContextManager[Callable[..., None]]:
    """What a run calls with the steps done and their total."""

    def shown(done: int, total: int) -> dict[str, float]:
        return {"done": done, "total": total, "simulated": done * timestep}

    return following(progress, label, "{simulated:.1f} s simulated", shown)


def _refuse_callers(scenario: Scenario) -> None:
    """Raise InputError if a stage leaves its commands to the caller of a Simulation."""
    for stage in (scenario.controller, scenario.actuation):
        if stage.by_caller:
            needed = f"a run needs another {stage.room.noun}"
            wrong = f"{stage.label()} leaves {stage.by_caller} to the caller of a Simulation; {needed}"
            raise InputError([Fault(f"{stage.room.table}.name", wrong)], "scenario")


def _told(sim: Simulation, whose: str = "") -> tuple[str, ...]:
    """The notes of a Simulation, which are given as warnings."""
    notes = sim.notes
    for note in notes:
        slow = note in sim.slow_stages
        warnings.warn(f"{whose}{note}", PlainPythonWarning if slow else SamplingWarning, stacklevel=3)
    return notes


@dataclasses.dataclass
class _Run:
    """One run, from the initial state to the trace."""

    sim: Simulation
    row_steps: int
    sinks: Sequence[Sink]
    keep_s: float
    notes: tuple[str, ...]
    peer: Peer | None = None
    guides: Sequence[Guide] = ()

    def __post_init__(self) -> None:
        self.scenario, self.memory = self.sim.scenario, self.sim.record(self.row_steps)
        self.blocks: deque[np.ndarray] = deque()
        self._taken_at = time.monotonic()
        self._rows_every_s = _GUIDED_S if self.guides else CHUNK_S
        self._changes: list[tuple[int, dict[str, Any]]] = []
        self.interrupted, self.ended, self._stepping_s = False, False, 0.0
        self.fresh: list[np.ndarray] | None = None  # the blocks that nobody has looked at, if somebody does
        self.most = self.sim.chunk_steps
        self.advance: Callable[[int], int] = lambda n: self.sim.run(n, CHUNK_S)

    @functools.cached_property
    def _of_motion(self) -> np.ndarray:
        """The places in a row of the time, the position, the attitude and the positions of joints."""
        ends = np.cumsum([signal.size for signal in self.sim.recorded])
        places = {s.name: np.arange(end - s.size, end) for s, end in zip(self.sim.recorded, ends, strict=True)}
        return np.concatenate([places[name] for name in ("t", "p_WB", "quat_WB", "q") if name in places])

    def taken_fresh(self) -> list[np.ndarray]:
        """Time, position, attitude and joints of the rows since the last call, after no row."""
        fresh, self.fresh = self.fresh or [], []
        return [np.zeros((0, self._of_motion.size)), *(block[:, self._of_motion] for block in fresh)]

    def start(self) -> encounter.Boxes:
        """The boxes around the vehicle at its start."""
        setup = self.sim.setup
        initial = setup.scenario.initial
        p, quat = np.array([initial.position]), quat_from_euler_deg(*initial.attitude_deg)[None]
        return encounter.boxes(setup.plant.geometry, p, quat, np.array([setup.initial_joints]))

    def boxes(self, rows: np.ndarray) -> encounter.Boxes:
        """The boxes around the vehicle at some rows of :meth:`taken_fresh`."""
        return encounter.boxes(self.sim.setup.plant.geometry, rows[:, 1:4], rows[:, 4:8], rows[:, 8:])

    def going(self) -> Generator[int]:
        """Step until the run ends or is stopped. Yields the number of steps done after each chunk; a KeyboardInterrupt
        that is thrown in there stops the run, as one that is raised by a signal."""
        notes = (*self.notes, LIVE_NOTE) if self.guides else self.notes
        header = header_of(self.sim, self.row_steps, notes)
        with Writing(self.sinks, header) as self.writing:
            outcome, self._raised = yield from self._outcome()
            self._take_rows()
            self.writing.end(outcome)
        self._trace, self.ended = Trace(header, Columns(header, [*self.blocks]), outcome), True

    def result(self) -> Trace:
        """The trace, when the run has ended. Raises what stopped it."""
        trace, raised, outcome = self._trace, self._raised, self._trace.outcome
        if isinstance(raised, StageFault):
            raise LawError(outcome.message, trace) from raised.__cause__
        if raised is not None:
            raise raised
        if self.writing.error is not None:
            raise SinkError(self.writing.message, trace) from self.writing.error
        return trace

    def _outcome(self) -> Generator[int, None, tuple[Outcome, Exception | None]]:
        """Step to the end. Returns the outcome, and the exception of a stage or of another part, if any."""
        sim, status, message = self.sim, Status.completed, ""
        raised: Exception | None = None
        try:
            for done in self._timed(self._chunks() if self.peer is None else self._exchanges(self.peer)):
                yield done
                if sim.divergence:
                    touched = self.memory.run["row"]["touches"][0] > 0.0
                    own = not (self.scenario.thrusters.is_shipped and self.scenario.actuation.is_shipped)
                    of_thrusters = own and self.memory.run["stop"][0] == STOP_THRUST
                    advice = f"{_warned(self.notes)}{_hint(touched, of_thrusters)}"
                    status, message = Status.unstable, f"t = {sim.t:.6g} s: {sim.divergence}. {advice}"
                    break
                if self.writing.error is not None:
                    status, message = Status.failed, f"t = {sim.t:.6g} s: {self.writing.message}"
                    break
        except OtherStopped as other:
            status, message = Status.failed, f"t = {sim.t:.6g} s: {other} has stopped, to which it is coupled"
        except KeyboardInterrupt:
            self.interrupted = True
            status, message = Status.interrupted, f"t = {sim.t:.6g} s: stopped from outside"
        except Exception as error:  # a StageFault, or an error of this package
            status, raised, message = Status.failed, error, f"t = {sim.t:.6g} s: {error}"
        steps = min(sim.steps, self.scenario.steps)
        return Outcome(status, message, steps, self._stepping_s, tuple(self._changes)), raised

    def _timed(self, chunks: Iterator[int]) -> Iterator[int]:
        """The chunks, with the wall time that they take. Between two of them other vehicles may step."""
        while True:
            start = time.perf_counter()
            try:
                done = next(chunks)
            except StopIteration:
                return
            finally:
                self._stepping_s += time.perf_counter() - start
            yield done

    def _allowed(self) -> int:
        """The steps until the guides are asked again, after they have let the run go on."""
        return min((guide.go_on(self.sim, self._change) for guide in self.guides), default=self.sim.chunk_steps)

    def _change(self, given: Mapping[str, Any]) -> None:
        try:
            values: dict[str, Any] = _VALUES.validate_python(overrides_of(given), strict=True)
        except ValidationError as error:
            raise InputError([Fault(name, "only numbers change in a run") for name in _places(error)]) from None
        self.sim.set(values)
        self._changes.append((self.sim.steps, values))

    def _chunks(self) -> Iterator[int]:
        """Step through the run. The rows of a chunk are taken even if it raises."""
        sim, steps, done, most = self.sim, self.scenario.steps, 0, self.most
        while done < steps:
            try:
                done += self.advance(min(most - done % most, steps - done, self._allowed()))
            finally:
                self._take_rows()
            sim.check()
            if not sim.divergence and done == steps:  # the final state, from which no step begins
                sim.finish()
                self._take_rows()
                sim.check()
            yield done

    def _exchanges(self, peer: Peer) -> Iterator[int]:
        """Step through the run with another program. The rows are taken when there are as many as of a chunk, or by
        wall time, also while the run waits."""
        sim, steps, done, taken = self.sim, self.scenario.steps, 0, 0
        try:
            while done < steps and not sim.divergence and (held := min(peer.command(sim, self._idle), steps - done)):
                end = done + held
                while done < end and not sim.divergence:
                    if done - taken == sim.chunk_steps or self._due():
                        self._take_rows()
                        yield done
                        taken = done
                    done += sim.run(min(end, taken + sim.chunk_steps, done + self._allowed()) - done, CHUNK_S)
                sim.check()
                peer.measure(sim)
        finally:
            self._take_rows()
        if not sim.divergence:
            peer.finish(sim)
            sim.finish()
            self._take_rows()
            sim.check()
        yield done

    def _due(self) -> bool:
        return time.monotonic() - self._taken_at > self._rows_every_s

    def _idle(self) -> None:
        if self._due():
            self._take_rows()

    def _take_rows(self) -> None:
        """Pass the rows on. An interrupt between any two lines, or a second call, neither loses nor repeats a row."""
        self._taken_at = time.monotonic()
        rows = self.memory.taken()
        if len(rows) and (not self.blocks or rows[0, 0] > self.blocks[-1][-1, 0]):
            block = rows.copy()
            block.setflags(write=False)  # sinks and trace share it
            first_step = round(block[0, 0] / self.scenario.simulation.timestep)
            self.writing.put(-(-first_step // self.row_steps), block)
            self.blocks.append(block)
            if self.fresh is not None:
                self.fresh.append(block)
        while len(self.blocks) > 1 and self.blocks[-1][-1, 0] - self.blocks[1][0, 0] >= self.keep_s:
            self.blocks.popleft()
        self.memory.clear()


def _places(error: ValidationError) -> list[str]:
    """The keys of the values that are no numbers."""
    return list(dict.fromkeys(str(each["loc"][0]) for each in error.errors()))


def _warned(notes: tuple[str, ...]) -> str:
    """The warnings with which a run began, for the message if it diverges."""
    if len(notes) < 2:
        return "".join(f"It began with a warning: {note}. " for note in notes)
    return f"It began with {len(notes)} warnings: {'; '.join(f'({i}) {note}' for i, note in enumerate(notes, 1))}. "


def _hint(touched: bool, of_thrusters: bool) -> str:
    """What to try after a divergence: of a vehicle that has touched a wall, or of the thrust of a user's thrusters."""
    ways = ["a smaller simulation.timestep", "smaller gains"]
    ways += ["a softer wall"] if touched else []
    ways += ["a longer time constant of the thrusters"] if of_thrusters else []
    return f"Try {', '.join(ways[:-1])}{',' * (len(ways) > 2)} or {ways[-1]}."


DEFAULT_LOG_RATE = 1000.0


def row_steps_of(timestep: float, log_rate: float | str | None) -> int:
    """Number of time steps between recorded rows.

    Args:
        timestep: [s].
        log_rate: [Hz], or "full" for every step, or None for the rate nearest to 1 kHz that divides the step rate.

    Raises:
        InputError: the rate does not divide the step rate; the message gives the nearest rates that do.
    """
    step_rate = 1.0 / timestep
    if log_rate is None:
        return max(1, round(step_rate / DEFAULT_LOG_RATE))
    if log_rate == "full":
        return 1
    try:
        rate = float(log_rate)
    except ValueError:
        rate = -1.0
    if not 1e-9 < rate < np.inf:
        raise InputError(f"log rate {log_rate!r}: must be a number of samples per second, or 'full'")
    row_steps = max(1, round(step_rate / rate))
    if abs(row_steps * rate - step_rate) > 1e-6 * step_rate:
        above = max(1, int(step_rate / rate))
        neighbours = f"{step_rate / (above + 1):.12g} and {step_rate / above:.12g} Hz"
        if rate > step_rate:
            neighbours = f"{step_rate:.6g} Hz, or 'full'"
        raise InputError(
            f"log rate {rate:g} Hz: must divide the step rate {step_rate:.6g} Hz; the nearest are {neighbours}"
        )
    return row_steps
