"""Paired comparison of laws: differences in the same draws, which have the same values and random numbers."""

import itertools
from dataclasses import dataclass

import numpy as np

from .data import Data, Metric
from .statistics import Estimate, difference_of_rates, median

MOST_METRICS = 4
MOST_LAWS = 3
"""Up to this many laws, each pair is compared; of more laws, each with the first."""


@dataclass(frozen=True)
class Paired:
    """Two laws in the same draws. Differences are ``second`` minus ``first``.

    Attributes:
        draws: in which every run of both is done.
        success: difference of the success rates.
        only_first, only_second: draws in which more runs of this law than of the other succeed.
        metrics: each with the median of its differences, the share of draws in which that of ``second`` is smaller,
            and the number of draws in which both completed.
    """

    first: str
    second: str
    draws: int
    success: Estimate
    only_first: int
    only_second: int
    metrics: tuple[tuple[Metric, Estimate, float, int], ...]


def paired(data: Data) -> list[Paired]:
    """Compare laws in the draws that both have done."""
    laws = data.laws
    pairs = list(itertools.combinations(laws, 2)) if len(laws) <= MOST_LAWS else [(laws[0], law) for law in laws[1:]]
    return [found for first, second in pairs if (found := _compared(data, first, second)) is not None]


def _compared(data: Data, first: str, second: str) -> Paired | None:
    success = data.success.astype(float)
    differences = data.by_draw(second, success) - data.by_draw(first, success)
    differences = differences[np.isfinite(differences)]
    if not len(differences):
        return None
    metrics = []
    for metric in data.varying[:MOST_METRICS]:
        values = data.values(metric)
        change = data.by_draw(second, values) - data.by_draw(first, values)
        change = change[np.isfinite(change)]
        found = median(change)
        if found is not None:
            metrics.append((metric, found, float((change < 0.0).mean()), len(change)))
    return Paired(
        first,
        second,
        len(differences),
        difference_of_rates(differences),
        int((differences < 0.0).sum()),
        int((differences > 0.0).sum()),
        tuple(metrics),
    )
