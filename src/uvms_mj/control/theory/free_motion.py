r"""The motion that a task leaves free: where the base and the joints rest while the law holds the frame of the task.

A law holds its frame by the wrench F, so that the joint positions q (n,) are the only unknowns: the base follows from
them. The tree is at rest where the posture balances what pushes it,

.. math::

    r(q) = \left[ M^{-1} \left( J^\top F + \tau_{posture} + d(q, R_{WB}) - g(q, R_{WB}) \right) \right]_q = 0, \qquad
    J M^{-1} (\dots) = 0,

with the current on all links in d, and F from the second equation. The rest that counts is the one that the slow motion

.. math:: 2\, \mathrm{s}^{-1} (\dot q - \bar J_q \nu_T) = r(q)

reaches from the initial posture (:mod:`.approach`), within the ranges of the joints, while the frame moves with nu_T
along its track: about the motion of the levels, which are critically damped. Where the current pushes along a motion
that no level of the posture holds, there is none, and the arm folds or stretches up to a stop.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...physics.flow import add_tether
from ...physics.frames import attitude, quat_error
from ...physics.operational import ATTITUDE, FREEDOM, JOINTS, STATION
from ...physics.statics import Statics
from ..posture import posture_constants
from .approach import approach, decays
from .task_motion import Track, between
from .terms import ThrustMap

_LARGEST = 0.3
"""Largest change of a joint in one step of the slow motion [rad or m]."""
_STEPS = 200
_FIRST = 0.1
"""The first step of the slow motion [s]."""
_DAMPING = 2.0
"""Its damping over its inertia [1/s]."""
_SMALL = 1e-6
"""Change of a joint for a derivative [rad or m]."""


def surroundings(setup: Any, tree: Statics, p_WB: np.ndarray, R_WB: np.ndarray) -> np.ndarray:
    """The generalised force (6 + n,) of current, weight, buoyancy, disturbance and tether on a tree at rest."""
    scenario = setup.scenario
    v_c_W = scenario.current.steady_at(-p_WB[2])
    total: np.ndarray = tree.stream(R_WB, v_c_W) - tree.restoring(R_WB, setup.gravity_W)
    total[:6] += scenario.disturbance.at_last
    if scenario.tether.factor:
        nu_r = np.concatenate([-R_WB.T @ v_c_W, np.zeros(3)])
        add_tether(scenario.tether.factor, scenario.tether.position, nu_r, total[:6])
    return total


def beyond(links: Sequence[Any], q: np.ndarray) -> str:
    """The reason why joints can't be at q (n,); empty if they can."""
    for link, q_k in zip(links, q, strict=True):
        if not link.range[0] <= q_k <= link.range[1]:
            end = link.range[int(q_k > link.range[0])]
            at = f"{end:.4g} m" if link.slide else f"{math.degrees(end):.4g} deg"
            return f"{link.joint} moves to the end of its range, {at}"
    return ""


@dataclass(frozen=True, eq=False)
class Push:
    """What acts on the free motion at rest in one posture.

    Attributes:
        r: (n,) acceleration of the joints [rad/s^2 or m/s^2].
        tau: (6 + n,) commanded wrench in B and torques of the joints [N, N m].
        J_bar: (6 + n, 6) velocity of the tree per velocity of the frame of the task, in its axes.
    """

    r: np.ndarray
    tau: np.ndarray
    J_bar: np.ndarray


