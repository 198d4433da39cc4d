"""Independent twin of the closed loop, in NumPy and SciPy alone, to test the simulator against.

Written from Dyrhaug, Pettersen and Gravdahl, "Robust Interaction using Generalized Super-Twisting Impedance
Control" ("paper") and Fossen (2021); it shares no code with the package. It has the plant, eq. (10), twice: as 6x6
matrices in `matrix_acceleration`, and as cross products of momenta in `simulate_fixed_step`.

World W: x towards the wall, y left, z up. Body B: forward, left, up. nu = [v; omega] and every wrench are in B, at
the body's origin, linear part first. Quaternions are w x y z and rotate B into W. SI units, radians.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

Array = np.ndarray
Vector = tuple[float, ...] | list[float] | Array  # its length is given in the comment
Diagonal = float | Vector  # scalar, or the 6 entries of a diagonal matrix
ZEROS_3 = (0.0,) * 3
ZEROS_6 = (0.0,) * 6
IDENTITY = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class TwinParameters:
    """Vehicle, water, wall, reference, law; the defaults are the paper's scenario with the full GSTA law."""

    # rigid body, about the body's origin
    mass: float = 7.31  # kg
    inertia: Array = field(default_factory=lambda: 0.16 * np.eye(3))  # (3, 3), kg m^2, I_b
    r_g: Vector = (0.0, 0.0, -0.00019)  # (3,), m, centre of gravity in B
    r_b: Vector = ZEROS_3  # (3,), m, centre of buoyancy in B
    gravity: float = 9.81  # m/s^2
    buoyancy: float | None = None  # N; None: neutrally buoyant, m g
    # water
    M_A: Array = field(default_factory=lambda: np.diag([5.5, 12.7, 14.57, 0.12, 0.12, 0.12]))  # (6, 6)
    D_linear: Array = field(default_factory=lambda: np.diag([4.03, 6.22, 5.18, 0.07, 0.07, 0.07]))  # (6, 6)
    # (6, 6), of abs(nu_j) nu_j
    D_quadratic: Array = field(default_factory=lambda: np.diag([18.18, 21.66, 36.99, 1.55, 1.55, 1.55]))
    v_c_W: Vector = (0.5 * math.cos(math.pi / 1.5), 0.5 * math.sin(math.pi / 1.5), 0.0)  # (3,), m/s
    # tau_dist(t) = bias + amplitude sin(2 pi frequency t), in B
    disturbance_bias: Vector = ZEROS_6  # (6,), N and N m
    disturbance_amplitude: Vector = ZEROS_6  # (6,), N and N m
    disturbance_frequency_hz: Diagonal = 0.0  # scalar or (6,)
    # wall at x = x_c in W
    x_c: float = 1.0  # m
    k_c: float = 1e5  # N/m
    b_c: float = 0.0  # N s/m
    # reference, its waypoints in order of time
    reference_start: Vector = ZEROS_3  # (3,), m, in W
    waypoints: tuple[tuple[float, Vector], ...] = ((1.0, (1.01, 0.0, 0.0)),)  # (s, (3,) m in W)
    bandwidth: float = 2.0  # rad/s, omega_n
    q_d: Vector = IDENTITY  # (4,), constant desired attitude
    # desired impedance and sliding variable
    K_d: Vector = (150.0, 1500.0, 1500.0, 50.0, 50.0, 50.0)  # (6,)
    M_d: Array | None = None  # (6, 6); None: the true M
    D_d: Array | None = None  # (6, 6); None: Ott's design
    damping_ratio: float = 1.0  # of Ott's design
    F_1: Diagonal = 1.0
    F_2: Diagonal = 1.0
    A: Diagonal = -100.0
    # law
    law: Literal["impedance", "fosm", "gsta"] = "gsta"
    nominal: bool = True  # False, with "gsta": tau = M_hat tau_GSTA
    k_1: float = 5.0
    k_2: float = 10.0
    beta: float = 5.0
    K_s: float = 19.0
    epsilon: float = 1e-3
    period: float | None = None  # s, sampling period of the law; None: every time step
    f_M: float = 1.0  # M_hat = f_M M
    f_C: float = 1.0  # C_hat(nu) nu = f_C C(nu) nu
    f_D: float = 1.0  # D_hat(nu) nu = f_D D(nu) nu
    f_g: float = 1.0  # g_hat(eta) = f_g g(eta)
    # start and time
    p_0: Vector = ZEROS_3  # (3,), m, p_WB
    quat_0: Vector = IDENTITY  # (4,), quat_WB
    nu_0: Vector = ZEROS_6  # (6,)
    timestep: float = 1e-4  # s
    duration: float = 20.0  # s


