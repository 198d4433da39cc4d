"""Independent twin of a vehicle with joints, in NumPy and SciPy alone, to test the simulator's trees against.

Featherstone, "Rigid Body Dynamics Algorithms" (2008): spatial vectors in link frames, composite inertias for the
joint-space inertia and recursive Newton-Euler for the rest, with the water's terms of Fossen (2021) on every body. It
shares no code with the package and does not use MuJoCo.

World W, body B (the base) and the frame of each link as in ``twin``. A tree's velocity is zeta = [nu; q_dot], (6 + n,):
nu of the base in B, linear part first. All coefficients are about the origin of their body's frame, in its axes, linear
part first. Inside this module a spatial vector has its angular part first, as Featherstone's.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

from twin import Array, rotation, skew

_SWAP = [3, 4, 5, 0, 1, 2]  # linear part first <-> angular part first


@dataclass(frozen=True, eq=False)
class Rigid:
    """A rigid part of a body, in the body's frame."""

    mass: float  # kg
    r_g: Array  # (3,), m, centre of gravity
    inertia: Array  # (3, 3), kg m^2, about r_g


@dataclass(frozen=True, eq=False)
class TwinBody:
    """The base, or a link with its one joint."""

    parent: int  # index of the body that carries it; -1: this is the base
    parts: tuple[Rigid, ...]
    M_A: Array  # (6, 6)
    D_linear: Array  # (6, 6)
    D_quadratic: Array  # (6, 6), of abs(nu_j) nu_j
    displaced_mass: float  # kg
    r_b: Array  # (3,), m, centre of buoyancy
    p_0: Array = field(default_factory=lambda: np.zeros(3))  # (3,), m, its frame in its parent's at q = 0
    R_0: Array = field(default_factory=lambda: np.eye(3))  # (3, 3)
    slide: bool = False  # else a hinge
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))  # (3,), of length 1, in its frame
    anchor: Array = field(default_factory=lambda: np.zeros(3))  # (3,), m, a point of the axis of a hinge
    damping: float = 0.0  # N m s or N s/m, of the joint

    @functools.cached_property
    def mass(self) -> float:
        return sum(part.mass for part in self.parts)

    @functools.cached_property
    def M_RB(self) -> Array:
        """Rigid-body inertia about the frame's origin, (6, 6), linear part first."""
        total = np.zeros((6, 6))
        for part in self.parts:
            m, S = part.mass, skew(part.r_g)
            total += np.block([[m * np.eye(3), -m * S], [m * S, part.inertia - m * S @ S]])
        return total

    @functools.cached_property
    def spatial(self) -> tuple[Array, Array]:
        """M_RB and M_A, angular part first."""
        return self.M_RB[np.ix_(_SWAP, _SWAP)], self.M_A[np.ix_(_SWAP, _SWAP)]

    @functools.cached_property
    def S(self) -> Array:
        """Velocity of the link's frame for a joint velocity of 1, (6,), angular part first."""
        zero = np.zeros(3)
        return np.r_[zero, self.axis] if self.slide else np.r_[self.axis, np.cross(self.anchor, self.axis)]


@dataclass(frozen=True, eq=False)
class TwinTree:
    """The bodies, each after its parent, and what acts on them."""

    bodies: tuple[TwinBody, ...]
    v_c_W: Array = field(default_factory=lambda: np.zeros(3))  # (3,), m/s
    gravity: float = 9.81  # m/s^2
    # velocity (3,) of further water at a place (3,) and a time, also of complex ones; links have it at their r_b
    waves: Callable[[Array, complex], Array] | None = None
    # tau_dist(t) = bias + amplitude sin(2 pi frequency t) on the base, in B
    disturbance_bias: Array = field(default_factory=lambda: np.zeros(6))  # (6,), N and N m
    disturbance_amplitude: Array = field(default_factory=lambda: np.zeros(6))
    disturbance_frequency_hz: Array = field(default_factory=lambda: np.zeros(6))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.bodies) - 1


def turn(axis: Array, angle: float) -> Array:
    """Rotation matrix, (3, 3), about a unit axis (Rodrigues)."""
    S = skew(axis)
    return np.eye(3) + np.sin(angle) * S + (1.0 - np.cos(angle)) * S @ S


def in_parent(body: TwinBody, q: float) -> tuple[Array, Array]:
    """Rotation and origin of a link's frame in its parent's."""
    if body.slide:
        return body.R_0, body.p_0 + body.R_0 @ body.axis * q
    Q = turn(body.axis, q)
    return body.R_0 @ Q, body.p_0 + body.R_0 @ (body.anchor - Q @ body.anchor)


