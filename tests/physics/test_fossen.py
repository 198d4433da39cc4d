"""Fossen's terms equal the matrices in the docstring and have their known properties."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from twin import skew
from uvms_mj.physics.fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring
from vehicles import dissipative

vectors = arrays(float, 6, elements=st.floats(-5, 5))
seeds = st.integers(0, 2**32 - 1)


def spd(seed: int) -> np.ndarray:
    a = np.random.default_rng(seed).normal(size=(6, 6))
    return a @ a.T


def rigid_body(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    m, r_g = rng.uniform(1, 20), rng.normal(size=3)
    a = rng.normal(size=(3, 3))
    I_b = a @ a.T + m * (r_g @ r_g * np.eye(3) - np.outer(r_g, r_g))
    return np.block([[m * np.eye(3), -m * skew(r_g)], [m * skew(r_g), I_b]])


def C_RB(M_RB: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """Fossen (2021), eq. (3.63), as a matrix."""
    m, omega, I_b = M_RB[0, 0], nu[3:], M_RB[3:, 3:]
    S_r = M_RB[3:, :3] / m
    return np.block([[m * skew(omega), -m * skew(omega) @ S_r], [m * S_r @ skew(omega), -skew(I_b @ omega)]])


def C_A(M_A: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """Fossen (2021), eq. (6.44), as a matrix."""
    a = M_A @ nu
    return np.block([[np.zeros((3, 3)), -skew(a[:3])], [-skew(a[:3]), -skew(a[3:])]])


@given(seeds, vectors)
def test_coriolis_wrenches_are_those_of_the_matrices_and_do_no_work(seed, nu):
    for function, matrix, M in (
        (coriolis_rigid_body, C_RB, rigid_body(seed)),
        (coriolis_added_mass, C_A, spd(seed)),
    ):
        out = np.empty(6)
        function(M, nu, out)
        scale = np.linalg.norm(M) * (nu @ nu) + 1e-12
        C = matrix(M, nu)
        assert np.abs(C + C.T).max() <= 1e-12 * scale
        assert np.abs(out - C @ nu).max() <= 1e-13 * scale
        assert abs(nu @ out) <= 1e-12 * scale * (np.linalg.norm(nu) + 1)


@given(seeds, vectors, arrays(float, 3, elements=st.floats(-2, 2)))
def test_a_constant_current_leaves_the_rigid_body_terms_as_they_are(seed, nu, v_c):
    """M_RB nu_r_dot + C_RB(nu_r) nu_r = M_RB nu_dot + C_RB(nu) nu for nu_c = (v_c, 0), v_c_dot = -omega x v_c."""
    M = rigid_body(seed)
    nu_r = nu - np.concatenate([v_c, np.zeros(3)])
    nu_c_dot = np.concatenate([-np.cross(nu[3:], v_c), np.zeros(3)])
    still, moving = np.empty(6), np.empty(6)
    coriolis_rigid_body(M, nu, still)
    coriolis_rigid_body(M, nu_r, moving)
    assert np.allclose(-M @ nu_c_dot + moving, still, rtol=0, atol=1e-11 * (1 + np.linalg.norm(M)))


matrices = arrays(float, (6, 6), elements=st.floats(-50, 50))


@given(matrices, matrices, vectors)
def test_damping_is_the_sum_over_its_coefficients(D_linear, D_quadratic, nu):
    """sum_ij (D_linear[i, j] + D_quadratic[i, j] |nu_j|) nu_j e_i, including the diagonal."""
    out, expected = np.empty(6), np.zeros(6)
    damping(D_linear, D_quadratic, nu, out)
    for i, j in np.ndindex(6, 6):
        expected[i] += D_linear[i, j] * nu[j] + D_quadratic[i, j] * abs(nu[j]) * nu[j]
    assert np.abs(out - expected).max() <= 1e-11


@given(seeds, vectors)
def test_damping_dissipates(seed, nu):
    """Matrices with a dominant diagonal dissipate. So do diagonal matrices without negative entries."""
    rng, out = np.random.default_rng(seed), np.empty(6)
    damping(dissipative(rng, 10.0), dissipative(rng, 30.0), nu, out)
    assert nu @ out >= 0.0
    diagonal = np.diag(rng.uniform(0, 50, 6)), np.diag(rng.uniform(0, 50, 6))
    damping(*diagonal, nu, out)
    assert nu @ out >= 0.0
    assert np.allclose(out, (diagonal[0] + diagonal[1] * np.abs(nu)) @ nu)


@given(seeds)
def test_restoring_wrench_is_the_gradient_of_the_potential(seed):
    """The power of -g(eta) is that of weight and buoyancy, -dU/dt by central differences."""
    rng = np.random.default_rng(seed)
    mass, displaced_mass = rng.uniform(1, 10, 2)
    r_g, r_b, p, nu = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3), rng.normal(size=6)
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    R *= np.linalg.det(R)
    gravity_W = rng.normal(size=3) * 9.81

    def potential(h: float) -> float:
        angle = np.linalg.norm(nu[3:]) * h
        axis = skew(nu[3:] / np.linalg.norm(nu[3:]))
        R_h = R @ (np.eye(3) + np.sin(angle) * axis + (1 - np.cos(angle)) * axis @ axis)
        p_h = p + h * R @ nu[:3]
        return float(displaced_mass * gravity_W @ (p_h + R_h @ r_b) - mass * gravity_W @ (p_h + R_h @ r_g))

    g_eta = np.empty(6)
    restoring(mass, displaced_mass, r_g, r_b, gravity_W, R, g_eta)
    h = 1e-5
    assert np.isclose(nu @ g_eta, (potential(h) - potential(-h)) / (2 * h), rtol=1e-6, atol=1e-5)