def skew(a: Vector) -> Array:
    """Matrix S(a), (3, 3), with S(a) b = a x b."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(quat: Vector) -> Array:
    """Rotation matrix R_WB, (3, 3), of a quaternion of any length but zero."""
    return np.array(_rows(*_unit(quat))).reshape(3, 3)


def M_RB(parameters: TwinParameters) -> Array:
    """Rigid-body inertia about the body's origin, (6, 6)."""
    m_I, m_S = parameters.mass * np.eye(3), parameters.mass * skew(parameters.r_g)
    return np.block([[m_I, -m_S], [m_S, np.asarray(parameters.inertia)]])  # Fossen (2021), sec. 3.3


def C_RB(parameters: TwinParameters, nu: Vector) -> Array:
    """Rigid-body Coriolis matrix, (6, 6), in the form that is independent of the linear velocity."""
    m, S_g, S_w = parameters.mass, skew(parameters.r_g), skew(nu[3:])
    S_h = skew(np.asarray(parameters.inertia) @ np.asarray(nu[3:]))
    return np.block([[m * S_w, -m * S_w @ S_g], [m * S_g @ S_w, -S_h]])  # Fossen (2021), eq. (3.63)


def C_A(parameters: TwinParameters, nu: Vector) -> Array:
    """Added-mass Coriolis matrix, (6, 6), of the full M_A (Kirchhoff)."""
    h = np.asarray(parameters.M_A) @ np.asarray(nu)
    S_1, S_2 = skew(h[:3]), skew(h[3:])
    return np.block([[np.zeros((3, 3)), -S_1], [-S_1, -S_2]])  # Fossen (2021), sec. 6.3, Kirchhoff form


def D(parameters: TwinParameters, nu: Vector) -> Array:
    """Damping matrix, (6, 6), linear and quadratic."""
    return np.asarray(parameters.D_linear) + np.asarray(parameters.D_quadratic) * np.abs(nu)  # eq. (33)


def g_eta(parameters: TwinParameters, quat: Vector) -> Array:
    """Restoring wrench on the left-hand side of eq. (10), (6,), in B."""
    up_B = rotation(quat)[2]  # R^T e_z
    weight = -parameters.mass * parameters.gravity * up_B
    buoyancy = _buoyancy(parameters) * up_B
    return -np.r_[weight + buoyancy, skew(parameters.r_g) @ weight + skew(parameters.r_b) @ buoyancy]


def tau_dist(parameters: TwinParameters, t: float) -> Array:
    """Disturbance wrench at time t, (6,), in B."""
    wave = np.sin(2.0 * math.pi * np.asarray(parameters.disturbance_frequency_hz) * t)
    return np.asarray(parameters.disturbance_bias) + np.asarray(parameters.disturbance_amplitude) * wave


def matrix_acceleration(
    parameters: TwinParameters, p: Vector, quat: Vector, nu: Vector, tau: Vector, t: float
) -> Array:
    """nu_dot, (6,), under the wrench tau without contact, so that p, (3,) in W, has no effect."""
    nu = np.asarray(nu, float)
    v_c = rotation(quat).T @ np.asarray(parameters.v_c_W)  # the current in B
    nu_c = np.r_[v_c, ZEROS_3]
    nu_c_dot = np.r_[-skew(nu[3:]) @ v_c, ZEROS_3]  # constant in W, so it turns in B
    nu_r = nu - nu_c
    C = C_RB(parameters, nu_r) + C_A(parameters, nu_r)
    resistance = (C + D(parameters, nu_r)) @ nu_r + g_eta(parameters, quat)
    load = np.asarray(tau) + tau_dist(parameters, t) - resistance
    return np.linalg.solve(M_RB(parameters) + np.asarray(parameters.M_A), load) + nu_c_dot  # paper eq. (10)


