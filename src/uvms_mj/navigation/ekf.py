"""An error-state Kalman filter of inertial unit, DVL, pressure, heading and a position fix, with its own sensors.

The stage simulates the sensors from the truth and runs the filter on them (:mod:`.aided` has the steps). The inertial
unit decides the filter's rate. Between its samples the estimate of pose and velocity is held. Force and moment of the
contact are measured in B by channels (:mod:`.channel`), by default perfectly at every time step.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from ..errors import Fault
from ..physics.frames import to_world
from ..quantities import NonNegative, Positive, Step
from ..stages.base import setting
from .aided import begin, depth_fix, due, estimation_error, heading_fix, position_fix, predict, publish, velocity_fix
from .base import Navigation
from .channel import MEMORY, measure
from .error_state import normalised_square
from .sensors import channel_faults, channel_of, channel_settings

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
