"""From a scenario and a vehicle: the desired impedance, the estimates, the desired attitude. Shared by the loop and
the closed forms."""

from dataclasses import dataclass

import numpy as np

from .control.damping_design import ott_damping
from .faults import Fault, InputError
from .frames import quat_from_euler_deg, rotation_matrix
from .scenario import Scenario
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


def wall_normal(quat_d: np.ndarray) -> np.ndarray:
    """(6,) the wall's normal W x in B at an attitude (4,), as a wrench."""
    normal = np.zeros(6)
    normal[:3] = rotation_matrix(quat_d)[0]
    return normal


def _square(value) -> np.ndarray:
    array = np.asarray(value, dtype=float)
    return np.diag(array) if array.ndim == 1 else array
