"""A study from its first missing block to its last log; and its time and size, estimated from a short run of each
law."""

import functools
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any

from ...engine.run import simulate
from ...engine.vehicle_run import LawError
from ...errors import InputError
from ...scenario import Scenario
from ...setup.world import World
from ..bundle import StudyBundle
from ..fleets import GPU, CpuWarning, Fleets
from ..results import StudyFolder, blocks, frame, put, schema_of
from ..rows import (
    CHECK,
    LEAST,
    SHARE,
    checked,
    chosen_engine,
    compared,
    differences,
    log_of,
    lost_row,
    pair_of,
    rows_of,
    sample,
)
from .executors import WorkerLost, each_call

if TYPE_CHECKING:
    from ..plan import Plan


Progress = Callable[[str, int, int, int], None]
"""Called with what is being done, the number of runs done, how many of them did not complete, and their total."""


class Execution:
    """The runs of a study on an executor.

    Attributes:
        failures: rows so far whose status is not "completed".
    """

    def __init__(
        self, plan: "Plan", bundle: StudyBundle, results: StudyFolder, executor: Executor, progress: Progress
    ) -> None:
        self.plan, self.bundle, self.results, self.executor, self.progress = plan, bundle, results, executor, progress
        self._rows: dict[int, dict[int, dict[str, Any]]] = {}
        self.what, self.done, self.failures, self.total = "running", 0, 0, plan.runs

    def run(self, until: int | None = None) -> None:
        """Run everything that the folder lacks; or the blocks of the runs before ``until`` alone, and nothing after.

        Raises:
            InputError: the executor or its workers can't go on.
            OSError: a file can't be written, e.g. because the disk is full.
        """
        calls = []
        wanted = [block for block in self.results.blocks if until is None or block.start < until]
        self.total = wanted[-1].stop if wanted else 0
        for i, block in enumerate(wanted):
            statuses = self.results.statuses(i)  # of earlier sessions
            self.done += len(statuses)
            self.failures += sum(status != "completed" for status in statuses)
            calls += [] if statuses else [(self.bundle, tuple(block))]
        fleets = None
        if self.plan.engine == GPU and calls:
            fleets = Fleets(self.plan, self.bundle, self.executor, self._tick)
        self.results.begin()  # a study that misses its GPU leaves nothing
        if fleets is not None:
            calls = self._on_gpu(fleets, [index for _, block in calls for index in block])
        each_call(self.executor, rows_of, calls, self._take, self._tick, run_by_run)
        if len(wanted) < len(self.results.blocks):
            return
        self.results.finish()
        rows = frame(self.results.folder)
        self._check(rows)
        self._logs(rows)

    def _on_gpu(self, fleets: Fleets, indices: Sequence[int]) -> list[tuple[Any, ...]]:
        """Run what a GPU can run, and return the calls for all other runs."""

        def moved(share: float) -> None:
            self.what = f"running on the GPU, {share:.0%}"

        fleets.moved = moved
        left = fleets.run(indices, lambda own, rows: self._take((self.bundle, own), rows))
        self.what = "running"
        for reason, runs in fleets.reasons.most_common():
            if runs:
                told = f"{runs} of {self.plan.runs} runs are not run on the GPU: {reason}"
                warnings.warn(told, CpuWarning, stacklevel=2)
        size = len(self.results.blocks[0])
        parts: dict[int, list[int]] = {}
        for index in left:
            parts.setdefault(index // size, []).append(index)
        return [(self.bundle, tuple(part)) for part in parts.values()]

    def _tick(self) -> None:
        self.progress(self.what, self.done, self.failures, self.total)

    def _take(self, call: tuple[Any, ...], answer: Any) -> None:
        """Keep rows, and write the part of a block that is whole."""
        indices = call[1]
        rows = [lost_row(self.plan, indices[0])] if isinstance(answer, WorkerLost) else answer
        i = indices[0] // len(self.results.blocks[0])
        block = self._rows.setdefault(i, {})
        for row in rows:
            paths = self.plan.run(row["index"]).values if self.bundle.files else {}  # of this machine, not a worker's
            block[row["index"]] = row | paths
            self.done += 1
            self.failures += row["status"] != "completed"
        if len(block) == len(self.results.blocks[i]):
            self.results.write(i, [block[index] for index in self.results.blocks[i]])
            del self._rows[i]

    def _check(self, rows: Any) -> None:
        """Repeat a sample of the runs in a slower engine and keep the differences."""
        indices = sample(self.plan, rows)
        try:
            if not indices or checked(self.results.folder) is not None:
                return
        except InputError:
            self.results.damaged.append(CHECK)
        pairs: dict[tuple[int, str], dict[str, Any]] = {}

        def keep(row: Any, index: int, engine: str) -> None:
            pairs[index, engine] = row or {"status": "lost"}

        engines = pair_of(self.plan)
        if engines[0] == GPU:
            fleets = Fleets(self.plan, self.bundle, self.executor, self._tick, compares=True)
            left = {*fleets.run(indices, functools.partial(_by_index, pairs))}
            for reason, runs in fleets.reasons.items():
                if runs:
                    told = f"{runs} of {len(indices)} runs of the sample are not compared with {engines[1]}: {reason}"
                    warnings.warn(told, CpuWarning, stacklevel=2)
            indices = [index for index in indices if index not in left]
            if not indices:
                return
        calls = [(index, engine) for index in indices for engine in engines if engine != GPU]
        self._repeat(f"checking in {engines[1]}", compared, calls, keep)
        found = differences(self.plan, indices, pairs)
        put(self.results.folder / CHECK, found.to_parquet)

    def _logs(self, rows: Any) -> None:
        """Run those runs again whose logs are kept. A run is the same each time."""

        def keep(logs: Any, index: int, _: str) -> None:
            for name, log in (logs or {}).items():
                put(self.results.log(index, name), functools.partial(_write, log))

        engines = dict(zip(rows["index"].tolist(), rows["engine"].tolist(), strict=True))
        names = self.plan.vehicles or ("",)
        missing = [
            index
            for index in kept(self.plan, rows)
            if not all(self.results.log(index, name).exists() for name in names)
        ]
        self._repeat("writing logs", log_of, [(index, engines[index]) for index in missing], keep)

    def _repeat(
        self, what: str, task: Callable[..., Any], runs: Sequence[tuple[int, str]], keep: Callable[..., None]
    ) -> None:
        """Run some runs again, each by its index in an engine. ``keep`` gets what the task returns, or None if the run
        ended three workers, and the run."""
        self.what, self.done, self.total = what, 0, len(runs)

        def take(call: tuple[Any, ...], answer: Any) -> None:
            keep(None if isinstance(answer, WorkerLost) else answer, *call[1:])
            self.done += 1

        each_call(self.executor, task, ((self.bundle, *run) for run in runs), take, self._tick)


def _write(data: bytes, file: IO[bytes]) -> None:
    file.write(data)


def _by_index(pairs: dict[tuple[int, str], dict[str, Any]], indices: Sequence[int], rows: Sequence[dict]) -> None:
    pairs.update({(index, GPU): row for index, row in zip(indices, rows, strict=True)})


def run_by_run(call: tuple[Any, ...]) -> list[tuple[Any, ...]]:
    """A call for several runs, which are its last argument, as one call for each of them."""
    *before, indices = call
    return [(*before, (index,)) for index in indices] if len(indices) > 1 else []


def kept(plan: "Plan", rows: Any) -> list[int]:
    """The runs whose logs are kept."""
    logs = plan.logs
    if logs.kind == "listed":
        return sorted(set(logs.indices))
    if logs.kind == "failed":
        chosen = rows["status"].isin(["unstable", "failed", "timed_out"])
        return rows.loc[chosen, "index"].tolist()
    if logs.kind == "worst":
        worst = _size(rows, str(logs.metric)).dropna().nlargest(logs.k).index
        return rows.loc[worst, "index"].tolist()
    return []


def _size(rows: Any, metric: str) -> Any:
    """A metric of each row; of a vector or a dictionary, the largest magnitude of its numbers."""
    import pandas as pd

    name = metric.rpartition(":")[2] if ".py:" in metric else metric
    columns = [column for column in rows if column == name or column.startswith(f"{name}.")]
    numbers = rows[columns].apply(pd.to_numeric, errors="coerce").astype(float)
    return numbers[name] if columns == [name] else numbers.abs().max(axis="columns")


_STEPS_OF_GPU = 1e9
"""Steps a second of a GPU that is not full of runs."""
_PROBE_S = 0.2
"""Simulated time of a probe [s]."""
_PART_BYTES, _ROW_BYTES = 600, 9
"""Size of each column of a part, and of each number in it [bytes]."""


@dataclass(frozen=True)
class Estimate:
    """Expected wall time [s] of a study, and the sizes of its rows and of the log of one run [bytes]."""

    seconds: float
    rows_bytes: int
    log_bytes: int


def estimate(plan: "Plan", workers: int) -> Estimate:
    """Estimate a study on so many workers. A run that fails counts as one without steps."""
    steps, runs = plan.steps / len(plan.laws), plan.runs / len(plan.laws)
    seconds, log_bytes = 0.0, 0
    for law in range(len(plan.laws)):
        try:
            scenario = plan.scenario_or_world(law * plan.repeats)
            engine = chosen_engine(scenario) if plan.engine in ("auto", GPU) else plan.engine
            fixed_s, step_s, row_bytes = _probe(scenario, engine)
            if plan.engine == GPU and engine == "free_body":
                step_s = workers / _STEPS_OF_GPU
            seconds += runs * fixed_s + steps * step_s
            log_bytes = max(log_bytes, round(row_bytes * scenario.simulation.duration * 1000.0))
            if plan.engine == "auto" and engine == "free_body":
                repeated = min(runs, max(LEAST / len(plan.laws), SHARE * runs) + len(plan.metrics) / len(plan.laws))
                fixed_s, step_s, _ = _probe(scenario, "mujoco")
                seconds += repeated * (fixed_s + steps / runs * step_s)
        except (InputError, LawError):
            continue
    columns, parts = len(schema_of(plan)), len(blocks(plan.runs))
    return Estimate(seconds / workers, columns * (parts * _PART_BYTES + plan.runs * _ROW_BYTES), log_bytes)


def _probe(scenario: Scenario | World, engine: str) -> tuple[float, float, int]:
    """Wall times of a run besides its steps and of a step [s], and the size of a row of its log [bytes]. The first of
    two short runs loads what both need."""
    short = scenario.updated({"simulation.duration": min(_PROBE_S, scenario.simulation.duration)})
    for _ in range(2):
        start = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = simulate(short, keep_s=0.0, engine=engine)
        traces = [*found.values()] if isinstance(found, dict) else [found]
        whole_s, stepping_s = time.perf_counter() - start, sum(trace.wall_time_s for trace in traces)
    width = sum(trace.header.width for trace in traces)
    return whole_s - stepping_s, stepping_s / max(1, min(trace.steps for trace in traces)), 8 * width
