"""Rotations, quaternions and the change between qvel and nu."""

import mujoco
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from uvms_mj.physics import frames

angles = arrays(float, 3, elements=st.floats(-179, 179))
vectors = arrays(float, 3, elements=st.floats(-5, 5))


@given(angles)
def test_euler_angles_turn_about_z_then_y_then_x(rpy):
    roll, pitch, yaw = np.deg2rad(rpy)
    x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    z = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    quat = frames.quat_from_euler_deg(*rpy)
    assert np.isclose(np.linalg.norm(quat), 1.0)
    assert np.allclose(frames.rotation_matrix(quat), z @ y @ x, atol=1e-14)


@given(angles, vectors)
def test_matrices_and_quaternions_are_mujocos(rpy, a):
    quat, R, turned = frames.quat_from_euler_deg(*rpy), np.zeros(9), np.zeros(3)
    mujoco.mju_quat2Mat(R, quat)
    assert np.allclose(frames.rotation_matrix(quat), R.reshape(3, 3), atol=1e-15)
    many = np.array([[1.0, 0.0, 0.0, 0.0], quat])
    assert np.allclose(frames.rotation_matrix(many), [np.eye(3), R.reshape(3, 3)], atol=1e-15)
    frames.to_world(R.reshape(3, 3), a, turned)
    assert np.allclose(turned, R.reshape(3, 3) @ a)
    frames.to_body(R.reshape(3, 3), turned, turned)
    assert np.allclose(turned, a, atol=1e-14 * (1 + np.abs(a).max()))


@given(angles, angles)
def test_quaternion_error_is_the_rotation_from_desired_to_actual_the_short_way(desired, actual):
    q_d, q, out = frames.quat_from_euler_deg(*desired), frames.quat_from_euler_deg(*actual), np.zeros(4)
    frames.quat_error(q_d, q, out)
    R_error = frames.rotation_matrix(q_d).T @ frames.rotation_matrix(q)
    assert out[0] >= 0.0
    assert np.allclose(frames.rotation_matrix(out), R_error, atol=1e-14)


def test_acceleration_in_the_body_frame_is_the_derivative_of_the_velocity(rng):
    """nu_dot agrees with central differences of nu along a motion with constant qacc."""
    q, v_W, omega = frames.quat_from_euler_deg(20, -30, 50), rng.normal(size=3), rng.normal(size=3)
    a_W, alpha = rng.normal(size=3), rng.normal(size=3)

    def nu_at(h):
        quat = q.copy()
        mujoco.mju_quatIntegrate(quat, omega + alpha * h / 2, h)
        nu = np.zeros(6)
        frames.body_velocity(frames.rotation_matrix(quat), np.concatenate([v_W + a_W * h, omega + alpha * h]), nu)
        return nu

    nu_dot, h = np.zeros(6), 1e-5
    frames.body_acceleration(frames.rotation_matrix(q), np.concatenate([a_W, alpha]), nu_at(0.0), nu_dot)
    assert np.allclose(nu_dot, (nu_at(h) - nu_at(-h)) / (2 * h), atol=1e-8)


def test_the_cross_product_is_numpys_to_the_last_bit(rng):
    for a, b in rng.normal(size=(100, 2, 3)) * 10.0 ** rng.integers(-8, 8, (100, 2, 1)):
        assert frames.cross(a, b).tobytes() == np.cross(a, b).tobytes()
