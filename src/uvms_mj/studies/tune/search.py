"""The search: Optuna suggests gains, trials answer, and a journal keeps every trial that is done. A trial is all runs
of the study with some gains, and what the objective and the constraints make of them.

The search goes on in memory, and a trial enters the journal when it is done. The seed, the trial's number and the
trials before it decide a suggestion, so that an interrupted search goes on with the same one.
"""

import dataclasses
import hashlib
import json
import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError, needs_extra, shortened
from ..plan import Plan
from ..plan.places import overrides_at
from ..pool.bundle import StudyBundle
from ..pool.execution import run_by_run
from ..pool.executors import WorkerLost, each_call, size_of
from ..rows import lost_row, one_row
from .problem import Constraint, Gain, Measure, Objective, Search

INCOMPLETE = 1e6
"""Violation that Optuna is told of a trial without all its numbers: beyond any limit's, so that it ranks last."""
_PER_WORKER = 4
"""Calls of a trial for each worker: few enough to cost little, and enough to share the load."""


@dataclass(frozen=True)
class Outcome:
    """The result of a trial.

    Attributes:
        state: "feasible"; "infeasible", beyond a limit; or "incomplete", a run did not complete or has no value.
        message: the limit that is exceeded most, or the reason why the trial is incomplete.
        objective: its value; None if incomplete.
        constraints: the value of each constraint; None if unknown.
        violations: for Optuna, feasible if none is positive: of completeness, then of each constraint [1].
        completed: number of runs that completed.
    """

    state: str
    message: str
    objective: float | None
    constraints: tuple[float | None, ...]
    violations: tuple[float, ...]
    completed: int


@dataclass(frozen=True)
class Trial:
    """A trial that is done: its number, its gains by place, and its outcome."""

    number: int
    gains: Mapping[str, float]
    outcome: Outcome


def with_gains(plan: Plan, values: Mapping[str, float]) -> Plan:
    """A plan of one law with other gains, by place. Raises InputError if they can't be used together."""
    (law,) = plan.laws
    overrides = overrides_at(values, law.tables)
    changed = {**law.overrides, **overrides}
    named = {"name": law.source, "label": law.label, **changed}
    law = dataclasses.replace(law, overrides=changed, scenario=law.scenario.updated(overrides))
    return dataclasses.replace(plan, laws=(law,), tables={**plan.tables, "laws": [named]})


def rows_of(bundle: StudyBundle, values: Mapping[str, float], indices: tuple[int, ...]) -> list[dict[str, Any]]:
    """The rows of some runs of a trial, in a worker."""
    plan = with_gains(bundle.plan(), values)
    return [one_row(plan, index) for index in indices]


