r"""The motion that a task leaves free: where the base and the joints rest while the law holds the frame of the task.

A law holds its frame by the wrench F, so that the joint positions q (n,) are the only unknowns: the base follows from
them. The tree is at rest where the posture balances what pushes it,

.. math::

    r(q) = \left[ M^{-1} \left( J^\top F + N^\top \tau_{posture} + d(q, R_{WB}) - g(q, R_{WB}) \right) \right]_q = 0,
    \qquad J M^{-1} (\dots) = 0,

with the current on all links in d, and F from the second equation. The projection :math:`N = I - \bar J J` keeps the
torques of the posture from the frame. The rest counts that the slow motion

.. math:: 2\, \mathrm{s}^{-1} (\dot q - \bar J_q \nu_T) = r(q)

reaches from the initial posture (:mod:`.approach`), within the ranges of the joints, while the frame moves with nu_T
along its track: about the motion of the levels, which are critically damped. Where the current pushes along a motion
that no level of the posture holds, there is none, and the arm folds or stretches up to a stop.

**The rest of the tool.** In the frame of the task, the law is as in :mod:`.balance`, with Lambda_hat in place of
M_hat. At rest its wrench F is

.. math:: w = \frac{A}{A - K}\, a, \qquad a = -\hat\Lambda^{-1} (F + \tau_c - \bar J^\top \hat g).

**A law that integrates**, K infinite, rests at w = 0. The pose of the tool is the only unknown of these six equations:
neither the posture, nor the estimates, nor the disturbance is in them. The base and the joints behind it must come to
rest, too, while the tool moves there as eq. (7) moves it.

**Any other law** rests where the disturbance of the whole tree leaves it. The unknowns are the pose of the base, the
joint positions q and F. The balance of the tree has 6 + n further equations,

.. math:: J^\top (F + \tau_c) + N^\top \tau_{posture} + d(q, R_{WB}) - g(q, R_{WB}) = 0,

with the current on all links in d. The slow motion :math:`M \dot y` on the right side of these equations
reaches the root from the rest of a law that integrates (:mod:`.approach`).
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...physics.frames import attitude, quat_turned, rotation_matrix
from ...stages.setup import SetupLike
from ..base import SteadyState
from .approach import UNSTABLE, approach, decays
from .task_motion import Track, between
from .terms import Balance, Pose, ThrustMap
from .tree_at_rest import TreeAtRest

_LARGEST = 0.3
"""Largest change of a joint in one step of the slow motion [rad or m]."""
_STEPS = 200
_FIRST = 0.1
"""The first step of the slow motion [s]."""
_DAMPING = 2.0
"""Its damping over its inertia [1/s]."""
_SMALL = 1e-6
"""Change of a joint for a derivative [rad or m]."""
_SAMPLED, _LATEST = 0.1, 10.0
"""Time between two velocities of a frame, and their shortest time in all [s]."""


def beyond(links: Sequence[Any], q: np.ndarray) -> str:
    """The reason why joints can't be at q (n,); empty if they can."""
    for link, q_k in zip(links, q, strict=True):
        if not link.range[0] <= q_k <= link.range[1]:
            end = link.range[int(q_k > link.range[0])]
            at = f"{end:.4g} m" if link.slide else f"{math.degrees(end):.4g} deg"
            return f"{link.joint} moves to the end of its range, {at}"
    return ""


