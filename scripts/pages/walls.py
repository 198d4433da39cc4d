"""docs/physics/walls.md: a vehicle with two bumpers on a pile, its forces and their closed form, and a shaking wall.

The picture needs an EGL driver.
"""

import functools
import warnings
from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from page_look import written
from render import View, render
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.control.base import SteadyState
from uvms_mj.setup.base import set_up
from uvms_mj.views.figures.style import BLACK, COLOURS, PAGE_IN, line, styled

K_C, AMPLITUDE, FREQUENCY = 2e3, 2e-3, 0.5
VIEW = View(
    distance=1.3,
    azimuth=58.0,
    elevation=-30.0,
    lookat=(1.2, 0.0, 0.02),
    streams=((1.0, 0.22, 0.3), (0.95, 0.05, 0.4), (1.05, 0.38, 0.36)),
    labels=((70, -96), (-60, -40)),
    scale=0.05,
)
RETUNED = {
    "controller.k_1": 1.0,
    "controller.k_2": 1.0,
    "controller.beta": 2.0,
    "task.A": -20.0,
    "controller.period": 0.01,
    "simulation.timestep": 1e-3,
    "simulation.duration": 30.0,
}


@functools.cache
def pile() -> Trace:
    return simulate(Scenario.load("press_pile", {"simulation.duration": 10.0}), engine="free_body", log_rate=200.0)


@functools.cache
def shaken() -> Trace:
    """The ideal law pressing on a plane that moves to and fro."""
    wall = {"shape": "plane", "position": [1.241, 0.0, 0.0], "stiffness": K_C}
    moving = wall | {"amplitude": [AMPLITUDE, 0.0, 0.0], "frequency_hz": FREQUENCY}
    overrides = {"wall.present": False, "walls": [moving], "reference.target": [1.05, 0.0, 0.0]}
    return simulate(Scenario.load("push_wall", overrides, "ideal"), engine="free_body", log_rate=200.0)


def response(trace: Trace) -> np.ndarray:
    """The force on the wall: M_d x'' + D_d x' + K_d (x - x_d) = -F, F = k_c (x - w), in closed form."""
    design, s = set_up(trace.scenario).design, 2j * np.pi * FREQUENCY
    M, D, K = (float(each[0, 0]) for each in (design.M_d, design.D_d, design.K_d))
    x_c = 1.241 - trace.header.geometry.reach
    X = K_C * AMPLITUDE / (M * s * s + D * s + K + K_C)
    mean = K * (1.05 - x_c) / (1.0 + K / K_C)
    return mean + (K_C * (X - AMPLITUDE) * np.exp(s * trace.t)).imag


def numbers() -> Iterator[tuple]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        bumped = Scenario.load("push_wall", RETUNED | {"bumper.stiffness": 1.0 / (1.0 / 2e3 - 1.0 / 1e5)})
        trace = simulate(bumped, engine="free_body", log_rate=1000.0)
    yield "A bumper of {} N/m in front of a wall of 1e5 N/m is a wall of 2e3 N/m", bumped.bumper.stiffness
    held = trace.push[trace.t > 25.0].mean()
    yield "holds {} N on it; the closed form is {} N", (held, 1e-5), 1.5 / (1.0 + 150.0 / 2e3)
    late = shaken().t > 14.0
    expected = response(shaken())[late]
    far = np.abs(shaken().push[late] - expected).max() / np.ptp(expected)
    yield "the largest difference is {} of the span", far
    rest = pile().analytic
    assert isinstance(rest, SteadyState)
    yield "The static balance of `press_pile` is {} N; its run ends at {} N", rest.force, pile().f_normal[-1]


def main() -> None:
    """Draw the picture."""
    with styled():
        figure = Figure(figsize=(PAGE_IN, 4.6))
        grid = figure.add_gridspec(2, 2, width_ratios=(1.5, 1.0))
        scene, forces, motion = (figure.add_subplot(place) for place in (grid[:, 0], grid[0, 1], grid[1, 1]))
        scene.imshow(render(pile(), 760, 800, VIEW))
        scene.axis("off")
        scene.set_title("press_pile: two bumpers on a pile")
        line(forces, pile().t, pile().f_normal, "push", color=COLOURS["force"], label="sum of the normal forces")
        rest = pile().analytic
        assert isinstance(rest, SteadyState)
        forces.axhline(rest.force, color=BLACK, ls=":", label=f"closed form, {rest.force:.3f} N")
        forces.set(xlim=(3.5, 10.0), ylim=(0.0, 22.0), xlabel="time [s]", ylabel="push [N]")
        shaking = shaken()
        late = shaking.t > 14.0
        line(motion, shaking.t[late], shaking.push[late], "push", color=COLOURS["force"], label="wall shakes by 2 mm")
        motion.plot(shaking.t[late], response(shaking)[late], color=BLACK, ls=":", label="closed form")
        motion.set(xlim=(14.0, 20.0), ylim=(6.2, 8.2), xlabel="time [s]", ylabel="push [N]")
        for axes in (forces, motion):
            axes.legend(loc="upper right", ncols=1)
        written(figure, "walls", 256)
