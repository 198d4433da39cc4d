"""A tuning file is read: a study file with tables for gains, objective, constraints and search; and its trials, which
are all runs of the study with some gains."""

import contextlib
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, TypeAdapter, ValidationInfo, model_validator
from pydantic import dataclasses as pydantic_dataclasses

from ...errors import Fault, InputError, shortened, suggestion
from ...files import plain
from ...quantities import STRICT, Number, Real, doc, overrides_of, within
from ...setup.world import VEHICLES, World
from ..bundle import StudyBundle
from ..plan import Plan
from ..plan.file import DEFAULT_METRICS, absolute, below_high, entries, read, used_with, valid, words_of
from ..plan.laws import Law, base_of, laws_of, split_overrides
from ..plan.metrics import METRICS, columns_of, kept_column, metric_of, number_of, parted
from ..plan.places import Place, missing, overlap, overrides_at, parsed, table_in, unit_of, value_at
from ..pool.execution import run_by_run
from ..pool.executors import WorkerLost, each_call, size_of
from ..rows import lost_row, one_row

_Quantile = Annotated[
    Annotated[Number, within(0.0, 1.0, "")] | None,
    used_with("over", {"quantile": ("q",)}),
    Field(validate_default=True),
]


def _at_most_at_most(at_least: float | None, info: ValidationInfo) -> float | None:
    at_most = info.data.get("at_most")
    if at_least is not None and at_most is not None and at_least > at_most:
        raise ValueError(f"must not exceed at_most, {at_most:g}")
    return at_least


@pydantic_dataclasses.dataclass(frozen=True, kw_only=True, config=STRICT)
class Gain:
    key: Place = doc("dotted key of a number, or a component of one, impedance.K_d[0]")
    log: bool = doc("whether its logarithm is searched", False)
    high: Real = doc("greatest value; the file's own is between them, and is trial 0")
    low: Annotated[Real, AfterValidator(below_high)] = doc("least value")


@pydantic_dataclasses.dataclass(frozen=True, config=STRICT)
class Measure:
    """A number of all runs of a trial: the mean, the largest value or a quantile of a metric."""

    metric: str = doc("a metric as in keep.metrics, its function's name, or a component of one")
    over: Literal["mean", "max", "quantile"] = doc('"mean", "max" or "quantile" of the runs, the last with q', "mean")
    q: _Quantile = doc("the quantile, from 0 to 1 [1]", None)

    @property
    def label(self) -> str:
        """Its name in tables: ``max contact.peak_N``."""
        over = f"{100.0 * self.q:g} % quantile" if self.q is not None else self.over
        return f"{over} {self.metric.rpartition('/')[2].rpartition(':')[2]}"


@pydantic_dataclasses.dataclass(frozen=True, config=STRICT)
class Objective(Measure):
    direction: Literal["minimize", "maximize"] = doc('"minimize" or "maximize"', "minimize")


@pydantic_dataclasses.dataclass(frozen=True, config=STRICT)
class Constraint(Measure):
    at_most: Real | None = doc("greatest value of a feasible trial", None)
    at_least: Annotated[Real | None, AfterValidator(_at_most_at_most)] = doc("least value of a feasible trial", None)

    @model_validator(mode="after")
    def _limited(self) -> "Constraint":
        if self.at_most is None and self.at_least is None:
            raise ValueError("give at_most or at_least, or both")
        return self

    def excess(self, value: float) -> float:
        """The violation of the nearer limit, relative to the limit unless that is 0; 0 within the limits."""
        pairs = ((self.at_most, 1.0), (self.at_least, -1.0))
        return max(0.0, *(sign * (value - limit) / (abs(limit) or 1.0) for limit, sign in pairs if limit is not None))

    @property
    def limits(self) -> str:
        """The limits in words."""
        pairs = (("at least", self.at_least), ("at most", self.at_most))
        return " and ".join(f"{words} {limit:g}" for words, limit in pairs if limit is not None)


