"""Laws as laboratories write them: in NumPy, with functions and constants beside the law, memory, an adaptation, a
small optimization, and a policy with two hidden layers."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uvms_mj import Controller, gain
from uvms_mj.quantities import NonNegative, Positive

LIMIT = np.array([60.0, 60.0, 60.0, 12.0, 12.0, 12.0])  # N, N m

# LQR with integral action for a double integrator of each axis
M = np.array([20.0, 20.0, 20.0, 1.0, 1.0, 1.0])
GAIN_I = np.sqrt(np.array([400.0, 400.0, 400.0, 40.0, 40.0, 40.0]))
GAIN_P = 9.0 * GAIN_I
GAIN_D = np.sqrt(2.0 * M * GAIN_P)

# prediction over five steps of 0.1 s
STEPS, DT = 5, 0.1
FREE = np.array([[1.0, DT * (k + 1)] for k in range(STEPS)])
FORCED = np.array([[DT**2 * (k - j + 0.5) if j <= k else 0.0 for j in range(STEPS)] for k in range(STEPS)])
HESSIAN = 100.0 * FORCED.T @ FORCED + 0.2 * np.eye(STEPS)
STEP = 1.0 / np.linalg.norm(HESSIAN, 2)

_random = np.random.default_rng(7)
W_1, W_2, W_3 = (_random.normal(size=size) / np.sqrt(size[1]) for size in ((64, 18), (64, 64), (6, 64)))


def limited(tau):
    return np.clip(tau, -LIMIT, LIMIT)


@dataclass(frozen=True)
class AntiWindupPid(Controller):
    """PID: what the limits take off runs the integral back."""

    k_p: Positive = gain(180.0, "N/m, N m", "stiffness")
    k_d: Positive = gain(140.0, "N s/m, N m s", "damping")
    k_i: NonNegative = gain(20.0, "N/(m s), N m/s", "integral gain")
    t_t: Positive = gain(0.5, "s", "time of the back calculation")
    states: ClassVar = {"xi": 6}
    uses_task = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        asked = -gains.k_p * signals.eta_e - gains.k_d * signals.nu_e - gains.k_i * state.xi
        given = limited(asked)
        state_dot.xi[:] = signals.eta_e + (asked - given) / (gains.k_i * gains.t_t + 1e-9)
        tau_cmd[:] = given + signals.g_hat


@dataclass(frozen=True)
class Backstepping(Controller):
    """Fossen's backstepping with a model: a virtual velocity, and its error."""

    k_1: Positive = gain(1.2, "1/s", "of the pose")
    k_2: Positive = gain(90.0, "N s/m, N m s", "of the velocity")
    uses_task = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        alpha = -gains.k_1 * signals.eta_e
        z = signals.nu_e - alpha
        alpha_dot = signals.nu_d_dot - gains.k_1 * signals.nu_e
        tau_cmd[:] = (
            signals.M_hat @ alpha_dot
            + signals.C_hat_nu
            + signals.D_hat_nu
            + signals.g_hat
            - signals.eta_e
            - gains.k_2 * z
        )


@dataclass(frozen=True)
class Adaptive(Controller):
    """Slotine and Li: mass, drag and a constant push of each axis are adapted, with a leakage."""

    lam: Positive = gain(1.0, "1/s", "slope of the sliding surface")
    k_s: Positive = gain(120.0, "N s/m, N m s", "damping of it")
    gamma: tuple[float, float, float] = gain((2.0, 5.0, 10.0), "", "rates of the adaptation")
    sigma: NonNegative = gain(0.02, "1/s", "leakage")
    states: ClassVar = {"theta": 18}
    uses_task = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        surface = signals.nu_e + gains.lam * signals.eta_e
        wanted = signals.nu_d_dot - gains.lam * signals.nu_e
        theta = state.theta.reshape(6, 3)
        for i in range(6):
            y = np.array([wanted[i], signals.nu[i] * abs(signals.nu[i]), 1.0])
            tau_cmd[i] = y @ theta[i] - gains.k_s * surface[i] + signals.g_hat[i]
            state_dot.theta[3 * i : 3 * i + 3] = -gains.gamma * (y * surface[i] + gains.sigma * theta[i])


@dataclass(frozen=True)
class SmallMpc(Controller):
    """Five steps ahead for each axis, solved by 40 steps of a projected gradient with momentum from the last plan."""

    memory: ClassVar = {"plan": (6, 5)}
    uses_task = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            free = FREE @ np.array([signals.eta_e[i], signals.nu_e[i]])
            linear = 100.0 * FORCED.T @ free
            bound = LIMIT[i] / M[i]
            u = state.plan[i].copy()
            y = u.copy()
            for k in range(40):
                new = np.clip(y - STEP * (HESSIAN @ y + linear), -bound, bound)
                y = new + k / (k + 3.0) * (new - u)
                u = new
            state.plan[i] = u
            tau_cmd[i] = M[i] * u[0] + signals.D_hat_nu[i] + signals.g_hat[i]


@dataclass(frozen=True)
class LqrIntegral(Controller):
    """LQR with the integral of the error, on the model's nominal motion."""

    states: ClassVar = {"xi": 6}
    uses_task = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        K = np.hstack([np.diag(GAIN_P), np.diag(GAIN_D), np.diag(GAIN_I)])
        x = np.concatenate([signals.eta_e, signals.nu_e, state.xi])
        state_dot.xi[:] = signals.eta_e
        tau_cmd[:] = signals.g_hat + signals.D_hat_nu - K @ x


@dataclass(frozen=True)
class Policy(Controller):
    """Two hidden layers of 64 with tanh."""

    uses_task = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        x = np.concatenate([signals.eta_e, signals.nu_e, signals.tau_contact_m_B])
        hidden = np.tanh(W_2 @ np.tanh(W_1 @ x))
        tau_cmd[:] = signals.g_hat - 100.0 * signals.eta_e - 100.0 * signals.nu_e + 5.0 * np.tanh(W_3 @ hidden)
