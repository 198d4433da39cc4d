r"""Static balance of a vehicle with an arm: the rest of the tool, and of the base and the joints behind it.

In the frame of the task, the law is that of :mod:`.balance` with Lambda_hat in place of M_hat. At rest its wrench F is

.. math:: w = \frac{A}{A - K}\, a, \qquad a = -\hat\Lambda^{-1} (F + \tau_c - \bar J^\top \hat g).

**A law that integrates**, K infinite, rests at w = 0. The pose of the tool is the only unknown of these six equations:
neither the posture, nor the estimates, nor the disturbance is in them.

**Any other law** rests where the disturbance of the whole tree leaves it. The unknowns are the pose of the base, the
joint positions q and F. The balance of the tree has 6 + n further equations,

.. math:: J^\top (F + \tau_c) + \tau_{posture} + d(q, R_{WB}) - g(q, R_{WB}) = 0,

with the current on all links in d. They may have several solutions. The one that is given is reached by a slow motion
:math:`M \dot y` on the right side of these equations, from the initial posture with the tool at its target. It is
computed by linearly implicit Euler with growing steps (Kelley and Keyes, SIAM J. Numerical Analysis 35, 1998). An
unstable rest of this motion is refused.
"""

import math
from typing import Any

import numpy as np

from ..physics.frames import quat_turned, rotation_matrix
from ..physics.statics import Statics
from .balance_terms import Balance
from .delivery import Delivery
from .posture_rest import PostureAtRest
from .rest import SteadyState

_LARGEST_CHANGE = 0.2
"""Largest change of a coordinate in one step of the slow motion [rad or m]."""
_STEPS = 100
_SHORTEST, _LONGEST = 1e-6, 1e9
"""Bounds of these steps."""
_AT_REST = 1e-8
"""Largest residual at rest [N, N m]."""
_FASTEST = 1e10
"""Rates above this are those of the algebraic rows [1/s]."""
_SMALL = 1e-7
"""Change of a coordinate for a derivative."""
_ONE = np.array([1.0, 0.0, 0.0, 0.0])


def tool_rest(setup: Any, K: float, delivery: Delivery) -> SteadyState | str:
    """The rest of a vehicle with an arm under a law with the slope K over s, or the reason why it is not known. The
    arguments are those of :func:`.balance.static_balance`; K is finite."""
    if any(link.friction > 0.0 for link in setup.vehicle.arm.links):
        return "with Coulomb friction in the joints, the rest posture depends on the path"
    if setup.scenario.impedance.natural:
        return "with impedance.M_d = 'natural' the desired inertia depends on the rest posture, which is not computed"
    wall = setup.scenario.wall
    of = ToolBalance(setup, K, delivery)
    y = of.start
    balance = of.at_task
    for in_contact in (False, True) if setup.contacts.paper else (False,):
        balance.in_contact = in_contact
        for scale in balance.springs.scales:
            balance.springs.scale = scale
            moved = slow_motion(of, y)
            if moved is None:
                return "the slow motion from the initial posture comes to no stable rest"
            y = moved
        position = balance.target + of.at_target(y)[:3]
        depth = position[0] - wall.position if setup.contacts.paper else 0.0
        if depth >= 0.0 if in_contact else depth <= 0.0:
            return _checked(of, y, wall.stiffness * depth if in_contact else 0.0)
    return "the static balance has no solution near the reference"


def _checked(of: "ToolBalance", y: np.ndarray, force: float) -> SteadyState | str:
    """The state of a rest with a force on ``[wall]``, or the reason why the vehicle does not rest there."""
    setup, delivery, x, tau = of.setup, of.delivery, of.at_target(y), of.commanded(y)[0]
    for link, q, torque in zip(setup.vehicle.arm.links, of.joints(y), tau[6:], strict=True):
        if not link.range[0] < q < link.range[1]:
            return f"the joint {link.joint} rests at the end of its range"
        if abs(torque) > link.effort:
            return f"the joint {link.joint} needs {torque:.4g} N m at rest and has {link.effort:.4g} N m"
    if weak := delivery.weak(delivery.T @ tau[:6]):
        return weak
    position, _, R = of.at_task.pose(x)
    normal = of.at_task.springs.wrench(position, R)[1]
    rubbed = force > 0.0 and setup.scenario.wall.friction > 0.0
    if rubbed or (of.at_task.springs.friction & (normal > 0.0)).any():
        return "with friction, the rest position depends on the path"
    return SteadyState(float(force + normal.sum()), s=of.sliding(y), tau=delivery.T @ tau[:6])


