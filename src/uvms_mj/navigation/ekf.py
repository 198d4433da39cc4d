r"""An error-state Kalman filter of inertial unit, DVL, pressure, heading and a position fix, with its own sensors.

The stage simulates the sensors from the truth (:func:`sense`) and runs the filter on what they measured, without the
truth (:func:`estimate`). The inertial unit decides the filter's rate. Between its samples the estimate of pose and
velocity is held. Force and moment of the contact are measured in B by
channels (:mod:`.channel`), by default perfectly at every time step.

**Inertial unit.** One that integrates its rates on board and compensates coning and sculling gives, for each sample,
the rotation vector from B at the last sample to B at this one, and the integral of the specific force in B at the last
sample. Both follow from the attitudes and velocities at the two instants exactly, so that the errors of such a unit are
its noise and its biases alone.

**Covariance.** The error state of 15 numbers is :math:`\delta x = [\delta p_W, \delta v_W, \delta\theta, \delta b_g,
\delta b_a]`, truth minus estimate, with the attitude error as a rotation vector in B: :math:`R = \hat R\,
Exp(\delta\theta)` (Sola, "Quaternion kinematics for the error-state Kalman filter", arXiv:1711.02508, sec. 5; Fossen
(2021), sec. 14.4). Over an interval h with the increments of velocity and attitude, without their biases, dv and
dtheta,

.. math::

    \delta v' &= \delta v - \hat R [dv]_\times \delta\theta - h \hat R\, \delta b_a - \hat R\, n_a
        && \text{Sola, sec. 5.4.2}

    \delta p' &= \delta p + \tfrac{h}{2} (\delta v + \delta v'), \qquad
    \delta\theta' = Exp(d\theta)^\top \delta\theta - h\, \delta b_g - n_g

**Corrections.** The filter takes each standard deviation for ``assumed_noise`` times the true one. A correction is
applied to the estimate at once, so that the error state is zero again; the covariance's change of frame by half the
corrected angle is left out, as usual (Sola, sec. 6.3).

The kernels work on the settings and the state of :class:`Ekf`; ``out`` has the estimated attitude.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np

from ..errors import Fault
from ..physics.frames import multiply, rotation, skew, to_body, to_world
from ..physics.kernels import kernel
from ..physics.linear_algebra import cholesky, forward
from ..physics.random import standard_normal
from ..quantities import NonNegative, Positive, Step
from ..stages.base import setting
from ..stages.setup import SetupLike
from .base import Navigation
from .channel import MEMORY, measure
from .sensors import channel_faults, channel_of, channel_settings


@kernel
def turned(quat, phi, out):
    """Set out = quat * Exp(phi) (4,), of unit length: quat turned by a rotation vector (3,) in its own frame [rad]."""
    angle = math.sqrt(phi @ phi)
    scale = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    x, y, z = scale * phi
    multiply(quat, np.array([math.cos(0.5 * angle), x, y, z]), out)
    out /= math.sqrt(out @ out)


@kernel
def rotation_vector(start, end, out):
    """Set out (3,) [rad] so that end = start * Exp(out). Below 0.3 rad the relative error is below 1e-8."""
    w, v = start @ end, start[0] * end[1:] - end[0] * start[1:] - np.cross(start[1:], end[1:])  # conj(start) * end
    square = v @ v  # sin^2 of half the angle
    scale = 2.0 + square * (1.0 / 3.0 + square * (3.0 / 20.0 + square * 5.0 / 56.0))  # of the arcsine
    out[:] = v * (scale if w >= 0.0 else -scale)


@kernel
def increments(given, quat_before, v_before_W, gravity_W, interval, turn, push):
    """Set the true increments of an interval [s] that ends now: turn (3,) [rad], the rotation vector, and push (3,)
    [m/s], the integral of the specific force in B at the beginning. quat_before (4,) and v_before_W (3,) are the
    attitude and velocity there; they are set to the present ones."""
    v_W, R_before = given.R_WB @ given.nu[:3], np.zeros((3, 3))
    rotation_vector(quat_before, given.quat_WB, turn)
    rotation(quat_before, R_before)
    push[:] = R_before.T @ (v_W - v_before_W - interval * gravity_W)
    v_before_W[:], quat_before[:] = v_W, given.quat_WB


@kernel
def transition(R, push, turn, A, E):
    """Set the blocks of F, (3, 3) each: A = -R [push]x of dv' over dtheta, and E = Exp(turn)^T."""
    square = turn @ turn
    angle = math.sqrt(square)
    s, c = 1.0, 0.5
    if angle > 1e-6:
        s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    S = skew(turn)
    A[:] = -R @ skew(push)
    E[:] = np.eye(3) - s * S + c * (S @ S)


