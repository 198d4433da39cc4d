"""A spheroid near a wall: its table by other computations of the same flow."""

import math

import numpy as np
import pytest

import spheroid_table
from uvms_mj import NearWall
from uvms_mj.physics.kernels import record_of
from uvms_mj.physics.near_wall import HULL, sphere_mass, tensor
from uvms_mj.plant.settings import Situation


def record(length):
    """Of the radius 1 and the half length ``length``."""
    table = NearWall(shape="spheroid", radius=1.0, length=2.0 * length, point=(0.0, 0.0, 0.0), least_gap=1e-3)
    return record_of(np.array(table.records(Situation()), HULL))


def reach(length, s):
    return math.sqrt(1.0 + (length**2 - 1.0) * s * s)


def of_table(length, s, gap):
    """What the wall adds (3, 3), over the displaced mass; the wall is z = 0, and the axis in the plane of x and z."""
    W, e, n = np.zeros((4, 3)), np.array([math.sqrt(1.0 - s * s), 0.0, s]), np.array([0.0, 0.0, 1.0])
    tensor(record(length), s, gap + reach(length, s), W)
    A, B, C, D = W[:, 0] / (4000.0 / 3.0 * math.pi * length)
    return A * np.eye(3) + B * np.outer(n, n) + C * np.outer(e, e) + D * (np.outer(n, e) + np.outer(e, n))


def by_panels(length, s, gap, rings=24, around=40):
    """The added mass (3, 3) over the displaced one by sources on the surface, one strength a panel; without a gap, in
    open water."""
    x, w = np.polynomial.legendre.leggauss(rings)
    X, P = (each.ravel() for each in np.meshgrid(x, 2.0 * math.pi * (np.arange(around) + 0.5) / around, indexing="ij"))
    unit = np.stack([np.sqrt(1.0 - X**2) * np.cos(P), np.sqrt(1.0 - X**2) * np.sin(P), X], axis=1)
    axes = np.array([[-s, 0.0, math.sqrt(1.0 - s * s)], [0.0, 1.0, 0.0], [math.sqrt(1.0 - s * s), 0.0, s]])
    half = np.array([1.0, 1.0, length])
    p, n = (unit * half) @ axes, (unit / half) @ axes
    size = np.linalg.norm(n, axis=1)
    n, area = n / size[:, None], np.repeat(w, around) * 2.0 * math.pi / around * length * size
    d = p[:, None] - p
    r = np.sqrt((d * d).sum(axis=2)) + np.eye(len(p))
    potential, normal_velocity = area / r, -np.einsum("ijk,ik->ij", d, n) * area / r**3
    # by a panel itself: of a disc; and so that all the water that a panel sends inwards leaves it again
    np.fill_diagonal(potential, 2.0 * np.sqrt(math.pi * area))
    np.fill_diagonal(normal_velocity, 0.0)
    np.fill_diagonal(normal_velocity, -4.0 * math.pi - (area @ normal_velocity) / area)
    if gap is not None:
        d = p[:, None] - p * [1.0, 1.0, -1.0] + [0.0, 0.0, 2.0 * (gap + reach(length, s))]
        r = np.sqrt((d * d).sum(axis=2))
        potential = potential + area / r
        normal_velocity = normal_velocity - np.einsum("ijk,ik->ij", d, n) * area / r**3
    phi = potential @ np.linalg.solve(normal_velocity, n)
    return -(phi * area[:, None]).T @ n / (4.0 / 3.0 * math.pi * length)


def in_open_water(length):
    """Along the axis and across it, over the displaced mass (Lamb, "Hydrodynamics", 1932, sec. 114)."""
    e = math.sqrt(1.0 - 1.0 / length**2)
    log = math.log((1.0 + e) / (1.0 - e))
    alpha = 2.0 * (1.0 - e * e) / e**3 * (0.5 * log - e)
    beta = 1.0 / e**2 - (1.0 - e * e) / (2.0 * e**3) * log
    return alpha / (2.0 - alpha), beta / (2.0 - beta)


def test_the_sources_and_the_panels_have_the_added_mass_of_open_water(monkeypatch):
    monkeypatch.setattr(spheroid_table, "RINGS", 16)
    monkeypatch.setattr(spheroid_table, "AROUND", 10)
    for length in (1.2, 2.0):
        along, across = in_open_water(length)
        found = np.diag(spheroid_table.masses(length, 0.0, spheroid_table.FAR))
        np.testing.assert_allclose(found, [along, across, across], atol=2e-4)
        fine, coarse = (np.diag(by_panels(length, 0.0, None, *n)) for n in ((24, 40), (12, 20)))
        np.testing.assert_allclose(2.0 * fine - coarse, [along, across, across], atol=1e-3)  # of first order


@pytest.mark.parametrize(("length", "s", "gap"), [(1.8, 0.5, 0.4), (1.3, -0.2, 0.6), (2.4, 0.9, 0.5), (2.2, 0.0, 1.0)])
def test_the_table_is_the_flow_by_panels(length, s, gap):
    """Away from the wall by some panels; between the rows of the table."""
    expected = by_panels(length, s, gap) - by_panels(length, s, None)
    np.testing.assert_allclose(of_table(length, s, gap), expected, atol=1e-3)
    assert np.abs(expected).max() > 0.01


@pytest.mark.parametrize(
    ("length", "s", "gap"),
    [(1.3, 0.1, 0.03), (1.9, 0.5, 0.025), (2.35, 0.0, 0.02), (2.35, 0.99, 0.05), (1.07, 0.7, 0.02)],
)
def test_the_table_is_the_flow_by_sources_where_the_gap_is_small(length, s, gap, monkeypatch):
    monkeypatch.setattr(spheroid_table, "RINGS", 20)
    monkeypatch.setattr(spheroid_table, "AROUND", 14)
    expected = spheroid_table.masses(length, s, gap) - spheroid_table.masses(length, s, spheroid_table.FAR)
    np.testing.assert_allclose(of_table(length, s, gap), expected, atol=1e-3)
    assert np.abs(expected).max() > 0.04


def test_a_spheroid_as_long_as_wide_is_a_sphere():
    for gap in (0.02, 0.03, 0.2, 1.5, 7.0):
        normal, along, _, _ = sphere_mass(gap)
        np.testing.assert_allclose(of_table(1.0, 0.4, gap), np.diag([along, along, normal]), atol=1e-5)


@pytest.mark.parametrize("gap", [0.01, 0.03, 0.5, 6.0, 20.0])
@pytest.mark.parametrize("s", [-0.7, 0.0, 0.3, 0.999])
def test_the_slopes_of_a_spheroid_are_the_derivatives(gap, s):
    """By the distance, and by s at a distance; nearer than 0.02 of the radius nothing grows."""
    hull, h, e = record(2.1), gap + reach(2.1, s), 1e-6
    W, more, less = np.zeros((4, 3)), np.zeros((4, 3)), np.zeros((4, 3))
    tensor(hull, s, h, W)
    for column, (dh, ds) in enumerate(((e * gap, 0.0), (0.0, e * min(gap, 1.0))), start=1):
        tensor(hull, s + ds, h + dh, more)
        tensor(hull, s - ds, h - dh, less)
        found = (more[:, 0] - less[:, 0]) / (2.0 * (dh + ds))
        np.testing.assert_allclose(W[:, column], found, rtol=1e-5, atol=1e-6 * np.abs(W[:, 0]).max())
