"""Panels of figures: position, sliding variable, actuation force and states of a law; contact force; an arm.

Linear and angular components have separate panels, because their units differ.
"""

import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ...control.base import SteadyState
from ...control.design import demanded_force
from ...physics.frames import rotation_matrix
from ...records.trace import Trace
from ...stages.signals import AXES, OF_JOINTS, OF_THRUSTERS, OWN_UNIT, Signal
from .scales import Inset, early, largest, linear_within, number, prefix_of, rebounding, rebounds
from .style import BLACK, COLOURS, GREY, JOINTS, LINE, line, stripe, symbol, unit_text

LINEAR, ANGULAR = slice(0, 3), slice(3, 6)
"""Components of a signal of six numbers."""
SWITCHING_S = 0.01
"""Time that the insets of tau show from the start of a run [s]. The first-order law's chatter dies out within it."""
MOST_LINES = 6
"""Most lines for one state; a state with more numbers is drawn as the range of its numbers."""
MOST_VECTORS = 4
"""Most vectors of one signal that have a panel each."""
REFERENCE: dict[str, Any] = {"color": BLACK, "linestyle": "dashed", "linewidth": 0.8, "zorder": 4}
LEVELS: dict[str, dict[str, Any]] = {
    "expected": REFERENCE,
    "analytic": {"color": BLACK, "linewidth": LINE, "zorder": 5},
}
"""Line styles of the expected forces, but for their dashes."""
_DASHES = {"expected": (9.0, 3.0), "analytic": (1.0, 1.2)}
"""A dash of each and the gap behind it, in line widths."""
_MOST_OWNERS = 3
"""Most runs that the legend names beside one force."""
MEANINGS = {"expected": "expected at a rigid wall", "analytic": "analytic, at rest at this wall"}
"""Their entries in a legend."""
WALL: dict[str, Any] = {"color": GREY, "linestyle": "dashdot", "linewidth": 0.8, "zorder": 1.5}


_PREFIXED = re.compile(r"(?!kg)[A-Za-z]+(?![A-Za-z²³$^])")
"""A unit whose first factor has no power. mm² is the square of a millimetre, and no thousandth of a square metre."""


@dataclass(frozen=True)
class Panel:
    """Contents of one panel, independent of its axes.

    Attributes:
        draw: draws the lines, in SI.
        largest: magnitude that determines the SI prefix of y; the default, 1, gives no prefix.
        height: in heights of an ordinary panel.
        within: y is logarithmic beyond +-within; None for a linear axis.
    """

    quantity: str
    unit: str
    draw: Callable[[Axes], None]
    largest: float = 1.0
    insets: tuple[Inset, ...] = ()
    height: float = 1.0
    within: float | None = None

    @property
    def scale(self) -> tuple[float, str]:
        """Power of ten of the numbers of y, and the text before its unit: an SI prefix, or the power if the unit can't
        have a prefix: none, 1, 1/s, m², kg."""
        power, prefix = prefix_of(self.largest)
        if power == 1.0 or _PREFIXED.match(self.unit):
            return power, prefix
        return power, {1e-3: "10⁻³ ", 1e-6: "10⁻⁶ ", 1e-9: "10⁻⁹ "}[power]

    def scaled(self, prefix: str) -> str:
        """The unit with its prefix or its power."""
        return f"{prefix}{'' if prefix and self.unit == '1' else self.unit}".strip()

    def label(self, prefix: str) -> str:
        """Label of y: quantity and unit."""
        unit = self.scaled(prefix)
        return f"{self.quantity} [{unit}]" if unit else self.quantity


# Position


def position(trace: Trace) -> Panel:
    """Position in W of B or of the tool, reference and wall; with an inset of x near the wall if the run ends there."""
    name = trace.header.task_frame[0]
    p, reach = trace[name], np.concatenate([trace[name], trace.p_d])

    def draw(ax: Axes) -> None:
        for i, axis in enumerate(AXES[LINEAR]):
            line(ax, trace.t, p[:, i], f"{name}.{axis}", label=axis, color=COLOURS[axis], **stripe(i, 3))
        for i, axis in enumerate(AXES[LINEAR] if led(trace) else ()):
            line(ax, trace.t, trace.p_d[:, i], f"p_d.{axis}", label="reference", **REFERENCE)
        wall(ax, trace, reach)

    what = "tool position" if name == "p_WT" else "position"
    return Panel(what, "m", draw, largest(reach), near_wall({"": trace}, {"": {"color": COLOURS["x"]}}))


