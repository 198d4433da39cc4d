"""Stages that no scenario chooses by name: tracking errors with estimates, the truth for the ideal law, the computation
delay, and the inflow of real thrusters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ...control.model import coefficients, model_wrenches, reveal
from ...control.task import tracking_errors
from ...control.theory.sampled import MOST_WAITING
from ...stages.base import Room, Stage
from ...stages.signals import CLOCK, ERRORS, ESTIMATES, MEASURED, REFERENCE, TRUE, TRUTH, WRENCH_COMMAND, Signal


@dataclass(frozen=True)
class Tracking(Stage):
    """Tracking errors and estimates."""

    name = "tracking"
    room: ClassVar[Room] = Room(
        "control", "tracking", lambda thrusters: CLOCK + MEASURED + REFERENCE, ERRORS + ESTIMATES
    )

    def constants(self, setup: Any) -> Mapping[str, Any]:
        estimated = coefficients(setup.nominal, setup.gravity_W, setup.scenario.estimates)
        return {**estimated, "M_hat": setup.design.M_hat}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        tracking_errors(given, out)
        for i in range(6):
            for j in range(6):
                out.M_hat[i, j] = settings.M_hat[i, j]
        model_wrenches(settings, given.nu, given.R_WB, out.C_hat_nu, out.D_hat_nu, out.g_hat)


@dataclass(frozen=True)
class Sensed(Stage):
    """The measured pose and velocity, without the force, which an observer sets in place of a force sensor."""

    name = "sensed"
    room: ClassVar[Room] = Room("navigation", "sensed", lambda thrusters: CLOCK + MEASURED, MEASURED[:4])

    @staticmethod
    def step(settings, state, given, state_dot, out):
        for i in range(3):
            out.p_WB[i] = given.p_WB[i]
            for j in range(3):
                out.R_WB[i, j] = given.R_WB[i, j]
        for i in range(4):
            out.quat_WB[i] = given.quat_WB[i]
        for i in range(6):
            out.nu[i] = given.nu[i]


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


@dataclass(frozen=True)
class Truth(Stage):
    """The truth for the ideal law. ``state`` is the record of the run."""

    name = "truth"
    room: ClassVar[Room] = Room("navigation", "truth", lambda thrusters: CLOCK + TRUE, TRUTH)

    def constants(self, setup: Any) -> Mapping[str, Any]:
        return {**coefficients(setup.vehicle, setup.gravity_W), "M": setup.design.M}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        for i in range(6):
            for j in range(6):
                out.M[i, j] = settings.M[i, j]
        reveal(settings, state.plant.water, given, out, out.g_eta)


@dataclass(frozen=True)
class Inflow(Stage):
    """The speed of advance of each thruster, a_k^T (v_r + omega x r_k) = B_k^T nu_r, for its axis a_k and its column
    B_k = [a_k; r_k x a_k] of B. It is zero for a pair that produces a pure moment."""

    name = "inflow"
    room: ClassVar[Room] = Room(
        "actuation", "inflow", lambda thrusters: CLOCK + TRUE, (Signal("inflow", (0,), "m/s", "-", "speed of advance"),)
    )

    def constants(self, setup: Any) -> Mapping[str, Any]:
        B = setup.vehicle.B
        return {"columns": (B * B[:3].any(axis=0)).T}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        R, nu, v_c, columns = given.R_WB, given.nu, given.v_c_W, settings.columns
        u = nu[0] - (R[0, 0] * v_c[0] + R[1, 0] * v_c[1] + R[2, 0] * v_c[2])
        v = nu[1] - (R[0, 1] * v_c[0] + R[1, 1] * v_c[1] + R[2, 1] * v_c[2])
        w = nu[2] - (R[0, 2] * v_c[0] + R[1, 2] * v_c[1] + R[2, 2] * v_c[2])
        p, q, r = nu[3], nu[4], nu[5]
        for k in range(out.shape[0]):
            linear = columns[k, 0] * u + columns[k, 1] * v + columns[k, 2] * w
            out[k] = linear + (columns[k, 3] * p + columns[k, 4] * q + columns[k, 5] * r)
