"""docs/how_to/thruster.md: the lagging thrusters of the examples, alone and in the loop of GSTA."""

import warnings
from collections.abc import Iterator

import numpy as np

from page_look import DOCS
from uvms_mj import Scenario, Simulation, simulate

EXAMPLE = DOCS.parent / "examples" / "lagging_thrusters.py"


def lagging(time_constant: float) -> dict[str, str | float]:
    return {"actuation.name": f"{EXAMPLE}:LaggingThrusters", "actuation.time_constant": time_constant}


def swings(time_constant: float) -> float:
    """Range of the position along x in free water over the last 5 s [m]."""
    away = {"wall.present": False, "simulation.duration": 15.0}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        trace = simulate(Scenario.load("push_wall", away | lagging(time_constant)), engine="free_body", log_rate=100)
    return float(np.ptp(trace.p_WB[trace.t > 10.0, 0]))


def numbers() -> Iterator[tuple]:
    free = {"controller.name": "external", "wall.present": False}
    with Simulation(Scenario.load("push_wall", lagging(0.05) | free)) as sim:
        sim.tau_cmd[0] = 6.0
        while sim.signals.tau[0] < 6.0 * (1.0 - np.exp(-1.0)):
            sim.step()
        yield "print(sim.t) # {} s", sim.t
    found = {T: swings(T) for T in (0.03, 0.04, 0.05, 0.06, 0.07, 0.08)}
    yield "cycles from about {} s", min(T for T, swing in found.items() if swing > 1e-4)
    yield "is unstable from about {} s", min(T for T, swing in found.items() if swing > 1.0)
