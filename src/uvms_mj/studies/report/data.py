"""The rows of a study as its report reads them: laws with their colours, factors, metrics, successes."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from ...analysis.summary import COURSES
from ...errors import InputError, suggestion
from ...views import colours
from ...views.figures.style import titled
from ..plan import Plan
from ..plan.file import DEFAULT_METRICS, Distribution, Vary
from ..plan.metrics import (
    COMPLETED,
    OF_ROWS,
    columns_of,
    in_words,
    is_settled,
    meaning_of,
    of_each,
    successes,
    unit_of_column,
    without_unit,
)

PREFERRED = (
    "contact.peak_N",
    "contact.final_N",
    "effort_N2s",
    "contact.impulse_Ns",
    "contact.touches",
    "contact.first_s",
    "saturated_s",
    "contact.relative_error",
)
"""Order of the metrics of a study whose file lists none."""
_LOG_RATIO = 30.0
"""Ratio of the greatest to the least value from which an axis of positive values is logarithmic."""


@dataclass(frozen=True, eq=False)
class Factor:
    """One entry of ``[[vary]]``; of keys that move together, the first is its axis."""

    variation: Vary
    unit: str
    numeric: bool
    words: str = ""

    @property
    def key(self) -> str:
        return self.variation.places[0]

    @property
    def name(self) -> str:
        """Its words, or the key, and the number of keys that move with it."""
        if self.words:
            return self.words
        more = len(self.variation.places) - 1
        return self.key + (f" (+{more})" if more else "")

    @property
    def label(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def axis(self) -> str:
        """The label of its axis in a figure."""
        return titled(self.key, self.unit, self.words)

    @property
    def limits(self) -> tuple[float, float] | None:
        """The limits of a uniform or log-uniform distribution; otherwise None."""
        given = self.variation
        if isinstance(given, Distribution) and given.distribution in ("uniform", "loguniform"):
            return given.low[0], given.high[0]
        return None

    @property
    def logarithmic(self) -> bool:
        """Whether its values are spaced as on a logarithmic axis."""
        if isinstance(self.variation, Distribution):
            return self.variation.distribution == "loguniform"
        values = [level[0] for level in self.variation.levels]
        return self.numeric and len(values) > 2 and min(values) > 0.0 and _even(np.log(values)) < _even(values)


def _even(values: Any) -> float:
    """Relative deviation of the distances between sorted values; 0 for equal distances."""
    distances = np.diff(np.sort(np.asarray(values, dtype=float)))
    return float(distances.std() / max(distances.mean(), 1e-300))


@dataclass(frozen=True)
class Metric:
    """A column of numbers. Its label has the unit in brackets, behind its words or its name."""

    name: str
    words: str = ""

    @property
    def unit(self) -> str:
        return unit_of_column(self.name)

    @property
    def label(self) -> str:
        return f"{self.short} [{self.unit}]" if self.unit else self.short

    @property
    def short(self) -> str:
        return self.words or without_unit(self.name)

    @property
    def axis(self) -> str:
        """The label of its axis in a figure."""
        return titled(self.short, self.unit, self.words)

    @property
    def meaning(self) -> str:
        """The definition of a shipped metric, with its time; empty for others."""
        return meaning_of(self.name)


@dataclass(frozen=True, eq=False)
class StudyRows:
    """The rows of a study. Series have the index of ``frame``; values of runs that did not complete are nan.

    Attributes:
        words: what stands in figures and tables in place of the names of laws, metrics and varied keys.
    """

    plan: Plan
    frame: pd.DataFrame
    words: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        laws = [law.label for law in self.plan.laws]
        known = [*laws, *(metric.name for metric in self.metrics), *(each.key for each in self.factors)]
        refuse_unknown(self.words, known, laws)

    @functools.cached_property
    def laws(self) -> tuple[str, ...]:
        return tuple(self.words.get(law.label, law.label) for law in self.plan.laws)

    @functools.cached_property
    def colours(self) -> dict[str, str]:
        """Colours of the laws as #rrggbb."""
        return dict(zip(self.laws, colours.hex_of_runs([law.source for law in self.plan.laws]), strict=True))

    @functools.cached_property
    def rows(self) -> dict[str, np.ndarray]:
        """Positions of the rows of each law."""
        given = self.frame["law"].to_numpy()
        return {shown: np.flatnonzero(given == law.label) for shown, law in zip(self.laws, self.plan.laws, strict=True)}

    @functools.cached_property
    def factors(self) -> tuple[Factor, ...]:
        return tuple(
            Factor(each, self.plan.units.get(key, ""), self._numbers(key).notna().any(), self.words.get(key, ""))
            for key, each in ((each.places[0], each) for each in self.plan.variations)
        )

    def of(self, factor: Factor) -> np.ndarray:
        """Values (n,) of a factor in every row; nan where it does not vary or is not a number."""
        return self._numbers(factor.key).to_numpy()

    @functools.cached_property
    def completed(self) -> np.ndarray:
        return (self.frame["status"] == COMPLETED).to_numpy()

    @functools.cached_property
    def success(self) -> np.ndarray:
        """Whether each run is a success."""
        return successes(self.frame, self.plan.success)

    @property
    def success_text(self) -> str:
        return in_words(self.plan.success, any(map(is_settled, self.frame)))

    def named(self, names: Sequence[str]) -> list[Metric]:
        """The metrics of these names. Raises InputError for one that the study does not keep as a number."""
        known = {metric.name: metric for metric in self.metrics}
        for name in names:
            if name not in known:
                there = "does not keep it"
                if name in self.frame:
                    empty = self.frame[name].isna().all()
                    there = "keeps it, but no run has a value" if empty else "keeps it, but it is no number"
                    there += f" ({meaning})" if empty and (meaning := meaning_of(name)) else ""
                raise InputError(f"metrics: {name!r}: the study {there}; {suggestion(name, known)}")
        return [known[name] for name in names]

    @functools.cached_property
    def metrics(self) -> tuple[Metric, ...]:
        """The columns of numbers but for the courses over time, the columns of :data:`PREFERRED` first unless the study
        file lists its metrics."""
        courses = {*of_each(COURSES, self.plan.vehicles)}
        known = {*OF_ROWS, *self.plan.varied, *(column for each in courses for column in columns_of(each))}
        names = [name for name in self.frame if name not in known and not is_settled(name)]
        names = [name for name in names if self._numbers(name).notna().any()]
        if tuple(self.plan.metrics) == DEFAULT_METRICS:
            names.sort(key=lambda name: PREFERRED.index(name) if name in PREFERRED else len(PREFERRED))
        return tuple(Metric(name, self.words.get(name, "")) for name in names)

    @functools.cached_property
    def varying(self) -> tuple[Metric, ...]:
        """The metrics that are not the same in every completed run. Those that most of these runs lack are last."""
        found = [each for each in self.metrics if np.ptp(_finite(self.values(each))) > 0.0]
        some = 0.5 * self.completed.sum()
        return tuple(sorted(found, key=lambda each: np.isfinite(self.values(each)).sum() < some))

    def values(self, metric: Metric) -> np.ndarray:
        """Values (n,) of a metric; nan for a run that did not complete or has no such value."""
        values = self._numbers(metric.name).to_numpy()
        return np.where(self.completed & np.isfinite(values), values, np.nan)

    def by_draw(self, law: str, values: np.ndarray) -> np.ndarray:
        """Values (draws,) of a law: the mean over the repeats of each draw; nan if one is missing or is nan."""
        rows = self.rows[law]
        table = np.full((len(self.plan.points), self.plan.repeats), np.nan)
        table[self.frame["draw"].to_numpy()[rows], self.frame["repeat"].to_numpy()[rows]] = values[rows]
        return table.mean(axis=1)

    def _numbers(self, name: str) -> pd.Series:
        if name not in self._columns:
            self._columns[name] = pd.to_numeric(self.frame[name], errors="coerce").astype(float)
        return self._columns[name]

    @functools.cached_property
    def _columns(self) -> dict[str, pd.Series]:
        return {}


def refuse_unknown(words: Mapping[str, str], known: Sequence[str], laws: Sequence[str]) -> None:
    """Raise InputError for words in place of a name that is not known, and for laws with the same words."""
    for name in words:
        if name not in known:
            raise InputError(f"labels: {name!r} is not in the results; {suggestion(name, known)}")
    shown = [words.get(law, law) for law in laws]
    if twice := [each for each in shown if shown.count(each) > 1]:
        raise InputError(f"labels: {twice[0]!r} would stand for two laws")


def _finite(values: np.ndarray) -> np.ndarray:
    found = values[np.isfinite(values)]
    return found if len(found) else np.zeros(1)


def spans_decades(values: np.ndarray) -> bool:
    """Whether values need a logarithmic axis: all are positive, and the bulk of them spans more than a decade."""
    found = _finite(values)
    if found.min() <= 0.0:
        return False
    low, high = np.quantile(found, (0.005, 0.995))
    return bool(high > _LOG_RATIO * low)
