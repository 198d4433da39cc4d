"""Desired impedance, estimates and desired attitude of a run. The loop and the closed forms share them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic.dataclasses import dataclass as table

from ..errors import Fault, InputError
from ..physics.frames import quat_from_euler_deg, rotation_matrix
from ..quantities import (
    STRICT,
    Damping,
    Factor,
    Factors,
    Inertia,
    Number,
    PositiveFactor,
    Stiffnesses,
    Wrench,
    doc,
    within,
)


@table(frozen=True, config=STRICT)
class Impedance:
    K_d: Stiffnesses = doc("desired stiffness, diagonal [N/m, N m]", (150.0, 1500.0, 1500.0, 50.0, 50.0, 50.0))
    M_d: Inertia = doc("desired inertia, diagonal or 6x6; default: M of the vehicle's file", None)
    D_d: Damping = doc("desired damping, diagonal or 6x6; default: Ott's design", None)
    K_f: Factors = doc("force gain, diagonal, eq. (7) [1]", (1.0,) * 6)
    F_d: Wrench = doc("wrench that the wall should exert on the vehicle, in B, eq. (7) [N, N m]", (0.0,) * 6)
    damping_ratio: Annotated[Number, within(0.0, 1e3, "")] = doc(
        "damping ratio of Ott's design, used if D_d is not given [1]", 1.0
    )


@table(frozen=True, config=STRICT)
class Estimates:
    inertia: PositiveFactor = doc("M_hat = f M of the vehicle's file; f is this key [1]", 1.0)
    coriolis: Factor = doc("C_hat(nu) nu = f C(nu) nu of the vehicle's file; f is this key [1]", 1.0)
    damping: Factor = doc("D_hat(nu) nu = f D(nu) nu of the vehicle's file; f is this key [1]", 1.0)
    restoring: Factor = doc("g_hat(eta) = f g(eta) of the vehicle's file; f is this key [1]", 1.0)


@dataclass(frozen=True, eq=False)
class Design:
    """Constant matrices of a run, (6, 6) in B unless another shape is given."""

    M: np.ndarray
    """True inertia of the vehicle, added mass included."""
    M_hat: np.ndarray
    M_d: np.ndarray
    D_d: np.ndarray
    K_d: np.ndarray
    quat_d: np.ndarray
    """(4,) desired attitude."""
    normal: np.ndarray
    """(6,) the wall's normal (x of W) in B at the desired attitude, as a wrench."""

    @classmethod
    def of(
        cls,
        impedance: Impedance,
        estimates: Estimates,
        M: np.ndarray,
        nominal_M: np.ndarray,
        attitude_deg: Sequence[float],
    ) -> "Design":
        """Matrices of a run, from the inertia (6, 6) of the true vehicle, that of its file, and the desired roll,
        pitch, yaw [deg]. Raises InputError if M_d is not symmetric positive definite, or D_d is not dissipative."""
        M_d = nominal_M if impedance.M_d is None else _square(impedance.M_d)
        K_d = np.diag(impedance.K_d)
        faults = []
        if np.abs(M_d - M_d.T).max() > 1e-9 * np.abs(M_d).max():
            faults.append(Fault("impedance.M_d", "is not symmetric"))
        elif np.linalg.eigvalsh(M_d)[0] <= 0.0:
            faults.append(Fault("impedance.M_d", "is not positive definite"))
        if impedance.D_d is not None:
            D_d = _square(impedance.D_d)
            if np.linalg.eigvalsh(D_d + D_d.T)[0] < 0.0:
                faults.append(
                    Fault("impedance.D_d", "is not dissipative: its symmetric part is not positive semi-definite")
                )
        elif not faults:
            D_d = ott_damping(M_d, K_d, impedance.damping_ratio)
        if faults:
            raise InputError(faults)
        quat_d = quat_from_euler_deg(*attitude_deg)
        return cls(M, estimates.inertia * nominal_M, M_d, D_d, K_d, quat_d, wall_normal(quat_d))

    def along_normal(self, inertia: np.ndarray) -> float:
        """Effective mass of an inertia (6, 6) along the wall's normal, with all other directions free [kg]."""
        return 1.0 / float(self.normal @ np.linalg.solve(inertia, self.normal))


def ott_damping(M_d: np.ndarray, K_d: np.ndarray, damping_ratio: float) -> np.ndarray:
    """Desired damping D_d (6, 6) [N s/m, N s, N m s] from the generalised eigenvalue problem of K_d and M_d.

    With M_d = Q^T Q and K_d = Q^T diag(k) Q, D_d = Q^T diag(2 zeta sqrt(k)) Q gives every mode of M_d x'' + D_d x' +
    K_d x = 0 the damping ratio zeta. Source: Ott (2008), sec. 3.3.
    M_d is (6, 6) symmetric positive definite [kg, kg m, kg m^2], K_d (6, 6) symmetric positive semi-definite [N/m, N,
    N m], and damping_ratio is zeta [1].
    """
    L = np.linalg.cholesky(M_d)  # M_d = L L^T
    inner = np.linalg.solve(L, np.linalg.solve(L, K_d).T)  # L^-1 K_d L^-T
    k, V = np.linalg.eigh((inner + inner.T) / 2.0)
    Q_T = L @ V  # Q^T = L V: Q^T Q = M_d, Q^T diag(k) Q = K_d
    return Q_T @ np.diag(2.0 * damping_ratio * np.sqrt(np.maximum(k, 0.0))) @ Q_T.T


def wall_normal(quat_d: np.ndarray) -> np.ndarray:
    """(6,) the wall's normal (x of W) in B at an attitude (4,), as a wrench."""
    normal = np.zeros(6)
    normal[:3] = rotation_matrix(quat_d)[0]
    return normal


def _square(value) -> np.ndarray:
    array = np.asarray(value, dtype=float)
    return np.diag(array) if array.ndim == 1 else array
