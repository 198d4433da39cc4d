"""From a scenario and a vehicle: the desired impedance, the estimates, the desired attitude. Shared by the loop and
the closed forms."""

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
    """Constant matrices of a run, all (6, 6) in B unless another shape is given."""

    M: np.ndarray
    """The vehicle's true inertia, added mass included."""
    M_hat: np.ndarray
    M_d: np.ndarray
    D_d: np.ndarray
    K_d: np.ndarray
    quat_d: np.ndarray
    """(4,) desired attitude."""
    normal: np.ndarray
    """(6,) the wall's normal W x in B at the desired attitude, as a wrench."""

    @classmethod
    def of(cls, scenario: Scenario, vehicle: Vehicle) -> "Design":
        """Raises InputError where M_d or D_d is not what an impedance can be."""
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
                faults.append(Fault("impedance.D_d", "is not dissipative: not positive semi-definite"))
        elif not faults:
            D_d = ott_damping(M_d, K_d, impedance.damping_ratio)
        if faults:
            raise InputError(faults)
        quat_d = quat_from_euler_deg(*scenario.reference.attitude_deg)
        return cls(M, scenario.estimates.inertia * M, M_d, D_d, K_d, quat_d, wall_normal(quat_d))

    def along_normal(self, inertia: np.ndarray) -> float:
        """What an inertia (6, 6) weighs along the wall's normal when everything else is free to move [kg]."""
        return 1.0 / float(self.normal @ np.linalg.solve(inertia, self.normal))

    def lightest_along_face(self, reach: float) -> float:
        """The least that the inertia weighs at the contact point along the wall's face, everything else free [kg].

        Args:
            reach: distance of the contact point from B's origin along the wall's normal [m].
        """
        n = self.normal[:3]
        along = np.linalg.svd(n.reshape(1, 3))[2][1:]  # (2, 3) two directions along the face
        J = np.hstack([along, np.cross(reach * n, along)])
        return 1.0 / float(np.linalg.eigvalsh(J @ np.linalg.solve(self.M, J.T))[-1])


def wall_normal(quat_d: np.ndarray) -> np.ndarray:
    """(6,) the wall's normal W x in B at an attitude (4,), as a wrench."""
    normal = np.zeros(6)
    normal[:3] = rotation_matrix(quat_d)[0]
    return normal


def contact_settings(wall: Wall, design: Design, reach: float) -> dict[str, float]:
    """The wall's settings in a :data:`uvms_mj.contact.CONTACT` record, with the defaults of sticking friction.

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
