"""The looks of a Simulation's model: they change no number, follow the run, and make a picture."""

import os
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from uvms_mj import Scenario, Simulation
from uvms_mj.plant import looks
from uvms_mj.plant.geometry import Geometry, solids

ONLY_LOOKS = ("skin", "tex", "cam", "name", "path", "vis", "stat")
"""Beginnings of the names of the arrays of a model that looks may change."""
SCENARIOS = {
    "push_wall": {},
    "tool_push": {"vehicle.mass": 1.1},
    "press_pile": {"simulation.timestep": 1e-3},
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_looks_change_neither_the_model_nor_a_step(name):
    scenario = Scenario.load(name, SCENARIOS[name])
    with Simulation(scenario) as seen, Simulation(scenario, looks=False) as bare:
        assert (seen.model.nskin > 0, seen.model.ncam, seen.model.nlight) == (True, 1, 1)
        assert bare.model.nskin == bare.model.ntex == 0
        for each in dir(bare.model):
            value = getattr(bare.model, each)
            if isinstance(value, np.ndarray) and each[0] != "_" and not each.startswith(ONLY_LOOKS):
                assert np.array_equal(value, getattr(seen.model, each)), each
        assert seen.model.stat.meaninertia == bare.model.stat.meaninertia
        for sim in (seen, bare):
            sim.step(300)
        for each in ("qpos", "qvel", "qacc", "sensordata", "ctrl"):
            assert np.array_equal(getattr(seen.data, each), getattr(bare.data, each)), each
        assert all(np.array_equal(seen.signals[each], bare.signals[each]) for each in bare.signals)


def in_world(sim: Simulation) -> dict[str, np.ndarray]:
    """Vertices (n, 3) in W of each skin, by the bodies that carry them."""
    mujoco.mj_kinematics(sim.model, sim.data)
    model, found = sim.model, {}
    for i in range(model.nskin):
        bone = model.skin_bonebodyid[model.skin_boneadr[i]]
        first, n = model.skin_vertadr[i], model.skin_vertnum[i]
        R = sim.data.xmat[bone].reshape(3, 3)
        found[model.skin(i).name] = model.skin_vert[first : first + n] @ R.T + sim.data.xpos[bone]
    return found


def test_every_shape_is_a_skin_of_the_body_that_carries_it():
    """The vertices are those of the run's scene, whose links have poses of their own computation."""
    with Simulation(Scenario.load("tool_push")) as sim:
        sim.step(2000)
        geometry, drawn = sim.setup.plant.geometry, in_world(sim)
        R, p, q = np.zeros(9), sim.data.qpos[:3], sim.data.qpos[7:]
        mujoco.mju_quat2Mat(R, sim.data.qpos[3:7])
        R = R.reshape(3, 3)
        poses = []
        for i, link in enumerate(geometry.links):
            R_P, p_P = poses[link.parent] if link.parent >= 0 else (R, p)
            at, quat = link.pose(q[i : i + 1])
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, quat[0])
            poses.append((R_P @ turn.reshape(3, 3), p_P + R_P @ at[0]))
        carriers = [(sim.setup.vehicle.body, geometry.shapes, (R, p))]
        carriers += [(link.name, link.shapes, pose) for link, pose in zip(geometry.links, poses, strict=True)]
        for name, shapes, (R_C, p_C) in carriers:
            for k, solid in enumerate(solids(Geometry(shapes, geometry.meshes))):
                expected = solid.vertices @ R_C.T + p_C
                assert drawn[f"uvms_mj/{name} {k + 1}"] == pytest.approx(expected, abs=1e-6)


def test_walls_are_drawn_where_a_reset_puts_them():
    pile = {"shape": "cylinder", "radius": 0.2, "position": [1.4, 0.3, 0.0]}
    with Simulation(Scenario.load("push_wall", {"walls": [pile]})) as sim:
        sim.reset({"wall.position": 1.7, "walls[0].radius": 0.1, "walls[0].position": [2.0, 0.0, 0.5]})
        drawn = in_world(sim)
        plate, cylinder = drawn["uvms_mj/wall 1 1"], drawn["uvms_mj/wall 2 1"]
        assert plate[:, 0].min() == pytest.approx(1.7 + sim.setup.plant.probe.radius, abs=1e-6)
        assert np.hypot(cylinder[:, 0] - 2.0, cylinder[:, 1]).max() == pytest.approx(0.1, abs=1e-6)
        assert (cylinder[:, 2].min() + cylinder[:, 2].max()) / 2 == pytest.approx(0.5, abs=1e-6)
        sim.reset()
        assert in_world(sim)["uvms_mj/wall 2 1"][:, 0].mean() == pytest.approx(1.4, abs=0.05)


def test_a_vehicle_without_a_light_gets_one():
    cube = Path(__file__).parents[2] / "examples" / "cube.xml"
    assert "<light" not in cube.read_text()
    with Simulation(Scenario.load("push_wall", {"vehicle.model": str(cube)})) as sim:
        assert sim.model.nlight == 1
        assert {looks.OVERVIEW} == {sim.model.camera(i).name for i in range(sim.model.ncam)}


def test_a_picture_shows_the_vehicle_where_it_is(tmp_path):
    """Three lines of a user's loop draw it. The vehicle's pixels are those that change when it is hidden."""
    done = subprocess.run(
        [sys.executable, "-c", PICTURE, tmp_path], env=os.environ | {"MUJOCO_GL": "egl"}, capture_output=True, text=True
    )
    if done.returncode and not (tmp_path / "seen.npy").exists():
        pytest.skip(f"no offscreen renderer: {done.stderr.strip().splitlines()[-1]}")
    before, after, empty = (np.load(tmp_path / f"{name}.npy").astype(int) for name in ("start", "seen", "empty"))
    assert empty.mean() > 20.0  # water, not black
    columns = []
    for picture in (before, after):
        changed = np.abs(picture - empty).sum(axis=2) > 30
        assert 0.005 < changed.mean() < 0.5
        columns.append(np.argwhere(changed)[:, 1].mean())
    assert columns[1] - columns[0] > 20.0  # the vehicle moved towards the wall, to the right


PICTURE = """
import sys, mujoco, numpy as np
try:
    from uvms_mj import Scenario, Simulation
    sim = Simulation(Scenario.load("push_wall", {"reference.step_time": 0.0, "simulation.timestep": 1e-3}))
    renderer = mujoco.Renderer(sim.model, 240, 320)
except Exception as error:
    sys.exit(f"{type(error).__name__}: {error}")
for name, steps in (("start", 0), ("seen", 8000)):
    sim.step(steps)
    renderer.update_scene(sim.data, "overview")
    np.save(f"{sys.argv[1]}/{name}.npy", renderer.render())
hidden = [i for i in range(sim.model.nskin) if "wall" not in sim.model.skin(i).name]
sim.model.skin_group[hidden] = 5  # which is not shown
renderer.update_scene(sim.data, "overview")
np.save(f"{sys.argv[1]}/empty.npy", renderer.render())
"""
