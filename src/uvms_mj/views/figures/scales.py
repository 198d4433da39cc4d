"""Ranges, scales and numbers of axes: SI prefixes, symmetric logarithmic scales, and windows of time."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FixedLocator, NullLocator, ScalarFormatter
from numpy.typing import ArrayLike

from .style import SMALL

FLAT = 10.0
"""Ratio of a panel's range to a line's range from which the line looks flat."""
_NOTHING = 1e-6
"""Magnitudes below this fraction of a signal's largest come from rounding and are ignored in the choice of a scale."""
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
_MOST_TICKS = 3
"""Most intervals between ticks of one sign on a logarithmic axis."""
_CROWDED = 5.0
"""Decades of both signs from which the limits of the linear part stand too close to 0 for their numbers."""
_FILLING = 50.0
"""A line fills an area if its total variation exceeds its range by this factor."""
_EARLY = 0.05
"""Longest initial transient, as a fraction of a run."""


def largest(values: ArrayLike) -> float:
    """Largest magnitude of the finite values; 0 if there are no finite values."""
    sizes = np.abs(np.asarray(values, dtype=float))
    return float(sizes[np.isfinite(sizes)].max(initial=0.0))


def prefix_of(largest: float) -> tuple[float, str]:
    """Power of ten and SI prefix for a signal with this largest magnitude."""
    return next(((power, prefix) for power, prefix in _PREFIXES if largest >= 0.05 * power), _PREFIXES[0])


def number(axis: Axis, power: float) -> None:
    """Number an axis in multiples of ``power``; the data remain in SI."""
    if power != 1.0:
        axis.set_major_formatter(_Multiples(power))


class _Multiples(ScalarFormatter):
    def __init__(self, power: float) -> None:
        super().__init__(useOffset=False)
        self.set_scientific(False)
        self.power = power

    def set_locs(self, locs: Iterable[float]) -> None:
        super().set_locs([value / self.power for value in locs])

    def __call__(self, x: float, pos: int | None = None) -> str:
        return super().__call__(x / self.power, pos)


def linear_within(sizes: Sequence[float], wholes: Sequence[float]) -> float | None:
    """Limit of the linear part of an axis that several lines share; None for a linear axis.

    It is a power of ten at or below the smallest magnitude if that line would look flat on a linear axis. ``sizes`` are
    the largest magnitudes of the lines, ``wholes`` those of their complete signals.
    """
    sizes = [size for size, whole in zip(sizes, wholes, strict=True) if size > _NOTHING * whole]
    if not sizes or max(sizes) < FLAT * min(sizes):
        return None
    return float(10.0 ** math.floor(math.log10(min(sizes))))


def logarithmic(ax: Axes, within: float, unit: str, power: float, prefix: str) -> None:
    """Make y linear within ±``within`` and logarithmic beyond, shade the linear part and show its limit."""
    low, high = ax.dataLim.y0, ax.dataLim.y1
    ax.set_yscale("symlog", linthresh=within, linscale=0.5)
    bottom = 1.6 * min(low, -within) if low < 0.0 else -0.3 * within
    top = 1.6 * max(high, within) if high > 0.0 else 0.3 * within
    ax.set_ylim(bottom, top)
    first = round(math.log10(within))
    last = math.floor(math.log10(max(-bottom, top)))
    decades = [10.0**k for k in range(first, last + 1, max(1, -(-(last - first) // _MOST_TICKS)))]
    if sum(math.log10(max(edge, within) / within) for edge in (-bottom, top)) > _CROWDED:
        del decades[0]  # the limit; the title has it
    places = [-d for d in decades[::-1]] + [0.0] + decades
    ax.yaxis.set_major_locator(FixedLocator([y for y in places if bottom <= y <= top]))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(lambda y, _: f"{y / power:g}".replace("-", "\N{MINUS SIGN}"))
    ax.axhspan(max(bottom, -within), min(top, within), color="#f3f3f3", linewidth=0.0, zorder=0.0)
    limit = f"{'±' if low < 0.0 else ''}{within / power:g} {prefix}{unit}"
    ax.set_title(f"log beyond {limit}", loc="right", fontsize=SMALL, color="#555555")


def fills(values: np.ndarray) -> bool:
    """Whether a line (n,) oscillates so much that it fills an area and would hide lines below it."""
    values = values[np.isfinite(values)]
    return len(values) > 2 and bool(np.abs(np.diff(values)).sum() > _FILLING * np.ptp(values))


def early(t: np.ndarray, values: np.ndarray) -> float:
    """Duration of an initial transient that makes the rest of a run look flat [s]; 0 without such a transient.

    Args:
        t: (n,).
        values: (n, k).

    Returns:
        The shortest of 1, 2, 5, 10, ... ms after which the values stay within twice their largest later magnitude.
    """
    size = np.abs(values).max(axis=1)
    latest = t[0] + _EARLY * (t[-1] - t[0])
    later = size[t > latest]
    if len(later) < 2 or not np.isfinite(size).all() or size.max() <= FLAT * later.max():
        return 0.0
    for window in (digit * 10.0**exponent for exponent in range(-3, 6) for digit in (1.0, 2.0, 5.0)):
        if t[0] + window > latest:
            break
        if size[t > t[0] + window].max() <= 2.0 * later.max() and (t <= t[0] + window).sum() > 2:
            return window
    return 0.0


def rebounds(t: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[float, float] | None:
    """Start and end of the rebounds of a push with the band from ``low`` to ``high`` (n,), with margins of 5 % of their
    duration before and 50 % after them [s].

    None without rebounds, for rebounds that do not end, and if the window is 30 % of the run or longer.
    """
    touched = np.flatnonzero(high > 0.0)
    if not len(touched):
        return None
    lost = touched[0] + np.flatnonzero(low[touched[0] :] <= 0.0)
    if not len(lost) or lost[-1] == len(low) - 1:
        return None
    first, last = float(t[touched[0]]), float(t[lost[-1]])
    window = first - 0.05 * (last - first), last + 0.5 * (last - first)
    return window if window[1] - window[0] < 0.3 * (t[-1] - t[0]) else None
