"""docs/posture.md: a vehicle that holds its tool and changes its posture, in two orders of priority.

The vehicle of the picture is the teaching vehicle planar_arm.
"""

import functools
import warnings
from collections.abc import Iterator

import matplotlib.pyplot as plt
import numpy as np

from page_look import written
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.analysis.sampling import SamplingWarning
from uvms_mj.analysis.setup import set_up
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.views.figures.style import BLACK, COLOURS, PAGE_IN, styled

PITCH_DEG, JOINTS, DEMANDED = 12.0, (0.6, 0.9), (0.2, 1.4)
ORDERS = {("attitude", "joints"): COLOURS["x"], ("joints",): COLOURS["roll"]}
BASE = {
    "vehicle.model": "planar_arm",
    "task.frame": "tool",
    "wall.present": False,
    "current.speed": 0.0,
    "initial.attitude_deg": [0.0, PITCH_DEG, 0.0],
    "initial.joints": list(JOINTS),
    "posture.attitude_deg": [0.0, 0.0, 0.0],
    "posture.joints": list(DEMANDED),
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
MOVE = 0.3
"""Distance that the tool of the Alpha 5 moves forward [m]."""


@functools.cache
def held(order: tuple[str, ...], timestep: float = 5e-4, period: float = 5e-4) -> Trace:
    """A run whose tool holds its initial pose, with a period of posture and projection [s]."""
    periods = {"posture.period": period, "task.inertia_period": period}
    settings = BASE | periods | {"simulation.timestep": timestep}
    initial = set_up(Scenario.load("push_wall", settings)).initial
    target = {"reference.target": initial.position, "reference.attitude_deg": initial.attitude_deg}
    return simulate(Scenario.load("push_wall", settings | target | {"posture.order": list(order)}, "impedance"))


def off(trace: Trace) -> float:
    """Largest distance of the tool from its target [um]."""
    return 1e6 * float(np.linalg.norm(trace.eta_e[:, :3], axis=1).max())


@functools.cache
def moved(friction: float) -> float:
    """Largest component of eta_e after a move of the Alpha 5's tool, with a share of the Coulomb friction of its
    gears."""
    settings = ALPHA | {"vehicle.coulomb_friction": friction}
    initial = set_up(Scenario.load("push_wall", settings)).initial
    x, y, z = initial.position
    target = {"reference.target": [x + MOVE, y, z], "reference.attitude_deg": initial.attitude_deg}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SamplingWarning)
        trace = simulate(Scenario.load("push_wall", settings | target, "gsta"), log_rate=100)
    return float(np.abs(trace.eta_e[-1]).max())


def numbers() -> Iterator[tuple]:
    first = next(iter(ORDERS))
    yield "the tool moves by at most {} micrometres", max(off(held(order)) for order in ORDERS)
    fine, default, coarse = (off(held(first, 1e-4, period)) for period in (1e-4, 1e-3, 1e-2))
    yield "by {} micrometres with 0.1 ms, by {} with the default of 1 ms and by {} with 10 ms", fine, default, coarse
    yield "a move of 0.3 m under `gsta` leaves eta_e = {} after 8 s", (moved(1.0), 0.005)
    yield "without the friction the same move ends within {}", moved(0.0)


def main() -> None:
    with styled():
        figure, (pitch, joints, tool) = plt.subplots(1, 3, figsize=(PAGE_IN, 2.5))
        for order, colour in ORDERS.items():
            trace, label = held(order), ", ".join(order)
            angle = np.degrees(-np.arcsin(rotation_matrix(trace.quat_WB)[:, 2, 0]))
            pitch.plot(trace.t, angle, color=colour, label=label)
            for k, style in enumerate(("-", "--")):
                joints.plot(trace.t, trace.q[:, k], style, color=colour)
            tool.plot(trace.t, 1e6 * np.linalg.norm(trace.eta_e[:, :3], axis=1), color=colour)
        t = np.linspace(0.0, 5.0, 30)
        closed = (1.0 + 2.0 * t) * np.exp(-2.0 * t)
        pitch.plot(t, PITCH_DEG * closed, ".", color=BLACK, ms=3, label="closed form")
        for name, style, q_0, q_d in zip(("shoulder", "elbow"), ("-", "--"), JOINTS, DEMANDED, strict=True):
            joints.plot(t, q_d + (q_0 - q_d) * closed, ".", color=BLACK, ms=3)
            joints.plot([], [], style, color=BLACK, label=name)
        pitch.set_ylabel("pitch of the base [deg]")
        joints.set_ylabel("joints [rad]")
        tool.set_ylabel("distance of the tool [um]")
        for axes in (pitch, joints, tool):
            axes.set_xlabel("time [s]")
        pitch.legend(title="posture.order")
        joints.legend(loc="center right")
        written(figure, "posture", 64)


if __name__ == "__main__":
    main()
