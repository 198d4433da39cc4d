r"""Thrusters as they are: a static curve, a speed controller with its quantised command, a lag, losses and failures.

The commanded thrust of a thruster passes these elements in order, each of which may be absent:

1. The control system's inverse of the static curve gives the command x, a pulse width [us]. Without an inverse, x is
   the commanded thrust itself [N]. ``assumed_efficiency`` is the efficiency that the control system knows of. A linear
   mixer, as ArduSub's, takes the curve for a straight line (:func:`mixer_curve`).
2. The speed controller rounds x to multiples of ``quantum`` from neutral.
3. The true static curve gives a thrust, zero within ``dead_band`` of neutral, times ``efficiency``.
4. A thruster that was at rest or turns the other way starts after ``start_delay``.
5. The thrust changes by at most ``rate_limit``.
6. It follows with a lag, discretised exactly for an input that is held over the stage's period.
7. The speed of advance u_a of the thruster through the water costs thrust. The bilinear model of a propeller (Fossen
   2021, Blanke et al. 2000), T = T_nn |n| n - T_nu |n| u_a, is with the thrust f = T_nn |n| n without inflow

   .. math:: u = f - c \sqrt{|f|}\, u_a, \qquad c = T_{nu} / \sqrt{T_{nn}}

A failed thruster keeps the command of its last good instant, or a fraction of its thrust. Outputs that freeze keep the
last command of every thruster for a time, once or again and again.

:class:`General` has every setting spelt out. :class:`T200` is the thruster of Blue Robotics at a battery's
voltage: ``t200.toml`` has the maker's measurements (September 2019) at 10, 12, 14, 16, 18 and 20 V: thrust over the
pulse width of the speed controller's command, on a test stand. Between two voltages the thrust is interpolated linearly
at equal pulse width.
"""

from __future__ import annotations  # so that help(Propeller) shows short type names

import bisect
import dataclasses
import functools
import math
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import MaxLen
from pydantic import Field

from ..errors import Fault, InputError
from ..physics.kernels import kernel
from ..quantities import Lowercase, Moderate, NonNegative, Number, Positive, Time, within
from ..stages.base import setting
from ..stages.setup import SetupLike
from .thrusters import Curve, StaticThrust, Thrusters, discrete, interpolated, interval, mean_delay, wrong_points

_Efficiency = Annotated[Number, within(1e-3, 10.0, "")]
_Fraction = Annotated[Number, within(0.0, 1.0, "")]
Lag = Annotated[Literal["none", "first_order", "third_order"], Lowercase]
_Quantum = Annotated[Number, within(0.0, 1e3, "us or N")]
_PASSED = ("efficiency", "quantum", "dead_band", "inflow_loss", "failed_at", "failed_fraction", "failed_stuck")
_LARGEST, _TINY = sys.float_info.max, 1e-12


@kernel
def command_of(settings, state, k, u_cmd) -> float:
    """Command of thruster k for a commanded thrust [N], as its speed controller takes it."""
    command = settings.wanted * u_cmd
    if settings.inverted:
        if command == 0.0:
            return settings.neutral
        i = interval(settings.thrust_hat, command, int(state.near_hat[k]))
        state.near_hat[k] = i
        command = interpolated(settings.thrust_hat, settings.command_hat, i, command)
    if settings.quantum > 0.0:
        command = settings.neutral + settings.quantum * math.floor(
            (command - settings.neutral) / settings.quantum + 0.5
        )
    return command


@kernel
def static_thrust(settings, state, k) -> float:
    """Thrust of thruster k by the true curve [N]."""
    command = state.command[k]
    if settings.dead_band > 0.0 and abs(command - settings.neutral) <= settings.dead_band:
        return 0.0
    if not settings.curved:
        return command
    i = interval(settings.command, command, int(state.near[k]))
    state.near[k] = i
    return interpolated(settings.command, settings.thrust, i, command)


@kernel
def started(settings, state, k, thrust) -> float:
    """The thrust after the delay of a thruster that starts, or starts in the other direction."""
    direction = np.sign(thrust)
    if direction != state.direction[k]:
        state.direction[k] = direction
        state.waits[k] = settings.start_instants
    if state.waits[k] > 0.0:
        state.waits[k] -= 1.0
        return 0.0
    return thrust


@kernel
def frozen(settings, instant) -> bool:
    """Whether the outputs are frozen at an instant of the stage."""
    since = instant - int(settings.freeze_from)
    if since >= 0 and settings.freeze_again > 0.0:
        since %= int(settings.freeze_again)
    return since >= 0 and since < int(settings.freeze_instants)