def led(trace: Trace) -> bool:
    """Whether a vehicle follows its reference; one without a law drifts."""
    return trace.header.law.source != "none"


def attitude(trace: Trace) -> Panel:
    """Roll, pitch and yaw of B or of the tool, and of the reference [deg]."""
    names = (trace.header.task_frame[1], "quat_d")
    angles, desired = (roll_pitch_yaw(trace[name]) for name in names)

    def draw(ax: Axes) -> None:
        for i, axis in enumerate(AXES[ANGULAR]):
            line(ax, trace.t, angles[:, i], f"{names[0]}.{axis}", label=axis, color=COLOURS[axis], **stripe(i, 3))
        for i, axis in enumerate(AXES[ANGULAR] if led(trace) else ()):
            line(ax, trace.t, desired[:, i], f"quat_d.{axis}", label="reference", **REFERENCE)

    return Panel("tool attitude" if names[0] == "quat_WT" else "attitude", "deg", draw)


def roll_pitch_yaw(quat: np.ndarray) -> np.ndarray:
    """Roll, pitch and yaw (n, 3) of quaternions (n, 4), without jumps by a turn [deg]."""
    R = rotation_matrix(quat)
    roll, yaw = (np.unwrap(np.arctan2(R[:, i, j], R[:, k, k])) for i, j, k in ((2, 1, 2), (1, 0, 0)))
    return np.degrees(np.stack([roll, -np.arcsin(np.clip(R[:, 2, 0], -1.0, 1.0)), yaw], axis=1))


def wall(ax: Axes, trace: Trace, reach: np.ndarray) -> None:
    """Draw the wall's position if positions or references, ``reach``, come near it."""
    x_c, span = trace.scenario.wall.position, float(np.ptp(reach))
    if trace.scenario.wall.present and reach.min() - 0.1 * span <= x_c <= reach.max() + 0.1 * span:
        level(ax, trace.t, x_c, "wall", WALL)


def near_wall(traces: dict[str, Trace], looks: dict[str, dict[str, Any]]) -> tuple[Inset, ...]:
    """Inset of x and its reference near ``[wall]``, if all runs end close to the same one."""
    if not all(trace.scenario.wall.present for trace in traces.values()):
        return ()
    walls = {trace.scenario.wall.position for trace in traces.values()}
    ways = {label: trace[trace.header.task_frame[0]][:, 0] for label, trace in traces.items()}
    depth = max(max(abs(float(trace.p_d[-1, 0]) - min(walls)) for trace in traces.values()), 2e-3)
    x_c = min(walls)
    ends = [float(x[-1]) for x in ways.values()]
    low, high = min(x_c - 0.9 * depth, *ends), x_c + 1.3 * depth
    seen = [label for label, x in ways.items() if np.ptp(x) > 5.0 * (high - low)]
    if len(walls) > 1 or not x_c - 3.0 * depth < min(ends) <= max(ends) < high or len(seen) < len(traces):
        return ()
    low -= 0.1 * depth
    first = min(float(traces[label].t[np.argmax(ways[label] > low)]) for label in seen)

    def draw(ax: Axes, power: float) -> None:
        for label, trace in traces.items():
            rest = slice(int(np.searchsorted(trace.t, first)), None)
            line(ax, trace.t[rest], ways[label][rest], f"{trace.header.task_frame[0]}.x", **looks[label])
            line(ax, trace.t[rest], trace.p_d[rest, 0], "p_d.x", **REFERENCE)
        last = max(float(trace.t[-1]) for trace in traces.values())
        level(ax, np.array([first, last]), x_c, "wall", WALL)
        ax.set(xlim=(first, last), ylim=(low, high))
        number(ax.yaxis, power)

    return (Inset(draw, "x at the wall"),)


# Components: sliding variable, actuation, states


def vector(trace: Trace, name: str, part: slice = LINEAR) -> Panel:
    """Three components of a signal of six numbers, all with the same unit.

    If an initial transient is much larger than the rest of the run, an inset shows the transient and the panel has the
    range of the rest.
    """
    signal = trace.header.by_name[name]
    values = np.concatenate([edge.reshape(len(trace), signal.size)[:, part] for edge in trace.band(name)], axis=1)
    window = early(trace.t, values)
    late = values[trace.t > trace.t[0] + window] if window else values  # a band is of the time before its row
    low, high = float(late.min()), float(late.max())

    def draw(ax: Axes) -> None:
        components(ax, trace, signal, part)
        if window:
            margin = 0.06 * (high - low)
            ax.set_ylim(low - margin, high + margin)

    inset = _beginning(lambda ax: components(ax, trace, signal, part, trace.t[0] + window), window) if window else ()
    return Panel(quantity(trace, name, part), unit_of(signal, part), draw, largest(late), inset)


