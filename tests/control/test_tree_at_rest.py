"""Machine code of a tree at rest, and the kernel of the posture, against NumPy."""

from types import SimpleNamespace

import numpy as np
import pytest

from uvms_mj import Scenario
from uvms_mj.control.posture import posture_constants
from uvms_mj.control.theory.terms import ThrustMap
from uvms_mj.control.theory.tree_at_rest import TreeAtRest
from uvms_mj.physics.frames import attitude, quat_error, rotation_matrix
from uvms_mj.physics.operational import ATTITUDE, FREEDOM, JOINTS, STATION, posture
from uvms_mj.physics.statics import Statics
from uvms_mj.physics.tree import MOST_JOINTS
from uvms_mj.setup.base import set_up

N, MANY = 11, 5
OTHERS = {  # an arm that the model has wrong, in a current, with a disturbance
    "estimates.inertia": 1.2,
    "estimates.restoring": 0.9,
    "current.speed": 0.4,
    "current.direction_deg": 35.0,
    "disturbance.bias": [1.0, -2.0, 3.0, 0.2, -0.1, 0.3],
    "posture.order": ["station", "attitude", "joints"],
}


def demanded(settings, p_WB, R_WB, q, M_inv, P):
    """The acceleration of the posture at rest, with NumPy's eigenvectors and pseudoinverses of the levels."""
    a, P, P_qq = np.zeros(len(P)), P.copy(), P[6:, 6:]
    for kind in settings["levels"]:
        frequency = settings["frequency"][int(kind)]
        if kind == ATTITUDE:
            columns, (T, b) = slice(3, 6), turned(settings, R_WB)
        elif kind == STATION:
            columns, T, b = slice(0, 3), np.eye(3), R_WB.T @ (settings["p_d"] - p_WB)
        else:
            if kind == JOINTS:  # it has all that is left
                b = frequency**2 * (settings["joints"][: len(q)] - q)
                a += P[:, 6:] @ np.linalg.solve(P_qq, b - a[6:])
            break
        L_inv = np.linalg.inv(np.linalg.cholesky(T @ M_inv[columns, columns] @ T.T))
        b = L_inv @ (frequency**2 * b - T @ a[columns])
        X = L_inv @ T @ P[columns]
        sigma, V = np.linalg.eigh(X[:, columns] @ (L_inv @ T).T)
        fading = (3.0 - 2.0 * sigma / FREEDOM) * sigma / FREEDOM**2
        f = np.where(sigma >= FREEDOM, 1.0 / np.maximum(sigma, FREEDOM), fading)
        x = V.T @ X
        a += x.T @ (f * (V.T @ b))
        P -= (x.T * f) @ x
    return a


def turned(settings, R_WB):
    """Rows of the angular velocity, and the error that they take away [rad]."""
    if settings["yaw"]:
        quat, quat_e = np.array([1.0, 0.0, 0.0, 0.0]), np.empty(4)
        attitude(R_WB, quat)
        quat_error(settings["quat_d"], quat, quat_e)
        return np.eye(3), -2.0 * quat_e[1:]
    up, up_d = R_WB[2], settings["up_d"]
    T = np.linalg.svd(up[None])[2][1:]  # the plane normal to it
    return T, -T @ np.cross(up, up_d) / np.sqrt(max(0.5 + 0.5 * float(up @ up_d), 1e-6))


@pytest.mark.parametrize("seed", range(12))
def test_the_posture_demands_what_its_equations_say(seed):
    rng = np.random.default_rng(seed)
    root, J = rng.normal(size=(N, N)), rng.normal(size=(6, N))
    M = root @ root.T + np.eye(N)
    M_inv = np.linalg.inv(M)
    P = M_inv - M_inv @ J.T @ np.linalg.solve(J @ M_inv @ J.T, J @ M_inv)
    levels = rng.permutation(3)[: rng.integers(1, 4)].tolist()
    quat, quat_d = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 4)))
    settings = {
        "levels": np.array([*levels, *[-1] * (3 - len(levels))], float),
        "frequency": rng.uniform(0.5, 3.0, 3),
        "damping": np.ones(3),
        "yaw": bool(seed % 2),
        "quat_d": quat_d,
        "up_d": rotation_matrix(quat_d)[2],
        "p_d": rng.normal(size=3),
        "joints": np.concatenate([rng.normal(size=MANY), np.zeros(MOST_JOINTS - MANY)]),
        "free_damping": 0.7,
    }
    p_WB, R_WB, q, a = rng.normal(size=3), rotation_matrix(quat), rng.normal(size=MANY), np.zeros(N)
    known = SimpleNamespace(p_WB=p_WB, quat_WB=quat, R_WB=R_WB)
    posture(SimpleNamespace(**settings), known, np.zeros(N), q, M, M_inv, P.copy(), a)
    expected = demanded(settings, p_WB, R_WB, q, M_inv, P)
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(a, expected, atol=1e-9 * np.abs(expected).max())