@pydantic_dataclasses.dataclass(frozen=True, config=STRICT)
class Search:
    trials: Annotated[int, Field(strict=True, ge=1, le=1_000_000)] = doc(
        "number of trials, with trial 0, the file's own gains; a larger one later goes on with the same search", 100
    )
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = doc("of the suggestions", 0)
    sampler: Literal["tpe", "random"] = doc('of Optuna: "tpe", or "random" for comparison', "tpe")


TABLES: Mapping[str, Any] = {"gain": Gain, "objective": Objective, "constraint": Constraint, "tune": Search}


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
    law = dataclasses.replace(law, overrides=changed, scenario=law.scenario.updated(overrides))
    return dataclasses.replace(plan, laws=(law,), tables={**plan.tables, "laws": [law.written]})


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


_LISTS = ("gain", "constraint")
_SET = ("objective", "tune")
"""Tables whose keys can be set."""
_EXAMPLES = {"gain": 'key = "controller.k_1", low = 1.0, high = 20.0', "objective": 'metric = "contact.peak_N"'}


@dataclass(frozen=True, eq=False)
class Problem:
    """The unknowns of a tuning, and the comparison of its trials.

    Attributes:
        plan: the runs of each trial, of one law.
        gains: the gains to find, each with its range.
        start: the file's own gains by place, which are trial 0.
        objective, constraints: numbers of all runs of a trial.
        search: number of trials, seed and sampler.
        tables: the tuning file with absolute paths: ``Tuning.from_dict(tuning.tables)`` gives the same tuning.
    """

    plan: Plan
    gains: tuple[Gain, ...]
    start: Mapping[str, float]
    objective: Objective
    constraints: tuple[Constraint, ...]
    search: Search
    tables: dict[str, Any]

    @property
    def name(self) -> str:
        return self.plan.name

    def text(self) -> list[str]:
        """Gains, objective and constraints, one a line."""
        units = {gain.key: unit_of(gain.key, self.plan.laws[0].scenario) for gain in self.gains}
        lines = [
            f"gain {gain.key}{f' [{units[gain.key]}]' if units[gain.key] else ''}: {gain.low:g} to {gain.high:g}"
            f"{', logarithmic' if gain.log else ''}; {self.start[gain.key]:g} in the file"
            for gain in self.gains
        ]
        lines.append(f"objective: {self.objective.direction} {self.objective.label}")
        lines += [f"constraint: {each.label} {each.limits}" for each in self.constraints]
        return [*lines, f"{self.search.trials} trials of {self.plan.runs} runs, sampler {self.search.sampler}"]

    def compared(self, trials: list[Trial]) -> list[tuple[Any, ...]]:
        """Gains, objective and constraints of some trials: rows of a name and one value a trial."""
        names = [each.label for each in self.constraints]
        return [
            *((gain.key, *(each.gains[gain.key] for each in trials)) for gain in self.gains),
            (self.objective.label, *(each.outcome.objective for each in trials)),
            *((name, *(each.outcome.constraints[i] for each in trials)) for i, name in enumerate(names)),
        ]


