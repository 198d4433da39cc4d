"""Functions as control engineers write them: machine code gives what plain Python gives. Without a function of libm and
without a matrix product, bit for bit; otherwise to 1e-12."""

import math

import numpy as np
import pytest

from compiled import compare

KIND = np.dtype(
    [
        ("t", "f8"),
        ("h", "f8"),
        ("k", "f8"),
        ("mode", "f8"),
        ("e", "f8", (6,)),
        ("e_dot", "f8", (6,)),
        ("nu", "f8", (6,)),
        ("f", "f8", (3,)),
        ("q", "f8", (4,)),
        ("M", "f8", (6, 6)),
        ("D", "f8", (6, 6)),
        ("x", "f8", (12,)),
    ],
    align=True,
)
STATE = np.dtype([("z", "f8", (6,)), ("P", "f8", (2, 2)), ("L", "f8", (6,)), ("w", "f8", (12,)), ("n", "f8", (1,))])
OUT = np.dtype(("f8", (6,)))

_RANDOM = np.random.default_rng(7)
W1, W2 = _RANDOM.normal(size=(64, 12)) / 4.0, _RANDOM.normal(size=(64, 64)) / 8.0
W3 = _RANDOM.normal(size=(6, 64)) / 8.0
B1, B2 = _RANDOM.normal(size=64), _RANDOM.normal(size=64)
SPEEDS = np.array([-2.0, -1.0, -0.3, 0.0, 0.4, 1.0, 2.0])
THRUSTS = (-40.0, -15.0, -3.0, 0.0, 4.0, 17.0, 45.0)
LIMITS = (10.0, 10.0, 10.0, 2.0, 2.0, 2.0)
A2, B2x = np.array([[1.0, 0.01], [0.0, 1.0]]), np.array([0.0, 0.01])


def pid_with_clamping(g, s, d, tau):
    for i in range(6):
        u = -3.0 * g.e[i] - g.e_dot[i] - s.z[i]
        d.z[i] = g.e[i] if abs(u) < LIMITS[i] else 0.0
        tau[i] = max(-LIMITS[i], min(LIMITS[i], u))


def adaptive_super_twisting(g, s, d, tau):
    sigma = g.e_dot + 2.0 * g.e
    for i in range(6):
        L = abs(s.L[i]) + 0.1
        d.L[i] = 5.0 * np.sign(abs(sigma[i]) - 0.02) if L > 0.05 else 0.05
        d.z[i] = -1.1 * L * np.sign(sigma[i])
        tau[i] = -1.5 * math.sqrt(L * abs(sigma[i])) * np.sign(sigma[i]) + s.z[i]


def accelerated_gradient(g, s, d, tau):
    H = g.M.T @ g.M + np.eye(6)
    x = g.e.copy()
    y = x
    for k in range(8):
        before = x
        x = y - 0.01 * (H @ y)
        y = x + k / (k + 3.0) * (x - before)
    tau[:] = x


def information_filter(g, s, d, tau):
    A = g.M @ g.M.T + np.eye(6)
    tau[:] = np.linalg.solve(A, g.e)


def kalman_of_six(g, s, d, tau):
    P = g.M @ g.M.T + np.eye(6)
    H = np.eye(3, 6)
    S = H @ P @ H.T + 0.1 * np.eye(3)
    K = P @ H.T @ np.linalg.inv(S)
    innovation = g.f - H @ g.e
    tau[:] = g.e + K @ innovation


def neural_policy(g, s, d, tau):
    h1 = np.tanh(W1 @ g.x + B1)
    h2 = np.tanh(W2 @ h1 + B2)
    tau[:] = 10.0 * np.tanh(W3 @ h2)


def radial_basis(g, s, d, tau):
    centres = np.array([-1.0, -0.5, 0.0, 0.5, 1.0, 1.5])
    phi = np.exp(-((g.e[0] - centres) ** 2) / 0.5)
    d.z[:] = 2.0 * phi * g.e_dot[0]
    tau[0] = phi @ s.z