def poses(tree: TwinTree, p: Array, R: Array, q: Array) -> list[tuple[Array, Array]]:
    """Rotation and origin in W of each body's frame, from those of the base."""
    found = [(R, p)]
    for k, body in enumerate(tree.bodies[1:]):
        R_P, p_P = found[body.parent]
        R_L, p_L = in_parent(body, q[k])
        found.append((R_P @ R_L, p_P + R_P @ p_L))
    return found


def _cross_motion(V: Array) -> Array:
    """V x, (6, 6), on motion vectors; minus its transpose works on forces. Featherstone, eqs. (2.31), (2.32)."""
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = skew(V[:3])
    out[3:, :3] = skew(V[3:])
    return out


def _from_parent(body: TwinBody, q: float) -> Array:
    """Transform of motion vectors from the parent's frame, (6, 6); its transpose takes forces to it. Eq. (2.24)."""
    R, p = in_parent(body, q)
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = R.T
    out[3:, :3] = -R.T @ skew(p)
    return out


def inertia(tree: TwinTree, q: Array) -> Array:
    """M(q), (6 + n, 6 + n), of zeta, with the added mass: composite inertias, Featherstone, table 6.2."""
    X = [np.eye(6), *(_from_parent(body, x) for body, x in zip(tree.bodies[1:], q, strict=True))]
    composite = [sum(body.spatial) for body in tree.bodies]
    for k in range(tree.n, 0, -1):
        composite[tree.bodies[k].parent] += X[k].T @ composite[k] @ X[k]
    M = np.zeros((6 + tree.n, 6 + tree.n))
    M[:6, :6] = composite[0][np.ix_(_SWAP, _SWAP)]
    for k in range(1, tree.n + 1):
        force, at = composite[k] @ tree.bodies[k].S, k
        while at > 0:
            M[5 + at, 5 + k] = M[5 + k, 5 + at] = tree.bodies[at].S @ force
            force, at = X[at].T @ force, tree.bodies[at].parent
        M[:6, 5 + k] = M[5 + k, :6] = force[_SWAP]
    return M


def _water_at(tree: TwinTree, p: Array, v: Array, t: float) -> tuple[Array, Array, Array]:
    """Velocity of the water at a place in W, its rate along a path with the velocity v, and the water's acceleration,
    each (3,), by complex steps."""
    if tree.waves is None:
        return tree.v_c_W, np.zeros(3), np.zeros(3)
    h, v_c = 1e-30, tree.v_c_W + tree.waves(p, t).real
    along = [tree.waves(p + 1j * h * u, t + 1j * h).imag / h for u in (v, v_c)]
    return v_c, along[0], along[1]


def _resistance_of(
    body: TwinBody, tree: TwinTree, R: Array, V: Array, a: Array, p: Array | None = None, t: float = 0.0
) -> Array:
    """Inertial forces of a body and the water around it less the forces of weight, buoyancy and drag, (6,)."""
    M_RB, M_A = body.spatial
    r = np.zeros(3) if body.parent < 0 else body.r_b
    p_W = R @ r + (np.zeros(3) if p is None else p)
    v_c_W, rate_W, a_c_W = _water_at(tree, p_W, R @ (V[3:] + np.cross(V[:3], r)), t)
    v_c, up = R.T @ v_c_W, R.T @ [0.0, 0.0, 1.0]
    V_r = V - np.r_[np.zeros(3), v_c]
    a_r = a + np.r_[np.zeros(3), skew(V[:3]) @ v_c - R.T @ rate_W]  # what is constant in W turns in the link
    force = M_RB @ a - _cross_motion(V).T @ M_RB @ V
    force += M_A @ a_r - _cross_motion(V_r).T @ M_A @ V_r  # Kirchhoff's equations, Fossen (2021), sec. 6.3
    nu_r = V_r[_SWAP]
    force += ((body.D_linear + body.D_quadratic * np.abs(nu_r)) @ nu_r)[_SWAP]  # paper eq. (33)
    for r, upward in ((body.r_b, body.displaced_mass), *((part.r_g, -part.mass) for part in body.parts)):
        f = upward * tree.gravity * up
        force -= np.r_[skew(r) @ f, f]
    f = body.displaced_mass * (R.T @ a_c_W)  # of the pressure that accelerates the water
    return force - np.r_[skew(body.r_b) @ f, f]


