"""The planar arm: its equations of motion, written by hand as in docs/physics/planar_arm.md, against the simulator."""

from math import cos, sin

import mujoco
import numpy as np
import pytest

from uvms_mj import attach
from uvms_mj.files import shipped

L, A, B, G = 0.3, 0.25, -0.1, 9.81
"""Length of a link, position (A, B) of the shoulder, gravity."""
BLOCK, LINK = np.diag([30.0, 40, 1.0]), np.diag([1.3, 2.1, 0.017])
"""Inertia with added mass along x, along z, about y."""
DAMPING = {"block": ([10, 15, 1], [40, 60, 2]), "link": ([0.2, 1, 0.01], [1, 10, 0.02])}
GEAR = 0.1


def jacobians(q1: float, q2: float) -> tuple[np.ndarray, np.ndarray]:
    """J_1, J_2 (3, 5): velocity of the middle of each link along it, across it, about y."""
    c1, s1, c12, s12, c2, s2 = cos(q1), sin(q1), cos(q1 + q2), sin(q1 + q2), cos(q2), sin(q2)
    J_1 = [[c1, -s1, B * c1 + A * s1, 0, 0], [s1, c1, B * s1 - A * c1 - L / 2, -L / 2, 0], [0, 0, 1, 1, 0]]
    across = -L * c2 - L / 2
    J_2 = [
        [c12, -s12, B * c12 + A * s12 + L * s2, L * s2, 0],
        [s12, c12, B * s12 - A * c12 + across, across, -L / 2],
        [0, 0, 1, 1, 1],
    ]
    return np.array(J_1), np.array(J_2)


def rates(q1: float, q2: float, q1_dot: float, q2_dot: float) -> tuple[np.ndarray, np.ndarray]:
    """J_1_dot, J_2_dot (3, 5)."""
    c1, s1, c12, s12, c2, s2 = cos(q1), sin(q1), cos(q1 + q2), sin(q1 + q2), cos(q2), sin(q2)
    a, b = q1_dot, q1_dot + q2_dot
    J_1 = [[-s1 * a, -c1 * a, (A * c1 - B * s1) * a, 0, 0], [c1 * a, -s1 * a, (B * c1 + A * s1) * a, 0, 0], [0] * 5]
    along, across = L * c2 * q2_dot, L * s2 * q2_dot
    J_2 = [
        [-s12 * b, -c12 * b, (A * c12 - B * s12) * b + along, along, 0],
        [c12 * b, -s12 * b, (B * c12 + A * s12) * b + across, across, 0],
        [0] * 5,
    ]
    return np.array(J_1), np.array(J_2)


def coriolis(M: np.ndarray, v: np.ndarray) -> np.ndarray:
    """C(v) v of a body with M = diag(m_x, m_z, I) and the velocity v = [u, w, q] in its own axes."""
    (m_x, m_z, _), (u, w, q) = np.diag(M), v
    return np.array([m_z * w * q, -m_x * u * q, (m_x - m_z) * u * w])


def drag(body: str, v: np.ndarray) -> np.ndarray:
    linear, quadratic = DAMPING[body]
    return linear * v + quadratic * np.abs(v) * v


def inertia(q1: float, q2: float) -> np.ndarray:
    """M(q) (5, 5) in zeta = [u, w, q, q1_dot, q2_dot]."""
    M = np.zeros((5, 5))
    M[:3, :3] = BLOCK
    for J in jacobians(q1, q2):
        M += J.T @ LINK @ J
    return M


