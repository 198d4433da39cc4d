"""Sensitivities of metrics to factors: Sobol indices where the design allows, otherwise rank correlations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .data import Factor, Metric, StudyRows
from .statistics import Estimate, rank_correlation, sobol_indices

MOST_METRICS = 5
SUCCESS = Metric("success")


@dataclass(frozen=True)
class Sensitivity:
    """Of one metric of one law: an estimate for each factor, total Sobol indices or rank correlations; with Sobol
    indices, also those of first order, and a note on what is left out."""

    main: Sequence[Estimate | None]
    first: Sequence[Estimate] = ()
    note: str = ""


@dataclass(frozen=True)
class Sensitivities:
    """All sensitivities, by metric and law; a law with a constant metric has none. ``sobol`` is their kind."""

    sobol: bool
    factors: tuple[Factor, ...]
    of: Mapping[Metric, Mapping[str, Sensitivity]]

    def strength(self, metric: Metric, factor: Factor) -> float:
        """Largest magnitude over the laws of the indices of first order or the correlations [1]. Total indices also
        grow with the random numbers of the runs."""
        return max((abs(value) for value, _, other in self._values(metric) if other is factor), default=0.0)

    def strongest(self, metric: Metric) -> tuple[float, str, Factor] | None:
        """The strongest sensitivity of a metric: its signed value, law and factor."""
        return max(self._values(metric), key=lambda each: abs(each[0]), default=None)

    def _values(self, metric: Metric) -> list[tuple[float, str, Factor]]:
        return [
            (each.value, law, factor)
            for law, sensitivity in self.of.get(metric, {}).items()
            for factor, each in zip(self.factors, sensitivity.first or sensitivity.main, strict=True)
            if each is not None
        ]

    @property
    def notes(self) -> list[str]:
        """What is left out, with the laws and metrics."""
        left_out: dict[str, list[str]] = {}
        for metric, laws in self.of.items():
            for law, each in laws.items():
                if each.note:
                    left_out.setdefault(f"{law}: {each.note}", []).append(metric.short)
        return [f"{note} ({', '.join(metrics)})" for note, metrics in left_out.items()]


def sensitivities(data: StudyRows) -> Sensitivities:
    """Sensitivities of the first metrics that vary, and of success."""
    sobol = data.plan.design == "sobol_indices"
    factors = data.factors if sobol else tuple(each for each in data.factors if each.numeric)
    of = {}
    for metric in (SUCCESS, *data.varying[:MOST_METRICS]):
        values = data.success.astype(float) if metric is SUCCESS else data.values(metric)
        found = {law: _sensitivity(data, law, values, factors) for law in data.laws}
        of[metric] = {law: each for law, each in found.items() if each is not None}
    return Sensitivities(sobol, factors, {metric: laws for metric, laws in of.items() if laws})


def _sensitivity(data: StudyRows, law: str, values: np.ndarray, factors: tuple[Factor, ...]) -> Sensitivity | None:
    y = data.by_draw(law, values)
    if data.plan.design == "sobol_indices":
        found = sobol_indices(y, len(factors), data.plan.seed)
        if found is None:
            return None
        total, first, missing = found
        blocks = f"{missing} of {len(y) // (len(factors) + 2)} blocks of samples"
        note = f"{blocks} have a run without a value; the indices are of the others" if missing else ""
        return Sensitivity(total, first, note)
    main = [rank_correlation(data.by_draw(law, data.of(factor)), y) for factor in factors]
    return Sensitivity(main) if any(main) else None
