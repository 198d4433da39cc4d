"""Draw the frames: world W and body B, the wall, the current and the contact force.

    python scripts/draw_frames.py                   docs/physics/frames.svg
    python scripts/draw_frames.py --out FILE.png    any format that matplotlib writes

All numbers are of the shipped scenario and its vehicle.
"""

from pathlib import Path

import click
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, Patch, Polygon, Rectangle
from matplotlib.transforms import Affine2D

from uvms_mj import Scenario
from uvms_mj.guidance import FilteredSteps
from uvms_mj.setup.base import set_up

OUT = Path(__file__).parents[1] / "docs" / "physics" / "frames.svg"
INK, BODY, MOVE = "#1f2933", "#0b5cad", "#7b4fa3"
WATER, FORCE, TARGET = "#0f7f91", "#d02a1e", "#2f7d32"


def arrow(ax: Axes, start, vector, colour: str, width: float = 1.6) -> None:
    """Draw a vector from a point."""
    end = np.add(start, vector)
    style = {
        "arrowstyle": "-|>",
        "color": colour,
        "lw": width,
        "shrinkA": 0,
        "shrinkB": 0,
        "mutation_scale": 12,
    }
    ax.annotate("", end, start, arrowprops=style, zorder=5)


def frame(ax: Axes, name: str, origin, yaw_deg: float, length: float, colour: str) -> None:
    """Draw axes x and y of a frame seen from above, z towards the reader."""
    for axis, angle in (("x", yaw_deg), ("y", yaw_deg + 90)):
        along = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
        arrow(ax, origin, length * along, colour)
        x, y = origin + (length + 0.035) * along
        ax.text(x, y, f"${axis}_{name}$", color=colour, ha="center", va="center")
    for radius, fill in ((0.02, "white"), (0.006, colour)):
        ax.add_patch(Circle(origin, radius, fc=fill, ec=colour, lw=1.2, zorder=6))


def vehicle(ax: Axes, position, yaw_deg: float, reach: float, faint: bool = False) -> None:
    """Draw the outline of a BlueROV1 from above. The front of its dome is at x = reach in B."""
    bend = np.linspace(-np.pi / 2, np.pi / 2, 30)
    hull = np.column_stack([0.187 + (reach - 0.187) * np.cos(bend), 0.055 * np.sin(bend)])
    hull = np.vstack([[[-0.115, 0.055], [-0.115, -0.055]], hull])
    parts: list[Patch] = [Rectangle((-0.2, side - 0.009), 0.4, 0.018) for side in (-0.16, 0.16)]
    parts += [Rectangle((x - 0.006, -0.16), 0.012, 0.32) for x in (-0.19, 0.19)]
    parts += [Rectangle((-0.03, y - 0.035), 0.06, 0.07) for y in (-0.105, 0.105)]
    parts += [Circle(centre, 0.037) for centre in ((0.15, 0.105), (0.15, -0.105), (-0.165, 0.0))]
    parts.append(Polygon(hull))
    place = Affine2D().rotate_deg(yaw_deg).translate(*position) + ax.transData
    for part in parts:
        part.set(fc="none" if faint else "#e6edf4", ec="#b8c2cc" if faint else "#52606d", lw=0.9)
        part.set(transform=place, zorder=1 if faint else 2)
        ax.add_patch(part)


def wall(ax: Axes, face: float, bottom: float, top: float) -> None:
    ax.add_patch(Rectangle((face, bottom), 0.12, top - bottom, fc="#dfe3e8", ec="#9aa5b1", hatch="////", lw=0))
    ax.plot([face, face], [bottom, top], color=INK, lw=1.8)
    behind = {"fc": "#dfe3e8", "ec": "none", "pad": 2.5}
    ax.text(face + 0.06, bottom + 0.2, "wall", rotation=90, ha="center", va="center", bbox=behind)


def drop(ax: Axes, x: float, low: float, high: float, colour: str) -> None:
    ax.plot([x, x], [low, high], color=colour, lw=1.0, ls=(0, (4, 3)), zorder=4)


