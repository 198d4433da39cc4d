"""The static force of the list of contacts at many poses at once, for the balance of a vehicle at rest.

It is that of the kernel :func:`uvms_mj.physics.contacts.pair_force` without velocity, dampers and friction.
"""

from typing import Any

import numpy as np

from ...physics.surfaces import BOX, CYLINDER, PLANE

_LEAST = 1e-300


class ContactSprings:
    """The walls and bumpers of a run's :class:`uvms_mj.plant.contacts.Contacts` at rest, without dampers and friction.

    Attributes:
        carriers: (n,) index of the frame that the body of each contact is fixed to.
        friction: (n,) whether each contact has friction.
        convex: whether all walls are planes in front of the origin of C: then the poses without contact are a convex
            set, and the turn of C does not matter.
        size: least radius or half edge of a wall, infinite for planes [m].
    """

    def __init__(self, setup: Any) -> None:
        surfaces, pairs = setup.contacts.records(lambda _: 1.0)
        contact, walls = pairs["contact"], surfaces[pairs["surface"]]
        self.carriers, self.friction = pairs["carrier"].copy(), contact["friction"] > 0.0
        self._ends_C, self._radius, self._capsules = pairs["ends_C"], pairs["radius"], pairs["capsule"] != 0
        self._k, self._k_b = contact["stiffness"], pairs["bumper_stiffness"]
        self._w_1, self._k_1 = pairs["layer_depth"], pairs["layer_stiffness"]
        self._p_WS, self._R_WS = walls["p_WS"], walls["R_WS"]
        self._kind, self._half = walls["kind"], walls["extent"]
        self._soft = self._k_b > 0.0
        self._give = np.where(self._soft, self._k_b, 1.0)
        curved = surfaces["kind"] != PLANE
        self.convex = not (curved.any() or self._ends_C.any())
        half = np.where((surfaces["kind"] == BOX)[:, None], surfaces["extent"], surfaces["extent"][:, :1])[curved]
        self.size = float(half.min(initial=np.inf))

    def __len__(self) -> int:
        return len(self._radius)

    def wrenches(self, p_WC: np.ndarray, R_WC: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The forces of all contacts on their bodies.

        Args:
            p_WC: (..., n, 3) position in W of the frame C that the body of each contact is fixed to [m].
            R_WC: (..., n, 3, 3) its attitude.

        Returns:
            The wrench (..., n, 6) of each contact in C at its origin, its normal force (..., n) [N] and depth
            (..., n), zero without contact [m].
        """
        centre = p_WC + _turned(R_WC, self._ends_C[:, 0])
        if self._capsules.any():
            end = p_WC + _turned(R_WC, self._ends_C[:, 1])
            centre = centre + self._nearest(centre, end)[..., None] * (end - centre)
        distance, n = self._distance(centre)
        distance = distance - self._radius
        depth = np.maximum(0.0, -distance)
        f_n = self._force(depth)
        arm = centre - p_WC - (self._radius + 0.5 * distance)[..., None] * n
        f_W = f_n[..., None] * n
        return np.concatenate([_to_body(R_WC, f_W), _to_body(R_WC, _cross(arm, f_W))], axis=-1), f_n, depth

    def _force(self, depth: np.ndarray) -> np.ndarray:
        """The normal force of wall and bumper in series, F_c(w) = k_b x with depth = w + x."""
        w = np.where(self._soft, depth * self._give / (self._give + self._k), depth)
        beyond = w > self._w_1
        f_0 = np.where(beyond, (self._k - self._k_1) * np.where(beyond, self._w_1, 0.0), 0.0)
        k = np.where(beyond, self._k_1, self._k)
        force = f_0 + k * depth
        return np.where(self._soft, self._give * force / (self._give + k), force)

    def _distance(self, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance (..., n) of points from their surfaces, and the normals (..., n, 3) out of these, in W."""
        q = _to_body(self._R_WS, centre - self._p_WS)
        along = np.where((self._kind == CYLINDER)[:, None], [1.0, 1.0, 0.0], 1.0) * q
        size = np.sqrt((along * along).sum(axis=-1))
        distance = size - self._half[:, 0]
        n = np.where(size[..., None] > 0.0, along / np.maximum(size, _LEAST)[..., None], [-1.0, 0.0, 0.0])
        plane, box = self._kind == PLANE, self._kind == BOX
        if plane.any():
            distance = np.where(plane, -q[..., 0], distance)
            n = np.where(plane[:, None], [-1.0, 0.0, 0.0], n)
        if box.any():
            beyond = np.abs(q) - self._half
            out = np.copysign(np.maximum(beyond, 0.0), q)
            outside = np.sqrt((out * out).sum(axis=-1))
            inside, nearest = beyond.max(axis=-1), np.eye(3)[beyond.argmax(axis=-1)]
            face = nearest * np.where(q >= 0.0, 1.0, -1.0)
            of_box = np.where((inside <= 0.0)[..., None], face, out / np.maximum(outside, _LEAST)[..., None])
            distance = np.where(box, np.where(inside <= 0.0, inside, outside), distance)
            n = np.where(box[:, None], of_box, n)
        return distance, _turned(self._R_WS, n)

    def _nearest(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Where on their segments (..., n) the points nearest to the centre or the axis of the surfaces are, from 0 at
        a to 1 at b; 0.5 if a segment is parallel to the axis. Zero for a sphere in place of a capsule."""
        d, e = b - a, self._p_WS - a
        axis = self._R_WS[:, :, 2]
        axial, shift = (d * axis).sum(axis=-1), (e * axis).sum(axis=-1)
        along, length = (d * e).sum(axis=-1), (d * d).sum(axis=-1)
        cylinder = self._kind == CYLINDER
        along, size = np.where(cylinder, along - axial * shift, along), length - np.where(cylinder, axial * axial, 0.0)
        parallel = size <= 1e-12 * length
        part = np.where(parallel, 0.5, np.clip(along / np.where(parallel, 1.0, size), 0.0, 1.0))
        return np.where(self._capsules, part, 0.0)


def _turned(R: np.ndarray, v: np.ndarray) -> np.ndarray:
    """R v of matrices (..., 3, 3) and vectors (..., 3)."""
    return (R @ v[..., None])[..., 0]


def _to_body(R: np.ndarray, v: np.ndarray) -> np.ndarray:
    """R^T v of matrices (..., 3, 3) and vectors (..., 3)."""
    return (v[..., None, :] @ R)[..., 0, :]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The product a x b of vectors (..., 3); np.cross takes several times as long."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    i, j, k = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * k - z * j, z * i - x * k, x * j - y * i], axis=-1)