@kernel
def advance(P, R, A, E, h, out):
    """Set out = F P^T, (15, 15). Applied twice, it gives F P F^T."""
    for i in range(15):  # a column of the result is F times a row of P
        v, theta, b_g, b_a = P[i, 3:6], P[i, 6:9], P[i, 9:12], P[i, 12:]
        v_after = v + A @ theta - h * (R @ b_a)
        out[:3, i] = P[i, :3] + 0.5 * h * (v + v_after)
        out[3:6, i] = v_after
        out[6:9, i] = E @ theta - h * b_g
        out[9:, i] = P[i, 9:]


@kernel
def add_noise(P, h, var_push, var_turn, var_gyro_walk, var_accelerometer_walk):
    """Add the noise of an interval: variances of the increments of velocity and attitude, and of the biases' steps."""
    for i in range(3):
        P[i, i] += 0.25 * h * h * var_push
        P[i, 3 + i] += 0.5 * h * var_push
        P[3 + i, i] += 0.5 * h * var_push
        P[3 + i, 3 + i] += var_push
        P[6 + i, 6 + i] += var_turn
        P[9 + i, 9 + i] += var_gyro_walk
        P[12 + i, 12 + i] += var_accelerometer_walk


@kernel
def correct(P, H, innovation, variance, correction) -> float:
    """Update P with one scalar measurement of row H (15,), and set the correction (15,) of the state.

    Independent measurements may be taken one after the other, so that no matrix is inverted. With the optimal gain
    P H^T / S the update is P - P H^T H P / S, and P stays symmetric. Returns the normalised innovation squared.
    """
    column = P @ H
    S = variance + H @ column
    correction[:] = column * (innovation / S)
    for i in range(15):
        for j in range(i, 15):
            mean = 0.5 * (P[i, j] + P[j, i]) - column[i] * column[j] / S
            P[i, j], P[j, i] = mean, mean
    return innovation * innovation / S


@kernel
def normalised_square(P, error, L) -> float:
    """error^T P^-1 error by Cholesky's factor, which is left in L (15, 15). NaN if P is not positive definite."""
    y = error.copy()
    cholesky(P, L)
    forward(L, y)
    return y @ y


# first random number of an instant for each use; numbers from 64 on are of the force's channels
_IMU, _WALK, _DVL, _DEPTH, _HEADING, _POSITION, _START = 0, 6, 12, 15, 16, 17, 20
_LEVEL = 3e-4  # squared cosine of the pitch, 89 degrees, above which there is a heading


@kernel
def due(sample, samples) -> bool:
    """Whether a sensor measures at a sample of the inertial unit, for its period in such samples; 0 is never."""
    n = int(samples)
    return n > 0 and sample > 0 and sample % n == 0


@kernel
def first_sample(settings, state, given):
    """Draw the true biases and the error of the first estimate, from the covariance that the filter starts with, and
    the first sample of the gyro."""
    p, v, key = state.p, state.v, given.key
    to_world(given.R_WB, given.nu, state.v_before)
    for i in range(3):
        p[i] = given.p_WB[i] - settings.initial_position * standard_normal(key, 0, _START + i)
        v[i] = state.v_before[i] - settings.initial_velocity * standard_normal(key, 0, _START + 3 + i)
        state.correction[i] = -settings.initial_attitude * standard_normal(key, 0, _START + 6 + i)
        state.b_g_true[i] = settings.gyro_bias * standard_normal(key, 0, _START + 9 + i)
        state.b_a_true[i] = settings.accelerometer_bias * standard_normal(key, 0, _START + 12 + i)
        noise = settings.gyro_noise * standard_normal(key, 0, _IMU + i)
        state.omega[i] = given.nu[3 + i] + state.b_g_true[i] + noise
    turned(given.quat_WB, state.correction[:3], state.quat)
    state.quat_before[:] = given.quat_WB