@kernel
def lagged(settings, state, k, thrust) -> float:
    """The thrust at this instant, before the new input acts; the states go on to the next instant."""
    x = np.array([state.x_1[k], state.x_2[k], state.x_3[k]])
    state.x_1[k], state.x_2[k], state.x_3[k] = settings.Phi @ x + settings.Gamma * thrust
    return settings.C @ x


def commands_alone(settings, state, given, state_dot, out):
    """The part of :meth:`Propeller.step` that a vehicle's own control system has: the command (n,) of each speed
    controller, which is recomputed where the commanded thrust changes. A failure is the thruster's."""
    for k in range(out.shape[0]):
        if given.instant == 0:
            state.command[k] = settings.neutral
        if given.instant == 0 or given.u_cmd[k] != state.asked[k]:
            state.asked[k] = given.u_cmd[k]
            state.command[k] = command_of(settings, state, k, given.u_cmd[k])
        out[k] = state.command[k]


@dataclasses.dataclass(frozen=True)
class Propeller(Thrusters):
    """Base class of the shipped thruster models. A derived class gives the static curves."""

    efficiency: _Efficiency = setting(1.0, "1", "installed thrust over the curve's")
    assumed_efficiency: _Efficiency = setting(1.0, "1", "efficiency that the control system assumes")
    quantum: _Quantum = setting(0.0, "us or N", "step of the speed controller's command; 0: none")
    dead_band: _Quantum = setting(
        0.0, "us or N", "commands as near to neutral as this give no thrust, besides the curve"
    )
    start_delay: Annotated[Number, within(0.0, 10.0, "s")] = setting(
        0.0, "s", "time from the command to the first thrust"
    )
    rate_limit: Positive | None = setting(None, "N/s", "greatest rate of the thrust; default: none")
    lag: Lag = setting("none", "-", "none, first_order with time_constant, or third_order, as identified on a T200")
    time_constant: Annotated[Number, within(1e-6, 100.0, "s")] = setting(0.03, "s", "of the first-order lag")
    inflow_loss: NonNegative = setting(0.0, "N^0.5 s/m", "c of the thrust lost by inflow, c sqrt(|f|) u_a")
    freeze_time: Annotated[Number, within(0.0, 1e3, "s")] = setting(
        0.0, "s", "how long the outputs freeze: every thruster keeps its last command; 0: never"
    )
    freeze_at: Time = setting(0.0, "s", "time at which the outputs freeze")
    freeze_every: Positive | None = setting(None, "s", "time from one freeze to the next; default: they freeze once")
    failed: Annotated[int, Field(strict=True, ge=0)] = setting(
        0, "1", "number of the thruster that fails, from 1; 0: none"
    )
    failed_at: Time = setting(0.0, "s", "time of the failure")
    failed_fraction: _Fraction = setting(0.0, "1", "part of its thrust that a failed thruster keeps")
    failed_stuck: bool = setting(False, "-", "whether a failed thruster keeps its last command instead")

    memory: ClassVar[Mapping[str, Any]] = dict.fromkeys(
        ("asked", "command", "near", "near_hat", "static", "direction", "waits", "held", "x_1", "x_2", "x_3"),
        "thrusters",
    )

    def check_settings(self) -> None:
        super().check_settings()
        if self.failed_stuck and self.failed_fraction > 0.0:
            wrong = f"{self.failed_fraction:g}: a stuck thruster keeps its command; set failed_fraction or failed_stuck"
            raise InputError([Fault("thrusters.failed_fraction", wrong)])
        if self.freeze_every is not None and self.freeze_every <= self.freeze_time:
            wrong = f"{self.freeze_every:g} s must be longer than thrusters.freeze_time, {self.freeze_time:g} s"
            raise InputError([Fault("thrusters.freeze_every", wrong)])

    def _curves(self) -> tuple[Curve | None, Curve | None]:
        """The curves, whose points the function has. Under a user's function :meth:`curves` has none."""
        return None, None

    def curves(self) -> tuple[Curve | None, Curve | None]:
        return self._curves()

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        n = len(setup.vehicle.thrusters)
        if self.failed > n:
            wrong = f"{self.failed}: the vehicle has {n} thrusters"
            raise InputError([Fault("thrusters.failed", wrong)], "scenario")
        period = self.period or setup.scenario.simulation.timestep
        true, assumed = self._curves()
        none = np.zeros(2)
        thrust_hat, command_hat = assumed.inverse() if assumed is not None else (none, none)
        return {
            **{name: getattr(self, name) for name in _PASSED},
            "wanted": 1.0 / self.assumed_efficiency,
            "curved": true is not None,
            "command": true.command if true is not None else none,
            "thrust": true.thrust if true is not None else none,
            "inverted": assumed is not None,
            "thrust_hat": thrust_hat,
            "command_hat": command_hat,
            "neutral": assumed.neutral if assumed is not None else 0.0,
            "start_instants": float(round(self.start_delay / period)),
            "change": np.inf if self.rate_limit is None else self.rate_limit * period,
            "lags": self.lag != "none",
            **discrete(self.lag, self.time_constant, period),
            "failed": self.failed - 1.0,
            "freeze_instants": float(round(self.freeze_time / period)),
            "freeze_from": float(round(self.freeze_at / period)),
            "freeze_again": 0.0 if self.freeze_every is None else float(max(1, round(self.freeze_every / period))),
        }

    def freezes(self, duration: float) -> bool:
        """Whether the outputs freeze in a run of this duration [s]."""
        return self.freeze_time > 0.0 and self.freeze_at < duration

    def command_limits(self, setup: SetupLike) -> tuple[np.ndarray, np.ndarray]:
        low, high = super().command_limits(setup)
        true, assumed = self.curves()
        ends = assumed.thrust if assumed is not None else true.command if true is not None else None
        if ends is None:
            return low, high
        return np.maximum(low, self.assumed_efficiency * ends[0]), np.minimum(high, self.assumed_efficiency * ends[-1])

    def mean_delay(self) -> float:
        return 0.0 if self.lag == "none" else mean_delay(self.lag, self.time_constant)

    def lag_model(self, period: float) -> Mapping[str, np.ndarray] | None:
        return None if self.lag == "none" else discrete(self.lag, self.time_constant, period)

    def at_rest(self, setup: SetupLike) -> StaticThrust | str:
        fails = self.failed > 0 and self.failed_at < setup.scenario.simulation.duration
        if fails and self.failed_stuck:
            return "a thruster is stuck"
        if self.freezes(setup.scenario.simulation.duration):
            return "the outputs to the thrusters freeze: thrusters.freeze_time"
        if self.inflow_loss > 0.0 and setup.scenario.mean_flow_W.any():
            return "the current costs thrust"
        true, assumed = self.curves()
        gain = np.full(len(setup.vehicle.thrusters), self.efficiency / self.assumed_efficiency)
        if fails:
            gain[self.failed - 1] *= self.failed_fraction

        def command(u_cmd: np.ndarray) -> np.ndarray:
            return u_cmd if assumed is None else assumed.command_for(u_cmd)

        def thrust(u_cmd: np.ndarray) -> np.ndarray:
            x = command(u_cmd / self.assumed_efficiency)
            return gain * self.assumed_efficiency * (x if true is None else true.at(x))

        neutral = 0.0 if assumed is None else assumed.neutral
        edges = command(np.array([-_TINY, _TINY])) - neutral
        edges = neutral + np.array([min(edges[0], -self.dead_band), max(edges[1], self.dead_band)])
        start = self.efficiency * (edges if true is None else true.at(edges))
        proportional = true is None or (assumed is not None and assumed.same_as(true))
        error = "the command of the thrusters is quantised" if self.quantum > 0.0 else ""
        if not proportional:
            error = "the thrusters' curve differs from the control system's"
        return StaticThrust(thrust, gain if proportional else None, (float(start[0]), float(start[1])), error)

    @staticmethod
    def step(settings, state, given, state_dot, u):
        freezes = settings.freeze_instants > 0.0 and frozen(settings, given.instant)
        for k in range(u.shape[0]):
            failed = k == settings.failed and given.t >= settings.failed_at
            if not abs(given.u_cmd[k]) <= _LARGEST:  # the run stops
                u[k] = given.u_cmd[k]
                continue
            if given.instant == 0:
                state.command[k] = settings.neutral
            if not freezes and (
                given.instant == 0 or given.u_cmd[k] != state.asked[k]
            ):  # a command is held for a control period
                state.asked[k] = given.u_cmd[k]
                if not (failed and settings.failed_stuck):
                    state.command[k] = command_of(settings, state, k, given.u_cmd[k])
                state.static[k] = settings.efficiency * static_thrust(settings, state, k)
            thrust = state.static[k]
            if failed and not settings.failed_stuck:
                thrust *= settings.failed_fraction
            if settings.start_instants > 0.0:
                thrust = started(settings, state, k, thrust)
            thrust = min(state.held[k] + settings.change, max(state.held[k] - settings.change, thrust))
            state.held[k] = thrust
            if settings.lags:
                thrust = lagged(settings, state, k, thrust)
            if settings.inflow_loss > 0.0:
                thrust -= settings.inflow_loss * math.sqrt(abs(thrust)) * given.inflow[k]
            u[k] = thrust


