r"""Statics of a vehicle with an arm in NumPy: poses, Jacobians, inertia, and the wrench of the water at rest.

The velocity is :math:`\zeta = [\nu; \dot q]`. A frame C on a link has the velocity :math:`\nu_C = J \zeta` in its own
axes, and a wrench F at its origin in its axes is the generalised force :math:`J^\top F`. The closed forms use this
module; the loop has the kernels of :mod:`.tree`.
"""

import copy
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .frames import cross_products
from .vehicle import VehicleLike


@dataclass(frozen=True, eq=False)
class _Bodies:
    """Coefficients of the base and the links, one row a body, and which joints carry each of them (m, n)."""

    M_RB: np.ndarray
    M_A: np.ndarray
    D_linear: np.ndarray
    D_quadratic: np.ndarray
    buoyant: np.ndarray
    """(m,) displaced mass minus mass [kg]."""
    lever: np.ndarray
    """(m, 3) mass times centre of gravity minus displaced mass times centre of buoyancy [kg m]."""
    armature: np.ndarray
    carried: np.ndarray

    @classmethod
    @functools.lru_cache(maxsize=8)
    def of(cls, vehicle: VehicleLike) -> "_Bodies":
        bodies, links = (vehicle, *vehicle.arm.links), vehicle.arm.links
        carried = np.zeros((len(bodies), len(links)), dtype=bool)
        for k, link in enumerate(links, 1):
            carried[k] = carried[link.parent + 1]
            carried[k, k - 1] = True
        names = ("M_RB", "M_A", "D_linear", "D_quadratic")
        M_RB, M_A, D_linear, D_quadratic = (np.array([getattr(b, name) for b in bodies]) for name in names)
        buoyant = np.array([b.displaced_mass - b.mass for b in bodies])
        lever = np.array([b.mass * b.r_g - b.displaced_mass * b.r_b for b in bodies])
        armature = np.array([link.armature for link in links])
        return cls(M_RB, M_A, D_linear, D_quadratic, buoyant, lever, armature, carried)