@kernel
def measure_increments(settings, state, given):
    """Set turn and push to a sample of the inertial unit, and let the true biases walk."""
    h, key, instant = settings.interval, given.key, given.instant
    turn, push = state.turn, state.push
    increments(given, state.quat_before, state.v_before, settings.gravity_W, h, turn, push)
    for i in range(3):
        noise = settings.gyro_noise * standard_normal(key, instant, _IMU + i)
        turn[i] += h * (state.b_g_true[i] + noise)
        noise = settings.accelerometer_noise * standard_normal(key, instant, _IMU + 3 + i)
        push[i] += h * (state.b_a_true[i] + noise)
        step = math.sqrt(h) * standard_normal(key, instant, _WALK + i)
        state.b_g_true[i] += settings.gyro_walk * step
        step = math.sqrt(h) * standard_normal(key, instant, _WALK + 3 + i)
        state.b_a_true[i] += settings.accelerometer_walk * step


@kernel
def sense(settings, state, given, sample):
    """Set what the sensors measure at a sample of the inertial unit, from the truth: turn and push, dvl (3,) in B,
    depth by the pressure, which the waves have a part in, heading and fix (3,) in W, and which of the last four are
    new. The first sample has the first estimate."""
    key, instant, present, R = given.key, given.instant, state.present, given.R_WB
    present[:] = 0.0
    if sample == 0:
        first_sample(settings, state, given)
    else:
        measure_increments(settings, state, given)
    if due(sample, settings.dvl_samples):
        present[0] = 1.0
        for i in range(3):
            state.dvl[i] = given.nu[i] + settings.dvl_noise * standard_normal(key, instant, _DVL + i)
    if due(sample, settings.depth_samples):
        present[1] = 1.0
        state.depth[0] = given.p_WB[2] - given.wave_head + settings.depth_noise * standard_normal(key, instant, _DEPTH)
    if due(sample, settings.heading_samples) and R[:2, 0] @ R[:2, 0] >= _LEVEL:
        present[2] = 1.0
        noise = settings.heading_noise * standard_normal(key, instant, _HEADING)
        state.heading[0] = math.atan2(R[1, 0], R[0, 0]) + noise
    if due(sample, settings.position_samples):
        present[3] = 1.0
        for i in range(3):
            noise = settings.position_noise * standard_normal(key, instant, _POSITION + i)
            state.fix[i] = given.p_WB[i] + noise


@kernel
def begin(settings, state, out):
    """Set the covariance of a first estimate, whose biases are zero."""
    P, k = state.P, settings.assumed_noise * settings.assumed_noise
    P[:], state.b_g[:], state.b_a[:] = 0.0, 0.0, 0.0
    for i in range(3):
        P[i, i] = k * settings.initial_position * settings.initial_position
        P[3 + i, 3 + i] = k * settings.initial_velocity * settings.initial_velocity
        P[6 + i, 6 + i] = k * settings.initial_attitude * settings.initial_attitude
        P[9 + i, 9 + i] = k * settings.gyro_bias * settings.gyro_bias
        P[12 + i, 12 + i] = k * settings.accelerometer_bias * settings.accelerometer_bias
    rotation(state.quat, out.R_WB)


@kernel
def predict(settings, state, h, out):
    """Take the estimate and its covariance over the interval h [s] of a sample of the inertial unit."""
    R, p, v = out.R_WB, state.p, state.v
    turn, push = state.turn - h * state.b_g, state.push - h * state.b_a
    transition(R, push, turn, state.A, state.E)
    advance(state.P, R, state.A, state.E, h, state.work)
    advance(state.work, R, state.A, state.E, h, state.P)
    k = settings.assumed_noise * settings.assumed_noise
    a, g = settings.accelerometer_noise * h, settings.gyro_noise * h
    w, u = settings.gyro_walk, settings.accelerometer_walk
    add_noise(state.P, h, k * a * a, k * g * g, k * h * w * w, k * h * u * u)
    v_after = v + R @ push + h * settings.gravity_W
    p += 0.5 * h * (v + v_after)
    v[:] = v_after
    state.omega[:] = turn / h
    turned(state.quat.copy(), turn, state.quat)
    rotation(state.quat, R)


