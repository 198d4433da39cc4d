"""The computation delay of a law as a stage behind it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ..stages.base import Room, Stage
from ..stages.signals import CLOCK, WRENCH_COMMAND
from .theory.sampled import MOST_WAITING


@dataclass(frozen=True)
class Delay(Stage):
    """The computation delay: the command of the law's instant t_k reaches the actuation at t_k + controller.delay.
    Before the first one it is zero."""

    name = "delay"
    memory: ClassVar = {"queue": 6 * (MOST_WAITING + 1)}
    room: ClassVar[Room] = Room("control", "delay", lambda thrusters: (*CLOCK, WRENCH_COMMAND), (WRENCH_COMMAND,))

    @staticmethod
    def steps(scenario: Any) -> tuple[int, int, int]:
        """Time steps of the control period, of the delay, and of their greatest common divisor, the stage's period."""
        h = scenario.simulation.timestep
        period, delay = round(scenario.control_period / h), round(scenario.controller.delay / h)
        return period, delay, math.gcd(period, delay)

    def constants(self, setup: Any) -> Mapping[str, Any]:
        """The control period and the delay in periods of the stage."""
        period, delay, own = self.steps(setup.scenario)
        return {"control": period / own, "delay": delay / own}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        queue, control, delay = state.queue, int(settings.control), int(settings.delay)
        if given.instant % control == 0:
            last = 6 * ((given.instant // control) % (MOST_WAITING + 1))
            for i in range(6):
                queue[last + i] = given.tau_cmd[i]
        if given.instant < delay:
            for i in range(6):
                out[i] = 0.0
        else:
            due = 6 * (((given.instant - delay) // control) % (MOST_WAITING + 1))
            for i in range(6):
                out[i] = queue[due + i]
