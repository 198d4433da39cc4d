"""Independent twin of the error-state Kalman filter, in NumPy and SciPy alone: dense matrices and Joseph's form.

Written from Sola, "Quaternion kinematics for the error-state Kalman filter". It shares the random numbers with the
package, and no other code. The error state is [dp_W, dv_W, dtheta_B, db_g, db_a], truth minus estimate.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

P, V, TH, BG, BA = (slice(3 * i, 3 * i + 3) for i in range(5))


def skew(a):
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass
class Estimate:
    """Estimate of position and velocity in W, attitude, and the biases of gyro and accelerometer."""

    p: np.ndarray
    v: np.ndarray
    R: Rotation
    b_g: np.ndarray = field(default_factory=lambda: np.zeros(3))
    b_a: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def integrated(self, turn, push, h, g_W):
        """After an interval h with measured increments of attitude and velocity."""
        v = self.v + self.R.apply(push - h * self.b_a) + h * g_W
        R = self.R * Rotation.from_rotvec(turn - h * self.b_g)
        return Estimate(self.p + 0.5 * h * (self.v + v), v, R, self.b_g, self.b_a)

    def moved(self, dx):
        """The state at an error state from this estimate."""
        R = self.R * Rotation.from_rotvec(dx[TH])
        return Estimate(self.p + dx[P], self.v + dx[V], R, self.b_g + dx[BG], self.b_a + dx[BA])

    def minus(self, other):
        """The error state of this state from another one."""
        turn = (other.R.inv() * self.R).as_rotvec()
        return np.concatenate([self.p - other.p, self.v - other.v, turn, self.b_g - other.b_g, self.b_a - other.b_a])


def transition(estimate, turn, push, h):
    """F (15, 15) of an interval, and G (15, 6) of the noise of the increments [attitude, velocity]."""
    R = estimate.R.as_matrix()
    E = Rotation.from_rotvec(turn - h * estimate.b_g).as_matrix()
    F = np.eye(15)
    F[V, TH], F[V, BA] = -R @ skew(push - h * estimate.b_a), -h * R
    F[P] += 0.5 * h * (F[V] + np.eye(15)[V])
    F[TH, TH], F[TH, BG] = E.T, -h * np.eye(3)
    G = np.zeros((15, 6))
    G[V, 3:], G[P, 3:], G[TH, :3] = np.eye(3), 0.5 * h * np.eye(3), np.eye(3)
    return F, G


def joseph(cov, H, variance):
    """Gain (15,) and covariance after a scalar measurement."""
    K = cov @ H / (H @ cov @ H + variance)
    left = np.eye(15) - np.outer(K, H)
    return K, left @ cov @ left.T + variance * np.outer(K, K)


def corrected(estimate, cov, H, innovation, sigma):
    K, cov = joseph(cov, H, sigma**2)
    return estimate.moved(K * innovation), cov


def velocity_row(estimate, axis):
    """Row of one component of the velocity in B, and its prediction."""
    v_B = estimate.R.inv().apply(estimate.v)
    H = np.zeros(15)
    H[V], H[TH] = estimate.R.as_matrix().T[axis], skew(v_B)[axis]
    return H, v_B[axis]


def heading(R):
    x = R.as_matrix()[:, 0]
    return np.arctan2(x[1], x[0])


def heading_row(estimate):
    """Row of the heading: the turn about the vertical axis, as the axes of B see it."""
    R, H = estimate.R.as_matrix(), np.zeros(15)
    x = R[:, 0]
    for j in range(3):
        turned = R @ skew(np.eye(3)[j])[:, 0]  # of x of B
        H[6 + j] = (x[0] * turned[1] - x[1] * turned[0]) / (x[0] ** 2 + x[1] ** 2)
    return H
