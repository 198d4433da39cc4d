r"""Static balance of a vehicle with an arm: the rest of the tool, and of the base and the joints behind it.

In the frame of the task, the law is that of :mod:`.balance` with Lambda_hat in place of M_hat. At rest its wrench F is

.. math:: w = \frac{A}{A - K}\, a, \qquad a = -\hat\Lambda^{-1} (F + \tau_c - \bar J^\top \hat g).

**A law that integrates**, K infinite, rests at w = 0. The pose of the tool is the only unknown of these six equations:
neither the posture, nor the estimates, nor the disturbance is in them. The base and the joints behind it must come to
rest, too (:mod:`.free_motion`), while the tool moves there as eq. (7) moves it (:mod:`.task_motion`).

**Any other law** rests where the disturbance of the whole tree leaves it. The unknowns are the pose of the base, the
joint positions q and F. The balance of the tree has 6 + n further equations,

.. math:: J^\top (F + \tau_c) + \tau_{posture} + d(q, R_{WB}) - g(q, R_{WB}) = 0,

with the current on all links in d. The root is the one that the slow motion :math:`M \dot y` on the right side of these
equations reaches from the rest of a law that integrates (:mod:`.approach`).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...physics.frames import attitude, quat_turned, rotation_matrix
from ...physics.statics import Statics
from ..base import SteadyState
from .approach import approach, decays
from .free_motion import FreeMotion, PostureAtRest, beyond, surroundings
from .task_motion import Track
from .terms import Balance, Pose, ThrustMap

_LARGEST = 0.2
"""Largest change of a coordinate in one step of the slow motion [rad or m]."""
_FIRST = 0.1
"""Its first step [s]."""
_STEPS = 150
_SMALL = 1e-7
"""Change of a coordinate for a derivative."""
_ONE = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class TreePose:
    """Position (3,) and attitude (3, 3) of B in W, joint positions q (n,) and the law's wrench F (6,)."""

    p_WB: np.ndarray
    R_WB: np.ndarray
    q: np.ndarray
    F: np.ndarray


def tool_rest(setup: Any, K: float, thrust_map: ThrustMap, track: Track) -> SteadyState | str:
    """The rest of a vehicle with an arm under a law with the slope K over s, or the reason why it is not known.

    The arguments are those of :func:`.balance.static_balance`, and the motion of the frame of the task to its rest if w
    is zero."""
    if not type(setup.interface).torque_controlled:
        return f"the joint interface {setup.interface.label()} holds the joints itself"
    if np.isfinite(K) and any(link.friction > 0.0 for link in setup.vehicle.arm.links):
        return "with Coulomb friction in the joints, the rest posture depends on the path"
    if np.isfinite(K) and setup.scenario.impedance.natural:
        return "with impedance.M_d = 'natural' the desired inertia depends on the rest posture, which is not computed"
    free, of = FreeMotion(setup, thrust_map, track), ToolBalance(setup, K, thrust_map)
    q = free.rest()
    if isinstance(q, str):
        return f"behind the tool, {q}"
    tool, tau, s = track.end, free.push(q).tau, np.zeros(6)
    if np.isfinite(K):
        y = approach(of, TreePose(*free.base(q), q, np.zeros(6)), np.zeros(12 + of.n), _FIRST, _STEPS)
        if isinstance(y, str):
            return f"behind the tool, {y}"
        tool, tau, s = of.tool(y), of.commanded(y)[0], of.sliding(y)
    if weak := free.infeasible(tau):
        return weak
    push = of.at_task.contacts(tool.position, tool.R_WB)[1]
    if of.at_task.rubs(push):
        return "with friction, the rest position depends on the path"
    return SteadyState(float(push.sum()), s=s, tau=thrust_map.T @ tau[:6], reached=True)


