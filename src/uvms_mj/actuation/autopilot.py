"""Pulse widths of an autopilot, with the number of the frame that they came in."""

import dataclasses
from typing import ClassVar

from .pwm import NEUTRAL_US, Pwm, thrust_of


@dataclasses.dataclass(frozen=True)
class Autopilot(Pwm):
    """Pulse widths of an autopilot, which ``uvms-mj sitl`` exchanges: each thruster's curve makes thrust of it."""

    name = "autopilot"
    states: ClassVar = {"pwm_cmd": "thrusters", "frame": 1}
    start_values: ClassVar = {"pwm_cmd": NEUTRAL_US}
    units: ClassVar = {"pwm_cmd": "us", "frame": "1"}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        for k in range(u.shape[0]):
            u[k] = thrust_of(settings.command, settings.thrust, state, k)
