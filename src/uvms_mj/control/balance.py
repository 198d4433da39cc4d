r"""Static balance: pose and contact force of a vehicle at rest, from the scenario and one number of the law.

Near rest each shipped law is the nominal control (23) minus :math:`\hat M (A + K) s`, up to a term that integrates. At
rest (nu = 0) zeta is constant in eq. (15), so that A s = -M_d^-1 (K_d eta_e - K_f (tau_c - F_d)). The balance of
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
is the wrench of the current and the constant disturbance on the vehicle at rest, at its rest attitude.
The frictionless wall gives tau_c = -k_c (x - x_c) along its normal for x > x_c; each contact of the list gives the
force of its springs with its moment (:mod:`.springs`). For GSTA with the attitude reference
along W this is eq. (12) at rest against the spring of eq. (34), F = K_x (x_d - x_c) / (1 + K_x / k_c); the paper's
1.5 N neglects the compliance of the wall. The six equations are solved by Newton's method.
"""

from typing import Any

import numpy as np

from ..physics.fossen import coriolis_added_mass, damping, restoring
from ..physics.frames import quat_error, rotation_matrix
from ..stages.base import is_shipped
from .rest import SteadyState
from .springs import Springs

_SOFTER = (1e-2, 0.1, 1.0)
"""Factors of the stiffness of the list of contacts, by which the set of contacts at rest is found."""

_HALVES = 12
"""Number of times that a step of Newton's method is halved, where the set of contacts changes."""


def static_balance(setup: Any, K: float) -> SteadyState | str:
    """The vehicle at rest under a law that is the nominal control minus M_hat (A + K) s near rest.

    Args:
        setup: the run's :class:`uvms_mj.analysis.setup.Setup`.
        K: slope of the law over s [1/s]; infinite for a law that integrates, so that s is zero at rest.

    Returns:
        The state, or the reason why there is none.
    """
    vehicle, scenario = setup.vehicle, setup.scenario
    if scenario.reference.rest_pose(scenario)[0] is None:
        return "the reference does not come to rest"
    if not (is_shipped(scenario.navigation) and is_shipped(scenario.actuation)):
        return "closed forms are known for the shipped navigation and actuation only"
    if scenario.observer.runs:
        return "closed forms are not known with an observer of the contact force"
    if K == 0.0 and 0.0 in setup.task.A:
        return "with a zero in A, zeta is not constant at rest: it integrates the remaining error"
    if any(wall.moves for _, wall in setup.contacts.surfaces):
        return "a wall moves"
    if min(np.linalg.matrix_rank(setup.nominal.B), np.linalg.matrix_rank(_delivered(setup))) < 6:
        return "the thrusters can't produce every wrench"
    springs = Springs(setup)
    state = _solve(setup, K, springs)
    if state is None:
        return "the static balance has no solution near the reference"
    u = np.linalg.pinv(setup.nominal.B) @ np.linalg.solve(_delivered(setup), np.asarray(state.tau))
    if (u < vehicle.u_min).any() or (u > vehicle.u_max).any():
        return "the thrusters are too weak"
    _, normal = springs.wrench(np.asarray(state.position), rotation_matrix(np.asarray(state.quat)))
    at_wall = setup.contacts.paper and state.force - normal.sum() > 0.0
    if (at_wall and setup.scenario.wall.friction > 0.0) or (springs.friction & (normal > 0.0)).any():
        return "with friction, the rest position depends on the path"
    return state


def _solve(setup: Any, K: float, springs: Springs) -> SteadyState | None:
    """Newton's method on the six equations, first without ``[wall]``, then in contact if that position is inside it.
    The contacts of the list are found as their stiffness grows."""
    wall = setup.scenario.wall
    for in_contact in (False, True) if setup.contacts.paper else (False,):
        balance = _Balance(setup, K, in_contact, springs)
        x = np.zeros(6)
        for scale in _SOFTER if len(springs) else (1.0,):
            springs.scale = scale
            x = _newton(balance, x)
        at_rest = bool(np.abs(balance(x)).max() < 1e-8)
        position, quat, R_WB = balance.pose(x)
        depth = position[0] - wall.position if setup.contacts.paper else 0.0
        if at_rest and (depth >= 0.0 if in_contact else depth <= 0.0):
            force = wall.stiffness * depth if in_contact else 0.0
            force += springs.wrench(position, R_WB)[1].sum()
            return SteadyState(float(force), position, quat, balance.sliding(x), balance.thrust(x))
    return None


