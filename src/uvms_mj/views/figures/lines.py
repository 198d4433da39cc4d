"""Lines that are thinned without loss of extremes, for logs of any length."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

PIXELS_PER_INCH = 300
"""Resolution for which lines are thinned."""


def thin(t: np.ndarray, values: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest sample of each pixel column, with their own times, and the first and last sample.

    From times (n,) and values (n,), these are at most 2 columns + 2 samples; all samples if there are no more.
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
    """Width and height of an axes [in]; approximate before the layout is computed."""
    figure, box = ax.get_figure(root=True), ax.get_position()
    assert figure is not None
    return figure.get_figwidth() * box.width, figure.get_figheight() * box.height


def line(ax: Axes, t: np.ndarray, values: np.ndarray, name: str, **look: Any) -> None:
    """Draw samples (n,) as one line; ``name`` is its group id in an SVG."""
    columns = max(100, round(size_in(ax)[0] * PIXELS_PER_INCH))
    ax.plot(*thin(t, values, columns), gid=name, **look)


def ticks(ax: Axes, most: int) -> None:
    """Set at most ``most`` intervals with round numbers on both axes."""
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))
