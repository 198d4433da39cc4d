"""The page of a tuning: what was found, against the file's own gains, and what was tried."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from ..pages import Picture, Table, number, rendered
from ..plan.places import unit_of
from ..report.tables import digits_of
from . import figures
from .reading import Problem
from .trial import Trial

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
    return rendered(
        Path(__file__).with_name("tune.html"),
        title=problem.name,
        description=problem.plan.description,
        line=problem.text()[-1],
        plan=problem.plan,
        counts=counts,
        missing=max(0, problem.search.trials - len(trials)),
        best=best,
        compared=_compared(problem, trials, best, units),
        command=f"uvms-mj run {shlex.quote(str(Path(folder, 'found.toml')))}",
        report_command=best and f"uvms-mj study report {shlex.quote(str(Path(folder, f'trial-{best.number:05d}')))}",
        history=Picture("history", _HISTORY, figures.history(problem, trials)) if trials else None,
        slices=Picture("slices", _SLICES, figures.slices(problem, trials, units, best)) if trials else None,
        ten=_ten(problem, trials),
        ranges=_ranges(problem, units),
    )


def _compared(problem: Problem, trials: Sequence[Trial], best: Trial | None, units: dict[str, str]) -> Table | None:
    """The file's own gains beside the found ones, with the difference."""
    if not trials:
        return None
    shown = [trials[0], *([best] if best is not None else [])]
    limits = {each.label: each.limits for each in problem.constraints}
    titles = {each.label: figures.titled(each) for each in (problem.objective, *problem.constraints)}
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
    names = [figures.titled(each) for each in (problem.objective, *problem.constraints)]
    shown = [(*each.gains.values(), each.outcome.objective, *each.outcome.constraints) for each in feasible[:_TEN]]
    digits = [digits_of([0.0 if x is None else x for x in column]) for column in zip(*shown, strict=True)]
    rows = [
        (f"trial {each.number}", [number(x, n) for x, n in zip(values, digits, strict=True)])
        for each, values in zip(feasible, shown, strict=False)
    ]
    return Table("", [*(gain.key for gain in problem.gains), *names], rows)


def _ranges(problem: Problem, units: dict[str, str]) -> list[tuple[str, str]]:
    """What was searched, with what."""
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
