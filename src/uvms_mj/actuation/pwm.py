"""Pulse widths from outside, such as the outputs of an autopilot or of a joystick's mixer."""

from __future__ import annotations  # so that help(Pwm) shows short type names

import dataclasses
import sys
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..errors import Fault, InputError
from ..physics.kernels import kernel
from .base import Actuation
from .curve import interpolated, interval
from .propeller import Propeller
from .t200 import NEUTRAL_US, PULSE_WIDTHS_US

LEAST_US, GREATEST_US = float(PULSE_WIDTHS_US[0]), float(PULSE_WIDTHS_US[-1])
_LARGEST = sys.float_info.max


@kernel
def thrust_of(command, thrust, state, k) -> float:
    """The thrust that the curve gives for the pulse width of thruster k [N]."""
    pulse = state.pwm_cmd[k]
    if not abs(pulse) <= _LARGEST:  # the run stops
        return pulse
    i = interval(command, pulse, int(state.near[k]))
    state.near[k] = i
    return interpolated(command, thrust, i, pulse)


@dataclasses.dataclass(frozen=True)
class Pwm(Actuation):
    """Pulse widths from outside: the caller of a Simulation sets pwm_cmd. Each thruster's curve makes thrust of it."""

    name = "pwm"
    by_caller: ClassVar[str] = "pwm_cmd"
    states: ClassVar = {"pwm_cmd": "thrusters"}
    memory: ClassVar[Mapping[str, Any]] = {"near": "thrusters"}
    start_values: ClassVar = {"pwm_cmd": NEUTRAL_US}
    units: ClassVar = {"pwm_cmd": "us"}

    def constants(self, setup: Any) -> Mapping[str, Any]:
        """The curve: that of the thrusters, so that their inverse gives the pulse width back."""
        thrusters = setup.scenario.thrusters
        true, assumed = thrusters.curves() if isinstance(thrusters, Propeller) else (None, None)
        if true is None or assumed is None:
            wrong = "pwm needs thrusters.name = t200, or general with a curve of pulse widths that is inverted"
            raise InputError([Fault("actuation.name", wrong)], "scenario")
        if not assumed.same_as(true):
            wrong = "with actuation.name = pwm nothing is assumed: the pulse width is given; leave it out"
            raise InputError([Fault("thrusters.assumed_voltage", wrong)], "scenario")
        if true.at(np.array([NEUTRAL_US]))[0] != 0.0 or true.command[0] < 0.0:
            wrong = f"is not a curve of pulse widths: with actuation.name = pwm, {NEUTRAL_US:g} us must give no thrust"
            raise InputError([Fault("thrusters.curve_command", wrong)], "scenario")
        return {"command": true.command, "thrust": thrusters.assumed_efficiency * true.thrust}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        for k in range(u.shape[0]):
            u[k] = thrust_of(settings.command, settings.thrust, state, k)
