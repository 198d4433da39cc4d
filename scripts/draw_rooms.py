"""Draw the house: the rooms with the way of one scenario, and one sample on its way through an instant.

python scripts/draw_rooms.py             docs/inside/rooms.svg and docs/inside/instant.svg
python scripts/draw_rooms.py --png DIR   the same as PNG in a folder, to look at them

The floors are from the import contract in pyproject.toml; a test of the docs compares them.
"""

import tomllib
from pathlib import Path

import click
import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Polygon

ROOT = Path(__file__).parents[1]
INK, GREY, LINE = "#1f2933", "#52606d", "#b8c2cc"
PLAIN, STAGE, WATER, BASE, ARM = "#f4f6f8", "#e3edf7", "#dcf0f2", "#eceff2", "#fdf3e1"
EDGES = {PLAIN: LINE, STAGE: "#0b5cad", WATER: "#0f7f91", BASE: LINE, ARM: "#b36b00"}
WAY, TRUE = "#d02a1e", "#0f7f91"
STAGES = ("guidance", "navigation", "control", "actuation")
EQUATION = (
    r"$(M_{RB} + M_A)\,\dot\nu + C_{RB}(\nu)\,\nu"
    r" + C_A(\nu_r)\,\nu_r + D(\nu_r)\,\nu_r + g(\eta) = B\,u + \tau_c + \tau_{dist}$"
)
"""Eq. (10) of the paper."""
FLOOR = 0.62
DASHES = (0, (3, 2))
SIDES = {
    "above": (0.0, 0.22, "center", "bottom"),
    "below": (0.0, -0.22, "center", "top"),
    "left": (-0.24, 0.12, "right", "center"),
    "right": (0.24, -0.14, "left", "center"),
}
SUBJECTS = {
    "cli": "commands",
    "reproduce": "the paper, practicality, a pool",
    "studies": "many runs: plans, pages, tuning",
    "envs": "dm_env, Gymnasium",
    "engine": "runs it: Simulation, machine code",
    "views": "figures, videos, Rerun",
    "analysis": "numbers from traces: metrics, summary",
    "setup": "before the first step: checks",
    "records": "Trace, logs, export",
    "scenario": "all inputs of a run",
    "guidance": "references",
    "navigation": "measurements",
    "control": "commands",
    "actuation": "thrusts",
    "plant": "in the water",
    "stages": "the contract of a stage, the table of signals",
    "physics": "Fossen's equations, frames, water, contact, random numbers",
    "compiler": "Python functions to LLVM",
    "quantities": "units and ranges",
    "files": "reading, writing",
    "errors": "bad input",
    "display": "objects in a notebook",
}


def floors() -> list[list[str]]:
    """The rooms of each floor, from the top, as the import contract has them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    layers = project["tool"]["importlinter"]["contracts"][0]["layers"]
    return [[name.strip() for name in layer.split("|")] for layer in layers]


def box(ax: Axes, x: float, y: float, width: float, height: float, fill: str) -> None:
    style = "round,pad=0,rounding_size=0.06"
    ax.add_patch(FancyBboxPatch((x, y), width, height, style, fc=fill, ec=EDGES[fill], lw=1.1, zorder=2))


def arrow(ax: Axes, start, end, colour: str = INK, bend: str = "arc3", width: float = 1.4) -> None:
    style = {"arrowstyle": "-|>", "color": colour, "lw": width, "mutation_scale": 12, "connectionstyle": bend}
    ax.annotate("", end, start, arrowprops={**style, "shrinkA": 0, "shrinkB": 0}, zorder=3)


def house(ax: Axes, plan: list[list[str]], width: float) -> dict[str, float]:
    """Draw the floors. Returns the height of each room's centre."""
    heights = {}
    for n, rooms in enumerate(plan):
        y, gap = (len(plan) - 1 - n) * FLOOR, 0.07
        share = width / len(rooms)
        for k, room in enumerate(rooms):
            fill = STAGE if room in STAGES else WATER if room == "plant" else BASE if n >= len(plan) - 2 else PLAIN
            box(ax, k * share + gap / 2, y + gap / 2, share - gap, FLOOR - gap, fill)
            heights[room] = y + FLOOR / 2
            centre = (k + 0.5) * share
            ax.text(centre, y + 0.42, room, ha="center", va="center", weight="bold", zorder=4)
            ax.text(centre, y + 0.19, SUBJECTS[room], ha="center", va="center", size=8.8, color=GREY,
                    zorder=4)  # fmt: skip
    top = len(plan) * FLOOR
    ax.add_patch(Polygon([(-0.18, top + 0.03), (width / 2, top + 0.62), (width + 0.18, top + 0.03)],
                         fc="#e9ecef", ec=LINE, lw=1.1, joinstyle="round"))  # fmt: skip
    ax.text(width / 2, top + 0.22, "uvms_mj", ha="center", va="center", weight="bold", color=GREY, size=11)
    return heights


