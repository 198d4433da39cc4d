"""Strapdown inertial navigation: increments of velocity and attitude, and quaternions.

An inertial unit that integrates its rates on board and compensates coning and sculling gives, for each sample, the
rotation vector from B at the last sample to B at this one, and the integral of the specific force in B at the last
sample. Both follow from the attitudes and velocities at the two instants exactly, so that the errors of such a unit are
its noise and its biases alone.
"""

import math

import numpy as np

from ..physics.frames import multiply, to_world
from ..physics.kernels import kernel


@kernel
def turned(quat, x, y, z, out):
    """Set out = quat * Exp([x, y, z]) (4,), of unit length: quat turned by a rotation vector in its own frame [rad]."""
    angle = math.sqrt(x * x + y * y + z * z)
    w, scale = math.cos(0.5 * angle), 0.5
    if angle > 0.0:
        scale = math.sin(0.5 * angle) / angle
    multiply(quat[0], quat[1], quat[2], quat[3], w, scale * x, scale * y, scale * z, 0, out)
    out /= math.sqrt(out @ out)


@kernel
def rotation_vector(start, end, out):
    """Set out (3,) [rad] so that end = start * Exp(out). Below 0.3 rad the relative error is below 1e-8."""
    w = start @ end
    out[0] = start[0] * end[1] - start[1] * end[0] - start[2] * end[3] + start[3] * end[2]
    out[1] = start[0] * end[2] + start[1] * end[3] - start[2] * end[0] - start[3] * end[1]
    out[2] = start[0] * end[3] - start[1] * end[2] + start[2] * end[1] - start[3] * end[0]
    square = out @ out  # sin^2 of half the angle
    scale = 2.0 + square * (1.0 / 3.0 + square * (3.0 / 20.0 + square * 5.0 / 56.0))  # of the arcsine
    out *= scale if w >= 0.0 else -scale


@kernel
def increments(given, quat_before, v_before_W, gravity_W, interval, turn, push):
    """Set the true increments of an interval [s] that ends now: turn (3,) [rad], the rotation vector, and push (3,)
    [m/s], the integral of the specific force in B at the beginning. quat_before (4,) and v_before_W (3,) are the
    attitude and velocity there; they are set to those of now."""
    rotation_vector(quat_before, given.quat_WB, turn)
    w, x, y, z = quat_before[0], quat_before[1], quat_before[2], quat_before[3]
    v_W = np.zeros(3)
    to_world(given.R_WB, given.nu, v_W)
    a, b, c = v_W - v_before_W - interval * gravity_W
    push[0] = (1 - 2 * (y * y + z * z)) * a + 2 * (x * y + w * z) * b + 2 * (x * z - w * y) * c
    push[1] = 2 * (x * y - w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z + w * x) * c
    push[2] = 2 * (x * z + w * y) * a + 2 * (y * z - w * x) * b + (1 - 2 * (x * x + y * y)) * c
    v_before_W[:], quat_before[:] = v_W, given.quat_WB
