"""docs/physics/theory.md: the push at rest by hand, by its formula and in runs."""

import functools
from collections.abc import Iterator

from uvms_mj import Scenario, Trace, simulate

X_U, X_UU, SURGE_INERTIA = 4.03, 18.18, 7.31 + 5.5
"""Drag [N s/m, N s^2/m^2] and inertia [kg] of the BlueROV1 in surge."""
K_X, SOFTENING = 150.0, 1.0 + 150.0 / 1e5
AWAY = {"reference.target": [1.05, 0.0, 0.0], "current.direction_deg": 180.0}


@functools.cache
def run(law: str, away: bool) -> Trace:
    """A run in the current straight away from the wall, or in the paper's scenario."""
    return simulate(Scenario.load("push_wall", AWAY if away else {}, law), engine="free_body")


def drag(speed: float) -> float:
    return (X_U + X_UU * speed) * speed


def push(trace: Trace) -> float:
    """The mean push of the last half second [N]."""
    return float(trace.final_impulse[-1]) / 0.5


def numbers() -> Iterator[tuple]:
    d_x, asked = drag(0.5), 0.05 * K_X
    share = {"impedance": 1.0, "fosm": 100.0 / 19100.0, "gsta": 0.0}
    by_hand = {law: (asked - part * d_x) / SOFTENING for law, part in share.items()}
    yield "| (7.5 - 6.56)/1.0015 = {} N | {} N at the wall", by_hand["impedance"], push(run("impedance", True))
    yield "100/19100)/1.0015 = {} N | {} N in its layer", by_hand["fosm"], push(run("fosm", True))
    yield "| 7.5/1.0015 = {} N | {} N, whatever", by_hand["gsta"], push(run("gsta", True))
    yield "loses {} % of its push", 100.0 * (1.0 - push(run("impedance", True)) / push(run("gsta", True)))
    yield "= {}/19100$, which is\n{} m/s in the run", -d_x / SURGE_INERTIA, run("fosm", True).s[-1, 0]
    yield "is {} m, and the run ends at {} m", 1.01 - drag(0.25) / K_X, run("impedance", False).p_WB[-1, 0]
    munk = (12.7 - 5.5) * 0.25 * 0.5 * 3.0**0.5 / 2.0
    yield "_N = {}$ N m, turns", munk
    yield r"0.779/50 = {}$ rad, as", 2.0 * munk / 50.0
    yield "push with {} N and with {} N", push(run("fosm", False)), push(run("gsta", False))
    yield "have {} rad/s and {}.", 5.0 * 10.0**0.5, 5.0 / (2.0 * 10.0**0.5)
    yield r"\cdot 150} = {}$ N s/m", 2.0 * (SURGE_INERTIA * K_X) ** 0.5
