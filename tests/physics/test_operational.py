"""Inertia, projection and manipulability at a tool against NumPy, for any sizes."""

import numpy as np
import pytest

from uvms_mj.physics import operational


def system(n: int, seed: int = 0):
    """M (N, N), and J (6, N) whose first columns are those of a rigid body."""
    rng, N = np.random.default_rng(seed), 6 + n
    a = rng.normal(size=(N, N))
    X, (x, y, z) = np.eye(6), rng.normal(size=3)
    X[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return a @ a.T + 0.1 * np.eye(N), np.hstack([X, rng.normal(size=(6, n))])


def computed(M, J):
    """Lambda, M^-1 J^T and the manipulability, by the kernels."""
    N, J_T = len(M), np.ascontiguousarray(J.T)
    L, MJ_T, J_bar, w = np.zeros((N, N)), np.zeros((N, 6)), np.zeros((N, 6)), np.zeros(1)
    Lambda = np.zeros((6, 6))
    operational.task_inertia(M, J_T, L, MJ_T, Lambda, J_bar, w)
    np.testing.assert_allclose(J_bar, MJ_T @ Lambda, rtol=0, atol=1e-12 * np.abs(J_bar).max())
    return Lambda, MJ_T, float(w[0])


@pytest.mark.parametrize("n", [0, 1, 5, 30])
def test_the_inertia_at_the_tool_is_that_of_numpy(n):
    M, J = system(n)
    Lambda, MJ_T, w = computed(M, J)
    M_inv_J_T = np.linalg.solve(M, J.T)
    expected = np.linalg.inv(J @ M_inv_J_T)
    np.testing.assert_allclose(MJ_T, M_inv_J_T, rtol=0, atol=1e-11 * np.abs(M_inv_J_T).max())
    np.testing.assert_allclose(Lambda, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    assert w == pytest.approx(np.sqrt(np.linalg.det(M[:6, :6]) * np.linalg.det(J @ M_inv_J_T)), rel=1e-9)


@pytest.mark.parametrize("n", [1, 5, 8])
def test_nothing_is_singular_at_the_tool_of_a_free_vehicle(n):
    """Lambda is at most that with locked joints, also where the arm alone is singular; w is 1 if no joint acts."""
    M, J = system(n)
    X_inv = np.linalg.inv(J[:, :6])
    locked = X_inv.T @ M[:6, :6] @ X_inv
    for scale in (1.0, 1e-3, 0.0):  # the joints' part of J, up to nothing
        singular = J.copy()
        singular[:, 6:] *= scale
        singular[2, 6:] = 0.0
        Lambda, _, w = computed(M, singular)
        assert np.linalg.eigvalsh(locked - Lambda)[0] >= -1e-9 * np.abs(locked).max()
        assert w >= 1.0 - 1e-12


def test_joints_that_do_not_couple_with_base_or_tool_give_a_measure_of_one():
    M, J = system(5)
    M[:6, 6:] = M[6:, :6] = J[:, 6:] = 0.0
    assert computed(M, J)[2] == pytest.approx(1.0, rel=1e-12)
