"""The contract of actuation, a stage that sets the thrusts, the pseudoinverse, and commands from outside."""

from __future__ import annotations  # so that help(Actuation) shows short type names

import dataclasses
import sys
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..errors import Fault, InputError
from ..physics.kernels import kernel
from ..physics.spanned_axes import pseudoinverse
from ..quantities import Step
from ..stages.base import Room, Stage, shared
from ..stages.setup import SetupLike
from ..stages.signals import actuation_given, thruster_signal
from .propeller import NEUTRAL_US, PULSE_WIDTHS_US, Propeller
from .thrusters import interpolated, interval


@dataclasses.dataclass(frozen=True)
class Actuation(Stage):
    """Base class of all actuation. ``given`` has the signals of :func:`uvms_mj.stages.signals.actuation_given`, and
    u (n,) is the thrust of each thruster [N]."""

    period: Step | None = shared(None, "s", "period, a multiple of the time step; default: every step")
    every_step: ClassVar[bool] = True

    room: ClassVar[Room] = Room(
        name="actuation",
        table="actuation",
        given=actuation_given,
        out=(thruster_signal(0),),
        noun="actuation stage",
        arguments=("settings", "state", "given", "state_dot", "u"),
    )
    records_loss: ClassVar[bool] = False
    """Whether a run records tau_lost, the part of tau_cmd that u does not produce, also with ideal thrusters."""

    @staticmethod
    def step(settings, state, given, state_dot, u):
        """Set u (n,) and state_dot from settings, state and given."""
        raise NotImplementedError

    def inverse(self, B: np.ndarray) -> np.ndarray:
        """The matrix (n, 6) by which the shipped allocations set u from tau_cmd within the thrusters' limits, for the
        allocation matrix B (6, n)."""
        return pseudoinverse(B)


@kernel
def pseudo_inverse(given, u):
    """Set u = B^+ tau_cmd (eq. 25) within the thrusters' limits. A stage that calls it first changes only the rest."""
    B_pinv, tau = given.B_pinv, given.tau_cmd
    free = B_pinv[:, :2] @ tau[:2] + B_pinv[:, 2:4] @ tau[2:4] + B_pinv[:, 4:] @ tau[4:]  # no sum waits for another
    u[:] = np.clip(free, given.u_min, given.u_max)


@dataclasses.dataclass(frozen=True)
class PseudoInverse(Actuation):
    """Ideal thrusters: they produce the thrust of the pseudoinverse at once, within their limits."""

    name = "pseudo_inverse"

    @staticmethod
    def step(settings, state, given, state_dot, u):
        pseudo_inverse(given, u)


@dataclasses.dataclass(frozen=True)
class External(Actuation):
    """Thrusts from outside: the caller of a Simulation sets u."""

    name = "external"
    external: ClassVar[bool] = True
    by_caller: ClassVar[str] = "u"

    @staticmethod
    def step(settings, state, given, state_dot, u):
        pass


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

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The thrusters' curve, so that their inverse gives the pulse width back."""
        thrusters = setup.scenario.thrusters
        true, assumed = thrusters.curves()
        if true is None or assumed is None:
            wrong = "pwm needs thrusters.name = t200, or general with a curve of pulse widths that is inverted"
            raise InputError([Fault("actuation.name", wrong)], "scenario")
        if getattr(thrusters, "mixer", "inverse") != "inverse":
            wrong = "with actuation.name = pwm nothing is mixed: the pulse width is given; leave it out"
            raise InputError([Fault("thrusters.mixer", wrong)], "scenario")
        if not assumed.same_as(true):
            wrong = "with actuation.name = pwm nothing is assumed: the pulse width is given; leave it out"
            raise InputError([Fault("thrusters.assumed_voltage", wrong)], "scenario")
        if true.at(np.array([NEUTRAL_US]))[0] != 0.0 or true.command[0] < 0.0:
            wrong = f"is not a curve of pulse widths: with actuation.name = pwm, {NEUTRAL_US:g} us must give no thrust"
            raise InputError([Fault("thrusters.curve_command", wrong)], "scenario")
        assert isinstance(thrusters, Propeller)  # no other one has curves
        return {"command": true.command, "thrust": thrusters.assumed_efficiency * true.thrust}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        for k in range(u.shape[0]):
            u[k] = thrust_of(settings.command, settings.thrust, state, k)


@dataclasses.dataclass(frozen=True)
class Autopilot(Pwm):
    """Pulse widths of an autopilot, which ``uvms-mj sitl`` exchanges: each thruster's curve makes thrust of it."""

    name = "autopilot"
    states: ClassVar = {"pwm_cmd": "thrusters", "frame": 1}
    start_values: ClassVar = {"pwm_cmd": NEUTRAL_US}
    units: ClassVar = {"pwm_cmd": "us", "frame": "1"}
