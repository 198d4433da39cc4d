r"""Covariance of the error state of inertial navigation, 15 states.

The error state is :math:`\delta x = [\delta p_W, \delta v_W, \delta\theta, \delta b_g, \delta b_a]`, truth minus
estimate, with the attitude error as a rotation vector in B: :math:`R = \hat R\, Exp(\delta\theta)` (Sola, "Quaternion
kinematics for the error-state Kalman filter", arXiv:1711.02508, sec. 5; Fossen (2021), sec. 14.4). Over an interval h
with the increments of velocity and attitude, without their biases, dv and dtheta,

.. math::

    \delta v' &= \delta v - \hat R [dv]_\times \delta\theta - h \hat R\, \delta b_a - \hat R\, n_a
        && \text{Sola, sec. 5.4.2}

    \delta p' &= \delta p + \tfrac{h}{2} (\delta v + \delta v'), \qquad
    \delta\theta' = Exp(d\theta)^\top \delta\theta - h\, \delta b_g - n_g

A matrix (15, 15) is 225 numbers, row by row.
"""

import math

import numpy as np

from ..physics.kernels import kernel


@kernel
def transition(R, push, turn, interval, A, E):
    """Set the blocks of F, (9,) each, row by row: A = -R [push]x of dv' over dtheta, and E = Exp(turn)^T."""
    for i in range(3):
        A[3 * i : 3 * i + 3] = np.cross(push, R[i])
    x, y, z = turn[0], turn[1], turn[2]
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    s, c = 1.0, 0.5
    if angle > 1e-6:
        s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    E[0], E[1], E[2] = 1.0 - c * (y * y + z * z), c * x * y + s * z, c * x * z - s * y
    E[3], E[4], E[5] = c * x * y - s * z, 1.0 - c * (x * x + z * z), c * y * z + s * x
    E[6], E[7], E[8] = c * x * z + s * y, c * y * z - s * x, 1.0 - c * (x * x + y * y)


@kernel
def advance(P, R, A, E, h, out):
    """Set out = F P^T, (15, 15). Applied twice, it gives F P F^T."""
    for i in range(15):
        n = 15 * i
        for k in range(3):
            v, turned = P[n + 3 + k], -h * P[n + 9 + k]
            new = v - h * (R[k, 0] * P[n + 12] + R[k, 1] * P[n + 13] + R[k, 2] * P[n + 14])
            for j in range(3):
                new += A[3 * k + j] * P[n + 6 + j]
                turned += E[3 * k + j] * P[n + 6 + j]
            out[15 * k + i] = P[n + k] + 0.5 * h * (v + new)
            out[15 * (3 + k) + i] = new
            out[15 * (6 + k) + i] = turned
            out[15 * (9 + k) + i] = P[n + 9 + k]
            out[15 * (12 + k) + i] = P[n + 12 + k]


@kernel
def add_noise(P, h, var_push, var_turn, var_gyro_walk, var_accelerometer_walk):
    """Add the noise of an interval: variances of the increments of velocity and attitude, and of the biases' steps."""
    diagonal = P[::16]
    diagonal[:3] += 0.25 * h * h * var_push
    P[3:48:16] += 0.5 * h * var_push  # of position and velocity
    P[45:90:16] += 0.5 * h * var_push
    diagonal[3:6] += var_push
    diagonal[6:9] += var_turn
    diagonal[9:12] += var_gyro_walk
    diagonal[12:] += var_accelerometer_walk


@kernel
def correct(P, H, innovation, variance, column, correction) -> float:
    """Update P with one scalar measurement of row H (15,), and set the correction (15,) of the state.

    Independent measurements may be taken one after the other, so that no matrix is inverted. With the optimal gain
    P H^T / S the update is P - P H^T H P / S, and P stays symmetric. Returns the normalised innovation squared.
    """
    S = variance
    for i in range(15):
        total = 0.0
        for j in range(15):
            total += P[15 * i + j] * H[j]
        column[i] = total
        S += H[i] * total
    for i in range(15):
        correction[i] = column[i] * (innovation / S)
        for j in range(i, 15):
            mean = 0.5 * (P[15 * i + j] + P[15 * j + i]) - column[i] * column[j] / S
            P[15 * i + j] = mean
            P[15 * j + i] = mean
    return innovation * innovation / S


@kernel
def normalised_square(P, error, L, y) -> float:
    """error^T P^-1 error by Cholesky's factor, which is left in L; y (15,) is scratch. NaN if P is not positive
    definite."""
    result = 0.0
    for i in range(15):
        rest = error[i]
        for j in range(i + 1):
            total = P[15 * i + j]
            for k in range(j):
                total -= L[15 * i + k] * L[15 * j + k]
            if i == j:
                L[16 * i] = math.sqrt(total)
            else:
                L[15 * i + j] = total / L[16 * j]
                rest -= L[15 * i + j] * y[j]
        y[i] = rest / L[16 * i]
        result += y[i] * y[i]
    return result
