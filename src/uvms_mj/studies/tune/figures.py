"""Figures of a tuning: the best value over the trials, and the objective over each gain."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ...views import colours
from ...views.figures.style import BLACK, GREY, LINE, PAGE_IN, Figure, panels, styled
from ..plan.metrics import unit_of_column, without_unit
from ..report.figures import ABOVE_PANEL, decades
from .reading import Problem
from .tables import Measure
from .trial import Trial

_COLUMNS = 3
_BULK = 0.9
"""Quantile of the objective up to which a figure shows it: a few bad trials must not make the others look flat."""


def _values(trials: Sequence[Trial], state: str) -> np.ndarray:
    """Objective (n,) of the trials with a state; nan for the others."""
    return np.array(
        [
            np.nan if each.outcome.state != state or each.outcome.objective is None else each.outcome.objective
            for each in trials
        ]
    )


def titled(measure: Measure) -> str:
    """The name of an objective or a constraint with its unit in brackets."""
    unit = unit_of_column(measure.metric)
    return without_unit(measure.label) + (f" [{unit}]" if unit else "")


def history(problem: Problem, trials: Sequence[Trial]) -> Figure:
    """The objective of each trial, and the best feasible value so far."""
    with styled():
        figure = Figure(figsize=(PAGE_IN, 2.3))
        ax = figure.subplots()
        numbers = np.array([each.number for each in trials])
        _points(ax, problem, numbers, trials)
        feasible = _values(trials, "feasible")
        running = np.minimum if problem.objective.direction == "minimize" else np.maximum
        best = running.accumulate(np.where(np.isnan(feasible), _worst(problem), feasible))
        best = np.where(np.isfinite(best), best, np.nan)
        ax.plot(numbers, best, color=_colour(problem), drawstyle="steps-post", linewidth=1.4 * LINE)
        ax.set_xlabel("trial")
        _limited(ax, problem, trials)
        ax.set_ylabel(titled(problem.objective), parse_math=False)
        ax.margins(x=0.02)
        _legend(figure, problem, trials, best=True)
    return figure


def slices(problem: Problem, trials: Sequence[Trial], units: Mapping[str, str], best: Trial | None) -> Figure:
    """The objective over each gain, with the file's own value and the best one."""
    with styled():
        figure, axes = panels(len(problem.gains), _COLUMNS, 0.35, 2.0, sharey=True)
        for i, (ax, gain) in enumerate(zip(axes, problem.gains, strict=True)):
            x = np.array([each.gains[gain.key] for each in trials])
            ax.axvline(problem.start[gain.key], color=GREY, linewidth=LINE, linestyle=(0, (3, 2)))
            _points(ax, problem, x, trials)
            if best is not None:
                ax.plot(best.gains[gain.key], np.array(best.outcome.objective, float), "o", markersize=8, **_ring())
            ax.set_xlim(gain.low, gain.high)
            if gain.log:
                decades(ax, "x")
            ax.margins(x=0.03)
            unit = units[gain.key]
            ax.set_xlabel(f"{gain.key} [{unit}]" if unit else gain.key, parse_math=False)
            _limited(ax, problem, trials)
            if i % _COLUMNS == 0:
                ax.set_ylabel(titled(problem.objective), parse_math=False)
        _legend(figure, problem, trials, best=False)
    return figure


def _ring() -> dict[str, Any]:
    return {"color": BLACK, "markerfacecolor": "none"}


def _worst(problem: Problem) -> float:
    return np.inf if problem.objective.direction == "minimize" else -np.inf


def _colour(problem: Problem) -> str:
    return colours.hex_of_runs([problem.plan.laws[0].source])[0]


def _points(ax: Axes, problem: Problem, x: np.ndarray, trials: Sequence[Trial]) -> None:
    """Feasible trials as dots, infeasible ones as open circles, incomplete ones as crosses above the panel."""
    ax.plot(x, _values(trials, "feasible"), "o", color=_colour(problem), markersize=3.2, alpha=0.85, linestyle="none")
    ax.plot(x, _values(trials, "infeasible"), "o", color=GREY, markersize=3.2, markerfacecolor="none", linestyle="none")
    lost = np.array([each.outcome.state == "incomplete" for each in trials])
    if lost.any():
        top = np.full(int(lost.sum()), ABOVE_PANEL)
        ax.plot(x[lost], top, "x", color=GREY, markersize=3.5, transform=ax.get_xaxis_transform(), clip_on=False)


def _limited(ax: Axes, problem: Problem, trials: Sequence[Trial]) -> None:
    """Limit y to the bulk of the values, and make it logarithmic if it still spans decades."""
    found = np.array([each.outcome.objective for each in trials if each.outcome.objective is not None])
    if len(found) < 2 or np.ptp(found) == 0.0:
        return
    minimize = problem.objective.direction == "minimize"
    near, far = (found.min(), np.quantile(found, _BULK)) if minimize else (found.max(), np.quantile(found, 1 - _BULK))
    if found.min() > 0.0 and found.max() > 30.0 * found.min():
        decades(ax, "y")
    elif abs(found.max() - found.min()) > 3.0 * abs(far - near) > 0.0:
        margin = 0.08 * (far - near)
        low, high = sorted((near - margin, far + margin))
        ax.set_ylim(low, high)


def _legend(figure: Figure, problem: Problem, trials: Sequence[Trial], *, best: bool) -> None:
    states = [each.outcome.state for each in trials]
    look: dict[str, Any] = {"linestyle": "none", "markersize": 4}
    kinds = {
        "feasible": Line2D([], [], color=_colour(problem), marker="o", **look),
        "infeasible": Line2D([], [], color=GREY, marker="o", markerfacecolor="none", **look),
        "incomplete": Line2D([], [], color=GREY, marker="x", **look),
    }
    handles = []
    for state, handle in kinds.items():
        if state in states:
            handle.set_label(f"{state} ({states.count(state)})")
            handles.append(handle)
    if best:
        handles.append(Line2D([], [], color=_colour(problem), linewidth=1.4 * LINE, label="best feasible so far"))
    else:
        handles.append(Line2D([], [], color=GREY, linewidth=LINE, linestyle=(0, (3, 2)), label="the file's own"))
        handles.append(Line2D([], [], marker="o", linestyle="none", markersize=8, label="best", **_ring()))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
