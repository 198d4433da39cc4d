"""What stands in one panel: position, contact force, sliding variable, actuation force, a law's own states."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.lines import Line2D
from matplotlib.ticker import ScalarFormatter
from numpy.typing import ArrayLike

from ..closed_forms import SteadyState, demanded_force
from ..signals import OWN_UNIT, Signal
from ..trace import Trace
from .lines import Inset, line
from .style import BLACK, COLOURS, GREY, WIDTHS

AXES = ("x", "y", "z")
SWITCHING_S = 0.01
"""How much of a run's beginning the insets of tau show [s]: the first-order law's chatter dies out in it."""
REACHING_S = 0.1
"""How much of a run's beginning the insets of s show [s]: the super-twisting law brings s to zero in it."""
MOST_LINES = 6
"""A state of more numbers than this is drawn as the range that they are in."""
_REFERENCE: dict[str, Any] = {"color": BLACK, "linestyle": "dashed", "linewidth": 0.8, "zorder": 4}
_EXPECTED: dict[str, Any] = _REFERENCE | {"linestyle": (0, (9, 3))}
_ANALYTIC: dict[str, Any] = {"color": BLACK, "linestyle": "dotted", "linewidth": 1.1, "zorder": 5}
_WALL: dict[str, Any] = {"color": GREY, "linestyle": "dashdot", "linewidth": 0.9, "zorder": 1.5}
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


@dataclass(frozen=True)
class Panel:
    """One panel, before there are axes for it; panels of the same quantity get the same range of y and prefix.

    Attributes:
        quantity: what y is.
        unit: of y; empty where there is none to name.
        draw: draws the lines, in SI.
        largest: value that y is to be numbered for; 1, no prefix, where not given.
        inset: a part of it, larger.
    """

    quantity: str
    unit: str
    draw: Callable[[Axes], None]
    largest: float = 1.0
    inset: Inset | None = None

    def label(self, prefix: str) -> str:
        """Of y."""
        return f"{self.quantity} [{prefix}{self.unit}]" if self.unit else self.quantity


# Position


def position(trace: Trace) -> Panel:
    """Position in W, reference and wall; near the wall in an inset, where the run ends there."""
    reach = np.concatenate([trace.p_WB, trace.p_d])

    def draw(ax: Axes) -> None:
        for i, axis in enumerate(AXES):
            line(ax, trace.t, trace.p_WB[:, i], f"p_WB.{axis}", label=axis, **_solid(axis))
        for i, axis in enumerate(AXES):
            line(ax, trace.t, trace.p_d[:, i], f"p_d.{axis}", label="reference", **_REFERENCE)
        x_c, span = trace.scenario.wall.position, float(np.ptp(reach))
        if reach.min() - 0.1 * span <= x_c <= reach.max() + 0.1 * span:
            _level(ax, trace, x_c, "wall", _WALL)

    return Panel("position", "m", draw, largest(reach), _near_wall(trace))


def _near_wall(trace: Trace) -> Inset | None:
    """Where a run ends close to the wall: position and reference there, from the first sample within the limits."""
    x_c, x, x_d = trace.scenario.wall.position, trace.p_WB[:, 0], trace.p_d[:, 0]
    depth = max(abs(float(x_d[-1]) - x_c), 2e-3)
    low, high = x_c - 0.9 * depth, x_c + 1.3 * depth
    if not low < x[-1] < high or np.ptp(x) < 5.0 * depth:
        return None
    first = int(np.argmax(x > low))

    def draw(ax: Axes, power: float) -> None:
        rest = slice(first, None)
        line(ax, trace.t[rest], x[rest], "p_WB.x", **_solid("x"))
        line(ax, trace.t[rest], x_d[rest], "p_d.x", **_REFERENCE)
        _level(ax, trace, x_c, "wall", _WALL)
        ax.set(xlim=(trace.t[first], trace.t[-1]), ylim=(low, high))
        number(ax.yaxis, power)

    return Inset(draw, "x at the wall")


# Contact force


