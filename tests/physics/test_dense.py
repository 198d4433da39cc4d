"""Factors, substitutions and products of matrices of any size against NumPy, as plain Python and as machine code."""

import numpy as np
import pytest

from uvms_mj.engine.native.compilation import native_function
from uvms_mj.engine.native.memory import floats
from uvms_mj.physics import linear_algebra

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
    linear_algebra.cholesky(M.ravel(), N, L.ravel())
    expected = np.linalg.cholesky(M)
    np.testing.assert_allclose(1.0 / np.diag(L), np.diag(expected), rtol=1e-12)
    np.testing.assert_allclose(np.tril(L, -1), np.tril(expected, -1), rtol=0, atol=1e-13)
    in_place = M.copy()
    linear_algebra.cholesky(in_place.ravel(), N, in_place.ravel())
    np.testing.assert_array_equal(np.tril(in_place), np.tril(L))


@pytest.mark.parametrize("columns", [1, 6])
@pytest.mark.parametrize("N", SIZES)
def test_both_substitutions_solve_a_system_for_several_right_hand_sides(N, columns):
    M, B, L = spd(N), np.random.default_rng(1).normal(size=(N, columns)), np.zeros(N * N)
    linear_algebra.cholesky(M.ravel(), N, L)
    Y = B.copy()
    linear_algebra.forward(L, N, Y.ravel(), columns)
    np.testing.assert_allclose(np.linalg.cholesky(M) @ Y, B, rtol=0, atol=1e-12)
    linear_algebra.backward(L, N, Y.ravel(), columns)
    X = np.linalg.solve(M, B)
    assert np.abs(Y - X).max() <= 1e-11 * np.abs(X).max()  # the matrix has the condition 1e4


@pytest.mark.parametrize("N", SIZES)
def test_the_inverse_is_that_of_numpy_and_exactly_symmetric(N):
    M, L, A = spd(N), np.zeros(N * N), np.zeros((N, N))
    linear_algebra.cholesky(M.ravel(), N, L)
    linear_algebra.inverse(L, N, A.ravel())
    assert np.abs(A - np.linalg.inv(M)).max() <= 1e-11 * np.abs(A).max()
    np.testing.assert_array_equal(A, A.T)


def test_products_are_those_of_numpy():
    rng = np.random.default_rng(2)
    A, B, Y, x = rng.normal(size=(6, 11)), rng.normal(size=(11, 4)), rng.normal(size=(11, 6)), rng.normal(size=6)
    out, square, turned = np.ones((6, 4)), np.ones((6, 6)), np.ones(11)
    linear_algebra.product(A.ravel(), 6, 11, B.ravel(), 4, out.ravel())
    linear_algebra.gram(Y.ravel(), 11, 6, square.ravel())
    linear_algebra.transposed_product(A.ravel(), 6, 11, x, turned)
    np.testing.assert_allclose(out, A @ B, rtol=0, atol=1e-14)
    np.testing.assert_allclose(square, Y.T @ Y, rtol=0, atol=1e-14)
    np.testing.assert_allclose(turned, A.T @ x, rtol=0, atol=1e-14)


def test_a_matrix_that_is_not_positive_definite_gives_nan():
    M, L = np.diag([1.0, -1.0, 1.0]), np.zeros(9)
    linear_algebra.cholesky(M.ravel(), 3, L)
    assert np.isnan(L[4])


def solve(M_at, N, L_at, B_at, columns):
    M, L, B = floats(M_at, N * N), floats(L_at, N * N), floats(B_at, N * columns)
    linear_algebra.cholesky(M, N, L)
    linear_algebra.forward(L, N, B, columns)
    linear_algebra.backward(L, N, B, columns)


@pytest.mark.parametrize("N", SIZES)
def test_machine_code_gives_the_same_numbers_for_every_size(N):
    M, L, made = spd(N), np.zeros((2, N * N)), np.random.default_rng(3).normal(size=(N, 6))
    expected = made.copy()
    native_function(solve, ["i8"] * 5).ctypes(M.ctypes.data, N, L.ctypes.data, made.ctypes.data, 6)
    solve(M.ctypes.data, N, L[1].ctypes.data, expected.ctypes.data, 6)
    np.testing.assert_array_equal(L[0], L[1])
    np.testing.assert_array_equal(made, expected)
