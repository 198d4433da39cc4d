"""The acceleration that the posture demands of a vehicle at rest, in the motion that the task leaves free.

It is that of the kernel :func:`uvms_mj.physics.posture.posture`, with the same levels in strict priority, at zero
velocity.
"""

from typing import Any

import numpy as np

from ..physics.frames import attitude, quat_error
from ..physics.posture import ATTITUDE, FREEDOM, JOINTS, STATION
from .posture import posture_constants


class PostureAtRest:
    """The posture of a run."""

    def __init__(self, setup: Any) -> None:
        self.settings, self.n = posture_constants(setup), len(setup.nominal.arm.links)

    def __call__(
        self, p_WB: np.ndarray, R_WB: np.ndarray, q: np.ndarray, M_inv: np.ndarray, P: np.ndarray
    ) -> np.ndarray:
        """a (6 + n,) at a pose of B and joint positions q (n,), for the law's M^-1 and the free mobility P, both
        (6 + n, 6 + n)."""
        a, P, P_qq = np.zeros(len(P)), P.copy(), P[6:, 6:]
        for kind in self.settings["levels"]:
            frequency = self.settings["frequency"][int(kind)]
            if kind == ATTITUDE:
                columns, (T, b) = slice(3, 6), self._attitude(R_WB)
            elif kind == STATION:
                columns, T, b = slice(0, 3), np.eye(3), R_WB.T @ (self.settings["p_d"] - p_WB)
            else:
                if kind == JOINTS:  # it has all that is left
                    b = frequency**2 * (self.settings["joints"][: self.n] - q)
                    a += P[:, 6:] @ np.linalg.solve(P_qq, b - a[6:])
                break
            L_inv = np.linalg.inv(np.linalg.cholesky(T @ M_inv[columns, columns] @ T.T))
            b = L_inv @ (frequency**2 * b - T @ a[columns])
            X = L_inv @ T @ P[columns]
            sigma, V = np.linalg.eigh(X[:, columns] @ (L_inv @ T).T)
            fading = (3.0 - 2.0 * sigma / FREEDOM) * sigma / FREEDOM**2
            f = np.where(sigma >= FREEDOM, 1.0 / np.maximum(sigma, FREEDOM), fading)
            x = V.T @ X
            a += x.T @ (f * (V.T @ b))
            P -= (x.T * f) @ x
        return a

    def _attitude(self, R_WB: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows T of the angular velocity, and the error that they take away [rad]."""
        if self.settings["yaw"]:
            quat, quat_e = np.array([1.0, 0.0, 0.0, 0.0]), np.empty(4)
            attitude(R_WB, quat)
            quat_error(self.settings["quat_d"], quat, quat_e)
            return np.eye(3), -2.0 * quat_e[1:]
        up, up_d = R_WB[2], self.settings["up_d"]
        half = np.sqrt(max(0.5 + 0.5 * float(up @ up_d), 1e-6))  # cos(theta/2)
        T = np.linalg.svd(up[None])[2][1:]  # the plane normal to it
        return T, -T @ np.cross(up, up_d) / half
