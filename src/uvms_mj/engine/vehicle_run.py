"""One vehicle's run from the initial state to the trace, and who takes part in it: guides and peers."""

import contextlib
import dataclasses
import functools
import time
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any, Protocol

import numpy as np
from pydantic import TypeAdapter, ValidationError

from ..control.theory.predictions import steady_state
from ..errors import Fault, InputError
from ..quantities import overrides_of
from ..records.header import LIVE_NOTE, Header, Outcome, Sink, Status, Values, sources_of, versions
from ..records.trace import Columns, Trace
from ..records.writing import Writing
from ..scenario import Scenario
from ..setup.checks import SamplingWarning
from ..views.progress import following
from .coupling import OtherStopped
from .native.plain_stage import StageFault
from .native.record import STOP_THRUST
from .simulation import CHUNK_S, Simulation

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


def drive(runs: "Mapping[str, Run]", advance: Callable[[int, int], None]) -> None:
    """Go through runs of the same number of steps, and call ``advance`` with the steps that all have done. An
    error between two chunks, or an interrupt of one run, stops them all."""
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


def followed(
    progress: Callable[[int, int], None] | bool | None, label: str, timestep: float
) -> AbstractContextManager[Callable[..., None]]:
    """The function that a run calls with the steps done and their total."""

    def shown(done: int, total: int) -> dict[str, float]:
        return {"done": done, "total": total, "simulated": done * timestep}

    return following(progress, label, "{simulated:.1f} s simulated", shown)


def refuse_callers(scenario: Scenario) -> None:
    """Raise InputError if a stage leaves its commands to the caller of a Simulation."""
    for stage in (scenario.controller, scenario.actuation):
        if stage.by_caller:
            needed = f"a run needs another {stage.room.noun}"
            wrong = f"{stage.label()} leaves {stage.by_caller} to the caller of a Simulation; {needed}"
            raise InputError([Fault(f"{stage.room.table}.name", wrong)], "scenario")


def told(sim: Simulation, whose: str = "", stacklevel: int = 3) -> tuple[str, ...]:
    """The notes of a Simulation, which are given as warnings after ``whose`` they are, at the line of the caller of
    ``simulate``."""
    notes = sim.notes
    for note in notes:
        slow = note in sim.slow_stages
        warnings.warn(f"{whose}{note}", PlainPythonWarning if slow else SamplingWarning, stacklevel=stacklevel)
    return notes


@dataclasses.dataclass
class Run:
    """One run, from the initial state to the trace.

    Attributes:
        row_steps: number of time steps from a row to the next.
        keep_s: length of the run's end that the trace keeps [s].
        notes: warnings with which it begins.
        ended: whether it has a trace.
        interrupted: whether somebody outside has stopped it.
        most: largest number of steps from one look at signals and rows to the next.
        advance: takes at most n steps, and returns how many it took. Coupled vehicles take them together.
    """

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

    def taken_fresh(self) -> list[np.ndarray]:
        """The rows since the last call, in blocks. From the first call on, a run keeps them for the next one."""
        fresh, self.fresh = self.fresh or [], []
        return fresh

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

    def result(self, whose: str = "") -> Trace:
        """The trace, when the run has ended. Raises what stopped it, with ``whose`` run it is before the message."""
        trace, raised, outcome = self._trace, self._raised, self._trace.outcome
        if isinstance(raised, StageFault):
            raise LawError(f"{whose}{outcome.message}", trace) from raised.__cause__
        if raised is not None:
            raise raised
        if self.writing.error is not None:
            raise SinkError(f"{whose}{self.writing.message}", trace) from self.writing.error
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
    """Remedies after a divergence: of a vehicle that has touched a wall, or of the thrust of a user's thrusters."""
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
