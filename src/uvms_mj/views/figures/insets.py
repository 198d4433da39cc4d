"""Insets: enlarged parts of a panel, placed where the panel has no lines."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from .style import LINE, SMALL, size_in, ticks

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


def _crossings(x: np.ndarray, y: np.ndarray, edge: float) -> np.ndarray:
    """The values of y where a line through points (n,) crosses x = ``edge``."""
    at = np.flatnonzero((x[:-1] < edge) != (x[1:] < edge))
    return y[at] + (edge - x[at]) / (x[at + 1] - x[at]) * (y[at + 1] - y[at])


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
        x, y = x[good], y[good]
        for i in range(CELLS):
            inside = [y[(x >= edges[i]) & (x <= edges[i + 1])], *(_crossings(x, y, edge) for edge in edges[i : i + 2])]
            low = min(each.min(initial=np.inf) for each in inside)
            high = max(each.max(initial=-np.inf) for each in inside)
            if high >= 0.0 and low <= 1.0:
                taken[max(0, int(low * CELLS) - 1) : int(min(high, 2.0) * CELLS) + 2, i] = 1
    return taken
