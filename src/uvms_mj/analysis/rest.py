r"""Steady states: pose and contact force of a vehicle at rest, from the scenario and the gains alone.

At rest (nu = 0) zeta is constant in eq. (15), so that A s = -M_d^-1 (K_d eta_e - K_f (tau_c - F_d)). For each law the
balance of eq. (10) is then

.. math::

    G M_d^{-1} (K_d \tilde\eta - K_f (\tau_c - F_d)) = \hat M^{-1} (d + \hat g(\eta) - g(\eta)), \qquad
    G = \begin{cases} I & \text{impedance, eq. (23): the static balance of eq. (5)} \\
                      I - A^{-1} K_s / \epsilon & \text{first-order law inside its boundary layer, eq. (31)} \\
                      \infty & \text{super-twisting, with and without nominal control: }
                                z \text{ balances disturbances that change slower than } k_2/2; \\
                             & \text{the first-order law with } A = 0, \text{ eq. (6); the ideal law, eq. (13)}
        \end{cases}

Here d = tau_dist - C_A(-nu_c)(-nu_c) - D(-nu_c)(-nu_c) is the wrench of the current and the constant disturbance on the
vehicle at rest, at its rest attitude. The frictionless wall gives tau_c = -k_c (x - x_c) along its normal for x > x_c.
For GSTA with the attitude reference along W this is eq. (12) at rest against the spring of eq. (34),
F = K_x (x_d - x_c) / (1 + K_x / k_c); the paper's 1.5 N neglects the compliance of the wall.
The six equations are solved by Newton's method.
"""

import math

import numpy as np

from ..control import Fosm, Gsta, Ideal, Impedance, Sta
from ..control.design import Design, wall_normal
from ..control.loader import has_built_in_law
from ..control.rest import NoClosedForm, SteadyState
from ..physics.fossen import coriolis_added_mass, damping, restoring
from ..physics.frames import quat_error, quat_from_euler_deg, rotation_matrix
from ..plant.vehicle import Vehicle
from ..scenario import Scenario
from .sampling import (
    boundary_layer_limit,
    control_period,
    force_age,
    force_feedback_limit,
    held_growth,
    zeta_limit,
)


def steady_state(
    scenario: Scenario, vehicle: Vehicle, design: Design, gravity_W: np.ndarray
) -> SteadyState | NoClosedForm:
    """The steady state of a scenario, or the reason why it has no closed form; gravity_W (3,) [m/s^2]."""
    controller, h = scenario.controller, control_period(scenario)
    if not has_built_in_law(controller):
        return NoClosedForm("closed forms are known for the shipped laws only")
    rate = _disturbance_rate(scenario, design)
    if isinstance(controller, Gsta | Sta):
        if controller.k_1 == 0.0 or controller.k_2 == 0.0:
            return NoClosedForm("super-twisting does not converge without k_1 and k_2")
        if rate.max() >= controller.k_2 / 2.0:
            return NoClosedForm("the disturbance changes faster than k_2/2, which super-twisting can follow")
    elif rate.any() and not isinstance(controller, Ideal):
        return NoClosedForm("the disturbance is not constant")
    if 0.0 in controller.A and isinstance(controller, Impedance):
        return NoClosedForm("with a zero in A, zeta is not constant at rest: it integrates the remaining error")
    if isinstance(controller, Fosm) and controller.K_s == 0.0 and 0.0 in controller.A:
        return NoClosedForm("with a zero in A and K_s = 0, s drifts")
    if isinstance(controller, Fosm) and h >= boundary_layer_limit(controller, design):
        return NoClosedForm("the sampled first-order law chatters at this step")
    if h > zeta_limit(controller) and not isinstance(controller, Impedance | Ideal):
        return NoClosedForm("the sampled zeta, eq. (15), grows without bound at this control period")
    if np.linalg.matrix_rank(vehicle.B) < 6:
        return NoClosedForm("the thrusters can't produce every wrench")
    state = _solve(scenario, vehicle, design, gravity_W)
    if state is None:
        return NoClosedForm("the static balance has no solution near the reference")
    if isinstance(controller, Fosm) and np.abs(state.s).max() >= controller.epsilon:
        return NoClosedForm("the first-order law is outside its boundary layer")
    u = np.linalg.pinv(vehicle.B) @ state.tau
    if (u < vehicle.u_min).any() or (u > vehicle.u_max).any():
        return NoClosedForm("the thrusters are too weak")
    if state.force > 0.0 and scenario.wall.friction > 0.0:
        return NoClosedForm("with friction, the rest position depends on the path")
    if state.force > 0.0 and force_age(scenario) >= force_feedback_limit(scenario, design):
        return NoClosedForm("the sampled law limit-cycles against this wall")
    if state.force > 0.0 and held_growth(scenario, design) > 1.0:
        return NoClosedForm("the held command does not damp the vibration against this wall")
    return state


