"""Statistics of a study: intervals of rates, paired differences, and sensitivities. Confidence is 95 %."""

import math
import warnings
from dataclasses import dataclass

import numpy as np

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


def rate(successes: int, runs: int, draws: int) -> Estimate:
    """A rate with Wilson's interval. Runs that repeat a draw count as one run of it, since they are not independent;
    the interval is then too wide rather than too narrow."""
    from scipy.stats import binomtest

    share = successes / runs
    interval = binomtest(round(share * draws), draws).proportion_ci(LEVEL, method="wilson")
    return Estimate(share, min(interval.low, share), max(interval.high, share))


def difference_of_rates(differences: np.ndarray) -> Estimate:
    """Mean of the differences (n,) between two laws' success shares of each draw, with its interval.

    Of single runs, the interval is that of Agresti and Min (2005): Wald's after adding one half to each cell of the
    2 x 2 table of both laws' successes.
    """
    n, total = len(differences) + 2.0, float(differences.sum())
    deviation = math.sqrt(float((differences**2).sum()) + 1.0 - total**2 / n) / n
    mean, middle = total / len(differences), total / n
    return Estimate(mean, min(mean, middle - _Z * deviation), max(mean, middle + _Z * deviation))


def median(differences: np.ndarray) -> Estimate | None:
    """Median of values (n,) with the distribution-free interval between two order statistics (inverted sign test).

    None for fewer than eight values.
    """
    if len(differences) < _FEWEST:
        return None
    from scipy.stats import quantile_test

    interval = quantile_test(differences, p=0.5).confidence_interval(LEVEL)
    return Estimate(float(np.median(differences)), float(interval.low), float(interval.high))


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
    """Total Sobol indices of numbers y (n,), one a draw of a design ``sobol_indices``, by SALib; those of first order;
    and the number of incomplete blocks.

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
        return [Estimate(value, value - half, value + half) for value, half in pairs]

    return estimates("ST"), estimates("S1"), len(blocks) - len(complete)


_MOST_RESAMPLED = 1_000_000
"""Most blocks in all bootstrap samples of one interval, so that the time of a report is bounded."""
