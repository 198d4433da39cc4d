"""The tables of a tuning file that a study file lacks: gains, objective, constraints, search."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationInfo, model_validator
from pydantic.dataclasses import dataclass

from ...quantities import STRICT, Number, Real, doc, within
from ..plan.file import below_high, used_with
from ..plan.places import Place

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


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Gain:
    key: Place = doc("dotted key of a number, or a component of one, impedance.K_d[0]")
    log: bool = doc("whether its logarithm is searched", False)
    high: Real = doc("greatest value; the file's own is between them, and is trial 0")
    low: Annotated[Real, AfterValidator(below_high)] = doc("least value")


@dataclass(frozen=True, config=STRICT)
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


@dataclass(frozen=True, config=STRICT)
class Objective(Measure):
    direction: Literal["minimize", "maximize"] = doc('"minimize" or "maximize"', "minimize")


@dataclass(frozen=True, config=STRICT)
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


@dataclass(frozen=True, config=STRICT)
class Search:
    trials: Annotated[int, Field(strict=True, ge=1, le=1_000_000)] = doc(
        "number of trials, with trial 0, the file's own gains; a larger one later goes on with the same search", 100
    )
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = doc("of the suggestions", 0)
    sampler: Literal["tpe", "random"] = doc('of Optuna: "tpe", or "random" for comparison', "tpe")


TABLES: Mapping[str, Any] = {"gain": Gain, "objective": Objective, "constraint": Constraint, "tune": Search}
