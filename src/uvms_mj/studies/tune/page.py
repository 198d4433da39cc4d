"""The page of a tuning: what was found, against the file's own gains, and what was tried."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ...views import colours
from ...views.figures import style
from ...views.figures.style import BLACK, GREY, LINE, PAGE_IN, Figure, panels, styled
from ..pages import Page, Picture, Section, Table, Text, facts, given, marked, number, rendered
from ..plan.metrics import unit_of_column, without_unit
from ..plan.places import unit_of
from ..report.figures import ABOVE_PANEL, decades
from ..report.tables import digits_of
from .problem import Measure, Problem, Trial

_STYLE = Path(__file__).with_name("tune.css")
_SAME_DRAWS = (
    "Every trial has the same draws and random numbers. A trial in which a run does not complete, or has no value of a "
    "metric, is incomplete and counts as infeasible, worse than any limit that is exceeded."
)
_TEN = 10
_HISTORY = "The objective of each trial, and the best feasible value so far."
_SLICES = (
    "The objective over each gain. Dashed: the file's own gains. A ring: the best trial. Values far from the bulk are "
    "beyond the edge; crosses at the top are incomplete trials."
)


def page(problem: Problem, trials: Sequence[Trial], best: Trial | None, folder: str) -> str:
    """The report of a tuning as HTML. ``folder`` is the path of its folder, for the commands."""
    scenario = problem.plan.laws[0].scenario
    units = {gain.key: unit_of(gain.key, scenario) for gain in problem.gains}
    states = [each.outcome.state for each in trials]
    counts = [(states.count(state), state) for state in ("feasible", "infeasible", "incomplete") if state in states]
    missing, description = max(0, problem.search.trials - len(trials)), problem.plan.description
    lead = given(
        Text(description, "lead") if description else None,
        Text(f"{problem.text()[-1]}: {', '.join(f'{n} {state}' for n, state in counts)}.", "soft"),
        Text(f"{missing} trials are not done yet.", "warning") if missing else None,
    )
    compared = _compared(problem, trials, best, units)
    found = given(
        compared.shown("Found gains against the file's own") if compared else None,
        *(_commands(best, folder) if best else [Text("No trial is feasible.")]),
        Text(_SAME_DRAWS, "soft"),
    )
    progress = given(Picture("history", _HISTORY, history(problem, trials)) if trials else None)
    gains = given(Picture("slices", _SLICES, slices(problem, trials, units, best)) if trials else None)
    sections = [
        Section("found", "Found", found),
        Section("progress", "Progress", progress, "keep"),
        Section("gains", "Gains", gains, "keep"),
        Section("ten", "Ten best", [_ten(problem, trials).shown("The ten best trials")], "keep"),
        Section("searched", "Search", [facts(_ranges(problem, units))]),
    ]
    return rendered(Page(problem.name, lead, sections, [_STYLE]))


def _commands(best: Trial, folder: str) -> list[Text]:
    """The commands that run the found gains once, and that report all their runs."""
    run = f"uvms-mj run {shlex.quote(str(Path(folder, 'found.toml')))}"
    report = f"uvms-mj study report {shlex.quote(str(Path(folder, f'trial-{best.number:05d}')))}"
    return [
        Text(marked("<code>{}</code>", run), "command"),
        Text(marked("All runs with the found gains: <code>{}</code>", report), "soft"),
    ]


def _compared(problem: Problem, trials: Sequence[Trial], best: Trial | None, units: dict[str, str]) -> Table | None:
    """The file's own gains beside the found ones, with the difference."""
    if not trials:
        return None
    shown = [trials[0], *([best] if best is not None else [])]
    limits = {each.label: each.limits for each in problem.constraints}
    titles = {each.label: titled(each) for each in (problem.objective, *problem.constraints)}
    rows = []
    for name, *values in problem.compared(shown):
        cells = ["–" if value is None else number(value, 5) for value in values]
        change = ""
        if len(values) == 2 and None not in values and values[0]:
            change = f"{100.0 * (values[1] / values[0] - 1.0):+.2g} %".replace("-", "−")
        limit = limits.get(name, problem.objective.direction if name == problem.objective.label else "")
        unit = units.get(name, "")
        shown_name = titles.get(name) or (f"{name} [{unit}]" if unit else name)
        rows.append((shown_name, [*cells, *([change] if len(shown) == 2 else []), limit]))
    rows.append(("state", [each.outcome.state for each in shown] + ([""] if len(shown) == 2 else []) + [""]))
    heads = ["the file's own", *([f"found, trial {best.number}", "change"] if best is not None else []), "asked"]
    return Table("", heads, rows)


def _ten(problem: Problem, trials: Sequence[Trial]) -> Table:
    """The ten best feasible trials."""
    sign = 1.0 if problem.objective.direction == "minimize" else -1.0
    feasible = [each for each in trials if each.outcome.state == "feasible"]
    feasible.sort(key=lambda each: sign * (each.outcome.objective or 0.0))
    names = [titled(each) for each in (problem.objective, *problem.constraints)]
    shown = [(*each.gains.values(), each.outcome.objective, *each.outcome.constraints) for each in feasible[:_TEN]]
    digits = [digits_of([0.0 if x is None else x for x in column]) for column in zip(*shown, strict=True)]
    rows = [
        (f"trial {each.number}", [number(x, n) for x, n in zip(values, digits, strict=True)])
        for each, values in zip(feasible, shown, strict=False)
    ]
    return Table("", [*(gain.key for gain in problem.gains), *names], rows)


def _ranges(problem: Problem, units: dict[str, str]) -> list[tuple[str, str]]:
    """The search: its unknowns and its means."""
    plan = problem.plan
    rows = [("base scenario", plan.base.name), ("law", plan.laws[0].label)]
    for gain in problem.gains:
        unit = f" {units[gain.key]}" if units[gain.key] else ""
        rows.append((gain.key, f"{gain.low:g} to {gain.high:g}{unit}{', logarithmic' if gain.log else ''}"))
    for each in plan.variations:
        unit = plan.units.get(each.places[0], "")
        rows.append((", ".join(each.places), f"{each.range()}{f' {unit}' if unit else ''}"))
    repeats = f", {plan.repeats} repeats each" if plan.repeats > 1 else ""
    rows.append(("runs of a trial", f"{plan.runs}: {plan.draws} draws ({plan.design.replace('_', ' ')}){repeats}"))
    rows.append(("base time", f"{plan.base.simulation.duration:g} s in steps of {plan.base.simulation.timestep:g} s"))
    rows.append(
        ("search", f"{problem.search.trials} trials, sampler {problem.search.sampler}, seed {problem.search.seed}")
    )
    return rows


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


def _axis(measure: Measure) -> str:
    return style.titled(without_unit(measure.label), unit_of_column(measure.metric))


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
        ax.set_ylabel(_axis(problem.objective))
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
            ax.set_xlabel(style.titled(gain.key, units[gain.key]))
            _limited(ax, problem, trials)
            if i % _COLUMNS == 0:
                ax.set_ylabel(_axis(problem.objective))
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
