"""Secondary tasks in strict priority: each level against the others, against least squares, and near singularities."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uvms_mj.engine.native.compilation import native_function
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.physics.operational import ATTITUDE, FREEDOM, JOINTS, STATION, posture

LEVELS = (ATTITUDE, STATION, JOINTS)


def record(**fields):
    """A record (1,) of arrays, numbers and flags."""
    arrays = {name: np.asarray(value) for name, value in fields.items()}
    found = np.zeros(
        1, np.dtype([(k, "?" if a.dtype == bool else "f8", a.shape) for k, a in arrays.items()], align=True)
    )
    for name, array in arrays.items():
        found[name] = array
    return found


MOST = 12
"""Most joints of a case. All cases have arrays of this size, so that one compilation serves them all."""


_vector, _matrix = (np.dtype(("f8", (6 + MOST,) * axes)) for axes in (1, 2))
KINDS = [_vector, np.dtype(("f8", (MOST,))), _matrix, _matrix, _matrix, _vector]


def conditioned(rng, rows, columns, low, high):
    """A random matrix with singular values from low to high."""
    U, _, V = np.linalg.svd(rng.normal(size=(rows, columns)), full_matrices=False)
    return (U * np.exp(rng.uniform(np.log(low), np.log(high), size=min(rows, columns)))) @ V


def padded(values, size):
    return np.concatenate([np.ravel(values), np.zeros(size - np.size(values))])


class Case:
    """A random vehicle with n joints, a task of six rows above the posture, and a state."""

    def __init__(self, seed, n=5, order=LEVELS, yaw=False, free_damping=0.0):
        rng = np.random.default_rng(seed)
        N = self.N = 6 + n
        self.n, self.order, self.yaw = n, order, yaw
        A = conditioned(rng, N, N, 0.3, 6.0)
        self.M = A @ A.T
        self.M_inv = np.linalg.inv(self.M)
        self.X, self.B = conditioned(rng, 6, 6, 0.5, 2.0), conditioned(rng, 6, n, 0.3, 2.0)
        self.zeta, self.q = rng.normal(size=N), rng.normal(size=n)
        self.quat, self.quat_d = (quat_from_euler_deg(*rng.uniform(-40.0, 40.0, size=3)) for _ in range(2))
        self.p, self.p_d, self.joints = rng.normal(size=3), rng.normal(size=3), rng.normal(size=n)
        self.frequency, ratio = rng.uniform(0.5, 3.0, size=3), rng.uniform(0.3, 1.5, size=3)
        self.damping, self.free_damping = 2.0 * ratio * self.frequency, free_damping

    @property
    def J(self):
        """Of the task (6, N), X (nu + B q_dot): the base can always do it."""
        return np.hstack([self.X, self.X @ self.B])

    @property
    def P(self):
        """What the task leaves: M^-1 N^T."""
        Y = self.M_inv @ self.J.T
        return self.M_inv - Y @ np.linalg.solve(self.J @ Y, Y.T)

    def run(self, P=None):
        """a (N,), and what is left of P (N, N), by machine code."""
        N, most = self.N, 6 + MOST
        settings = record(
            levels=padded(self.order, 3) - (np.arange(3) >= len(self.order)),
            **{name: getattr(self, name) for name in ("frequency", "damping", "yaw", "quat_d", "free_damping")},
            up_d=rotation_matrix(self.quat_d)[2],
            p_d=self.p_d,
            joints=padded(self.joints, MOST),
        )
        known = record(p_WB=self.p, quat_WB=self.quat, R_WB=rotation_matrix(self.quat))
        zeta, q, a = padded(self.zeta, most), padded(self.q, MOST), np.zeros(most)
        matrices = [np.eye(most) for _ in range(3)]  # of further joints at rest, which are not coupled with the others
        for matrix, own in zip(matrices, (self.M, self.M_inv, self.P if P is None else P), strict=True):
            matrix[:N, :N] = own
        native = native_function(posture, [settings.dtype, known.dtype, *KINDS]).ctypes
        native(*(each.ctypes.data for each in (settings, known, zeta, q, *matrices, a)))
        assert not a[N:].any()
        return a[:N].copy(), matrices[2][:N, :N].copy()

    def demands(self):
        """The Jacobian and the demanded acceleration of each level, in order, in NumPy."""
        R, v, omega = rotation_matrix(self.quat), self.zeta[:3], self.zeta[3:6]
        for level in self.order:
            k, d = self.frequency[level] ** 2, self.damping[level]
            J = np.zeros((0, self.N))
            if level == STATION:
                J, b = np.eye(self.N)[:3], -k * R.T @ (self.p - self.p_d) - d * v - np.cross(omega, v)
            elif level == JOINTS:
                J, b = np.eye(self.N)[6:], -k * (self.q - self.joints) - d * self.zeta[6:]
            else:
                R_e = rotation_matrix(self.quat_d).T @ R  # from B to the desired frame
                J = np.eye(self.N)[3:6]
                if self.yaw:
                    S = R_e - R_e.T
                    axis = np.array([S[2, 1], S[0, 2], S[1, 0]])  # 2 sin(theta)
                    b = -k * axis / np.sqrt(1.0 + np.trace(R_e)) - d * omega
                else:
                    up, up_d = R[2], rotation_matrix(self.quat_d)[2]
                    axis = np.cross(up, up_d)
                    e = axis / np.linalg.norm(axis) * np.linalg.norm(up - up_d)
                    T = np.linalg.svd(up[None])[2][1:]
                    J, b = T @ J, T @ (-k * e - d * omega)
            yield J, b


cases = st.integers(0, 2**32 - 1)
orders = st.permutations(LEVELS).flatmap(lambda order: st.integers(0, 3).map(lambda n: tuple(order[:n])))


@given(cases, st.integers(1, 8), orders, st.booleans())
def test_the_task_above_feels_nothing_and_no_level_feels_a_lower_one(seed, n, order, yaw):
    """J_1 M^-1 tau = J_1 a = 0, and the acceleration at a level is the same with and without the levels below it."""
    case = Case(seed, n, order=order, yaw=yaw)
    a, P = case.run()
    scale = 1.0 + np.abs(a).max()
    assert np.abs(case.J @ a).max() < 1e-10 * scale
    assert np.allclose(P, P.T, rtol=0.0, atol=1e-12 * np.abs(case.M_inv).max())
    left = case.P
    for k, (J, _) in enumerate(list(case.demands())):
        strict = shares(J, case, left)[0] > FREEDOM
        case.order = order[: k + 1]
        above, left = case.run()
        if strict:
            assert np.abs(J @ (a - above)).max() < 1e-10 * scale


def reference(J, case):
    """What the rows have in all: the base without a task, the joints below it."""
    return J @ (case.P if J[:, 6:].any() else case.M_inv) @ J.T


def shares(J, case, P=None):
    """The shares of freedom of a level below the task, ascending."""
    L = np.linalg.cholesky(reference(J, case))
    W = np.linalg.solve(L, J)
    return np.linalg.eigvalsh(W @ (case.P if P is None else P) @ W.T)


@given(cases, st.integers(8, 12), st.permutations(LEVELS), st.booleans())
def test_a_level_with_freedom_has_the_demanded_acceleration(seed, n, order, yaw):
    case = Case(seed, n, order=tuple(order), yaw=yaw)
    a, P = case.run()
    left = case.P
    for J, b in case.demands():
        values = shares(J, case, left)
        if values[0] > FREEDOM:
            assert np.allclose(J @ a, b, rtol=0.0, atol=1e-9 * (1.0 + np.abs(a).max()))
        else:
            return
        Y = left @ J.T
        left = left - Y @ np.linalg.solve(J @ Y, Y.T)
    assert np.allclose(P, left, rtol=0.0, atol=1e-9 * np.abs(case.M_inv).max())


@given(cases, st.permutations(LEVELS))
def test_order_matters_where_freedom_is_short(seed, order):
    """With five joints the first two levels of five or six components leave the third one nothing."""
    case = Case(seed, 5, order=tuple(order), yaw=False)
    a, _ = case.run()
    (J, b), *_ = case.demands()
    if shares(J, case)[0] > FREEDOM:
        assert np.allclose(J @ a, b, rtol=0.0, atol=1e-9 * (1.0 + np.abs(a).max()))
    case.order = tuple(reversed(order))
    other, _ = case.run()
    assert np.abs(J @ (a - other)).max() > 1e-6


@given(cases)
def test_demands_beyond_the_freedom_are_met_in_the_least_squares_of_the_inertia(seed):
    """Six joint demands in three degrees of freedom, against NumPy's least squares in a basis of the free motion."""
    case = Case(seed, 6, order=(ATTITUDE, JOINTS), yaw=True)
    a, _ = case.run()
    (attitude, b_a), (J, b) = case.demands()
    if shares(attitude, case)[0] > FREEDOM:
        above = np.vstack([case.J, attitude])
        W = np.linalg.inv(np.linalg.cholesky(reference(J, case)))
        first = case.P @ attitude.T @ np.linalg.solve(attitude @ case.P @ attitude.T, b_a)
        Z = np.linalg.svd(above)[2][9:].T  # (12, 3)
        y = np.linalg.lstsq(W @ J @ Z, W @ (b - J @ first), rcond=None)[0]
        assert np.allclose(a, first + Z @ y, rtol=0.0, atol=1e-8 * (1.0 + np.abs(a).max()))