def way(ax: Axes, heights: dict[str, float], left: float) -> None:
    """Draw the way of a scenario: to the right in time, at the height of the room where it happens."""
    stations = [
        ("scenario", "1", "TOML becomes\na Scenario", "below"),
        ("setup", "2", "Setup: plant\nand design ", "left"),
        ("engine", "3", "Simulation: steps,\nrows", "above"),
        ("records", "4", "rows become\na Trace, a log", "below"),
        ("analysis", "5", "metrics,\nsummary", "right"),
        ("views", "6", "figures,\nreplay", "above"),
    ]
    points = [(left + 0.7 + 0.9 * n, heights[room]) for n, (room, *_) in enumerate(stations)]
    ax.plot(
        *zip((left - 0.3, points[0][1]), *points, strict=True), color=WAY, lw=2.2, solid_joinstyle="round", zorder=3
    )
    for (x, y), (_, number, words, side) in zip(points, stations, strict=True):
        ax.add_patch(Circle((x, y), 0.15, fc="white", ec=WAY, lw=1.8, zorder=5))
        ax.text(x, y - 0.01, number, ha="center", va="center", size=9, weight="bold", color=WAY, zorder=6)
        dx, dy, ha, va = SIDES[side]
        ax.text(x + dx, y + dy, words, ha=ha, va=va, size=8.8, zorder=6)


def rooms() -> Figure:
    """The rooms by floor, and the way of one scenario beside them."""
    plan, width = floors(), 8.9
    figure = Figure(figsize=(9.3, 6.0), facecolor="white")
    ax = figure.add_axes((0, 0, 1, 1))
    top = len(plan) * FLOOR
    heights = house(ax, plan, width)
    left = width + 0.45
    way(ax, heights, left)
    ax.text(left + 2.75, top + 0.22, "the way of one scenario", ha="center", va="center", weight="bold", color=WAY)
    y = heights["plant"]
    arrow(ax, (left + 0.9, y - 0.62), (width + 0.06, y - 0.1), EDGES[STAGE], "arc3,rad=-0.2")
    ax.text(left + 1.0, y - 0.62, "Stages and vehicles: a file of yours\ncan take the place of a shipped one.",
            va="center", color=EDGES[STAGE], size=9)  # fmt: skip
    ax.annotate("", (-0.32, 0.1), (-0.32, top - 0.1), arrowprops={"arrowstyle": "-|>", "color": GREY, "lw": 1.2})
    ax.text(-0.48, top / 2, "a room imports only from the rooms below it", rotation=90, ha="center", va="center",
            size=8.8, color=GREY)  # fmt: skip
    ax.set(xlim=(-0.7, left + 5.6), ylim=(-0.12, top + 0.75))
    ax.axis("off")
    return figure


