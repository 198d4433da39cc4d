"""Places and coefficients in another frame.

A :class:`Pose` of a frame F in a frame G has R (3, 3) and p (3,): a point r of F is at p + R r in G. A rigid body has
the velocity nu_F = H nu_G with H = [R^T, -R^T S(p); 0, R^T], so that a matrix about the origin of F is H^T M H about
the origin of G: M_RB, M_A and D_linear (Fossen (2021), Appendix C). D_quadratic has the form abs(nu_j) nu_j at one
point and in one set of axes only; it can be turned by quarter turns and mirrored, and not be moved.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ..arm import skew


@dataclass(frozen=True, eq=False)
class Pose:
    """The pose of a frame in another one: R (3, 3), p (3,) [m]."""

    R: np.ndarray
    p: np.ndarray

    def __matmul__(self, other: "Pose") -> "Pose":
        return Pose(self.R @ other.R, self.p + self.R @ other.p)

    def inverse(self) -> "Pose":
        return Pose(self.R.T, -self.R.T @ self.p)

    def point(self, r: np.ndarray) -> np.ndarray:
        return self.p + self.R @ r

    @property
    def quat(self) -> np.ndarray:
        """(4,) w x y z."""
        return Rotation.from_matrix(self.R).as_quat(scalar_first=True)

    @classmethod
    def of_rpy(cls, p, rpy, degrees: bool = False) -> "Pose":
        """From roll, pitch, yaw about fixed axes x, y, z, as in URDF and SDF: R = R_z R_y R_x."""
        return cls(Rotation.from_euler("xyz", rpy, degrees=degrees).as_matrix(), np.array(p, float))


HERE = Pose(np.eye(3), np.zeros(3))
NED = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
"""Factors of nu and tau between x forward, y right, z down and B: half a turn about x."""


def moved(M: np.ndarray, pose: Pose) -> np.ndarray:
    """H^T M H (6, 6) about the origin of G, from M about the origin of F, whose pose in G is given."""
    H = np.zeros((6, 6))
    H[:3, :3] = H[3:, 3:] = pose.R.T
    H[:3, 3:] = -pose.R.T @ skew(pose.p)
    return H.T @ M @ H


def mirrored(M: np.ndarray, signs: np.ndarray = NED) -> np.ndarray:
    """M (6, 6) in axes whose components of nu and tau have these factors (6,); D_quadratic too, whose entry [i, j]
    multiplies abs(nu_j) nu_j."""
    return signs[:, None] * M * signs


def mirrored_products(terms: dict[tuple[int, int, int, bool], float], signs: np.ndarray = NED):
    """Coefficients of products by axis, first and second velocity, and bars, in axes with other signs."""
    return {
        (i, j, k, bars): float(c * signs[i] * signs[j] * (1.0 if bars else signs[k]))
        for (i, j, k, bars), c in terms.items()
    }


def product_name(i: int, j: int, k: int, bars: bool) -> str:
    """The name of a product in a vehicle's file: Yuv, or Yr|u|."""
    velocities = "uvwpqr"
    return f"{'XYZKMN'[i]}{velocities[j]}{f'|{velocities[k]}|' if bars else velocities[k]}"


def quarter_turn(R: np.ndarray) -> np.ndarray | None:
    """R with exact entries if it is made of quarter turns, else None."""
    near = np.round(R)
    return near if np.abs(R - near).max() < 1e-9 else None


def about_cg(I_o: np.ndarray, mass: float, r_g: np.ndarray) -> np.ndarray:
    """Inertia (3, 3) about the centre of gravity, from the one about the origin (Huygens and Steiner)."""
    return I_o - mass * (r_g @ r_g * np.eye(3) - np.outer(r_g, r_g))