def thrust_table(g, s, d, tau):
    for i in range(6):
        tau[i] = np.interp(g.nu[i], SPEEDS, THRUSTS)


def bilinear_table(g, s, d, tau):
    x = min(max(g.e[0] + 2.5, 0.0), 4.99)
    y = min(max(g.e[1] + 2.5, 0.0), 4.99)
    i, j = int(x), int(y)
    a, b = x - i, y - j
    tau[0] = (1 - a) * (1 - b) * g.M[i, j] + a * (1 - b) * g.M[i + 1, j]
    tau[0] += (1 - a) * b * g.M[i, j + 1] + a * b * g.M[i + 1, j + 1]


def quaternion_product(p, q):
    w = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    v = p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
    return np.array([w, v[0], v[1], v[2]])


def conjugate(q):
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def attitude_error(g, s, d, tau):
    q = g.q / np.linalg.norm(g.q)
    wanted = np.array([1.0, 0.0, 0.0, 0.0])
    error = quaternion_product(conjugate(wanted), q)
    if error[0] < 0.0:
        error = -error
    tau[3:] = -2.0 * error[1:] - g.nu[3:]


def rotation_from_quaternion(q):
    w, x, y, z = q
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def rotated_force(g, s, d, tau):
    R = rotation_from_quaternion(g.q / math.sqrt(g.q @ g.q))
    tau[:3] = R.T @ g.f
    tau[3:] = np.cross(g.e[:3], tau[:3])


