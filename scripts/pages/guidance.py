"""docs/physics/guidance.md: the shipped references, and runs that follow two of them."""

import functools
from collections.abc import Iterator

import matplotlib.pyplot as plt
import numpy as np

from page_look import written
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.views.figures.style import BLACK, COLOURS, PAGE_IN, line, styled

RUN = COLOURS["z"]


@functools.cache
def run(name: str) -> Trace:
    return simulate(Scenario.load(name), log_rate=200, engine="free_body")


def triads(axes: plt.Axes, p: np.ndarray, quat: np.ndarray) -> None:
    """The body's axes at some instants."""
    for position, R in zip(p, rotation_matrix(quat), strict=True):
        for i, colour in enumerate((COLOURS["force"], COLOURS["y"], COLOURS["x"])):
            axes.plot(*np.stack([position, position + 0.15 * R[:, i]]).T, color=colour, linewidth=1.2)


def numbers() -> Iterator[tuple]:
    wall = run("wipe_wall")
    way = wall.push[(wall.t > 20.0) & (wall.t < 28.0)]
    yield "{} N on the way, {} N at the end, as in closed form", way.mean(), wall.push[-1]
    path = run("follow_path")
    speed = np.linalg.norm(path.p_d_dot, axis=1)[(path.t > 4.5) & (path.t < 11.0)]
    yield "constant within {}", np.abs(speed - 0.2).max()


def main() -> None:
    with styled():
        figure = plt.figure(figsize=(PAGE_IN, 4.6))
        grid = figure.add_gridspec(2, 1, height_ratios=(1.0, 0.9))
        above, below = grid[0].subgridspec(2, 2), grid[1].subgridspec(1, 2)
        space = figure.add_subplot(above[:, 0], projection="3d")
        trace = run("follow_path")
        space.plot(*trace.p_WB.T, color=RUN, linewidth=3.0, alpha=0.7)
        space.plot(*trace.p_d.T, color=BLACK)
        triads(space, trace.p_d[::500], trace.quat_d[::500])
        poses = np.array([pose.position for pose in getattr(trace.scenario.reference, "poses", ())])
        space.plot(*poses.T, "o", color=BLACK, markersize=4)
        space.set(xlabel="x [m]", ylabel="y [m]", title="path: follow_path (z up)")
        for axis in (space.xaxis, space.yaxis, space.zaxis):
            axis.set_pane_color((1.0, 1.0, 1.0, 1.0))
        space.set_box_aspect((1.7, 1.8, 0.8), zoom=1.0)
        space.set_zticks([0.0, 0.2, 0.4])
        space.locator_params(axis="x", nbins=4)
        space.locator_params(axis="y", nbins=4)
        speed, error = figure.add_subplot(above[0, 1]), figure.add_subplot(above[1, 1])
        line(speed, trace.t, np.linalg.norm(trace.p_d_dot, axis=1), "speed", color=BLACK)
        speed.set(title="speed of the reference [m/s], with a stop", xlim=(0.0, trace.t[-1]), ylim=(-0.02, 0.24))
        position, attitude = (np.linalg.norm(trace.eta_e[:, part], axis=1) for part in (slice(0, 3), slice(3, 6)))
        line(error, trace.t, 1e3 * position, "position", color=COLOURS["x"], label="position [mm]")
        line(error, trace.t, 2e3 * attitude, "attitude", color=COLOURS["force"], label="attitude [mrad]")
        error.set(title="error of GSTA", xlabel="time [s]", yscale="log", xlim=(0.0, trace.t[-1]), ylim=(1e-4, 20.0))
        error.legend(loc="upper right", ncols=2)
        wall = run("wipe_wall")
        plane, push = figure.add_subplot(below[0]), figure.add_subplot(below[1])
        plane.plot(*wall.p_WB[:, 1:].T, color=RUN, linewidth=3.0, alpha=0.7, label="run")
        plane.plot(*wall.p_d[:, 1:].T, color=BLACK, label="reference")
        plane.set(xlabel="y [m]", ylabel="z [m]", title="along_wall: wipe_wall", aspect="equal")
        plane.margins(0.08)
        plane.legend(loc="upper left")
        line(push, wall.t, wall.push, "push", color=RUN, label="push [N]")
        line(push, wall.t, -wall.F_d[:, 0], "F_d", color=BLACK, label="$-F_{d,x}$ [N], the schedule")
        push.set(title="push of wipe_wall", xlabel="time [s]", xlim=(0.0, wall.t[-1]), ylim=(-0.3, 13.5))
        push.legend(loc="upper right")
        written(figure, "guidance")
