"""Factors and substitutions of matrices of any size against NumPy, as plain Python and as machine code."""

import numpy as np
import pytest
import scipy.linalg

import uvms_mj.engine.native.compilation  # noqa: F401  # machine code for called_on
from uvms_mj.physics import linear_algebra
from uvms_mj.physics.kernels import called_on

SIZES = [1, 2, 6, 7, 11, 36]


def spd(N: int, condition: float = 1e4) -> np.ndarray:
    """A random symmetric positive definite matrix with eigenvalues from 1 / condition to 1."""
    rng = np.random.default_rng(N)
    Q, _ = np.linalg.qr(rng.normal(size=(N, N)))
    M = Q * np.geomspace(1.0 / condition, 1.0, N) @ Q.T
    return 0.5 * (M + M.T)


@pytest.mark.parametrize("N", SIZES)
def test_the_factor_is_that_of_numpy_with_reciprocals_on_its_diagonal(N):
    M, L = spd(N), np.zeros((N, N))
    linear_algebra.cholesky(M, L)
    expected = np.linalg.cholesky(M)
    np.testing.assert_allclose(1.0 / np.diag(L), np.diag(expected), rtol=1e-12)
    np.testing.assert_allclose(np.tril(L, -1), np.tril(expected, -1), rtol=0, atol=1e-13)
    in_place = M.copy()
    linear_algebra.cholesky(in_place, in_place)
    np.testing.assert_array_equal(np.tril(in_place), np.tril(L))


@pytest.mark.parametrize("columns", [1, 6])
@pytest.mark.parametrize("N", SIZES)
def test_both_substitutions_solve_a_system_for_several_right_hand_sides(N, columns):
    M, B, L = spd(N), np.random.default_rng(1).normal(size=(N, columns)), np.zeros((N, N))
    linear_algebra.cholesky(M, L)
    Y, one = B.copy(), B[:, 0].copy()
    linear_algebra.forward(L, Y)
    np.testing.assert_allclose(np.linalg.cholesky(M) @ Y, B, rtol=0, atol=1e-12)
    linear_algebra.backward(L, Y)
    linear_algebra.forward(L, one)
    linear_algebra.backward(L, one)
    np.testing.assert_array_equal(one, Y[:, 0])
    X = np.linalg.solve(M, B)
    assert np.abs(Y - X).max() <= 1e-11 * np.abs(X).max()  # the matrix has the condition 1e4


@pytest.mark.parametrize("N", SIZES)
def test_the_inverse_is_that_of_numpy_and_exactly_symmetric(N):
    M, L, A = spd(N), np.zeros((N, N)), np.zeros((N, N))
    linear_algebra.cholesky(M, L)
    linear_algebra.inverse(L, A)
    assert np.abs(A - np.linalg.inv(M)).max() <= 1e-11 * np.abs(A).max()
    np.testing.assert_array_equal(A, A.T)


@pytest.mark.parametrize("N", SIZES)
def test_elimination_solves_a_system_without_symmetry_and_knows_its_smallest_pivot(N):
    rng = np.random.default_rng(N)
    A, b = rng.normal(size=(N, N)), rng.normal(size=N)
    A[0, 0] = 0.0 if N > 1 else 2.0  # no pivot without an exchange of rows
    before = A.copy(), b.copy()
    x, pivots = linear_algebra.solved(A, b)
    expected = np.linalg.solve(A, b)
    assert np.abs(x - expected).max() <= 1e-13 * np.linalg.cond(A) * np.abs(expected).max()
    pivoted = np.abs(np.diag(scipy.linalg.lu(A)[2]))
    assert pivots == pytest.approx(pivoted.min() / pivoted.max(), rel=1e-9)
    np.testing.assert_array_equal(A, before[0])
    np.testing.assert_array_equal(b, before[1])


def test_elimination_of_a_singular_matrix_has_no_finite_solution_and_no_pivot():
    with np.errstate(all="ignore"):
        x, pivots = linear_algebra.solved(np.ones((3, 3)), np.array([1.0, 2.0, 3.0]))
    assert pivots == 0.0
    assert not np.isfinite(x).all()


def test_a_matrix_that_is_not_positive_definite_gives_nan():
    M, L = np.diag([1.0, -1.0, 1.0]), np.zeros((3, 3))
    linear_algebra.cholesky(M, L)
    assert np.isnan(L[1, 1])


def solve(M, L, B):
    linear_algebra.cholesky(M, L)
    linear_algebra.forward(L, B)
    linear_algebra.backward(L, B)


@pytest.mark.parametrize("N", SIZES)
def test_machine_code_gives_the_same_numbers_for_every_size(N):
    M, L, made = spd(N), np.zeros((N, N)), np.random.default_rng(3).normal(size=(N, 6))
    L_expected, expected = L.copy(), made.copy()
    called_on(solve, M, L, made)()
    solve(M, L_expected, expected)
    np.testing.assert_array_equal(L, L_expected)
    np.testing.assert_array_equal(made, expected)