def quantity(trace: Trace, name: str, part: slice = LINEAR) -> str:
    """Name of the linear or angular components of a signal, for the axis label."""
    if name == "tau":
        return f"actuation {'moment' if part == ANGULAR else 'force'} {symbol(name)}"
    if name == "s":
        return f"sliding variable {symbol(name)}"
    if name == "z" and trace.header.law.source in ("gsta", "sta"):
        return f"integral term {symbol(name)}"
    return f"state {symbol(name)}" if name in (state.name for state in states_of(trace)) else symbol(name)


def tau(trace: Trace, fine: Trace | None, other: Trace | None = None, other_fine: Trace | None = None) -> Panel:
    """Force part of tau, with an inset of its beginning at every step from ``fine``; ``other`` is dashed."""
    inset = _beginning(lambda ax: pair(ax, fine, other_fine, "tau", SWITCHING_S), SWITCHING_S) if fine else ()
    size = max(largest(edge[:, :3]) for edge in trace.band("tau"))
    return Panel(quantity(trace, "tau"), "N", lambda ax: pair(ax, trace, other, "tau"), size, inset)


def _beginning(lines: Callable[[Axes], None], window: float) -> tuple[Inset, ...]:
    """Inset of the beginning of a run up to a time [s]."""
    power, unit = (1e-3, "ms") if window < 1.0 else (1.0, "s")

    def draw(ax: Axes, power_y: float) -> None:
        lines(ax)
        ax.margins(y=0.08)
        ax.set_xlim(0.0, window)
        number(ax.yaxis, power_y)
        number(ax.xaxis, power)

    return (Inset(draw, f"first {window / power:g} {unit}", height=0.38),)


def integral(trace: Trace, other: Trace | None = None) -> Panel:
    """Force part of the integral term of a super-twisting law; ``other`` is dashed."""
    return Panel(
        f"integral term {symbol('z')}", "m/s²", lambda ax: pair(ax, trace, other, "z"), largest(trace.z[:, :3])
    )


def of_signal(trace: Trace, name: str) -> list[Panel]:
    """Panels of a recorded signal by its name, or of one of its components, ``tau.x``."""
    signal, i = trace.header.part(name)
    if i is not None:
        return [some(trace, signal, slice(i, i + 1))]
    if signal.components == AXES:
        return [vector(trace, name, part) for part in (LINEAR, ANGULAR)]
    if 1 < signal.vectors <= MOST_VECTORS:
        return [_one_of(trace, signal, k) for k in range(signal.vectors)]
    return [state(trace, signal)]


def _one_of(trace: Trace, signal: Signal, k: int) -> Panel:
    """The components of vector k of a signal of several."""

    def draw(ax: Axes) -> None:
        for i, axis in enumerate(AXES[LINEAR]):
            look = {"color": COLOURS[axis], "label": axis, **stripe(i, 3)}
            samples(ax, trace, signal.name, 3 * k + i, slice(None), f"{signal.name}.{3 * k + i + 1}", **look)

    part = slice(3 * k, 3 * k + 3)
    size = largest(trace[signal.name].reshape(len(trace), signal.size)[:, part])
    return Panel(symbol(signal.name, str(k + 1)), unit_of(signal, part), draw, size)


def state(trace: Trace, signal: Signal) -> Panel:
    """A signal that is not a vector of six: its numbers, or the range of more than six numbers."""
    if signal.size <= MOST_LINES or signal.name in OF_THRUSTERS:
        return some(trace, signal, slice(0, signal.size))
    values = trace[signal.name].reshape(len(trace), signal.size)

    def draw(ax: Axes) -> None:
        label = f"range of the {signal.size} numbers of {symbol(signal.name)}"
        for edge, text in ((values.min(axis=1), label), (values.max(axis=1), None)):
            line(ax, trace.t, edge, f"{signal.name}.range", color=GREY, label=text)

    return Panel(quantity(trace, signal.name), unit_of(signal, slice(0, signal.size)), draw, largest(values))


