"""Frames and rotations. All changes of frame in the package are made here.

World W: x towards the wall, y left, z up. Body B: x forward, y left, z up, origin at the vehicle's body frame. A
rotation matrix ``R_WB`` maps components in B to components in W; a quaternion is ``[w, x, y, z]``. Velocities ``nu =
[v; omega]`` are in B, linear first. MuJoCo's free joint has ``qvel = [v in W; omega in B]``, so ``nu = T qvel`` with
``T = blockdiag(R_WB^T, I)``.
"""

import functools
import math

import numpy as np

from .kernels import kernel

BODY = "body"
"""The frame of the task at which the paper's equations stand: B."""


@kernel
def to_world(R_WB, a_B, a_W):
    """Set the first three components of a_W = R_WB a_B."""
    a_W[:3] = R_WB @ a_B[:3]


@kernel
def to_body(R_WB, a_W, a_B):
    """Set the first three components of a_B = R_WB^T a_W."""
    a_B[:3] = R_WB.T @ a_W[:3]


@kernel
def skew(a):
    """S(a) (3, 3) of a vector (3,), with S(a) b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@kernel
def cross(a, b):
    """The cross product a x b (3,) of two vectors (3,), with the bits of np.cross, which takes ten times as long in
    plain Python: the theory calls kernels there."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@kernel
def velocity_at(nu, p):
    """The velocity (3,) of the point p (3,) of a body that moves with nu = [v; omega] (6,), in its axes: v + omega x p.
    Of the rate of nu, it is the acceleration without the centripetal part."""
    return nu[:3] + cross(nu[3:], p)


@kernel
def body_velocity(R_WB, qvel, nu):
    """Set nu (6,) = T qvel, the free joint's velocity in B."""
    to_body(R_WB, qvel, nu)
    nu[3:] = qvel[3:6]


@kernel
def body_acceleration(R_WB, qacc, nu, nu_dot):
    """Set nu_dot (6,), the time derivative of nu, from the free joint's acceleration qacc = [a_W; omega_dot].

    B rotates, so v_dot = R_WB^T a_W - omega x v. omega_dot is already in B.
    """
    to_body(R_WB, qacc, nu_dot)
    nu_dot[:3] -= cross(nu[3:], nu[:3])
    nu_dot[3:] = qacc[3:6]


@kernel
def compose_poses(R_1, p_1, R_2, p_2, R, p):
    """Set R (3, 3), p (3,) to the pose of a frame in a first one, from its pose R_2, p_2 in a second one and the pose
    R_1, p_1 of that."""
    for i in range(3):
        p[i], R[i] = p_1[i] + R_1[i] @ p_2, R_1[i] @ R_2


@kernel
def motion_at(R, p, motion, out):
    """Set out (6,) to a velocity or an acceleration (6,) at the origin of a frame as one at the origin and in the axes
    of a second frame, whose pose in the first is R (3, 3), p (3,) and which is fixed to the same body."""
    out[:3], out[3:] = R.T @ velocity_at(motion, p), R.T @ motion[3:]


@kernel
def motion_from(R, p, motion, out):
    """Set out (6,), at the origin of a frame, to a velocity or an acceleration (6,) at the origin and in the axes of a
    second frame, whose pose in the first is R (3, 3), p (3,) and which is fixed to the same body."""
    v, omega = R @ motion[:3], R @ motion[3:]
    out[:3], out[3:] = v + cross(p, omega), omega


@kernel
def wrench_at(R, p, wrench, out):
    """Set out (6,) to a wrench (6,) at the origin of a frame as one at the origin and in the axes of a second frame,
    whose pose in the first is R (3, 3), p (3,)."""
    f, moment = wrench[:3], wrench[3:]
    out[:3], out[3:] = R.T @ f, R.T @ (moment - cross(p, f))


@kernel
def add_wrench_from(R, p, wrench, out):
    """Add to out (6,), a wrench at the origin of a frame, a wrench (6,) at the origin and in the axes of a second
    frame, whose pose in the first is R (3, 3), p (3,)."""
    f, moment = R @ wrench[:3], R @ wrench[3:]
    out[:3] += f
    out[3:] += moment + cross(p, f)


