r"""Static balance: pose and contact force of a vehicle at rest, from the scenario and one number of the law.

Near rest each shipped law is the nominal control (23) minus :math:`\hat M K s`, up to a term that integrates. At rest
(nu = 0) zeta is constant in eq. (15), so that A s = -w with w = M_d^-1 (K_d eta_e - K_f (tau_c - F_d)). The balance of
eq. (10) is then

.. math::

    (I - A^{-1} K) M_d^{-1} (K_d \tilde\eta - K_f (\tau_c - F_d))
    = \hat M^{-1} (d + \hat g(\eta) - g(\eta) + (I - T^{-1}) \tau), \qquad
    K = \begin{cases} 0 & \text{impedance, eq. (23): the static balance of eq. (5)} \\
                      K_s / \epsilon & \text{first-order law inside its boundary layer, eq. (31)} \\
                      \infty & \text{super-twisting, whose } z \text{ balances disturbances slower than } k_2/2; \\
                             & \text{the ideal law, eq. (13)}
        \end{cases}

For A = 0 and K > 0 the left factor is infinite, which is eq. (6). T = B B_hat^+ gives the wrench of the true thrusters
for a commanded one, and tau = g - d - tau_c holds the vehicle. Here d = tau_dist - C_A(-nu_c)(-nu_c) - D(-nu_c)(-nu_c)
is the wrench of the current and the constant disturbance on the vehicle at rest, at its rest attitude; tau_dist has
the drag of a tether in it.
The frictionless wall gives tau_c = -k_c (x - x_c) along its normal for x > x_c; each contact of the list gives the
force of its springs with its moment (:mod:`.springs`). For GSTA with the attitude reference
along W this is eq. (12) at rest against the spring of eq. (34), F = K_x (x_d - x_c) / (1 + K_x / k_c); the paper's
1.5 N neglects the compliance of the wall.

The law sees measurements, with the constant errors that :meth:`uvms_mj.navigation.base.Navigation.rest_errors` gives.
Then w is that of the measurements, a biased velocity nu_m adds D_d nu_m to it and makes the pose error seem to move, so
that A s = F_1 eta_e_dot - w, and the estimates are those of the measurements:

.. math::

    w - \frac{K}{K - A} F_1 \dot{\tilde\eta} = \frac{A}{A - K} \hat M^{-1}
        (d + \hat n_m - g(\eta) + \tau_c - \tau_{c,m} + (I - T^{-1}) \tau), \qquad
    \hat n_m = \hat C \nu_m + \hat D \nu_m + \hat g(\eta_m).

An observer measures all that the controller's model does not explain: tau_c,m is tau_c plus the rest of the bracket,
which is then zero.
The ideal law knows all wrenches but that of the contact: w = M^-1 (tau_c - tau_c,m). The six equations are solved by
Newton's method.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ..physics.fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring
from ..physics.frames import quat_error, rotation_matrix
from ..physics.tether import add_tether
from ..stages.base import is_shipped
from .delivery import Delivery
from .newton import newton
from .rest import SteadyState
from .springs import Springs


def static_balance(
    setup: Any, K: float, residual: "Callable[[_Balance, np.ndarray], np.ndarray] | None" = None
) -> SteadyState | str:
    """The vehicle at rest under a law that is the nominal control minus M_hat (A + K) s near rest.

    Args:
        setup: the run's :class:`uvms_mj.analysis.setup.Setup`.
        K: slope of the law over s [1/s]; infinite for a law that integrates, so that s is zero at rest.
        residual: the six equations of another law, from the balance and x (6,), in place of the ones above.

    Returns:
        The state, or the reason why there is none.
    """
    scenario = setup.scenario
    if scenario.reference.rest_pose(scenario)[0] is None:
        return "the reference does not come to rest"
    if not scenario.current.steady:
        return "the current is not constant"
    if not (is_shipped(scenario.navigation) and is_shipped(scenario.actuation)):
        return "closed forms are known for the shipped navigation and actuation only"
    observer = scenario.observer if scenario.observer.runs else None
    if observer is not None and not is_shipped(observer):
        return "closed forms are known for the shipped observers only"
    if K == 0.0 and 0.0 in setup.task.A:
        return "with a zero in A, zeta is not constant at rest: it integrates the remaining error"
    if any(wall.moves for _, wall in setup.contacts.surfaces):
        return "a wall moves"
    delivery = Delivery.of(setup)
    if isinstance(delivery, str):
        return delivery
    if not delivery.can_be_any():
        return "the thrusters can't produce every wrench"
    errors = scenario.navigation.rest_errors(setup)
    if isinstance(errors, str):
        return errors
    if residual is not None and (observer is not None or not _exact(errors)):
        return "with errors of the sensors, closed forms are known for the laws of the impedance task only"
    if delivery.static.error and (np.isfinite(K) or residual is not None):
        return f"{delivery.static.error}, and the law does not integrate"
    solved = _solve(setup, K, delivery, residual)
    if solved is None:
        return "the static balance has no solution near the reference"
    state, known = solved
    for sensor in (scenario.navigation, observer):
        if sensor is not None and (reason := sensor.out_of_range(known)):
            return reason
    weak = delivery.weak(np.asarray(state.tau))
    if weak:
        return weak
    springs = Springs(setup)
    _, normal = springs.wrench(np.asarray(state.position), rotation_matrix(np.asarray(state.quat)))
    if (_in_wall(setup, state) and scenario.wall.friction > 0.0) or (springs.friction & (normal > 0.0)).any():
        return "with friction, the rest position depends on the path"
    return state


def _exact(errors: Any) -> bool:
    """Whether the measurements of a vehicle at rest are the truth."""
    position, quat, tau_c = np.ones(3), np.full(4, 0.5), np.ones(6)
    known = errors(position, quat, tau_c)
    pairs = ((known.position, position), (known.quat, quat), (known.tau_c, tau_c), (known.nu, np.zeros(6)))
    return all(np.array_equal(measured, true) for measured, true in pairs)


def unknown_acceleration(setup: Any, state: SteadyState) -> np.ndarray:
    """The acceleration (6,) of disturbances and model errors at rest, M_hat^-1 tau_dist of eq. (11), in a state of
    :func:`static_balance`."""
    delivery, turn = Delivery.of(setup), np.empty(4)
    assert not isinstance(delivery, str)  # the state was found with it
    balance = _Balance(setup, np.inf, _in_wall(setup, state), delivery)
    quat_error(setup.design.quat_d, state.quat, turn)
    sine = float(np.linalg.norm(turn[1:]))
    vector = turn[1:] * (2.0 * np.arctan2(sine, turn[0]) / sine if sine > 0.0 else 2.0)
    return balance.unknown(np.concatenate([state.position - balance.target, vector]))


def _in_wall(setup: Any, state: SteadyState) -> bool:
    """Whether the probe is in ``[wall]``."""
    return bool(setup.contacts.paper and np.asarray(state.position)[0] > setup.scenario.wall.position)


def _solve(setup: Any, K: float, delivery: Delivery, residual_of: Any = None) -> tuple[SteadyState, Any] | None:
    """Newton's method on the six equations, first without ``[wall]``, then in contact if that position is inside it.
    The contacts of the list are found as their stiffness grows. Returns the state with its measurements."""
    wall = setup.scenario.wall
    for in_contact in (False, True) if setup.contacts.paper else (False,):
        balance = _Balance(setup, K, in_contact, delivery)
        of, springs = balance if residual_of is None else functools.partial(residual_of, balance), balance.springs
        x = np.zeros(6)
        for scale in springs.scales:
            springs.scale = scale
            x = newton(of, x, len(springs) > 0)
        at_rest = bool(np.abs(of(x)).max() < 1e-8)
        position, quat, R_WB = balance.pose(x)
        depth = position[0] - wall.position if setup.contacts.paper else 0.0
        if at_rest and (depth >= 0.0 if in_contact else depth <= 0.0):
            force = wall.stiffness * depth if in_contact else 0.0
            force += springs.wrench(position, R_WB)[1].sum()
            state = SteadyState(float(force), position, quat, balance.sliding(x), balance.thrust(x))
            return state, balance.known(x)
    return None


class _Balance:
    """Residual (6,) of the balance and its terms, functions of x (6,): position minus reference in W, and the rotation
    vector from the desired attitude."""

    def __init__(self, setup: Any, K: float, in_contact: bool, delivery: Delivery) -> None:
        scenario, design = setup.scenario, setup.design
        self.setup, self.K, self.in_contact, self.springs = setup, K, in_contact, Springs(setup)
        self.target = np.array(scenario.reference.rest_pose(scenario)[0])
        self.tau_dist = np.array(scenario.disturbance.bias)
        self.A = np.array(setup.task.A)
        self.M_d_inv = design.M_d_inv
        self.M_hat_inv = np.linalg.inv(design.M_hat)
        self.undelivered = np.eye(6) - np.linalg.inv(delivery.T)
        self.K_f, self.F_d = (np.array(each) for each in scenario.impedance.at_end)
        self.factor_inverse = self.A / (self.A - K)
        self.told = scenario.controller.uses_truth
        self.errors = scenario.navigation.rest_errors(setup)
        self._at: tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]] | None = None

    def pose(self, x: np.ndarray):
        """Position, attitude and R_WB, computed once for an array, which must not change."""
        if self._at is None or self._at[0] is not x:
            self._at = x, self._pose(x)
        return self._at[1]

    def _pose(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angle = float(np.linalg.norm(x[3:]))
        axis = x[3:] / angle if angle > 0.0 else np.zeros(3)
        turn = np.concatenate([[np.cos(angle / 2.0)], np.sin(angle / 2.0) * axis])
        quat = _product(self.setup.design.quat_d, turn)
        return self.target + x[:3], quat, rotation_matrix(quat)

    def contact(self, x: np.ndarray) -> np.ndarray:
        """tau_c (6,) in B, eq. (34)."""
        position, _, R_WB = self.pose(x)
        wall, tau_c = self.setup.scenario.wall, np.zeros(6)
        if self.in_contact:
            tau_c[:3] = -wall.stiffness * (position[0] - wall.position) * R_WB[0]
        return tau_c + self.springs.wrench(position, R_WB)[0] if len(self.springs) else tau_c

    def error(self, x: np.ndarray) -> np.ndarray:
        """eta_e (6,) as the law measures it."""
        known, quat_e = self.known(x), np.empty(4)
        quat_error(self.setup.design.quat_d, known.quat, quat_e)
        return np.concatenate([rotation_matrix(known.quat).T @ (known.position - self.target), quat_e[1:]])

    def asked(self, x: np.ndarray) -> np.ndarray:
        """w = M_d^-1 (K_d eta_e + D_d nu_e - K_f (tau_c - F_d)) as the law measures them, zero where the desired
        impedance, eq. (7), holds at rest."""
        known, design = self.known(x), self.setup.design
        forces = self.K_f * (known.tau_c - self.F_d)
        return self.M_d_inv @ (design.K_d @ self.error(x) + design.D_d @ known.nu - forces)

    def known(self, x: np.ndarray) -> Any:
        """The measurements, :class:`uvms_mj.navigation.base.Known`."""
        position, quat, _ = self.pose(x)
        tau_c = self.contact(x)
        known = self.errors(position, quat, tau_c)
        if not self.setup.scenario.observer.runs:
            return known
        explained = dataclasses.replace(known, tau_c=tau_c)
        return dataclasses.replace(known, tau_c=tau_c + self.setup.design.M_hat @ self.unknown(x, explained))

    def moving(self, x: np.ndarray) -> np.ndarray:
        """F_1 times the rate (6,) of the pose error that the law derives from a biased velocity, eq. (18)."""
        known, quat_e = self.known(x), np.empty(4)
        quat_error(self.setup.design.quat_d, known.quat, quat_e)
        v, omega = known.nu[:3], known.nu[3:]
        turning = 0.5 * (quat_e[0] * omega + np.cross(quat_e[1:], omega))
        return np.array(self.setup.task.F_1) * np.concatenate([v, turning])

    def sliding(self, x: np.ndarray) -> np.ndarray | None:
        """s (6,) at rest: A s = F_1 eta_e_dot - w. None if zeta integrates what the ideal law does not answer to."""
        if not self.told:
            return (self.unknown(x) - self.moving(x)) / (self.K - self.A) + 0.0  # zero has no sign
        left = self.moving(x) - self.asked(x)
        if np.abs(left).max() < 1e-12:
            return np.zeros(6)
        return None if 0.0 in self.A else left / self.A

    def thrust(self, x: np.ndarray) -> np.ndarray:
        """tau (6,) that holds the vehicle at rest, eq. (10)."""
        d, g_eta = self.environment(x)
        return g_eta - d - self.contact(x)

    def effort(self, x: np.ndarray) -> np.ndarray:
        """tau_cmd - g_hat(eta) (6,) that holds the vehicle at rest."""
        return -self.contact(x) - self.setup.design.M_hat @ self.unknown(x)

    def unknown(self, x: np.ndarray, known: Any = None) -> np.ndarray:
        """The acceleration (6,) that a law without an integral term must balance through s, with the measurements
        ``known``; default: those at x."""
        d, g_eta = self.environment(x)
        known = self.known(x) if known is None else known
        estimates, term = self.setup.scenario.estimates, np.empty(6)
        vehicle = self.setup.nominal
        nominal = self.restoring(vehicle, rotation_matrix(known.quat))
        unknown = (estimates.restoring - 1.0) * nominal + (nominal - g_eta) + (self.contact(x) - known.tau_c)
        if known.nu.any():
            damping(vehicle.D_linear, vehicle.D_quadratic, known.nu, term)
            unknown += estimates.damping * term
            for coriolis, M in ((coriolis_added_mass, vehicle.M_A), (coriolis_rigid_body, vehicle.M_RB)):
                coriolis(M, known.nu, term)
                unknown += estimates.coriolis * term
        return self.M_hat_inv @ (d + unknown + self.undelivered @ self.thrust(x))

    def __call__(self, x: np.ndarray) -> np.ndarray:
        if self.told:
            return self.asked(x) - np.linalg.solve(self.setup.design.M, self.contact(x) - self.known(x).tau_c)
        return self.asked(x) - (1.0 - self.factor_inverse) * self.moving(x) - self.factor_inverse * self.unknown(x)

    def environment(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """d and g(eta), (6,) each, in B."""
        vehicle, scenario = self.setup.vehicle, self.setup.scenario
        position, _, R_WB = self.pose(x)
        nu_r, term = np.zeros(6), np.empty(6)
        nu_r[:3] = -R_WB.T @ scenario.current.steady_at(-position[2])
        d = self.tau_dist.copy()
        if scenario.tether.factor:
            add_tether(scenario.tether.factor, scenario.tether.position, nu_r, d)
        coriolis_added_mass(vehicle.M_A, nu_r, term)
        d -= term
        damping(vehicle.D_linear, vehicle.D_quadratic, nu_r, term)
        d -= term
        return d, self.restoring(vehicle, R_WB)

    def restoring(self, vehicle: Any, R_WB: np.ndarray) -> np.ndarray:
        """g(eta) (6,) of a vehicle, the true one or that of the file."""
        g_eta = np.empty(6)
        restoring(vehicle.mass, vehicle.displaced_mass, vehicle.r_g, vehicle.r_b, self.setup.gravity_W, R_WB, g_eta)
        return g_eta


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Quaternion product a b."""
    (_, x, y, z), (_, i, j, k) = a.tolist(), b.tolist()
    cross = np.array([y * k - z * j, z * i - x * k, x * j - y * i])  # np.cross takes ten times as long
    w, v = a[0] * b[0] - a[1:] @ b[1:], a[0] * b[1:] + b[0] * a[1:] + cross
    return np.concatenate([[w], v])
