"""docs/physics/tool_push.md: the vehicle at the start and at rest, the push of three laws, and currents from all
sides."""

import functools
import os
import warnings
from collections.abc import Iterator

os.environ.setdefault("MUJOCO_GL", "disable")  # the picture needs no driver

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Rectangle

from page_look import written
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.control.base import SteadyState
from uvms_mj.control.design import demanded_force
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.physics.statics import Statics
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import SamplingWarning
from uvms_mj.views.figures.style import COLOURS, GREY, PAGE_IN, line, styled

LAWS = {"gsta": COLOURS["x"], "fosm": COLOURS["z"], "impedance": COLOURS["roll"]}
BLOCK = np.array([[-0.25, -0.15], [0.25, -0.15], [0.25, 0.15], [-0.25, 0.15]])
"""Corners of the base in x and z of B [m]."""
REST = 1e-6
"""Difference from the demanded force up to which a run rests there [N]."""
SPEED, COARSE = 0.5, 4e-4
"""Speed of the currents [m/s], and time step of their runs [s]: a rest does not depend on it."""
ROUND, SPREAD = 24, 12
"""Number of directions of the current in the horizontal plane, and of directions that are spread over the sphere."""
ARMS: dict[str, list[tuple[float, ...]]] = {
    "planar_arm": [(-0.698, 1.309), (-0.2, 0.811), (-1.2, 1.811)],
    "bluerov2_alpha5": [(0.0, 0.5, 1.461, 0.0), (0.0, 1.0, 1.961, 0.0), (0.0, 1.5, 2.461, 0.0)],
}
"""Joints at the start [rad], with the tool 35 deg down as at rest."""


def in_plane(n: int) -> np.ndarray:
    """n directions (n, 3) in the horizontal plane."""
    angles = 2.0 * np.pi * np.arange(n) / n
    return np.array([np.cos(angles), np.sin(angles), np.zeros(n)]).T


def on_sphere(n: int) -> np.ndarray:
    """n directions (n, 3) spread over the sphere, by the golden angle."""
    z, angles = 1.0 - (2.0 * np.arange(n) + 1.0) / n, np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n)
    return np.array([np.sqrt(1.0 - z * z) * np.cos(angles), np.sqrt(1.0 - z * z) * np.sin(angles), z]).T


def pushed(model: str, joints: tuple[float, ...], direction: np.ndarray) -> Trace:
    """A run of tool_push in a current of 0.5 m/s along a direction (3,). The gears are without Coulomb friction."""
    x, y, z = (SPEED * direction).tolist()
    current = {"speed": float(np.hypot(x, y)), "direction_deg": float(np.degrees(np.arctan2(y, x))), "vertical": z}
    overrides = {f"current.{key}": value for key, value in current.items()} | {
        "vehicle.model": model,
        "vehicle.coulomb_friction": 0.0,
        "initial.joints": list(joints),
        "simulation.timestep": COARSE,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SamplingWarning)
        return simulate(Scenario.load("tool_push", overrides), log_rate=10)


@functools.cache
def all_round(model: str, joints: tuple[float, ...], n: int, spread: bool = False) -> tuple[float, ...]:
    """Of currents from n directions: the number of runs that rest within 1e-6 N of the demanded force, the most
    touches, the largest peak [N], the longest time that a thruster was at its limit [s], and the largest difference
    from the demanded force at the end [N]."""
    found = []
    for direction in on_sphere(n) if spread else in_plane(n):
        trace = pushed(model, joints, direction)
        force, settled = final_force(trace)
        off = abs(force - demanded_force(trace.scenario)) if force and settled else np.inf
        found.append(
            (trace.touches[-1], trace.force_peak[-1], trace.saturation_time[-1], off, 0.0 if trace.notes else off)
        )
    touches, peaks, times, off, silent = np.array(found).T
    assert silent.max() < REST, "a run that does not rest there has a warning"
    return (off < REST).sum(), touches.max(), peaks.max(), times.max(), off.max()


@functools.cache
def run(law: str) -> Trace:
    """tool_push under a law."""
    settings = {"fosm": {"controller.epsilon": 3e-3}, "impedance": {"simulation.duration": 40.0}}
    return simulate(Scenario.load("tool_push", settings.get(law, {}), law), log_rate=100)


def numbers() -> Iterator[tuple]:
    yield from of_law("gsta", "`tool_push`, GSTA | {} N | {} N")


def of_law(law: str, words: str) -> Iterator[tuple]:
    state = run(law).analytic
    assert isinstance(state, SteadyState)
    yield words, state.force, final_force(run(law))[0]


def of_posture(model: str, joints: tuple[float, ...]) -> Iterator[tuple]:
    *values, _ = all_round(model, joints, ROUND)
    yield f"`{model}`, {list(joints)} | {{}} of {ROUND} | {{}} | {{}} N | {{}} s |", *values


def long_numbers() -> Iterator[tuple]:
    yield from of_law("fosm", r"first order, $\epsilon$ = 3e-3 | {} N | {} N")
    yield from of_law("impedance", "impedance, after 40 s | {} N | {} N")
    for model, postures in ARMS.items():
        for joints in postures:
            yield from of_posture(model, joints)
    worst = max(all_round(model, joints, ROUND)[-1] for model, postures in ARMS.items() for joints in postures)
    yield "the push is within {} N after 20 s", worst
    ends = all_round("planar_arm", ARMS["planar_arm"][0], SPREAD, spread=True)
    yield "over the sphere, it does in {} of 12", ends[0]


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
        figure, (left, right) = plt.subplots(
            1, 2, figsize=(PAGE_IN, 2.9), layout="constrained", width_ratios=[1.0, 1.1]
        )
        trace = run("gsta")
        side_view(left, trace, 0, GREY, "start")
        side_view(left, trace, -1, COLOURS["x"], "rest")
        face = trace.scenario.wall.position + trace.header.probe_radius
        left.add_patch(Rectangle((face, -0.3), 0.08, 1.0, color=GREY, alpha=0.5, linewidth=0))
        left.set(xlim=(-0.35, face + 0.08), ylim=(-0.22, 0.62), xlabel="x [m]", ylabel="z [m]", aspect="equal")
        left.legend(loc="upper left", bbox_to_anchor=(0.52, 0.98))
        left.set_title("planar_arm, seen from the side")
        for law, colour in LAWS.items():
            trace = run(law)
            shown = trace.t <= 20.0
            line(right, trace.t[shown], trace.push[shown], law, color=colour, lw=1.2, label=law)
            assert isinstance(trace.analytic, SteadyState)
            right.axhline(trace.analytic.force, color=colour, linestyle=":", linewidth=1.2)
        right.set(xlim=(4.0, 20.0), ylim=(1.0, 2.4), xlabel="time [s]", ylabel="push of the tool [N]")
        right.set_title("dotted: closed form of each law")
        right.legend(loc="lower right", ncols=3)
        written(figure, "tool_push")


if __name__ == "__main__":
    main()
