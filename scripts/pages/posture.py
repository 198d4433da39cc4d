"""docs/physics/posture.md: a vehicle that holds its tool and changes its posture, in two orders of priority.

The vehicle is the teaching vehicle planar_arm.
"""

import functools
import warnings
from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from page_look import written
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import SamplingWarning
from uvms_mj.views.figures.style import BLACK, COLOURS, PAGE_IN, line, styled

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
ALPHA = {
    "vehicle.model": "bluerov2_alpha5",
    "task.frame": "tool",
    "wall.present": False,
    "current.speed": 0.0,
    "initial.joints": [0.0, 1.0, 1.961, 0.0],
    "simulation.duration": 8.0,
}


@functools.cache
def held(order: tuple[str, ...], **others: float) -> Trace:
    """A run whose tool holds its initial pose."""
    initial = set_up(Scenario.load("push_wall", BASE)).initial
    target = {"reference.target": initial.position, "reference.attitude_deg": initial.attitude_deg}
    return simulate(Scenario.load("push_wall", BASE | target | {"posture.order": list(order)} | others, "impedance"))


def moved(trace: Trace) -> np.ndarray:
    """Distance of the tool from its target [m]."""
    return np.linalg.norm(trace.eta_e[:, :3], axis=1)


def left_after_a_move(friction: float) -> float:
    """Largest component of eta_e after the tool of the Alpha 5 has moved by 0.3 m, with a share of the Coulomb friction
    of its gears."""
    settings = ALPHA | {"vehicle.coulomb_friction": friction}
    initial = set_up(Scenario.load("push_wall", settings)).initial
    x, y, z = initial.position
    target = {"reference.target": [x + 0.3, y, z], "reference.attitude_deg": initial.attitude_deg}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SamplingWarning)
        trace = simulate(Scenario.load("push_wall", settings | target, "gsta"), log_rate=100)
    return float(np.abs(trace.eta_e[-1]).max())


def numbers() -> Iterator[tuple]:
    yield "the tool moves by {} micrometres at most", 1e6 * max(moved(held(order)).max() for order in ORDERS)
    fine = {"simulation.timestep": 1e-4, "task.inertia_period": 1e-4}
    far = [1e6 * moved(held(ORDERS[0], **fine, **{"posture.period": T})).max() for T in (1e-4, 1e-3, 1e-2)]
    yield "by {} micrometres with 0.1 ms, by {} with the default of 1 ms and by {} with 10 ms", *far
    yield r"a move of 0.3 m under `gsta` leaves $\tilde\eta$ = {} after 8 s", (left_after_a_move(1.0), 0.005)
    yield "without the friction the same move ends within {}", left_after_a_move(0.0)


def main() -> None:
    with styled():
        figure = Figure(figsize=(PAGE_IN, 2.6))
        pitch, joints, tool = figure.subplots(1, 3)
        for order, colour in zip(ORDERS, (COLOURS["x"], COLOURS["force"]), strict=True):
            trace, label = held(order), ", ".join(order)
            tilt = np.degrees(-np.arcsin(rotation_matrix(trace.quat_WB)[:, 2, 0]))
            line(pitch, trace.t, tilt, label, color=colour, label=label)
            for k, style in enumerate(("-", "--")):
                line(joints, trace.t, trace.q[:, k], f"joint {k + 1}", color=colour, linestyle=style)
            line(tool, trace.t, 1e6 * moved(trace), label, color=colour)
        t = np.linspace(0.0, 5.0, 30)
        closed = (1.0 + 2.0 * t) * np.exp(-2.0 * t)
        pitch.plot(t, PITCH_DEG * closed, ".", color=BLACK, ms=3, label="closed form")
        for q_0, q_d in zip(JOINTS, WANTED, strict=True):
            joints.plot(t, q_d + (q_0 - q_d) * closed, ".", color=BLACK, ms=3)
        for style, name in (("-", "shoulder"), ("--", "elbow")):
            joints.plot([], [], style, color=BLACK, label=name)
        for axes, title in ((pitch, "pitch of the base [deg]"), (joints, "joints [rad]"), (tool, "tool's error [µm]")):
            axes.set(title=title, xlabel="time [s]", xlim=(0.0, 5.0))
            axes.margins(y=0.05)
        joints.set_ylim(0.0, 1.8)
        joints.legend(loc="upper right", ncols=2)
        pitch.legend(title="posture.order")
        written(figure, "posture", 64)