def rows(
    plan: Plan, bundle: StudyBundle, values: Mapping[str, float], executor: Executor, tick: Callable[[], None]
) -> list[dict[str, Any]]:
    """The rows of all runs of a trial, in order. ``plan`` is the bundle's with these gains."""
    found: dict[int, dict[str, Any]] = {}

    def take(call: tuple[Any, ...], answer: Any) -> None:
        lost = isinstance(answer, WorkerLost)
        found.update((row["index"], row) for row in ([lost_row(plan, call[2][0])] if lost else answer))

    size = -(-plan.runs // (_PER_WORKER * size_of(executor)))
    blocks = (tuple(range(i, min(i + size, plan.runs))) for i in range(0, plan.runs, size))
    calls = ((bundle, values, indices) for indices in blocks)
    each_call(executor, rows_of, calls, take, tick, run_by_run)
    return [found[index] for index in range(plan.runs)]


def refused(constraints: Sequence[Constraint], error: InputError) -> Outcome:
    """The outcome of gains that can't be used together."""
    unknown = (None,) * len(constraints)
    return Outcome("incomplete", str(error), None, unknown, (INCOMPLETE, *(0.0 for _ in unknown)), 0)


def outcome(objective: Objective, constraints: Sequence[Constraint], found: Sequence[Mapping[str, Any]]) -> Outcome:
    """The outcome of a trial's rows."""
    ended = [row for row in found if row["status"] != "completed"]
    measures = (objective, *constraints)
    values = [_value(each, found) for each in measures]
    lacking = {each.metric: n for each in measures if (n := sum(_number(row, each) is None for row in found))}
    completed = len(found) - len(ended)
    if ended or lacking:
        violations = (
            INCOMPLETE * (1.0 + max(len(ended), *lacking.values(), 0) / len(found)),
            *(0.0,) * len(values[1:]),
        )
        if ended:
            first = ended[0]
            why = f"{len(ended)} of {len(found)} runs did not complete, e.g. {first['status']}: {first['message']}"
        else:
            why = "; ".join(f"{metric} has no value in {n} of {len(found)} runs" for metric, n in lacking.items())
        return Outcome("incomplete", why, None, (None,) * len(values[1:]), violations, completed)
    excess = [each.excess(value) for each, value in zip(constraints, values[1:], strict=True)]
    if max(excess, default=0.0) > 0.0:
        worst = int(np.argmax(excess))
        each, value = constraints[worst], values[1 + worst]
        message = f"{each.label} is {value:.4g}, not {each.limits}"
        return Outcome("infeasible", message, values[0], tuple(values[1:]), (0.0, *excess), completed)
    return Outcome("feasible", "", values[0], tuple(values[1:]), (0.0, *excess), completed)


def _number(row: Mapping[str, Any], measure: Measure) -> float | None:
    """A metric of a row; None if it has none, or an infinite one, which has no mean. Raises InputError if the rows have
    no such column."""
    column = measure.metric.rpartition(":")[2]
    if column not in row and row["status"] == "completed":
        raise InputError(f"{measure.metric}: the function returns several numbers; give one function for each")
    value = row.get(column)
    return None if value is None or not math.isfinite(value) else float(value)


def _value(measure: Measure, found: Sequence[Mapping[str, Any]]) -> Any:
    """The number of all runs; nan if a run lacks it."""
    each = np.array([np.nan if (value := _number(row, measure)) is None else value for row in found])
    if measure.q is not None:
        return float(np.quantile(each, measure.q))
    return float(each.mean() if measure.over == "mean" else each.max())


JOURNAL = "trials.journal"


def optuna() -> Any:
    """Optuna's module. Raises InputError if it is not installed."""
    with needs_extra("tune"):
        import optuna
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna


class Journal:
    """The trials of a folder, in Optuna's journal storage. This process alone writes to it."""

    def __init__(self, folder: Path, name: str, direction: str) -> None:
        self._optuna, path = optuna(), folder / JOURNAL
        if path.exists():
            _cut(path)
        self._path = path
        try:
            self._study = self._opened(name, direction)
        except OSError:
            raise
        except Exception as error:  # what Optuna raises for other data than its own is not documented
            raise self._damaged(f"{type(error).__name__}: {error}") from error

    def _opened(self, name: str, direction: str) -> Any:
        backend = self._optuna.storages.journal.JournalFileBackend(str(self._path), _NoLock())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            storage = self._optuna.storages.JournalStorage(backend)
            study = self._optuna.create_study(
                storage=storage, study_name=name, direction=direction, load_if_exists=True
            )
        if len(storage.get_all_studies()) > 1 or study.direction.name.lower() != direction:
            raise ValueError("it has another search")
        return study

    def _damaged(self, why: str) -> InputError:
        return InputError(f"{self._path}: damaged ({shortened(why)}); without it the search begins anew")

    @property
    def trials(self) -> list[Any]:
        """The trials that are done. Raises InputError if one is not what was kept."""
        try:
            found = self._study.get_trials(deepcopy=False)
        except Exception as error:  # as in the constructor
            raise self._damaged(f"{type(error).__name__}: {error}") from error
        for each in found:
            if each.user_attrs.get("checksum") != checksum(each):
                raise self._damaged(f"trial {each.number} does not have its checksum")
        return found

    def add(self, trial: Any) -> None:
        """Keep a trial. Raises OSError, for example if the disk is full."""
        self._study.add_trial(trial)


def checksum(trial: Any) -> str:
    """Checksum of a trial of Optuna: its number, gains, value and outcome."""
    kept = [trial.number, trial.params, trial.value, trial.user_attrs.get("outcome")]
    return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()[:32]


def _cut(path: Path) -> None:
    """Cut the line that a killed process or a full disk left unfinished."""
    data = path.read_bytes()
    if not data.endswith(b"\n"):
        with path.open("r+b") as file:
            file.truncate(data.rfind(b"\n") + 1)
            os.fsync(file.fileno())


class _NoLock:
    """A lock of the journal that does nothing: the folder is locked."""

    def acquire(self) -> bool:
        return True

    def release(self) -> None:
        pass


def search(
    gains: Sequence[Gain],
    start: Mapping[str, float],
    direction: str,
    settings: Search,
    journal: Journal,
    evaluate: Callable[[Mapping[str, float]], Outcome],
    done: Callable[[int, Outcome], None],
) -> None:
    """Run the trials that the journal lacks, one after the other. Trial 0 has the gains ``start``. ``done`` is called
    with the number and the outcome of each."""
    module = optuna()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # parts of the sampler are marked as experimental
        memory = module.create_study(direction=direction)
        memory.add_trials(journal.trials)
        for number in range(len(memory.trials), settings.trials):
            memory.sampler = _sampler(module, settings, number)
            if number == 0:
                memory.enqueue_trial(start)
            trial = memory.ask()
            values = {each.key: trial.suggest_float(each.key, each.low, each.high, log=each.log) for each in gains}
            found = evaluate(values)
            trial.set_user_attr("outcome", asdict(found))
            worst = math.inf if direction == "minimize" else -math.inf
            memory.tell(trial, worst if found.objective is None else found.objective)
            kept = memory.trials[-1]
            kept.set_user_attr("checksum", checksum(kept))
            journal.add(kept)
            done(number, found)


def _sampler(module: Any, settings: Search, number: int) -> Any:
    """The sampler of one trial, whose random numbers the seed and the trial's number decide."""
    seed = int.from_bytes(hashlib.sha256(f"{settings.seed} {number}".encode()).digest()[:4])
    if settings.sampler == "random":
        return module.samplers.RandomSampler(seed=seed)

    def violations(trial: Any) -> list[float]:
        return list(trial.user_attrs["outcome"]["violations"])

    return module.samplers.TPESampler(seed=seed, multivariate=True, constraints_func=violations)
