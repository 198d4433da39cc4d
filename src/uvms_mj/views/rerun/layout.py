"""Layout of the viewer: a 3-D view and, to its right, the plots."""

import hashlib
import itertools
from collections.abc import Iterable, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...control.base import SteadyState
from ...physics.tree import MOST_JOINTS
from ...records.scene import span, wall_face
from .run import TIMELINE, Run, readable

_ENDS_ALONE, _ENDS_COMPARED = 1.3, 1.5
"""End of the plots' time axis, in durations, so that the legend hides no line. Names of runs make the legend wider."""
_FORCES_AT_REST = 2.5
"""End of the contact force's axis, relative to the largest force at rest. An impact may be ten times as large."""
_WATER = (84, 112, 128)
"""Background of the 3-D view: lighter than the black parts of a vehicle, darker than the text."""
_EYE = (-0.42, -1.13, 0.63)
"""Position of the 3-D view's eye relative to its centre, in units of the distance from start to wall."""


def application(runs: Sequence[Run]) -> str:
    """Application name for a layout: a digest of the layout's inputs.

    Rerun stores layouts by application name and would otherwise apply a stored layout to other runs.
    """
    parts = [
        (run.label, run.header.scenario, run.header.law.states, getattr(run.header.analytic, "force", None))
        for run in runs
    ]
    return f"uvms-mj {hashlib.sha256(repr(parts).encode()).hexdigest()[:8]}"


def layout(runs: Sequence[Run]) -> rrb.Blueprint:
    """The layout for one run, or for the comparison of several runs."""
    together = 3 if len(runs) == 1 else 1
    states = dict.fromkeys(state for run in runs for state in run.header.law.states)
    thrust, sliding = _signal(runs, "Thrust", "tau", together), _signal(runs, "Sliding variable", "s", together)
    law = [_signal(runs, "State", state, together) for state in states]
    arms = any(run.header.geometry.links for run in runs)
    groups = [_joints(runs), [*thrust, *sliding, *itertools.chain(*law)]] if arms else [thrust, sliding, *law]
    position = _signal(runs, "Position", runs[0].origin, 1, reference="p_d")
    plots = rrb.Vertical(
        _tabs(_contact(runs), 0 if _over(runs) else -1), *(_tabs(views) for views in (position, *groups) if views)
    )
    return rrb.Blueprint(
        rrb.Horizontal(_scene(runs), plots, column_shares=[11, 9]),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        auto_views=False,
    )