def resistance(tree: TwinTree, R: Array, q: Array, zeta: Array, p: Array | None = None, t: float = 0.0) -> Array:
    """b(R_WB, q, zeta), (6 + n,), of M zeta_dot + b = tau, without the disturbance: recursive Newton-Euler. Waves need
    the place p of the base and the time t."""
    places = poses(tree, np.zeros(3) if p is None else p, R, q)
    X, V, a = [np.eye(6)], [zeta[:6][_SWAP]], [np.zeros(6)]
    for body, x, rate in zip(tree.bodies[1:], q, zeta[6:], strict=True):
        joint = body.S * rate
        X.append(_from_parent(body, x))
        V.append(X[-1] @ V[body.parent] + joint)
        a.append(X[-1] @ a[body.parent] + _cross_motion(V[-1]) @ joint)  # Featherstone, eq. (5.8)
    force = [
        _resistance_of(body, tree, R_L, V_L, a_L, p_L, t)
        for body, (R_L, p_L), V_L, a_L in zip(tree.bodies, places, V, a, strict=True)
    ]
    b = np.zeros(6 + tree.n)
    for k in range(tree.n, 0, -1):
        body = tree.bodies[k]
        b[5 + k] = body.S @ force[k] + body.damping * zeta[5 + k]
        force[body.parent] = force[body.parent] + X[k].T @ force[k]
    b[:6] = force[0][_SWAP]
    return b


def disturbance(tree: TwinTree, t: float) -> Array:
    """tau_dist(t), (6,), in B."""
    return tree.disturbance_bias + tree.disturbance_amplitude * np.sin(2.0 * np.pi * tree.disturbance_frequency_hz * t)


def acceleration(
    tree: TwinTree, R: Array, q: Array, zeta: Array, tau: Array, t: float = 0.0, p: Array | None = None
) -> Array:
    """zeta_dot, (6 + n,), under tau = [wrench on the base in B; joint torques], (6 + n,)."""
    load = tau - resistance(tree, R, q, zeta, p, t)
    load[:6] += disturbance(tree, t)
    return np.linalg.solve(inertia(tree, q), load)


def velocities(tree: TwinTree, q: Array, zeta: Array) -> list[Array]:
    """Velocity of each body in its frame, (6,), linear part first."""
    V: list[Array] = [zeta[:6][_SWAP]]
    for body, x, rate in zip(tree.bodies[1:], q, zeta[6:], strict=True):
        V.append(_from_parent(body, x) @ V[body.parent] + body.S * rate)
    return [each[_SWAP] for each in V]


def momentum_W(tree: TwinTree, p: Array, R: Array, q: Array, zeta: Array) -> Array:
    """Momentum of bodies and water, (6,), linear part first, in W about its origin, in still water."""
    total = np.zeros(6)
    for body, (R_L, p_L), nu in zip(tree.bodies, poses(tree, p, R, q), velocities(tree, q, zeta), strict=True):
        h = (body.M_RB + body.M_A) @ nu
        total += np.r_[R_L @ h[:3], R_L @ h[3:] + np.cross(p_L, R_L @ h[:3])]
    return total


def motion(
    tree: TwinTree,
    start: tuple[Array, Array, Array, Array],
    times: Array,
    tau: Callable[[float], Array] | None = None,
) -> tuple[Array, Array, Array, Array]:
    """p_WB, quat_WB, q and zeta, each (times, ...), from a tight integration of the start; tau is a function of t."""
    n = tree.n

    def rate(t: float, y: Array) -> Array:
        w, x, y_, z = quat = y[3:7] / np.linalg.norm(y[3:7])
        R, zeta = rotation(quat), y[7 + n :]
        E = 0.5 * np.array([[-x, -y_, -z], [w, -z, y_], [z, w, -x], [-y_, x, w]])
        given = np.zeros(6 + n) if tau is None else tau(t)
        zeta_dot = acceleration(tree, R, y[7 : 7 + n], zeta, given, t)
        return np.r_[R @ zeta[:3], E @ zeta[3:6], zeta[6:], zeta_dot]

    solution = solve_ivp(rate, (0.0, times[-1]), np.concatenate(start), "DOP853", times, rtol=1e-9, atol=1e-11)
    p, quat, q, zeta = np.split(solution.y.T, [3, 7, 7 + n], axis=1)
    return p, quat / np.linalg.norm(quat, axis=1)[:, None], q, zeta
