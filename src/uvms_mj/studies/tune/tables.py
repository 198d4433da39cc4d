"""The tables of a tuning file that a study file lacks: gains, objective, constraints, search."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from ...errors import Fault, faults_of, shortened
from ...quantities import STRICT, Number, Real, doc, within

_Quantile = Annotated[Number, within(0.0, 1.0, "")]


@dataclass(frozen=True, config=STRICT)
class Gain:
    key: str = doc("dotted key of a number, or a component of one, impedance.K_d[0]")
    low: Real = doc("least value")
    high: Real = doc("greatest value; the file's own is between them, and is trial 0")
    log: bool = doc("whether its logarithm is searched", False)


@dataclass(frozen=True, config=STRICT)
class Measure:
    """A number of all runs of a trial: the mean, the largest value or a quantile of a metric."""

    metric: str = doc("a metric as in keep.metrics, its function's name, or a component of one")
    over: Literal["mean", "max", "quantile"] = doc('"mean", "max" or "quantile" of the runs, the last with q', "mean")
    q: _Quantile | None = doc("the quantile, from 0 to 1 [1]", None)

    @property
    def label(self) -> str:
        """Its name in tables: ``max contact.peak_N``."""
        over = f"{100.0 * self.q:g} % quantile" if self.q is not None else self.over
        return f"{over} {self.metric.rpartition('/')[2].rpartition(':')[2]}"


@dataclass(frozen=True, config=STRICT)
class Objective(Measure):
    direction: Literal["minimize", "maximize"] = doc('"minimize" or "maximize"', "minimize")


@dataclass(frozen=True, config=STRICT)
class Constraint(Measure):
    at_most: Real | None = doc("greatest value of a feasible trial", None)
    at_least: Real | None = doc("least value of a feasible trial", None)

    def excess(self, value: float) -> float:
        """The violation of the nearer limit, relative to the limit unless that is 0; 0 within the limits."""
        pairs = ((self.at_most, 1.0), (self.at_least, -1.0))
        return max(0.0, *(sign * (value - limit) / (abs(limit) or 1.0) for limit, sign in pairs if limit is not None))

    @property
    def limits(self) -> str:
        """The limits in words."""
        pairs = (("at least", self.at_least), ("at most", self.at_most))
        return " and ".join(f"{words} {limit:g}" for words, limit in pairs if limit is not None)


@dataclass(frozen=True, config=STRICT)
class Search:
    trials: Annotated[int, Field(strict=True, ge=1, le=1_000_000)] = doc(
        "number of trials, with trial 0, the file's own gains; a larger one later goes on with the same search", 100
    )
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = doc("of the suggestions", 0)
    sampler: Literal["tpe", "random"] = doc('of Optuna: "tpe", or "random" for comparison', "tpe")


TABLES: Mapping[str, Any] = {"gain": Gain, "objective": Objective, "constraint": Constraint, "tune": Search}


def valid(name: str, given: Any, place: str, faults: list[Fault]) -> Any:
    """A table as its dataclass. Errors are appended to ``faults``; then it is None."""
    kind = TABLES[name]
    words = [field.name for field in dataclasses.fields(kind)]
    if not isinstance(given, Mapping):
        faults.append(Fault(place, f"{shortened(given)} is not a table"))
        return None
    try:
        found = TypeAdapter(kind).validate_python(given)
    except ValidationError as error:
        faults += faults_of(error, place, {place.partition("[")[0]: words})
        return None
    wrong = [*_measure_faults(found, place), *_own_faults(found, place)]
    faults += wrong
    return None if wrong else found


def _measure_faults(found: Any, place: str) -> list[Fault]:
    if not isinstance(found, Measure):
        return []
    if found.over == "quantile" and found.q is None:
        return [Fault(f"{place}.q", "lacks this key: over = quantile needs it, for example q = 0.95")]
    if found.over != "quantile" and found.q is not None:
        return [Fault(f"{place}.q", f"has no effect with over = {found.over}; leave it out")]
    return []


def _own_faults(found: Any, place: str) -> list[Fault]:
    if isinstance(found, Gain):
        if found.low >= found.high:
            return [Fault(f"{place}.low", f"{found.low:g} must be less than high, {found.high:g}")]
        if found.log and found.low <= 0.0:
            return [Fault(f"{place}.low", f"{found.low:g} must be greater than 0 for a logarithm")]
    if isinstance(found, Constraint):
        if found.at_most is None and found.at_least is None:
            return [Fault(place, "give at_most or at_least, or both")]
        if found.at_most is not None and found.at_least is not None and found.at_least > found.at_most:
            return [Fault(f"{place}.at_least", f"{found.at_least:g} must not exceed at_most, {found.at_most:g}")]
    return []
