"""A body in the water: the coefficients that the base of a vehicle and each link of its arm have."""

import functools
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Body:
    """Coefficients of a body about the origin of its frame, in its axes, as read-only arrays."""

    M_RB: np.ndarray
    """(6, 6) rigid-body inertia [kg, kg m, kg m^2]."""
    M_A: np.ndarray
    """(6, 6) added mass [kg, kg m, kg m^2]."""
    D_linear: np.ndarray
    """(6, 6) linear damping; D(nu) nu = D_linear nu + D_quadratic (abs(nu) nu) [N s/m, N s, N m s]."""
    D_quadratic: np.ndarray
    """(6, 6) quadratic damping: D_quadratic[i, j] multiplies abs(nu_j) nu_j [N s^2/m^2, N s^2/m, N s^2, N m s^2]."""
    displaced_mass: float
    """[kg]"""
    r_b: np.ndarray
    """(3,) centre of buoyancy [m]."""

    @functools.cached_property
    def M(self) -> np.ndarray:
        """(6, 6) M = M_RB + M_A."""
        M = self.M_RB + self.M_A
        M.setflags(write=False)
        return M

    @property
    def mass(self) -> float:
        """Rigid mass [kg]."""
        return float(self.M_RB[0, 0])

    @property
    def r_g(self) -> np.ndarray:
        """(3,) centre of gravity [m]: M_RB[3:, :3] = m S(r_g)."""
        return np.array([self.M_RB[5, 1], self.M_RB[3, 2], self.M_RB[4, 0]]) / (self.mass or 1.0)


def skew(a: np.ndarray) -> np.ndarray:
    """S(a) (3, 3): S(a) b = a x b."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
