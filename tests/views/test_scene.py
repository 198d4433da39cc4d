"""The scene: arrows stay in it, and solids are closed."""

import mujoco
import numpy as np
import pytest

from tree_run import tree_run
from uvms_mj import Scenario, World, simulate
from uvms_mj.files import shipped
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.plant import looks
from uvms_mj.plant.geometry import Geometry, solids
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.records import scene


def test_arrows_of_a_strong_vehicle_stay_in_the_scene_and_both_viewers_have_one_scale(trace):
    header = trace.header
    span = scene.span(header)
    assert scene.force_scale(header) == scene.force_scale(header, 19.0) == scene.FORCE_SCALE
    for largest in (19.0, 30.1, 1e3, 4.7e5):
        scale = scene.force_scale(header, largest)
        assert scale * largest <= span
        assert scale == scene.FORCE_SCALE or 2.5 * scale * largest > span, "not smaller than necessary"
        assert float(f"{scale:.1g}") == pytest.approx(scale, rel=1e-12), "a round number"
    forces = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 2.0], [3e5, 0.0, 4e5]])
    drawn = scene.arrows(forces, scene.FORCE_SCALE, span)
    np.testing.assert_allclose(drawn[:2], scene.FORCE_SCALE * forces[:2], rtol=1e-15)
    assert np.linalg.norm(drawn[2]) == pytest.approx(span)
    np.testing.assert_allclose(np.cross(drawn[2], forces[2]), 0.0, atol=1e-6)


@pytest.mark.parametrize("name", shipped("models"))
def test_solids_are_closed_and_have_their_volume(name):
    geometry = Mjcf.find(name).geometry
    for solid in solids(geometry):
        np.testing.assert_allclose(np.linalg.norm(solid.normals, axis=1), 1.0, atol=1e-5)
        a, b, c = (solid.vertices[solid.triangles[:, i]].astype(float) for i in range(3))
        area = np.cross(b - a, c - a)
        np.testing.assert_allclose(area.sum(axis=0), 0.0, atol=1e-6)  # closed
        outwards = np.einsum("ij,ij->i", area, solid.normals[solid.triangles[:, 0]])
        assert np.mean(outwards[np.linalg.norm(area, axis=1) > 1e-12] > 0.0) > 0.98
    reach = max(solid.vertices[:, 0].max() for solid in solids(geometry))
    assert reach == pytest.approx(geometry.reach, abs=1e-3)


def test_walls_and_contact_bodies_are_drawn_where_they_touch():
    """The drawn shapes have the distances of the contacts: a ray along the normal meets them at the contact."""
    bodies = [
        {"position": [0.3, 0.1, 0.0], "radius": 0.05},
        {"position": [0.3, 0.2, 0.0], "end": [0.3, -0.2, 0.1], "radius": 0.03},
    ]
    walls = [
        {"shape": "plane", "position": [1.3, 0.2, 0.1], "attitude_deg": [10.0, 20.0, 30.0]},
        {"shape": "cylinder", "position": [1.5, 0.0, 0.0], "radius": 0.2, "attitude_deg": [40.0, 0.0, 0.0]},
        {"shape": "sphere", "position": [0.0, 2.0, 0.0], "radius": 0.3},
        {"shape": "box", "position": [0.0, -2.0, 0.0], "edges": [0.4, 0.6, 0.8], "attitude_deg": [0.0, 0.0, 20.0]},
    ]
    overrides = {"wall.present": False, "walls": walls[:3], "vehicle.contact_bodies": bodies}
    run = simulate(Scenario.load("push_wall", overrides | {"simulation.duration": 1e-3}), engine="free_body")
    drawn = scene.scene_of(run.header)
    plane, cylinder, sphere = drawn.walls
    face = np.array(plane.position) - plane.size[0] * rotation_matrix(np.array(plane.quat))[:, 0]
    assert face == pytest.approx(walls[0]["position"], abs=1e-12)
    assert (cylinder.kind, cylinder.size[0], sphere.kind, sphere.size[0]) == ("cylinder", 0.2, "sphere", 0.3)
    box = looks.drawn_wall(Scenario.load("push_wall", {"walls": walls[3:]}).walls[0])
    assert (box.kind, box.size) == ("box", (0.2, 0.3, 0.4))
    ball, capsule = drawn.vehicles[0].shapes[-2:]
    assert (ball.kind, ball.position, ball.size[0]) == ("sphere", (0.3, 0.1, 0.0), 0.05)
    along = capsule.size[1] * rotation_matrix(np.array(capsule.quat))[:, 2]
    ends = [np.array(capsule.position) - along, np.array(capsule.position) + along]
    assert ends[0] == pytest.approx(bodies[1]["position"], abs=1e-12)
    assert ends[1] == pytest.approx(bodies[1]["end"], abs=1e-12)
    for round_wall in (cylinder, sphere):
        (solid,) = solids(Geometry((round_wall,), {}))
        assert len(solid.triangles) > 100


