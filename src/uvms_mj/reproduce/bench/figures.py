"""Small multiples of a task: the push of each law over time."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...analysis.hold import HOLD_S
from ...analysis.summary import COURSES, PARTS
from ...control.task import Schedule
from ...studies.pages import Picture
from ...views.figures.style import GREY, LINE, SMALL, panels, styled
from .results import broken
from .task import Task

if TYPE_CHECKING:
    import pandas as pd

    from .execution import Job

_COLUMNS, _HEIGHT = 5, 1.15
_TOP = 2.5
"""Top of a panel over the largest demanded push; a push above is drawn there."""
_CAPTION = (
    "Push over time. Line: median over the draws of the mean in each sixtieth of the run. Shade: from the least to the "
    "greatest push of all draws, at every step. Thin line: the failed draw with the largest error. Dashed: the "
    "demanded push. Grey: the hold, in which the push is judged. A push above the panel is drawn at its top."
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


def courses(
    task: Task, jobs: "Mapping[str, Job]", rows: "Mapping[str, pd.DataFrame]", colours: Mapping[str, str]
) -> Picture | None:
    """The figure of a task; None if no law runs on it."""
    if not rows:
        return None
    some = next(iter(jobs.values())).plan
    assert some is not None
    duration = some.base.simulation.duration
    t = (np.arange(PARTS) + 0.5) * duration / PARTS
    push = demanded(some.base, t)
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
        place = drawn[0].get_subplotspec()
        columns = place.get_gridspec().ncols if place is not None else 1
        for ax in drawn[-columns:]:  # also above the end of a row that is not full
            ax.tick_params(labelbottom=True)
        figure.supxlabel("time [s]", fontsize=SMALL)
        figure.supylabel("push [N]", fontsize=SMALL)
    return Picture(f"courses-{task.name}", _CAPTION, figure)


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
