"""Damping design for a desired impedance."""

import numpy as np


def ott_damping(M_d: np.ndarray, K_d: np.ndarray, damping_ratio: float) -> np.ndarray:
    """Desired damping D_d (6, 6) [N s/m, N s, N m s] from the generalised eigenvalue problem of K_d and M_d.

    With M_d = Q^T Q and K_d = Q^T diag(k) Q, D_d = Q^T diag(2 zeta sqrt(k)) Q gives every mode of M_d x'' + D_d x' +
    K_d x = 0 the damping ratio zeta. Source: Ott (2008), sec. 3.3.

    Args:
        M_d: (6, 6) symmetric positive definite [kg, kg m, kg m^2].
        K_d: (6, 6) symmetric positive semi-definite [N/m, N, N m].
        damping_ratio: zeta [1].
    """
    L = np.linalg.cholesky(M_d)  # M_d = L L^T
    inner = np.linalg.solve(L, np.linalg.solve(L, K_d).T)  # L^-1 K_d L^-T
    k, V = np.linalg.eigh((inner + inner.T) / 2.0)
    Q_T = L @ V  # Q^T = L V: Q^T Q = M_d, Q^T diag(k) Q = K_d
    return Q_T @ np.diag(2.0 * damping_ratio * np.sqrt(np.maximum(k, 0.0))) @ Q_T.T
