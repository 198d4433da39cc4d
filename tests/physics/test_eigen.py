"""Jacobi's rotations: eigenvalues and eigenvectors of symmetric matrices, those of deficient rank included."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import uvms_mj.engine.native.compilation  # noqa: F401  # machine code for called_on
from uvms_mj.physics.kernels import called_on
from uvms_mj.physics.linear_algebra import symmetric_eigen


def eigen(A):
    """Eigenvalues (n,), and eigenvectors (n, n) in rows, by machine code."""
    D, V = np.triu(A), np.zeros_like(A)
    called_on(symmetric_eigen, D, V)()
    return np.diag(D), V


@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(0, 9), st.floats(0.0, 6.0))
def test_eigenvalues_and_eigenvectors_are_those_of_numpy(seed, n, rank, decades):
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(n, min(rank, n))) * 10.0 ** rng.uniform(0.0, 0.5 * decades, size=(n, 1))
    A = B @ B.T
    values, V = eigen(A)
    scale = max(1e-300, np.abs(A).max())
    assert np.allclose(V @ V.T, np.eye(n), rtol=0.0, atol=1e-13)
    assert np.allclose((V.T * values) @ V, A, rtol=0.0, atol=1e-13 * scale)
    assert np.allclose(np.sort(values), np.linalg.eigvalsh(A), rtol=0.0, atol=1e-13 * scale)


@pytest.mark.parametrize("A", [np.diag([3.0, 1.0, 2.0]), np.zeros((4, 4)), np.ones((5, 5)), np.eye(6) + 1e-9])
def test_equal_eigenvalues_and_diagonals_are_no_exceptions(A):
    values, V = eigen(A)
    assert np.allclose((V.T * values) @ V, A, rtol=0.0, atol=1e-14)
    assert np.allclose(V @ V.T, np.eye(len(A)), rtol=0.0, atol=1e-14)


def test_plain_python_gives_the_same_bits():
    B = np.random.default_rng(1).normal(size=(6, 6))
    A, D, V = B @ B.T, np.triu(B @ B.T), np.zeros((6, 6))
    symmetric_eigen(D, V)
    values, vectors = eigen(A)
    assert (values == np.diag(D)).all()
    assert (vectors == V).all()
