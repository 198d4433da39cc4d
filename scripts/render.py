"""Render the built-in scenario at rest on the wall: the first picture of the README.

    python scripts/render.py                                a PNG of 1280x720, docs/push_wall.png
    python scripts/render.py --out FILE.png --size 1920 1080
    python scripts/render.py --out FILE.png --vehicle bluerov2_heavy --distance 1.2

Wall, force and current are those of the run's scene at its end. Water, floor and textures are decoration. The orange
arrow is the force of the wall on the vehicle, the blue arrows are the ocean current. Arrows are drawn above everything
else.
"""

import os
import sys
from collections.abc import Sequence
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
from uvms_mj.files import shipped
from uvms_mj.plant.shapes import Shape
from uvms_mj.records.scene import FORCES, Colour, scene_of

OUT = Path(__file__).parents[1] / "docs" / "push_wall.png"
DURATION_S = 8.0
FINER = 2
"""Factor of supersampling, for smooth edges."""
FORCE_SCALE = 0.15
"""Length of the force's arrow in this close view [m/N]."""
FLOOR = -0.42

Point = tuple[float, float, float]


def noise(seed: int, slope: float, n: int = 1024) -> np.ndarray:
    """Periodic noise (n, n) of unit variance; a steeper slope of the spectrum makes it smoother."""
    frequency = n * np.hypot(*np.meshgrid(np.fft.fftfreq(n), np.fft.fftfreq(n)))
    white = np.random.default_rng(seed).standard_normal((n, n))
    field = np.real(np.fft.ifft2(np.fft.fft2(white) / np.maximum(frequency, 2.0) ** slope))
    return (field - field.mean()) / field.std()


def concrete() -> np.ndarray:
    """Pixels (n, n, 3) of cast concrete in panels."""
    grey = 0.61 + 0.03 * noise(1, 1.6)
    n = len(grey)
    to_joint = np.abs((np.arange(n) + n // 4) % (n // 2) - n // 4)
    grey *= 1.0 - 0.35 * np.exp(-((np.minimum.outer(to_joint, to_joint) / 2.5) ** 2))
    return to_pixels(grey, (0.97, 1.0, 0.98))


def sand() -> np.ndarray:
    """Pixels (n, n, 3) of rippled sand with caustics."""
    warp = noise(2, 1.75)
    n = len(warp)
    ripples = np.sin(2 * np.pi * 20 * np.add.outer(0.2 * np.arange(n), np.arange(n)) / n + 1.2 * warp)
    caustics = np.exp(-8.0 * np.abs(noise(3, 2.25)))
    return to_pixels(0.52 + 0.03 * ripples + 0.03 * noise(4, 1.7) + 0.16 * caustics, (0.86, 0.84, 0.70))


def to_pixels(brightness: np.ndarray, rgb: tuple[float, float, float]) -> np.ndarray:
    return (255 * np.clip(brightness[..., None] * np.array(rgb), 0, 1)).astype(np.uint8)


def picture(scenario: Scenario, walls: Sequence[Shape], bodies: Sequence[Shape] = ()) -> mujoco.MjModel:
    """The vehicle with its contact bodies under water, between a floor and the walls: a model for rendering only."""
    spec = mujoco.MjSpec.from_file(str(shipped("models")[scenario.vehicle.model]))
    spec.add_texture(
        name="water",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.30, 0.80, 0.90],
        rgb2=[0.00, 0.04, 0.12],
        width=512,
        height=3072,
    )
    for name, pixels in (("concrete", concrete()), ("sand", sand())):
        height, width, _ = pixels.shape
        kind = mujoco.mjtTexture.mjTEXTURE_2D
        spec.add_texture(name=name, type=kind, width=width, height=height, nchannel=3).data = pixels.tobytes()
        material = spec.add_material(name=name, texuniform=True, specular=0.05)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    if (acrylic := spec.material("acrylic")) is not None:
        acrylic.rgba = [0.75, 0.93, 1.0, 0.36]
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 1], pos=[0, 0, FLOOR], material="sand")
    for wall in walls:
        kind, size, quat = getattr(mujoco.mjtGeom, f"mjGEOM_{wall.kind.upper()}"), wall.size, wall.quat
        if wall.kind == "box":  # the texture is mapped to x and y, which must be the axes of the wall's face
            size, quat = tuple(np.roll(wall.size, -1)), (0.5, 0.5, -0.5, -0.5)
        spec.worldbody.add_geom(type=kind, size=size, pos=wall.position, quat=quat, material="concrete")
    for each in bodies:
        kind = getattr(mujoco.mjtGeom, f"mjGEOM_{each.kind.upper()}")
        place = {"size": each.size, "pos": each.position, "quat": each.quat}
        spec.body(scenario.vehicle.model).add_geom(type=kind, rgba=each.rgba, mass=0.0, **place)
    directional = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    sun = spec.light("sun") or spec.worldbody.add_light(name="sun", type=directional, pos=[0, 0, 2])
    sun.castshadow, sun.dir, sun.diffuse = True, [0.35, -0.25, -1.0], [0.85, 0.90, 0.90]
    visual = spec.visual
    visual.headlight.ambient, visual.headlight.diffuse = [0.34, 0.42, 0.46], [0.25, 0.27, 0.28]
    visual.quality.shadowsize, visual.quality.offsamples = 8192, 8
    visual.rgba.fog = [0.10, 0.42, 0.55, 1.0]
    visual.map.fogstart, visual.map.fogend, visual.map.shadowclip, visual.map.znear = 0.9, 4.0, 6.0, 0.02
    spec.stat.extent, spec.stat.center = 1.0, [scenario.wall.position, 0, 0]
    return spec.compile()


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
    scenario, drawn = trace.scenario, scene_of(trace.header)
    contact, (current,) = FORCES[0], drawn.arrows
    last = {name: trace[name][-1:] for name in trace}
    start_W, tip_W = (ends[0] for ends in contact.ends(trace.header, last, view.scale))
    streams_W = np.array(view.streams)

    model = picture(scenario, drawn.walls, drawn.vehicles[0].shapes[len(trace.header.geometry.shapes) :])
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