class Push(NamedTuple):
    """The loads on the free motion at rest in one posture.

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

    def __init__(self, setup: SetupLike, thrust_map: ThrustMap, track: Track) -> None:
        self.setup, self.thrust_map, self.track, self.held = setup, thrust_map, track, track.at(0.0)
        self.links, self.tree = setup.vehicle.arm.links, TreeAtRest(setup, thrust_map)
        n = len(self.links)
        self.inertia, self.damping = np.zeros((n, n)), _DAMPING * np.eye(n)
        self.largest, self.sharp, self.ends = _LARGEST, 1e-3, track.ends
        # of a pose that is held and joint positions: a derivative begins where the push is known
        self._pushes = functools.lru_cache(2)(lambda held, *q: self._push(np.array(q)))

    def base(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) and attitude (3, 3) of B in W at joint positions q (n,)."""
        self.tree.place(q, self.held.position, self.held.R_WB)
        return np.array(self.tree.rest["p_WB"]), np.array(self.tree.rest["R_WB"])

    def push(self, q: np.ndarray) -> Push:
        """The loads at joint positions q (n,)."""
        return self._pushes(self.held, *q)

    def _push(self, q: np.ndarray) -> Push:
        tree = self.tree
        tree.place(q, self.held.position, self.held.R_WB)
        tree.push(self.held.tau_c)
        return Push(np.array(tree.rest["r"]), np.array(tree.rest["tau"]), tree.J_bar)

    def speeds(self, motion: np.ndarray, h: float) -> np.ndarray:
        """The largest speed (n,) of the joints [rad/s or m/s] as the vehicle begins to drift and the frame of the task
        moves with the velocities (k, 3) in W, h [s] after each other: of a linear oscillator from the initial
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

    def too_fast(self, motion: np.ndarray, h: float, share: float = 1.0) -> str:
        """The joints whose speed comes to a share of its limit, with both, as text: a motor there has no torque. The
        arguments are as for :meth:`speeds`."""
        if not any(math.isfinite(link.speed_limit) for link in self.links):
            return ""
        return ", ".join(
            f"{link.joint} about {speed:.2g} of {link.speed_limit:.3g} {'m/s' if link.slide else 'rad/s'}"
            for link, speed in zip(self.links, self.speeds(motion, h), strict=True)
            if speed > share * link.speed_limit
        )

    def __call__(self, q: np.ndarray, /) -> np.ndarray:
        return self.push(q).r

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """dr/dq (n, n)."""
        r = self(q)
        return np.array([(self(q + e) - r) / _SMALL for e in _SMALL * np.eye(len(q))]).T

    def leaves(self, q: np.ndarray) -> str:
        """The reason why the slow motion does not stay at a rest; empty if it does."""
        return "" if decays(self.jacobian(q), self.damping) else UNSTABLE

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


_LARGEST_OF_TREE = 0.2
"""Largest change of a coordinate in one step of the slow motion [rad or m]."""
_FIRST_OF_TREE = 0.1
"""Its first step [s]."""
_STEPS_OF_TREE = 150
_SMALL_OF_TREE = 1e-7
"""Change of a coordinate for a derivative."""
_ONE = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class TreePose:
    """Position (3,) and attitude (3, 3) of B in W, joint positions q (n,) and the law's wrench F (6,)."""

    p_WB: np.ndarray
    R_WB: np.ndarray
    q: np.ndarray
    F: np.ndarray


def tool_rest(
    setup: SetupLike, K: float, thrust_map: ThrustMap, track: Track, reached: Callable[[Pose, np.ndarray], str]
) -> SteadyState | str:
    """The rest of a vehicle with an arm under a law with the slope K over s, or the reason why it is not known.

    The arguments are as for :func:`.balance.static_balance`, and the motion of the frame of the task to its rest if w
    is zero. ``reached`` gives the reason why the frame does not come to a pose with the acceleration a (6,) that the
    law leaves there, empty if it does."""
    if not type(setup.interface).torque_controlled:
        return f"the joint interface {setup.interface.label()} holds the joints itself"
    if np.isfinite(K) and any(link.friction > 0.0 for link in setup.vehicle.arm.links):
        return "with Coulomb friction in the joints, the rest posture depends on the path"
    if np.isfinite(K) and setup.scenario.impedance.natural:
        return "with impedance.M_d = 'natural' the desired inertia depends on the rest posture, which is not computed"
    free, of = FreeMotion(setup, thrust_map, track), ToolBalance(setup, K, thrust_map)
    fast, q = free.too_fast(*_velocities(track)), free.rest()
    if isinstance(q, str):
        return f"behind the tool, {q}"
    if fast:
        return f"behind the tool, the joints come to their speed limits, at which a motor has no torque left: {fast}"
    tool, tau, s = track.end, free.push(q).tau, np.zeros(6)
    if np.isfinite(K):
        start = TreePose(*free.base(q), q, np.zeros(6))
        y = approach(of, start, np.zeros(12 + of.n), _FIRST_OF_TREE, _STEPS_OF_TREE)
        if isinstance(y, str):
            return f"behind the tool, {y}"
        tool, tau, s = of.tool(y), of.commanded(y)[0], of.sliding(y)
        if reason := reached(tool, of.commanded(y)[1]):
            return reason
    if weak := free.infeasible(tau):
        return weak
    push = of.at_task.contacts(tool.position, tool.R_WB)[1]
    if of.at_task.rubs(push):
        return "with friction, the rest position depends on the path"
    return SteadyState(float(push.sum()), s=s, tau=thrust_map.T @ tau[:6], reached=True)


