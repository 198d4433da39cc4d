"""Render the built-in scenario at rest on the wall: the first picture of the README.

    python scripts/render.py                                a PNG of 1280x720, docs/push_wall.png
    python scripts/render.py --out FILE.png --size 1920 1080
    python scripts/render.py --out FILE.png --vehicle bluerov2_heavy --distance 1.2

Wall, force and current are of the run's scene at its end. Water, floor and textures are decoration. The orange
arrow is the force of the wall on the vehicle, the blue arrows are the ocean current. Arrows are drawn above everything
else.
"""

import os
import sys
from dataclasses import dataclass
from pathlib import Path

if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")  # mujoco reads it when it is imported

import click
import mujoco
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.records.scene import FORCES, Colour, scene_of
from uvms_mj.views.video.underwater import FLOOR, model_of

OUT = Path(__file__).parents[1] / "docs" / "push_wall.png"
DURATION_S = 8.0
FINER = 2
"""Factor of supersampling, for smooth edges."""
FORCE_SCALE = 0.15
"""Length of the force's arrow in this close view [m/N]."""

Point = tuple[float, float, float]


def add_arrow(scene: mujoco.MjvScene, start: np.ndarray, tip: np.ndarray, width: float, colour: Colour) -> None:
    """Draw an arrow between two points in W."""
    geom, arrow = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_ARROW
    mujoco.mjv_initGeom(
        geom, arrow, np.zeros(3), np.zeros(3), np.zeros(9), np.array((*np.array(colour) / 255, 1.0), "f4")
    )
    mujoco.mjv_connector(
        geom, arrow, width, start, start + 2 * (tip - start)
    )  # MuJoCo draws arrows at half their length
    geom.emission = 0.3
    scene.ngeom += 1


def pixel(scene: mujoco.MjvScene, point_W: np.ndarray, width: int, height: int) -> tuple[float, float]:
    """Position of a point in the picture, from the lower left corner [pixels]."""
    left, right = scene.camera
    ray = point_W - (left.pos + right.pos) / 2
    scale = height / 2 * left.frustum_near / left.frustum_top / (ray @ left.forward)
    return width / 2 + scale * (ray @ np.cross(left.forward, left.up)), height / 2 + scale * (ray @ left.up)


@dataclass(frozen=True)
class View:
    """Where the camera looks, from where, and where the arrows of the current begin, in W.

    Attributes:
        distance: of the camera from the point that it looks at [m].
        azimuth, elevation: direction in which the camera looks [deg].
        lookat: the point that it looks at [m].
        streams: starts of the current's arrows [m].
        labels: offsets of the labels of the force and of the current, right and up [pixels of a height of 720].
        scale: length of the force's arrow [m/N].
        text: size of the labels [pt in a picture of 720 pixels' height].
    """

    distance: float
    azimuth: float = 75.0
    elevation: float = -31.0
    lookat: Point = (1.03, 0.0, 0.08)
    streams: tuple[Point, ...] = ((0.74, -0.16, 0.0), (0.66, 0.03, 0.0), (0.82, 0.24, 0.0))
    labels: tuple[tuple[int, int], tuple[int, int]] = ((22, 48), (-150, -34))
    scale: float = FORCE_SCALE
    text: float = 17.0


def render(trace: Trace, width: int, height: int, view: View) -> Image.Image:
    """The picture of the last instant of a trace, with labels."""
    drawn = scene_of(trace.header)
    contact, (current,) = FORCES[0], drawn.arrows
    last = {name: trace[name][-1:] for name in trace}
    start_W, tip_W = (ends[0] for ends in contact.ends(trace.header, last, view.scale))
    streams_W = np.array(view.streams)

    model = model_of(trace.header, [trace.scenario.wall.position, 0.0, 0.0], floor=FLOOR)
    model.vis.global_.offwidth, model.vis.global_.offheight = FINER * width, FINER * height
    data = mujoco.MjData(model)
    data.qpos[:] = *trace.p_WB[-1], *trace.quat_WB[-1], *(trace.q[-1] if "q" in trace.arrays else ())
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance = view.lookat, view.distance
    camera.azimuth, camera.elevation = view.azimuth, view.elevation
    with mujoco.Renderer(model, FINER * height, FINER * width) as renderer:
        renderer.update_scene(data, camera)
        scene = renderer.scene
        scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = 1
        under_water = renderer.render()
        scene.ngeom = 0
        add_arrow(scene, start_W, tip_W, 0.013, contact.colour)
        for start in streams_W:
            add_arrow(scene, start, start + current.tip - current.start, 0.006, current.colour)
        scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = 0
        arrows = renderer.render()
        renderer.enable_segmentation_rendering()
        is_arrow = renderer.render()[..., :1] >= 0
        at_force, at_current = (pixel(scene, p, width, height) for p in (tip_W, streams_W[0]))
    fine = np.where(is_arrow, arrows, under_water).reshape(height, FINER, width, FINER, 3)
    figure = Figure(figsize=(width / 100, height / 100), dpi=100)
    canvas = FigureCanvasAgg(figure)
    figure.figimage(fine.mean(axis=(1, 3)) / 255)
    newtons = np.linalg.norm(trace.f_contact_W[-1])
    texts = (at_force, f"{contact.name} {newtons:.1f} N"), (at_current, current.label)
    for ((x, y), text), (right, up) in zip(texts, view.labels, strict=True):
        size = height / 720
        figure.text((x + right * size) / width, (y + up * size) / height, text, color="white", size=view.text * size)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])


@click.command()
@click.option(
    "--out",
    default=OUT,
    type=click.Path(path_type=Path),
    show_default="docs/push_wall.png",
    help="PNG to write.",
)
@click.option("--size", nargs=2, type=int, default=(1280, 720), help="Width and height in pixels.")
@click.option("--vehicle", default="bluerov1", show_default=True, help="Name of a vehicle that ships.")
@click.option("--distance", default=0.93, show_default=True, help="Distance of the camera in metres.")
def main(out: Path, size: tuple[int, int], vehicle: str, distance: float) -> None:
    """Render the built-in scenario at rest on the wall."""
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": DURATION_S, "vehicle.model": vehicle}))
    render(trace, *size, View(distance)).save(out, optimize=True)
    print(f"{out}: {out.stat().st_size / 1000:.0f} kB, contact force {trace.f_contact_W[-1, 0]:.3f} N")


if __name__ == "__main__":
    main()
