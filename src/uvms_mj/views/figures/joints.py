"""Panels of an arm: positions and torques of its joints, the force on its tool, and its manipulability."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...records.trace import Trace
from ...stages.signals import AXES
from .panels import LINEAR, Panel, level, samples
from .scales import largest
from .style import COLOURS, GREY, JOINTS, line, stripe

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
