"""Desired impedance, estimates and desired attitude of a scenario. The loop and the closed forms share them."""

import math
from dataclasses import dataclass

import numpy as np

from .control.damping_design import ott_damping
from .faults import Fault, InputError
from .frames import quat_from_euler_deg, rotation_matrix
from .scenario import Scenario
from .sections import Wall
from .vehicle import Vehicle


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
    def of(cls, scenario: Scenario, vehicle: Vehicle) -> "Design":
        """Matrices of a scenario.

        Raises:
            InputError: M_d is not symmetric positive definite, or D_d is not dissipative.
        """
        impedance = scenario.impedance
        M = vehicle.M
        M_d = M if impedance.M_d is None else _square(impedance.M_d)
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
        quat_d = quat_from_euler_deg(*scenario.reference.attitude_deg)
        return cls(M, scenario.estimates.inertia * M, M_d, D_d, K_d, quat_d, wall_normal(quat_d))

    def along_normal(self, inertia: np.ndarray) -> float:
        """Effective mass of an inertia (6, 6) along the wall's normal, with all other directions free [kg]."""
        return 1.0 / float(self.normal @ np.linalg.solve(inertia, self.normal))

    def lightest_along_face(self, reach: float) -> float:
        """Least effective mass at the contact point along the wall's face, with all other directions free [kg].

        Args:
            reach: distance of the contact point from B's origin along the wall's normal [m].
        """
        n = self.normal[:3]
        along = np.linalg.svd(n.reshape(1, 3))[2][1:]  # (2, 3) two directions along the face
        J = np.hstack([along, np.cross(reach * n, along)])
        return 1.0 / float(np.linalg.eigvalsh(J @ np.linalg.solve(self.M, J.T))[-1])


def wall_normal(quat_d: np.ndarray) -> np.ndarray:
    """(6,) the wall's normal (x of W) in B at an attitude (4,), as a wrench."""
    normal = np.zeros(6)
    normal[:3] = rotation_matrix(quat_d)[0]
    return normal


def contact_settings(wall: Wall, design: Design, reach: float) -> dict[str, float]:
    """Settings of the wall for a :data:`uvms_mj.contact.CONTACT` record, with the defaults of sticking friction.

    The default damping is critical for the lightest motion along the face, so that a contact that sticks comes to rest.
    """
    k_t = wall.stiffness if wall.tangential_stiffness is None else wall.tangential_stiffness
    b_t = wall.tangential_damping
    if b_t is None:
        b_t = 2.0 * math.sqrt(k_t * design.lightest_along_face(reach))
    return {
        "stiffness": wall.stiffness,
        "damping": wall.damping,
        "friction": wall.friction,
        "tangential_stiffness": k_t,
        "tangential_damping": b_t,
    }


def _square(value) -> np.ndarray:
    array = np.asarray(value, dtype=float)
    return np.diag(array) if array.ndim == 1 else array