def force(trace: Trace) -> Panel:
    """Force with which the vehicle pushes on the wall, and where it should come to rest; the rest in an inset."""

    def draw(ax: Axes) -> None:
        line(ax, trace.t, trace.push, "push", label="contact force", color=COLOURS["force"], linewidth=1.0)
        _expectations(ax, trace)
        ax.set_ylim(bottom=min(0.0, -0.03 * ax.get_ylim()[1]))

    return Panel("contact force", "N", draw, inset=_at_rest(trace))


def _expectations(ax: Axes, trace: Trace) -> list[float]:
    levels = []
    expected = demanded_force(trace.scenario, math.inf)  # what the paper expects: of a wall that does not give
    if 0.0 < expected < math.inf:
        _level(ax, trace, expected, "expected", _EXPECTED)
        levels.append(expected)
    if isinstance(trace.analytic, SteadyState) and trace.analytic.force > 0.0:
        _level(ax, trace, trace.analytic.force, "analytic", _ANALYTIC)
        levels.append(trace.analytic.force)
    return levels


def _at_rest(trace: Trace) -> Inset | None:
    """The second half of what follows the first contact, where peaks before it are much larger."""
    push = trace.push
    touched = np.flatnonzero(push > 0.0)
    if not len(touched):
        return None
    start = (touched[0] + len(push)) // 2
    rest = push[start:]
    if len(rest) < 2 or not 0.0 < 2.0 * rest.max() < push.max():
        return None

    def draw(ax: Axes, _: float) -> None:
        line(ax, trace.t[start:], rest, "push", color=COLOURS["force"], linewidth=2.0)
        seen = [float(rest.min()), float(rest.max()), *_expectations(ax, trace)]
        margin = max(0.25 * (max(seen) - min(seen)), 0.005 * max(seen))
        ax.set(xlim=(trace.t[start], trace.t[-1]), ylim=(min(seen) - margin, max(seen) + margin))

    return Inset(draw, "at rest")


# Components: sliding variable, actuation force, integral term


def sliding(trace: Trace) -> Panel:
    """Linear part of the sliding variable; its beginning in an inset, where what follows is much smaller."""
    size = np.abs(trace.s[:, :3]).max(axis=1)
    late = int(np.searchsorted(trace.t, REACHING_S))

    def draw(ax: Axes) -> None:
        components(ax, trace, "s")

    def beginning(ax: Axes, power: float) -> None:
        components(ax, trace, "s", REACHING_S)
        ax.margins(y=0.08)
        ax.set_xlim(0.0, REACHING_S)
        number(ax.yaxis, power)
        number(ax.xaxis, 1e-3)

    reaches = 2 < late < len(size) / 4 and size[:late].max() > 5.0 * size[late:].max()
    inset = Inset(beginning, "first 100 ms", height=0.38) if reaches else None
    return Panel("sliding variable s", "m/s", draw, largest(size), inset)


def tau(trace: Trace, fine: Trace | None, other: Trace | None = None, other_fine: Trace | None = None) -> Panel:
    """Force part of tau, with its beginning at every step in an inset where ``fine`` has it; ``other`` dashed."""
    inset = Inset(lambda ax, power: _transient(ax, fine, other_fine, power), "first 10 ms", 0.38) if fine else None
    return Panel("actuation force τ", "N", lambda ax: pair(ax, trace, other, "tau"), largest(trace.tau[:, :3]), inset)


def _transient(ax: Axes, fine: Trace, other: Trace | None, power: float) -> None:
    pair(ax, fine, other, "tau", SWITCHING_S)
    ax.margins(y=0.08)
    ax.set_xlim(0.0, SWITCHING_S)
    number(ax.yaxis, power)
    number(ax.xaxis, 1e-3)


def integral(trace: Trace, other: Trace | None = None) -> Panel:
    """Force part of the integral term of a super-twisting law; ``other`` dashed."""
    return Panel("integral term z", "m/s²", lambda ax: pair(ax, trace, other, "z"), largest(trace.z[:, :3]))


