"""Paired comparison of laws: differences in the same draws, which have the same values and random numbers."""

import itertools
from dataclasses import dataclass

import numpy as np

from ..pages import ROUNDING
from .data import Metric, StudyRows
from .statistics import Estimate, difference_of_rates, median

MOST_METRICS = 4
MOST_LAWS = 3
"""Up to this many laws, each pair is compared; of more laws, each with the first."""


@dataclass(frozen=True)
class Difference:
    """Difference of a metric between two laws: the median over the draws that both completed, the share of draws in
    which the second law's value is smaller, the number of draws, and the median size of the first law's values."""

    metric: Metric
    median: Estimate
    smaller: float
    draws: int
    size: float

    @property
    def matters(self) -> bool:
        """Whether the interval excludes zero, and the difference is at least 1 % of the values and not rounding."""
        apart = self.median.low > 0.0 or self.median.high < 0.0
        return apart and abs(self.median.value) >= max(0.01 * self.size, ROUNDING)


@dataclass(frozen=True)
class Paired:
    """Two laws in the same draws. Differences are ``second`` minus ``first``.

    Attributes:
        draws: in which every run of both is done.
        success: difference of the success rates.
        only_first, only_second: draws in which more runs of this law than of the other succeed.
    """

    first: str
    second: str
    draws: int
    success: Estimate
    only_first: int
    only_second: int
    metrics: tuple[Difference, ...]


def paired(data: StudyRows) -> list[Paired]:
    """Compare laws in the draws that both have done."""
    laws = data.laws
    pairs = list(itertools.combinations(laws, 2)) if len(laws) <= MOST_LAWS else [(laws[0], law) for law in laws[1:]]
    return [found for first, second in pairs if (found := _compared(data, first, second)) is not None]


def _compared(data: StudyRows, first: str, second: str) -> Paired | None:
    success = data.success.astype(float)
    differences = data.by_draw(second, success) - data.by_draw(first, success)
    differences = differences[np.isfinite(differences)]
    if not len(differences):
        return None
    metrics = []
    for metric in data.varying[:MOST_METRICS]:
        values = data.values(metric)
        before = data.by_draw(first, values)
        change = data.by_draw(second, values) - before
        both = np.isfinite(change)
        found = median(change[both])
        if found is not None:
            size = float(np.median(np.abs(before[both])))
            metrics.append(Difference(metric, found, float((change[both] < 0.0).mean()), int(both.sum()), size))
    return Paired(
        first,
        second,
        len(differences),
        difference_of_rates(differences),
        int((differences < 0.0).sum()),
        int((differences > 0.0).sum()),
        tuple(metrics),
    )
