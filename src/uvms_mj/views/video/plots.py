"""The plots beside the scene. They are drawn twice, with their lines and without, and uncovered as time goes on."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg

from ...errors import InputError
from ...records.trace import Trace
from ..figures import compose
from ..figures.panels import LEVELS, MEANINGS
from ..figures.style import Figure, styled

_CONSTANT = (*LEVELS, "wall")
"""Names of the lines that do not change with time."""

_SHORT = {text: name for name, text in MEANINGS.items()}
"""Short entries of a legend by the long ones."""


class Plots:
    """Pictures of the plots of a run, by time."""

    def __init__(self, trace: Trace, whats: Sequence[str], width: int, height: int, dpi: float) -> None:
        """Of each quantity the first panel of its figure is drawn. Raises InputError if the run has no such quantity,
        or there is no room for so many."""
        if height < 90 * len(whats) * dpi / 100.0:
            raise InputError(f"{len(whats)} plots need more height than {height} pixels; give fewer, or a larger size")
        for what in whats:
            compose.check_quantity(what, {"": trace})
        with styled():
            figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi)
            canvas = FigureCanvasAgg(figure)
            axes = list(figure.subplots(len(whats), 1, squeeze=False, sharex=True)[:, 0])
            panels = [compose.of_one("the run", trace, what)[0][0] for what in whats]
            compose.fill(list(zip(axes, panels, strict=True)))
            for ax in axes:
                ax.set_xlim(left=float(trace.t[0]))
                if ax is not axes[-1]:
                    ax.set_xlabel("")
                _legend(ax)
            figure.align_ylabels(axes)
            canvas.draw()
            figure.set_layout_engine("none")  # both pictures have this layout
            self.whole = _drawn(canvas)
            for artist in figure.findobj(lambda each: bool(each.get_gid())):
                artist.set_visible(str(artist.get_gid()) in _CONSTANT)
            self.empty = _drawn(canvas)
        self._boxes = [ax.get_window_extent() for ax in axes]
        self._t, self._height = (float(trace.t[0]), float(trace.t[-1])), height
        self._ends = [ax.transData.transform([(t, 0.0) for t in self._t])[:, 0] for ax in axes]

    def at(self, t: float) -> np.ndarray:
        """The picture (height, width, 3) with the lines up to a time [s]."""
        picture = self.empty.copy()
        share = np.clip((t - self._t[0]) / max(self._t[1] - self._t[0], 1e-12), 0.0, 1.0)
        for box, (first, last) in zip(self._boxes, self._ends, strict=True):
            top, bottom = round(self._height - box.y1), round(self._height - box.y0)
            now = round(first + share * (last - first))
            rows, columns = slice(max(0, top - 2), bottom + 3), slice(max(0, int(box.x0) - 2), now + 1)
            picture[rows, columns] = self.whole[rows, columns]
            if share < 1.0:
                picture[top:bottom, now : now + 1] = (150, 150, 150)
        return picture


def _drawn(canvas: FigureCanvasAgg) -> np.ndarray:
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _legend(ax: Axes) -> None:
    """Name the lines where they leave most room."""
    found = {str(label): handle for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    if len(found) > 1:
        look: dict[str, Any] = {"fontsize": 6.0, "frameon": True, "edgecolor": "none", "framealpha": 0.8}
        names = [_SHORT.get(label, label) for label in found]
        ax.legend([*found.values()], names, loc="best", ncols=1 if len(names) < 4 else 2, **look)
