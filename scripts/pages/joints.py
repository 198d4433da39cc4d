"""Draw docs/joints.png: a motor on its torque-speed line, a gear that sticks, a servo that follows a motion, and the
contact force that a wrist sensor derives in a swing without contact.

python scripts/pages/joints.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from uvms_mj import Scenario, Trace, simulate

OUT = Path(__file__).parents[2] / "docs" / "joints.png"
INK, BLUE, RED, GREY = "#1f2933", "#0b5cad", "#d02a1e", "#9aa5b1"
EFFORT, LIMIT, COULOMB = 9.0, np.deg2rad(30.0), 1.3
"""Of the elbow of the Alpha 5, axis c: effort [N m], speed limit [rad/s], Coulomb friction [N m]."""
ELBOW, START = 2, [0.0, 1.2, 1.0, 0.0]


def run(duration: float, waypoints: list[tuple[float, float]], **others: float | str) -> Trace:
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


def main() -> None:
    figure = Figure(figsize=(9.0, 5.4), layout="constrained", dpi=100)
    (line, stick), (follow, felt) = figure.subplots(2, 2)
    fast = run(
        3.0,
        [(0.0, 1.0), (0.2, 1.6), (1.4, 1.6), (1.6, 1.0)],
        **{"joints.velocity_bandwidth": 2000.0, "joints.position_bandwidth": 60.0},
    )
    speed = np.linspace(-LIMIT, LIMIT, 401)
    line.plot(speed, EFFORT * (1.0 - np.maximum(speed, 0.0) / LIMIT), color=RED, lw=1.2)
    line.plot(speed, -EFFORT * (1.0 + np.minimum(speed, 0.0) / LIMIT), color=RED, lw=1.2)
    line.plot(fast.q_dot[:, ELBOW], fast.tau_q[:, ELBOW], color=BLUE, lw=1.0)
    line.set(xlabel="speed [rad/s]", ylabel="torque [N m]", title="A fast move, within the torque-speed line")
    turns = [(0.0, 1.0), (1.0, 1.08), (2.0, 1.0), (3.0, 1.08)]
    slow = run(3.0, turns, **{"joints.friction_compensation": 0.0})
    stick.plot(slow.t, slow.tau_q[:, ELBOW], color=BLUE, lw=1.0, label="torque of the motor [N m]")
    stick.plot(slow.t, 10.0 * slow.q_dot[:, ELBOW], color=INK, lw=1.0, label="10 x speed [rad/s]")
    for level in (-COULOMB, COULOMB):
        stick.axhline(level, color=GREY, lw=0.8, ls="--")
    stick.set(xlabel="time [s]", title="Slow turns: the gear sticks")
    stick.set_ylim(-2.6, 3.4)
    stick.legend(frameon=False, fontsize=7, loc="upper right", ncols=2)
    for share, colour in ((0.0, GREY), (1.0, BLUE)):
        trace = run(3.0, turns, **{"joints.friction_compensation": share})
        wanted = spline(trace.t, turns)
        follow.plot(trace.t, 1e3 * (trace.q[:, ELBOW] - wanted), color=colour, lw=1.0, label=f"sigma = {share:g}")
    follow.set(xlabel="time [s]", ylabel="error [mrad]", title="The servo, without and with feed-forward")
    follow.legend(frameon=False, fontsize=7)
    swing = [(0.2, 1.0), (1.4, 1.4), (2.6, 1.0)]
    for compensation, colour in (("none", GREY), ("weight", RED), ("dynamic", BLUE)):
        sensor = {"wrist.name": "sensor", "wrist.site": "forearm", "wrist.compensation": compensation}
        trace = run(3.0, swing, **sensor, **{"controller.name": "pid"})
        felt.plot(trace.t, np.linalg.norm(trace.f_contact_m_W, axis=1), color=colour, lw=1.0, label=compensation)
    felt.set_yscale("log")
    felt.set(xlabel="time [s]", ylabel="derived force [N]", title="A swing without contact: wrist sensor")
    felt.set_ylim(1e-6, 100.0)
    felt.legend(frameon=False, fontsize=7, ncols=3, loc="upper right")
    for axes in (line, stick, follow, felt):
        axes.title.set_fontsize(9)
        axes.tick_params(labelsize=7)
        axes.xaxis.label.set_fontsize(8)
        axes.yaxis.label.set_fontsize(8)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(OUT)


def spline(t: np.ndarray, waypoints: list[tuple[float, float]]) -> np.ndarray:
    """The motion that the servo is given."""
    from scipy.interpolate import CubicSpline

    times, values = zip(*waypoints, strict=True)
    return CubicSpline(times, values, bc_type="clamped")(np.clip(t, times[0], times[-1]))


if __name__ == "__main__":
    main()
