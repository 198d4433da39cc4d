r"""An error-state Kalman filter of inertial unit, DVL, pressure, heading and a position fix, with its own sensors.

Strapdown inertial navigation: increments of velocity and attitude, and quaternions.

An inertial unit that integrates its rates on board and compensates coning and sculling gives, for each sample, the
rotation vector from B at the last sample to B at this one, and the integral of the specific force in B at the last
sample. Both follow from the attitudes and velocities at the two instants exactly, so that the errors of such a unit are
its noise and its biases alone.

Covariance of the error state of inertial navigation, 15 states.

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

The steps of the aided inertial filter: its sensors, simulated from the truth, prediction and corrections.

The kernels work on the settings and the state of :class:`uvms_mj.navigation.ekf.Ekf`. ``out`` has the estimated
attitude. The filter takes each standard deviation for ``assumed_noise`` times the true one. A correction is applied to
the estimate at once, so that the error state is zero again; the covariance's change of frame by half the corrected
angle is left out, as usual (Sola, sec. 6.3).

An error-state Kalman filter of inertial unit, DVL, pressure, heading and a position fix, with its own sensors.

The stage simulates the sensors from the truth and runs the filter on them. The inertial
unit decides the filter's rate. Between its samples the estimate of pose and velocity is held. Force and moment of the
contact are measured in B by channels (:mod:`.channel`), by default perfectly at every time step.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np

from ..errors import Fault
from ..physics.frames import multiply, rotation, to_body, to_world
from ..physics.kernels import kernel
from ..physics.random import standard_normal
from ..quantities import NonNegative, Positive, Step
from ..stages.base import setting
from .base import Navigation
from .channel import MEMORY, measure
from .sensors import channel_faults, channel_of, channel_settings


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


_AIDS = ("dvl", "depth", "heading", "position")
_FORCE = ("force", "moment")
_SETTINGS = list(channel_settings(*_FORCE))
_ForceSensor: Any = dataclasses.make_dataclass("_ForceSensor", _SETTINGS, bases=(Navigation,), frozen=True)


@dataclasses.dataclass(frozen=True)
class Ekf(_ForceSensor):
    """Error-state Kalman filter of inertial unit, DVL, pressure, heading and position fix, with their errors."""

    imu_period: Step = setting(0.005, "s", "time between samples of the inertial unit")
    gyro_noise: Positive = setting(0.0012, "rad/s", "standard deviation of a sample of the angular velocity")
    accelerometer_noise: Positive = setting(0.0028, "m/s^2", "standard deviation of a sample of the specific force")
    gyro_bias: Positive = setting(1e-3, "rad/s", "standard deviation of the gyro's bias at the start")
    accelerometer_bias: Positive = setting(0.02, "m/s^2", "standard deviation of the accelerometer's bias at the start")
    gyro_walk: Positive = setting(1e-5, "rad/s^1.5", "random walk of the gyro's bias")
    accelerometer_walk: Positive = setting(1e-4, "m/s^2.5", "random walk of the accelerometer's bias")
    dvl_period: NonNegative = setting(0.2, "s", "time between velocities of the DVL, in B; 0: no DVL")
    dvl_noise: Positive = setting(0.0015, "m/s", "standard deviation of each component of the DVL")
    depth_period: NonNegative = setting(0.2, "s", "time between depths from the pressure; 0: none")
    depth_noise: Positive = setting(5e-4, "m", "standard deviation of the depth")
    heading_period: NonNegative = setting(0.1, "s", "time between headings; 0: none")
    heading_noise: Positive = setting(0.01, "rad", "standard deviation of the heading")
    position_period: NonNegative = setting(0.2, "s", "time between position fixes in W; 0: none, the position drifts")
    position_noise: Positive = setting(0.01, "m", "standard deviation of each component of a fix")
    initial_position: Positive = setting(0.01, "m", "standard deviation of the first estimate's position")
    initial_velocity: Positive = setting(0.01, "m/s", "standard deviation of the first estimate's velocity")
    initial_attitude: Positive = setting(0.01, "rad", "standard deviation of the first estimate's attitude")
    assumed_noise: Positive = setting(1.0, "1", "what the filter takes all standard deviations for, over the true ones")

    name = "ekf"
    every_step: ClassVar = True
    states: ClassVar[Mapping[str, int]] = {
        **{"b_g": 3, "b_a": 3, "b_g_true": 3, "b_a_true": 3},
        **{"sigma_p": 3, "sigma_v": 3, "sigma_theta": 3, "sigma_b_g": 3, "sigma_b_a": 3},
        **{"nees": 1, "nis": 1},
    }
    units: ClassVar[Mapping[str, str]] = {
        **{"b_g": "rad/s", "b_a": "m/s^2", "b_g_true": "rad/s", "b_a_true": "m/s^2"},
        **{"sigma_p": "m", "sigma_v": "m/s", "sigma_theta": "rad", "sigma_b_g": "rad/s", "sigma_b_a": "m/s^2"},
        **{"nees": "1", "nis": "1"},
    }
    memory: ClassVar[Mapping[str, int]] = {
        **{"P": 225, "work": 225, "H": 15, "column": 15, "correction": 15, "A": 9, "E": 9},
        **{"p": 3, "v": 3, "quat": 4, "omega": 3, "turn": 3, "push": 3, "quat_before": 4, "v_before": 3},
        **{"squares": 1, "updates": 1, "force": MEMORY, "moment": MEMORY},
    }

    def constants(self, setup: Any) -> Mapping[str, Any]:
        """The settings with the rates in samples and instants, the packed channels of the force, and gravity."""
        numbers = {f.name: getattr(self, f.name) for f in dataclasses.fields(Ekf) if "period" not in f.name}
        numbers = {name: value for name, value in numbers.items() if name.partition("_")[0] not in _FORCE}
        step, h = self.period or setup.scenario.simulation.timestep, self.imu_period
        rates = {f"{aid}_samples": float(round(getattr(self, f"{aid}_period") / h)) for aid in _AIDS}
        rates |= {"imu_instants": float(round(h / step)), "interval": h}
        force = {quantity: channel_of(self, quantity).pack(step) for quantity in _FORCE}
        return {**numbers, **rates, **force, "gravity_W": setup.gravity_W}

    def faults(self, setup: Any) -> Iterator[Fault]:
        step, h = self.period or setup.scenario.simulation.timestep, self.imu_period
        yield from _odd("imu", h, step, "the period of this stage")
        for aid in _AIDS:
            yield from _odd(aid, getattr(self, f"{aid}_period"), h, "imu_period")
        yield from channel_faults(self, _FORCE, step)

    @property
    def force_timing(self) -> tuple[float | None, float]:
        force = channel_of(self, "force")
        return force.period, force.delay + 0.5 * force.jitter

    def rest_errors(self, setup: Any) -> str:
        return "the estimate of the Kalman filter fluctuates, and the vehicle with it"

    @staticmethod
    def step(settings, state, given, state_dot, out):
        instant, key, wrench = given.instant, given.key, out.tau_contact_m_B
        measure(settings.force, state.force, given.tau_springs_B, 0, instant, key, 8, wrench)
        measure(settings.moment, state.moment, given.tau_springs_B, 3, instant, key, 9, wrench)
        if instant % int(settings.imu_instants) != 0:
            to_world(out.R_WB, wrench, out.f_contact_m_W)
            return
        sample = instant // int(settings.imu_instants)
        if sample == 0:
            begin(settings, state, given, out)
        else:
            predict(settings, state, given, out)
        state.squares[0], state.updates[0] = 0.0, 0.0
        if due(sample, settings.dvl_samples):
            velocity_fix(settings, state, given, out)
        if due(sample, settings.depth_samples):
            depth_fix(settings, state, given, out)
        if due(sample, settings.heading_samples):
            heading_fix(settings, state, given, out)
        if due(sample, settings.position_samples):
            position_fix(settings, state, given, out)
        if state.updates[0] > 0.0:
            state.nis[0] = state.squares[0] / state.updates[0]
            estimation_error(state, given, state.correction)
            state.nees[0] = normalised_square(state.P, state.correction, state.work, state.column)
        publish(state, out)
        to_world(out.R_WB, wrench, out.f_contact_m_W)


def _odd(aid: str, period: float, of: float, called: str) -> Iterator[Fault]:
    """The error of a period that is not a multiple of another one [s]."""
    n = period / of
    if abs(n - round(n)) > 1e-6 or (period > 0.0 and round(n) < 1):
        yield Fault(f"navigation.{aid}_period", f"{period:g} s is not a multiple of {called}, {of:g} s")
