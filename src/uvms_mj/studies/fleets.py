"""The runs of a study with the engine gpu: runs of one kind are a fleet.

Workers make the records with which the runs start, and compute the metrics. The GPU takes all steps in between, and
gives the rows that the metrics need: the last one, and some before it (:attr:`uvms_mj.analysis.summary.Number.rows`).

A run goes to this machine's processor, with a reason, if a fleet can't run it, if a metric needs other rows, or if it
stops early: then the engine free_body gives its last row and its message.
"""

import functools
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.summary import ENDING
from ..control.theory.predictions import steady_state
from ..engine.fleet import DEVICES, Fleet, NotInFleet, Starts
from ..engine.vehicle_run import row_steps_of
from ..errors import InputError
from ..records.header import Header, Outcome, Status, versions
from ..records.trace import Trace
from ..setup.base import set_up
from ..setup.checks import warnings_of
from .plan.metrics import METRICS
from .pool.executors import each_call

if TYPE_CHECKING:
    from .bundle import StudyBundle
    from .plan import Plan

GPU = "gpu"
"""The name of the engine."""
MOST = 1 << 17
"""Runs of a fleet at once: enough to fill a GPU twice."""
_OF_CALL = 64
"""Runs whose starts a worker makes in one call."""


class CpuWarning(UserWarning):
    """Runs of a study with the engine gpu ran on this machine's processor; the message says why."""


def no_fleet(plan: "Plan") -> str:
    """Why no run of a plan can be of a fleet; empty if nothing is known yet."""
    lacking = [place for place in plan.metrics if place not in METRICS or METRICS[place].rows is None]
    if lacking:
        return f"keep.metrics: {lacking[0]} needs rows of the whole run"
    if plan.time_limit_s is not None:
        return "run.time_limit_s: the runs of a fleet have one clock"
    return ""


def rows_before(plan: "Plan") -> tuple[tuple[float, float], ...]:
    """The rows that the metrics of a plan need: lengths of the end of a run, and the time from row to row [s]."""
    return tuple(sorted({ENDING, *(METRICS[place].rows for place in plan.metrics)}))  # type: ignore[type-var]


def instants(steps: int, timestep: float, rows: Sequence[tuple[float, float]]) -> list[int]:
    """The time steps of the rows of a run, the last one included."""
    found = {steps}
    for length, apart in rows:
        every = max(1, round(apart / timestep))
        found |= {steps - k * every for k in range(int(length / apart + 1e-9) + 1)}
    return sorted(step for step in found if step >= 0)


SIGNALS = (
    *("t", "p_WB", "quat_WB", "nu", "s", "z", "tau", "p_d", "nu_e", "push", "touches", "first_contact", "force_peak"),
    *("impulse", "final_impulse", "final_low", "final_high", "effort", "saturation_time", "tau_variation", "tau_max"),
)
"""The signals of the rows, where a run has them."""


@dataclass(frozen=True)
class Started:
    """The starts of the runs that a fleet can take, by the kind of the fleet, and why it can't take the others.

    Attributes:
        columns, words: of each kind, the words that differ from the first run of its law, and their values (n, m).
    """

    indices: dict[tuple, list[int]]
    columns: dict[tuple, np.ndarray]
    words: dict[tuple, np.ndarray]
    refused: dict[int, str]


def _starts(bundle: "StudyBundle", first: int) -> Starts:
    """The starts of the runs of a law, once a process; ``first`` is one of them. Raises NotInFleet."""
    from .rows import vehicle_of

    key = bundle.digest, first
    if key not in _made:
        while len(_made) >= 8:
            del _made[next(iter(_made))]
        scenario = bundle.plan().scenario(first)
        _made[key] = Starts(scenario, vehicle_of(scenario.vehicle.model))
    return _made[key]


_made: dict[tuple[str, int], Starts] = {}