def poses(ax: Axes, scenario: Scenario, reach: float) -> None:
    """Draw the frames and the current to scale."""
    x_c, face = scenario.wall.position, scenario.wall.position + reach
    p_WB, yaw = np.array([0.63, 0.17]), 18.0
    wall(ax, face, -0.5, 0.5)
    vehicle(ax, (0, 0), 0.0, reach, faint=True)
    vehicle(ax, p_WB, yaw, reach)
    frame(ax, "W", np.zeros(2), 0.0, 0.27, INK)
    frame(ax, "B", p_WB, yaw, 0.27, BODY)
    arrow(ax, (0, 0), p_WB, MOVE)
    ax.text(0.33, 0.13, "p_WB", color=MOVE, ha="center")
    ax.text(-0.03, -0.24, "start", color="#7b8794", ha="center")
    drop(ax, x_c, -0.5, 0.5, INK)
    ax.text(
        x_c - 0.03,
        -0.33,
        f"$x_c$ = {x_c:g} m:\ncontact begins\nwhen B's origin\nis here",
        ha="right",
        va="center",
        size="small",
    )
    beta = scenario.current.direction_deg
    x, y = 0.36, -0.42
    along = np.array([np.cos(np.deg2rad(beta)), np.sin(np.deg2rad(beta))])
    ax.plot([x, x + 0.17], [y, y], color=WATER, lw=1.0, ls=(0, (4, 3)))
    ax.add_patch(Arc((x, y), 0.18, 0.18, theta1=0, theta2=beta, color=WATER, lw=1.2))
    arrow(ax, (x, y), 0.27 * along, WATER, 2.2)
    ax.text(x + 0.09, y + 0.08, f"{beta:g}°", color=WATER)
    ax.text(x - 0.14, y + 0.05, f"$v_c$, {scenario.current.speed:g} m/s", color=WATER, ha="right")


def contact(ax: Axes, scenario: Scenario, reach: float) -> None:
    """Draw the vehicle in contact. The depth of the target, a centimetre, is drawn larger than to scale."""
    x_c, face, target = scenario.wall.position, scenario.wall.position + reach, FilteredSteps().target[0]
    drawn_target = x_c + 0.05
    wall(ax, face, -0.5, 0.5)
    vehicle(ax, (x_c, 0), 0.0, reach)
    drop(ax, x_c, -0.36, 0.0, BODY)
    ax.add_patch(Circle((x_c, 0), 0.011, color=BODY, zorder=6))
    ax.text(x_c - 0.02, 0.0, "B", color=BODY, ha="right", va="center")
    ax.text(x_c, -0.38, f"$x_c$ = {x_c:g} m", color=BODY, ha="center", va="top")
    drop(ax, drawn_target, 0.0, 0.25, TARGET)
    ax.plot(drawn_target, 0, "x", color=TARGET, ms=7, mew=2, zorder=6)
    ax.text(face - 0.03, 0.27, f"target {target:g} m", color=TARGET, ha="right")
    arrow(ax, (face, 0), (-0.15, 0), FORCE, 2.4)
    ax.text(face - 0.03, 0.4, "f_contact_W = (−F, 0, 0)", color=FORCE, ha="right")
    ax.annotate("", (face, -0.26), (x_c, -0.26), arrowprops={"arrowstyle": "<->", "shrinkA": 0, "shrinkB": 0})
    ax.text((x_c + face) / 2, -0.25, f"{reach:.3f} m", ha="center", va="bottom", size="small")


@click.command()
@click.option(
    "--out",
    default=OUT,
    type=click.Path(path_type=Path),
    show_default="docs/physics/frames.svg",
    help="File to write.",
)
def main(out: Path) -> None:
    """Draw the frames: world W and body B, the wall, the current and the contact force."""
    scenario = Scenario.load("push_wall")
    reach = set_up(scenario).plant.geometry.reach
    matplotlib.rcParams.update(
        {
            "font.size": 10.5,
            "axes.titlesize": 10.5,
            "svg.hashsalt": "frames",
            "hatch.color": "#b8c2cc",
            "text.color": INK,
        }
    )
    figure = Figure(figsize=(7.4, 3.05), facecolor="white")
    left, right = figure.subplots(1, 2, width_ratios=(1.72, 0.80))
    poses(left, scenario, reach)
    contact(right, scenario, reach)
    left.set(xlim=(-0.36, 1.36), title="frames W and B, seen from above ($z$ up)")
    right.set(xlim=(0.56, 1.36), title="in contact (not to scale)")
    for ax in (left, right):
        ax.set(ylim=(-0.5, 0.5), aspect="equal")
        ax.axis("off")
    figure.tight_layout(pad=0.4)
    figure.savefig(out, dpi=200, metadata={"Date": None} if out.suffix == ".svg" else None)


if __name__ == "__main__":
    main()