def _scene(runs: Sequence[Run]) -> rrb.Spatial3DView:
    header, scale = runs[0].header, runs[0].place.force_scale
    starts, face = np.array([run.header.scenario.initial.position for run in runs]), wall_face(header)
    together = runs[0].place.y == runs[-1].place.y  # one run, or one world
    start = starts.mean(axis=0).tolist() if together else header.scenario.initial.position
    lanes = float(np.ptp(starts[:, 1])) if together else abs(runs[0].place.y - runs[-1].place.y)
    room = span(header) if header.geometry.links else abs(face - start[0])  # an arm reaches to the wall from afar
    distance = 1.15 * room + header.geometry.reach + lanes
    centre = (start[0] + 0.65 * (face - start[0]), start[1], start[2])
    up_to_now = rrb.VisibleTimeRanges(
        timeline=TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    return rrb.Spatial3DView(
        origin="/",
        name=f"Vehicle and wall (arrows: {scale:g} m/N)",
        contents=[f"{run.path('world')}/**" for run in runs],
        overrides={run.path("world", "trajectory"): up_to_now for run in runs},
        eye_controls=rrb.EyeControls3D(
            position=[c + distance * e for c, e in zip(centre, _EYE, strict=True)],
            look_target=centre,
            eye_up=(0.0, 0.0, 1.0),
        ),
        line_grid=rrb.LineGrid3D(visible=False),
        background=_WATER,
    )


def _over(runs: Sequence[Run]) -> bool:
    """Whether all runs are finished, so that the ranges of their signals are known."""
    return all(run.extents is not None for run in runs)


def _tabs(views: Sequence[rrb.View], active: int = 0) -> rrb.View | rrb.Container:
    return rrb.Tabs(*views, active_tab=active % len(views)) if len(views) > 1 else views[0]


def _contact(runs: Sequence[Run]) -> list[rrb.View]:
    """Views of the contact force: up to the known or expected forces at rest, and up to the peak."""
    lines = [path for run in runs for path in (run.path("push"), run.path("push", "analytic"))]
    lines += [run.line(edge, 0) for run in runs for edge in run.band("push")]
    rests = [run.header.analytic.force for run in runs if isinstance(run.header.analytic, SteadyState)]
    seen = [run.extents for run in runs if run.extents is not None]
    top = _FORCES_AT_REST * max([*rests, *(each.rest for each in seen)], default=0.0)
    whole = _plot(runs, "with its peak", lines, [(0.0, max(each.peak for each in seen))] if _over(runs) else ())
    if top <= 0.0 or (_over(runs) and top > max(each.peak for each in seen)):
        whole.name = "Contact force [N]"
        return [whole]
    return [_plot(runs, "Contact force [N]", lines, [(0.0, top)]), whole]


def _joints(runs: Sequence[Run]) -> list[rrb.View]:
    """Views of the joints: positions, torques, velocities, manipulability."""
    kinds = (("Joints", "q"), ("Torque", "tau_q"), ("Velocity", "q_dot"), ("Manipulability", "manipulability"))
    together = MOST_JOINTS if len(runs) == 1 else 1
    return [view for what, name in kinds for view in _signal(runs, what, name, together)]


def _signal(runs: Sequence[Run], what: str, name: str, together: int, reference: str = "") -> list[rrb.View]:
    """Views of a signal, ``together`` components in each, with the first run's reference; empty without it."""
    owners = [run for run in runs if name in run.header.by_name]
    views: list[rrb.View] = []
    if not owners:
        return views
    owner = max(owners, key=lambda run: run.header.by_name[name].size)
    signal = owner.header.by_name[name]
    parts, units = owner.header.components(signal), owner.header.units(signal)
    for start in range(0, signal.size, together):
        these = range(start, min(start + together, signal.size))
        lines = [
            (run, each, i)
            for run in owners
            for i in these
            if i < run.header.by_name[name].size
            for each in (name, *run.band(name))
        ]
        lines += [(runs[0], reference, i) for i in these if reference]
        limits = [run.extents.ranges[name][i] for run, name, i in lines if run.extents is not None]
        title = f"{' '.join(parts[i] for i in these)} [{', '.join(dict.fromkeys(units[i] for i in these))}]"
        full = f"{what} {name}: {title}" if start == 0 else f"{name}: {title}"
        views.append(_plot(runs, full, [run.line(name, i) for run, name, i in lines], limits if _over(runs) else ()))
    return views


def _plot(
    runs: Sequence[Run], name: str, lines: Sequence[str], limits: Iterable[tuple[float, float]] = ()
) -> rrb.TimeSeriesView:
    """A plot of entities over the duration of the longest run, with a value axis that contains the given ranges."""
    limits = list(limits)
    end = max(run.header.scenario.steps * run.header.scenario.simulation.timestep for run in runs)
    room = _ENDS_ALONE if len(runs) == 1 else _ENDS_COMPARED
    time = rr.TimeRange(
        start=rrb.TimeRangeBoundary.absolute(seconds=0.0), end=rrb.TimeRangeBoundary.absolute(seconds=room * end)
    )
    return rrb.TimeSeriesView(
        origin="/",
        name=name,
        contents=list(lines),
        axis_x=rrb.TimeAxis(view_range=time),
        axis_y=rrb.ScalarAxis(range=readable(limits)) if limits else None,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )
