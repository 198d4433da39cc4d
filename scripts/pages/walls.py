"""Draw docs/walls.png: a vehicle with two bumpers on a pile, its forces and their closed form, and a wall that shakes.

    python scripts/pages/walls.py

It needs an EGL driver. The solids are those of the run's scene, as all viewers draw them.
"""

import os
import sys
from pathlib import Path

if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")  # mujoco reads it when it is imported

import mujoco
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.control.rest import SteadyState
from uvms_mj.files import shipped
from uvms_mj.plant.shapes import Shape
from uvms_mj.records.scene import scene_of

OUT = Path(__file__).parents[2] / "docs" / "walls.png"
INK, BLUE, RED, GREY = "#1f2933", "#0b5cad", "#d02a1e", "#9aa5b1"
WIDTH, HEIGHT, FINER = 420, 330, 2
WATER = (0.85, 0.91, 0.95)
COLOURS = 200
"""Colours of the PNG's palette, for a small file."""
K_C, AMPLITUDE, FREQUENCY = 2e3, 2e-3, 0.5


def add(body: mujoco.MjsBody, shape: Shape) -> None:
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{shape.kind.upper()}")
    body.add_geom(type=kind, size=shape.size, pos=shape.position, quat=shape.quat, rgba=shape.rgba)


def picture(trace: Trace) -> np.ndarray:
    """The scene (HEIGHT, WIDTH, 3) at the end of a run."""
    header = trace.header
    scene, spec = scene_of(header), mujoco.MjSpec.from_file(str(shipped("models")[header.scenario.vehicle.model]))
    own = len(header.geometry.shapes)
    for shape in scene.vehicles[0].shapes[own:]:  # the contact bodies
        add(spec.body(trace.header.mjcf.vehicle.body), shape)
    for wall in scene.walls:
        add(spec.worldbody, wall)
    flat, sky = mujoco.mjtBuiltin.mjBUILTIN_FLAT, mujoco.mjtTexture.mjTEXTURE_SKYBOX
    spec.add_texture(name="water", type=sky, builtin=flat, width=8, height=48, rgb1=WATER, rgb2=WATER)
    spec.visual.quality.offsamples = 8
    model = spec.compile()
    model.vis.global_.offwidth, model.vis.global_.offheight = FINER * WIDTH, FINER * HEIGHT
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    data.qpos[:] = *trace.p_WB[-1], *trace.quat_WB[-1]
    mujoco.mj_forward(model, data)
    camera.lookat, camera.distance, camera.azimuth, camera.elevation = [1.2, 0, 0.02], 1.35, 55.0, -42.0
    with mujoco.Renderer(model, FINER * HEIGHT, FINER * WIDTH) as renderer:
        renderer.update_scene(data, camera)
        fine = renderer.render().reshape(HEIGHT, FINER, WIDTH, FINER, 3)
    return fine.mean(axis=(1, 3)) / 255


def shaken() -> Trace:
    """The ideal law pressing on a plane that moves to and fro."""
    wall = {"shape": "plane", "position": [1.241, 0.0, 0.0], "stiffness": K_C}
    moving = wall | {"amplitude": [AMPLITUDE, 0.0, 0.0], "frequency_hz": FREQUENCY}
    overrides = {"wall.present": False, "walls": [moving], "reference.target": [1.05, 0.0, 0.0]}
    return simulate(Scenario.load("push_wall", overrides, "ideal"), engine="free_body", log_rate=200.0)


def response(trace: Trace) -> np.ndarray:
    """The force on the wall: M_d x'' + D_d x' + K_d (x - x_d) = -F, F = k_c (x - w), in closed form."""
    from uvms_mj.analysis.setup import set_up

    design, s = set_up(trace.scenario).design, 2j * np.pi * FREQUENCY
    M, D, K = (float(each[0, 0]) for each in (design.M_d, design.D_d, design.K_d))
    x_c = 1.241 - trace.header.geometry.reach
    X = K_C * AMPLITUDE / (M * s * s + D * s + K + K_C)
    mean = K * (1.05 - x_c) / (1.0 + K / K_C)
    return mean + (K_C * (X - AMPLITUDE) * np.exp(s * trace.t)).imag


def main() -> None:
    """Draw the picture."""
    pile = simulate(Scenario.load("press_pile", {"simulation.duration": 10.0}), engine="free_body", log_rate=200.0)
    shaking = shaken()
    figure = Figure(figsize=(11.2, 3.3), dpi=100, layout="constrained")
    scene, forces, motion = figure.subplots(1, 3, width_ratios=(1.25, 1.0, 1.0))
    scene.imshow(picture(pile))
    scene.axis("off")
    scene.set_title("press_pile: two bumpers on a pile", fontsize=10, color=INK)
    forces.plot(pile.t, pile.f_normal, color=BLUE, lw=1.2, label="sum of the normal forces")
    rest = pile.analytic
    assert isinstance(rest, SteadyState)
    forces.axhline(rest.force, color=RED, lw=1.0, ls="--", label=f"static balance, {rest.force:.3f} N")
    forces.set(xlim=(3.5, 10.0), xlabel="t [s]", ylabel="push [N]")
    late = shaking.t > 14.0
    motion.plot(shaking.t[late], shaking.push[late], color=BLUE, lw=1.2, label="a wall that shakes by 2 mm")
    motion.plot(shaking.t[late], response(shaking)[late], color=RED, lw=1.0, ls="--", label="closed form")
    motion.set(xlim=(14.0, 20.0), xlabel="t [s]", ylabel="push [N]")
    motion.margins(y=0.35)
    for axes in (forces, motion):
        axes.grid(color=GREY, alpha=0.3)
        axes.legend(fontsize=8, loc="upper right")
    difference = np.abs(shaking.push[late] - response(shaking)[late]).max() / np.ptp(response(shaking)[late])
    figure.savefig(OUT)
    Image.open(OUT).convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE).save(OUT, optimize=True)
    print(f"{OUT}: {OUT.stat().st_size / 1000:.0f} kB, largest difference of the right panel {difference:.1e}")


if __name__ == "__main__":
    main()