class ToolBalance:
    """The equations of a vehicle with an arm at rest; an :class:`.approach.Motion` of :class:`TreePose`.

    Its coordinates are the displacement (3,) and the rotation vector (3,) of the base in B, q (n,) and F (6,)."""

    def __init__(self, setup: Any, K: float, thrust_map: ThrustMap) -> None:
        scenario, links = setup.scenario, setup.nominal.arm.links
        self.setup, self.thrust_map, self.n = setup, thrust_map, len(links)
        self.frame = setup.plant.probe.carrier
        self.at_task = Balance(setup, K, thrust_map)
        self.posture = PostureAtRest(setup)
        self.inertia, self.damping = np.zeros((12 + self.n, 12 + self.n)), np.zeros((12 + self.n, 12 + self.n))
        self.damping[: 6 + self.n, : 6 + self.n] = setup.start.inertia()
        self.largest = np.concatenate([np.full(6 + self.n, _LARGEST), np.full(6, np.inf)])
        self.sharp, self.ends = 1e-3, 0.0
        estimates = [scenario.estimates, *(scenario.estimates.of(link.name) for link in links)]
        self.inertia_hat, self.restoring_hat = [e.inertia for e in estimates], [e.restoring for e in estimates]

    def moved(self, y: TreePose, change: np.ndarray) -> TreePose:
        """The posture after a change (12 + n,)."""
        n, turn = self.n, rotation_matrix(quat_turned(_ONE, change[3:6]))
        return TreePose(y.p_WB + y.R_WB @ change[:3], y.R_WB @ turn, y.q + change[6 : 6 + n], y.F + change[6 + n :])

    def lead(self, y: TreePose, t: float, step: float) -> np.ndarray:
        """The reference is at its end."""
        return np.zeros(12 + self.n)

    def passed(self, t: float, y: TreePose) -> str:
        """The reason why a joint can't be there; empty if all can."""
        return beyond(self.setup.vehicle.arm.links, y.q)

    def jacobian(self, y: TreePose) -> np.ndarray:
        """The derivative of the residual."""
        residual = self(y)
        return np.array([(self(self.moved(y, e)) - residual) / _SMALL for e in _SMALL * np.eye(12 + self.n)]).T

    def stable(self, y: TreePose) -> bool:
        """Whether the slow motion stays at a rest."""
        return decays(self.jacobian(y), self.damping)

    def tool(self, y: TreePose, tree: Statics | None = None) -> Pose:
        """The pose of the frame of the task."""
        p, R = (tree or Statics(self.setup.vehicle, y.q)).pose(self.frame)
        quat = np.empty(4)
        attitude(y.R_WB @ R, quat)
        return self.at_task.pose(y.p_WB + y.R_WB @ p, quat)

    def commanded(self, y: TreePose, tree: Statics | None = None) -> tuple[np.ndarray, np.ndarray]:
        """The generalised force (6 + n,) that is commanded, and a (6,)."""
        setup, F = self.setup, y.F
        tree = tree or Statics(setup.vehicle, y.q)
        model = tree.with_coefficients(setup.nominal)
        J, M = model.jacobian(self.frame), model.inertia(self.inertia_hat)
        g = model.restoring(y.R_WB, setup.gravity_W, self.restoring_hat)
        M_inv = np.linalg.inv(M)
        if setup.at_tool:
            inverse = J @ M_inv @ J.T  # of Lambda_hat
            J_bar_T = np.linalg.solve(inverse, J @ M_inv)
            P = M_inv - M_inv @ J.T @ J_bar_T
            g_hat, kept = J_bar_T @ g, g - J.T @ (J_bar_T @ g)
        else:  # the law at B has the rows of the base
            inverse, P = np.linalg.inv(M[:6, :6]), np.zeros_like(M)
            P[6:, 6:] = np.linalg.inv(M[6:, 6:])
            g_hat, kept = g[:6], np.concatenate([np.zeros(6), g[6:]])
        F_free = F + self.tool(y, model).tau_c - g_hat
        return J.T @ F + kept + M @ self.posture(y.p_WB, y.R_WB, y.q, M_inv, P), -inverse @ F_free

    def __call__(self, y: TreePose) -> np.ndarray:
        """The residual (12 + n,): the balance of the tree, then the law's."""
        setup, balance = self.setup, self.at_task
        tree = Statics(setup.vehicle, y.q)
        tool = self.tool(y, tree)
        tau, a = self.commanded(y, tree)
        tau[:6] = self.thrust_map.T @ tau[:6]
        tau += surroundings(setup, tree, y.p_WB, y.R_WB) + tree.jacobian(self.frame).T @ tool.tau_c
        return np.concatenate(
            [tau, setup.design.M_d @ (balance.desired_acceleration(tool) - balance.factor_inverse * a)]
        )

    def sliding(self, y: TreePose) -> np.ndarray:
        """s (6,) at rest: a = w + K s, or A s = -w without K."""
        w, K = self.at_task.desired_acceleration(self.tool(y)), self.at_task.K
        return (self.commanded(y)[1] - w) / K if K > 0.0 else -w / self.at_task.A
