"""Draw docs/tool_push.png: a tool that presses on a wall at the end of the run, and its force over time.

python scripts/pages/arms.py
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from PIL import Image

from render import View, render
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.control.rest import SteadyState
from uvms_mj.views.figures.panels import LEVELS, level
from uvms_mj.views.figures.style import COLOURS, LINE, PAGE_IN, line, save, styled

DOCS = Path(__file__).parents[2] / "docs"
PIXELS = (900, 600)
VIEW = View(
    distance=1.25,
    azimuth=97.0,
    elevation=-14.0,
    lookat=(0.56, 0.0, -0.02),
    streams=((0.25, -0.45, 0.28), (0.45, 0.35, 0.33)),
    labels=((-250, 36), (-40, 26)),
)


def force(ax: Axes, trace: Trace) -> None:
    """The push of the tool, and the closed form of the force at rest."""
    line(ax, trace.t, trace.push, "push", color=COLOURS["force"], linewidth=LINE, label="tool")
    if isinstance(trace.analytic, SteadyState):
        level(ax, trace.t, trace.analytic.force, "closed form", LEVELS["analytic"])
    top = 1.6 * trace.push[trace.t > 0.5 * trace.t[-1]].max()
    ax.set(xlabel="time [s]", ylabel="push on the wall [N]", xlim=(0.0, trace.t[-1]), ylim=(-0.03 * top, top))
    ax.legend(loc="lower right")


def main() -> None:
    """Simulate, render and draw."""
    trace = simulate(Scenario.load("tool_push"))
    picture = render(trace, *PIXELS, VIEW)
    with styled():
        figure, (left, right) = plt.subplots(
            1, 2, figsize=(PAGE_IN, 2.75), layout="constrained", width_ratios=[1.72, 1.0]
        )
        left.imshow(picture)
        left.set_axis_off()
        force(right, trace)
        (file,) = save(figure, DOCS / "tool_push", ("png",))
    small = Image.open(file).convert("RGB").resize((1065, 412), Image.Resampling.LANCZOS)
    small.quantize(96, dither=Image.Dither.NONE).save(file, optimize=True)
    print(file, file.stat().st_size)


if __name__ == "__main__":
    main()