def _velocities(track: Track) -> tuple[np.ndarray, float]:
    """Velocities (k, 3) in W of a frame on its track, and the time between two of them [s]."""
    times = np.arange(0.0, max(track.ends, _LATEST), _SAMPLED)
    return np.diff([track.at(t).position for t in times], axis=0) / _SAMPLED, _SAMPLED


class ToolBalance:
    """The equations of a vehicle with an arm at rest; an :class:`.approach.Motion` of :class:`TreePose`.

    Its coordinates are the displacement (3,) and the rotation vector (3,) of the base in B, q (n,) and F (6,)."""

    def __init__(self, setup: SetupLike, K: float, thrust_map: ThrustMap) -> None:
        self.setup, self.thrust_map, self.n = setup, thrust_map, len(setup.nominal.arm.links)
        self.at_task, self.tree = Balance(setup, K, thrust_map), TreeAtRest(setup, thrust_map)
        self.inertia, self.damping = np.zeros((12 + self.n, 12 + self.n)), np.zeros((12 + self.n, 12 + self.n))
        self.damping[: 6 + self.n, : 6 + self.n] = setup.start.inertia()
        self.largest = np.concatenate([np.full(6 + self.n, _LARGEST_OF_TREE), np.full(6, np.inf)])
        self.sharp, self.ends = 1e-3, 0.0

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
        small = _SMALL_OF_TREE
        return np.array([(self(self.moved(y, e)) - residual) / small for e in small * np.eye(12 + self.n)]).T

    def leaves(self, y: TreePose) -> str:
        """The reason why the slow motion does not stay at a rest; empty if it does."""
        return "" if decays(self.jacobian(y), self.damping) else UNSTABLE

    def tool(self, y: TreePose) -> Pose:
        """The pose of the frame of the task."""
        position, R = self.tree.stand(y.q, y.p_WB, y.R_WB)
        quat = np.empty(4)
        attitude(R, quat)
        return self.at_task.pose(position, quat)

    def commanded(self, y: TreePose) -> tuple[np.ndarray, np.ndarray]:
        """The generalised force (6 + n,) that is commanded, and a (6,)."""
        self.tree.balance(y.F, self.tool(y).tau_c)
        return np.array(self.tree.rest["tau"]), np.array(self.tree.rest["a"])

    def __call__(self, y: TreePose) -> np.ndarray:
        """The residual (12 + n,): the balance of the tree, then the law's."""
        balance, tool = self.at_task, self.tool(y)
        self.tree.balance(y.F, tool.tau_c)
        left = balance.desired_acceleration(tool) - balance.factor_inverse * self.tree.rest["a"]
        return np.concatenate([self.tree.rest["left"], self.setup.design.M_d @ left])

    def sliding(self, y: TreePose) -> np.ndarray | None:
        """s (6,) at rest: a = w + K s, or A s = -w without K. None if s grows, as with an integral to which the law
        does not answer."""
        w, K, A = self.at_task.desired_acceleration(self.tool(y)), self.at_task.K, self.at_task.A
        if K > 0.0:
            return (self.commanded(y)[1] - w) / K
        return None if 0.0 in A else -w / A