def some(trace: Trace, signal: Signal, part: slice) -> Panel:
    """Some components of a signal."""
    size = largest([edge.reshape(len(trace), signal.size)[:, part] for edge in trace.band(signal.name)])
    what = quantity(trace, signal.name, part) if part.stop - part.start > 1 else _one(trace, signal, part.start)
    unit = trace.header.units(signal)[part.start] if signal.name in OF_JOINTS else unit_of(signal, part)
    return Panel(what, unit, lambda ax: components(ax, trace, signal, part), size)


def _one(trace: Trace, signal: Signal, i: int) -> str:
    component = trace.header.components(signal)[i]
    return symbol(signal.name, component) if component else quantity(trace, signal.name)


def unit_of(signal: Signal, part: slice) -> str:
    """Unit of some components in the format of a label; empty if a law does not declare the unit of its state."""
    unit = signal.units[part.start or 0]
    return "" if unit == OWN_UNIT else unit_text(unit)


def samples(ax: Axes, trace: Trace, name: str, i: int, rows: slice, gid: str, **look: Any) -> None:
    """Draw component i of a signal at some rows, with the signal's band."""
    values, low, high = (each.reshape(len(trace), -1)[rows, i] for each in (trace[name], *trace.band(name)))
    line(ax, trace.t[rows], values, gid, (low, high), **look)


def components(ax: Axes, trace: Trace, signal: Signal, part: slice, until: float = np.inf) -> None:
    """Draw some components of a signal, until a time [s]."""
    n = int(np.searchsorted(trace.t, until + 1e-9, side="right"))
    names = trace.header.components(signal)[part]
    labels = trace.header.mjcf.vehicle.thrusters[part] if signal.name in OF_THRUSTERS else names
    for i, component in enumerate(names):
        look = {
            "color": colour(signal, component, part.start + i),
            "label": labels[i].replace("_", " ") or component or symbol(signal.name),
            **stripe(i, len(names)),
        }
        gid = f"{signal.name}.{component}".rstrip(".")
        samples(ax, trace, signal.name, part.start + i, slice(n), gid, **look)


def colour(signal: Signal, component: str, i: int) -> str:
    """Colour of the component i of a signal: the colour of its axis or its joint, or the next one for a mere number."""
    of_numbers = [*(COLOURS[axis] for axis in AXES), COLOURS["force"], *JOINTS]
    numbered = JOINTS if signal.name in OF_JOINTS else of_numbers
    return COLOURS.get(component, GREY if component == "w" else numbered[i % len(numbered)])


def pair(ax: Axes, trace: Trace, other: Trace | None, name: str, until: float = np.inf) -> None:
    """Draw x, y and z of a signal. With another trace, the first is solid and pale and the other dashed above it."""
    # dashes would hide reversals at every sample
    alone: dict[str, Any] = {"linestyle": "solid"} if np.isfinite(until) else {}
    runs: list[tuple[Trace, dict[str, Any]]] = [(trace, {"alpha": 0.45, "linestyle": "solid"} if other else alone)]
    if other is not None:
        runs.append((other, {"linestyle": "dashed", "zorder": 2.5}))
    for run, look in runs:
        n = int(np.searchsorted(run.t, until + 1e-9, side="right"))
        for i, axis in enumerate(AXES[LINEAR]):
            label = axis if run is trace else None
            whole = {"color": COLOURS[axis], "label": label, **stripe(i, 3), **look}
            samples(ax, run, name, i, slice(n), f"{name}.{axis}", **whole)


def pair_handles() -> list[Line2D]:
    """Legend entries for colours, solid lines and dashed lines."""
    return [
        *(Line2D([], [], color=COLOURS[axis], linewidth=LINE, label=axis) for axis in AXES[LINEAR]),
        Line2D([], [], color=GREY, linewidth=LINE, alpha=0.6, label="with nominal control"),
        Line2D([], [], color=GREY, linewidth=LINE, linestyle="dashed", label="without"),
    ]


def level(ax: Axes, t: np.ndarray, value: float, name: str, look: dict[str, Any], of: str = "") -> None:
    """Draw a horizontal line over the time of a run; ``of`` says in the legend whose it is."""
    ax.plot(t[[0, -1]], [value, value], label=MEANINGS.get(name, name) + of, gid=name, **look)


def states_of(trace: Trace) -> Sequence[Signal]:
    """Signals of the states of all stages; empty if none has a state."""
    names, scenario = set[str](), trace.header.scenario
    for table, source in trace.header.sources.items():
        names |= {scenario.recorded_name(table, name) for name in source.states}
    return [signal for signal in trace.signals if signal.name in names]