@kernel
def rotation(quat, R_WB):
    """Set R_WB (3, 3) from a unit quaternion (4,)."""
    w, x, y, z = quat
    R_WB[0, 0], R_WB[0, 1], R_WB[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R_WB[1, 0], R_WB[1, 1], R_WB[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R_WB[2, 0], R_WB[2, 1], R_WB[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@kernel
def attitude(R, quat):
    """Set quat (4,) to the unit quaternion of a rotation R (3, 3): of q and -q that which is nearer to the quaternion
    in ``quat`` before, so that it does not jump. The largest of its components is computed first (Shepperd 1978)."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    largest = max(trace, R[0, 0], R[1, 1], R[2, 2])
    if largest == trace:
        w, x, y, z = 1.0 + trace, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    elif largest == R[0, 0]:
        w, x, y, z = R[2, 1] - R[1, 2], 1.0 + 2.0 * R[0, 0] - trace, R[1, 0] + R[0, 1], R[0, 2] + R[2, 0]
    elif largest == R[1, 1]:
        w, x, y, z = R[0, 2] - R[2, 0], R[1, 0] + R[0, 1], 1.0 + 2.0 * R[1, 1] - trace, R[2, 1] + R[1, 2]
    else:
        w, x, y, z = R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[2, 1] + R[1, 2], 1.0 + 2.0 * R[2, 2] - trace
    scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    if w * quat[0] + x * quat[1] + y * quat[2] + z * quat[3] < 0.0:
        scale = -scale
    quat[0], quat[1], quat[2], quat[3] = scale * w, scale * x, scale * y, scale * z


@kernel
def multiply(p, q, out):
    """Set out (4,) to the product of the quaternions p and q (4,); out may be one of them."""
    a, b, c, d = p
    w, x, y, z = q
    out[0] = a * w - b * x - c * y - d * z
    out[1] = a * x + b * w + c * z - d * y
    out[2] = a * y - b * z + c * w + d * x
    out[3] = a * z + b * y - c * x + d * w


@kernel
def turning(P, Q):
    """The vector part (3,) of the product of P (4,) with the conjugate of Q (4,)."""
    return Q[0] * P[1:] - P[0] * Q[1:] - cross(P[1:], Q[1:])


@kernel
def quat_error(quat_d, quat, out):
    """Set the error quaternion out = conj(quat_d) * quat (paper, below eq. (12)), with w >= 0.

    q and -q are the same attitude. The sign with w >= 0 gives the shorter rotation, so that a vehicle which starts at
    -q does not turn by a full revolution.
    """
    multiply(np.array([1.0, -1.0, -1.0, -1.0]) * quat_d, quat, out)
    if out[0] < 0.0:
        out[:] = -out


@functools.lru_cache(maxsize=64)  # a Simulation computes the same ones at each reset
def quat_from_euler_deg(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Unit quaternion (4,) of the attitude R_WB = R_z(yaw) R_y(pitch) R_x(roll), read-only; angles in degrees, z up."""
    half = [math.radians(angle) / 2.0 for angle in (roll, pitch, yaw)]
    (c_x, c_y, c_z), (s_x, s_y, s_z) = map(math.cos, half), map(math.sin, half)
    quat = np.array(
        [
            c_x * c_y * c_z + s_x * s_y * s_z,
            s_x * c_y * c_z - c_x * s_y * s_z,
            c_x * s_y * c_z + s_x * c_y * s_z,
            c_x * c_y * s_z - s_x * s_y * c_z,
        ]
    )
    quat.setflags(write=False)
    return quat


def rotation_matrix(quat: np.ndarray) -> np.ndarray:
    """R_WB (3, 3) of a unit quaternion (4,), or (n, 3, 3) of n (n, 4)."""
    R_WB = np.empty((3, 3, *quat.shape[:-1]))
    rotation(quat.tolist() if quat.ndim == 1 else quat.T, R_WB)  # Python's floats are several times as fast as NumPy's
    return np.moveaxis(R_WB, (0, 1), (-2, -1)) if quat.ndim > 1 else R_WB


def quat_turned(quat: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """The attitude (4,) that differs from ``quat`` (4,) by the rotation vector phi (3,) in B."""
    x, y, z = phi.tolist()  # Python's floats are several times as fast as NumPy's
    half = 0.5 * math.hypot(x, y, z)
    w, scale = math.cos(half), 0.5 * math.sin(half) / half if half > 0.0 else 0.5
    q_w, q_x, q_y, q_z = quat.tolist()
    x, y, z = scale * x, scale * y, scale * z
    return np.array(
        [
            q_w * w - (q_x * x + q_y * y + q_z * z),
            q_w * x + w * q_x + (q_y * z - q_z * y),
            q_w * y + w * q_y + (q_z * x - q_x * z),
            q_w * z + w * q_z + (q_x * y - q_y * x),
        ]
    )


def cross_products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The products a x b of vectors (..., 3); np.cross takes two to three times as long."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    i, j, k = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * k - z * j, z * i - x * k, x * j - y * i], axis=-1)


def quat_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The attitudes (..., 4) a b of unit quaternions (..., 4): first the turn b, then a."""
    w_a, w_b, v_a, v_b = a[..., :1], b[..., :1], a[..., 1:], b[..., 1:]
    w = w_a * w_b - (v_a * v_b).sum(axis=-1, keepdims=True)
    return np.concatenate([w, w_a * v_b + w_b * v_a + cross_products(v_a, v_b)], axis=-1)
