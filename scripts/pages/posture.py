"""Draw docs/posture.png: a vehicle that holds its tool and changes its posture, in two orders of priority.

    python scripts/pages/posture.py

The vehicle is the teaching vehicle planar_arm.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.analysis.setup import set_up
from uvms_mj.physics.frames import rotation_matrix

OUT = Path(__file__).parents[2] / "docs" / "posture.png"
INK, BLUE, RED, GREY = "#1f2933", "#0b5cad", "#d02a1e", "#9aa5b1"
PITCH_DEG, JOINTS, WANTED = 12.0, (0.6, 0.9), (0.2, 1.4)
ORDERS = (("attitude", "joints"), ("joints",))
BASE = {
    "vehicle.model": "planar_arm",
    "task.frame": "tool",
    "wall.present": False,
    "current.speed": 0.0,
    "initial.attitude_deg": [0.0, PITCH_DEG, 0.0],
    "initial.joints": list(JOINTS),
    "posture.attitude_deg": [0.0, 0.0, 0.0],
    "posture.joints": list(WANTED),
    "simulation.timestep": 5e-4,
    "posture.period": 5e-4,
    "simulation.duration": 5.0,
}


def held(order: tuple[str, ...]) -> Trace:
    """A run whose tool holds its initial pose."""
    initial = set_up(Scenario.load("push_wall", BASE)).initial
    target = {"reference.target": initial.position, "reference.attitude_deg": initial.attitude_deg}
    return simulate(Scenario.load("push_wall", BASE | target | {"posture.order": list(order)}, "impedance"))


def main() -> None:
    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    pitch, joints, tool = figure.subplots(1, 3)
    for order, colour in zip(ORDERS, (BLUE, RED), strict=True):
        trace, label = held(order), ", ".join(order)
        pitch.plot(trace.t, np.degrees(-np.arcsin(rotation_matrix(trace.quat_WB)[:, 2, 0])), color=colour, label=label)
        for k, style in enumerate(("-", "--")):
            joints.plot(trace.t, trace.q[:, k], style, color=colour)
        tool.plot(trace.t, 1e3 * np.linalg.norm(trace.eta_e[:, :3], axis=1), color=colour)
    t = np.linspace(0.0, 5.0, 30)
    closed = (1.0 + 2.0 * t) * np.exp(-2.0 * t)
    pitch.plot(t, PITCH_DEG * closed, ".", color=INK, ms=3, label="closed form")
    for q_0, q_d in zip(JOINTS, WANTED, strict=True):
        joints.plot(t, q_d + (q_0 - q_d) * closed, ".", color=INK, ms=3)
    for axes, title in ((pitch, "pitch of the base [deg]"), (joints, "joints [rad]"), (tool, "tool's error [mm]")):
        axes.set_title(title, fontsize=9, color=INK, loc="left")
        axes.set_xlabel("t [s]", fontsize=8)
        axes.tick_params(labelsize=8)
        axes.axhline(0.0, color=GREY, lw=0.6, zorder=0)
        axes.spines[["top", "right"]].set_visible(False)
    pitch.legend(fontsize=7, frameon=False, title="posture.order", title_fontsize=7)
    figure.savefig(OUT, dpi=110)


if __name__ == "__main__":
    main()