class ToolBalance:
    """The equations for y = [displacement of the base (3,), its rotation vector (3,), q (n,), F (6,)], the first two in
    B at p_0 and R_0. They begin in the initial posture with the tool at its target, where y is ``start``."""

    def __init__(self, setup: Any, K: float, delivery: Delivery) -> None:
        scenario, links = setup.scenario, setup.nominal.arm.links
        self.setup, self.delivery, self.n = setup, delivery, len(links)
        self.frame = setup.plant.probe.carrier
        self.at_task = Balance(setup, K, False, delivery)
        self.posture = PostureAtRest(setup)
        self.R_d = rotation_matrix(setup.design.quat_d)
        p, R = setup.start.pose(self.frame)
        self.R_0 = self.R_d @ R.T
        self.p_0 = self.at_task.target - self.R_0 @ p
        self.start = np.concatenate([np.zeros(6), setup.start.q, np.zeros(6)])
        self.mass = np.zeros((12 + self.n, 12 + self.n))
        self.mass[: 6 + self.n, : 6 + self.n] = setup.start.inertia()
        estimates = [scenario.estimates, *(scenario.estimates.of(link.name) for link in links)]
        self.inertia, self.restoring = [e.inertia for e in estimates], [e.restoring for e in estimates]

    def joints(self, y: np.ndarray) -> np.ndarray:
        """q (n,)."""
        return y[6 : 6 + self.n]

    def base(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) and attitude (3, 3) of B in W."""
        return self.p_0 + self.R_0 @ y[:3], self.R_0 @ rotation_matrix(quat_turned(_ONE, y[3:6]))

    def carried(self, y: np.ndarray) -> np.ndarray:
        """Move p_0 and R_0 to the base of y. Returns y from there."""
        self.p_0, self.R_0 = self.base(y)
        return np.concatenate([np.zeros(6), y[6:]])

    def at_target(self, y: np.ndarray, tree: Statics | None = None) -> np.ndarray:
        """Position of the task's frame minus the reference in W, and its rotation vector from the desired attitude
        (6,)."""
        p_WB, R_WB = self.base(y)
        p, R = (tree or Statics(self.setup.vehicle, self.joints(y))).pose(self.frame)
        return np.concatenate([p_WB + R_WB @ p - self.at_task.target, _vector(self.R_d.T @ R_WB @ R)])

    def commanded(self, y: np.ndarray, tree: Statics | None = None) -> tuple[np.ndarray, np.ndarray]:
        """The generalised force (6 + n,) that is commanded, and a (6,)."""
        setup, F = self.setup, y[6 + self.n :]
        tree, base = tree or Statics(setup.vehicle, self.joints(y)), self.base(y)
        model = tree.with_coefficients(setup.nominal)
        J, M = model.jacobian(self.frame), model.inertia(self.inertia)
        g = model.restoring(base[1], setup.gravity_W, self.restoring)
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
        F_free = F + self.at_task.contact(self.at_target(y, model)) - g_hat
        return J.T @ F + kept + M @ self.posture(*base, self.joints(y), M_inv, P), -inverse @ F_free

    def __call__(self, y: np.ndarray) -> np.ndarray:
        """The residual (12 + n,): the balance of the tree, then the law's."""
        setup, balance = self.setup, self.at_task
        tree, (p_WB, R_WB) = Statics(setup.vehicle, self.joints(y)), self.base(y)
        x = self.at_target(y, tree)
        tau, a = self.commanded(y, tree)
        tau[:6] = self.delivery.T @ tau[:6] + balance.tau_dist
        tau += tree.jacobian(self.frame).T @ balance.contact(x)
        tau += tree.stream(R_WB, setup.scenario.current.steady_at(-p_WB[2]))
        tau -= tree.restoring(R_WB, setup.gravity_W)
        return np.concatenate([tau, setup.design.M_d @ (balance.asked(x) - balance.factor_inverse * a)])

    def sliding(self, y: np.ndarray) -> np.ndarray:
        """s (6,) at rest: a = w + K s, or A s = -w without K."""
        w, K = self.at_task.asked(self.at_target(y)), self.at_task.K
        return (self.commanded(y)[1] - w) / K if K > 0.0 else -w / self.at_task.A


def slow_motion(of: ToolBalance, y: np.ndarray) -> np.ndarray | None:
    """The rest that the slow motion from y reaches; None if it reaches none, or an unstable one."""
    step, N = 0.1, 6 + of.n
    for _ in range(_STEPS):
        residual = of(y)
        J = np.array([(of(y + e) - residual) / _SMALL for e in _SMALL * np.eye(len(y))]).T
        if np.abs(residual).max() < _AT_REST:
            return y if _decays(J, of.mass) else None
        change = np.linalg.solve(of.mass / step - J, residual)
        while (largest := np.abs(change[:N]).max()) > _LARGEST_CHANGE and step > _SHORTEST:
            step /= 4.0
            change = np.linalg.solve(of.mass / step - J, residual)
        y = of.carried(y + change)
        step = min(_LONGEST, step * min(10.0, max(1.0, _LARGEST_CHANGE / (2.0 * largest))))
    return None


def _decays(J: np.ndarray, mass: np.ndarray) -> bool:
    """Whether mass y' = J y, which is algebraic in the rows without mass, decays."""
    from scipy.linalg import eigvals  # a run of a rigid vehicle does without SciPy

    rates = eigvals(J, mass)
    return bool(rates[np.abs(rates) < _FASTEST].real.max(initial=-math.inf) < 0.0)


def _vector(R: np.ndarray) -> np.ndarray:
    """The rotation vector (3,) of a rotation (3, 3) by less than pi."""
    sine = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    size = float(np.linalg.norm(sine))
    return sine * (math.atan2(size, 0.5 * (np.trace(R) - 1.0)) / size if size > 0.0 else 1.0)