@kernel
def apply(state, innovation, sigma, out):
    """Correct the estimate by a scalar measurement of row H with a standard deviation, and clear H."""
    change = state.correction
    state.squares[0] += correct(state.P, state.H, innovation, sigma * sigma, change)
    state.updates[0] += 1.0
    state.p += change[:3]
    state.v += change[3:6]
    state.b_g += change[9:12]
    state.omega -= change[9:12]
    state.b_a += change[12:]
    turned(state.quat.copy(), change[6:9], state.quat)
    rotation(state.quat, out.R_WB)
    state.H[:] = 0.0


@kernel
def velocity_fix(settings, state, out):
    """The DVL: velocity in B. R^T v changes by R^T dv + [R^T v]x dtheta."""
    H, R, sigma = state.H, out.R_WB, settings.assumed_noise * settings.dvl_noise
    for i in range(3):
        v = R.T @ state.v
        H[3:6] = R[:, i]
        next_axis, last_axis = (i + 1) % 3, (i + 2) % 3
        H[6 + next_axis], H[6 + last_axis] = -v[last_axis], v[next_axis]
        apply(state, state.dvl[i] - v[i], sigma, out)


@kernel
def depth_fix(settings, state, out):
    """The depth from the pressure: z of W."""
    state.H[2] = 1.0
    apply(state, state.depth[0] - state.p[2], settings.assumed_noise * settings.depth_noise, out)


@kernel
def heading_fix(settings, state, out):
    """The heading, the angle of x of B in the horizontal plane. The innovation is the sine of the difference, which
    does not jump. Without an effect above 89 degrees of estimated pitch, where there is no heading."""
    H, R, heading = state.H, out.R_WB, state.heading[0]
    square = R[:2, 0] @ R[:2, 0]
    if square < _LEVEL:
        return
    H[7] = (R[1, 0] * R[0, 2] - R[0, 0] * R[1, 2]) / square
    H[8] = (R[0, 0] * R[1, 1] - R[1, 0] * R[0, 1]) / square
    innovation = (R[0, 0] * math.sin(heading) - R[1, 0] * math.cos(heading)) / math.sqrt(square)
    apply(state, innovation, settings.assumed_noise * settings.heading_noise, out)


@kernel
def position_fix(settings, state, out):
    """The position in W."""
    for i in range(3):
        state.H[i] = 1.0
        apply(state, state.fix[i] - state.p[i], settings.assumed_noise * settings.position_noise, out)


@kernel
def estimate(settings, state, first, interval, out):
    """Run the filter on a sample of the sensors, without the truth. ``first`` is whether it has the first estimate;
    otherwise ``interval`` is the time since the last one [s], where 0 is a sample without the inertial unit."""
    if first:
        begin(settings, state, out)
    elif interval > 0.0:
        predict(settings, state, interval, out)
    state.squares[0], state.updates[0] = 0.0, 0.0
    if state.present[0] > 0.0:
        velocity_fix(settings, state, out)
    if state.present[1] > 0.0:
        depth_fix(settings, state, out)
    if state.present[2] > 0.0:
        heading_fix(settings, state, out)
    if state.present[3] > 0.0:
        position_fix(settings, state, out)
    publish(state, out)


@kernel
def estimation_error(state, given, error):
    """Set the error state (15,), truth minus estimate."""
    rotation_vector(state.quat, given.quat_WB, error[6:9])
    error[:3], error[3:6] = given.p_WB - state.p, given.R_WB @ given.nu[:3] - state.v
    error[9:12], error[12:] = state.b_g_true - state.b_g, state.b_a_true - state.b_a


@kernel
def publish(state, out):
    """Set the measured pose and velocity to the estimate, and the recorded standard deviations."""
    to_body(out.R_WB, state.v, out.nu)
    out.p_WB[:], out.quat_WB[:], out.nu[3:] = state.p, state.quat, state.omega
    sigma = np.sqrt(np.diag(state.P))
    state.sigma_p[:], state.sigma_v[:], state.sigma_theta[:] = sigma[:3], sigma[3:6], sigma[6:9]
    state.sigma_b_g[:], state.sigma_b_a[:] = sigma[9:12], sigma[12:]


