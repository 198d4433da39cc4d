"""One trial: all runs of the study with some gains, and what the objective and the constraints make of them."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import InputError
from ..plan import Plan
from ..plan.places import overrides_at
from ..pool.bundle import StudyBundle
from ..pool.execution import run_by_run
from ..pool.executors import WorkerLost, each_call, size_of
from ..rows import lost_row, one_row
from .tables import Constraint, Measure, Objective

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
