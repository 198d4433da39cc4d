"""Draw docs/guidance.png: the shipped references, and a run that follows one of them.

python scripts/pages/guidance.py
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from uvms_mj import Scenario, simulate
from uvms_mj.physics.frames import rotation_matrix

TARGET = Path(__file__).parents[2] / "docs" / "guidance.png"


def triads(axes, p, quat):
    """The body's axes at some instants."""
    for position, R in zip(p, rotation_matrix(quat), strict=True):
        for i, colour in enumerate(("tab:red", "tab:green", "tab:blue")):
            tip = position + 0.15 * R[:, i]
            axes.plot(*np.stack([position, tip]).T, color=colour, linewidth=1.2)


def run(name, **overrides):
    return simulate(Scenario.load(name, overrides), log_rate=100, engine="free_body")


if __name__ == "__main__":
    figure = plt.figure(figsize=(12.0, 4.6), layout="constrained")
    grid = figure.add_gridspec(2, 3)
    space = figure.add_subplot(grid[:, 0], projection="3d")
    trace = run("follow_path")
    space.plot(*trace.p_d.T, color="black", linewidth=1.0)
    space.plot(*trace.p_WB.T, color="tab:orange", linewidth=2.5, alpha=0.6)
    triads(space, trace.p_d[::250], trace.quat_d[::250])
    poses = np.array([pose.position for pose in trace.scenario.reference.poses])
    space.plot(*poses.T, "o", color="black", markersize=4)
    space.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", title="path: follow_path", box_aspect=(1.7, 1.8, 0.8))
    space.locator_params(nbins=4)
    speed, error = figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])
    speed.plot(trace.t, np.linalg.norm(trace.p_d_dot, axis=1), color="black")
    speed.set(ylabel="speed [m/s]", title="constant speed, a stop, no jumps of acceleration")
    error.plot(trace.t, 1e3 * np.linalg.norm(trace.eta_e[:, :3], axis=1), label="position [mm]")
    error.plot(trace.t, 2e3 * np.linalg.norm(trace.eta_e[:, 3:], axis=1), label="attitude [mrad]")
    error.set(xlabel="t [s]", ylabel="error of GSTA", ylim=(0.0, 0.1))
    error.legend(fontsize=8)
    wall = run("wipe_wall")
    plane, push = figure.add_subplot(grid[0, 2]), figure.add_subplot(grid[1, 2])
    plane.plot(wall.p_d[:, 1], wall.p_d[:, 2], color="black")
    plane.plot(wall.p_WB[:, 1], wall.p_WB[:, 2], color="tab:orange", linewidth=2.5, alpha=0.6)
    plane.set(xlabel="y [m]", ylabel="z [m]", title="along_wall: wipe_wall", aspect="equal")
    push.plot(wall.t, wall.push, color="tab:orange", label="push [N]")
    push.plot(wall.t, -wall.F_d[:, 0], color="black", label="-F_d [N], the schedule")
    push.set(xlabel="t [s]", ylim=(-0.2, 6.0))
    push.legend(fontsize=8, loc="upper left")
    for each in (speed, error, plane, push):
        each.grid(alpha=0.3, linewidth=0.4)
    figure.savefig(TARGET, dpi=78)
