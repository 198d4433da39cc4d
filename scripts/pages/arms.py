"""docs/arms.md: a tool that presses on a wall at the end of the run, and its force over time.

The picture needs an EGL driver.
"""

import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from PIL import Image

from render import View, render
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.control.rest import SteadyState
from uvms_mj.views.figures.panels import LEVELS, level
from uvms_mj.views.figures.style import COLOURS, LINE, PAGE_IN, line, save, styled, ticks

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
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
    )


def force(ax: Axes, trace: Trace) -> None:
    """The push of the tool, and the closed form of the force at rest."""
    line(ax, trace.t, trace.push, "push", color=COLOURS["force"], linewidth=LINE, label="tool")
    if isinstance(trace.analytic, SteadyState):
        level(ax, trace.t, trace.analytic.force, "closed form", LEVELS["analytic"])
    top = 1.6 * trace.push[trace.t > 0.5 * trace.t[-1]].max()
    ax.set(xlabel="time [s]", ylabel="push on the wall [N]", xlim=(0.0, trace.t[-1]), ylim=(-0.03 * top, top))
    ticks(ax, 6)
    ax.legend(loc="lower right")


def pressing() -> Trace:
    """The last scenario of the page, with its vehicle."""
    text = re.findall(r"```toml\n(.*?)```", (DOCS / "arms.md").read_text(), re.DOTALL)[-1]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "my_rov.xml").write_text((ROOT / "examples" / "bluerov1_two_joints.xml").read_text())
        (Path(folder) / "tool.toml").write_text(text)
        return simulate(Scenario.load(str(Path(folder) / "tool.toml")), log_rate=100)


def numbers() -> Iterator[tuple]:
    yield "The tool rests on the wall with {} N", pressing().push[-1]
    yield "presses on a pile with {} N", simulate(Scenario.load("tool_slide"), log_rate=100).push[-1]


def main() -> None:
    """Simulate, render and draw."""
    trace = simulate(Scenario.load("tool_push"))
    picture = render(trace, *PIXELS, view_of(trace))
    with styled():
        figure, (left, right) = plt.subplots(
            1, 2, figsize=(PAGE_IN, 2.9), layout="constrained", width_ratios=[1.4, 1.0]
        )
        left.imshow(picture)
        left.set_axis_off()
        force(right, trace)
        (file,) = save(figure, DOCS / "arms", ("png",))
    small = Image.open(file).convert("RGB").resize((1065, 435), Image.Resampling.LANCZOS)
    palette = small.quantize(256, Image.Quantize.FASTOCTREE)
    small.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(file, optimize=True)
    print(file, file.stat().st_size)


if __name__ == "__main__":
    main()
