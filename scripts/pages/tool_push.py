"""docs/tool_push.md: the vehicle at the start and at rest, and the push of three laws with their closed forms."""

import functools
import warnings
from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

from page_look import written
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.analysis.setup import set_up
from uvms_mj.control.rest import SteadyState
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.physics.statics import Statics
from uvms_mj.views.colours import hex_of_runs
from uvms_mj.views.figures.style import COLOURS, GREY, PAGE_IN, line, styled

LAWS = ("gsta", "fosm", "impedance")
BLOCK = np.array([[-0.25, -0.15], [0.25, -0.15], [0.25, 0.15], [-0.25, 0.15]])
"""Corners of the base in x and z of B [m]."""


@functools.cache
def run(law: str, duration: float = 20.0) -> Trace:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        wide = {"controller.epsilon": 3e-3} if law == "fosm" else {}
        return simulate(Scenario.load("tool_push", wide | {"simulation.duration": duration}, law), log_rate=500)


def numbers() -> Iterator[tuple]:
    for words, law, duration in (
        ("| `tool_push`, GSTA | {} N | below {} |", "gsta", 20.0),
        ("| first order, epsilon = 3e-3 | {} N | below {} |", "fosm", 20.0),
        ("| impedance, after 40 s | {} N | below {} |", "impedance", 40.0),
    ):
        trace = run(law, duration)
        assert isinstance(trace.analytic, SteadyState)
        yield words, trace.analytic.force, trace.push[-1] / trace.analytic.force - 1.0


def side_view(axes: Axes, trace: Trace, row: int, colour: str, label: str) -> None:
    """The base, the links and the tool in the x-z plane of W."""
    setup = set_up(trace.scenario)
    tree, p_WB, R_WB = Statics(setup.vehicle, trace.q[row]), trace.p_WB[row], rotation_matrix(trace.quat_WB[row])
    corners = p_WB[[0, 2]] + BLOCK @ R_WB[np.ix_([0, 2], [0, 2])].T
    axes.add_patch(Polygon(corners, closed=True, fill=False, edgecolor=colour, linewidth=1.6, label=label))
    joints = [p_WB + R_WB @ anchor for anchor in tree.anchors] + [trace.p_WT[row]]
    x, z = np.array(joints)[:, [0, 2]].T
    axes.plot(x, z, color=colour, linewidth=3.0, solid_capstyle="round")
    axes.plot(x[:-1], z[:-1], "o", color="white", markeredgecolor=colour, markersize=5)
    axes.add_patch(Circle((x[-1], z[-1]), setup.plant.probe.radius, color=colour))


def main() -> None:
    with styled():
        figure = Figure(figsize=(PAGE_IN, 2.9))
        left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.1])
        trace = run("gsta")
        side_view(left, trace, 0, GREY, "start")
        side_view(left, trace, -1, COLOURS["x"], "rest")
        face = trace.scenario.wall.position + trace.header.probe_radius
        left.add_patch(Rectangle((face, -1.0), 0.08, 3.0, color=GREY, alpha=0.5, linewidth=0))
        left.set(xlim=(-0.35, face + 0.08), xlabel="x [m]", ylabel="z [m]", aspect="equal", ylim=(-0.25, 0.75))
        left.legend(loc="upper left", ncols=2)
        left.set_title("planar_arm, seen from the side")
        for law, colour in zip(LAWS, hex_of_runs(LAWS), strict=True):
            t, state = run(law).t, run(law).analytic
            line(right, t, run(law).push, law, color=colour, label=law)
            assert isinstance(state, SteadyState)
            right.axhline(state.force, color=colour, linestyle=":", linewidth=1.4)
        right.set(xlim=(4.0, 20.0), ylim=(1.0, 2.6), xlabel="time [s]", ylabel="push of the tool [N]")
        right.set_title("dotted: closed form of each law")
        right.legend(loc="upper right", ncols=3)
        written(figure, "tool_push")