def reference(parameters: TwinParameters, t: float) -> tuple[list[float], list[float], list[float]]:
    """p_d, p_d_dot, p_d_ddot in W at time t: superposed steps through (omega_n / (p + omega_n))^3."""
    w = parameters.bandwidth
    before = parameters.reference_start
    p_d, p_d_dot, p_d_ddot = [float(x) for x in before], [0.0] * 3, [0.0] * 3
    for start, target in parameters.waypoints:
        if t <= start:
            break
        a = w * (t - start)
        decay = math.exp(-a)
        step = 1.0 - decay * (1.0 + a + a * a / 2.0)
        rate, curvature = w * decay * a * a / 2.0, w * w * decay * (a - a * a / 2.0)
        for i in range(3):
            change = target[i] - before[i]
            p_d[i] += change * step
            p_d_dot[i] += change * rate
            p_d_ddot[i] += change * curvature
        before = target
    return p_d, p_d_dot, p_d_ddot


def damping_design(M_d: Array, K_d: Array, ratio: float) -> Array:
    """Ott's damping, (6, 6): one damping ratio in every generalised eigenmode of (K_d, M_d), both (6, 6)."""
    k, V = eigh(K_d, M_d)  # V^T M_d V = I, V^T K_d V = diag(k)
    Q = V.T @ M_d  # the inverse of V: M_d = Q^T Q, K_d = Q^T diag(k) Q
    return Q.T @ np.diag(2.0 * ratio * np.sqrt(np.maximum(k, 0.0))) @ Q  # Ott (2008), sec. 3.3


# Plain floats for the inner loop; R is 9 numbers, row by row.


def _rows(w: float, x: float, y: float, z: float) -> tuple[float, ...]:
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


def _to_W(R: Vector, a: Vector) -> tuple[float, float, float]:
    x, y, z = a
    return R[0] * x + R[1] * y + R[2] * z, R[3] * x + R[4] * y + R[5] * z, R[6] * x + R[7] * y + R[8] * z


def _to_B(R: Vector, a: Vector) -> tuple[float, float, float]:
    x, y, z = a
    return R[0] * x + R[3] * y + R[6] * z, R[1] * x + R[4] * y + R[7] * z, R[2] * x + R[5] * y + R[8] * z


