"""Surfaces, contact bodies and bumpers: exact distances, motion, and the series of two springs and dampers."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from uvms_mj.physics.contacts import PAIR, pair_force, series_force
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.physics.surfaces import SHAPES, SURFACE, move, nearest_on_segment, signed_distance


def surface(shape: str, size=(0.4, 0.3, 0.2), attitude=(20.0, -30.0, 50.0), position=(0.3, -0.2, 0.5)) -> np.recarray:
    found = np.zeros(1, SURFACE).view(np.recarray)[0]
    found.kind, found.extent[:] = list(SHAPES).index(shape), size
    found.R_WS[:] = rotation_matrix(quat_from_euler_deg(*attitude))
    found.p_WS[:] = found.start_W[:] = position
    return found


def distance(of: np.recarray, point: np.ndarray) -> tuple[float, np.ndarray]:
    normal = np.zeros(3)
    return signed_distance(of, point, normal), normal


def pair(**settings: float) -> np.recarray:
    found = np.zeros(1, PAIR).view(np.recarray)[0]
    found.contact.stiffness, found.layer_depth = 1e4, np.inf
    for name, value in settings.items():
        if name in ("stiffness", "damping"):
            found.contact[name] = value
        else:
            found[name] = value
    return found


@pytest.mark.parametrize("shape", SHAPES)
def test_the_normal_is_the_gradient_of_the_distance_and_leads_to_the_surface(shape, rng):
    """|grad d| = 1 and d(c - d n) = 0, inside and outside; points on an edge of the medial axis are not drawn."""
    wall, signs = surface(shape), set()
    for _ in range(200):
        point = wall.p_WS + rng.uniform(-0.8, 0.8, 3)
        d, n = distance(wall, point)
        gradient = [(distance(wall, point + e)[0] - distance(wall, point - e)[0]) / 2e-6 for e in 1e-6 * np.eye(3)]
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-14)
        assert distance(wall, point - d * n)[0] == pytest.approx(0.0, abs=1e-14)
        assert n == pytest.approx(gradient, abs=1e-8) or np.linalg.norm(gradient) < 0.999
        signs.add(d > 0.0)
    assert signs == {True, False}


def test_no_two_shapes_have_the_same_distance(rng):
    """A shape of the table without its own line in the kernel would be taken for another one."""
    points = rng.uniform(-0.8, 0.8, (20, 3))
    found = {name: [distance(surface(name), point)[0] for point in points] for name in SHAPES}
    for a, b in itertools.combinations(SHAPES, 2):
        assert np.abs(np.subtract(found[a], found[b])).max() > 1e-3, (a, b)


@pytest.mark.parametrize(
    ("shape", "q", "d"),
    [
        ("plane", (-0.3, 5.0, 7.0), 0.3),
        ("sphere", (0.0, 0.6, 0.8), 0.6),
        ("cylinder", (0.3, 0.4, 9.0), 0.1),
        ("capsule", (0.3, 0.4, 0.25), 0.1),
        ("capsule", (0.3, 0.0, 0.3 + 0.4), 0.1),
        ("capsule", (0.0, 0.0, -0.3 - 0.1), -0.3),
        ("box", (0.4 + 0.3, 0.3 + 0.4, 0.0), 0.5),
        ("box", (0.4 + 0.02, 0.3 + 0.03, 0.2 + 0.06), 0.07),
        ("box", (0.35, 0.0, 0.0), -0.05),
        ("box", (0.1, -0.1, -0.2 + 0.04), -0.04),
    ],
)
def test_distances_of_textbook_points(shape, q, d):
    wall = surface(shape)
    assert distance(wall, wall.p_WS + wall.R_WS @ q)[0] == pytest.approx(d, abs=1e-15)


@pytest.mark.parametrize("shape", ["sphere", "cylinder"])
def test_a_capsule_touches_where_its_segment_is_nearest(shape, rng):
    wall = surface(shape)
    for _ in range(50):
        a, b = wall.p_WS + rng.normal(size=(2, 3))
        part = nearest_on_segment(wall, a, b)
        found = minimize_scalar(
            lambda t, a=a, b=b: distance(wall, a + t * (b - a))[0],
            bounds=(0.0, 1.0),
            method="bounded",
            options={"xatol": 1e-10},
        )
        here = distance(wall, a + part * (b - a))[0]
        assert here <= found.fun + 1e-12
        assert part == pytest.approx(found.x, abs=1e-4)


def test_a_moving_surface_has_the_velocity_of_its_displacement():
    """A table, linear between its rows and at rest outside, and a sine."""
    wall = surface("plane", position=(1.0, 2.0, 3.0))
    table = np.array([[0.5, 0.0, 0.0, 0.0], [1.5, 0.2, -0.1, 0.4], [2.0, 0.2, 0.3, 0.0]])
    wall.rows, wall.amplitude_W[:], wall.frequency, wall.phase = 3, (0.1, 0.0, 0.05), 0.7, 0.3
    for t in np.linspace(0.0, 2.5, 101):
        move(wall, table.reshape(-1), t)
        sine = np.sin(2.0 * np.pi * 0.7 * t + 0.3)
        shift = [np.interp(t, table[:, 0], column) for column in table[:, 1:].T]
        assert wall.p_WS == pytest.approx(np.array([1.0, 2.0, 3.0]) + shift + sine * wall.amplitude_W, abs=1e-14)
        if not np.isclose(t, table[:, 0], atol=1e-5).any():
            later, at = [], wall.copy()
            for dt in (-1e-6, 1e-6):
                at.row = 0
                move(at, table.reshape(-1), t + dt)
                later.append(at.p_WS.copy())
            assert wall.v_W == pytest.approx((later[1] - later[0]) / 2e-6, abs=1e-7)


@pytest.mark.parametrize("depth", [1e-4, 5e-3])
def test_a_bumper_without_dampers_is_two_springs_in_series(depth):
    """The wall has a second layer: the force is the root of x + w(F) = depth."""
    k_c, k_1, w_1, k_b = 1e4, 1e5, 1e-3, 2e3
    contact = pair(stiffness=k_c, layer_depth=w_1, layer_stiffness=k_1, bumper_stiffness=k_b)

    def too_deep(f: float) -> float:
        wall = f / k_c if f <= k_c * w_1 else w_1 + (f - k_c * w_1) / k_1
        return f / k_b + wall - depth

    assert series_force(contact, depth, 0.3, 1e-4) == pytest.approx(brentq(too_deep, 0.0, 1e4, xtol=1e-12), rel=1e-12)
    linear = pair(stiffness=k_c, bumper_stiffness=k_b)
    assert series_force(linear, depth, 0.0, 1e-4) == pytest.approx(depth / (1.0 / k_c + 1.0 / k_b), rel=1e-13)


def test_a_bumper_with_dampers_is_that_of_an_independent_integration():
    """Its error is of first order in the step; b_b or b_c may be zero."""
    k_c, k_b = 1e4, 2e3
    for b_c, b_b in ((40.0, 15.0), (0.0, 15.0), (40.0, 0.0)):

        def depth(t):
            return 2e-3 * t / 0.05 + 3e-4 * np.sin(200.0 * t), 2e-3 / 0.05 + 0.06 * np.cos(200.0 * t)

        def x_dot(t, x, b_c=b_c, b_b=b_b):
            d, rate = depth(t)
            return (k_c * (d - x) + b_c * rate - k_b * x) / (b_c + b_b)

        exact = solve_ivp(x_dot, (0.0, 0.05), [0.0], rtol=1e-11, atol=1e-15, method="Radau")
        force = k_b * exact.y[0, -1] + b_b * x_dot(0.05, exact.y[0, -1])
        errors = []
        for n in (1000, 2000):
            contact = pair(stiffness=k_c, damping=b_c, bumper_stiffness=k_b, bumper_damping=b_b)
            for t in np.linspace(0.0, 0.05, n + 1)[1:]:
                found = series_force(contact, *depth(t), 0.05 / n)
            errors.append(abs(found - force))
        assert errors[1] < 5e-3 * force
        assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)


def test_wall_and_bumper_give_back_no_more_energy_than_they_were_given(rng):
    """Around a closed cycle of the depth, from rest to rest, for any springs, dampers, layers and steps."""
    for _ in range(40):
        h, n = 10.0 ** rng.uniform(-5, -3), 600
        contact = pair(
            stiffness=10.0 ** rng.uniform(2, 5),
            damping=10.0 ** rng.uniform(0, 3),
            bumper_stiffness=10.0 ** rng.uniform(2, 5),
            bumper_damping=10.0 ** rng.uniform(0, 3),
        )
        depth = 1e-3 * np.interp(np.arange(n), np.linspace(0, n - 1, 13), np.r_[0.0, rng.uniform(0.0, 1.0, 11), 0.0])
        rate = np.diff(depth, prepend=0.0) / h
        force = np.array([series_force(contact, d, v, h) if d > 0.0 else 0.0 for d, v in zip(depth, rate, strict=True)])
        assert (force >= 0.0).all()
        assert float(force @ rate) * h >= 0.0


def test_a_deformed_bumper_touches_again_only_where_it_has_returned():
    contact = pair(stiffness=1e5, bumper_stiffness=1e3, bumper_damping=1e3)  # returns with a time constant of 1 s
    wall, nu, at = surface("plane", attitude=(0.0,) * 3, position=(0.0,) * 3), np.zeros(6), np.array([-0.9e-3, 0, 0])
    contact.radius, contact.compression = 1e-3, 5e-4
    pair_force(contact, wall, at, np.eye(3), nu, 1e-4)
    assert contact.depth == pytest.approx(1e-4)
    assert contact.f_n == 0.0
    assert contact.compression == pytest.approx(5e-4 / (1.0 + 1e-4))
    contact.compression = 0.0
    pair_force(contact, wall, at, np.eye(3), nu, 1e-4)
    assert contact.f_n > 0.0
    assert contact.contact.f_W == pytest.approx([-contact.f_n, 0.0, 0.0])


def test_the_force_acts_at_the_contact_point_relative_to_a_wall_that_moves():
    """A damped sphere off the origin: force and moment by vector algebra."""
    contact = pair(stiffness=1e4, damping=200.0, radius=0.1)
    contact.ends_C[:] = (0.2, 0.3, -0.1)
    R, p, nu = rotation_matrix(quat_from_euler_deg(10.0, 20.0, 30.0)), np.array([0.1, 0.2, 0.3]), np.arange(6.0) / 10.0
    centre = p + R @ contact.ends_C[0]
    wall = surface("sphere", size=(0.5, 0.0, 0.0), position=centre + (0.5 + 0.1 - 2e-3) * np.array([0.6, 0.0, 0.8]))
    wall.v_W[:] = (-0.3, 0.1, 0.2)
    pair_force(contact, wall, p, R, nu, 1e-4)
    n = -np.array([0.6, 0.0, 0.8])
    arm = centre - (0.1 - 1e-3) * n - p
    v = R @ nu[:3] + np.cross(R @ nu[3:], arm) - wall.v_W
    f = (1e4 * 2e-3 - 200.0 * float(n @ v)) * n
    assert contact.contact.f_W == pytest.approx(f, rel=1e-11)
    assert contact.contact.tau_B == pytest.approx(np.r_[R.T @ f, R.T @ np.cross(arm, f)], rel=1e-11)
