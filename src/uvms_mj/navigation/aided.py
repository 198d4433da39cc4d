"""The steps of the aided inertial filter: its sensors, simulated from the truth, prediction and corrections.

The kernels work on the settings and the state of :class:`uvms_mj.navigation.ekf.Ekf`. ``out`` has the estimated
attitude. The filter takes each standard deviation for ``assumed_noise`` times the true one. A correction is applied to
the estimate at once, so that the error state is zero again; the covariance's change of frame by half the corrected
angle is left out, as usual (Sola, sec. 6.3).
"""

import math

import numpy as np

from ..physics.frames import rotation, to_body, to_world
from ..physics.kernels import kernel
from ..physics.random import standard_normal
from .error_state import add_noise, advance, correct, transition
from .strapdown import increments, rotation_vector, turned

# first random number of an instant for each use; those from 64 on are of the force's channels
_IMU, _WALK, _DVL, _DEPTH, _HEADING, _POSITION, _START = 0, 6, 12, 15, 16, 17, 20


@kernel
def due(sample, samples) -> bool:
    """Whether a sensor measures at a sample of the inertial unit, for its period in such samples; 0 is never."""
    n = int(samples)
    return n > 0 and sample > 0 and sample % n == 0


@kernel
def begin(settings, state, given, out):
    """Draw the true biases and the error of the first estimate, from the covariance that the filter starts with."""
    P, p, v, key, k = state.P, state.p, state.v, given.key, settings.assumed_noise * settings.assumed_noise
    to_world(given.R_WB, given.nu, state.v_before)
    for i in range(3):
        p[i] = given.p_WB[i] - settings.initial_position * standard_normal(key, 0, _START + i)
        v[i] = state.v_before[i] - settings.initial_velocity * standard_normal(key, 0, _START + 3 + i)
        state.correction[i] = -settings.initial_attitude * standard_normal(key, 0, _START + 6 + i)
        state.b_g_true[i] = settings.gyro_bias * standard_normal(key, 0, _START + 9 + i)
        state.b_a_true[i] = settings.accelerometer_bias * standard_normal(key, 0, _START + 12 + i)
        noise = settings.gyro_noise * standard_normal(key, 0, _IMU + i)
        state.omega[i] = given.nu[3 + i] + state.b_g_true[i] + noise
        P[16 * i] = k * settings.initial_position * settings.initial_position
        P[16 * (3 + i)] = k * settings.initial_velocity * settings.initial_velocity
        P[16 * (6 + i)] = k * settings.initial_attitude * settings.initial_attitude
        P[16 * (9 + i)] = k * settings.gyro_bias * settings.gyro_bias
        P[16 * (12 + i)] = k * settings.accelerometer_bias * settings.accelerometer_bias
    turned(given.quat_WB, state.correction[0], state.correction[1], state.correction[2], state.quat)
    state.quat_before[:] = given.quat_WB
    rotation(state.quat, out.R_WB)


@kernel
def measure_increments(settings, state, given):
    """Set turn and push to a sample of the inertial unit less the estimated biases, and let the true biases walk."""
    h, key, instant = settings.interval, given.key, given.instant
    turn, push = state.turn, state.push
    increments(given, state.quat_before, state.v_before, settings.gravity_W, h, turn, push)
    for i in range(3):
        noise = settings.gyro_noise * standard_normal(key, instant, _IMU + i)
        turn[i] += h * (state.b_g_true[i] - state.b_g[i] + noise)
        noise = settings.accelerometer_noise * standard_normal(key, instant, _IMU + 3 + i)
        push[i] += h * (state.b_a_true[i] - state.b_a[i] + noise)
        step = math.sqrt(h) * standard_normal(key, instant, _WALK + i)
        state.b_g_true[i] += settings.gyro_walk * step
        step = math.sqrt(h) * standard_normal(key, instant, _WALK + 3 + i)
        state.b_a_true[i] += settings.accelerometer_walk * step


@kernel
def predict(settings, state, given, out):
    """Take the estimate and its covariance over the interval of a sample of the inertial unit."""
    measure_increments(settings, state, given)
    h, R, turn, push, p, v = settings.interval, out.R_WB, state.turn, state.push, state.p, state.v
    transition(R, push, turn, h, state.A, state.E)
    advance(state.P, R, state.A, state.E, h, state.work)
    advance(state.work, R, state.A, state.E, h, state.P)
    k = settings.assumed_noise * settings.assumed_noise
    a, g = settings.accelerometer_noise * h, settings.gyro_noise * h
    w, u = settings.gyro_walk, settings.accelerometer_walk
    add_noise(state.P, h, k * a * a, k * g * g, k * h * w * w, k * h * u * u)
    for i in range(3):
        new = v[i] + R[i, 0] * push[0] + R[i, 1] * push[1] + R[i, 2] * push[2] + h * settings.gravity_W[i]
        p[i] += 0.5 * h * (v[i] + new)
        v[i] = new
    state.omega[:] = turn / h
    turned(state.quat.copy(), turn[0], turn[1], turn[2], state.quat)
    rotation(state.quat, R)


