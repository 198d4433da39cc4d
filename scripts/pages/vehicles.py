"""docs/physics/vehicles.md: the vehicles that ship, from the front and from behind, with an arm from the side.

The picture needs an EGL driver. Variants of a frame look alike, so each frame is drawn once.
"""

import os
import re
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")  # mujoco reads it when it is imported

import mujoco
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.files import shipped
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.plant.description import reach
from uvms_mj.plant.mjcf import Mjcf

OUT = Path(__file__).parents[2] / "docs" / "physics" / "vehicles.png"
FRAMES = {
    "bluerov1": (0.78, 0.0, ()),
    "bluerov2": (0.78, 0.0, ()),
    "lauv": (1.25, 0.0, ()),
    "bluerov2_heavy": (0.92, 0.0, ()),
    "bluerov2_alpha5": (1.12, 0.18, (0.5, 1.7, 2.1, 0.6)),
    "planar_arm": (1.3, 0.26, (0.6, -0.9)),
}
"""Vehicles: distance of the camera, x that it looks at [m], and positions of the joints [rad]."""
COLUMNS = 3
VIEWS = {"from the front": (212.0, -20.0), "from behind": (328.0, -24.0)}
"""Azimuth and elevation of the camera [deg]."""
FROM_THE_SIDE = (265.0, -8.0)
"""In place of the view from behind, which hides an arm."""
WIDTH, HEIGHT, FINER = 330, 250, 2
WATER = (0.85, 0.91, 0.95)
COLOURS = 256
"""Colours of the PNG's palette, for a small file."""


def views_of(name: str, distance: float, ahead: float, joints: tuple[float, ...]) -> list[np.ndarray]:
    """Pictures (HEIGHT, WIDTH, 3) of a vehicle, one for each view."""
    spec = mujoco.MjSpec.from_file(str(shipped("models")[name]))
    kind, builtin = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_FLAT
    spec.add_texture(name="water", type=kind, builtin=builtin, width=8, height=48, rgb1=WATER, rgb2=WATER)
    spec.visual.quality.offsamples = 8
    model = spec.compile()
    model.vis.global_.offwidth, model.vis.global_.offheight = FINER * WIDTH, FINER * HEIGHT
    data = mujoco.MjData(model)
    data.qpos[7:] = joints
    mujoco.mj_forward(model, data)
    pictures = []
    with mujoco.Renderer(model, FINER * HEIGHT, FINER * WIDTH) as renderer:
        front, behind = VIEWS.values()
        for azimuth, elevation in (front, FROM_THE_SIDE if joints else behind):
            camera = mujoco.MjvCamera()
            camera.lookat, camera.distance = [ahead, 0, -0.3 * ahead], distance
            camera.azimuth, camera.elevation = azimuth, elevation
            renderer.update_scene(data, camera)
            fine = renderer.render().reshape(HEIGHT, FINER, WIDTH, FINER, 3)
            pictures.append(fine.mean(axis=(1, 3)) / 255)
    return pictures


def pushed(vehicle: str) -> Trace:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return simulate(Scenario.load("push_wall", {"vehicle.model": vehicle}), engine="free_body", log_rate=1000)


def numbers() -> Iterator[tuple]:
    page = (OUT.parent / "vehicles.md").read_text()
    for name in shipped("models"):
        vehicle = Mjcf.find(name).vehicle
        (printed,) = re.findall(rf"^\| \[{name}\]\(\S+\) \| [\d.]+, [\d.]+", page, re.MULTILINE)
        of = printed.rpartition("|")[0] + "| {}, {}"
        yield of, *(sum(getattr(k, what) for k in (vehicle, *vehicle.arm.links)) for what in ("mass", "displaced_mass"))
    trace, heavy = pushed("bluerov2"), pushed("bluerov2_heavy")
    pitch = np.degrees(-np.arcsin(rotation_matrix(trace.quat_WB)[:, 2, 0]))
    yield "(it reaches {} rad/s^2)", np.abs(trace.z).max()
    yield (
        "pitches by up to {} deg and hits the wall with {} N, where the Heavy hits it with {} N",
        np.abs(pitch).max(),
        trace.force_peak[-1],
        heavy.force_peak[-1],
    )
    arm = Mjcf.find("bluerov2_alpha5").vehicle.arm
    yield "with a reach of {} m", reach(arm, "tool")
    (upper,) = (link for link in arm.links if link.displaced_mass == max(k.displaced_mass for k in arm.links))
    yield "{} kg across the upper arm", upper.M_A[2, 2]


def main() -> None:
    """Draw the picture."""
    columns = [np.vstack(views_of(name, *look)) for name, look in FRAMES.items()]
    rows = np.vstack([np.hstack(columns[i : i + COLUMNS]) for i in range(0, len(columns), COLUMNS)])
    height, width, _ = rows.shape
    figure = Figure(figsize=(width / 100, height / 100), dpi=100)
    figure.figimage(rows)
    for i, name in enumerate(FRAMES):
        x, y = i % COLUMNS * WIDTH + 10, height - i // COLUMNS * len(VIEWS) * HEIGHT - 22
        figure.text(x / width, y / height, name, size=11, color="#10304a")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]).quantize(COLOURS, Image.Quantize.MAXCOVERAGE).save(
        OUT, optimize=True
    )
    print(f"{OUT}: {OUT.stat().st_size / 1000:.0f} kB")