_Points = Annotated[tuple[Moderate, ...], MaxLen(2000)]


@dataclasses.dataclass(frozen=True)
class General(Propeller):
    """Thrusters with all settings spelt out; ideal by default. Without a curve, thrust and command are the same."""

    curve_command: _Points = setting((), "us or N", "commands of the points of the static curve; empty: no curve")
    curve_thrust: _Points = setting((), "N", "thrusts of the points of the static curve")
    inverted: bool = setting(
        True, "-", "whether the control system inverts the curve; otherwise its command is u_cmd in N"
    )

    name = "general"

    def check_settings(self) -> None:
        super().check_settings()
        wrong = wrong_points(self.curve_command, self.curve_thrust, self.inverted)
        faults = [Fault(f"thrusters.{key}", reason) for key, reason in wrong]
        if faults:
            raise InputError(faults, f"the settings of {self.label()}")

    def _curves(self) -> tuple[Curve | None, Curve | None]:
        if not self.curve_command:
            return None, None
        curve = Curve.of(self.curve_command, self.curve_thrust)
        return curve, curve if self.inverted else None


_TABLE = tomllib.loads(Path(__file__).with_name("t200.toml").read_text(encoding="utf-8"))
NEUTRAL_US = 1500.0
STANDARD_GRAVITY = 9.80665
VOLTAGES: list[float] = _TABLE["voltages_V"]
PULSE_WIDTHS_US = np.array(_TABLE["pulse_widths_us"], float)
_THRUST_N = 0.01 * STANDARD_GRAVITY * np.array(_TABLE["thrust_10_gf"])
_Voltage = Annotated[Number, within(VOLTAGES[0], VOLTAGES[-1], "V")]


