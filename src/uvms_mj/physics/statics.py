r"""Statics of a vehicle with an arm in NumPy: poses, Jacobians, inertia, and the wrench of the water at rest.

The velocity is :math:`\zeta = [\nu; \dot q]`. A frame C on a link has the velocity :math:`\nu_C = J \zeta` in its own
axes, and a wrench F at its origin in its axes is the generalised force :math:`J^\top F`. The closed forms use this
module; the loop has the kernels of :mod:`.tree`.
"""

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .fossen import coriolis_added_mass, damping, restoring


class Statics:
    """A vehicle with an arm at joint positions q (n,) [rad or m].

    Args:
        vehicle: with M_RB, M_A, D_linear, D_quadratic, mass, r_g, displaced_mass, r_b, and ``arm.links``, each of which
            has these too, and parent, slide, p_0, R_0, axis, anchor.

    Attributes:
        bodies: the base and the links.
        R, p: attitudes (n + 1, 3, 3) and positions (n + 1, 3) of their frames in B [m].
    """

    def __init__(self, vehicle: Any, q: np.ndarray) -> None:
        links = vehicle.arm.links
        self.bodies, self.q = (vehicle, *links), q
        n = len(links)
        self.R, self.p = np.tile(np.eye(3), (n + 1, 1, 1)), np.zeros((n + 1, 3))
        for k, (link, q_k) in enumerate(zip(links, q, strict=True), 1):
            above = link.parent + 1
            turn = np.eye(3) if link.slide else _rotation(link.axis, float(q_k))
            R_PL = link.R_0 @ turn
            moved = link.axis * q_k if link.slide else link.anchor - turn @ link.anchor
            self.R[k] = self.R[above] @ R_PL
            self.p[k] = self.p[above] + self.R[above] @ (link.p_0 + link.R_0 @ moved)

    @property
    def _ones(self) -> Sequence[float]:
        return (1.0,) * len(self.bodies)

    def pose(self, carrier: Any) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) and attitude (3, 3) in B of a frame on a link, with link (-1: the base), p and R."""
        k = carrier.link + 1
        return self.p[k] + self.R[k] @ carrier.p, self.R[k] @ carrier.R

    def jacobian(self, carrier: Any) -> np.ndarray:
        """J (6, 6 + n) of a frame on a link, in its axes."""
        p, R = self.pose(carrier)
        J = np.zeros((6, 6 + len(self.q)))
        J[:3, :3] = J[3:, 3:6] = np.eye(3)
        J[:3, 3:6] = -skew(p)
        k = carrier.link + 1
        while k > 0:
            link = self.bodies[k]
            axis = self.R[k] @ link.axis
            if link.slide:
                J[:3, 5 + k] = axis
            else:
                J[:3, 5 + k] = np.cross(axis, p - self.p[k] - self.R[k] @ link.anchor)
                J[3:, 5 + k] = axis
            k = link.parent + 1
        J[:3], J[3:] = R.T @ J[:3], R.T @ J[3:]
        return J

    @functools.cached_property
    def jacobians(self) -> np.ndarray:
        """(n + 1, 6, 6 + n), those of the frames of all bodies."""
        return np.array([self.jacobian(_Frame(k - 1)) for k in range(len(self.bodies))])

    def inertia(self, factors: Sequence[float] | None = None) -> np.ndarray:
        """M(q) (6 + n, 6 + n), added mass and armature included, with a factor for that of each body."""
        M = np.zeros((6 + len(self.q),) * 2)
        for body, J, factor in zip(self.bodies, self.jacobians, factors or self._ones, strict=True):
            M += factor * (J.T @ (body.M_RB + body.M_A) @ J)
        for k, link in enumerate(self.bodies[1:]):
            M[6 + k, 6 + k] += (factors or self._ones)[1 + k] * link.armature
        return M

    def restoring(self, R_WB: np.ndarray, gravity_W: np.ndarray, factors: Sequence[float] | None = None) -> np.ndarray:
        """g (6 + n,): minus weight and buoyancy of all bodies, with a factor for those of each body."""
        total, g = np.zeros(6 + len(self.q)), np.empty(6)
        for body, R, J, factor in zip(self.bodies, self.R, self.jacobians, factors or self._ones, strict=True):
            restoring(body.mass, body.displaced_mass, body.r_g, body.r_b, gravity_W, R_WB @ R, g)
            total += factor * (J.T @ g)
        return total

    def stream(self, R_WB: np.ndarray, v_c_W: np.ndarray) -> np.ndarray:
        """The wrench (6 + n,) of a constant current on all bodies at rest, -C_A(nu_r) nu_r - D(nu_r) nu_r."""
        total, nu_r, part = np.zeros(6 + len(self.q)), np.zeros(6), np.empty(6)
        for body, R, J in zip(self.bodies, self.R, self.jacobians, strict=True):
            nu_r[:3] = -(R_WB @ R).T @ v_c_W
            coriolis_added_mass(body.M_A, nu_r, part)
            wrench = -part
            damping(body.D_linear, body.D_quadratic, nu_r, part)
            total += J.T @ (wrench - part)
        return total


class _Frame:
    """The frame of a link itself."""

    p, R = np.zeros(3), np.eye(3)

    def __init__(self, link: int) -> None:
        self.link = link


def skew(a: np.ndarray) -> np.ndarray:
    """S(a) (3, 3): S(a) b = a x b."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation (3, 3) by an angle [rad] about a unit vector (3,)."""
    S = skew(axis)
    return np.eye(3) + math.sin(angle) * S + (1.0 - math.cos(angle)) * (S @ S)
