"""The computation delay of a law as a stage behind it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ..errors import Fault
from ..stages.base import Room, Stage
from ..stages.signals import CLOCK, WRENCH_COMMAND

MOST_WAITING = 1000
"""Control periods that a computation delay may last."""


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
        queue = state.queue.reshape(MOST_WAITING + 1, 6)
        control, delay = int(settings.control), int(settings.delay)
        if given.instant % control == 0:
            queue[given.instant // control % (MOST_WAITING + 1)] = given.tau_cmd
        if given.instant < delay:
            out[:] = 0.0
        else:
            out[:] = queue[(given.instant - delay) // control % (MOST_WAITING + 1)]


def delay_faults(scenario: Any) -> Iterator[Fault]:
    """Errors in the computation delay: it is a multiple of the time step, and not too many control periods long."""
    h, delay = scenario.simulation.timestep, scenario.controller.delay
    if delay is None:
        return
    if abs(delay / h - round(delay / h)) > 1e-6:
        n = int(delay / h)
        nearest = f"the nearest are {n * h:g} and {(n + 1) * h:g} s"
        yield Fault("controller.delay", f"{delay:g} s is not a multiple of the time step {h:g} s; {nearest}")
    elif delay > MOST_WAITING * scenario.control_period * (1.0 + 1e-9):
        longest = f"{MOST_WAITING} control periods of {scenario.control_period:g} s"
        yield Fault(
            "controller.delay", f"{delay:g} s must be at most {MOST_WAITING * scenario.control_period:g} s, {longest}"
        )
