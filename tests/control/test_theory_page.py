"""docs/physics/theory.md: its equations, written as they stand there, beside the functions that compute them.

Eq. (11) is held by tests/analysis/test_disturbance.py, Ott's design by test_damping_design.py.
"""

import math

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from uvms_mj import Gsta, Scenario, Sta, simulate
from uvms_mj.control import Fosm, Impedance, ImpedanceTask
from uvms_mj.control.base import SteadyState
from uvms_mj.control.task import tracking_errors
from uvms_mj.control.theory.certificate import rate_bound
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.setup.base import set_up
from uvms_mj.stages.signals import GIVEN, TASK, record_dtype

SIX = (1.5, 0.7, 2.0, 3.0, 0.4, 1.1)


def random_spd(rng):
    half = rng.normal(size=(6, 6))
    return half @ half.T + 6.0 * np.eye(6)


def skew(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def zero_record(dtype):
    return np.zeros(1, dtype).view(np.recarray)[0]


class Instant:
    """A law's signals at a random state, after the impedance task has run."""

    def __init__(self, rng):
        self.task = ImpedanceTask(F_1=SIX, F_2=SIX[::-1], A=tuple(-7.0 * x for x in SIX))
        signals = zero_record(record_dtype(GIVEN))
        for each in GIVEN:
            if each.kind == "f8":
                signals[each.name] = rng.normal(size=each.shape)
        attitude = Rotation.random(random_state=rng)
        signals.R_WB[:], signals.quat_WB[:] = attitude.as_matrix(), attitude.as_quat(scalar_first=True)
        signals.quat_d[:] = Rotation.random(random_state=rng).as_quat(scalar_first=True)
        signals.K_d[:], signals.K_f[:] = np.abs(rng.normal(size=(2, 6)))
        for name in ("M_hat", "M_d", "D_d"):
            signals[name][:] = random_spd(rng)
        signals.instant = 1
        tracking_errors(signals, signals)
        self.signals, self.zeta = signals, rng.normal(size=6)
        self.run_task(signals)

    def run_task(self, signals):
        """Set the task's signals, and return zeta_dot."""
        state, state_dot = (zero_record(np.dtype([("zeta", "f8", (6,))])) for _ in range(2))
        settings = zero_record(
            np.dtype([(n, "f8", (6,)) for n in ("F_1", "F_2", "A")] + [("M_d_inv", "f8", (6, 6))] + FLAGS)
        )
        settings.F_1[:], settings.F_2[:], settings.A[:] = self.task.F_1, self.task.F_2, self.task.A
        settings.M_d_inv[:] = np.linalg.inv(signals.M_d)
        out, state.zeta[:] = zero_record(record_dtype(TASK)), self.zeta
        ImpedanceTask.step(settings, state, signals, state_dot, out)
        for each in TASK:
            signals[each.name] = out[each.name]
        return state_dot.zeta.copy()

    def s_dot(self, nu_e_dot):
        """The rate of eq. (14) for an acceleration error (6,), with zeta_dot of the program."""
        x = self.signals
        F_1, F_2 = np.array(self.task.F_1), np.array(self.task.F_2)
        return nu_e_dot + F_1 * (self.turned() @ x.nu_e) + F_2 * self.run_task(x)

    def turned(self):
        """The matrix (6, 6) of eq. (18)."""
        q_w, q_v = self.signals.quat_e[0], self.signals.quat_e[1:]
        J = np.eye(6)
        J[3:, 3:] = 0.5 * (q_w * np.eye(3) + skew(q_v))
        return J

    def command(self, law, **state):
        """tau_cmd (6,) and the rates of the law's states."""
        kinds = np.dtype([(name, "f8", (6,)) for name in type(law).states] or [("none", "f8")])
        states, rates, tau = zero_record(kinds), zero_record(kinds), np.full(6, np.nan)
        for name, value in state.items():
            states[name][:] = value
        type(law).law(law, states, self.signals, rates, tau)
        return tau, rates


FLAGS = [("integral", "f8"), ("natural", "f8")]


@pytest.fixture
def instant(rng):
    return Instant(rng)


def test_the_compensator_is_eq_15_with_the_gains_of_eq_21(instant):
    x, inverse = instant.signals, np.linalg.inv
    F_1, F_2, A = (np.diag(each) for each in (instant.task.F_1, instant.task.F_2, instant.task.A))
    A_, F_1_bar = F_2 @ A @ inverse(F_2), F_1 @ instant.turned()
    K_vz = inverse(F_2) @ (inverse(x.M_d) @ x.D_d - F_1_bar + A_)
    K_pz = inverse(F_2) @ (inverse(x.M_d) @ np.diag(x.K_d) + A_ @ F_1)
    K_fz = inverse(F_2) @ inverse(x.M_d) @ np.diag(x.K_f)
    expected = A @ instant.zeta + K_pz @ x.eta_e + K_vz @ x.nu_e - K_fz @ (x.tau_contact_m_B - x.F_d)
    assert np.allclose(instant.run_task(x), expected)
    assert np.allclose(x.s, x.nu_e + F_1 @ x.eta_e + F_2 @ instant.zeta)


def test_the_rate_of_s_is_eq_20_whatever_the_acceleration(instant, rng):
    x, nu_e_dot = instant.signals, rng.normal(size=6)
    demanded = x.K_d * x.eta_e + x.D_d @ x.nu_e - x.K_f * (x.tau_contact_m_B - x.F_d)
    lack = nu_e_dot + np.linalg.solve(x.M_d, demanded)
    assert np.allclose(instant.s_dot(nu_e_dot), lack + instant.task.A * x.s)


def nominal_control(x):
    """Eq. (23) as the paper writes it, for K_f = I and F_d = 0 in place of w."""
    shaped = x.M_hat @ np.linalg.inv(x.M_d)
    error = x.K_d * x.eta_e + x.D_d @ x.nu_e
    estimates = x.C_hat_nu + x.D_hat_nu + x.g_hat
    return x.M_hat @ x.nu_d_dot + estimates + (shaped - np.eye(6)) @ x.tau_contact_m_B - shaped @ error


def test_the_nominal_control_is_eq_23(instant):
    x = instant.signals
    x.K_f[:], x.F_d[:] = 1.0, 0.0
    instant.run_task(x)
    assert np.allclose(instant.command(Impedance())[0], nominal_control(x))


@pytest.mark.parametrize("law", [Gsta(), Gsta(k_1=3.0, k_2=7.0, beta=0.5), Sta(k_1=2.0, k_2=4.0)], ids=repr)
def test_super_twisting_is_eqs_22_and_24_and_leaves_eq_27(law, instant, rng):
    x, z, varphi = instant.signals, rng.normal(size=6), rng.normal(size=6)

    def power(value, p):
        return np.abs(value) ** p * np.sign(value)

    s, beta = x.s.copy(), law.beta
    phi_1 = power(s, 0.5) + beta * s
    phi_2 = 0.5 * power(s, 0.0) + 1.5 * beta * power(s, 0.5) + beta**2 * s
    alpha = -law.k_1 * phi_1 + z
    tau, rates = instant.command(law, z=z)
    assert np.allclose(tau, x.tau_nom + x.M_hat @ (alpha - instant.task.A * s))
    assert np.allclose(rates.z, -law.k_2 * phi_2)
    slope = 0.5 * np.abs(s) ** -0.5 + beta
    assert np.allclose(phi_2, slope * phi_1)
    nu_e_dot = -x.w + np.linalg.solve(x.M_hat, tau - x.tau_nom) + varphi
    assert np.allclose(instant.s_dot(nu_e_dot), alpha + varphi)


def test_gsta_alone_is_its_last_term(instant, rng):
    z, s = rng.normal(size=6), instant.signals.s
    law = Gsta(nominal=False)
    alpha = -law.k_1 * (np.sqrt(np.abs(s)) * np.sign(s) + law.beta * s) + z
    assert np.allclose(instant.command(law, z=z)[0], instant.signals.M_hat @ alpha)


@pytest.mark.parametrize("epsilon", [1e-3, 2.0])
def test_the_first_order_law_is_eqs_31_and_32_and_keeps_the_leak(epsilon, instant, rng):
    law, x, varphi = Fosm(epsilon=epsilon), instant.signals, rng.normal(size=6)
    s = x.s.copy()
    sat = np.where(np.abs(s / epsilon) < 1.0, s / epsilon, np.sign(s))
    tau, _ = instant.command(law)
    assert np.allclose(tau, x.tau_nom - x.M_hat @ (law.K_s * sat))
    nu_e_dot = -x.w + np.linalg.solve(x.M_hat, tau - x.tau_nom) + varphi
    assert np.allclose(instant.s_dot(nu_e_dot), instant.task.A * s - law.K_s * sat + varphi)


def test_a_rotation_has_the_frequency_and_the_damping_ratio_of_half_the_angle():
    ratio, settings = 0.4, {"wall.present": False, "current.speed": 0.0, "initial.attitude_deg": [0.0, 0.0, 1.0]}
    settings |= {"reference.target": [0.0, 0.0, 0.0], "impedance.damping_ratio": ratio, "simulation.duration": 1.0}
    trace = simulate(Scenario.load("push_wall", settings, "ideal"), engine="free_body")
    inertia = set_up(Scenario.load("push_wall", settings, "ideal")).design.M_d[5, 5]
    omega, zeta = math.sqrt(50.0 / (2.0 * inertia)), math.sqrt(2.0) * ratio
    fast, t = omega * math.sqrt(1.0 - zeta**2), trace.t
    closed = np.exp(-zeta * omega * t) * (np.cos(fast * t) + zeta * omega / fast * np.sin(fast * t))
    yaw = 2.0 * np.arcsin(trace.quat_WB[:, 3]) / math.radians(1.0)
    assert closed.min() < -0.05
    assert np.abs(yaw - closed).max() < 2e-3


@drawn(st.integers(0, 2**32 - 1))
def test_the_rate_of_the_lyapunov_function_is_the_quadratic_form_of_the_page(seed):
    k_1, D, b, *xi = np.random.default_rng(seed).uniform(0.1, 9.0, 5)
    xi, c = np.array(xi) - 4.0, 0.5 * k_1
    P = np.array([[D + c * c, -c], [-c, 1.0]])
    xi_dot = np.array([[-k_1, 1.0], [-b, 0.0]]) @ xi
    square = -2.0 * (2.0 * c * (D + c * c) - c * b) * xi[0] ** 2
    page = square + 2.0 * (D + 3.0 * c * c - b) * xi[0] * xi[1] - 2.0 * c * xi[1] ** 2
    assert math.isclose(2.0 * xi @ P @ xi_dot, page, rel_tol=1e-9, abs_tol=1e-9)
    assert math.isclose(np.linalg.det(P), D, rel_tol=1e-9)
    form = 4.0 * c * (2.0 * c * (D + c * c) - c * b) - (D + 3.0 * c * c - b) ** 2
    assert math.isclose(form, 4.0 * b * D - (c * c - b - D) ** 2, rel_tol=1e-9, abs_tol=1e-7)


@drawn(st.floats(0.1, 20.0), st.floats(0.1, 50.0))
def test_a_D_of_the_page_exists_up_to_the_certified_rate_and_not_beyond(k_1, k_2):
    c, delta = 0.5 * k_1, 2.0 * rate_bound(k_1, k_2)

    def interval(delta):
        most, least = math.sqrt(k_2 + delta), math.sqrt(k_2 - delta)
        return max(most - c, c - least, 0.0), least + c

    low, high = interval(0.999 * delta)
    assert low < high
    root_D = 0.5 * (low + high)
    for b in np.linspace(k_2 - 0.999 * delta, k_2 + 0.999 * delta, 9):
        assert abs(math.sqrt(b) - root_D) < c < math.sqrt(b) + root_D
    if 1.001 * delta < k_2:
        low, high = interval(1.001 * delta)
        assert low >= high


@pytest.mark.parametrize("law", ["impedance", "fosm", "gsta", "sta"])
@pytest.mark.parametrize("k_c", [1e5, 2e3])
@pytest.mark.parametrize("generalised", [False, True])
def test_the_push_at_rest_is_the_line_of_the_page(law, k_c, generalised):
    K_f, F_d = (0.7, -2.0) if generalised else (1.0, 0.0)
    settings = {
        "current.direction_deg": 180.0,
        "reference.target": [1.06, 0.0, 0.0],
        "wall.stiffness": k_c,
        "impedance.K_f": [K_f] + [1.0] * 5,
        "impedance.F_d": [F_d] + [0.0] * 5,
    }
    state = steady_state(set_up(Scenario.load("push_wall", settings, law)))
    assert isinstance(state, SteadyState), state
    A, K = -100.0, {"impedance": 0.0, "fosm": 19.0 / 1e-3}.get(law, math.inf)
    d_x = -(4.03 + 18.18 * 0.5) * 0.5
    share = 0.0 if math.isinf(K) else A / (A - K)
    force = (150.0 * 0.06 - K_f * F_d + share * d_x) / (K_f + 150.0 / k_c)
    assert state.force == pytest.approx(force, rel=1e-6)  # the pitch of the offset centre of gravity is the rest
