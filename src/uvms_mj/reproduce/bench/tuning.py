"""Gains of a law for all tasks at once, by a stated budget: so many trials for every law, of the same draws.

A trial has one factor for each gain of the law, from 1/6 to 6, and runs one development draw of levels 1, 3 and 5 of
each task. Its cost is the mean over these runs of the largest share that a criterion's value has of its bound, at most
:data:`WORST`. Up to 1 a run is passed; beyond it the cost shows the search the way.
"""

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

from ...errors import InputError
from ...files import locked
from ...studies.bundle import StudyBundle
from ...studies.pages import write
from ...studies.plan import Plan
from ...studies.plan.metrics import COMPLETED
from ...studies.pool.execution import run_by_run
from ...studies.pool.executors import WorkerLost, each_call
from ...studies.tune.problem import Gain, Outcome, Search, rows_of, with_gains
from ...studies.tune.search import Journal, search
from .. import Progress
from .task import LEVELS, Entry, Task, identity

SEARCHED = LEVELS[::2]
"""The levels of a trial."""
RANGE = 6.0
"""The factors of gains are from its inverse to it."""
WORST = 3.0
"""The cost of a run that fails by far, or does not complete."""
LAWS = "laws.toml"
"""The laws with their own and with tuned gains, a file that ``uvms-mj bench`` takes."""
FOLDER = "tuning"
"""The folder of a law's trials, in the folder of the law."""


@dataclass(frozen=True)
class TunedGain:
    """A setting of a law that is scaled: its key, and its numbers."""

    key: str
    value: float | list[float]

    def scaled(self, factor: float) -> float | list[float]:
        """The setting times a factor, to four digits."""
        if isinstance(self.value, list):
            return [float(f"{factor * x:.4g}") for x in self.value]
        return float(f"{factor * self.value:.4g}")

    def places(self, factor: float) -> Iterator[tuple[str, float]]:
        """Its numbers by place, scaled."""
        scaled = self.scaled(factor)
        if isinstance(scaled, list):
            yield from ((f"{self.key}[{i}]", x) for i, x in enumerate(scaled))
        else:
            yield self.key, scaled


def gains_of(plan: Plan) -> list[TunedGain]:
    """The gains of a law that are tuned: its settings that are a positive number, or a list of numbers that are not
    negative, and not all zero; and K_f of eq. (7), the gain of the force, which no task sets. Control rate and delay
    are the task's."""
    scenario = plan.laws[0].scenario.to_dict()
    settings = {f"controller.{name}": value for name, value in scenario["controller"].items()} | {
        "impedance.K_f": scenario["impedance"]["K_f"]
    }
    found = []
    for key, value in settings.items():
        numbers = value if isinstance(value, list) else [value]
        given = bool(numbers) and all(isinstance(x, float) and 0.0 <= x < math.inf for x in numbers)
        if given and max(numbers) > 0.0 and key not in ("controller.period", "controller.delay"):
            found.append(TunedGain(key, value))
    return found


def cost(task: Task, row: Mapping[str, Any]) -> float:
    """The cost of a run, from 0 to :data:`WORST`: the largest share that a criterion's value has of its bound. Beyond a
    bound of zero, and outside of bounds that are equal, it is 1 and the distance."""
    if row["status"] != COMPLETED:
        return WORST
    worst = 0.0
    for name, (low, high) in task.criteria.items():
        value = row.get(name)
        if value is None or not math.isfinite(value):
            return WORST
        beyond = max(low - value, value - high)
        worst = max(worst, value / high if low < high else 1.0 + beyond if beyond > 0.0 else 0.0)
    return min(worst, WORST)


