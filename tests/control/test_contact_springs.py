"""The static forces of many poses at once are those of the loop's kernel."""

import numpy as np
import pytest

from uvms_mj import Scenario
from uvms_mj.control.theory.contacts_about_rest import contacts_about
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.control.theory.task_motion import TaskMotion
from uvms_mj.control.theory.terms import Balance, ContactSprings, ThrustMap
from uvms_mj.physics.contacts import pair_force
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.setup.base import set_up

ROUND = [
    {"shape": "sphere", "radius": 0.3, "position": [1.0, 0.0, 0.0], "stiffness": 1e4},
    {
        "shape": "cylinder",
        "radius": 0.2,
        "position": [0.0, 1.0, 0.0],
        "attitude_deg": [20.0, 30.0, 40.0],
        "layer_depth": 0.05,
        "layer_stiffness": 3e3,
    },
    {"shape": "plane", "position": [1.0, 0.0, 0.0], "attitude_deg": [3.0, 4.0, 50.0]},
]
BOX = {"shape": "box", "edges": [0.3, 0.5, 0.7], "attitude_deg": [10.0, 20.0, 30.0], "position": [0.5, -0.5, 0.2]}
SPHERES = [
    {"position": [0.2, 0.1, 0.0], "radius": 0.1},
    {"position": [0.2, -0.1, 0.0], "radius": 0.1, "stiffness": 5e3},
]
CAPSULE = {"position": [0.2, -0.1, 0.0], "end": [0.2, 0.4, 0.1], "radius": 0.05, "stiffness": 5e3}


def test_forces_and_moments_of_all_shapes_are_those_of_the_kernel():
    rng = np.random.default_rng(1)
    for walls, bodies in ((ROUND, [*SPHERES, CAPSULE]), ([*ROUND, BOX], SPHERES)):
        over = {"wall.present": False, "walls": walls, "vehicle.contact_bodies": bodies}
        setup = set_up(Scenario.load("push_wall", over))
        surfaces, pairs = setup.contacts.records(lambda _: 1.0)
        n = len(pairs)
        p, quats = rng.uniform(-0.3, 1.3, (60, 3)), rng.normal(size=(60, 4))
        p[0] = BOX["position"]  # its centre
        R = rotation_matrix(quats / np.linalg.norm(quats, axis=1, keepdims=True))
        shape = (60, n)
        at_once = ContactSprings(setup).wrenches(
            np.broadcast_to(p[:, None], (*shape, 3)), np.broadcast_to(R[:, None], (*shape, 3, 3))
        )
        expected = np.zeros((*shape, 6)), np.zeros(shape), np.zeros(shape)
        surfaces, records = surfaces.view(np.recarray), pairs.view(np.recarray)
        for i in range(60):
            for k, record in enumerate(records):
                pair_force(record, surfaces[record.surface], p[i], R[i], np.zeros(6), 1.0)
                expected[1][i, k], expected[2][i, k] = record.f_n, record.depth
                expected[0][i, k] = record.contact.tau_B if record.f_n > 0.0 else 0.0
        assert (expected[1] > 0.0).sum() > 100
        for found, kernel in zip(at_once, expected, strict=True):
            np.testing.assert_allclose(found, kernel, rtol=1e-9, atol=1e-9)


def test_the_wall_is_the_first_of_all_walls():
    """``[wall]`` and a plane of ``[[walls]]`` in its place give one rest, one thrust and one loop."""
    wall, plane = {"position": 1.1, "stiffness": 3e3, "damping": 40.0}, {"stiffness": 3e3, "damping": 40.0}
    over = {"vehicle.model": "bluerov2_heavy", "reference.target": [1.2, 0.1, 0.0], "current.speed": 0.2}
    for law in ("impedance", "gsta", "parallel"):
        first = set_up(Scenario.load("push_wall", over | {f"wall.{key}": value for key, value in wall.items()}, law))
        plane["position"] = [wall["position"] + first.plant.probe.radius, 0.0, 0.0]
        second = set_up(
            Scenario.load("push_wall", over | {"wall.present": False, "walls": [{"shape": "plane", **plane}]}, law)
        )
        ours, theirs = steady_state(first), steady_state(second)
        assert ours.force > 1.0
        for name in ("force", "position", "quat", "tau"):
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-10, atol=1e-10)
        (one,), (other,) = first.contacts_at_rest, second.contacts_at_rest
        assert (one.stiffness, one.damping) == (other.stiffness, other.damping) == (3e3, 40.0)
        np.testing.assert_allclose(one.normal, other.normal, atol=1e-12)
        np.testing.assert_allclose(np.abs(one.normal), np.abs(first.design.normal), atol=1e-12)


WALLS = {
    "hertz": {"contact": "hertz", "modulus": 6e5, "restitution": 0.7},
    "layers": {"stiffness": 2e3, "damping": 30.0, "layer_depth": 0.001, "layer_stiffness": 9e3},
}


def _sets(kinds, gaps):
    """The springs (K, C) of all sets of contacts about a pose with a wall along each of x and y, by their gaps [m], and
    the balance."""
    walls = [
        {"shape": "plane", "position": [0.15 + gaps[0], 0.0, 0.0], **WALLS[kinds[0]]},
        {"shape": "plane", "position": [0.0, 0.15 + gaps[1], 0.0], "attitude_deg": [0.0, 0.0, 90.0], **WALLS[kinds[1]]},
    ]
    over = {
        "wall.present": False,
        "walls": walls,
        "vehicle.contact_bodies": [{"position": [0.1, 0, 0], "radius": 0.05}],
    }
    over["vehicle.contact_bodies"].append({"position": [0.0, 0.1, 0.02], "radius": 0.05})
    setup = set_up(Scenario.load("push_wall", over))
    balance = Balance(setup, np.inf, ThrustMap.of(setup))
    pose = balance.pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return contacts_about(TaskMotion(balance, Balance.__call__), pose, None).springs, balance


@pytest.mark.parametrize("kind", ["hertz", "layers"])
def test_a_contact_that_opens_leaves_the_stiffness_of_the_others(kind):
    (_, (K, C)), _ = _sets((kind, "hertz"), (-0.003, -0.05))
    ((alone, damped),), _ = _sets((kind, "hertz"), (0.5, -0.05))
    np.testing.assert_allclose(K, alone, rtol=1e-6, atol=1e-6 * np.abs(alone).max())
    np.testing.assert_allclose(C, damped, rtol=1e-6, atol=1e-6 * np.abs(damped).max())


@pytest.mark.parametrize("kind", ["hertz", "layers"])
def test_a_contact_that_closes_has_the_slope_of_its_force(kind):
    ((K, C), (closed, damped)), balance = _sets((kind, "hertz"), (0.002, -0.05))
    depth, push = 0.008, balance.springs.wrenches(np.array([[0.01, 0.0, 0.0]]), np.eye(3)[None])[1][0]
    slope = 1.5 * 4.0 / 3.0 * 6e5 * (0.05 * depth) ** 0.5 if kind == "hertz" else 9e3
    damping = 30.0 if kind == "layers" else balance.springs.dissipation[0] * push
    assert damping > 0.0
    for changed, along in ((closed - K, slope), (damped - C, damping)):
        np.testing.assert_allclose(changed, along * np.diag([1, 0, 0, 0, 0, 0]), rtol=1e-5, atol=1e-5 * along)