def demanded_force(scenario: Scenario, k_c: float) -> float:
    r"""The pushing force on a wall at rest that the desired impedance demands, for any disturbance [N].

    With eq. (7) at rest, K_d eta_e = K_f (tau_c - F_d), and the wall's spring (34) along its normal n in B,

    .. math:: F = \max\left(0, \frac{x_d - x_c - n^\top K_d^{-1} K_f F_d}{n^\top K_d^{-1} K_f n + 1/k_c}\right)

    For the paper's K_f = I, F_d = 0 this is K_x (x_d - x_c) / (1 + K_x / k_c), and K_x (x_d - x_c) for a rigid wall. If
    K_d is zero along n, it is the force demanded by F_d. F_d must be without moments. The result is infinite for a
    rigid wall and K_f = 0.

    Args:
        scenario: with reference, wall and impedance.
        k_c: stiffness of the wall [N/m]; infinite for a rigid one.
    """
    impedance, reference = scenario.impedance, scenario.reference
    normal = wall_normal(quat_from_euler_deg(*reference.attitude_deg))
    K_f, K_d, F_d = (np.array(values) for values in (impedance.K_f, impedance.K_d, impedance.F_d))
    pushed = np.abs(normal) > 1e-12
    n, K_d, K_f, F_d = normal[pushed], K_d[pushed], K_f[pushed], F_d[pushed]
    limp = K_d == 0.0
    if limp.any():  # without a spring, eq. (7) is K_f (F n + F_d) = 0
        forces = -F_d[limp] / n[limp]
        return max(0.0, float(forces[0])) if K_f[limp].all() and np.ptp(forces) < 1e-9 else 0.0
    give = K_f / K_d
    distance = reference.steps[-1].position[0] - scenario.wall.position - float(n @ (give * F_d))
    yielding = float(n @ (give * n)) + 1.0 / k_c
    return max(0.0, distance / yielding) if yielding > 0.0 else math.inf if distance > 0.0 else 0.0


def _disturbance_rate(scenario: Scenario, design: Design) -> np.ndarray:
    """Bound (6,) on the rate of M_hat^-1 tau_dist, which eq. (28) has to follow."""
    disturbance = scenario.disturbance
    rate = 2.0 * np.pi * np.abs(np.array(disturbance.amplitude) * np.array(disturbance.frequency_hz))
    return np.abs(np.linalg.inv(design.M_hat)) @ rate


def _solve(scenario: Scenario, vehicle: Vehicle, design: Design, gravity: np.ndarray) -> SteadyState | None:
    """Newton's method on the six equations, first without the wall, then in contact if that position is inside it."""
    for in_contact in (False, True):
        balance = _Balance(scenario, vehicle, design, gravity, in_contact)
        x = np.zeros(6)
        for _ in range(60):
            residual = balance(x)
            step = np.linalg.lstsq(_jacobian(balance, x), residual, rcond=None)[0]
            x = x - step * min(1.0, 0.5 / max(np.abs(step).max(), 1e-300))
            if np.abs(step).max() < 1e-14:
                break
        at_rest = bool(np.abs(balance(x)).max() < 1e-8)
        position, quat, _ = balance.pose(x)
        depth = position[0] - scenario.wall.position
        if at_rest and (depth >= 0.0 if in_contact else depth <= 0.0):
            force = scenario.wall.stiffness * depth if in_contact else 0.0
            return SteadyState(position, quat, float(force), balance.sliding(x), balance.thrust(x))
    return None


def _jacobian(function, x: np.ndarray) -> np.ndarray:
    columns = []
    for i in range(6):
        e = np.zeros(6)
        e[i] = 1e-6
        columns.append((function(x + e) - function(x - e)) / 2e-6)
    return np.array(columns).T


