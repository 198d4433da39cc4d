"""docs/physics/joints.md: a motor on its torque-speed line, a gear that sticks, a servo that follows a motion, and the
contact force that a wrist sensor derives in a swing without contact."""

import functools
from collections.abc import Iterator

import mujoco
import numpy as np
from matplotlib.figure import Figure

from page_look import written
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.files import shipped
from uvms_mj.views.figures.style import BLACK, COLOURS, GREY, PAGE_IN, line, styled

BLUE, RED = COLOURS["x"], COLOURS["force"]
EFFORT, LIMIT, COULOMB = 9.0, np.deg2rad(30.0), 1.3
"""Of the elbow of the Alpha 5, axis c: effort [N m], speed limit [rad/s], Coulomb friction [N m]."""
ELBOW, START = 2, [0.0, 1.2, 1.0, 0.0]


TURNS = ((0.0, 1.0), (1.0, 1.08), (2.0, 1.0), (3.0, 1.08))
MOVE = ((0.0, 1.0), (1.0, 1.2))
SWING = ((0.2, 1.0), (1.4, 1.4), (2.6, 1.0))
"""Motions of the elbow: times [s] and angles [rad]."""


@functools.cache
def run(duration: float, waypoints: tuple[tuple[float, float], ...], **others: float | str) -> Trace:
    """The Alpha 5 below a vehicle in still water that holds its pose; the elbow moves by waypoints (time, angle)."""
    motion = [{"time": t, "joints": [*START[:ELBOW], q, START[-1]]} for t, q in waypoints]
    overrides = {
        "vehicle.model": "bluerov2_alpha5",
        "wall.present": False,
        "current.speed": 0.0,
        "reference.target": [0.0, 0.0, 0.0],
        "initial.joints": START,
        "simulation.duration": duration,
        "joints.name": "position",
        "joints.motion": motion,
        **others,
    }
    return simulate(Scenario.load("push_wall", overrides))


def derived(compensation: str) -> np.ndarray:
    """The contact force that a wrist sensor derives in the swing [N]."""
    sensor = {"wrist.name": "sensor", "wrist.site": "forearm", "wrist.compensation": compensation}
    return np.linalg.norm(run(3.0, SWING, **sensor, **{"controller.name": "pid"}).f_contact_m_W, axis=1)


def numbers() -> Iterator[tuple]:
    yield (
        "With `weight`, the inertia and drag of the links behind. In the swing of the picture ({} rad in {} s",
        0.4,
        1.2,
    )
    yield "this is up to {} N, with `dynamic` up to {} N", derived("weight").max(), derived("dynamic").max()
    trace = run(1.5, MOVE)
    error = np.abs(trace.q[:, ELBOW] - spline(trace.t, MOVE))
    yield "follow a move of {} rad/s within {} mrad", np.abs(trace.q_dot[:, ELBOW]).max(), 1e3 * error.max()
    model = mujoco.MjModel.from_xml_path(str(shipped("models")["bluerov2_alpha5"]))
    w, load, h, T = float(model.dof_invweight0[6]), 1.26, 1e-4, 2e-3
    yield "(w = {} 1/(kg m^2), {} N m, h = 1e-4 s) this is {} rad/s", w, load, 1e-6 * h * w * load
    yield "$10^4/(T^2 w)$: {} N m/rad", 1e4 / (T * T * w)
    free = run(1.5, ((0.0, START[ELBOW]), (1.5, START[ELBOW])), **{"vehicle.coulomb_friction": 0.0})
    error = np.abs(free.q - START).max(axis=1)
    yield "within {} mrad from the start on, and to {} rad after a second", 1e3 * error.max(), error[free.t > 1.0].max()


def main() -> None:
    with styled():
        figure = Figure(figsize=(PAGE_IN, 4.4))
        (motor, stick), (follow, felt) = figure.subplots(2, 2)
        quick = ((0.0, 1.0), (0.2, 1.6), (1.4, 1.6), (1.6, 1.0))
        fast = run(3.0, quick, **{"joints.velocity_bandwidth": 2000.0, "joints.position_bandwidth": 60.0})
        speed = np.linspace(-LIMIT, LIMIT, 401)
        motor.plot(speed, EFFORT * (1.0 - np.maximum(speed, 0.0) / LIMIT), color=RED, label="limits of the motor")
        motor.plot(speed, -EFFORT * (1.0 + np.minimum(speed, 0.0) / LIMIT), color=RED)
        motor.plot(fast.q_dot[:, ELBOW], fast.tau_q[:, ELBOW], color=BLUE, label="the move")
        motor.set(xlabel="speed [rad/s]", ylabel="torque [N m]", title="A fast move, within the torque-speed line")
        motor.set_ylim(-10.0, 13.0)
        motor.legend(loc="upper right", ncols=2)
        slow = run(3.0, TURNS, **{"joints.friction_compensation": 0.0})
        line(stick, slow.t, slow.tau_q[:, ELBOW], "torque", color=BLUE, label="torque of the motor [N m]")
        line(stick, slow.t, 10.0 * slow.q_dot[:, ELBOW], "speed", color=BLACK, label="10 x speed [rad/s]")
        for level in (-COULOMB, COULOMB):
            stick.axhline(level, color=GREY, lw=0.8, ls="--", label="Coulomb friction" if level > 0.0 else None)
        stick.set(xlabel="time [s]", title="Slow turns: the gear sticks", xlim=(0.0, 3.0), ylim=(-2.6, 4.4))
        stick.legend(loc="upper right", ncols=2)
        for share, colour in ((0.0, GREY), (1.0, BLUE)):
            trace = run(3.0, TURNS, **{"joints.friction_compensation": share}) if share == 0.0 else run(3.0, TURNS)
            label = "with feed-forward of the friction" if share else "without"
            error = 1e3 * (trace.q[:, ELBOW] - spline(trace.t, TURNS))
            line(follow, trace.t, error, label, color=colour, label=label)
        follow.set(xlabel="time [s]", ylabel="error [mrad]", title="The servo in these turns", ylim=(-2.2, 3.2))
        follow.legend(loc="upper right", ncols=2)
        for compensation, colour in (("none", GREY), ("weight", RED), ("dynamic", BLUE)):
            force = derived(compensation)
            line(felt, np.linspace(0.0, 3.0, len(force)), force, compensation, color=colour, label=compensation)
        felt.set(xlabel="time [s]", ylabel="derived force [N]", title="A swing without contact: wrist sensor")
        felt.set(yscale="log", ylim=(1e-6, 1e5), xlim=(0.0, 3.0))
        felt.legend(title="wrist.compensation", loc="upper right", ncols=3)
        written(figure, "joints")


def spline(t: np.ndarray, waypoints: tuple[tuple[float, float], ...]) -> np.ndarray:
    """The motion that the servo is given."""
    from scipy.interpolate import CubicSpline

    times, values = zip(*waypoints, strict=True)
    return CubicSpline(times, values, bc_type="clamped")(np.clip(t, times[0], times[-1]))