def starts_of(bundle: "StudyBundle", first: int, indices: tuple[int, ...]) -> Started:
    """Make the starts of some runs of one law in a worker; ``first`` is a run of the law that a fleet can run."""
    plan, starts = bundle.plan(), _starts(bundle, first)
    runs: dict[tuple, list[tuple[int, np.ndarray]]] = {}
    refused: dict[int, str] = {}
    for index in indices:
        try:
            scenario = plan.scenario(index)
            words = starts.of(scenario)
            stepping = scenario.simulation
            runs.setdefault((first, scenario.steps, stepping.timestep), []).append((index, words))
        except NotInFleet as error:
            refused[index] = str(error)
        except InputError:  # as a row says
            refused[index] = ""
    columns, words = {}, {}
    for kind, found in runs.items():
        table = np.array([each for _, each in found])
        columns[kind] = np.flatnonzero((table != starts.template).any(axis=0))
        words[kind] = table[:, columns[kind]]
    return Started({kind: [index for index, _ in found] for kind, found in runs.items()}, columns, words, refused)


def rows_from(
    bundle: "StudyBundle", first: int, indices: tuple[int, ...], samples: np.ndarray, compares: bool
) -> list[dict[str, Any] | str]:
    """The rows of a study of some runs in a worker, from their rows ``samples`` (n, rows, width); for a run of
    which a metric needs more than them, what it misses."""
    from .rows import comparing, row_of_trace

    plan, starts = comparing(bundle.plan()) if compares else bundle.plan(), _starts(bundle, first)
    signals = recorded(starts)
    found = []
    for index, rows in zip(indices, samples, strict=True):
        scenario = plan.scenario(index)
        setup = set_up(scenario, starts.mjcf)
        notes = tuple(warnings_of(setup))
        header = Header(
            scenario, signals, row_steps_of(scenario.simulation.timestep, None), functools.partial(steady_state, setup),
            notes, setup.plant.mjcf, setup.plant.geometry, {}, versions(), GPU,
        )  # fmt: skip
        trace = Trace.of(header, rows, Outcome(Status.completed, "", scenario.steps, 0.0))
        found.append(row_of_trace(plan, index, GPU, trace))
    return found


def recorded(starts: Starts) -> tuple[Any, ...]:
    """The signals of the rows of a run."""
    by_name = {signal.name: signal for signal, _ in starts.memory.recorded}
    return tuple(by_name[name] for name in SIGNALS if name in by_name)


