"""Render the shipped scenario at rest on the wall: the picture that opens the README.

    python scripts/render.py                                a PNG of 1280x720 in docs/push_wall.png
    python scripts/render.py --out FILE.png --size 1920x1080

The pose and the force are those at the end of a run; everything else here is looks. Red arrow: force of the wall on the vehicle.
Blue arrows: the ocean current. Both arrows are drawn on top of what hides them.
"""

import os
import sys
from pathlib import Path

if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")  # read when mujoco is imported

import click
import matplotlib.pyplot as plt
import mujoco
import numpy as np

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.plant import build
from uvms_mj.resources import resource

OUT = Path(__file__).parents[1] / "docs" / "push_wall.png"
DURATION_S = 8.0
FINER = 2
"""Rendered this many times finer, then averaged: smooth edges."""
FORCE_SCALE = 0.2
"""Length of the force's arrow [m/N]."""
CURRENT_SCALE = 0.5
"""Length of the current's arrows [s]."""
RED, BLUE = (0.93, 0.16, 0.13, 1.0), (0.35, 0.72, 1.0, 1.0)


def noise(rng: np.random.Generator, n: int, octaves: int) -> np.ndarray:
    """(n, n) smooth noise with zero mean, about one in size, that repeats at its edges."""
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(n), np.fft.fftfreq(n))) * n
    spectrum = np.fft.fft2(rng.standard_normal((n, n))) / np.maximum(frequency, 2.0) ** (octaves / 4)
    field = np.real(np.fft.ifft2(spectrum))
    return (field - field.mean()) / field.std()


def concrete(n: int = 1024) -> np.ndarray:
    """(n, n, 3) cast concrete in four panels, with joints."""
    rng = np.random.default_rng(1)
    grey = 0.62 + 0.03 * noise(rng, n, 5)
    edge = np.abs((np.arange(n) + n // 4) % (n // 2) - n // 4)
    joint = np.exp(-((np.minimum.outer(edge, edge) / 2.5) ** 2))
    grey *= 1.0 - 0.35 * joint
    return np.uint8(255 * np.clip(grey[..., None] * [0.97, 1.0, 0.98], 0, 1))


def sand(n: int = 1024) -> np.ndarray:
    """(n, n, 3) rippled sand."""
    rng = np.random.default_rng(2)
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    ripple = np.sin(2 * np.pi * 20 * (x + 0.2 * y) / n + 1.2 * noise(rng, n, 7))
    caustics = np.exp(-np.abs(noise(rng, n, 9)) * 8)
    light = 0.52 + 0.03 * ripple + 0.03 * noise(rng, n, 5) + 0.16 * caustics
    return np.uint8(255 * np.clip(light[..., None] * [0.86, 0.84, 0.70], 0, 1))


def picture(scenario: Scenario) -> mujoco.MjModel:
    """The vehicle alone, under water in front of a wall."""
    spec = mujoco.MjSpec.from_file(str(resource("models", f"{scenario.vehicle.model}.xml")))
    two_d, cube = mujoco.mjtTexture.mjTEXTURE_2D, mujoco.mjtTexture.mjTEXTURE_SKYBOX
    spec.add_texture(
        name="water",
        type=cube,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.30, 0.80, 0.90],
        rgb2=[0.0, 0.04, 0.12],
        width=512,
        height=3072,
    )
    for name, pixels in (("concrete", concrete()), ("sand", sand())):
        height, width, _ = pixels.shape
        texture = spec.add_texture(name=name, type=two_d, width=width, height=height, nchannel=3)
        texture.data = pixels.tobytes()
        material = spec.add_material(name=name, texuniform=True, specular=0.05)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        material.texrepeat = [1.0, 1.0]
    spec.material("acrylic").rgba = [0.75, 0.93, 1.0, 0.36]
    face = scenario.wall.position + build(scenario).reach
    plane, box = mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_BOX
    solid = {"contype": 0, "conaffinity": 0}
    floor = -0.42
    spec.worldbody.add_geom(type=plane, size=[20, 20, 1], pos=[0, 0, floor], material="sand", **solid)
    spec.worldbody.add_geom(  # its own z axis is -x of W, its own x axis -y
        type=box,
        size=[0.75, 0.75, 0.06],
        pos=[face + 0.06, 0.0, floor + 0.5],
        quat=[0.5, 0.5, -0.5, -0.5],
        material="concrete",
        **solid,
    )
    sun = spec.light("sun")
    sun.castshadow, sun.dir, sun.diffuse = True, [0.35, -0.25, -1.0], [0.85, 0.9, 0.9]
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.34, 0.42, 0.46], [0.25, 0.27, 0.28]
    spec.visual.quality.shadowsize = 8192
    spec.visual.quality.offsamples = 8
    spec.visual.rgba.fog = [0.10, 0.42, 0.55, 1.0]
    spec.visual.map.fogstart, spec.visual.map.fogend = 0.9, 4.0
    spec.visual.map.shadowclip = 3.0
    spec.stat.extent = 1.0
    spec.stat.center = [face, 0, 0]
    spec.visual.map.znear = 0.02
    return spec.compile()


