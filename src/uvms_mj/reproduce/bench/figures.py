"""Figures of the benchmark: the laws of each task in their order, and the courses of the push on a task."""

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import to_rgba

from ...analysis.hold import HOLD_S
from ...analysis.summary import COURSES, PARTS
from ...control.task import Schedule
from ...studies.pages import Picture
from ...views import colours
from ...views.figures.style import GREY, LINE, SMALL, panels, styled
from .results import broken, ended
from .task import LEVELS, Task

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


def colours_of(found: Mapping[str, Any]) -> list[str]:
    """A colour for each law."""
    return colours.hex_of_runs([law["name"] for law in found["laws"]])


_COLUMNS, _HEIGHT = 5, 1.15
_TOP = 2.5
"""Top of a panel over the largest demanded push; a push above is drawn there."""
_CAPTION = (
    "Push over time, at the first level that a law does not hold, or at level 5. Line: median over the draws of the "
    "mean in each sixtieth of the run. Shade: from the least to the greatest push of all draws, at every step. Thin "
    "line: the failed draw with the largest error. Dashed: the demanded push. Grey: the hold, in which the push is "
    "judged. A push above the panel is drawn at its top."
)


def demanded(scenario: Any, t: np.ndarray) -> np.ndarray:
    """The demanded push |F_d| of a scenario at times t (n,) [N]."""
    impedance = scenario.impedance
    if not impedance.schedule:
        return np.full(len(t), np.linalg.norm(impedance.F_d[:3]))
    settings = SimpleNamespace(**Schedule().constants(SimpleNamespace(scenario=scenario)))
    out = SimpleNamespace(K_f=np.zeros(6), F_d=np.zeros(6))
    push = []
    for each in t:
        Schedule.step(settings, None, SimpleNamespace(t=each), None, out)
        push.append(float(np.linalg.norm(out.F_d[:3])))
    return np.array(push)


def courses(task: Task, base: Any, rows: "Mapping[str, pd.DataFrame]", colours: Mapping[str, str]) -> Picture:
    """The figure of a task.

    Args:
        base: a scenario of the task.
        rows: the draws of each law at the level that ended its ladder, or at the last one, by the title of its panel.
        colours: by the same titles.
    """
    duration = base.simulation.duration
    t = (np.arange(PARTS) + 0.5) * duration / PARTS
    push = demanded(base, t)
    top = _TOP * float(push.max())
    with styled():
        figure, drawn = panels(len(rows), _COLUMNS, 0.1, _HEIGHT, sharex=True, sharey=True)
        for ax, (label, frame) in zip(drawn, rows.items(), strict=True):
            mean, least, greatest = (_matrix(frame, name) for name in COURSES)
            ax.axvspan(duration - HOLD_S, duration, color=GREY, alpha=0.12, linewidth=0.0)
            if np.isfinite(mean).any():
                low, high = (np.clip(edge, 0.0, top) for edge in (_least(least), -_least(-greatest)))
                ax.fill_between(t, low, high, color=colours[label], alpha=0.25, linewidth=0.0)
                ax.plot(t, np.clip(_median(mean), 0.0, top), color=colours[label], linewidth=1.2 * LINE)
            worst = _worst(task, frame)
            if worst is not None:
                ax.plot(t, np.clip(mean[worst], 0.0, top), color="#000000", linewidth=0.5 * LINE)
            ax.plot(t, push, color="#000000", linestyle="--", linewidth=0.6 * LINE)
            ax.set_title(label, fontsize=SMALL, loc="left")
            ax.set_ylim(0.0, top)
            ax.set_xlim(0.0, duration)
        _label_last(drawn)
        figure.supxlabel("time [s]", fontsize=SMALL)
        figure.supylabel("push [N]", fontsize=SMALL)
    return Picture(f"courses-{task.name}", _CAPTION, figure)


def _label_last(axes: "Sequence[Axes]") -> None:
    """Number the time or the levels below the last panel of each column, also above the end of a row that is not
    full."""
    place = axes[0].get_subplotspec()
    for ax in axes[-(place.get_gridspec().ncols if place is not None else 1) :]:
        ax.tick_params(labelbottom=True)


def _matrix(frame: "pd.DataFrame", name: str) -> np.ndarray:
    """(draws, parts) of a course."""
    columns = [f"{name}.{i:02d}" for i in range(PARTS)]
    return frame[columns].to_numpy(dtype=float)


def _least(values: np.ndarray) -> np.ndarray:
    return np.nanmin(np.where(np.isnan(values), np.inf, values), axis=0)


def _median(values: np.ndarray) -> np.ndarray:
    """Median of each column; nan where most values are missing."""
    return np.median(np.where(np.isnan(values), np.nan, values), axis=0)


def _worst(task: Task, frame: "pd.DataFrame") -> int | None:
    """The position of the failed draw with the largest error; None if none fails."""
    failed = [i for i, row in enumerate(frame.to_dict("records")) if broken(task, row)]
    if not failed:
        return None
    errors = frame["hold.error_N"].fillna(np.inf).to_numpy(dtype=float)
    return max(failed, key=lambda i: errors[i])


_PALE = 0.25
"""Opacity of the bars, whose edges have the full colour."""
ORDER = (
    "The laws of each task in order: by the level that they hold, and by the share of the draws that they pass at the "
    "next. A full step is a level."
)


def order(found: Mapping[str, Any], shown: Mapping[str, str]) -> Any:
    """A figure with a panel a task: the laws as bars, in the order of their levels."""
    names = list(found["tasks"])
    with styled():
        figure, drawn_in = panels(len(names), _COLUMNS, 0.1, 0.35 + 0.13 * len(found["laws"]), sharex=True)
        for ax, name in zip(drawn_in, names, strict=True):
            lengths = {law["label"]: reach(law["tasks"][name]) for law in found["laws"] if law["tasks"][name]["runs"]}
            labels = sorted(lengths, key=lambda label: lengths[label])
            ax.barh(
                range(len(labels)),
                [lengths[each] for each in labels],
                color=[to_rgba(shown[each], _PALE) for each in labels],  # the names stand on the bars
                edgecolor=[shown[each] for each in labels],
                linewidth=0.8 * LINE,
                height=0.7,
            )
            for i, label in enumerate(labels):
                ax.text(0.06, i, label, va="center", fontsize=SMALL, parse_math=False)
            ax.set_yticks([])
            ax.set_xlim(0.0, len(LEVELS))
            ax.set_xticks(range(len(LEVELS) + 1))
            ax.set_title(f"{found['tasks'][name]['number']} {name.replace('_', ' ')}", fontsize=SMALL, loc="left")
        _label_last(drawn_in)
        figure.supxlabel("level", fontsize=SMALL)
    return figure


def reach(ladder: Mapping[str, Any]) -> float:
    """The level that a law holds, and the share of the draws that it passes at the next one [1], which orders laws that
    hold the same level."""
    last = ended(ladder)
    return ladder["level"] + (0.0 if last is None else last[1]["passed"] / last[1]["draws"])
