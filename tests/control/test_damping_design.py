"""Ott's design gives every mode the requested damping ratio."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from uvms_mj.control.design import ott_damping


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