@kernel
def apply(state, innovation, sigma, out):
    """Correct the estimate by a scalar measurement of row H with a standard deviation, and clear H."""
    change = state.correction
    state.squares[0] += correct(state.P, state.H, innovation, sigma * sigma, state.column, change)
    state.updates[0] += 1.0
    state.p += change[:3]
    state.v += change[3:6]
    state.b_g += change[9:12]
    state.omega -= change[9:12]
    state.b_a += change[12:]
    turned(state.quat.copy(), change[6], change[7], change[8], state.quat)
    rotation(state.quat, out.R_WB)
    state.H[:] = 0.0


@kernel
def velocity_fix(settings, state, given, out):
    """The DVL: velocity in B. R^T v changes by R^T dv + [R^T v]x dtheta."""
    H, R, sigma = state.H, out.R_WB, settings.assumed_noise * settings.dvl_noise
    for i in range(3):
        v = np.zeros(3)
        to_body(R, state.v, v)
        measured = given.nu[i] + settings.dvl_noise * standard_normal(given.key, given.instant, _DVL + i)
        H[3:6] = R[:, i]
        next_axis, last_axis = (i + 1) % 3, (i + 2) % 3
        H[6 + next_axis], H[6 + last_axis] = -v[last_axis], v[next_axis]
        apply(state, measured - v[i], sigma, out)


@kernel
def depth_fix(settings, state, given, out):
    """The depth from the pressure: z of W."""
    measured = given.p_WB[2] + settings.depth_noise * standard_normal(given.key, given.instant, _DEPTH)
    state.H[2] = 1.0
    apply(state, measured - state.p[2], settings.assumed_noise * settings.depth_noise, out)


@kernel
def heading_fix(settings, state, given, out):
    """The heading, the angle of x of B in the horizontal plane. The innovation is the sine of the difference, which
    does not jump. Without an effect above 89 degrees of pitch, where there is no heading."""
    H, R, true = state.H, out.R_WB, given.R_WB
    square = R[0, 0] * R[0, 0] + R[1, 0] * R[1, 0]
    true_square = true[0, 0] * true[0, 0] + true[1, 0] * true[1, 0]
    if min(square, true_square) < 3e-4:
        return
    noise = settings.heading_noise * standard_normal(given.key, given.instant, _HEADING)
    scale = math.sqrt(square * true_square)
    sine = (R[0, 0] * true[1, 0] - R[1, 0] * true[0, 0]) / scale
    cosine = (R[0, 0] * true[0, 0] + R[1, 0] * true[1, 0]) / scale
    H[7] = (R[1, 0] * R[0, 2] - R[0, 0] * R[1, 2]) / square
    H[8] = (R[0, 0] * R[1, 1] - R[1, 0] * R[0, 1]) / square
    innovation = sine * math.cos(noise) + cosine * math.sin(noise)
    apply(state, innovation, settings.assumed_noise * settings.heading_noise, out)


@kernel
def position_fix(settings, state, given, out):
    """The position in W."""
    for i in range(3):
        noise = settings.position_noise * standard_normal(given.key, given.instant, _POSITION + i)
        state.H[i] = 1.0
        apply(state, given.p_WB[i] + noise - state.p[i], settings.assumed_noise * settings.position_noise, out)


@kernel
def estimation_error(state, given, error):
    """Set the error state (15,), truth minus estimate."""
    v, phi = np.zeros(3), np.zeros(3)
    to_world(given.R_WB, given.nu, v)
    rotation_vector(state.quat, given.quat_WB, phi)
    error[:3], error[3:6], error[6:9] = given.p_WB - state.p, v - state.v, phi
    error[9:12], error[12:] = state.b_g_true - state.b_g, state.b_a_true - state.b_a


@kernel
def publish(state, out):
    """Set the measured pose and velocity to the estimate, and the recorded standard deviations."""
    to_body(out.R_WB, state.v, out.nu)
    out.p_WB[:], out.quat_WB[:], out.nu[3:] = state.p, state.quat, state.omega
    sigma = np.sqrt(state.P[::16])  # of the diagonal
    state.sigma_p[:], state.sigma_v[:], state.sigma_theta[:] = sigma[:3], sigma[3:6], sigma[6:9]
    state.sigma_b_g[:], state.sigma_b_a[:] = sigma[9:12], sigma[12:]