def _newton(balance: "_Balance", x: np.ndarray) -> np.ndarray:
    """Sixty steps at most, each of at most 0.5; with a list of contacts, each of them lowers the residual."""
    for _ in range(60):
        residual = balance(x)
        columns = [(balance(x + e) - balance(x - e)) / 2e-6 for e in 1e-6 * np.eye(6)]  # of the Jacobian
        step = np.linalg.lstsq(np.array(columns).T, residual, rcond=None)[0]
        step = step * min(1.0, 0.5 / max(np.abs(step).max(), 1e-300))
        if len(balance.springs):
            size = np.abs(residual).max()
            halves = (step * 0.5**k for k in range(_HALVES))
            step = next((each for each in halves if np.abs(balance(x - each)).max() < size), step)
        x = x - step
        if np.abs(step).max() < 1e-14:
            break
    return x


class _Balance:
    """Residual (6,) of the balance, a function of x (6,): position minus reference in W, and the rotation vector from
    the desired attitude."""

    def __init__(self, setup: Any, K: float, in_contact: bool, springs: Springs) -> None:
        scenario, design = setup.scenario, setup.design
        self.setup, self.K, self.in_contact, self.springs = setup, K, in_contact, springs
        self.v_c_W = np.array(scenario.current.velocity_W)
        self.target = np.array(scenario.reference.rest_pose(scenario)[0])
        self.tau_dist = np.array(scenario.disturbance.bias)
        self.A = np.array(setup.task.A)
        self.M_d_inv = design.M_d_inv
        self.M_hat_inv = np.linalg.inv(design.M_hat)
        self.undelivered = np.eye(6) - np.linalg.inv(_delivered(setup))
        self.K_f, self.F_d = np.array(scenario.impedance.K_f), np.array(scenario.impedance.F_d)
        self.factor_inverse = self.A / (self.A - K)
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

    def asked(self, x: np.ndarray) -> np.ndarray:
        """M_d^-1 (K_d eta_e - K_f (tau_c - F_d))."""
        position, quat, R_WB = self.pose(x)
        design, quat_e = self.setup.design, np.empty(4)
        quat_error(design.quat_d, quat, quat_e)
        eta_e = np.concatenate([R_WB.T @ (position - self.target), quat_e[1:]])
        return self.M_d_inv @ (design.K_d @ eta_e - self.K_f * (self.contact(x) - self.F_d))

    def sliding(self, x: np.ndarray) -> np.ndarray:
        """s (6,) at rest."""
        return self.unknown(x) / (self.K - self.A) + 0.0  # zero has no sign

    def thrust(self, x: np.ndarray) -> np.ndarray:
        """tau (6,) that holds the vehicle at rest, eq. (10)."""
        d, g_eta = self.environment(x)
        return g_eta - d - self.contact(x)

    def unknown(self, x: np.ndarray) -> np.ndarray:
        """The acceleration (6,) that a law without an integral term must balance through s."""
        d, g_eta = self.environment(x)
        nominal = self.restoring(self.setup.nominal, x)
        unknown = (self.setup.scenario.estimates.restoring - 1.0) * nominal + (nominal - g_eta)
        return self.M_hat_inv @ (d + unknown + self.undelivered @ self.thrust(x))

    def __call__(self, x: np.ndarray) -> np.ndarray:
        return self.asked(x) - self.factor_inverse * self.unknown(x)

    def environment(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """d and g(eta), (6,) each, in B."""
        vehicle = self.setup.vehicle
        _, _, R_WB = self.pose(x)
        nu_r, term = np.zeros(6), np.empty(6)
        nu_r[:3] = -R_WB.T @ self.v_c_W
        d = self.tau_dist.copy()
        coriolis_added_mass(vehicle.M_A, nu_r, term)
        d -= term
        damping(vehicle.D_linear, vehicle.D_quadratic, nu_r, term)
        d -= term
        return d, self.restoring(vehicle, x)

    def restoring(self, vehicle: Any, x: np.ndarray) -> np.ndarray:
        """g(eta) (6,) of a vehicle, the true one or that of the file."""
        _, _, R_WB = self.pose(x)
        g_eta = np.empty(6)
        restoring(vehicle.mass, vehicle.displaced_mass, vehicle.r_g, vehicle.r_b, self.setup.gravity_W, R_WB, g_eta)
        return g_eta


def _delivered(setup: Any) -> np.ndarray:
    """T (6, 6): tau = T tau_cmd with the true thrusters and the allocation of the file, within their limits."""
    if setup.vehicle.B is setup.nominal.B or np.array_equal(setup.vehicle.B, setup.nominal.B):
        return np.eye(6)
    return setup.vehicle.B @ np.linalg.pinv(setup.nominal.B)


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Quaternion product a b."""
    (_, x, y, z), (_, i, j, k) = a.tolist(), b.tolist()
    cross = np.array([y * k - z * j, z * i - x * k, x * j - y * i])  # np.cross takes ten times as long
    w, v = a[0] * b[0] - a[1:] @ b[1:], a[0] * b[1:] + b[0] * a[1:] + cross
    return np.concatenate([[w], v])
