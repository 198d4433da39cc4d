"""Statistics of a study: intervals of rates, paired differences, and sensitivities. Confidence is 95 %.

Laws are compared in pairs: differences in the same draws, which have the same values and random numbers.

Sensitivities of metrics to factors are Sobol indices where the design allows, otherwise rank correlations.
"""

import functools
import itertools
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from ..pages import ROUNDING
from .data import Factor, Metric, StudyRows

LEVEL = 0.95
_Z = 1.959963984540054
"""Quantile of the standard normal distribution at (1 + LEVEL) / 2."""
_FEWEST = 8
"""Fewest pairs, or blocks of Sobol samples, from which an index is computed."""


@dataclass(frozen=True)
class Estimate:
    """A number with its confidence interval."""

    value: float
    low: float
    high: float

    @property
    def apart(self) -> bool:
        """Whether zero is outside its interval."""
        return self.low > 0.0 or self.high < 0.0


@functools.lru_cache(maxsize=4096)  # a page has many cells with the same counts
def rate(successes: int, runs: int, draws: int) -> Estimate:
    """A rate with Wilson's interval. Runs that repeat a draw count as one run of it, since they are not independent;
    the interval is then too wide rather than too narrow."""
    from scipy.stats import binomtest

    share = successes / runs
    interval = binomtest(round(share * draws), draws).proportion_ci(LEVEL, method="wilson")
    return Estimate(share, min(interval.low, share), max(interval.high, share))


def difference_of_rates(differences: np.ndarray, level: float = LEVEL) -> Estimate:
    """Mean of the differences (n,) between two laws' success shares of each draw, with its interval of a level.

    Of single runs, the interval is Agresti and Min's (2005): Wald's after adding one half to each cell of the
    2 x 2 table of both laws' successes, within -1 and 1.
    """
    n, total = len(differences) + 2.0, float(differences.sum())
    deviation = math.sqrt(float((differences**2).sum()) + 1.0 - total**2 / n) / n
    mean, middle = total / len(differences), total / n
    z = NormalDist().inv_cdf(0.5 * (1.0 + level))
    low, high = max(-1.0, middle - z * deviation), min(1.0, middle + z * deviation)
    return Estimate(mean, min(mean, low), max(mean, high))


def median(differences: np.ndarray, level: float = LEVEL) -> Estimate | None:
    """Median of values (n,) with the distribution-free interval of a level, between two order statistics (inverted sign
    test). Without order statistics that are far enough apart for a high level, it is infinite.

    None for fewer than eight values.
    """
    if len(differences) < _FEWEST:
        return None
    values = np.sort(differences)
    ends = zip(_ranks(len(values), level), (-math.inf, math.inf), strict=True)
    low, high = (beyond if rank is None else float(values[rank]) for rank, beyond in ends)
    return Estimate(float(np.median(values)), low, high)


@functools.lru_cache(maxsize=1024)
def _ranks(n: int, level: float) -> tuple[int | None, ...]:
    """The order statistics of n values between which the median is with a level; None where none is so far out."""
    from scipy.stats import quantile_test

    interval = quantile_test(np.arange(n), p=0.5).confidence_interval(level)
    return tuple(None if math.isnan(rank) else int(rank) for rank in interval)


def rank_correlation(x: np.ndarray, y: np.ndarray) -> Estimate | None:
    """Spearman's rank correlation of x (n,) and y (n,), with the interval of Bonett and Wright (2000) on Fisher's z.

    None for fewer than eight finite pairs, or if x or y is constant.
    """
    both = np.isfinite(x) & np.isfinite(y)
    x, y = x[both], y[both]
    if len(x) < _FEWEST or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return None
    from scipy.stats import spearmanr

    rho = float(np.clip(spearmanr(x, y).statistic, -1.0, 1.0))
    z = math.atanh(min(max(rho, -1.0 + 1e-12), 1.0 - 1e-12))
    deviation = math.sqrt((1.0 + rho**2 / 2.0) / (len(x) - 3.0))
    return Estimate(rho, math.tanh(z - _Z * deviation), math.tanh(z + _Z * deviation))


def sobol_indices(y: np.ndarray, factors: int, seed: int) -> tuple[list[Estimate], list[Estimate], int] | None:
    """Total Sobol indices of numbers y (n,), one a draw of a design ``sobol_indices``, by SALib; the indices of first
    order; and the number of incomplete blocks. An index is a share of the variance, and its interval stays from 0 to 1.

    The design has blocks of ``factors`` + 2 draws. A block with a value that is not finite is left out as a whole.
    None for fewer than eight complete blocks, or if all values are equal.
    """
    blocks = y.reshape(-1, factors + 2)
    complete = blocks[np.isfinite(blocks).all(axis=1)]
    if len(complete) < _FEWEST or np.ptp(complete) == 0.0:
        return None
    from SALib.analyze import sobol

    problem = {"num_vars": factors, "names": [f"x{i}" for i in range(factors)], "bounds": [[0.0, 1.0]] * factors}
    resamples = int(np.clip(_MOST_RESAMPLED / len(complete), 30, 200))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a factor without effect: its index is zero
        found = sobol.analyze(
            problem, complete.ravel(), calc_second_order=False, num_resamples=resamples, conf_level=LEVEL, seed=seed + 1
        )

    def estimates(name: str) -> list[Estimate]:
        pairs = zip(found[name].tolist(), found[f"{name}_conf"].tolist(), strict=True)
        return [Estimate(*map(_share, (value, value - half, value + half))) for value, half in pairs]

    return estimates("ST"), estimates("S1"), len(blocks) - len(complete)