def state(trace: Trace, signal: Signal) -> Panel:
    """A state of a law of the user's own: its numbers, or where they are many, the range that they are in."""
    values = trace[signal.name].reshape(len(trace), signal.size)
    colours = [COLOURS[name] for name in ("x", "y", "z", "roll", "pitch", "yaw")]

    def draw(ax: Axes) -> None:
        if signal.size > MOST_LINES:
            label = f"range of the {signal.size} numbers of {signal.name}"
            for edge, text in ((values.min(axis=1), label), (values.max(axis=1), None)):
                line(ax, trace.t, edge, f"{signal.name}.range", color=GREY, label=text)
            return
        for i, component in enumerate(signal.components):
            name = f"{signal.name}.{component}" if component else signal.name
            look = {"color": colours[i], "linewidth": 0.9 + 0.4 * i, "zorder": 2.6 - 0.1 * i}
            line(ax, trace.t, values[:, i], name, label=component or signal.name, **look)

    unit = "" if signal.unit == OWN_UNIT else signal.unit.replace("^2", "²").replace("^3", "³")
    return Panel(f"state {signal.name}", unit, draw)


def components(
    ax: Axes, trace: Trace, name: str, until: float = np.inf, dashed: bool = False, under: bool = False
) -> None:
    """x, y and z of a signal. ``under``: wider and paler, for dashed lines to be seen on."""
    n = int(np.searchsorted(trace.t, until + 1e-9, side="right"))
    for i, axis in enumerate(AXES):
        look = _solid(axis)
        if dashed:
            look |= {"linestyle": "dashed", "linewidth": 1.0, "zorder": look["zorder"] + 0.5}
        elif under:
            look |= {"linewidth": 2.2, "alpha": 0.45}
        label = None if dashed else axis
        line(ax, trace.t[:n], trace[name][:n, i], f"{name}.{axis}", label=label, **look)


def pair(ax: Axes, trace: Trace, other: Trace | None, name: str, until: float = np.inf) -> None:
    """x, y and z of a signal solid, and of another trace dashed on them."""
    components(ax, trace, name, until, under=other is not None)
    if other is not None:
        components(ax, other, name, until, dashed=True)


def pair_handles() -> list[Line2D]:
    """What colours, solid and dashed mean, for a legend."""
    return [
        *(Line2D([], [], color=COLOURS[axis], label=axis) for axis in AXES),
        Line2D([], [], color=GREY, linewidth=2.2, alpha=0.6, label="with nominal control"),
        Line2D([], [], color=GREY, linewidth=1.0, linestyle="dashed", label="without"),
    ]


def _solid(axis: str) -> dict[str, Any]:
    return {"color": COLOURS[axis], "linewidth": WIDTHS[axis], "zorder": 2.3 - 0.1 * AXES.index(axis)}


def _level(ax: Axes, trace: Trace, level: float, label: str, look: dict[str, Any]) -> None:
    ax.plot(trace.t[[0, -1]], [level, level], label=label, gid=label, **look)


def largest(values: ArrayLike) -> float:
    """The largest size of numbers."""
    return float(np.abs(values).max(initial=0.0))


def prefix_of(largest: float) -> tuple[float, str]:
    """The SI prefix that a signal is best read in whose largest size is this."""
    return next(((power, prefix) for power, prefix in _PREFIXES if largest >= 0.05 * power), _PREFIXES[0])


def number(axis: Axis, power: float) -> None:
    """Number an axis in multiples of ``power``; the data stay in SI."""
    if power != 1.0:
        axis.set_major_formatter(_Multiples(power))


class _Multiples(ScalarFormatter):
    def __init__(self, power: float) -> None:
        super().__init__(useOffset=False)
        self.set_scientific(False)
        self.power = power

    def set_locs(self, locs: Iterable[float]) -> None:
        super().set_locs([value / self.power for value in locs])

    def __call__(self, x: float, pos: int | None = None) -> str:
        return super().__call__(x / self.power, pos)


def states_of(trace: Trace) -> Sequence[Panel]:
    """Panels of the law's states; none for a law that has none."""
    if trace.header.law.source in ("gsta", "sta"):
        return [integral(trace)]
    names = trace.header.law.states
    return [state(trace, signal) for signal in trace.signals if signal.name in names]