def skew(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rigid_coriolis(g, s, d, tau):
    m, r = 11.5, np.array([0.0, 0.0, 0.02])
    C = np.zeros((6, 6))
    C[:3, 3:] = -m * skew(g.nu[:3]) - m * skew(skew(g.nu[3:]) @ r)
    C[3:, :3] = C[:3, 3:].T * -1.0
    C[3:, 3:] = m * skew(skew(g.nu[3:]) @ r) - skew(np.array([0.1, 0.2, 0.3]) * g.nu[3:])
    tau[:] = C @ g.nu


def integrate_quaternion(g, s, d, tau):
    q = g.q
    rate = np.concatenate((np.zeros(1), g.nu[3:]))
    for _ in range(4):
        q = q + 0.5 * 0.01 * quaternion_product(q, rate)
        q = q / np.linalg.norm(q)
    tau[:4] = q


def state_machine(g, s, d, tau):
    mode = int(abs(g.mode)) % 4
    if mode == 0:
        tau[:] = -g.e
        following = 1 if g.f[0] > 0.5 else 0
    elif mode == 1:
        tau[:3] = -0.1 * g.f
        following = 2 if abs(g.f[0]) < 0.1 else 1
    elif mode == 2:
        tau[0] = 1.0
        following = 3
    else:
        tau[:] = 0.0
        following = 0
    s.n[0] = following


def hysteresis(g, s, d, tau):
    on = s.n[0] > 0.5
    if not on and g.e[0] > 0.3:
        on = True
    elif on and g.e[0] < -0.3:
        on = False
    s.n[0] = 1.0 if on else 0.0
    tau[0] = 5.0 * s.n[0]


def schmitt_for_each(g, s, d, tau):
    up, down = g.e > 0.3, g.e < -0.3
    s.z[:] = np.where(up, 1.0, np.where(down, 0.0, s.z))
    tau[:] = s.z


def delay_line(g, s, d, tau):
    s.w[1:] = s.w[:-1]
    s.w[0] = g.e[0]
    tau[0] = s.w[-1]


def moving_average(g, s, d, tau):
    k = int(s.n[0]) % 12
    s.w[k] = g.e[0]
    s.n[0] = (k + 1) % 12
    tau[0] = s.w.mean()


def insertion_sorted_median(g, s, d, tau):
    x = g.e.copy()
    for i in range(1, len(x)):
        value, j = x[i], i - 1
        while j >= 0 and x[j] > value:
            x[j + 1] = x[j]
            j -= 1
        x[j + 1] = value
    tau[0] = 0.5 * (x[2] + x[3])


def notch_bank(g, s, d, tau):
    for i, (w, z) in enumerate(((10.0, 0.1), (25.0, 0.05))):
        x1, x2 = s.w[2 * i], s.w[2 * i + 1]
        d.w[2 * i] = x2
        d.w[2 * i + 1] = -w * w * x1 - 2.0 * z * w * x2 + g.e[i]
        tau[i] = g.e[i] - 2.0 * z * w * x2


def hybrid_force_position(g, s, d, tau):
    n = np.array([1.0, 0.0, 0.0])
    P = np.outer(n, n)
    force = (5.0 - g.f @ n) * n
    d.z[:3] = P @ force
    position = -50.0 * g.e[:3] - 10.0 * g.e_dot[:3]
    tau[:3] = P @ (force + s.z[:3]) + (np.eye(3) - P) @ position


def cholesky_solution(g, s, d, tau):
    A = g.M @ g.M.T + 6.0 * np.eye(6)
    L = np.linalg.cholesky(A)
    y = np.zeros(6)
    for i in range(6):
        y[i] = (g.e[i] - L[i, :] @ y) / L[i, i]
    x = np.zeros(6)
    for i in range(5, -1, -1):
        x[i] = (y[i] - L[:, i] @ x) / L[i, i]
    tau[:] = x


def recursive_least_squares(g, s, d, tau):
    phi, theta, P = g.e[:2], s.z[:2], s.P
    gain = P @ phi / (0.98 + phi @ P @ phi)
    error = g.f[0] - phi @ theta
    s.z[:2] = theta + gain * error
    s.P[:] = (P - np.outer(gain, phi @ P)) / 0.98
    tau[0] = error


def gradient_adaptation(g, s, d, tau):
    regressor = np.diag(g.nu) @ np.diag(np.abs(g.nu))
    sigma = g.e_dot + g.e
    d.z[:] = -0.5 * regressor.T @ sigma
    tau[:] = -sigma + regressor @ s.z


def energy_shaping(g, s, d, tau):
    kinetic = 0.5 * g.nu @ g.M @ g.nu
    potential = 0.5 * np.sum(g.e**2)
    tau[:] = -g.e - g.nu * (kinetic + potential - 1.0)


def line_of_sight(g, s, d, tau):
    cross_track = g.e[1]
    heading = math.atan2(-cross_track, 2.0) - 0.1 * s.z[0]
    d.z[0] = 2.0 * cross_track / (4.0 + (cross_track + 0.1 * s.z[0]) ** 2)
    error = (heading - g.e[5] + math.pi) % (2.0 * math.pi) - math.pi
    tau[5] = -3.0 * error


def wrapped_angles(g, s, d, tau):
    tau[:] = (10.0 * g.e + math.pi) % (2.0 * math.pi) - math.pi


def spline(g, s, d, tau):
    knots = np.array([0.0, 0.5, 1.0, 2.0])
    values = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 2.0], [1.5, -1.0, 0.0], [0.0, 0.0, 0.0]])
    t = min(max(abs(g.t), 0.0), 1.999)
    k = 0
    for i in range(3):
        if t >= knots[i]:
            k = i
    r = (t - knots[k]) / (knots[k + 1] - knots[k])
    tau[:3] = (1.0 - r) * values[k] + r * values[k + 1]


def clipped_to_norm(x, most):
    n = np.linalg.norm(x)
    return x * (most / n) if n > most else x


def norm_limited(g, s, d, tau):
    tau[:3] = clipped_to_norm(g.e[:3], 0.5)
    tau[3:] = clipped_to_norm(g.e[3:], most=0.1)


