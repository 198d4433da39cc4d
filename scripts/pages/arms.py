"""docs/physics/arms.md: the water of a link; and the picture of docs/how_to/arm.md, a tool that presses on a wall at
the end of the run, and its force over time.

The picture needs an EGL driver.
"""

from collections.abc import Iterator

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from page_look import DOCS, written
from render import View, render
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.control.base import SteadyState
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.views.figures.panels import LEVELS, level
from uvms_mj.views.figures.style import COLOURS, LINE, PAGE_IN, line, styled, ticks

FILE = DOCS.parent / "examples" / "bluerov1_two_joints.xml"
PIXELS = (840, 640)


def view_of(trace: Trace) -> View:
    """The vehicle and its tool from the side, wherever they come to rest."""
    base, tool = trace.p_WB[-1], trace.p_WT[-1]
    middle, width = 0.5 * (base + tool), float(np.linalg.norm(tool - base))
    streams = middle + width * np.array([[0.1, -0.1, 0.55], [-0.25, 0.0, 0.62], [0.35, 0.1, 0.4]])
    return View(
        distance=2.0 * width,
        azimuth=66.0,
        elevation=-20.0,
        lookat=tuple(middle.tolist()),
        streams=tuple(tuple(start) for start in streams.tolist()),
        labels=((-60, 46), (-40, 26)),
        text=22.0,
    )


def force(ax: Axes, trace: Trace) -> None:
    """The push of the tool, and the closed form of the force at rest."""
    line(ax, trace.t, trace.push, "push", color=COLOURS["force"], linewidth=LINE, label="tool")
    if isinstance(trace.analytic, SteadyState):
        level(ax, trace.t, trace.analytic.force, "closed form", LEVELS["analytic"] | {"linestyle": "dotted"})
    ax.set(xlabel="time [s]", ylabel="push on the wall [N]", xlim=(0.0, trace.t[-1]))
    ticks(ax, 6)
    ax.legend(loc="upper right")


def numbers() -> Iterator[tuple]:
    vehicle = Mjcf.find(str(FILE)).vehicle
    link = vehicle.arm.links[0]
    yield r"$\pi r^2 (l + \tfrac43 r)$ = {} kg", link.displaced_mass
    yield "| {} kg, {} kg m^2 |", link.M_A[2, 2], link.M_A[4, 4]
    yield "| {} N s^2/m^2, {} N m s^2 |", link.D_quadratic[2, 2], link.D_quadratic[4, 4]


def main() -> None:
    """Simulate, render and draw."""
    trace = simulate(Scenario.load("tool_push"))
    picture = render(trace, *PIXELS, view_of(trace))
    with styled():
        figure, (left, right) = plt.subplots(1, 2, figsize=(PAGE_IN, 3.0), width_ratios=[1.4, 1.0])
        left.imshow(picture)
        left.set_axis_off()
        force(right, trace)
        written(figure, "arms", 256)
