"""The twin of a vehicle with joints is right by itself: without water it is MuJoCo's, with water it is Lagrange's."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from random_trees import (
    load_tree,
    of_bodies,
    place_tree,
    random_state,
    random_tree,
    still,
    tree_acceleration,
)
from tree_twin import TwinTree, acceleration, disturbance, inertia, poses, turn
from twin import rotation


def dry(tree: TwinTree) -> TwinTree:
    none = np.zeros((6, 6))
    water = {"M_A": none, "D_linear": none, "D_quadratic": none, "displaced_mass": 0.0, "damping": 0.3}
    return still(of_bodies(tree, lambda body: replace(body, **water)))


@pytest.mark.parametrize(("seed", "joints"), [(1, 0), (2, 1), (3, 3), (4, 6), (5, 10), (6, 30)])
def test_a_dry_tree_is_mujocos(seed, joints):
    tree = dry(random_tree(seed, joints))
    state = random_state(tree, seed)
    tau = np.random.default_rng(seed).normal(size=6 + joints) * 5.0
    model, data = load_tree(tree)
    assert (model.nv, model.njnt) == (6 + joints, 1 + joints)
    place_tree(data, state)
    data.ctrl[:] = tau
    mujoco.mj_forward(model, data)
    p, quat, q, zeta = state
    R, M = rotation(quat), np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    T = np.eye(model.nv)
    T[:3, :3] = R.T
    assert np.allclose(M, T.T @ inertia(tree, q) @ T, rtol=0.0, atol=1e-12 * np.abs(M).max())
    expected = acceleration(tree, R, q, zeta, tau)
    assert np.linalg.norm(tree_acceleration(data, joints) - expected) <= 1e-10 * np.linalg.norm(expected)
    for k, (R_L, p_L) in enumerate(poses(tree, p, R, q)[1:], start=1):
        assert np.allclose(data.body(f"link{k}").xpos, p_L, rtol=0.0, atol=1e-12)
        assert np.allclose(data.body(f"link{k}").xmat.reshape(3, 3), R_L, rtol=0.0, atol=1e-12)


def attitude(x: np.ndarray) -> np.ndarray:
    e = np.eye(3)
    return turn(e[2], x[5]) @ turn(e[1], x[4]) @ turn(e[0], x[3])


def velocities(tree: TwinTree, x: np.ndarray, x_dot: np.ndarray) -> list[np.ndarray]:
    """nu of each body, from the derivative of its pose along x_dot by a complex step."""
    moved = x + 1e-30j * x_dot
    found = []
    for (R, _), (dR, dp) in zip(
        poses(tree, x[:3], attitude(x), x[6:]), poses(tree, moved[:3], attitude(moved), moved[6:]), strict=True
    ):
        S = R.T @ dR.imag / 1e-30
        found.append(np.r_[R.T @ dp.imag / 1e-30, S[2, 1], S[0, 2], S[1, 0]])
    return found


def lagrangian(tree: TwinTree, x: np.ndarray, x_dot: np.ndarray) -> float:
    """Kinetic energy of bodies and water less the potential energy. x has the position of the base, its roll, pitch
    and yaw, and q."""
    total = 0.0
    here = poses(tree, x[:3], attitude(x), x[6:])
    for body, (R, p), nu in zip(tree.bodies, here, velocities(tree, x, x_dot), strict=True):
        nu_r = nu - np.r_[R.T @ tree.v_c_W, np.zeros(3)]
        lifted = [-body.displaced_mass * (p + R @ body.r_b)[2], *(e.mass * (p + R @ e.r_g)[2] for e in body.parts)]
        total += 0.5 * nu @ body.M_RB @ nu + 0.5 * nu_r @ body.M_A @ nu_r - tree.gravity * sum(lifted)
    return total


def drag(tree: TwinTree, x: np.ndarray, x_dot: np.ndarray) -> np.ndarray:
    """Generalised forces of the drag of each body and of the joints' damping, from the powers that they take."""
    total = np.zeros(len(x))
    ways = [velocities(tree, x, e) for e in np.eye(len(x))]
    here = poses(tree, x[:3], attitude(x), x[6:])
    for k, (body, (R, _), nu) in enumerate(zip(tree.bodies, here, velocities(tree, x, x_dot), strict=True)):
        nu_r = nu - np.r_[R.T @ tree.v_c_W, np.zeros(3)]
        wrench = body.D_linear @ nu_r + body.D_quadratic @ (np.abs(nu_r) * nu_r)
        total -= [wrench @ way[k] for way in ways]
        if k > 0:
            total[5 + k] -= body.damping * x_dot[5 + k]
    return total


def velocity_of_base(x: np.ndarray) -> np.ndarray:
    """zeta = J x_dot, (6 + n, 6 + n)."""
    cr, sr, cp, sp = np.cos(x[3]), np.sin(x[3]), np.cos(x[4]), np.sin(x[4])
    J = np.eye(len(x))
    J[:3, :3] = attitude(x).T
    J[3:6, 3:6] = [[1.0, 0.0, -sp], [0.0, cr, sr * cp], [0.0, -sr, cr * cp]]
    return J


STEP = 2e-3


def rate(f):
    """Derivative of f at zero, by central differences of the sixth order."""
    weights = {1: 45.0 / 60.0, 2: -9.0 / 60.0, 3: 1.0 / 60.0}
    return sum(w / STEP * (f(i * STEP) - f(-i * STEP)) for i, w in weights.items())


def gradient(f, x: np.ndarray) -> np.ndarray:
    return np.array([rate(lambda h, e=e: f(x + h * e)) for e in np.eye(len(x))])


@pytest.mark.parametrize(("seed", "joints"), [(11, 1), (12, 3), (13, 5)])
def test_the_twin_obeys_lagranges_equations(seed, joints):
    """With the full added mass, drag, weight and buoyancy of every body, in a current."""
    tree = of_bodies(random_tree(seed, joints), lambda body: replace(body, damping=0.4))
    rng = np.random.default_rng(seed)
    x, x_dot = rng.uniform(-1.0, 1.0, 6 + joints), rng.normal(size=6 + joints)
    tau = rng.normal(size=6 + joints) * 3.0
    J = velocity_of_base(x)
    zeta_dot = acceleration(tree, attitude(x), x[6:], J @ x_dot, tau, t=0.4)
    J_dot = rate(lambda h: velocity_of_base(x + h * x_dot))
    x_ddot = np.linalg.solve(J, zeta_dot - J_dot @ x_dot)

    def momentum(h):
        at = x + h * x_dot + 0.5 * h * h * x_ddot
        return gradient(lambda v: lagrangian(tree, at, v), x_dot + h * x_ddot)

    inertial = rate(momentum) - gradient(lambda y: lagrangian(tree, y, x_dot), x)
    force = J.T @ (tau + np.r_[disturbance(tree, 0.4), np.zeros(joints)]) + drag(tree, x, x_dot)
    assert np.allclose(inertial, force, rtol=0.0, atol=1e-8 * np.abs(inertial).max())