def gain_schedule(g, s, d, tau):
    depth = abs(g.t)
    for limit, kp, kd in ((0.5, 1.0, 0.1), (1.0, 2.0, 0.2), (1e9, 4.0, 0.4)):
        if depth < limit:
            tau[:] = -kp * g.e - kd * g.e_dot
            break


def newton_root(g, s, d, tau):
    x = 1.0
    for _ in range(50):
        f = x * x * x - 2.0 - abs(g.k)
        if abs(f) < 1e-12:
            break
        x -= f / (3.0 * x * x)
    tau[0] = x


def runge_kutta(g, s, d, tau):
    x, h = s.z[:2], 0.01
    k1 = pendulum(x, g.k)
    k2 = pendulum(x + 0.5 * h * k1, g.k)
    k3 = pendulum(x + 0.5 * h * k2, g.k)
    k4 = pendulum(x + h * k3, g.k)
    s.z[:2] = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def pendulum(x, u):
    return np.array([x[1], -9.81 * math.sin(x[0]) + u])


def horizon(g, s, d, tau):
    """Several steps ahead with a model, and the cost of a few candidates."""
    best, chosen = np.inf, 0.0
    for candidate in (-1.0, -0.5, 0.0, 0.5, 1.0):
        x = g.e[:2]
        cost = 0.0
        for _ in range(10):
            x = A2 @ x + B2x * candidate
            cost += x @ x + 0.01 * candidate**2
        if cost < best:
            best, chosen = cost, candidate
    tau[0], tau[1] = chosen, best


def riccati(g, s, d, tau):
    P = np.eye(2)
    B = B2x.reshape(2, 1)
    for _ in range(30):
        K = np.linalg.solve(0.1 * np.eye(1) + B.T @ P @ B, B.T @ P @ A2)
        P = np.eye(2) + A2.T @ P @ (A2 - B @ K)
    tau[:2] = (-K @ g.e[:2].reshape(2, 1)).sum() * np.ones(2)


def outlier_gate(g, s, d, tau):
    for i in range(6):
        innovation = g.e[i] - s.z[i]
        if abs(innovation) > 1.5 or math.isnan(innovation):
            continue
        s.z[i] += 0.2 * innovation
        tau[i] = s.z[i]


def running_extremes(g, s, d, tau):
    s.z[0] = max(s.z[0], g.e.max())
    s.z[1] = min(s.z[1], g.e.min())
    tau[0] = s.z[0] - s.z[1]
    tau[1] = g.e.argmax() + 10 * np.argmin(g.nu)


def named_arguments(g, s, d, tau):
    tau[:] = mixed(g.e, damping=0.5, rate=g.e_dot)


def mixed(x, rate=None, *, stiffness=1.0, damping=0.0):
    result = -stiffness * x
    if rate is not None:
        result = result - damping * rate
    return result


EXACT = [
    pid_with_clamping, adaptive_super_twisting, thrust_table, bilinear_table, state_machine, hysteresis,
    schmitt_for_each, delay_line, moving_average, insertion_sorted_median, notch_bank, spline, gain_schedule,
    newton_root, outlier_gate, running_extremes, named_arguments, wrapped_angles,
]  # fmt: skip
ROUNDED = [
    accelerated_gradient, information_filter, kalman_of_six, neural_policy, radial_basis, attitude_error, rotated_force,
    rigid_coriolis, integrate_quaternion, hybrid_force_position, cholesky_solution, recursive_least_squares,
    gradient_adaptation, energy_shaping, line_of_sight, norm_limited, runge_kutta, horizon, riccati,
]  # fmt: skip


@pytest.mark.parametrize("law", EXACT, ids=lambda law: law.__name__)
def test_a_law_without_libm_is_plain_python_bit_for_bit(law):
    compare(law, [KIND, STATE, STATE, OUT], runs=30)


@pytest.mark.parametrize("law", ROUNDED, ids=lambda law: law.__name__)
def test_a_law_is_plain_python_to_rounding(law):
    compare(law, [KIND, STATE, STATE, OUT], runs=15, exact=False)