class Tree:
    """A vehicle with an arm at random joint positions and pose, by Statics."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.setup = set_up(Scenario.load("tool_push", OTHERS))
        self.at_rest = TreeAtRest(self.setup, ThrustMap.of(self.setup))
        n = len(self.setup.vehicle.arm.links)
        self.q, self.p_WB, self.tau_c, self.F = (rng.normal(size=size) for size in (n, 3, 6, 6))
        self.R_WB = rotation_matrix((lambda quat: quat / np.linalg.norm(quat))(rng.normal(size=4)))
        self.tree, carrier = Statics(self.setup.vehicle, self.q), self.setup.plant.probe.carrier
        model = self.tree.with_coefficients(self.setup.nominal)
        self.J, self.M = self.tree.jacobian(carrier), model.inertia([1.2] * (1 + n))
        self.g = model.restoring(self.R_WB, self.setup.gravity_W, [0.9] * (1 + n))
        M_inv = np.linalg.inv(self.M)
        self.inverse = self.J @ M_inv @ self.J.T
        self.J_bar = np.linalg.solve(self.inverse, self.J @ M_inv).T
        P = M_inv - self.J_bar @ self.J @ M_inv
        a = demanded(posture_constants(self.setup), self.p_WB, self.R_WB, self.q, M_inv, P)
        self.tau_posture, self.rising = self.M @ a, self.M @ P @ self.g
        v_c_W = np.array(self.setup.scenario.current.velocity_W)
        self.others = self.tree.stream(self.R_WB, v_c_W) - self.tree.restoring(self.R_WB, self.setup.gravity_W)
        self.others[:6] += OTHERS["disturbance.bias"]
        self.others += self.J.T @ self.tau_c
        p, R = self.tree.pose(carrier)
        self.position, self.R = self.p_WB + self.R_WB @ p, self.R_WB @ R


@pytest.mark.parametrize("seed", range(3))
def test_a_tool_that_is_held_accelerates_the_joints_as_the_tree_of_statics_does(seed):
    each = Tree(seed)
    at = each.at_rest
    at.place(each.q, each.position, each.R)
    np.testing.assert_allclose(at.rest["p_WB"], each.p_WB, atol=1e-12)
    np.testing.assert_allclose(at.rest["R_WB"], each.R_WB, atol=1e-12)
    at.push(each.tau_c)
    tau = at.rest["tau"]
    acceleration = np.linalg.solve(each.tree.inertia(), tau + each.others)
    np.testing.assert_allclose(each.J @ acceleration, 0.0, atol=1e-10 * np.abs(acceleration).max())
    np.testing.assert_allclose(at.rest["r"], acceleration[6:], rtol=1e-9, atol=1e-9 * np.abs(acceleration).max())
    F = np.linalg.lstsq(each.J.T, tau - each.tau_posture - each.rising, rcond=None)[0]
    np.testing.assert_allclose(each.J.T @ F + each.tau_posture + each.rising, tau, atol=1e-9 * np.abs(tau).max())
    np.testing.assert_allclose(at.J_bar, each.J_bar, atol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_a_force_at_the_tool_leaves_what_the_tree_of_statics_leaves(seed):
    each = Tree(seed)
    at = each.at_rest
    position, R = at.stand(each.q, each.p_WB, each.R_WB)
    np.testing.assert_allclose(position, each.position, atol=1e-12)
    np.testing.assert_allclose(R, each.R, atol=1e-12)
    at.balance(each.F, each.tau_c)
    g_hat = each.J_bar.T @ each.g
    tau = each.J.T @ each.F + each.g - each.J.T @ g_hat + each.tau_posture
    np.testing.assert_allclose(at.rest["tau"], tau, atol=1e-9 * np.abs(tau).max())
    left = tau + each.others
    np.testing.assert_allclose(at.rest["left"], left, atol=1e-9 * np.abs(left).max())
    a = -each.inverse @ (each.F + each.tau_c - g_hat)
    np.testing.assert_allclose(at.rest["a"], a, atol=1e-9 * np.abs(a).max())