class _Balance:
    """Residual (6,) of the balance, a function of x (6,): position minus reference in W, and the rotation vector from
    the desired attitude."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, design: Design, gravity, in_contact: bool) -> None:
        self.scenario, self.vehicle, self.design, self.in_contact = scenario, vehicle, design, in_contact
        self.v_c_W = np.array(scenario.current.velocity_W)
        self.target = np.array(scenario.reference.steps[-1].position)
        self.gravity_W = gravity
        self.tau_dist = np.array(scenario.disturbance.bias)
        self.A = np.array(scenario.controller.A)
        self.M_d_inv = np.linalg.inv(design.M_d)
        self.M_hat_inv = np.linalg.inv(design.M_hat)
        self.K_f, self.F_d = np.array(scenario.impedance.K_f), np.array(scenario.impedance.F_d)
        controller = scenario.controller
        if isinstance(controller, Fosm):
            self.G_inverse = self.A / (self.A - controller.K_s / controller.epsilon)
        else:
            self.G_inverse = np.full(6, 1.0 if isinstance(controller, Impedance) else 0.0)

    def pose(self, x: np.ndarray):
        angle = float(np.linalg.norm(x[3:]))
        axis = x[3:] / angle if angle > 0.0 else np.zeros(3)
        turn = np.concatenate([[np.cos(angle / 2.0)], np.sin(angle / 2.0) * axis])
        quat = _product(self.design.quat_d, turn)
        return self.target + x[:3], quat, rotation_matrix(quat)

    def contact(self, x: np.ndarray) -> np.ndarray:
        """tau_c (6,) in B, eq. (34)."""
        position, _, R_WB = self.pose(x)
        tau_c = np.zeros(6)
        if self.in_contact:
            depth = position[0] - self.scenario.wall.position
            tau_c[:3] = -self.scenario.wall.stiffness * depth * R_WB[0]
        return tau_c

    def asked(self, x: np.ndarray) -> np.ndarray:
        """M_d^-1 (K_d eta_e - K_f (tau_c - F_d))."""
        position, quat, R_WB = self.pose(x)
        quat_e = np.empty(4)
        quat_error(self.design.quat_d, quat, quat_e)
        eta_e = np.concatenate([R_WB.T @ (position - self.target), quat_e[1:]])
        return self.M_d_inv @ (self.design.K_d @ eta_e - self.K_f * (self.contact(x) - self.F_d))

    def sliding(self, x: np.ndarray) -> np.ndarray:
        """s (6,) at rest; zero for super-twisting and for the ideal law."""
        controller = self.scenario.controller
        if isinstance(controller, Fosm):
            return self.unknown(x) / (controller.K_s / controller.epsilon - self.A)
        return -self.asked(x) / self.A if isinstance(controller, Impedance) else np.zeros(6)

    def thrust(self, x: np.ndarray) -> np.ndarray:
        """tau (6,) that holds the vehicle at rest, eq. (10)."""
        d, g_eta = self.environment(x)
        return g_eta - d - self.contact(x)

    def unknown(self, x: np.ndarray) -> np.ndarray:
        """The acceleration (6,) that a law without an integral term must balance through s."""
        d, g_eta = self.environment(x)
        return self.M_hat_inv @ (d + (self.scenario.estimates.restoring - 1.0) * g_eta)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        return self.asked(x) - self.G_inverse * self.unknown(x)

    def environment(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """d and g(eta), (6,) each, in B."""
        vehicle = self.vehicle
        _, _, R_WB = self.pose(x)
        nu_r, term, g_eta = np.zeros(6), np.empty(6), np.empty(6)
        nu_r[:3] = -R_WB.T @ self.v_c_W
        d = self.tau_dist.copy()
        coriolis_added_mass(vehicle.M_A, nu_r, term)
        d -= term
        damping(vehicle.D_linear, vehicle.D_quadratic, nu_r, term)
        d -= term
        restoring(vehicle.mass, vehicle.displaced_mass, vehicle.r_g, vehicle.r_b, self.gravity_W, R_WB, g_eta)
        return d, g_eta


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Quaternion product a b."""
    w, v = a[0] * b[0] - a[1:] @ b[1:], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.concatenate([[w], v])
