"""Cylinders and spheres near a wall, on the base and on links: added masses by their multipoles, and the motion by
Lagrange's equations, differentiated numerically."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from random_trees import (
    drag_free,
    load_tree,
    neutral,
    place_tree,
    random_state,
    random_tree,
    still,
    tree_acceleration,
    tree_state,
    water_of_tree,
)
from tree_twin import acceleration, inertia, momentum_W, poses, velocities
from twin import rotation
from uvms_mj import InputError, NearWall, Scenario, attach, simulate
from uvms_mj.physics.kernels import record_of
from uvms_mj.physics.near_wall import HULL, cylinder_mass, sphere_mass, tensor
from uvms_mj.plant.settings import Situation

TABLE = {  # h/a, design numbers of the project
    1.01: 2.034029,
    1.05: 1.783295,
    1.1: 1.634506,
    1.25: 1.416147,
    1.5: 1.258781,
    2.0: 1.134576,
    3.0: 1.057238,
}


def by_multipoles(h, terms=500):
    """The added mass of a cylinder of radius 1 beside its mirror image, over that of the water it displaces."""
    k = np.arange(1, terms + 1)
    gamma = np.array([math.lgamma(i) for i in range(1, 2 * terms + 2)])  # gamma[i] = ln i!
    images = np.exp(gamma[k[:, None] + k - 1] - gamma[k[:, None]] - gamma[k - 1] - (k[:, None] + k) * math.log(2.0 * h))
    x = np.linalg.solve(k[:, None] * images - np.diag(k.astype(float)), np.eye(terms)[0])
    return -(x[0] + images[0] @ x)


def test_added_masses_of_a_cylinder_are_those_of_its_multipoles():
    for h, mass in TABLE.items():
        assert cylinder_mass(1.0 / h)[0] + 1.0 == pytest.approx(mass, abs=1e-6)
    for h in (1.02, 1.2, 1.9, 2.3, 2.4, 4.0, 9.0):
        assert cylinder_mass(1.0 / h)[0] + 1.0 == pytest.approx(by_multipoles(h), abs=2e-9)
    assert cylinder_mass(1.0 - 1e-12)[0] == pytest.approx(math.pi**2 / 3.0 - 2.0, abs=1e-5)  # at the touch
    assert cylinder_mass(1e-6)[0] == pytest.approx(0.5e-12, rel=1e-9)


@pytest.mark.parametrize("t", [0.01, 0.3, 0.42, 0.43, 0.7, 0.95, 0.999])
def test_the_slope_of_a_cylinders_mass_is_the_derivative(t):
    e = 1e-5 * t * (1.0 - t)
    found = (cylinder_mass(t + e)[0] - cylinder_mass(t - e)[0]) / (2.0 * e)
    assert t * cylinder_mass(t)[1] == pytest.approx(found, rel=1e-7)


NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
RADIUS, CENTRE = 0.1, np.array([0.11, -0.05, 0.07])


def near(shape, link, state, tree, gap=0.05, tilt=0.4):
    """A wall beside a link in a state, and a body on this link."""
    p, quat, q, _ = state
    R, origin = poses(tree, p, rotation(quat), q)[link]
    e, across = np.array([0.48, 0.6, 0.64]), np.array([0.8, 0.0, -0.6])
    n = R @ (math.cos(tilt) * across + math.sin(tilt) * e)
    reach, own = RADIUS, {}
    if shape != "sphere":
        own = {"shape": shape, "axis": tuple(e), "length": 0.5 if shape == "cylinder" else 0.36}
        reach = RADIUS * math.cos(tilt) + 0.5 * own["length"] * math.sin(abs(tilt))
    point = origin + R @ CENTRE - (reach + gap) * n
    return NearWall(radius=RADIUS, position=tuple(CENTRE), point=tuple(point), normal=tuple(n), **own)


def mass(table, tree, link, p, R, q):
    """The inertia (6 + n, 6 + n) of the water that the wall adds."""
    R_L, origin = poses(tree, p, R, q)[link]
    nu = np.array([velocities(tree, q, unit)[link] for unit in np.eye(6 + tree.n)])  # per unit of each velocity
    n, point, a, rho = R_L.T @ np.array(table.normal), np.array(table.point), table.radius, table.density

    def at(r):
        return nu[:, :3] + np.cross(nu[:, 3:], r), np.array(table.normal) @ (origin + R_L @ r - point)

    if table.shape == "sphere":
        v, h = at(CENTRE)
        m_n, m_t, _, _ = sphere_mass(h / a - 1.0)
        return rho * 4.0 / 3.0 * math.pi * a**3 * v @ (m_t * np.eye(3) + (m_n - m_t) * np.outer(n, n)) @ v.T
    e, found = np.array(table.axis), 0.0
    if table.shape == "spheroid":
        v, h = at(CENTRE)
        A, B, C, D = of_spheroid(table, n @ e, h)
        both = np.outer(n, e) + np.outer(e, n)
        return v @ (A * np.eye(3) + B * np.outer(n, n) + C * np.outer(e, e) + D * both) @ v.T
    for s, w in zip(0.5 * table.length * NODES, 0.5 * table.length * WEIGHTS, strict=True):
        v, h = at(CENTRE + s * e)
        section = h / math.sqrt(1.0 - (n @ e) ** 2)  # the distance of the wall across the axis
        strip = rho * math.pi * a**2 * cylinder_mass(a / section)[0]
        found = found + w * strip * v @ (np.eye(3) - np.outer(e, e)) @ v.T
    return found


def of_spheroid(table, s, h):
    """A, B, C and D [kg] at the distance h from the wall, whose normal has the part s along the axis."""
    W = np.zeros((4, 3))
    tensor(record_of(np.array(replace(table, link=None).records(Situation()), HULL)), s, h, W)
    return W[:, 0]


def turned(quat, phi):
    half = 0.5 * np.asarray(phi)
    w, x = quat[0], quat[1:]
    moved = np.r_[w - x @ half, x + w * half + np.cross(x, half)]
    return moved / np.linalg.norm(moved)


def by_lagrange(table, tree, link, state, tau, t):
    """zeta_dot by the equations of Boltzmann and Hamel for the energy of the water at the wall: momenta and their rates
    by differences of the inertia alone."""
    p, quat, q, zeta = state
    h = 1e-6

    def at(x):
        moved = p + rotation(quat) @ x[:3], rotation(turned(quat, x[3:6])), q + x[6:]
        return mass(table, tree, link, *moved)

    def slope(x):
        return (at(h * x) - at(-h * x)) / (2.0 * h)

    M = at(0.0 * zeta)
    momentum, v, omega = M @ zeta, zeta[:3], zeta[3:6]
    left = slope(zeta) @ zeta - np.array([0.5 * zeta @ slope(e) @ zeta for e in np.eye(len(zeta))])
    left[:3] += np.cross(omega, momentum[:3])
    left[3:6] += np.cross(omega, momentum[3:6]) + np.cross(v, momentum[:3])
    without = inertia(tree, q) @ acceleration(tree, rotation(quat), q, zeta, tau, t)
    return np.linalg.solve(inertia(tree, q) + M, without - left)


@given(st.integers(0, 2**32 - 1), st.sampled_from(["cylinder", "sphere", "spheroid"]), st.sampled_from([0, 1, 3]))
def test_the_acceleration_of_a_random_tree_at_a_wall_is_that_of_lagranges_equations(seed, shape, link):
    """Also in a current, which the water at the wall does not see, with added mass and drag on every body."""
    tree = random_tree(seed, 3)
    state, rng = random_state(tree, seed), np.random.default_rng(seed)
    table = near(shape, link, state, tree, tilt=float(rng.uniform(-1.2, 1.2)))
    tau, t = rng.normal(size=9) * 10.0, 1.3
    model, data = load_tree(tree)
    if link:
        table = replace(table, link=f"link{link}")
    place_tree(data, state)
    data.time, data.ctrl[:] = t, tau
    with attach(model, data, "rov", near_wall=table, **water_of_tree(tree)):
        mujoco.mj_forward(model, data)
    found, expected = tree_acceleration(data, 3), by_lagrange(table, tree, link, state, tau, t)
    far = acceleration(tree, rotation(state[1]), state[2], state[3], tau, t)
    assert np.linalg.norm(found - expected) <= 1e-6 * np.linalg.norm(expected)
    assert np.linalg.norm(found - far) > 1e-4 * np.linalg.norm(expected)


def thrown(timestep, link, shape="cylinder", seconds=0.2):
    """Changes of energy and of the momentum along the wall of a neutral tree without drag that is thrown past a wall,
    relative to their sizes; and the greatest share of the water at the wall in the energy."""
    tree = neutral(drag_free(still(random_tree(4, 3))))
    state = random_state(tree, 4, rate=0.3)
    table = near(shape, link, state, tree, gap=0.1, tilt=0.3)
    model, data = load_tree(tree, timestep=timestep, integrator="RK4")
    if link:
        table = replace(table, link=f"link{link}")
    place_tree(data, state)
    data.qvel[:3] -= 0.3 * np.array(table.normal)  # towards the wall
    n, shares = np.array(table.normal), []

    def kept():
        p, quat, q, zeta = tree_state(data, 3)
        R = rotation(quat)
        own, wall = zeta @ inertia(tree, q) @ zeta, mass(table, tree, link, p, R, q) @ zeta
        shares.append(zeta @ wall / (own + zeta @ wall))
        momentum = momentum_W(tree, p, R, q, zeta)[:3] + R @ wall[:3]
        return np.r_[0.5 * (own + zeta @ wall), momentum - (n @ momentum) * n]

    with attach(model, data, "rov", near_wall=table):
        before = kept()
        for _ in range(10):
            mujoco.mj_step(model, data, round(0.1 * seconds / timestep))
            after = kept()
    return (
        abs(after[0] / before[0] - 1.0),
        np.linalg.norm(after[1:] - before[1:]) / np.linalg.norm(before[1:]),
        max(shares),
    )


@pytest.mark.parametrize("shape", ["cylinder", "sphere", "spheroid"])
@pytest.mark.parametrize("link", [0, 3])
def test_a_tree_thrown_past_a_wall_keeps_energy_and_the_momentum_along_the_wall(link, shape):
    """Of second order with RK4, as MuJoCo turns the base."""
    errors = np.array([thrown(h, link, shape) for h in (4e-3, 2e-3, 1e-3)])
    assert errors[2, 0] < 1e-9
    assert errors[2, 1] < 5e-9
    assert (errors[:-1, :2] > 3.0 * errors[1:, :2]).all()
    assert errors[2, 2] > 1e-4


def test_engines_agree_on_a_landing_with_a_cylinder_and_the_rest_is_that_without_it():
    cylinder = {"shape": "cylinder", "radius": 0.15, "length": 0.5, "axis": [0.3, 1.0, 0.2]}
    over = {"near_wall": [cylinder], "simulation.duration": 4.0}
    first, second = (simulate(Scenario.load("push_wall", over), engine=each) for each in ("free_body", "mujoco"))
    np.testing.assert_allclose(first.p_WB, second.p_WB, atol=2e-7)
    without = simulate(Scenario.load("push_wall", {"simulation.duration": 4.0}), engine="free_body")
    assert first.analytic.force == without.analytic.force
    assert np.abs(first.p_WB - without.p_WB).max() > 1e-8


ARM = {"simulation.duration": 6.0, "simulation.timestep": 4e-4}
FOREARM = {"shape": "cylinder", "link": "forearm", "radius": 0.03, "length": 0.2, "position": [0.1, 0.0, 0.0]}


def test_an_arm_pushes_at_a_wall_with_the_water_about_its_links():
    """The motion is another one, the rest is the same."""
    with_water, without = (simulate(Scenario.load("tool_push", ARM | over)) for over in ({"near_wall": [FOREARM]}, {}))
    assert np.abs(with_water.tau_q - without.tau_q).max() > 1e-3
    assert with_water.analytic.force == without.analytic.force
    assert with_water.push[-1] == pytest.approx(without.push[-1], rel=1e-3)


@pytest.mark.parametrize(
    ("given", "over", "said"),
    [
        ({"link": "tail"}, {}, r"near_wall\[0\].link: 'tail' is no link of the vehicle: "),
        ({"length": None}, {}, "a cylinder needs length"),
        ({"shape": "sphere"}, {}, "length and axis belong to a cylinder"),
        ({"shape": "spheroid"}, {}, "must be 2 to 5 times the radius"),
        ({"axis": [0, 0, 0]}, {}, "axis must not be zero"),
        ({}, {"wall.present": False}, r"near_wall\[0\].point: there is no \[wall\]"),
        ({}, {"wrist.name": "sensor", "wrist.site": "tool"}, "near_wall.*take no wrist"),
    ],
)
def test_a_wrong_link_is_refused(given, over, said):
    table = {key: value for key, value in (FOREARM | given).items() if value is not None}
    with pytest.raises(InputError, match=said):
        simulate(Scenario.load("tool_push", {"near_wall": [table]} | over))