def fields_of(
    tables: Mapping[str, Any], folder: Path, overrides: Mapping[str, Any] | None, place: str
) -> dict[str, Any]:
    """The fields of a :class:`Problem`, by name. It has the arguments of its ``from_dict``. Raises InputError
    with every error of the tables and the overrides."""
    faults: list[Fault] = []
    study, own, of_study = _split(tables, overrides, faults)
    found = _own_tables(own, folder, faults)
    measures = [each for name in ("objective", "constraint") for each in found[name]]
    study = _with_metrics(study, measures, folder, faults)
    plan = None
    try:
        plan = Plan.from_dict(study, folder, of_study)
    except InputError as error:
        faults += error.faults
    if plan is not None and len(plan.laws) > 1:
        laws = ", ".join(law.label for law in plan.laws)
        faults.append(Fault("laws", f"has {laws}; a tuning is of one law"))
    faults += [
        Fault(f"{place}.metric", f"name a vehicle: {plan.vehicles[0]}.{each.metric}")
        for place, each in measures
        if plan is not None and plan.vehicles and each.metric in {c for m in METRICS for c in columns_of(m)}
    ]
    law, varied = _law(study, folder, of_study)
    if law is not None and isinstance(law.scenario, World):
        varied = [law.scenario.named(place) for place in varied]
        found["gain"] = [
            (place, dataclasses.replace(gain, key=law.scenario.named(gain.key))) for place, gain in found["gain"]
        ]
    faults += _gain_faults(found["gain"], law, varied) if law is not None else []
    if faults or plan is None:
        raise InputError(faults, place)
    objective, search = found["objective"][0][1], found["tune"][0][1]
    written = {name: [plain(each) for _, each in found[name]] for name in _LISTS if found[name]}
    return {
        "plan": plan,
        "gains": tuple(gain for _, gain in found["gain"]),
        "start": {gain.key: float(value_at(gain.key, plan.laws[0].tables)) for _, gain in found["gain"]},
        "objective": objective,
        "constraints": tuple(each for _, each in found["constraint"]),
        "search": search,
        "tables": {**plan.tables, **written, "objective": plain(objective), "tune": plain(search)},
    }