def add_arrow(scene: mujoco.MjvScene, start, end, width: float, rgba) -> None:
    """An arrow from start to end, points in W."""
    geom = scene.geoms[scene.ngeom]
    arrow = mujoco.mjtGeom.mjGEOM_ARROW
    mujoco.mjv_initGeom(geom, arrow, np.zeros(3), np.zeros(3), np.zeros(9), np.array(rgba, dtype=np.float32))
    mujoco.mjv_connector(geom, arrow, width, np.asarray(start, dtype=float), np.asarray(end, dtype=float))
    geom.emission = 0.3
    scene.ngeom += 1


def add_arrows(scene: mujoco.MjvScene, trace: Trace) -> None:
    """Contact force and current."""
    current = trace.scenario.current
    beta = np.deg2rad(current.direction_deg)
    drift = CURRENT_SCALE * current.speed * np.array([np.cos(beta), np.sin(beta), 0.0])
    tip = trace.p_WB[-1] + [build(trace.scenario).reach, 0.0, 0.0]
    add_arrow(scene, tip, tip + FORCE_SCALE * trace.f_contact_W[-1], 0.012, RED)
    for start in ([0.72, -0.2, 0.0], [0.64, 0.0, 0.0], [0.8, 0.22, 0.0]):
        add_arrow(scene, start, start + drift, 0.005, BLUE)


def pixel(scene: mujoco.MjvScene, point_W, width: int, height: int) -> tuple[float, float]:
    """Where a point appears in the picture, from its upper left corner."""
    eyes = scene.camera
    up, forward = np.array(eyes[0].up), np.array(eyes[0].forward)
    ray = np.asarray(point_W) - (eyes[0].pos + eyes[1].pos) / 2
    scale = height / 2 * eyes[0].frustum_near / eyes[0].frustum_top / (ray @ forward)
    return width / 2 + scale * (ray @ np.cross(forward, up)), height / 2 - scale * (ray @ up)


def render(trace: Trace, width: int, height: int) -> np.ndarray:
    """(height, width, 3) picture of a trace's last instant."""
    model = picture(trace.scenario)
    model.vis.global_.offwidth, model.vis.global_.offheight = FINER * width, FINER * height
    data = mujoco.MjData(model)
    data.qpos[:] = *trace.p_WB[-1], *trace.quat_WB[-1]
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance = [1.03, 0.0, 0.1], 1.0
    camera.azimuth, camera.elevation = 75.0, -31.0
    with mujoco.Renderer(model, FINER * height, FINER * width) as renderer:
        renderer.update_scene(data, camera)
        scene = renderer.scene
        scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = 1
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 1
        behind = renderer.render().astype(float)
        scene.ngeom = 0
        add_arrows(scene, trace)
        scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = 0
        arrows = renderer.render().astype(float)
        tip=np.array([1.241,0,0]); print([pixel(scene,tip+[-x,0,0],width,height) for x in (0,.15,.3)])
        renderer.enable_segmentation_rendering()
        drawn = renderer.render()[..., :1] >= 0
    fine = np.where(drawn, arrows, behind)
    return np.uint8(fine.reshape(height, FINER, width, FINER, 3).mean(axis=(1, 3)).round())


@click.command(help=__doc__)
@click.option("--out", default=OUT, type=click.Path(path_type=Path), help="PNG to write.  [default: docs/push_wall.png]")
@click.option("--size", default="1280x720", show_default=True, help="Width and height in pixels.")
def main(out: Path, size: str) -> None:
    width, height = (int(n) for n in size.split("x"))
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": DURATION_S}))
    plt.imsave(out, render(trace, width, height))
    print(f"{out}: contact force {trace.f_contact_W[-1, 0]:.3f} N, {out.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