def other_terms(theta: float, q: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """C(q, zeta) zeta + D(zeta) zeta + g(theta, q) (5,)."""
    h = np.zeros(5)
    h[:3] = coriolis(BLOCK, zeta[:3]) + drag("block", zeta[:3])
    h[:3] += -0.4 * G * np.array([-sin(theta), cos(theta), 0]) + [0, 0, 20.4 * G * 0.02 * sin(theta)]
    h[3:] += GEAR * zeta[3:]
    for k, (J, J_dot) in enumerate(zip(jacobians(*q), rates(*q, *zeta[3:]), strict=True)):
        v, turned = J @ zeta, theta + q[: k + 1].sum()
        weight = 0.2 * G * np.array([-sin(turned), cos(turned), 0])
        h += J.T @ (LINK @ (J_dot @ zeta) + coriolis(LINK, v) + drag("link", v) + weight)
    return h


PLANE = [0, 2, 4, 6, 7]
"""Of the eight coordinates [nu; q_dot] those in the plane."""


def simulated(theta: float, q: np.ndarray, zeta: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """M (8, 8) that MuJoCo has after the callback and the acceleration (8,), both in [nu; q_dot]."""
    model = mujoco.MjModel.from_xml_path(str(shipped("models")["planar_arm"]))
    data = mujoco.MjData(model)
    data.qpos[3:7] = cos(theta / 2), 0, sin(theta / 2), 0
    data.qpos[7:], data.qvel[6:] = q, zeta[3:]
    R_WB = np.array([[cos(theta), 0, sin(theta)], [0, 1, 0], [-sin(theta), 0, cos(theta)]])
    data.qvel[:3], data.qvel[4] = R_WB @ [zeta[0], 0, zeta[1]], zeta[2]
    data.qfrc_applied[:3] = R_WB @ [tau[0], 0, tau[1]]
    data.qfrc_applied[4], data.qfrc_applied[6:] = tau[2], tau[3:]
    with attach(model, data):
        mujoco.mj_forward(model, data)
        full = np.zeros((8, 8))
        mujoco.mj_fullM(model, data, full)
        T = np.eye(8)
        T[:3, :3] = R_WB
        qacc = data.qacc.copy()
    omega = [0, zeta[2], 0]
    qacc[:3] = R_WB.T @ qacc[:3] - np.cross(omega, [zeta[0], 0, zeta[1]])
    return T.T @ full @ T, qacc


@pytest.mark.parametrize("seed", range(10))
def test_the_simulator_has_the_equations_of_the_page(seed):
    """M(q) zeta_dot + C zeta + D zeta + g = tau, in any state and under any force of the plane."""
    rng = np.random.default_rng(seed)
    theta, q = rng.uniform(-1, 1), rng.uniform(-2, 2, 2)
    zeta, tau = rng.uniform(-2, 2, 5), rng.uniform(-20, 20, 5)
    M, zeta_dot = simulated(theta, q, zeta, tau)
    np.testing.assert_allclose(M[np.ix_(PLANE, PLANE)], inertia(*q), rtol=1e-9, atol=1e-9)
    expected = np.linalg.solve(inertia(*q), tau - other_terms(theta, q, zeta))
    np.testing.assert_allclose(zeta_dot[PLANE], expected, rtol=1e-9, atol=1e-9)
    assert np.abs(np.delete(zeta_dot, PLANE)).max() < 1e-9  # nothing leaves the plane
    out = np.delete(M[PLANE], PLANE, axis=1)
    assert np.abs(out).max() < 1e-12


def test_the_rates_are_those_of_the_jacobians():
    """By a central difference of the page's own formulas."""
    q, q_dot, h = np.array([0.4, -1.1]), np.array([0.7, 1.3]), 1e-6
    for rate, after, before in zip(
        rates(*q, *q_dot), jacobians(*(q + h * q_dot)), jacobians(*(q - h * q_dot)), strict=True
    ):
        np.testing.assert_allclose(rate, (after - before) / (2 * h), atol=1e-9)


def test_the_links_move_the_block():
    """At rest in neutral water the momentum stays zero: the elbow's torque turns the block the other way."""
    M = inertia(0.3, -0.8)
    accelerations = np.linalg.solve(M, [0, 0, 0, 0, 1.0])
    assert accelerations[4] > 0 > accelerations[3]
    np.testing.assert_allclose(M[:3] @ accelerations, 0, atol=1e-12)


def test_the_stretched_arm_pitches_the_vehicle_by_26_degrees():
    """The pitch of the page, at which g has no moment about y."""
    moment = [other_terms(np.radians(theta), np.zeros(2), np.zeros(5))[2] for theta in (25.5, 26.5)]
    assert moment[0] < 0 < moment[1]