@kernel
def estimate_alone(settings, state, given, state_dot, out):
    """The part of :meth:`Ekf.step` that a vehicle's own control system has: the estimate of what its sensors measured,
    without the truth. ``given`` has the flags ``start``, ``inertial`` and ``present`` (4,) of what is new, and the
    interval of the inertial unit [s]; ``state`` is :data:`ALONE` of the stage's, with the samples in it."""
    state.present[:] = given.present
    first, inertial = given.start > 0.0, given.inertial > 0.0
    if first or inertial or np.any(given.present > 0.0):
        estimate(settings, state, first, given.interval if inertial else 0.0, out)


def estimate_with_force(settings, state, given, state_dot, out):
    """As :func:`estimate_alone`, with the contact force that is measured in B, in W with the estimated attitude."""
    estimate_alone(settings, state, given, state_dot, out)
    to_world(out.R_WB, out.tau_contact_m_B, out.f_contact_m_W)


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
    assumed_noise: Positive = setting(1.0, "1", "standard deviations in the filter over the true ones")

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
    memory: ClassVar[Mapping[str, Any]] = {
        **{"P": (15, 15), "work": (15, 15), "H": 15, "correction": 15, "A": (3, 3), "E": (3, 3)},
        **{"p": 3, "v": 3, "quat": 4, "omega": 3, "turn": 3, "push": 3, "quat_before": 4, "v_before": 3},
        **{"dvl": 3, "depth": 1, "heading": 1, "fix": 3, "present": 4},
        **{"squares": 1, "updates": 1, "force": MEMORY, "moment": MEMORY},
    }

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The settings with the rates in samples and instants, the packed channels of the force, and gravity."""
        numbers = {f.name: getattr(self, f.name) for f in dataclasses.fields(Ekf) if "period" not in f.name}
        numbers = {name: value for name, value in numbers.items() if name.partition("_")[0] not in _FORCE}
        step, h = self.period or setup.scenario.simulation.timestep, self.imu_period
        rates = {f"{aid}_samples": float(round(getattr(self, f"{aid}_period") / h)) for aid in _AIDS}
        rates |= {"imu_instants": float(round(h / step)), "interval": h}
        force = {quantity: channel_of(self, quantity).pack(step) for quantity in _FORCE}
        return {**numbers, **rates, **force, "gravity_W": setup.gravity_W}

    def faults(self, setup: SetupLike) -> Iterator[Fault]:
        step, h = self.period or setup.scenario.simulation.timestep, self.imu_period
        yield from _odd("imu", h, step, "the period of this stage")
        for aid in _AIDS:
            yield from _odd(aid, getattr(self, f"{aid}_period"), h, "imu_period")
        yield from channel_faults(self, _FORCE, step)

    @property
    def force_timing(self) -> tuple[float | None, float]:
        force = channel_of(self, "force")
        return force.period, force.delay + 0.5 * force.jitter

    def rest_errors(self, setup: SetupLike) -> str:
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
        sense(settings, state, given, sample)
        estimate(settings, state, sample == 0, settings.interval, out)
        if state.updates[0] > 0.0:
            state.nis[0] = state.squares[0] / state.updates[0]
            estimation_error(state, given, state.correction)
            state.nees[0] = normalised_square(state.P, state.correction, state.work)
        to_world(out.R_WB, wrench, out.f_contact_m_W)


KEPT = ("P", "p", "v", "quat", "omega", "b_g", "b_a")
"""The part of the stage's state that the filter keeps from one sample to the next."""
SAMPLED = ("turn", "push", "dvl", "depth", "heading", "fix", "present")
"""The sensors' measurements in the stage's state."""
_WORKED = ("work", "H", "correction", "A", "E", "squares", "updates")
_SPREAD = ("sigma_p", "sigma_v", "sigma_theta", "sigma_b_g", "sigma_b_a")
ALONE = (*KEPT, *SAMPLED, *_WORKED, *_SPREAD)
"""The part of the stage's state of which :func:`estimate` knows."""


def _odd(aid: str, period: float, of: float, called: str) -> Iterator[Fault]:
    """The error of a period that is not a multiple of another one [s]."""
    n = period / of
    if abs(n - round(n)) > 1e-6 or (period > 0.0 and round(n) < 1):
        yield Fault(f"navigation.{aid}_period", f"{period:g} s is not a multiple of {called}, {of:g} s")