def _share(value: float) -> float:
    """The nearest share to a number, from 0 to 1: an index is a share of the variance, its estimate need not be."""
    return min(max(value, 0.0), 1.0)


_MOST_RESAMPLED = 1_000_000
"""Most blocks in all bootstrap samples of one interval, so that the time of a report is bounded."""


MOST_OF_ALL_PAIRS = 4
"""Most metrics that are compared."""


def of_many(n: int) -> str:
    """The joint meaning of n intervals of 95 %, in a sentence; empty for one."""
    if n < 2:
        return ""
    least = 100.0 * (1.0 - n * (1.0 - LEVEL))
    together = f"all {n} at once with at least {least:.0f} %" if least > 0.5 else f"some of the {n} may miss by chance"
    return f"Each interval holds with 95 %, {together}."


@dataclass(frozen=True)
class Difference:
    """Difference of a metric between two laws: the median over the draws that both completed, the shares of draws in
    which the second law's value is smaller and in which it is larger, the number of draws, and the median size of the
    first law's values. ``among_all`` is the median with the interval that holds with 95 % for all pairs and metrics at
    once."""

    metric: Metric
    median: Estimate
    smaller: float
    larger: float
    draws: int
    size: float
    among_all: Estimate

    @property
    def matters(self) -> bool:
        """Whether the interval excludes zero, and the difference is at least 1 % of the values and not rounding."""
        return self.median.apart and abs(self.median.value) >= max(0.01 * self.size, ROUNDING)


@dataclass(frozen=True)
class Paired:
    """Two laws in the same draws. Differences are ``second`` minus ``first``.

    Attributes:
        draws: in which every run of both is done.
        success: difference of the success rates.
        only_first, only_second: draws in which more runs of this law than of the other succeed.
        among_all: ``success`` with the interval that holds with 95 % for all pairs and metrics at once.
    """

    first: str
    second: str
    draws: int
    success: Estimate
    only_first: int
    only_second: int
    metrics: tuple[Difference, ...]
    among_all: Estimate


def paired(data: StudyRows, metrics: Sequence[Metric] = ()) -> list[Paired]:
    """Compare each pair of laws in the draws that both have done, in metrics; default: the first that vary.

    n intervals of 1 - 0.05 / n hold all at once with 95 % (Bonferroni).
    """
    pairs, chosen = list(itertools.combinations(data.laws, 2)), metrics or data.varying[:MOST_OF_ALL_PAIRS]
    level = 1.0 - (1.0 - LEVEL) / (max(1, len(pairs)) * (1 + len(chosen)))
    return [found for first, second in pairs if (found := _compared(data, first, second, chosen, level)) is not None]


def _compared(data: StudyRows, first: str, second: str, chosen: Sequence[Metric], level: float) -> Paired | None:
    success = data.success.astype(float)
    differences = data.by_draw(second, success) - data.by_draw(first, success)
    differences = differences[np.isfinite(differences)]
    if not len(differences):
        return None
    metrics = []
    for metric in chosen:
        values = data.values(metric)
        before = data.by_draw(first, values)
        change = data.by_draw(second, values) - before
        both = np.isfinite(change)
        found = median(change[both])
        if found is not None:
            size = float(np.median(np.abs(before[both])))
            among_all = median(change[both], level)
            assert among_all is not None
            smaller, larger = (float((sign * change[both] > 0.0).mean()) for sign in (-1.0, 1.0))
            metrics.append(Difference(metric, found, smaller, larger, int(both.sum()), size, among_all))
    return Paired(
        first,
        second,
        len(differences),
        difference_of_rates(differences),
        int((differences < 0.0).sum()),
        int((differences > 0.0).sum()),
        tuple(metrics),
        difference_of_rates(differences, level),
    )


MOST_SENSITIVITIES = 5
SUCCESS = Metric("success")


@dataclass(frozen=True)
class Sensitivity:
    """Of one metric of one law: an estimate for each factor, total Sobol indices or rank correlations; with Sobol
    indices, also of first order, and a note on what is left out."""

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
        """The values that are left out, with the laws and metrics."""
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
    for metric in (SUCCESS, *data.varying[:MOST_SENSITIVITIES]):
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