class Statics:
    """A vehicle with an arm at joint positions q (n,) [rad or m].

    Args:
        vehicle: with M_RB, M_A, D_linear, D_quadratic, mass, r_g, displaced_mass, r_b, and ``arm.links``, each of which
            has these too, and parent, slide, p_0, R_0, axis, anchor, armature.

    Attributes:
        bodies: the base and the links.
        R, p: attitudes (n + 1, 3, 3) and positions (n + 1, 3) of their frames in B [m].
    """

    def __init__(self, vehicle: VehicleLike, q: np.ndarray) -> None:
        self.vehicle, self.bodies, self.q = vehicle, (vehicle, *vehicle.arm.links), q
        n = len(vehicle.arm.links)
        self.R, self.p = np.tile(np.eye(3), (n + 1, 1, 1)), np.zeros((n + 1, 3))
        self.axes, self.anchors = np.zeros((n, 3)), np.zeros((n, 3))  # of the joints, in B
        for k, (link, q_k) in enumerate(zip(vehicle.arm.links, q, strict=True), 1):
            above = link.parent + 1
            turn = np.eye(3) if link.slide else _rotation(link.axis, float(q_k))
            moved = link.axis * q_k if link.slide else link.anchor - turn @ link.anchor
            self.R[k] = self.R[above] @ (link.R_0 @ turn)
            self.p[k] = self.p[above] + self.R[above] @ (link.p_0 + link.R_0 @ moved)
            self.axes[k - 1], self.anchors[k - 1] = self.R[k] @ link.axis, self.p[k] + self.R[k] @ link.anchor

    def with_coefficients(self, vehicle: VehicleLike) -> "Statics":
        """The same posture of a vehicle whose links are in the same places and have other coefficients."""
        other = copy.copy(self)
        other.vehicle, other.bodies = vehicle, (vehicle, *vehicle.arm.links)
        vars(other).pop("_bodies", None)
        return other

    @functools.cached_property
    def _bodies(self) -> _Bodies:
        return _Bodies.of(self.vehicle)

    def pose(self, carrier: Any) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) and attitude (3, 3) in B of a frame on a link, with link (-1: the base), p and R."""
        k = carrier.link + 1
        return self.p[k] + self.R[k] @ carrier.p, self.R[k] @ carrier.R

    def jacobian(self, carrier: Any) -> np.ndarray:
        """J (6, 6 + n) of a frame on a link, in its axes."""
        p, R = self.pose(carrier)
        return self._jacobians(p[None], R[None], self._bodies.carried[carrier.link + 1][None])[0]

    @functools.cached_property
    def jacobians(self) -> np.ndarray:
        """(n + 1, 6, 6 + n), of the frames of all bodies."""
        return self._jacobians(self.p, self.R, self._bodies.carried)

    def _jacobians(self, p: np.ndarray, R: np.ndarray, carried: np.ndarray) -> np.ndarray:
        """(m, 6, 6 + n) of m frames with the poses p (m, 3), R (m, 3, 3), and the joints that carry them (m, n)."""
        J = np.zeros((len(p), 6, 6 + len(self.q)))
        J[:, :3, :3] = J[:, 3:, 3:6] = np.eye(3)
        x, y, z = p.T
        J[:, 0, 4], J[:, 0, 5], J[:, 1, 3], J[:, 1, 5], J[:, 2, 3], J[:, 2, 4] = z, -y, -z, x, y, -x
        slides = np.array([link.slide for link in self.vehicle.arm.links], dtype=bool)
        a, arm = self.axes, p[:, None] - self.anchors
        turning = np.swapaxes(cross_products(a, arm), 1, 2)
        J[:, :3, 6:] = np.where(slides, a.T, turning) * carried[:, None]
        J[:, 3:, 6:] = np.where(slides, 0.0, a.T) * carried[:, None]
        R_T = np.swapaxes(R, 1, 2)
        return np.concatenate([R_T @ J[:, :3], R_T @ J[:, 3:]], axis=1)

    def inertia(self, factors: Sequence[float] | None = None) -> np.ndarray:
        """M(q) (6 + n, 6 + n), added mass and armature included, with a factor for the added mass and inertia of each
        body."""
        bodies, J = self._bodies, self.jacobians
        inertia, armature = bodies.M_RB + bodies.M_A, bodies.armature
        if factors is not None:
            inertia, armature = np.array(factors)[:, None, None] * inertia, np.array(factors)[1:] * armature
        M = (np.swapaxes(J, 1, 2) @ inertia @ J).sum(axis=0)
        M[6:, 6:] += np.diag(armature)
        return M

    def mobility(self, carrier: Any) -> np.ndarray:
        """J M^-1 J^T (6, 6), the acceleration of a frame by wrenches at its origin: the inverse of Lambda."""
        J = self.jacobian(carrier)
        return J @ np.linalg.solve(self.inertia(), J.T)

    def restoring(self, R_WB: np.ndarray, gravity_W: np.ndarray, factors: Sequence[float] | None = None) -> np.ndarray:
        """g (6 + n,): minus weight and buoyancy of all bodies, with a factor for each body."""
        g = gravity_W @ R_WB @ self.R  # in the links' axes
        wrenches = np.hstack([self._bodies.buoyant[:, None] * g, cross_products(g, self._bodies.lever)])
        return self._generalised(wrenches if factors is None else np.array(factors)[:, None] * wrenches)

    def stream(self, R_WB: np.ndarray, v_c_W: np.ndarray) -> np.ndarray:
        """The wrench (6 + n,) of a constant current on all bodies at rest, -C_A(nu_r) nu_r - D(nu_r) nu_r."""
        bodies, nu_r = self._bodies, np.zeros((len(self.bodies), 6))
        nu_r[:, :3] = -(v_c_W @ R_WB @ self.R)
        wrenches = bodies.D_linear @ nu_r[..., None] + bodies.D_quadratic @ (np.abs(nu_r) * nu_r)[..., None]
        momentum = (bodies.M_A @ nu_r[..., None])[:, :3, 0]
        wrenches = wrenches[..., 0]
        wrenches[:, 3:] += cross_products(nu_r[:, :3], momentum)
        return -self._generalised(wrenches)

    def _generalised(self, wrenches: np.ndarray) -> np.ndarray:
        """(6 + n,) of wrenches (n + 1, 6) at the origins of all bodies, in their axes."""
        return np.einsum("kij,ki->j", self.jacobians, wrenches)


def _rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation (3, 3) by an angle [rad] about a unit vector (3,)."""
    x, y, z = axis.tolist()
    c, s = math.cos(angle), math.sin(angle)
    v = 1.0 - c
    return np.array(
        [
            [c + v * x * x, v * x * y - s * z, v * x * z + s * y],
            [v * x * y + s * z, c + v * y * y, v * y * z - s * x],
            [v * x * z - s * y, v * y * z + s * x, c + v * z * z],
        ]
    )
