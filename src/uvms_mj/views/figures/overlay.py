"""Several runs on the same axes: one panel for each component, each run in the colour of its law.

If one run would make the others look flat, the axis is logarithmic beyond a limit that the panel shows.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...records.trace import Trace
from ...stages.signals import AXES, OF_JOINTS, OF_THRUSTERS, Signal
from .. import colours
from .panels import (
    ANGULAR,
    LINEAR,
    MOST_LINES,
    MOST_VECTORS,
    REFERENCE,
    Panel,
    led,
    near_wall,
    roll_pitch_yaw,
    samples,
    states_of,
    unit_of,
    wall,
)
from .scales import Inset, fills, largest, linear_within
from .style import line, stripe, symbol

MOST_NAMES = 30
"""Most runs named in the legend; more runs are named by their laws only."""
_BELOW = 1.9
"""zorder of a line that would hide others."""


class Overlay:
    """Panels of several runs, whose traces are given by the names shown in the legend."""

    def __init__(self, traces: Mapping[str, Trace]) -> None:
        self.traces = dict(traces)
        laws = [trace.header.law.source for trace in traces.values()]
        shades = colours.hex_of_runs(laws)
        names = list(traces) if len(traces) <= MOST_NAMES else [f"{law} ({laws.count(law)} runs)" for law in laws]
        self.looks: dict[str, dict[str, Any]] = {}
        for i, (label, name, shade) in enumerate(zip(traces, names, shades, strict=True)):
            self.looks[label] = {"color": shade, "label": name, **stripe(i, len(traces))}

    def of(self, labels: Sequence[str]) -> "Overlay":
        """Some of the runs, in the same colours."""
        some = copy.copy(self)
        some.traces = {label: self.traces[label] for label in labels}
        some.looks = {label: self.looks[label] for label in labels}
        return some

    def position(self, i: int) -> Panel:
        """x, y or z, with references; x with walls."""
        names = {label: trace.header.task_frame[0] for label, trace in self.traces.items()}
        values = {label: trace[names[label]][:, i] for label, trace in self.traces.items()}
        wholes = [largest(trace[names[label]]) for label, trace in self.traces.items()]

        def draw(ax: Axes) -> None:
            for label, trace in self.traces.items():
                line(ax, trace.t, values[label], f"{names[label]}.{AXES[i]}", **self.looks[label])
            for label, trace in self.traces.items():
                if led(trace):
                    line(ax, trace.t, trace.p_d[:, i], f"p_d.{AXES[i]}", **REFERENCE | {"label": "reference"})
                if i == 0:
                    wall(ax, trace, np.concatenate([trace[names[label]][:, 0], trace.p_d[:, 0]]))

        unlabelled = {label: {**look, "label": None} for label, look in self.looks.items()}
        inset = near_wall(self.traces, unlabelled) if i == 0 else ()
        return _panel(f"position {AXES[i]}", "m", draw, values, wholes, inset)

    def attitude(self, i: int) -> Panel:
        """Roll, pitch or yaw, with references [deg]."""
        names = {label: trace.header.task_frame[1] for label, trace in self.traces.items()}
        values = {label: roll_pitch_yaw(trace[names[label]])[:, i] for label, trace in self.traces.items()}

        def draw(ax: Axes) -> None:
            axis = AXES[ANGULAR][i]
            for label, trace in self.traces.items():
                line(ax, trace.t, values[label], f"{names[label]}.{axis}", **self.looks[label])
            for trace in filter(led, self.traces.values()):
                desired = roll_pitch_yaw(trace.quat_d)[:, i]
                line(ax, trace.t, desired, f"quat_d.{axis}", **REFERENCE | {"label": "reference"})

        return Panel(AXES[ANGULAR][i], "deg", draw)

    def signal(self, name: str) -> list[list[Panel]]:
        """A signal of the runs that have it, or one of its components, ``tau.x``: a row of linear and a row of angular
        components, or rows of three joints or thrusters; no rows without it."""
        name, _, component = name.partition(".")
        owners = {label: trace for label, trace in self.traces.items() if name in trace.arrays}
        if not owners:
            return []
        signals = {label: trace.header.by_name[name] for label, trace in owners.items()}
        size = max(signal.size for signal in signals.values())
        if component:
            found = {label: owners[label].header.components(signal) for label, signal in signals.items()}
            having = {label: parts.index(component) for label, parts in found.items() if component in parts}
            owners = {label: owners[label] for label in having}
            i = next(iter(having.values()))
            return [[self._component(name, i, slice(i, i + 1), owners, signals)]]
        rows = [LINEAR, ANGULAR] if all(signal.components == AXES for signal in signals.values()) else [slice(0, size)]
        if name in OF_JOINTS or name in OF_THRUSTERS:
            rows = [slice(i, min(i + 3, size)) for i in range(0, size, 3)]
        elif 1 < max(signal.vectors for signal in signals.values()) <= MOST_VECTORS:
            rows = [slice(i, i + 3) for i in range(0, size, 3)]
        elif size > MOST_LINES:
            return [[self._range(name, owners)]]
        elif size > 3 and len(rows) == 1:
            rows = [slice(0, size // 2), slice(size // 2, size)]  # four panels beside each other have no room for times
        return [[self._component(name, i, part, owners, signals) for i in range(size)[part]] for part in rows]

    def _component(
        self, name: str, i: int, part: slice, owners: Mapping[str, Trace], signals: Mapping[str, Signal]
    ) -> Panel:
        having = {label: trace for label, trace in owners.items() if signals[label].size > i}
        bands = {
            label: np.stack([edge.reshape(len(trace), -1) for edge in trace.band(name)])
            for label, trace in having.items()
        }
        values = {label: each[..., i] for label, each in bands.items()}
        wholes = [largest(each[..., part]) for each in bands.values()]
        label = next(iter(having))
        header = having[label].header
        component = header.components(signals[label])[i]
        shown = f"{i // 3 + 1},{AXES[i % 3]}" if signals[label].vectors > 1 else component

        def draw(ax: Axes) -> None:
            for label, trace in having.items():
                full = fills(trace[name].reshape(len(trace), -1)[:, i])
                look = self.looks[label] | ({"zorder": _BELOW} if full else {})
                samples(ax, trace, name, i, slice(None), f"{name}.{component}".rstrip("."), **look)

        return _panel(
            symbol(name, shown),
            header.units(signals[label])[i] if name in OF_JOINTS else unit_of(signals[label], slice(i, i + 1)),
            draw,
            values,
            wholes,
        )

    def _range(self, name: str, owners: Mapping[str, Trace]) -> Panel:
        """The range of the numbers of a large state."""
        flat = {label: trace[name].reshape(len(trace), -1) for label, trace in owners.items()}

        def draw(ax: Axes) -> None:
            for label, trace in owners.items():
                for edge in (flat[label].min(axis=1), flat[label].max(axis=1)):
                    line(ax, trace.t, edge, f"{name}.range", **self.looks[label])

        signal = next(iter(owners.values())).header.by_name[name]
        wholes = [largest(each) for each in flat.values()]
        return _panel(f"range of {symbol(name)}", unit_of(signal, slice(0, 1)), draw, flat, wholes)

    @property
    def velocities(self) -> list[str]:
        """The names of the velocity in the frame of the task of each run."""
        return list(dict.fromkeys(trace.header.task_frame[2] for trace in self.traces.values()))

    def states(self) -> list[str]:
        """The names of all states of all runs' stages."""
        return list(dict.fromkeys(signal.name for trace in self.traces.values() for signal in states_of(trace)))


def _panel(
    what: str,
    unit: str,
    draw: Callable[[Axes], None],
    values: Mapping[str, np.ndarray],
    wholes: Sequence[float],
    insets: Sequence[Inset] = (),
) -> Panel:
    """A panel with one line for each run; ``wholes`` are the largest magnitudes of the complete signals."""
    sizes = [largest(each) for each in values.values()]
    return Panel(what, unit, draw, max(sizes), tuple(insets), within=linear_within(sizes, wholes))
