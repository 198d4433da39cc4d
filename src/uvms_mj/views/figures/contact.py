"""Panel of the contact force of one or several runs, with insets of the impacts and of the force at rest."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...control.base import SteadyState
from ...control.design import demanded_force
from ...records.trace import Trace
from .insets import Inset
from .panels import LEVELS, Panel, level
from .scales import largest, linear_within, rebounds
from .style import COLOURS, LINE, line

_TALLER = 0.3
"""Additional height of a panel per inset, in heights of a panel."""
_MOST_OF_A_RUN = 0.4
"""Impacts that take a larger fraction of a run are readable without an inset."""


def force(trace: Trace) -> Panel:
    """Panel of the force with which the vehicle of one run pushes on the wall."""
    return forces({"": trace}, {"": {"label": "contact force", "color": COLOURS["force"], "linewidth": LINE}})


def forces(traces: Mapping[str, Trace], looks: Mapping[str, Mapping[str, Any]]) -> Panel:
    """Panel of the forces with which vehicles push on the wall, and of the expected forces at rest.

    Insets show the impacts, from the first contact to the end of the rebounds, and the force at rest. ``looks`` are
    colour, dashes and label of each trace.
    """

    def draw(ax: Axes) -> None:
        _pushes(ax, traces, looks)
        _expected(ax, traces)
        ax.set_ylim(bottom=min(0.0, -0.03 * ax.get_ylim()[1]))

    sizes = [_peak(trace) for trace in traces.values()]
    insets = (*_impacts(traces, looks), *_at_rest(traces, looks))
    height = 1.0 + _TALLER * len(insets)
    return Panel("contact force", "N", draw, 1.0, insets, height, linear_within(sizes, sizes))


def _peak(trace: Trace) -> float:
    """Largest push that is drawn [N]."""
    return largest(trace.band("push")[1])


def expected_forces(trace: Trace) -> list[tuple[str, float]]:
    """Names and values of the force that the impedance task demands at a rigid wall, and of the closed form [N]."""
    found = []
    if "s" in trace.header.by_name:  # the law uses the task
        found.append(("expected", demanded_force(trace.scenario, math.inf)))  # the paper neglects the wall's compliance
    if isinstance(trace.analytic, SteadyState):
        found.append(("analytic", trace.analytic.force))
    return [(name, force) for name, force in found if 0.0 < force < math.inf]


def _pushes(
    ax: Axes,
    traces: Mapping[str, Trace],
    looks: Mapping[str, Mapping[str, Any]],
    window: tuple[float, float] = (-np.inf, np.inf),
) -> list[float]:
    """Draw the pushes within a window of time and one sample on either side; return least and largest values [N]."""
    ends = []
    for label, trace in traces.items():
        first, last = np.searchsorted(trace.t, window)
        rows = slice(max(0, first - 1), last + 1)
        if len(trace.t[rows]) > 1:
            low, high = (edge[rows] for edge in trace.band("push"))
            line(ax, trace.t[rows], trace.push[rows], "push", (low, high), **looks[label])
            ends += [float(low.min()), float(high.max())]
    return ends


def _expected(ax: Axes, traces: Mapping[str, Trace]) -> list[float]:
    """Draw the expected forces of all runs, each once; return their values [N]."""
    span = np.array([min(trace.t[0] for trace in traces.values()), max(trace.t[-1] for trace in traces.values())])
    found = dict.fromkeys(pair for trace in traces.values() for pair in expected_forces(trace))
    for name, force in found:
        level(ax, span, force, name, LEVELS[name])
    return [force for _, force in found]


def _impacts(traces: Mapping[str, Trace], looks: Mapping[str, Mapping[str, Any]]) -> tuple[Inset, ...]:
    windows = [window for trace in traces.values() if (window := rebounds(trace.t, *trace.band("push")))]
    if not windows:
        return ()
    first, last = min(window[0] for window in windows), max(window[1] for window in windows)
    if not 0.0 < last - first <= _MOST_OF_A_RUN * max(float(trace.t[-1]) for trace in traces.values()):
        return ()

    def draw(ax: Axes, _: float) -> None:
        top = max(_pushes(ax, traces, looks, (first, last)))
        ax.set(xlim=(first, last), ylim=(-0.04 * top, 1.06 * top))

    return (Inset(draw, "impacts", height=0.36),)


def _at_rest(traces: Mapping[str, Trace], looks: Mapping[str, Mapping[str, Any]]) -> tuple[Inset, ...]:
    """Inset of the second half of the time after first contact, for runs in contact then, if peaks are much larger."""
    pushes = {label: trace.band("push")[1] for label, trace in traces.items()}
    touched = {label: trace for label, trace in traces.items() if pushes[label].any()}
    if not touched:
        return ()
    start = max(0.5 * float(trace.t[np.argmax(pushes[label] > 0.0)] + trace.t[-1]) for label, trace in touched.items())
    end = max(float(trace.t[-1]) for trace in touched.values())
    late = {label: pushes[label][trace.t >= start] for label, trace in touched.items()}
    resting = {label: trace for label, trace in touched.items() if late[label].any()}
    highest = max((largest(late[label]) for label in resting), default=0.0)
    if not resting or 2.0 * highest > max(_peak(trace) for trace in traces.values()):
        return ()

    def draw(ax: Axes, _: float) -> None:
        seen = [*_pushes(ax, resting, looks, (start, end)), *_expected(ax, resting)]
        margin = max(0.2 * (max(seen) - min(seen)), 0.005 * max(seen))
        ax.set(xlim=(start, end), ylim=(min(seen) - margin, max(seen) + margin))

    return (Inset(draw, "at rest", height=0.24),)