def test_what_vehicles_touch_each_other_with_is_drawn_at_their_frames():
    """MuJoCo's poses of the site and of its body give the place of the surface that rides on a tool."""
    surface = {"shape": "box", "edges": [0.1, 0.2, 0.3], "position": [0.2, 0.1, 0.0], "attitude_deg": [10.0, 0.0, 40.0]}
    body = {"position": [0.3, 0.1, 0.0], "radius": 0.05}
    coupling = {"kind": "contact", "vehicles": ["a", "b"], "at": ["body", "tool"], "body": body, "surface": surface}
    arm = Mjcf.find("planar_arm")
    vehicles = [{"name": "a"}, {"name": "b", "vehicle": {"model": "planar_arm"}}, {"name": "c"}]
    world = World.from_dict({"couplings": [coupling], "controller": {"name": "none"}, "vehicles": vehicles})
    a, b, c = world.scenarios.values()
    rov = Mjcf.find(a.vehicle.model)
    assert looks.drawn_vehicle(rov.geometry, c, rov.vehicle.arm) == rov.geometry
    ball = looks.drawn_vehicle(rov.geometry, a, rov.vehicle.arm).shapes[-1]
    assert (ball.kind, ball.position, ball.size[0]) == ("sphere", (0.3, 0.1, 0.0), 0.05)
    drawn = looks.drawn_vehicle(arm.geometry, b, arm.vehicle.arm)
    assert drawn.shapes == arm.geometry.shapes
    ((link, box),) = [
        (after.name, after.shapes[-1])
        for before, after in zip(arm.geometry.links, drawn.links, strict=True)
        if after.shapes != before.shapes
    ]
    model = arm.compiled(arm.spec())
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    site, carrier = data.site("tool"), data.body(link)
    R, carried = site.xmat.reshape(3, 3), carrier.xmat.reshape(3, 3)
    own = looks.drawn_wall(b.couplings[0].surface)
    assert model.site("tool").bodyid[0] == carrier.id
    assert carrier.xpos + carried @ box.position == pytest.approx(site.xpos + R @ surface["position"], abs=1e-12)
    turned, expected = (carried @ rotation_matrix(np.array(box.quat)), R @ rotation_matrix(np.array(own.quat)))
    np.testing.assert_allclose(turned, expected, atol=1e-12)
    assert box.size == (0.05, 0.1, 0.15)


def test_a_contact_body_is_drawn_with_the_link_that_carries_it():
    bodies = [
        {"position": [0.1, 0.0, 0.0], "radius": 0.05, "body": "rod"},
        {"position": [0.3, 0.1, 0.0], "radius": 0.02},
    ]
    header = tree_run(1e-3, **{"vehicle.contact_bodies": bodies}).header
    (drawn,) = scene.scene_of(header).vehicles
    assert drawn.shapes[-1].position == (0.3, 0.1, 0.0)
    _, rod, _ = drawn.links
    assert (rod.shapes[-1].kind, rod.shapes[-1].position, rod.shapes[-1].size[0]) == ("sphere", (0.1, 0.0, 0.0), 0.05)
    more = [len(a.shapes) - len(b.shapes) for a, b in zip(drawn.links, header.geometry.links, strict=True)]
    assert more == [0, 1, 0]


def test_the_arrow_of_a_contact_is_on_its_line_of_action():
    """Of one body off the axis, with friction: the line through the arrow goes through the place of contact."""
    body = {"position": [0.3, 0.15, -0.1], "radius": 0.05, "stiffness": 2e3, "damping": 50.0}
    wall = {"shape": "plane", "position": [0.4, 0.0, 0.0], "stiffness": 1e4, "damping": 100.0, "friction": 0.3}
    keys = {"wall.present": False, "walls": [wall], "vehicle.contact_bodies": [body], "simulation.duration": 4.0}
    keys |= {"reference.target": [0.3, 0.2, 0.0], "reference.step_time": 0.0, "simulation.timestep": 1e-3}
    trace = simulate(Scenario.load("push_wall", keys), engine="free_body")
    starts, tips = scene.FORCES[0].ends(trace.header, {name: trace[name] for name in trace}, scene.FORCE_SCALE)
    pressing = np.linalg.norm(trace.f_contact_W, axis=1) > 0.5
    assert pressing.sum() > 500
    place = trace.p_WB + rotation_matrix(trace.quat_WB) @ np.array(body["position"])
    place[:, 0] = 0.5 * (place[:, 0] + 0.05 + 0.4)  # halfway between the surfaces of wall and bumper, which yield
    along = (tips - starts)[pressing]
    along /= np.linalg.norm(along, axis=1)[:, None]
    off = np.cross(place[pressing] - tips[pressing], along)
    assert np.linalg.norm(off, axis=1).max() < 1e-6
    assert np.abs(along[:, 1]).max() > 0.1, "friction"