@pytest.mark.slow
def test_a_direction_that_loses_its_freedom_fades_without_a_jump():
    """The joints turn until they can no longer roll the base. Along the way the acceleration is continuous and bounded,
    and where the base can't roll it is not tried."""
    roll, b, largest = Case(3).B[3], 0.0, []

    def along(points):
        nonlocal b
        case = Case(3, 5, order=(ATTITUDE, JOINTS), yaw=True)
        for share in np.linspace(-0.4, 0.4, points):
            case.B[3] = share * roll
            case.order = (ATTITUDE,)
            a, _ = case.run()
            ((_, b),) = case.demands()
            W = np.linalg.inv(np.linalg.cholesky(case.M_inv[3:6, 3:6]))
            largest.append(np.sqrt(a @ case.M @ a) / np.linalg.norm(W @ b))
            case.order = (ATTITUDE, JOINTS)
            yield case.run()[0]

    coarse, fine = np.array(list(along(501))), np.array(list(along(2001)))
    steps = [np.abs(np.diff(each, axis=0)).max() for each in (coarse, fine)]
    assert steps[1] < 0.3 * steps[0] < 0.3
    assert abs(fine[1000, 3]) < 1e-9 < abs(b[0])
    assert 2.0 < max(largest) < 1.03 / np.sqrt(FREEDOM)


