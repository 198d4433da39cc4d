"""Draw docs/tool_push.png: the vehicle at the start and at rest, and the push of three laws with their closed forms.

python scripts/pages/tool_push.py
"""

import os
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "disable")  # the picture needs no driver

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.analysis.setup import set_up
from uvms_mj.control.rest import SteadyState
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.physics.statics import Statics

OUT = Path(__file__).parents[2] / "docs" / "tool_push.png"
INK, BLUE, RED, GREY, GREEN = "#1f2933", "#0b5cad", "#d02a1e", "#9aa5b1", "#3a7d34"
LAWS = {"gsta": BLUE, "fosm": GREEN, "impedance": RED}
BLOCK = np.array([[-0.25, -0.15], [0.25, -0.15], [0.25, 0.15], [-0.25, 0.15]])
"""Corners of the base in x and z of B [m]."""


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
    traces = {
        law: simulate(
            Scenario.load("tool_push", {"controller.epsilon": 3e-3} if law == "fosm" else {}, law), log_rate=100
        )
        for law in LAWS
    }
    figure = Figure(figsize=(9.6, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.15])
    trace = traces["gsta"]
    side_view(left, trace, 0, GREY, "start")
    side_view(left, trace, -1, BLUE, "rest")
    face = trace.scenario.wall.position + trace.header.probe_radius
    left.add_patch(Rectangle((face, -0.3), 0.08, 1.0, color=GREY, alpha=0.5, linewidth=0))
    left.set(xlim=(-0.35, face + 0.08), ylim=(-0.22, 0.62), xlabel="x [m]", ylabel="z [m]", aspect="equal")
    left.legend(loc="upper left", bbox_to_anchor=(0.52, 0.98), frameon=False)
    left.set_title("planar_arm, seen from the side", fontsize=10, color=INK)
    for law, colour in LAWS.items():
        t, state = traces[law].t, traces[law].analytic
        right.plot(t, traces[law].push, color=colour, label=law)
        assert isinstance(state, SteadyState)
        right.axhline(state.force, color=colour, linestyle=":", linewidth=1.4)
    right.set(xlim=(4.0, 20.0), ylim=(1.0, 2.4), xlabel="time [s]", ylabel="push of the tool [N]")
    right.set_title("dotted: closed form of each law", fontsize=10, color=INK)
    right.legend(loc="lower right", frameon=False, ncols=3)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(OUT, dpi=110)


if __name__ == "__main__":
    main()
