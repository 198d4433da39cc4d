"""The axes that thrusters span do not depend on the digits of their file, on units or on a vehicle's size."""

import numpy as np
import pytest

from uvms_mj.actuation.allocation import Constrained, Weighted
from uvms_mj.physics.spanned_axes import LEAST, axes_spanned, axis_strengths, pseudoinverse, spanning
from uvms_mj.plant.mjcf import Mjcf

POSITIONS = np.array(
    [[0.14, -0.092, 0], [0.14, 0.092, 0], [-0.15, -0.092, 0], [-0.15, 0.092, 0], [0, -0.109, 0.077], [0, 0.109, 0.077]]
)
ANGLES = np.radians([[0, -45], [0, 45], [0, 45], [0, -45], [90, 0], [90, 0]])
"""Elevation and azimuth of the thrusters of a BlueROV2."""


def allocation(angles, scale=1.0):
    up, turn = angles.T
    e = np.array([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])
    return np.vstack([e, np.cross(scale * POSITIONS, e.T).T])


def printed(angles, digits):
    return np.array([[float(f"{x:.{digits}g}") for x in row] for row in angles])


@pytest.mark.parametrize("digits", [2, 3, 4, 5, 6, 9, 12, 17])
def test_angles_of_any_digits_give_the_allocation_of_the_exact_ones(digits):
    """The bound is that of matrices of one rank (Wedin 1973), with twice the error, since an axis is left out."""
    exact, B = allocation(ANGLES), allocation(printed(ANGLES, digits))
    assert axes_spanned(exact) == axes_spanned(B) == 5
    inverse = np.linalg.pinv(exact)
    most = 4.0 * np.linalg.norm(inverse, 2) ** 2 * np.linalg.norm(B - exact, 2) + 1e-12
    assert np.linalg.norm(pseudoinverse(B) - inverse, 2) < most
    assert (Weighted().inverse(B) == pseudoinverse(B)).all()
    assert np.abs(Constrained().inverse(B)).max() < 10.0  # the inverse of a rounding is a thousand or more


@pytest.mark.parametrize("size", [1e-3, 1.0, 20.0])
def test_neither_size_nor_units_change_what_counts(size):
    B = Mjcf.find("bluerov2_heavy").vehicle.B * np.repeat([1.0, size], 3)[:, None]
    units = np.geomspace(1e-3, 1e3, B.shape[1])
    assert axes_spanned(B) == axes_spanned(B * units) == 6
    assert axis_strengths(B)[0] == pytest.approx(axis_strengths(B * units)[0], rel=1e-9)
    assert axes_spanned(allocation(printed(ANGLES, 4), size)) == 5


@pytest.mark.parametrize("model", ["bluerov1", "bluerov2", "bluerov2_heavy", "lauv", "planar_arm"])
def test_the_pseudoinverse_of_the_shipped_vehicles_keeps_its_bits(model):
    B = Mjcf.find(model).vehicle.B
    assert spanning(B) is B
    assert (pseudoinverse(B) == np.linalg.pinv(B)).all()


def test_a_weak_axis_counts_from_the_limit_on():
    """Four thrusters up at arms of a metre, and two along x at an arm b: yaw has b of the strongest axis."""
    for b, axes in ((0.5 * LEAST, 4), (2.0 * LEAST, 5)):
        columns = [[0, 0, 1, y, -x, 0] for x in (1.0, -1.0) for y in (1.0, -1.0)]
        columns += [[1, 0, 0, 0, 0, -y] for y in (b, -b)]
        B = np.array(columns).T.astype(float)
        assert axes_spanned(B) == axes
        inverse = pseudoinverse(B, rows=np.array([1e-3, 1, 1, 1, 1, 1e3]))
        reached = B @ inverse
        assert reached[5, 5] == pytest.approx(float(axes == 5), abs=1e-9)
        assert reached[0, 0] == pytest.approx(1.0)