def tuned(
    entry: Entry,
    tasks: Sequence[Task],
    folder: Path,
    trials: int,
    executor: Executor,
    advance: Callable[[int], None],
) -> Entry:
    """Tune a law on the tasks that it can run on, and return it with the best gains, labelled as tuned.

    Trial 0 has the law's own gains. The folder keeps the trials, and a search goes on where it was. ``advance`` is
    called with the number of trials that are done. Raises InputError if the law has no gain, or runs on no task.
    """
    plans = list(_plans(entry, tasks))
    if not plans:
        raise InputError(f"{entry.label}: can't run on any task")
    bundles = [(task, StudyBundle.of(plan)) for task, plan in plans]
    first = plans[0][1]
    gains = gains_of(first)
    if not gains:
        raise InputError(f"{entry.label}: has no gain to tune: no setting of its own is a positive number")

    def evaluate(factors: Mapping[str, float]) -> Outcome:
        values = dict(pair for gain in gains for pair in gain.places(factors[gain.key]))
        try:
            with_gains(first, values)
        except InputError as error:
            return Outcome("incomplete", str(error), WORST, (), (0.0,), 0)
        costs = {}

        def take(call: tuple[Any, ...], answer: Any) -> None:
            (i,) = call[3]
            costs[i] = WORST if isinstance(answer, WorkerLost) else cost(bundles[i][0], answer)

        calls = ((bundle, values, 0, (i,)) for i, (_, bundle) in enumerate(bundles))
        each_call(executor, _row, calls, take, lambda: None, run_by_run)
        return Outcome("feasible", "", math.fsum(costs.values()) / len(costs), (), (0.0,), len(costs))

    place = folder / entry.label / FOLDER
    with locked(place):
        journal = Journal(place, _name(first, plans), "minimize")
        kinds = [Gain(key=gain.key, log=True, high=RANGE, low=1.0 / RANGE) for gain in gains]
        start = {gain.key: 1.0 for gain in gains}
        done = len(journal.trials)
        advance(min(done, trials))
        settings = Search(trials=trials)
        search(kinds, start, "minimize", settings, journal, evaluate, lambda number, _: advance(number + 1))
        best = min(journal.trials[:trials], key=lambda trial: trial.value)
    found = {gain.key: gain.scaled(best.params[gain.key]) for gain in gains}
    return Entry(f"{entry.label}, tuned", entry.source, {**entry.settings, **found}, trials)


def tuned_laws(
    entries: Sequence[Entry], tasks: Sequence[Task], folder: Path, trials: int, executor: Executor, told: Progress
) -> list[Entry]:
    """Each law with its own gains, and behind it with tuned ones where it has gains; the yardstick is not tuned. The
    folder gets them as a file of laws. ``told`` is called with the trials that are done, and their number."""
    found = list[Entry]()
    searched = [entry for entry in entries if not entry.knows and gains_of(next(_plans(entry, tasks))[1])]
    for entry in entries:
        found.append(entry)
        if entry in searched:
            before = searched.index(entry) * trials
            found.append(
                tuned(entry, tasks, folder, trials, executor, lambda n, b=before: told(b + n, len(searched) * trials))
            )
    laws = [{"name": each.source, "label": each.label, **each.budget, **each.settings} for each in found]
    write(folder / LAWS, tomli_w.dumps({"laws": laws}))
    return found


def _row(bundle: StudyBundle, values: Mapping[str, float], index: int, _: tuple[int, ...]) -> dict[str, Any]:
    """The row of one run, in a worker."""
    return rows_of(bundle, dict(values), (index,))[0]


def _plans(entry: Entry, tasks: Sequence[Task]) -> Iterator[tuple[Task, Plan]]:
    """The development draws of the tasks that a law can run on, at the levels of a search."""
    for task in tasks:
        try:
            yield from [(task, entry.plan(task, level, most=1)) for level in SEARCHED]
        except InputError:
            continue


def _name(first: Plan, plans: Sequence[tuple[Task, Plan]]) -> str:
    """A name for a search, of all that decides a trial: the law, its own gains, and the tasks."""
    parts = [identity(first)["digest"], *dict.fromkeys(task.digest for task, _ in plans)]
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()[:16]
