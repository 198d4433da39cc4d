r"""The motion that a task leaves free: where the base and the joints rest while the law holds the frame of the task.

A law holds its frame by the wrench F, so that the joint positions q (n,) are the only unknowns: the base follows from
them. The tree is at rest where the posture balances what pushes it,

.. math::

    r(q) = \left[ M^{-1} \left( J^\top F + \tau_{posture} + d(q, R_{WB}) - g(q, R_{WB}) \right) \right]_q = 0, \qquad
    J M^{-1} (\dots) = 0,

with the current on all links in d, and F from the second equation. The rest that counts is the one that the slow motion
:math:`\dot q = r(q)` reaches from the initial posture (linearly implicit Euler with growing steps, as in
:mod:`.tool_balance`), within the ranges of the joints. Where the current pushes along a motion that no level of the
posture holds, there is none, and the arm folds or stretches up to a stop.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..physics.frames import quat_from_euler_deg, rotation_matrix
from ..physics.statics import Statics
from ..physics.tether import add_tether
from .delivery import Delivery
from .posture_rest import PostureAtRest

_LARGEST_CHANGE = 0.3
"""Largest change of a joint in one step of the slow motion [rad or m]."""
_STEPS = 60
_AT_REST = 1e-6
"""Largest acceleration of a joint at rest [rad/s^2 or m/s^2]."""
_GROWS = 1e-3
"""Least growth of the slow motion about a rest that is not stable [1/s]. Zero is a motion that nothing pushes."""
_SMALL = 1e-6
"""Change of a joint for a derivative [rad or m]."""


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
    """The free motion of a run's vehicle with joints while the frame of its task stays at a pose.

    Args:
        setup: the run's :class:`uvms_mj.analysis.setup.Setup`; its joint interface obeys torques.
        delivery: what the thrusters make of a commanded wrench.
        position, attitude_deg: (3,) pose of the frame of the task in W [m, deg].
        tau_c: (6,) contact wrench on that frame, at its origin, in its axes [N, N m].
    """

    def __init__(self, setup: Any, delivery: Delivery, position: Any, attitude_deg: Any, tau_c: np.ndarray) -> None:
        self.setup, self.delivery, self.tau_c = setup, delivery, tau_c
        self.frame, self.links = setup.plant.probe.carrier, setup.vehicle.arm.links
        self.position, self.R_d = np.array(position), rotation_matrix(quat_from_euler_deg(*attitude_deg))
        self.posture, estimates = PostureAtRest(setup), setup.scenario.estimates
        given = [estimates, *(estimates.of(link.name) for link in self.links)]
        self.inertia, self.restoring = [e.inertia for e in given], [e.restoring for e in given]

    def push(self, q: np.ndarray) -> Push:
        """What acts at joint positions q (n,)."""
        setup, scenario = self.setup, self.setup.scenario
        tree = Statics(setup.vehicle, q)
        model, J = tree.with_coefficients(setup.nominal), tree.jacobian(self.frame)
        p, R = tree.pose(self.frame)
        R_WB = self.R_d @ R.T
        p_WB = self.position - R_WB @ p
        M_hat = model.inertia(self.inertia)
        M_inv = np.linalg.inv(M_hat)
        J_bar = np.linalg.solve(J @ M_inv @ J.T, J @ M_inv).T
        P = M_inv - J_bar @ (J @ M_inv)
        g_hat = model.restoring(R_WB, setup.gravity_W, self.restoring)
        tau_posture = M_hat @ (self.posture(p_WB, R_WB, q, M_inv, P) + P @ g_hat)
        v_c_W = scenario.current.steady_at(-p_WB[2])
        others = tree.stream(R_WB, v_c_W) - tree.restoring(R_WB, setup.gravity_W) + J.T @ self.tau_c
        others[:6] += scenario.disturbance.at_last
        if scenario.tether.factor:
            nu_r = np.concatenate([-R_WB.T @ v_c_W, np.zeros(3)])
            add_tether(scenario.tether.factor, scenario.tether.position, nu_r, others[:6])
        delivered = np.eye(len(others))
        delivered[:6, :6] = self.delivery.T
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
        driven = np.diff(motion @ self.R_d @ push.J_bar[6:, :3].T, axis=0) + h * push.r
        y, y_dot, fastest = np.zeros((3, len(push.r)))
        for change in driven:  # implicit Euler
            y_dot = (y_dot + change - h * omega * omega * y) / (1.0 + h * damping + h * h * omega * omega)
            y = y + h * y_dot
            fastest = np.maximum(fastest, np.abs(y_dot))
        return fastest

    def slope(self, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        """dr/dq (n, n) at q, where r is known."""
        return np.array([(self.push(q + e).r - r) / _SMALL for e in _SMALL * np.eye(len(q))]).T

    def rest(self) -> np.ndarray | str:
        """q (n,) at the rest that the slow motion reaches from the initial posture, or the reason why there is none."""
        q, step = self.setup.start.q.copy(), 0.3
        for _ in range(_STEPS):
            r = self.push(q).r
            slope = self.slope(q, r)
            if np.abs(r).max() < _AT_REST:
                stable = np.linalg.eigvals(slope).real.max() < _GROWS
                return q if stable else "its balance is not stable"
            change = np.linalg.solve(np.eye(len(q)) / step - slope, r)
            while (largest := np.abs(change).max()) > _LARGEST_CHANGE and step > 1e-6:
                step /= 4.0
                change = np.linalg.solve(np.eye(len(q)) / step - slope, r)
            q = q + change
            for link, q_k in zip(self.links, q, strict=True):
                if not link.range[0] <= q_k <= link.range[1]:
                    end = link.range[int(q_k > link.range[0])]
                    at = f"{end:.4g} m" if link.slide else f"{math.degrees(end):.4g} deg"
                    return f"{link.joint} moves to the end of its range, {at}"
            step = min(1e9, step * min(10.0, max(1.0, _LARGEST_CHANGE / (2.0 * largest))))
        return "it comes to no rest"

    def weak(self, tau: np.ndarray) -> str:
        """The reason why motors, with the friction of their gears, or thrusters can't hold a rest with the commanded
        tau (6 + n,); empty if they can."""
        for link, torque in zip(self.links, tau[6:], strict=True):
            if abs(torque) > link.effort + link.friction:
                unit = "N" if link.slide else "N m"
                return f"{link.joint} needs {torque:.4g} {unit} at rest and has {link.effort:.4g} {unit}"
        return self.delivery.weak(self.delivery.T @ tau[:6])