_TALLER = 0.3
"""Additional height of a panel per inset, in heights of a panel."""
_MOST_OF_A_RUN = 0.4
"""Impacts that take a larger fraction of a run are readable without an inset."""


def force(trace: Trace) -> Panel:
    """Panel of the force with which the vehicle of one run pushes on the wall."""
    look = {"label": _of_push([trace]), "color": COLOURS["force"], "linewidth": LINE}
    return forces({"": trace}, {"": look})


def _of_push(traces: Iterable[Trace]) -> str:
    """The name of the push: of several contacts, or one with friction, the sum of their normal forces, which is not the
    size of the contact force."""
    return "pushing force" if any("f_normal" in each.arrays for each in traces) else "contact force"


def forces(traces: Mapping[str, Trace], looks: Mapping[str, Mapping[str, Any]]) -> Panel:
    """Panel of the forces with which vehicles push on the wall, and of the expected forces at rest.

    Insets show the impacts, from the first contact to the end of the rebounds, and the force at rest. ``looks`` are
    colour, dashes and label of each trace.
    """

    levels = _levels(traces, looks)

    def draw(ax: Axes) -> None:
        _pushes(ax, traces, looks)
        _expected(ax, traces, levels)
        ax.set_ylim(bottom=min(0.0, -0.03 * ax.get_ylim()[1]))

    sizes = [_peak(trace) for trace in traces.values()]
    insets = (*_impacts(traces, looks), *_at_rest(traces, looks, levels))
    height = 1.0 + _TALLER * len(insets)
    return Panel(_of_push(traces.values()), "N", draw, 1.0, insets, height, linear_within(sizes, sizes))


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


@dataclass(frozen=True)
class _Level:
    """A force that runs expect: its name, its value [N], the runs, its dashes, and whose it is in the legend."""

    name: str
    force: float
    runs: list[str]
    dashes: tuple[float, ...]
    of: str


def _levels(traces: Mapping[str, Trace], looks: Mapping[str, Mapping[str, Any]]) -> list[_Level]:
    """The expected forces of all runs, each once. Where runs expect different forces, the legend says whose each is,
    and the n-th has its dashes in groups of n."""
    found: dict[str, dict[float, list[str]]] = {name: {} for name in LEVELS}
    for label, trace in traces.items():
        for name, force in expected_forces(trace):
            same = next((other for other in found[name] if math.isclose(force, other, rel_tol=_SAME)), force)
            found[name].setdefault(same, []).append(label)
    levels = list[_Level]()
    for name, forces in found.items():
        on, off = _DASHES[name]
        for i, (force, runs) in enumerate(forces.items()):
            alone = len(forces) == 1
            dashes = (on, off) if alone else (on, off) * i + (on, 4.0 * off)
            of = "" if alone else _of([str(looks[label]["label"]) for label in runs])
            levels.append(_Level(name, force, runs, dashes, of))
    return levels


def _expected(ax: Axes, traces: Mapping[str, Trace], levels: Sequence[_Level]) -> list[float]:
    """Draw the expected forces of some runs; return their values [N]."""
    span = np.array([min(trace.t[0] for trace in traces.values()), max(trace.t[-1] for trace in traces.values())])
    own = [each for each in levels if not traces.keys().isdisjoint(each.runs)]
    for each in own:
        level(ax, span, each.force, each.name, LEVELS[each.name] | {"linestyle": (0.0, each.dashes)}, each.of)
    return [each.force for each in own]


_SAME = 1e-6
"""Relative difference of two forces that no figure shows."""


def _of(owners: Sequence[str]) -> str:
    """Whose a force is."""
    names = list(dict.fromkeys(owners))
    more = f", {len(names) - _MOST_OWNERS} more" if len(names) > _MOST_OWNERS else ""
    return f" ({', '.join(names[:_MOST_OWNERS])}{more})"


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