class FreeMotion:
    """The free motion of a run's vehicle with joints while the frame of its task is on a track; an
    :class:`.approach.Motion` of q (n,).

    Args:
        setup: the run's :class:`uvms_mj.setup.base.Setup`; its joint interface obeys torques.
        thrust_map: what the thrusters make of a commanded wrench.
        track: of the frame of the task.
    """

    def __init__(self, setup: Any, thrust_map: ThrustMap, track: Track) -> None:
        self.setup, self.thrust_map, self.track, self.held = setup, thrust_map, track, track.at(0.0)
        self.frame, self.links = setup.plant.probe.carrier, setup.vehicle.arm.links
        n = len(self.links)
        self.inertia, self.damping = np.zeros((n, n)), _DAMPING * np.eye(n)
        self.largest, self.sharp, self.ends = _LARGEST, 1e-3, track.ends
        self.posture, estimates = PostureAtRest(setup), setup.scenario.estimates
        given = [estimates, *(estimates.of(link.name) for link in self.links)]
        self.inertia_hat, self.restoring_hat = [e.inertia for e in given], [e.restoring for e in given]

    def base(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) and attitude (3, 3) of B in W at joint positions q (n,)."""
        p, R = Statics(self.setup.vehicle, q).pose(self.frame)
        R_WB = self.held.R_WB @ R.T
        return self.held.position - R_WB @ p, R_WB

    def push(self, q: np.ndarray) -> Push:
        """What acts at joint positions q (n,)."""
        setup = self.setup
        tree = Statics(setup.vehicle, q)
        model, J = tree.with_coefficients(setup.nominal), tree.jacobian(self.frame)
        p_WB, R_WB = self.base(q)
        M_hat = model.inertia(self.inertia_hat)
        M_inv = np.linalg.inv(M_hat)
        J_bar = np.linalg.solve(J @ M_inv @ J.T, J @ M_inv).T
        P = M_inv - J_bar @ (J @ M_inv)
        g_hat = model.restoring(R_WB, setup.gravity_W, self.restoring_hat)
        tau_posture = M_hat @ (self.posture(p_WB, R_WB, q, M_inv, P) + P @ g_hat)
        others = surroundings(setup, tree, p_WB, R_WB) + J.T @ self.held.tau_c
        delivered = np.eye(len(others))
        delivered[:6, :6] = self.thrust_map.T
        by = np.linalg.solve(tree.inertia(), np.column_stack([delivered @ J.T, delivered @ tau_posture + others]))
        F = -np.linalg.solve(J @ by[:, :6], J @ by[:, 6])
        return Push((by[:, :6] @ F + by[:, 6])[6:], J.T @ F + tau_posture, J_bar)

    def speeds(self, motion: np.ndarray, h: float) -> np.ndarray:
        """The largest speed (n,) of the joints [rad/s or m/s] as the vehicle begins to drift and the frame of the task
        moves with the velocities (k, 3) in W, h [s] after each other: that of a linear oscillator from the initial
        posture with the slowest level of the posture, which the push and the acceleration of the frame drive."""
        given, push = self.setup.scenario.posture, self.push(self.setup.start.q)
        levels = [getattr(given, f"{level}_frequency") for level in given.order]
        omega = min(levels) if "joints" in given.order else 0.0
        damping = 2.0 * given.damping_ratio * omega if omega else given.free_damping
        driven = np.diff(motion @ self.held.R_WB @ push.J_bar[6:, :3].T, axis=0) + h * push.r
        y, y_dot, fastest = np.zeros((3, len(push.r)))
        for change in driven:  # implicit Euler
            y_dot = (y_dot + change - h * omega * omega * y) / (1.0 + h * damping + h * h * omega * omega)
            y = y + h * y_dot
            fastest = np.maximum(fastest, np.abs(y_dot))
        return fastest

    def __call__(self, q: np.ndarray, /) -> np.ndarray:
        return self.push(q).r

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """dr/dq (n, n)."""
        r = self(q)
        return np.array([(self(q + e) - r) / _SMALL for e in _SMALL * np.eye(len(q))]).T

    def stable(self, q: np.ndarray) -> bool:
        """Whether the slow motion stays at a rest."""
        return decays(self.jacobian(q), self.damping)

    def moved(self, q: np.ndarray, change: np.ndarray) -> np.ndarray:
        """q after a change."""
        return q + change

    def lead(self, q: np.ndarray, t: float, step: float) -> np.ndarray:
        """Move the frame of the task along its track. Returns the change of q that comes with it."""
        self.held, there = (self.track.end if each >= self.ends else self.track.at(each) for each in (t, t + step))
        moved = between(self.held, there)
        change = self.push(q).J_bar[6:] @ moved if moved.any() else np.zeros(len(q))
        self.held = there
        return change

    def passed(self, t: float, q: np.ndarray) -> str:
        """The reason why a joint can't be there; empty if all can."""
        return beyond(self.links, q)

    def rest(self) -> np.ndarray | str:
        """q (n,) at the rest that the slow motion reaches from the initial posture, or the reason why there is none."""
        start = self.setup.start.q
        found: np.ndarray | str = approach(self, start, np.zeros(len(start)), _FIRST, _STEPS)
        return found

    def infeasible(self, tau: np.ndarray) -> str:
        """The reason why motors, with the friction of their gears, or thrusters can't hold a rest with the commanded
        tau (6 + n,); empty if they can."""
        for link, torque in zip(self.links, tau[6:], strict=True):
            if abs(torque) > link.effort + link.friction:
                unit = "N" if link.slide else "N m"
                return f"{link.joint} needs {torque:.4g} {unit} at rest and has {link.effort:.4g} {unit}"
        return self.thrust_map.infeasible(self.thrust_map.T @ tau[:6])


class PostureAtRest:
    """The acceleration that the posture demands of a vehicle at rest, in the motion that the task leaves free.

    It is that of the kernel :func:`.operational.posture`, with the same levels in strict priority, at zero velocity."""

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