CHAIN = (
    ("navigation", "[navigation]", STAGE, "MEASURED", "pose, velocity,\nforce"),
    ("model", "[estimates]", PLAIN, "ESTIMATES", "M, C, D, g"),
    ("guidance", "[reference]", STAGE, "REFERENCE", "pose and its\nderivatives"),
    ("tracking", "", PLAIN, "ERRORS", "to the\nreference"),
    ("task", "[impedance][task]", PLAIN, "TASK", "s, zeta,\ntau_nom"),
    ("law", "[controller]", STAGE, "tau_cmd", "wrench at\nB or the tool"),
    ("allocation", "[actuation]", STAGE, "u_cmd", "commanded\nthrusts"),
    ("thrusters", "[thrusters]", STAGE, "", ""),
)
"""The stages of an instant: name, tables of the scenario, colour, what they give and its meaning."""
BETWEEN = {
    "navigation": [
        ("felt, wrist, derived", "[wrist]", ARM),
        ("encoder", "[encoder]", ARM),
        ("sensed", "if there is an observer", PLAIN),
    ],
    "model": [("posture", "[posture]", ARM)],
    "tracking": [
        ("natural", "M_d, D_d of the instant", PLAIN),
        ("schedule", "K_f, F_d over time", PLAIN),
        ("observer", "[observer]", STAGE),
    ],
    "task": [("truth", "for the law ideal", PLAIN)],
    "law": [("resolution", "tau and tau_q: J^T F", ARM), ("delay", "controller.delay", PLAIN)],
    "allocation": [("inflow", "at the thrusters", PLAIN), ("joints", "[joints]", ARM)],
}
"""Stages that a run has only if its scenario asks for them, from the last to the first, by the stage before them."""
BEFORE = ("tool", "true attitude", ARM)
"""The stage before all others, of a run with a tool."""
AFTER = ("surroundings, effects", "effects = [...]", STAGE)
"""The stages after all others, of a run with effects of a user's own."""


def instant() -> Figure:
    """One sample on its way through an instant: the stages in their order from the top, the plant below them."""
    pitch, width, height, way = 1.08, 2.1, 0.5, 0.42
    top = 1.9 + len(CHAIN) * pitch
    figure = Figure(figsize=(8.7, top + 1.3), facecolor="white")
    ax = figure.add_axes((0, 0, 1, 1))
    for n, (name, table, fill, signals, meaning) in enumerate(CHAIN):
        low = top - n * pitch - height
        box(ax, 0.0, low, width, height, fill)
        if name == "thrusters":
            ax.patches[-1].set_linestyle(DASHES)
        ax.text(width / 2, low + (0.34 if table else 0.25), name, ha="center", va="center", weight="bold", zorder=4)
        ax.text(width / 2, low + 0.13, table, ha="center", va="center", size=9, color=GREY, zorder=4)
        if signals:
            arrow(ax, (way, low - 0.04), (way, low - pitch + height + 0.04))
            ax.text(way + 0.1, low - 0.18, signals, va="center", weight="bold", size=9.5, color=EDGES[STAGE])
            ax.text(way + 0.1, low - 0.39, meaning.replace("\n", " "), va="center", size=9, color=GREY)
            _optional(ax, low - (pitch - height) / 2, way, BETWEEN.get(name, []))
    _optional(ax, top + 0.36, way, [BEFORE])
    _legend(ax, 4.75, top + 0.9)
    last = top - (len(CHAIN) - 1) * pitch - height
    _optional(ax, last - 0.38, way, [AFTER])
    plant, right = last - 1.62, 8.4
    box(ax, -0.02, plant, right, 0.82, WATER)
    ax.text(right / 2, plant + 0.6, "plant: the vehicle in the water, at its walls, one time step", ha="center",
            va="center", weight="bold", zorder=4)  # fmt: skip
    ax.text(right / 2, plant + 0.26, EQUATION, ha="center", va="center", size=11, zorder=4)
    arrow(ax, (way, last - 0.04), (way, plant + 0.86))
    for k, (signal, meaning, colour) in enumerate((("u", "thrusts", STAGE), ("tau_q", "torques of joints", ARM))):
        y = last - 0.24 - 0.25 * k
        ax.text(way + 0.1, y, signal, va="center", weight="bold", size=9.5, color=EDGES[colour])
        ax.text(way + (0.28 if k == 0 else 0.62), y, meaning, va="center", size=9, color=GREY)
    # the truth of this instant goes up, left of the stages
    ax.plot((0.12, -0.25, -0.25, way, way), (plant + 0.41,) * 2 + (top + 0.72,) * 2 + (top + 0.7,), color=TRUE,
            lw=1.4, zorder=1)  # fmt: skip
    arrow(ax, (way, top + 0.72), (way, top + 0.04), TRUE)
    ax.text(-0.37, top / 2, "TRUE", color=TRUE, weight="bold", size=9.5, rotation=90, ha="center", va="top")
    ax.text(-0.37, top / 2 + 0.06, "state and contact force of this instant", color=GREY, size=9, rotation=90,
            ha="center", va="bottom")  # fmt: skip
    box(ax, -0.02, plant - 0.72, 6.35, 0.4, PLAIN)
    row = "row: state, joints, reference, task, states of the stages, u, contact, sums so far"
    ax.text(3.16, plant - 0.52, row, ha="center", va="center", size=9, zorder=4)
    arrow(ax, (3.16, plant - 0.04), (3.16, plant - 0.29), WAY)
    arrow(ax, (6.37, plant - 0.52), (6.85, plant - 0.52), WAY)
    ax.text(6.92, plant - 0.52, "Trace, log, viewer", color=WAY, weight="bold", size=9.5, va="center")
    ax.set(xlim=(-0.55, 8.5), ylim=(plant - 0.8, top + 1.25))
    ax.axis("off")
    return figure