class Fleets:
    """The runs of a plan on a GPU.

    Args:
        tick: is called some times a second.
        compares: whether the rows have the metrics that are compared between engines, in place of the plan's.
        device: the device of the fleets.

    Raises:
        InputError: there is no GPU.
    """

    def __init__(
        self, plan: "Plan", bundle: "StudyBundle", executor: Executor, tick: Callable[[], None],
        compares: bool = False, device: str = GPU,
    ) -> None:  # fmt: skip
        from .rows import comparing

        self.plan, self.compares = comparing(plan) if compares else plan, compares
        self.bundle, self.executor, self.tick, self.device = bundle, executor, tick, device
        DEVICES[device]().close()  # it is missed before the first start is made
        self._firsts: dict[int, int | None] = {}
        self._varying: dict[int, set[int]] = {}
        self.reasons = Counter[str]()
        self.moved: Callable[[float], None] = lambda share: None

    def run(self, indices: Sequence[int], take: Callable[[tuple[int, ...], list[dict[str, Any]]], None]) -> list[int]:
        """Run some runs. ``take`` gets indices, and their rows. Returns the runs that are left to the processor."""
        left = list[int]()
        if reason := no_fleet(self.plan):
            self.reasons[reason] += len(indices)
            return [*indices]
        laws = len(self.plan.laws)
        for law in range(laws):
            mine = [index for index in indices if index // self.plan.repeats % laws == law]
            for start in range(0, len(mine), MOST):
                left += self._some(mine[start : start + MOST], take)
        return sorted(left)

    def _some(self, indices: list[int], take: Callable) -> list[int]:
        """Runs of one law."""
        law = indices[0] // self.plan.repeats % len(self.plan.laws)
        if law not in self._firsts:
            self._firsts[law] = self._first(indices)
        first = self._firsts[law]
        if first is None:
            return indices
        left, kinds = list[int](), dict[tuple, list[tuple[list[int], np.ndarray, np.ndarray]]]()

        def keep(call: tuple[Any, ...], started: Any) -> None:
            if not isinstance(started, Started):  # it ended three workers
                left.extend(call[2])
                return
            for index, reason in started.refused.items():
                left.append(index)
                self.reasons[reason] += bool(reason)
            for kind, own in started.indices.items():
                kinds.setdefault(kind, []).append((own, started.columns[kind], started.words[kind]))

        calls = ((self.bundle, first, tuple(part)) for part in _parts(indices, _OF_CALL))
        each_call(self.executor, starts_of, calls, keep, self.tick)
        for kind, started in kinds.items():
            left += self._fleet(kind, started, take)
        return left

    def _first(self, indices: Sequence[int]) -> int | None:
        """A run of a law that a fleet can run; None if it can't run the first one of them that can run at all."""
        for index in indices:
            try:
                _starts(self.bundle, index)
                return index
            except NotInFleet as error:
                self.reasons[str(error)] += len(indices)
                return None
            except InputError:
                continue
        return None

    def _fleet(
        self, kind: tuple, started: Sequence[tuple[list[int], np.ndarray, np.ndarray]], take: Callable
    ) -> list[int]:
        """The runs of one kind."""
        first, steps, timestep = kind
        starts = _starts(self.bundle, first)
        indices = [index for own, _, _ in started for index in own]
        words = np.tile(starts.template, (len(indices), 1))
        at = 0
        for own, columns, values in started:
            words[at : at + len(own), columns] = values
            at += len(own)
        signals = recorded(starts)
        try:
            fleet = Fleet.of(starts, len(indices), signals=[s.name for s in signals], device=self.device)
        except NotInFleet as error:
            self.reasons[str(error)] += len(indices)
            return indices
        with fleet:
            try:
                fleet.start(words, self._varying.setdefault(first, set()))
                samples = self._samples(fleet, instants(steps, timestep, rows_before(self.plan)), steps)
            except NotInFleet as error:
                self.reasons[str(error)] += len(indices)
                return indices
            stopped = fleet.stopped
        whole = np.flatnonzero(~stopped)
        self.reasons["it stopped early, and free_body says why"] += int(stopped.sum())
        calls = (
            (
                self.bundle,
                first,
                tuple(indices[i] for i in part),
                samples[:, :, part].transpose(2, 0, 1).copy(),
                self.compares,
            )
            for part in _blocks(self.plan, indices, whole)
        )
        lost = list[int]()

        def keep(call: tuple[Any, ...], rows: Any) -> None:
            rows = rows if isinstance(rows, list) else ["its worker ended"] * len(call[2])
            there = [(index, row) for index, row in zip(call[2], rows, strict=True) if not isinstance(row, str)]
            for index, row in zip(call[2], rows, strict=True):
                if isinstance(row, str):
                    lost.append(index)
                    self.reasons[f"a metric needs other rows of a run like this: {row}"] += 1
            if there:
                take(tuple(index for index, _ in there), [row for _, row in there])

        each_call(self.executor, rows_from, calls, keep, self.tick)
        return [*lost, *(indices[i] for i in np.flatnonzero(stopped))]

    def _samples(self, fleet: Fleet, at: Sequence[int], steps: int) -> np.ndarray:
        """The rows of all runs at some time steps, (rows, width, n)."""
        found, done = [], 0

        def tell(more: int) -> None:
            self.moved((done + more) / max(1, steps))
            self.tick()

        for step in at:
            fleet.step(step - done, tell)
            done = step
            fleet.finish()
            found.append(fleet.table())
        return np.array(found)


def _parts(indices: Sequence[int], size: int) -> Iterator[Sequence[int]]:
    for start in range(0, len(indices), size):
        yield indices[start : start + size]


def _blocks(plan: "Plan", indices: Sequence[int], which: np.ndarray) -> Iterator[list[int]]:
    """Positions of runs, some hundred at a time; one part of the rows stays together."""
    from .results import blocks

    size, parts = len(blocks(plan.runs)[0]), dict[int, list[int]]()
    for i in which.tolist():
        parts.setdefault(indices[i] // size, []).append(i)
    for part in parts.values():
        yield from map(list, _parts(part, 256))
