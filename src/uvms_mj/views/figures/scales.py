"""Ranges, scales and numbers of axes, windows of time, and enlarged parts where a panel has no lines."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FixedLocator, NullLocator, ScalarFormatter
from numpy.typing import ArrayLike

from .style import LINE, SMALL, size_in, ticks

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
    the largest magnitudes of the lines, ``wholes`` the largest magnitudes of their complete signals.
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
    if (ended := rebounding(t, low, high)) is None or ended[1] == t[-1]:
        return None
    first, last = ended
    window = first - 0.05 * (last - first), last + 0.5 * (last - first)
    return window if window[1] - window[0] < 0.3 * (t[-1] - t[0]) else None


def rebounding(t: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[float, float] | None:
    """Time of the first touch and of the last instant without contact after it [s], from a band of the push (n,); None
    without a touch, or if contact is never lost. The band of the row in which the first contact begins holds the zero
    before it, which is no loss."""
    touched = np.flatnonzero(high > 0.0)
    lost = touched[0] + 1 + np.flatnonzero(low[touched[0] + 1 :] <= 0.0) if len(touched) else touched
    return (float(t[touched[0]]), float(t[lost[-1]])) if len(lost) else None


CELLS = 120
"""Width and height of an axes in cells, for the search of a free place."""
_LEFT_PT, _RIGHT_PT, _BELOW_PT, _ABOVE_PT = 24.0, 6.0, 11.0, 11.0
"""Room around an inset for its numbers and its title [pt]."""

Corner = tuple[float, float]
"""Lower left corner of an inset, in fractions of its axes."""


@dataclass(frozen=True)
class Inset:
    """An enlarged part of a panel, with a title above it and a height as a fraction of the panel's. ``draw`` draws it
    into axes and sets their limits; its second argument is the power of ten of the axis numbers."""

    draw: Callable[[Axes, float], None]
    title: str
    height: float = 0.34


def place(ax: Axes, insets: Sequence[Inset], power: float) -> None:
    """Draw insets of a panel where the panel is empty.

    The upper limit of the panel is raised until all insets fit, at most to twice the range. If they still do not fit,
    the panel keeps its range, and only the insets that fit are drawn.
    """
    low, high = ax.get_ylim()
    corners: list[Corner | None] = []
    linear = ax.get_yscale() == "linear"
    for growth in np.arange(0.0, 1.05, 0.1) if linear else [0.0]:
        ax.set_ylim(low, high + growth * (high - low))
        corners = _corners(ax, insets)
        if None not in corners:
            break
    else:
        ax.set_ylim(low, high)
        corners = _corners(ax, insets)
    for inset, corner in zip(insets, corners, strict=True):
        if corner is not None:
            _draw(ax, inset, corner, power)


def _draw(ax: Axes, inset: Inset, corner: Corner, power: float) -> None:
    inner = ax.inset_axes((*corner, *_size(ax, inset)))
    ticks(inner, 4)
    inset.draw(inner, power)
    inner.set_title(inset.title, fontsize=SMALL, pad=2, loc="left")
    inner.tick_params(labelsize=SMALL, length=1.5, width=0.4, pad=1.5)
    for spine in inner.spines.values():
        spine.set_linewidth(0.5)
    for each in inner.lines:
        each.set_linewidth(0.8 * LINE)


def _corners(ax: Axes, insets: Sequence[Inset]) -> list[Corner | None]:
    """A corner for each inset, clear of lines and earlier insets; None if there is no room."""
    taken = _taken(ax)
    return [_corner(ax, inset, taken) for inset in insets]


def _corner(ax: Axes, inset: Inset, taken: np.ndarray) -> Corner | None:
    """The uppermost, then rightmost, lower left corner for an inset with its numbers and title, whose cells are then
    taken; None without room."""
    wide, high = (72.0 * side for side in size_in(ax))
    left, right, below, above = _LEFT_PT / wide, _RIGHT_PT / wide, _BELOW_PT / high, _ABOVE_PT / high
    width, height = _size(ax, inset)
    total = np.pad(taken.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    nx = int(np.ceil((left + width + right) * CELLS))
    ny = int(np.ceil((below + height + above) * CELLS))
    if nx > CELLS or ny > CELLS:
        return None
    sums = total[ny:, nx:] - total[:-ny, nx:] - total[ny:, :-nx] + total[:-ny, :-nx]
    free = np.argwhere(sums == 0)
    if not len(free):
        return None
    row, column = max(free.tolist())
    taken[row : row + ny, column : column + nx] = 1
    return column / CELLS + left, row / CELLS + below


def _size(ax: Axes, inset: Inset) -> tuple[float, float]:
    """Width and height of an inset in fractions of its panel's; smaller in a small panel, to leave room for numbers."""
    wide, high = size_in(ax)
    return (0.48 if wide > 2.0 else 0.4), inset.height * (1.0 if high > 1.5 else 0.85)


def _taken(ax: Axes) -> np.ndarray:
    """Cells (row from below, column) of an axes that lines and bands pass through, as ones."""
    taken = np.zeros((CELLS, CELLS), dtype=int)
    edges = np.linspace(0.0, 1.0, CELLS + 1)
    to_axes = ax.transData - ax.transAxes
    areas = [path for area in ax.collections for path in area.get_paths()]
    for path in (*(each.get_path() for each in ax.lines), *areas):
        x, y = to_axes.transform(path.vertices).T
        good = np.isfinite(x) & np.isfinite(y)
        if not good.any():
            continue
        low, high = _band(x[good], y[good], edges)
        for i in np.flatnonzero((high >= 0.0) & (low <= 1.0)):
            taken[max(0, int(low[i] * CELLS) - 1) : int(min(high[i], 2.0) * CELLS) + 2, i] = 1
    return taken


def _band(x: np.ndarray, y: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest y (m,) of a line through points (n,) between each two of the edges (m + 1,) of x."""
    left, right = np.searchsorted(edges, x), np.searchsorted(edges, x, "right")
    crossed = np.abs(np.diff(right))
    at = np.repeat(np.arange(len(crossed)), crossed)
    edge = np.minimum(right[:-1], right[1:])[at] + np.arange(len(at)) - (np.cumsum(crossed) - crossed)[at]
    there = y[at] + (edges[edge] - x[at]) / (x[at + 1] - x[at]) * (y[at + 1] - y[at])
    low, high = np.full(len(edges) + 1, np.inf), np.full(len(edges) + 1, -np.inf)
    room, values = np.concatenate([left, right, edge, edge + 1]), np.concatenate([y, y, there, there])
    np.minimum.at(low, room, values)
    np.maximum.at(high, room, values)
    return low[1:-1], high[1:-1]