def _split(
    tables: Mapping[str, Any], overrides: Mapping[str, Any] | None, faults: list[Fault]
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """The tables of the study, the tables of the tuning alone, and the overrides of the study."""
    own = {name: tables[name] for name in TABLES if name in tables}
    of_study = {}
    for key, value in overrides_of(overrides).items():
        table, _, word = key.partition(".")
        if table in _SET and word:
            inner = own.get(table, {})
            own[table] = {**inner, word: value} if isinstance(inner, Mapping) else inner
        elif table in TABLES:
            faults.append(Fault(key, "can't be set; change it in the tuning file"))
        else:
            of_study[key] = value
    return {name: value for name, value in tables.items() if name not in TABLES}, own, of_study


def _own_tables(own: Mapping[str, Any], folder: Path, faults: list[Fault]) -> dict[str, list[tuple[str, Any]]]:
    """The valid tables of a tuning by name, each with its place."""
    found: dict[str, list[tuple[str, Any]]] = {name: [] for name in TABLES}
    for name in TABLES:
        given = own.get(name, [] if name in _LISTS else {} if name == "tune" else None)
        if given is None or (name == "gain" and given == []):
            faults.append(Fault(name, f"lacks this table, for example {_EXAMPLES[name]}"))
            continue
        if name in _LISTS and not isinstance(given, list):
            faults.append(Fault(name, f"{shortened(given)} is not a list of tables, [[{name}]]"))
            continue
        for i, each in enumerate(given if name in _LISTS else [given]):
            place = f"{name}[{i}]" if name in _LISTS else name
            table = valid(TypeAdapter(TABLES[name]), each, place, faults, words_of(TABLES[name]))
            if table is not None and hasattr(table, "metric"):
                table = dataclasses.replace(table, metric=absolute(table.metric, folder))
            found[name] += [(place, table)] if table is not None else []
    return found


def _with_metrics(
    study: dict[str, Any], measures: list[tuple[str, Any]], folder: Path, faults: list[Fault]
) -> dict[str, Any]:
    """The study, which also keeps the metrics of the objective and the constraints."""
    keep = study.get("keep", {})
    kept = keep.get("metrics", list(DEFAULT_METRICS)) if isinstance(keep, Mapping) else None
    if not isinstance(kept, list) or not all(isinstance(name, str) for name in kept):
        return study  # the study reports it
    kept = [absolute(name, folder) for name in kept]
    for place, each in measures:
        try:
            metric = _metric(each.metric, kept, folder)
            number = number_of(metric)
            if number and each.metric not in columns_of(metric):
                raise InputError(f"{each.metric!r} has components; {suggestion(each.metric, columns_of(metric))}")
            if number and number.kind is str:
                raise InputError(f"{metric!r} is a text, not a number")
        except InputError as error:
            faults += [Fault(f"{place}.metric", fault.message) for fault in error.faults]
            continue
        kept += [metric] if metric not in kept and parted(metric)[1] not in kept else []
    return {**study, "keep": {**keep, "metrics": kept}}


def _metric(name: str, kept: list[str], folder: Path) -> str:
    """The metric of a name: one that is kept, or another one, which is given in full. Raises InputError if there is
    none."""
    with contextlib.suppress(InputError):
        return kept_column(name, kept, folder)[0]
    file, colon, word = name.rpartition(":")
    whole = f"{file}:{word.partition('.')[0]}" if colon else name
    parent = name.rpartition(".")[0]
    metric_of(metric := parent if number_of(parent) else whole)
    return metric


def _law(study: dict[str, Any], folder: Path, overrides: Mapping[str, Any]) -> tuple[Law | None, list[str]]:
    """The law of a study, as far as it can be read, and the keys that vary. The plan reports the errors."""
    ignored: list[Fault] = []
    tables, of_base = split_overrides(study, overrides, ignored)
    file = read(tables, ignored)
    base = base_of(file.base, folder, of_base, ignored)
    laws = laws_of(file.laws, base, folder, ignored, []) if base is not None else []
    varied = entries(file.vary, ignored).values()
    return laws[0] if laws else None, [place for each in varied for place in each.places]


def _gain_faults(gains: list[tuple[str, Gain]], law: Law, varied: list[str]) -> list[Fault]:
    """Errors of the keys of the gains and of their ranges."""
    faults: list[Fault] = []
    for i, (place, gain) in enumerate(gains):
        others = [*varied, *(other.key for _, other in gains[:i])]
        if any(overlap(gain.key, other) for other in others):
            faults.append(Fault(f"{place}.key", f"{gain.key} is varied or tuned already"))
        elif absent := missing(gain.key, law.tables):
            faults.append(Fault(f"{place}.key", absent))
        else:
            faults += _range_faults(place, gain, law)
    return faults


def _range_faults(place: str, gain: Gain, law: Law) -> list[Fault]:
    """Errors of the value of a gain in the file, and of the ends of its range."""
    found: dict[str, str] = {}
    for end in ("low", "high"):
        try:
            law.scenario.updated(overrides_at({gain.key: getattr(gain, end)}, law.tables))
        except InputError as error:
            found |= {fault.message: end for fault in error.faults if fault.message not in found}
    key = parsed(gain.key)[0]
    table, _, word = key.rpartition(".")
    own = table_in(table, law.tables)
    if own is None and VEHICLES in law.tables:
        return [Fault(f"{place}.key", f"name a vehicle: {VEHICLES}[{law.tables[VEHICLES][0]['name']}].{gain.key}")]
    if own is None or word not in own:
        return [Fault(f"{place}.key", f"{key}: {message}") for message in found] or [
            Fault(f"{place}.key", f"{gain.key} has no value in the base scenario, where the search begins: give it one")
        ]
    value = value_at(gain.key, law.tables)
    if isinstance(value, list):
        hint = f"it has {len(value)} components; give one gain for each that is tuned, {gain.key}[0]"
        return [Fault(f"{place}.key", hint)]
    if type(value) not in (int, float):
        return [Fault(f"{place}.key", f"{gain.key} is {shortened(value)}; only numbers can be tuned")]
    if not gain.low <= value <= gain.high:
        outside = f"{gain.key} is {value:g} in the file, outside low to high, {gain.low:g} to {gain.high:g}"
        return [Fault(place, f"{outside}: trial 0 is the file's own")]
    return [Fault(f"{place}.{end}", message) for message, end in found.items()]