@given(cases, st.integers(3, 6))
def test_motion_that_no_level_governs_decays(seed, n):
    """The free velocity P M zeta decays with the rate, and neither the task nor a level feels it."""
    case = Case(seed, n, order=(ATTITUDE,), free_damping=0.7)
    a, P = case.run()
    case.free_damping = 0.0
    without, left = case.run()
    assert np.allclose(P, left, rtol=0.0, atol=0.0)
    assert np.allclose(a - without, -0.7 * P @ case.M @ case.zeta, rtol=0.0, atol=1e-12)
    Z = np.linalg.svd(np.vstack([case.J, *(J for J, _ in case.demands())]))[2][8:].T
    if shares(next(case.demands())[0], case)[0] > FREEDOM:  # then P has the span of Z
        assert np.allclose(P, Z @ np.linalg.solve(Z.T @ case.M @ Z, Z.T), rtol=0.0, atol=1e-8)


def test_gains_scale_with_the_inertia():
    """Another unit of mass changes the torque M a, not the acceleration."""
    case = Case(5, 5, order=LEVELS, free_damping=1.0)
    a, _ = case.run()
    case.M, case.M_inv = 1e3 * case.M, 1e-3 * case.M_inv
    heavy, _ = case.run()
    assert np.allclose(a, heavy, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("yaw", [False, True])
@pytest.mark.parametrize("angle_deg", [20.0, -110.0, 179.0])
def test_the_attitude_turns_the_short_way_about_the_axis_of_its_error(yaw, angle_deg):
    """About the x axis the demand is -omega^2 2 sin(theta/2), and only about it."""
    case = Case(2, 6, order=(ATTITUDE,), yaw=yaw)
    case.M_inv = case.M = np.eye(case.N)
    case.zeta[:] = 0.0
    case.quat, case.quat_d = quat_from_euler_deg(angle_deg, 0.0, 0.0), np.array([1.0, 0.0, 0.0, 0.0])
    a, _ = case.run(np.eye(case.N))
    expected = -(case.frequency[ATTITUDE] ** 2) * 2.0 * np.sin(np.radians(angle_deg) / 2.0)
    assert np.allclose(a, expected * np.eye(case.N)[3], rtol=0.0, atol=1e-12)


def test_tilt_alone_ignores_a_turn_about_the_vertical():
    case = Case(2, 6, order=(ATTITUDE,))
    case.zeta[:] = 0.0
    case.quat_d, case.quat = quat_from_euler_deg(10.0, -20.0, 0.0), quat_from_euler_deg(10.0, -20.0, 130.0)
    a, _ = case.run()
    assert np.abs(a).max() < 1e-12