def _optional(ax: Axes, y: float, way: float, stages: list[tuple[str, str, str]]) -> None:
    """Draw the stages of one place beside each other, from the first to the last, with a line from the way."""
    left, width = 2.6, 1.92
    for n, (name, meaning, fill) in enumerate(reversed(stages)):
        x = left + n * (width + 0.06)
        wide = width + (0.25 if len(name) > 20 else 0.0)
        box(ax, x, y - 0.23, wide, 0.46, fill)
        ax.patches[-1].set(linestyle=DASHES, zorder=4)
        ax.text(x + wide / 2, y + 0.09, name, ha="center", va="center", weight="bold", size=9.5, zorder=5)
        ax.text(x + wide / 2, y - 0.11, meaning, ha="center", va="center", size=9, color=GREY, zorder=5)
    if stages:
        ax.plot((way, left), (y, y), color=GREY, lw=1.0, ls=DASHES, zorder=1)


def _legend(ax: Axes, x: float, y: float) -> None:
    """Say what the boxes are, from the top down."""
    kinds = (
        (STAGE, False, "in every run, chosen by the scenario"),
        (PLAIN, False, "in every run"),
        (PLAIN, True, "in a run that asks for it, the left one first"),
        (ARM, True, "with joints, or a task at a tool"),
    )
    for n, (fill, dashed, meaning) in enumerate(kinds):
        low = y - 0.28 * n
        box(ax, x, low, 0.42, 0.19, fill)
        ax.patches[-1].set_linestyle(DASHES if dashed else "-")
        ax.text(x + 0.52, low + 0.095, meaning, size=9, va="center", color=GREY)


@click.command()
@click.option("--png", type=click.Path(file_okay=False, path_type=Path), help="Write PNG files to this folder instead.")
def main(png: Path | None) -> None:
    """Draw docs/inside/rooms.svg and docs/inside/instant.svg."""
    fonts = ["DejaVu Sans", "Verdana", "sans-serif"]  # the others are as wide, or narrower
    matplotlib.rcParams.update({"font.size": 10, "font.sans-serif": fonts, "text.color": INK})
    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "rooms"})  # letters, not their paths
    for name, figure in (("rooms", rooms()), ("instant", instant())):
        if png:
            figure.savefig(png / f"{name}.png", dpi=120)
        else:
            figure.savefig(ROOT / "docs" / "inside" / f"{name}.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
