"""Ott's design gives every mode the requested damping ratio; the matrices of a run; the mass at the wall's face."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uvms_mj.control.design import Design, Impedance, ott_damping
from uvms_mj.errors import InputError
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.plant.settings import lightest_along_face
from uvms_mj.scenario import Scenario


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 2.0))
def test_all_modes_have_the_damping_ratio(seed, ratio):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 6, 6))
    M, K = a @ a.T + np.eye(6), b @ b.T + np.eye(6)
    D = ott_damping(M, K, ratio)
    assert np.allclose(D, D.T)
    poles = np.linalg.eigvals(
        np.block([[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    )
    # each mode has two poles with product omega^2 and sum -2 ratio omega
    omega_squared = np.linalg.eigvals(np.linalg.solve(M, K)).real
    expected = np.concatenate([np.roots([1.0, 2 * ratio * np.sqrt(w2), w2]) for w2 in omega_squared])
    # double poles (ratio 1) are accurate to half the digits only
    for pole in expected:
        assert np.abs(poles - pole).min() < 1e-5 * np.abs(pole).max() + 1e-6


M = np.diag([13.0, 20.0, 22.0, 0.3, 0.3, 0.3]) + 1e-3
SIX, OTHER = (20.0, 25.0, 30.0, 2.0, 3.0, 4.0), (10.0, 0.0, 300.0, 20.0, 0.5, 0.0)


@pytest.mark.parametrize("D_d", [None, OTHER])
def test_six_numbers_are_the_diagonal_of_a_matrix(D_d):
    """They are computed in another way, without eigenvalues."""

    def matrix(six):
        return None if six is None else tuple(map(tuple, np.diag(six).tolist()))

    given = Design.of(Scenario(impedance=Impedance(M_d=SIX, D_d=D_d, K_d=OTHER)), M, M, M)
    other = Design.of(Scenario(impedance=Impedance(M_d=matrix(SIX), D_d=matrix(D_d), K_d=OTHER)), M, M, M)
    for name in ("M_d", "M_d_inv", "D_d", "K_d"):
        assert np.allclose(getattr(given, name), getattr(other, name), rtol=1e-13, atol=1e-12), name
    assert np.allclose(given.M_d @ given.M_d_inv, np.eye(6))


@pytest.mark.parametrize("form", [tuple, lambda six: tuple(map(tuple, np.diag(six).tolist()))])
def test_both_matrices_that_are_not_physical_are_named(form):
    wrong = form((1.0,) * 5 + (-1.0,))
    scenario = Scenario(impedance=Impedance(M_d=wrong, D_d=wrong))
    with pytest.raises(InputError, match=r"(?s)impedance.M_d.*not positive definite.*impedance.D_d.*not dissipative"):
        Design.of(scenario, M, M, M)


@given(st.tuples(*[st.floats(-180.0, 180.0)] * 3), st.floats(0.0, 1.0))
def test_the_least_mass_along_the_face_is_that_of_the_lightest_direction(attitude_deg, reach):
    R_WB = rotation_matrix(quat_from_euler_deg(*attitude_deg))
    n, masses = R_WB[0], []
    for angle in np.linspace(0.0, np.pi, 361):
        t = np.cos(angle) * R_WB[1] + np.sin(angle) * R_WB[2]
        wrench = np.concatenate([t, np.cross(reach * n, t)])
        masses.append(1.0 / (wrench @ np.linalg.solve(M, wrench)))
    assert lightest_along_face(M, R_WB, reach) == pytest.approx(min(masses), rel=1e-3)