def _at_rest(
    traces: Mapping[str, Trace], looks: Mapping[str, Mapping[str, Any]], levels: Sequence[_Level]
) -> tuple[Inset, ...]:
    """Inset of the second half of the time after first contact, for runs that press all that time, if peaks are much
    larger, and rebounds have long ended."""
    pushes = {label: trace.band("push")[1] for label, trace in traces.items()}
    touched = {label: trace for label, trace in traces.items() if pushes[label].any()}
    if not touched:
        return ()
    start = max(0.5 * float(trace.t[np.argmax(pushes[label] > 0.0)] + trace.t[-1]) for label, trace in touched.items())
    end = max(float(trace.t[-1]) for trace in touched.values())
    late = {label: [edge[trace.t >= start] for edge in trace.band("push")] for label, trace in touched.items()}
    resting = {label: trace for label, trace in touched.items() if (late[label][0] > 0.0).all()}
    highest = max((largest(late[label][1]) for label in resting), default=0.0)
    if not resting or 2.0 * highest > max(_peak(trace) for trace in traces.values()):
        return ()
    bounced = [time for trace in resting.values() if (time := rebounding(trace.t, *trace.band("push")))]
    if any(start < last + (last - first) for first, last in bounced):
        return ()

    def draw(ax: Axes, _: float) -> None:
        seen = [*_pushes(ax, resting, looks, (start, end)), *_expected(ax, resting, levels)]
        margin = max(0.2 * (max(seen) - min(seen)), 0.005 * max(seen))
        ax.set(xlim=(start, end), ylim=(min(seen) - margin, max(seen) + margin))

    lows = (trace.band("push")[0][trace.t >= start] for trace in resting.values())
    stays = all((low > 0.0).all() for low in lows)
    return (Inset(draw, "at rest" if stays else "at the end", height=0.24),)


_NEAR = 0.4
"""Fraction of a motor's limit from which the limit is drawn; a limit far away would make the lines flat."""
LIMIT: dict[str, Any] = {"linestyle": (0, (1, 1.5)), "linewidth": 0.8, "zorder": 1.9}
"""Line style of a motor's limit, in the colour of its joint."""
_NAMES = {"q": "joint position q", "tau_q": "joint torque τ"}
SIGNALS = (*_NAMES, "manipulability")
"""Signals of an arm that are drawn for several runs."""


def joint_panels(trace: Trace) -> list[Panel]:
    """All panels of the arm whose signals are recorded; none for a rigid vehicle."""
    found = [panel for name in _NAMES if name in trace.arrays for panel in of_joints(trace, name)]
    return [*found, *tool_panels(trace)] if trace.header.geometry.links else []


def tool_panels(trace: Trace) -> list[Panel]:
    """The force on the tool by its components in W, and the manipulability, as far as they are recorded."""
    found = []
    if "p_WT" in trace.arrays:
        found.append(_force(trace))
    if "manipulability" in trace.arrays:
        found.append(_manipulability(trace))
    return found


def of_joints(trace: Trace, name: str) -> list[Panel]:
    """A signal of the joints: one panel for hinges and one for slides, because their units differ."""
    units = trace.header.units(trace.header.by_name[name])
    numbered = sorted(range(len(units)), key=lambda i: units[i] != units[0])
    groups = itertools.groupby(numbered, key=lambda i: units[i])
    return [_lines(trace, name, unit, list(joints)) for unit, joints in groups]


def _lines(trace: Trace, name: str, unit: str, joints: Sequence[int]) -> Panel:
    """Lines of some joints, with the limits of their motors."""
    links = trace.header.geometry.links

    def draw(ax: Axes) -> None:
        for k, i in enumerate(joints):
            look = {"color": JOINTS[i % len(JOINTS)], "label": links[i].joint, **stripe(k, len(joints))}
            samples(ax, trace, name, i, slice(None), f"{name}.{links[i].joint}", **look)
            limit = links[i].effort
            if name == "tau_q" and limit and largest([edge[:, i] for edge in trace.band(name)]) > _NEAR * limit:
                for edge in (-limit, limit):
                    level(ax, trace.t, edge, "motor limit", {**LIMIT, "color": look["color"]})

    return Panel(_NAMES.get(name, name), unit, draw, largest([edge[:, joints] for edge in trace.band(name)]))


def _force(trace: Trace) -> Panel:
    force = trace.f_contact_W

    def draw(ax: Axes) -> None:
        for i, axis in enumerate(AXES[LINEAR]):
            line(ax, trace.t, force[:, i], f"f_contact_W.{axis}", label=axis, color=COLOURS[axis], **stripe(i, 3))

    return Panel("force on the tool, W", "N", draw, largest(force))


def _manipulability(trace: Trace) -> Panel:
    values = trace.manipulability

    def draw(ax: Axes) -> None:
        line(ax, trace.t, values, "manipulability", color=GREY)
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        ax.set_ylim(min(0.0, low), 1.1 * max(high, 1e-300))

    return Panel("manipulability", trace.header.by_name["manipulability"].unit, draw, largest(values))