@functools.lru_cache(maxsize=8)
def thrust_curve(voltage: float) -> Curve:
    """The static curve at a voltage from 10 to 20 V, on the test stand."""
    k = min(bisect.bisect_right(VOLTAGES, voltage), len(VOLTAGES) - 1)  # of the row above
    low, high = _THRUST_N[k - 1], _THRUST_N[k]
    thrust = low + (high - low) / (VOLTAGES[k] - VOLTAGES[k - 1]) * (voltage - VOLTAGES[k - 1])
    return Curve(PULSE_WIDTHS_US, thrust, NEUTRAL_US)


FULL_US = 400.0
"""Pulse width from neutral at the full demand of a mixer [us]."""


def mixer_curve(curve: Curve, gain: float) -> Curve:
    """The straight line that a linear mixer takes for the curve of pulse widths: the demand f/f_max moves the pulse by
    400 us times the pilot's gain, where f_max is the curve's greatest thrust."""
    demand = (curve.command - curve.neutral) / FULL_US
    return Curve(curve.neutral + gain * FULL_US * demand, curve.thrust[-1] * demand, curve.neutral)


_Mixer = Annotated[Literal["inverse", "linear"], Lowercase]


@dataclasses.dataclass(frozen=True)
class T200(Propeller):
    """T200 thrusters with the maker's curve, a pulse width in whole microseconds and the identified lag."""

    voltage: _Voltage = setting(16.0, "V", "voltage of the battery")
    assumed_voltage: _Voltage | None = setting(None, "V", "voltage that the control system assumes; default: voltage")
    quantum: Annotated[Number, within(0.0, 1e3, "us")] = setting(1.0, "us", "step of the pulse width; 0: none")
    dead_band: Annotated[Number, within(0.0, 1e3, "us")] = setting(
        0.0, "us", "pulse widths as near to 1500 us as this give no thrust, besides the curve"
    )
    lag: Lag = setting("third_order", "-", "none, first_order with time_constant, or third_order, as identified")
    mixer: _Mixer = setting(
        "inverse", "-", "inverse: the control system inverts the curve; linear: the pulse is proportional, as ArduSub's"
    )
    pilot_gain: Annotated[Number, within(0.01, 1.0, "")] = setting(1.0, "1", "pilot's gain of the linear mixer")

    name = "t200"

    @property
    def takes_pulses(self) -> bool:
        return True

    def check_settings(self) -> None:
        super().check_settings()
        if self.mixer == "inverse" and self.pilot_gain != 1.0:
            wrong = f'{self.pilot_gain:g} has no effect on the inverse curve; set thrusters.mixer = "linear"'
            raise InputError([Fault("thrusters.pilot_gain", wrong)])

    def at_rest(self, setup: SetupLike) -> StaticThrust | str:
        if self.mixer == "linear":
            return "a linear mixer does not jump over the thrusters' dead band, about which a law hunts"
        return super().at_rest(setup)

    def _curves(self) -> tuple[Curve | None, Curve | None]:
        voltage = self.voltage if self.assumed_voltage is None else self.assumed_voltage
        assumed = thrust_curve(voltage)
        return thrust_curve(self.voltage), assumed if self.mixer == "inverse" else _line(voltage, self.pilot_gain)


@functools.lru_cache(maxsize=8)
def _line(voltage: float, gain: float) -> Curve:
    return mixer_curve(thrust_curve(voltage), gain)
