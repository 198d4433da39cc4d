"""Lines that don't lie however long the log is, and places for insets where there are no lines."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from .style import SMALL

PIXELS_PER_INCH = 300
"""That lines are thinned for."""
CELLS = 120
"""An axes is this many cells wide and high when a free place is sought in it."""


def thin(t: np.ndarray, values: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest sample of each pixel column, with their own times, and the first and last sample.

    Args:
        t: (n,) increasing.
        values: (n,).
        columns: of pixels.

    Returns:
        At most 2 columns + 2 samples (m,), (m,); all of them where there are not many more than that.
    """
    n = len(t)
    if n <= 2 * columns + 2:
        return t, values
    width = -(-n // columns)
    at = np.minimum(np.arange(-(-n // width) * width), n - 1).reshape(-1, width)
    blocks = values[at]
    finite = np.isfinite(blocks)
    low = np.where(finite, blocks, np.inf).argmin(axis=1)
    high = np.where(finite, blocks, -np.inf).argmax(axis=1)
    rows = np.arange(len(at))
    kept = np.unique(np.concatenate([[0], at[rows, low], at[rows, high], [n - 1]]))
    return t[kept], values[kept]


def size_in(ax: Axes) -> tuple[float, float]:
    """Width and height of an axes, before there is a layout about so [in]."""
    figure, box = ax.get_figure(root=True), ax.get_position()
    assert figure is not None
    return figure.get_figwidth() * box.width, figure.get_figheight() * box.height


def line(ax: Axes, t: np.ndarray, values: np.ndarray, name: str, **look: Any) -> None:
    """Draw samples (n,) as one line; ``name`` is its group in an SVG."""
    columns = max(100, round(size_in(ax)[0] * PIXELS_PER_INCH))
    ax.plot(*thin(t, values, columns), gid=name, **look)


def ticks(ax: Axes, most: int) -> None:
    """Few round numbers on both axes."""
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))


@dataclass(frozen=True)
class Inset:
    """A part of a panel, larger.

    Attributes:
        draw: draws it, limits included, into the axes that it is given, numbered in multiples of a power.
        title: what it shows.
        height: as part of the panel's.
    """

    draw: Callable[[Axes, float], None]
    title: str
    height: float = 0.34


def place(panels: Iterable[tuple[Axes, Inset | None]], power: float) -> None:
    """Draw the insets of panels that share one range of y and its power, each where its panel is empty; if there is no
    such place in one of them, all get more room above, up to half as much again."""
    panels = list(panels)
    axes = [ax for ax, _ in panels]
    low, high = min(ax.get_ylim()[0] for ax in axes), max(ax.get_ylim()[1] for ax in axes)
    for growth in np.arange(0.0, 0.55, 0.1):
        for ax in axes:
            ax.set_ylim(low, high + growth * (high - low))
        corners = [_corner(ax, inset) if inset else (0.0, 0.0) for ax, inset in panels]
        if None not in corners:
            break
    else:  # insets where there is room as it is
        for ax in axes:
            ax.set_ylim(low, high)
        corners = [_corner(ax, inset) if inset else None for ax, inset in panels]
    for (ax, inset), corner in zip(panels, corners, strict=True):
        if inset is not None and corner is not None:
            _draw(ax, inset, corner, power)


def _draw(ax: Axes, inset: Inset, corner: tuple[float, float], power: float) -> None:
    inner = ax.inset_axes((*corner, *_size(ax, inset)))
    inset.draw(inner, power)
    inner.set_title(inset.title, fontsize=SMALL, pad=2, loc="left")
    inner.tick_params(labelsize=SMALL, length=1.5, width=0.4, pad=1.5)
    ticks(inner, 4)
    for spine in inner.spines.values():
        spine.set_linewidth(0.5)
    for each in inner.lines:
        each.set_linewidth(max(0.7, 0.65 * each.get_linewidth()))


def _corner(ax: Axes, inset: Inset) -> tuple[float, float] | None:
    """Lower left corner for an inset and what stands around it: as far up as there is room, then to the right."""
    wide, high = (72.0 * side for side in size_in(ax))
    left, right, below, above = 22.0 / wide, 6.0 / wide, 11.0 / high, 11.0 / high  # its numbers and title [pt]
    width, height = _size(ax, inset)
    taken = _taken(ax)
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
    return column / CELLS + left, row / CELLS + below


def _size(ax: Axes, inset: Inset) -> tuple[float, float]:
    """Of an inset, as parts of its panel's; in a small panel there is less room beside the numbers."""
    wide, high = size_in(ax)
    return (0.48 if wide > 2.0 else 0.4), inset.height * (1.0 if high > 1.5 else 0.85)


def _taken(ax: Axes) -> np.ndarray:
    """Which cells (row from below, column) of an axes lines go through."""
    taken = np.zeros((CELLS, CELLS), dtype=int)
    edges = np.linspace(0.0, 1.0, CELLS + 1)
    for each in ax.lines:
        x, y = ax.transLimits.transform(np.column_stack([each.get_xdata(), each.get_ydata()])).T
        good = np.isfinite(x) & np.isfinite(y)
        if not good.any():
            continue
        x, y = x[good], y[good]
        for i in range(CELLS):
            inside = y[(x >= edges[i]) & (x <= edges[i + 1])]
            ends = np.interp(edges[i : i + 2], x, y)
            low = min(ends.min(), inside.min(initial=np.inf))
            high = max(ends.max(), inside.max(initial=-np.inf))
            if high >= 0.0 and low <= 1.0:
                taken[max(0, int(low * CELLS) - 1) : int(high * CELLS) + 2, i] = 1
    return taken
