"""docs/physics/actuation.md: the curves of the T200 by voltage, the step responses of the lags, and an example."""

import re
import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from page_look import written
from uvms_mj import Scenario, simulate
from uvms_mj.actuation import T200 as T200Thrusters
from uvms_mj.actuation.propeller import VOLTAGES, thrust_curve
from uvms_mj.actuation.thrusters import discrete
from uvms_mj.reproduce.practicality.results import SMOOTHER
from uvms_mj.setup.deployment import AS_DEPLOYED, pushed
from uvms_mj.views.figures.style import BLACK, COLOURS, GREY, PAGE_IN, styled

PERIOD = 1e-3
STEPS = 120


def step_response(lag: str, time_constant: float = 0.03) -> np.ndarray:
    """The thrust (n,) at each instant after a step of the command."""
    matrices = discrete(lag, time_constant, PERIOD)
    x, found = np.zeros(3), []
    for _ in range(STEPS):
        found.append(float(matrices["C"] @ x))
        x = matrices["Phi"] @ x + matrices["Gamma"]
    return np.array(found)


T200 = {"thrusters.name": "t200", "thrusters.voltage": 14.8, "thrusters.efficiency": 0.8}
EXAMPLE = {
    "vehicle.model": "bluerov2_heavy",
    "controller.k_1": 1.0,
    "controller.k_2": 1.0,
    "controller.beta": 2.0,
    "task.A": -20.0,
    "wall.stiffness": 2e3,
    "wall.damping": 50.0,
    "current.speed": 0.2,
    "simulation.timestep": 1e-3,
    "simulation.duration": 30.0,
}
ROWS = {
    "ideal": {},
    "T200 at 14.8 V, efficiency 0.8, without the lag": T200 | {"thrusters.lag": "none"},
    "the same with the identified lag": T200,
    "the same with a start-up delay of 0.11 s": T200 | {"thrusters.start_delay": 0.11},
    "12 V where 16 V is assumed, efficiency 0.8, with the lag": T200
    | {"thrusters.voltage": 12.0, "thrusters.assumed_voltage": 16.0},
}
"""Rows of the table of the example, by the settings of the thrusters."""
WEAK = {"thrusters.name": "t200", "thrusters.voltage": 10.0, "reference.target": [1.4, 0.0, 0.0]}


DEPLOYED = {
    "vehicle.model": "bluerov2_heavy",
    "initial.position": [0.95, 0.0, 0.0],
    "reference.step_time": 1.5,
    "bumper.stiffness": 2e3,
    "simulation.duration": 20.0,
    "simulation.timestep": 5e-4,
}
FREEZES = {"thrusters.freeze_time": 1.4, "thrusters.freeze_at": 1.6, "thrusters.freeze_every": 6.0}
STIFFNESS = 150.0  # N/m, of the paper's impedance ahead


def as_deployed(law: str, push: float, settings: Mapping[str, Any]) -> tuple[float, float]:
    """Mean push of the last 0.5 s and largest push [N] of a law of which a push is demanded."""
    ahead = {"reference.target": [1.0 + push / STIFFNESS, 0.0, 0.0]}
    gains = SMOOTHER if law == "gsta" else {}
    keys = {**gains, **settings}  # a control period is a key of the preset
    scenario = Scenario.load("push_wall", DEPLOYED | ahead | keys, law)
    trace = simulate(scenario, engine="free_body", log_rate=1000)
    return float(trace.push[trace.t > 19.5].mean()), float(trace.force_peak[-1])


def deployed_numbers() -> Iterator[tuple]:
    """The two tables of the section on a law as deployed."""
    parts = np.full(4, np.cos(np.pi / 4))
    for push in (1.5, 5.0, 20.0, 60.0):
        one = pushed(T200Thrusters(), thrust_curve(16.0), thrust_curve(16.0), parts, 0.25 / parts, push)
        yield f"| {push:g} | {{}} | {{}} | {{}} |", one.thrusts[0], one.commands[0], one.step
    yield "The smallest push is then {} N", one.smallest
    for law in ("gsta", "admittance", "impedance"):
        for push in (5.0, 20.0):
            each = [
                as_deployed(law, push, keys) for keys in ({}, AS_DEPLOYED, {**AS_DEPLOYED, "thrusters.mixer": "linear"})
            ]
            (ideal, _), (mean, most), (mixed, peak) = each
            close = 0.02 if law == "gsta" else 2e-3
            yield (
                f"| {law}, {push:g} N | {{}} | {{}} | {{}} | {{}} | {{}} |",
                (ideal, 1e-3),
                (mean, close),
                (most, 0.1),
                (mixed, 20.0 * close),
                (peak, 1.0),
            )
    _, hit = as_deployed("admittance", 20.0, {**AS_DEPLOYED, **FREEZES})
    yield "hits the bumper with {} N instead of", (hit, 2.0)


def numbers() -> Iterator[tuple]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for row, settings in ROWS.items():
            trace = simulate(Scenario.load("push_wall", EXAMPLE | settings), engine="free_body", log_rate=1000)
            late = trace.push[trace.t > 25.0]
            yield (
                f"| {row} | {{}} | {{}} | {{}} |",
                (late.mean(), 3e-5),
                (np.ptp(late), 0.2 * np.ptp(late)),
                trace.force_peak[-1],
            )
            if not settings:
                yield "stepped at 1 ms for 30 s. The closed form is {} N", trace.analytic.force
        weak = simulate(Scenario.load("push_wall", WEAK | {"simulation.duration": 0.001}), engine="free_body")
    needs, has = re.findall(r"needs (\S+) N at rest and has (\S+) N", str(weak.analytic))[0]
    yield "surge_left needs {} N at rest and has {} N", float(needs), float(has)
    denominator, numerator, gain = 9258.0, 6136.0, 108700.0  # of the transfer function: s, s, 1
    yield "Slow changes of the thrust are {} ms late", 1e3 * (denominator - numerator) / gain
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield from deployed_numbers()
    yield "with both efficiencies at 0.46 has {} N at 16 V", 0.46 * thrust_curve(16.0).thrust[-1]


def main() -> None:
    with styled():
        figure, (left, right) = plt.subplots(1, 2, figsize=(PAGE_IN, 3.0))
        colours = plt.get_cmap("viridis")(np.linspace(0.0, 0.85, len(VOLTAGES)))
        for voltage, colour in zip(VOLTAGES, colours, strict=True):
            curve = thrust_curve(voltage)
            left.plot(curve.command, curve.thrust, "o", markersize=2.0, color=colour)
            left.plot(curve.command, curve.thrust, color=colour, label=f"{voltage:g} V")
        between = thrust_curve(15.0)
        left.plot(between.command, between.thrust, "--", color=GREY, label="15 V, interpolated")
        left.set(xlabel="pulse width [µs]", ylabel="thrust [N]", title="T200: points of the maker's table")
        t = 1e3 * PERIOD * np.arange(STEPS)
        right.plot([0.0, 0.0, t[-1]], [0.0, 1.0, 1.0], color=GREY, label="none")
        right.plot(t, step_response("first_order"), color=COLOURS["x"], label="first_order, 30 ms")
        right.plot(t, step_response("third_order"), color=COLOURS["force"], label="third_order, as identified")
        right.plot(
            [20.0, 32.0], [0.63, 0.95], "+", color=BLACK, markersize=9, label="63 % at 20 ms, 95 % at 32 ms (source)"
        )
        right.set(xlabel="time after the command [ms]", ylabel="thrust over command", title="Step response of the lags")
        left.legend(loc="upper left")
        right.legend(loc="lower right")
        written(figure, "actuation")
