"""What stands where in the viewer: a 3-D view, and beside it the plots that tell how a run went."""

import hashlib
from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from ..closed_forms import SteadyState
from .run import TIMELINE, Run

_ENDS_ALONE, _ENDS_COMPARED = 1.3, 1.5
"""Where the plots' time axis ends, in durations, so that the legend hides no line; it is wider with runs' names."""
_FORCES_AT_REST = 2.5
"""Where the axis of the contact force ends, in forces at rest: an impact is ten times as large, and has its own tab."""
_WATER = (84, 112, 128)
"""What the 3-D view has behind: neither dark, for much of a vehicle is black, nor light, for text."""
_EYE = (-0.42, -1.13, 0.63)
"""Where the 3-D view looks from, seen from its centre, in lengths of the way from start to wall."""


def application(runs: Sequence[Run]) -> str:
    """The name under which a viewer keeps a layout, and would give it to whatever else has this name: a digest of what
    the layout depends on."""
    parts = [
        (run.label, run.header.scenario, run.header.law.states, getattr(run.header.analytic, "force", None))
        for run in runs
    ]
    return f"uvms-mj {hashlib.sha256(repr(parts).encode()).hexdigest()[:8]}"


def layout(runs: Sequence[Run]) -> rrb.Blueprint:
    """The layout for a run, or for several to compare."""
    together = 3 if len(runs) == 1 else 1
    states = dict.fromkeys(state for run in runs for state in run.header.law.states)
    plots = rrb.Vertical(
        _contact(runs),
        _signal(runs, "Position", "p_WB", 1, reference="p_d"),
        _signal(runs, "Thrust", "tau", together),
        _signal(runs, "Sliding variable", "s", together),
        *(_signal(runs, "State", state, together) for state in states),
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
    header = runs[0].header
    start, face = header.scenario.initial.position, header.scenario.wall.position + header.geometry.reach
    span = abs(face - start[0]) + header.geometry.reach
    centre = (start[0] + 0.55 * (face - start[0]), start[1], start[2])
    up_to_now = rrb.VisibleTimeRanges(
        timeline=TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    return rrb.Spatial3DView(
        origin="/",
        name="Vehicle and wall",
        contents=[f"{run.path('world')}/**" for run in runs],
        overrides={run.path("world", "trajectory"): up_to_now for run in runs},
        eye_controls=rrb.EyeControls3D(
            position=[c + span * e for c, e in zip(centre, _EYE, strict=True)],
            look_target=centre,
            eye_up=(0.0, 0.0, 1.0),
        ),
        line_grid=rrb.LineGrid3D(visible=False),
        background=_WATER,
    )


def _contact(runs: Sequence[Run]) -> rrb.View | rrb.Container:
    lines = [path for run in runs for path in (run.path("push"), run.path("push", "analytic"))]
    rests = [run.header.analytic.force for run in runs if isinstance(run.header.analytic, SteadyState)]
    if not any(rests):
        return _plot(runs, "Contact force [N]", lines)
    top = _FORCES_AT_REST * max(rests)
    return rrb.Tabs(
        _plot(runs, "Contact force [N]", lines, (-0.05 * top, top)), _plot(runs, "with its peak", lines), active_tab=0
    )


def _signal(runs: Sequence[Run], what: str, name: str, together: int, reference: str = "") -> rrb.View | rrb.Container:
    """A signal's components on tabs, so many together; beside each, that of the first run's reference."""
    owners = [run for run in runs if run.has(name)]
    signal = max((run.signal(name) for run in owners), key=lambda signal: signal.size)
    tabs = []
    for start in range(0, signal.size, together):
        these = range(start, min(start + together, signal.size))
        lines = [run.line(name, i) for run in owners for i in these if i < run.signal(name).size]
        lines += [runs[0].line(reference, i) for i in these if reference]
        title = f"{' '.join(signal.components[i] for i in these)} [{signal.units[start]}]"
        tabs.append(_plot(runs, title if start else f"{what} {name}: {title}", lines))
    return rrb.Tabs(*tabs, active_tab=0) if len(tabs) > 1 else tabs[0]


def _plot(
    runs: Sequence[Run], name: str, lines: Sequence[str], limits: tuple[float, float] | None = None
) -> rrb.TimeSeriesView:
    """A plot of entities over the whole of the longest run."""
    end = max(run.header.scenario.steps * run.header.scenario.simulation.timestep for run in runs)
    room = _ENDS_ALONE if len(runs) == 1 else _ENDS_COMPARED
    time = rr.TimeRange(
        start=rrb.TimeRangeBoundary.absolute(seconds=0.0),
        end=rrb.TimeRangeBoundary.absolute(seconds=room * end),
    )
    return rrb.TimeSeriesView(
        origin="/",
        name=name,
        contents=list(lines),
        axis_x=rrb.TimeAxis(view_range=time),
        axis_y=rrb.ScalarAxis(range=limits) if limits else None,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )
