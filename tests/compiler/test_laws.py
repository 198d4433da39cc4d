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
SMALL = _RANDOM.normal(size=(8, 6))
SPEEDS = np.array([-2.0, -1.0, -0.3, 0.0, 0.4, 1.0, 2.0])
THRUSTS = (-40.0, -15.0, -3.0, 0.0, 4.0, 17.0, 45.0)
LIMITS = (10.0, 10.0, 10.0, 2.0, 2.0, 2.0)
A2, B2x = np.array([[1.0, 0.01], [0.0, 1.0]]), np.array([0.0, 0.01])
Q2, R2 = 1e-3 * np.eye(2), 0.1


def pd_control(g, s, d, tau):
    tau[:] = -g.k * g.e - 2.0 * g.e_dot


def pid_with_clamping(g, s, d, tau):
    for i in range(6):
        u = -3.0 * g.e[i] - g.e_dot[i] - s.z[i]
        d.z[i] = g.e[i] if abs(u) < LIMITS[i] else 0.0
        tau[i] = max(-LIMITS[i], min(LIMITS[i], u))


def impedance(g, s, d, tau):
    tau[:] = g.M @ (g.D @ g.e_dot + g.k * g.e)


def computed_torque(g, s, d, tau):
    acceleration = -4.0 * g.e - 4.0 * g.e_dot
    tau[:] = g.M @ acceleration + g.D @ g.nu + np.abs(g.nu) * g.nu


def super_twisting(g, s, d, tau):
    sigma = g.e_dot + 2.0 * g.e
    root = np.sqrt(np.abs(sigma)) * np.sign(sigma)
    d.z[:] = -1.1 * np.sign(sigma)
    tau[:] = -1.5 * root + s.z


def adaptive_super_twisting(g, s, d, tau):
    sigma = g.e_dot + 2.0 * g.e
    for i in range(6):
        L = abs(s.L[i]) + 0.1
        d.L[i] = 5.0 * np.sign(abs(sigma[i]) - 0.02) if L > 0.05 else 0.05
        d.z[i] = -1.1 * L * np.sign(sigma[i])
        tau[i] = -1.5 * math.sqrt(L * abs(sigma[i])) * np.sign(sigma[i]) + s.z[i]


def boundary_layer(g, s, d, tau):
    sigma = g.e_dot + g.e
    tau[:] = -5.0 * np.clip(sigma / 0.05, -1.0, 1.0)


def hyperbolic_switching(g, s, d, tau):
    tau[:] = -5.0 * np.tanh((g.e_dot + g.e) / 0.05)


def prescribed_performance(g, s, d, tau):
    rho = (2.0 - 0.05) * math.exp(-0.5 * abs(g.t)) + 0.05
    for i in range(6):
        xi = min(max(g.e[i] / rho, -0.999), 0.999)
        transformed = 0.5 * math.log((1.0 + xi) / (1.0 - xi))
        tau[i] = -g.k * transformed / (rho * (1.0 - xi * xi))


def backstepping(g, s, d, tau):
    alpha = -2.0 * g.e
    z2 = g.nu - alpha
    alpha_dot = -2.0 * g.e_dot
    tau[:] = g.M @ (alpha_dot - g.e - 3.0 * z2) + g.D @ g.nu


def command_filter(g, s, d, tau):
    wn, zeta = 10.0, 0.8
    x, v = s.w[:6], s.w[6:]
    d.w[:6] = v
    d.w[6:] = wn * wn * (g.e - x) - 2.0 * zeta * wn * v
    tau[:] = x


def projected_gradient(g, s, d, tau):
    """A few steps of a box-constrained quadratic programme."""
    H = g.M @ g.M.T + 10.0 * np.eye(6)
    u = np.zeros(6)
    step = 1.0 / (np.trace(H) + 1.0)
    for _ in range(20):
        gradient = H @ u - g.e
        u = np.clip(u - step * gradient, -0.05, 0.05)
    tau[:] = u


def accelerated_gradient(g, s, d, tau):
    H = g.M.T @ g.M + np.eye(6)
    x = g.e.copy()
    y = x
    for k in range(8):
        before = x
        x = y - 0.01 * (H @ y)
        y = x + k / (k + 3.0) * (x - before)
    tau[:] = x


def kalman_filter(g, s, d, tau):
    x = s.z[:2]
    P = s.P
    x = A2 @ x + B2x * g.e[0]
    P = A2 @ P @ A2.T + Q2
    S = P[0, 0] + R2
    K = P[:, 0] / S
    x = x + K * (g.e[1] - x[0])
    P = P - np.outer(K, P[0])
    s.z[:2] = x
    s.P[:] = P
    tau[:2] = x


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


def luenberger(g, s, d, tau):
    d.z[:] = s.w[:6] + 20.0 * (g.e - s.z)
    d.w[:6] = 100.0 * (g.e - s.z)
    tau[:] = s.w[:6]


def high_gain_observer(g, s, d, tau):
    eps = 0.01
    gains = np.array([3.0 / eps, 3.0 / eps**2, 1.0 / eps**3])
    x = s.w[0:3]
    error = g.e[0] - x[0]
    shifted = np.array([x[1], x[2], 0.0])
    d.w[0:3] = shifted + gains * error
    tau[0] = x[2]


def sliding_differentiator(g, s, d, tau):
    error = s.w[0] - g.e[0]
    v = s.w[1] - 1.5 * math.sqrt(abs(error)) * np.sign(error)
    d.w[0] = v
    d.w[1] = -1.1 * np.sign(error)
    tau[0] = v


def disturbance_observer(g, s, d, tau):
    d_hat = s.z + 5.0 * (g.M @ g.nu)
    d.z[:] = -5.0 * (d_hat + g.e)
    tau[:] = -g.e - d_hat


def friction_observer(g, s, d, tau):
    v = g.nu[0]
    dissipation = abs(v) / (1.5 + 0.5 * math.exp(-((v / 0.01) ** 2)))
    d.z[0] = v - dissipation * s.z[0]
    tau[0] = 1e2 * s.z[0] + 0.3 * d.z[0] + 0.4 * v


def friction_compensation(g, s, d, tau):
    stribeck = 0.2 + 0.3 * np.exp(-np.abs(g.nu / 0.1))
    tau[:] = np.where(np.abs(g.nu) < 1e-3, 0.0, stribeck * np.sign(g.nu))


def neural_policy(g, s, d, tau):
    h1 = np.tanh(W1 @ g.x + B1)
    h2 = np.tanh(W2 @ h1 + B2)
    tau[:] = 10.0 * np.tanh(W3 @ h2)


def rectified_policy(g, s, d, tau):
    hidden = np.maximum(SMALL @ g.e, 0.0)
    tau[:] = SMALL.T @ hidden


def radial_basis(g, s, d, tau):
    centres = np.array([-1.0, -0.5, 0.0, 0.5, 1.0, 1.5])
    phi = np.exp(-((g.e[0] - centres) ** 2) / 0.5)
    d.z[:] = 2.0 * phi * g.e_dot[0]
    tau[0] = phi @ s.z


def thrust_table(g, s, d, tau):
    for i in range(6):
        tau[i] = np.interp(g.nu[i], SPEEDS, THRUSTS)


def thrust_table_by_hand(g, s, d, tau):
    for i in range(6):
        v = min(max(g.nu[i], SPEEDS[0]), SPEEDS[-1])
        k = 0
        while k < len(SPEEDS) - 2 and v > SPEEDS[k + 1]:
            k += 1
        share = (v - SPEEDS[k]) / (SPEEDS[k + 1] - SPEEDS[k])
        tau[i] = THRUSTS[k] + share * (THRUSTS[k + 1] - THRUSTS[k])


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


def euler_angles(g, s, d, tau):
    q = g.q / np.linalg.norm(g.q)
    w, x, y, z = q
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    tau[3], tau[4], tau[5] = roll, pitch, yaw


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


def debounce(g, s, d, tau):
    touching = abs(g.f[0]) > 0.5
    s.n[0] = s.n[0] + 1 if touching else 0
    tau[0] = 1.0 if touching and s.n[0] > 3 or not touching and s.n[0] == 0 else 0.0


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


def median_of_three(g, s, d, tau):
    a, b, c = g.f
    tau[0] = max(min(a, b), min(max(a, b), c))


def insertion_sorted_median(g, s, d, tau):
    x = g.e.copy()
    for i in range(1, len(x)):
        value, j = x[i], i - 1
        while j >= 0 and x[j] > value:
            x[j + 1] = x[j]
            j -= 1
        x[j + 1] = value
    tau[0] = 0.5 * (x[2] + x[3])


def rate_limit(g, s, d, tau):
    for i in range(6):
        change = np.clip(g.e[i] - s.z[i], -0.1, 0.1)
        s.z[i] += change
        tau[i] = s.z[i]


def dead_zone(g, s, d, tau):
    width = 0.2
    tau[:] = np.sign(g.e) * np.maximum(np.abs(g.e) - width, 0.0)


def low_pass_second_order(g, s, d, tau):
    b0, b1, b2, a1, a2 = 0.02, 0.04, 0.02, -1.56, 0.64
    x = g.e[0]
    y = b0 * x + s.w[0]
    s.w[0] = b1 * x - a1 * y + s.w[1]
    s.w[1] = b2 * x - a2 * y
    tau[0] = y


def notch_bank(g, s, d, tau):
    for i, (w, z) in enumerate(((10.0, 0.1), (25.0, 0.05))):
        x1, x2 = s.w[2 * i], s.w[2 * i + 1]
        d.w[2 * i] = x2
        d.w[2 * i + 1] = -w * w * x1 - 2.0 * z * w * x2 + g.e[i]
        tau[i] = g.e[i] - 2.0 * z * w * x2


def admittance(g, s, d, tau):
    v = s.w[:3]
    d.w[:3] = (g.f - 20.0 * v - 100.0 * s.z[:3]) / 5.0
    d.z[:3] = v
    tau[:3] = 200.0 * (s.z[:3] - g.e[:3]) - 30.0 * g.nu[:3]


def hybrid_force_position(g, s, d, tau):
    n = np.array([1.0, 0.0, 0.0])
    P = np.outer(n, n)
    force = (5.0 - g.f @ n) * n
    d.z[:3] = P @ force
    position = -50.0 * g.e[:3] - 10.0 * g.e_dot[:3]
    tau[:3] = P @ (force + s.z[:3]) + (np.eye(3) - P) @ position


def damped_pseudoinverse(g, s, d, tau):
    J = g.M[:3]
    tau[:] = J.T @ np.linalg.solve(J @ J.T + 0.01 * np.eye(3), g.f)


def null_space(g, s, d, tau):
    J = g.M[:2]
    JJ = J @ J.T
    inverse = J.T @ np.linalg.inv(JJ + 0.1 * np.eye(2))
    N = np.eye(6) - inverse @ J
    tau[:] = inverse @ g.f[:2] + N @ g.e


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


def determinant(g, s, d, tau):
    tau[0] = np.linalg.det(g.M[:3, :3])
    tau[1] = np.linalg.det(g.M[:2, :2]) - (g.M[0, 0] * g.M[1, 1] - g.M[0, 1] * g.M[1, 0])


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


def projection_operator(g, s, d, tau):
    rate = g.e * g.nu
    outside = (np.abs(s.z) > 1.0) & (s.z * rate > 0.0)
    d.z[:] = np.where(outside, 0.0, rate)
    tau[:] = s.z


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


def quintic(g, s, d, tau):
    r = min(max(g.t, 0.0), 1.0)
    tau[0] = r**3 * (10.0 - 15.0 * r + 6.0 * r**2)
    tau[1] = 30.0 * r**2 * (1.0 - r) ** 2


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


def weighted_allocation(g, s, d, tau):
    B = g.M
    W = np.diag(1.0 / (1.0 + np.abs(g.nu)))
    tau[:] = W @ B.T @ np.linalg.solve(B @ W @ B.T + 0.5 * np.eye(6), g.e)


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


def matrix_exponential(g, s, d, tau):
    A = 0.1 * g.M
    total = np.eye(6)
    term = np.eye(6)
    for k in range(1, 12):
        term = term @ A / k
        total += term
    tau[:] = total @ g.e


def complementary_filter(g, s, d, tau):
    roll = math.atan2(g.f[1], g.f[2])
    s.z[0] = 0.98 * (s.z[0] + g.nu[3] * 0.01) + 0.02 * roll
    tau[3] = s.z[0]


def outlier_gate(g, s, d, tau):
    for i in range(6):
        innovation = g.e[i] - s.z[i]
        if abs(innovation) > 1.5 or math.isnan(innovation):
            continue
        s.z[i] += 0.2 * innovation
        tau[i] = s.z[i]


def voting(g, s, d, tau):
    votes = 0
    for value in (g.e[0], g.e[1], g.e[2]):
        votes += value > 0.0
    tau[0] = 1.0 if votes >= 2 else -1.0


def running_extremes(g, s, d, tau):
    s.z[0] = max(s.z[0], g.e.max())
    s.z[1] = min(s.z[1], g.e.min())
    tau[0] = s.z[0] - s.z[1]
    tau[1] = g.e.argmax() + 10 * np.argmin(g.nu)


def relay_tuning(g, s, d, tau):
    crossing = s.z[0] * g.e[0] < 0.0
    s.n[0] += crossing
    s.z[0] = g.e[0]
    tau[0] = 2.0 if g.e[0] >= 0.0 else -2.0


def thruster_curve(g, s, d, tau):
    u = np.clip(g.e, -1.0, 1.0)
    tau[:] = np.where(u >= 0.0, 40.0 * u**2, -30.0 * u * u)


def named_arguments(g, s, d, tau):
    tau[:] = mixed(g.e, damping=0.5, rate=g.e_dot)


def mixed(x, rate=None, *, stiffness=1.0, damping=0.0):
    result = -stiffness * x
    if rate is not None:
        result = result - damping * rate
    return result


EXACT = [
    pd_control, pid_with_clamping, super_twisting, adaptive_super_twisting, boundary_layer, command_filter, luenberger,
    high_gain_observer, sliding_differentiator, thrust_table, thrust_table_by_hand, bilinear_table, state_machine,
    debounce, hysteresis, schmitt_for_each, delay_line, moving_average, median_of_three, insertion_sorted_median,
    rate_limit, dead_zone, low_pass_second_order, notch_bank, admittance, projection_operator, spline, gain_schedule,
    newton_root, outlier_gate, voting, running_extremes, relay_tuning, thruster_curve, named_arguments, wrapped_angles,
]  # fmt: skip
ROUNDED = [
    impedance, computed_torque, hyperbolic_switching, prescribed_performance, backstepping, projected_gradient,
    accelerated_gradient, kalman_filter, information_filter, kalman_of_six, disturbance_observer, friction_observer,
    friction_compensation, neural_policy, rectified_policy, radial_basis, attitude_error, rotated_force,
    rigid_coriolis, euler_angles, integrate_quaternion, hybrid_force_position, damped_pseudoinverse, null_space,
    cholesky_solution, determinant, recursive_least_squares, gradient_adaptation, energy_shaping, line_of_sight,
    quintic, weighted_allocation, norm_limited, runge_kutta, horizon, riccati, matrix_exponential,
    complementary_filter,
]  # fmt: skip


@pytest.mark.parametrize("law", EXACT, ids=lambda law: law.__name__)
def test_a_law_without_libm_is_plain_python_bit_for_bit(law):
    compare(law, [KIND, STATE, STATE, OUT], runs=30)


@pytest.mark.parametrize("law", ROUNDED, ids=lambda law: law.__name__)
def test_a_law_is_plain_python_to_rounding(law):
    compare(law, [KIND, STATE, STATE, OUT], runs=15, exact=False)
