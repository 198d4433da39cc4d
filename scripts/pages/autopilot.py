"""docs/how_to/autopilot.md: pushes on a wall under ArduSub and under GSTA, in three currents along the wall's normal.

The pushes under ArduSub are measured: ardusub_push.csv has their rows. GSTA runs here.
"""

import functools
from collections.abc import Iterator
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes

from page_look import DOCS, written
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.views.figures.style import COLOURS, PAGE_IN, styled

CURRENTS = {-0.2: COLOURS["x"], 0.0: COLOURS["y"], 0.2: COLOURS["z"]}
"""Speed of the current towards the wall [m/s], and its colour."""
WALL, STIFFNESS, DEMANDED = 2.0, 2e4, 20.0
"""Place of the wall [m], stiffness [N/m], push that GSTA is asked for [N]."""
K_D = 150.0
"""Stiffness of the impedance along the normal [N/m]."""
HELD = slice(-800, -100)
"""Rows of GSTA in which the push is at rest; 100 Hz."""
DRAWN = 1
"""Thruster of the Heavy whose command is drawn: horizontal."""


@functools.cache
def ardusub() -> dict[float, pd.DataFrame]:
    """The measured rows of each current, 10 Hz; ``peak_N`` is the greatest force of a row's 0.1 s."""
    rows = pd.read_csv(DOCS / "how_to" / "ardusub_push.csv", comment="#")
    return {float(speed): frame for speed, frame in rows.groupby("current_mps")}


def held(frame: pd.DataFrame) -> pd.DataFrame:
    """The rows in which ArduSub presses, from 6 s to 1 s before the vehicle leaves."""
    leaves = frame["t_s"][frame["force_N"] > 1.0].iloc[-1]
    return frame[frame["t_s"].between(leaves - 6.0, leaves - 1.0)]


@functools.cache
def gsta(speed: float) -> Trace:
    """The same push under GSTA: it follows a line to a point behind the wall, as deep as the demanded push asks."""
    beyond = WALL + DEMANDED * (1.0 / K_D + 1.0 / STIFFNESS)
    keys = {
        "vehicle.model": "bluerov2_heavy",
        "thrusters.name": "t200",
        "controller.period": 2.5e-3,  # ArduSub's
        "current.speed": abs(speed),
        "current.direction_deg": 0.0 if speed >= 0.0 else 180.0,
        "wall.position": WALL,
        "wall.stiffness": STIFFNESS,
        "wall.damping": 500.0,
        "wall.friction": 0.3,
        "reference.name": "path",
        "reference.poses": [{"position": [beyond, 0.0, 0.0]}],
        "reference.speed": 0.1,
        "reference.start_time": 3.0,
        "simulation.duration": 45.0,
    }
    return simulate(Scenario.load("push_wall", keys, "gsta"), engine="free_body", log_rate=100)


def draw(axes: dict[str, Axes]) -> None:
    """Push, command of one thruster and position; ArduSub on the left, GSTA on the right."""
    for speed, colour in CURRENTS.items():
        told = f"current of {speed:+g} m/s" if speed else "no current"
        frame, trace = ardusub()[speed], gsta(speed)
        axes["push a"].plot(frame["t_s"], frame["peak_N"], color=colour, lw=0.8)
        axes["command a"].plot(frame["t_s"], frame[f"pwm{DRAWN}_us"], color=colour, lw=0.8)
        axes["place a"].plot(frame["t_s"], frame["x_m"], color=colour, lw=0.8)
        axes["push g"].plot(trace.t, trace.push_high, color=colour, lw=0.8, label=told)
        axes["command g"].plot(trace.t, trace.u_cmd[:, DRAWN - 1], color=colour, lw=0.8)
        axes["place g"].plot(trace.t, trace.p_WB[:, 0], color=colour, lw=0.8)
    for side, title in (("a", "ArduSub in ALT_HOLD, the same stick"), ("g", "GSTA, 20 N demanded")):
        axes[f"push {side}"].set(title=title, yscale="log", ylim=(3.0, 500.0))
        axes[f"push {side}"].set_yticks([5, 10, 20, 50, 100, 200], ["5", "10", "20", "50", "100", "200"])
        axes[f"push {side}"].minorticks_off()
        axes[f"place {side}"].set(xlabel="time [s]", ylim=(-1.5, 2.5))
        for name in ("push", "command", "place"):
            axes[f"{name} {side}"].set_xlim(0.0, 45.0)
    axes["push a"].set_ylabel("push [N]")
    axes["command a"].set_ylabel("pulse, thruster 1 [µs]")
    axes["command g"].set_ylabel("thrust, thruster 1 [N]")
    axes["place a"].set_ylabel("x [m]; wall at 2 m")
    axes["push g"].legend(loc="upper left")


def main() -> None:
    mosaic: list[Any] = [[f"{name} {side}" for side in "ag"] for name in ("push", "command", "place")]
    with styled():
        figure, axes = plt.subplot_mosaic(mosaic, figsize=(PAGE_IN, 4.6), sharex=True, layout="constrained")
        draw(axes)
    written(figure, "autopilot")


def numbers() -> Iterator[tuple]:
    forces = [held(ardusub()[speed])["force_N"] for speed in CURRENTS]
    yield "it presses with {}, {} and {} N", *(force.mean() for force in forces)
    yield "touches with {}, {} and {} N", *(ardusub()[speed]["peak_N"].max() for speed in CURRENTS)
    runs = [gsta(speed) for speed in CURRENTS]
    yield "GSTA presses with {}, {} and {} N", *((run.push[HELD].mean(), 0.05) for run in runs)
    yield "first touch is {}, {} and {} N", *((run.push_high.max(), 2.0) for run in runs)
    yield "by {} N (standard deviation)", (max(run.push[HELD].std() for run in runs), 0.1)