def _cross(a: Vector, b: Vector) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _product(a: Vector, b: Vector) -> tuple[float, float, float, float]:
    """Quaternion product a (x) b."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def _floats(a: Vector) -> list[float]:
    return np.asarray(a, float).tolist()


def _unit(quat: Vector) -> tuple[float, ...]:
    return tuple(_floats(np.asarray(quat, float) / np.linalg.norm(quat)))


def _buoyancy(parameters: TwinParameters) -> float:
    return parameters.mass * parameters.gravity if parameters.buoyancy is None else parameters.buoyancy


class _Plant:
    """Eq. (10) with precomputed constants."""

    def __init__(self, parameters: TwinParameters) -> None:
        W, B = parameters.mass * parameters.gravity, _buoyancy(parameters)
        self.M = M_RB(parameters) + np.asarray(parameters.M_A, float)
        self.M_inv = np.linalg.inv(self.M)
        self.D = np.asarray(parameters.D_linear, float), np.asarray(parameters.D_quadratic, float)
        self.surplus = W - B
        self.lever = _floats(W * np.asarray(parameters.r_g) - B * np.asarray(parameters.r_b))
        self.v_c_W = _floats(parameters.v_c_W)

    def resistance(self, R: Vector, nu: Vector, f_C: float, f_D: float, f_g: float) -> list[float]:
        """f_C C(nu) nu + f_D D(nu) nu + f_g g(eta), (6,)."""
        h = self.M.dot(nu).tolist()
        v, omega, h_1, h_2, up_B = nu[:3], nu[3:], h[:3], h[3:], R[6:9]
        # both Coriolis parametrisations times nu give the change of momentum in a rotating frame
        a, b, c = _cross(omega, h_1), _cross(v, h_1), _cross(omega, h_2)  # Fossen (2021), eq. (3.63)
        coriolis = (*a, b[0] + c[0], b[1] + c[1], b[2] + c[2])
        restoring = (*[self.surplus * x for x in up_B], *_cross(self.lever, up_B))
        damping = (self.D[0].dot(nu) + self.D[1].dot([abs(x) * x for x in nu])).tolist()  # paper eq. (33)
        return [f_C * coriolis[i] + f_D * damping[i] + f_g * restoring[i] for i in range(6)]

    def acceleration(self, R: Vector, nu: list[float], load: list[float]) -> list[float]:
        """nu_dot, (6,), under the sum of all applied wrenches, (6,)."""
        v_c = _to_B(R, self.v_c_W)
        nu_r = [nu[0] - v_c[0], nu[1] - v_c[1], nu[2] - v_c[2], *nu[3:]]
        resistance = self.resistance(R, nu_r, 1.0, 1.0, 1.0)
        # paper eq. (10)
        x, y, z, *omega_dot = self.M_inv.dot([load[i] - resistance[i] for i in range(6)]).tolist()
        v_c_dot = _cross(v_c, nu[3:])  # -omega x v_c
        return [x + v_c_dot[0], y + v_c_dot[1], z + v_c_dot[2], *omega_dot]


class _Law:
    """The three laws with their states zeta and z, and s of the latest sample, (6,) each."""

    def __init__(self, parameters: TwinParameters, plant: _Plant) -> None:
        if parameters.law not in ("impedance", "fosm", "gsta"):
            raise ValueError(f"law is {parameters.law!r}; choose 'impedance', 'fosm' or 'gsta'")
        self.parameters, self.plant = parameters, plant
        M_d = plant.M if parameters.M_d is None else np.asarray(parameters.M_d, float)
        K_d, D_d = np.diag(_floats(parameters.K_d)), parameters.D_d
        if D_d is None:
            D_d = damping_design(M_d, K_d, parameters.damping_ratio)
        self.M_d_inv = np.linalg.inv(M_d)
        self.M_d_inv_K_d_D_d = self.M_d_inv @ np.hstack([K_d, D_d])
        self.M_hat = parameters.f_M * plant.M
        self.feedforward = self.M_hat @ self.M_d_inv - np.eye(6)
        gains = [np.full(6, x, float) for x in (parameters.F_1, parameters.F_2, parameters.A)]
        self.gains = np.array(gains).T.tolist()
        w, x, y, z = _unit(parameters.q_d)
        self.q_d_conjugate = (w, -x, -y, -z)
        self.s, self.z, self.zeta = [0.0] * 6, [0.0] * 6, [0.0] * 6

    def errors(self, t: float, p: Vector, quat: Vector, R: Vector, nu: list[float]) -> tuple[tuple, ...]:
        """eta_e, its derivative by eq. (18), nu_e and nu_d_dot, (6,) each, in B."""
        p_d, p_d_dot, p_d_ddot = reference(self.parameters, t)
        omega = nu[3:]
        p_e = _to_B(R, (p[0] - p_d[0], p[1] - p_d[1], p[2] - p_d[2]))
        v_d, a_d = _to_B(R, p_d_dot), _to_B(R, p_d_ddot)
        v_e = (nu[0] - v_d[0], nu[1] - v_d[1], nu[2] - v_d[2])
        turn = _cross(v_d, omega)  # -omega x v_d
        w, x, y, z = _product(self.q_d_conjugate, quat)
        if w < 0.0:
            w, x, y, z = -w, -x, -y, -z
        a, b, c = _cross((x, y, z), omega)
        q_v_dot = (0.5 * (w * omega[0] + a), 0.5 * (w * omega[1] + b), 0.5 * (w * omega[2] + c))  # eq. (17)
        nu_d_dot = (a_d[0] + turn[0], a_d[1] + turn[1], a_d[2] + turn[2], 0.0, 0.0, 0.0)
        return (*p_e, x, y, z), (*v_e, *q_v_dot), (*v_e, *omega), nu_d_dot

    def sample(
        self, t: float, p: Vector, quat: Vector, R: Vector, nu: list[float], tau_c: list[float], period: float
    ) -> list[float]:
        """tau, (6,), from the contact wrench tau_c, (6,), of this instant; then zeta and z advance by one period."""
        law, zeta, z = self.parameters, self.zeta, self.z
        with_nominal = law.nominal or law.law != "gsta"
        eta_e, eta_e_dot, nu_e, nu_d_dot = self.errors(t, p, quat, R, nu)
        impedance = self.M_d_inv_K_d_D_d.dot(eta_e + nu_e).tolist()  # M_d^-1 (K_d eta_e + D_d nu_e)
        contact = self.M_d_inv.dot(tau_c).tolist()
        acceleration = [0.0] * 6  # tau has M_hat times this
        for i, (F_1, F_2, A) in enumerate(self.gains):  # F_2 A F_2^-1 = A, all three being diagonal
            s = self.s[i] = nu_e[i] + F_1 * eta_e[i] + F_2 * zeta[i]  # paper eq. (14)
            inside = impedance[i] + A * (F_1 * eta_e[i] + nu_e[i]) - F_1 * eta_e_dot[i] - contact[i]
            zeta[i] += period * (A * zeta[i] + inside / F_2)  # paper eq. (15), (21); (18) for F1bar nu_e
            if with_nominal:
                acceleration[i] = nu_d_dot[i] - impedance[i]  # paper eq. (23)
            if law.law == "fosm":
                acceleration[i] -= law.K_s * max(-1.0, min(1.0, s / law.epsilon))  # paper eq. (31), (32)
            elif law.law == "gsta":
                sign = math.copysign(1.0, s) if s != 0.0 else 0.0
                root = sign * math.sqrt(abs(s))
                phi_1 = root + law.beta * s
                phi_2 = 0.5 * sign + 1.5 * law.beta * root + law.beta**2 * s
                acceleration[i] += z[i] - law.k_1 * phi_1  # paper eq. (24a)
                z[i] -= period * law.k_2 * phi_2  # paper eq. (24b)
                if with_nominal:
                    acceleration[i] -= A * s  # paper eq. (22)
        tau = self.M_hat.dot(acceleration).tolist()
        if with_nominal:
            model = self.plant.resistance(R, nu, law.f_C, law.f_D, law.f_g)
            contact = self.feedforward.dot(tau_c).tolist()
            tau = [tau[i] + model[i] + contact[i] for i in range(6)]  # paper eq. (23)
        return tau


def simulate_fixed_step(parameters: TwinParameters, timestep: float | None = None) -> dict[str, Array]:
    """Closed loop by semi-implicit Euler, nu first; n = duration / timestep + 1 rows, the first at t = 0.

    Returns t (n,), p (n, 3) in W, quat (n, 4), nu (n, 6), force (n,) pushing on the wall at t; s, z, zeta,
    tau (n, 6) of the law's latest sample: its states before they advance, and its command.
    Raises ValueError for an unknown law, or a period that isn't a multiple of the step.
    """
    h = parameters.timestep if timestep is None else timestep
    ratio = 1 if parameters.period is None else round(parameters.period / h)
    if ratio < 1 or (parameters.period is not None and abs(ratio * h / parameters.period - 1.0) > 1e-9):
        raise ValueError(f"period is {parameters.period} s; choose a multiple of the time step, {h} s")
    table = np.empty((round(parameters.duration / h) + 1, 39))
    x_c, k_c, b_c = parameters.x_c, parameters.k_c, parameters.b_c
    calm, bias = not np.any(parameters.disturbance_amplitude), _floats(tau_dist(parameters, 0.0))
    plant = _Plant(parameters)
    law = _Law(parameters, plant)
    p, quat, nu = _floats(parameters.p_0), _unit(parameters.quat_0), _floats(parameters.nu_0)
    for k in range(len(table)):
        t, R = k * h, _rows(*quat)
        force, tau_c = 0.0, [0.0] * 6
        if p[0] > x_c:
            force = max(0.0, k_c * (p[0] - x_c) + b_c * _to_W(R, nu[:3])[0])  # paper eq. (34), with a damper
            tau_c = [*_to_B(R, (-force, 0.0, 0.0)), 0.0, 0.0, 0.0]
        if k % ratio == 0:
            z, zeta = law.z.copy(), law.zeta.copy()
            tau = law.sample(t, p, quat, R, nu, tau_c, ratio * h)
        table[k] = (t, force, *p, *quat, *nu, *law.s, *z, *zeta, *tau)

        disturbance = bias if calm else tau_dist(parameters, t).tolist()
        load = [tau[i] + tau_c[i] + disturbance[i] for i in range(6)]
        nu_dot = plant.acceleration(R, nu, load)
        nu = [nu[i] + h * nu_dot[i] for i in range(6)]
        p_dot = _to_W(R, nu[:3])
        p = [p[i] + h * p_dot[i] for i in range(3)]
        rate = math.hypot(*nu[3:])
        c = math.sin(0.5 * h * rate) / rate if rate > 0.0 else 0.0
        turn = (math.cos(0.5 * h * rate), c * nu[3], c * nu[4], c * nu[5])  # exponential map
        quat = _product(quat, turn)
        norm = math.hypot(*quat)
        quat = (quat[0] / norm, quat[1] / norm, quat[2] / norm, quat[3] / norm)
    p_q_nu = {"p": table[:, 2:5], "quat": table[:, 5:9], "nu": table[:, 9:15]}
    s_z_tau = {"s": table[:, 15:21], "z": table[:, 21:27], "zeta": table[:, 27:33], "tau": table[:, 33:39]}
    return {"t": table[:, 0], "force": table[:, 1], **p_q_nu, **s_z_tau}


def simulate_smooth(parameters: TwinParameters, t_eval: Vector) -> dict[str, Array]:
    """Continuous-time impedance law (23), wall ignored; t_eval, (n,), in s, rises from 0 or later.

    Returns t (n,), p (n, 3) in W, quat (n, 4), nu (n, 6).
    """
    if parameters.law != "impedance":
        raise ValueError(f"law is {parameters.law!r}; the smooth solution exists for 'impedance' only")
    t_eval = np.asarray(t_eval, float)
    law = _Law(parameters, _Plant(parameters))

    def derivative(t: float, y: Array) -> Array:
        p, quat, nu = y[:3].tolist(), _unit(y[3:7]), y[7:].tolist()
        R = _rows(*quat)
        tau = law.sample(t, p, quat, R, nu, [0.0] * 6, 0.0)
        quat_dot = 0.5 * np.array(_product(quat, (0.0, *nu[3:])))  # paper eq. (16)
        return np.r_[_to_W(R, nu[:3]), quat_dot, matrix_acceleration(parameters, p, quat, nu, tau, t)]

    y = np.r_[parameters.p_0, _unit(parameters.quat_0), parameters.nu_0]
    rows = np.empty((t_eval.size, 13))
    # a step of the reference has a discontinuous third derivative, so integration stops and restarts there
    ends = sorted({t for t, _ in parameters.waypoints if 0.0 < t < t_eval[-1]} | {float(t_eval[-1])})
    begin = 0.0
    for end in ends:
        inside = (t_eval >= begin) & (t_eval <= end)
        times = np.union1d(t_eval[inside], [end])
        solution = solve_ivp(derivative, (begin, end), y, "DOP853", times, rtol=1e-11, atol=1e-12)
        rows[inside], y, begin = solution.y.T[: inside.sum()], solution.y[:, -1], end
    quat = rows[:, 3:7] / np.linalg.norm(rows[:, 3:7], axis=1, keepdims=True)
    return {"t": t_eval, "p": rows[:, :3], "quat": quat, "nu": rows[:, 7:]}
