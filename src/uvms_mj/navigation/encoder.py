"""The encoders of the joints: positions and velocities as a control system reads them."""

from __future__ import annotations  # so that help(Encoder) shows short type names

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from ..errors import Fault, InputError
from ..physics.kernels import kernel
from ..physics.random import standard_normal
from ..physics.tree import MOST_JOINTS
from ..quantities import Lowercase, Moderate, NonNegative, Number, Step, Time, repeated, within
from ..stages.base import Room, Stage, setting, shared
from ..stages.setup import SetupLike
from ..stages.signals import encoder_given, encoder_signals

MOST_LATE = 500
"""Largest delay in periods of the encoder."""


OfJoints = Annotated[tuple[Moderate, ...], repeated(1)]
"""A number of each joint, or one number for all."""
_Deviations = Annotated[tuple[NonNegative, ...], repeated(1)]


@dataclasses.dataclass(frozen=True)
class Encoder(Stage):
    """Base class of all encoders of the joints. ``given`` has CLOCK and the signals of
    :func:`uvms_mj.stages.signals.joint_signals`, and ``out`` has the signals of
    :func:`uvms_mj.stages.signals.encoder_signals`."""

    period: Step | None = shared(None, "s", "time between two samples, a multiple of the time step; default: the step")

    every_step: ClassVar[bool] = True
    room: ClassVar[Room] = Room("navigation", "encoder", encoder_given, encoder_signals(0), "encoder", counts="joints")

    @staticmethod
    def step(settings, state, given, state_dot, out):
        """Set q_m (n,) and q_dot_m (n,) of out, and state_dot, from settings, state and given."""
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class PerfectEncoder(Encoder):
    """Perfect encoders: positions and velocities of the same instant, without an error."""

    name = "perfect"
    runs: ClassVar[bool] = False

    def check_settings(self) -> None:
        super().check_settings()
        if self.period is not None:
            raise InputError([Fault("encoder.period", "a perfect encoder has no period; choose encoder.name")])


@dataclasses.dataclass(frozen=True)
class JointEncoder(Encoder):
    """Encoders with a resolution, bias, noise and delay; the velocity is measured, or taken from the differences of the
    positions."""

    resolution: _Deviations = setting((0.0,), "rad or m", "quantum of the position, of each joint or of all; 0: exact")
    bias: OfJoints = setting((0.0,), "rad or m", "bias of the position, of each joint or of all")
    noise: _Deviations = setting((0.0,), "rad or m", "standard deviation of each sample of the position")
    delay: Annotated[Number, within(0.0, 100.0, "s")] = setting(0.0, "s", "delay of each sample")
    velocity: Annotated[Literal["measured", "differences"], Lowercase] = setting(
        "differences", "-", "measured, or the differences of the measured positions over the period"
    )
    velocity_noise: _Deviations = setting((0.0,), "rad/s or m/s", "standard deviation of a sample of measured velocity")
    velocity_filter: Time = setting(0.0, "s", "time constant of a first-order filter of the velocity; 0: none")

    name = "encoder"
    memory: ClassVar = {
        "queue": (MOST_LATE + 1, 2, MOST_JOINTS),
        "last": "joints",
        "rate": "joints",
    }

    def faults(self, setup: SetupLike) -> Iterator[Fault]:
        if not setup.vehicle.arm.links:
            yield Fault("encoder.name", f"{self.label()!r} is for a vehicle with joints; {setup.vehicle.body} has none")
            return
        joints, step = setup.vehicle.arm.joints, self.period or setup.scenario.simulation.timestep
        for name in ("resolution", "bias", "noise", "velocity_noise"):
            n = len(getattr(self, name))
            if n not in (1, len(joints)):
                wanted = f"one for all, or {len(joints)} for the joints {', '.join(joints)}"
                yield Fault(f"encoder.{name}", f"has {n} values; give {wanted}")
        late = self.delay / step
        if abs(late - round(late)) > 1e-6 or late > MOST_LATE:
            wanted = f"a multiple of the encoder's period {step:g} s, at most {MOST_LATE} of them"
            yield Fault("encoder.delay", f"{self.delay:g} s is not {wanted}")
        if self.velocity == "differences" and any(self.velocity_noise):
            yield Fault("encoder.velocity_noise", "is of a measured velocity; set encoder.velocity = measured")

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        n = len(setup.vehicle.arm.links)
        step = self.period or setup.scenario.simulation.timestep
        names = ("resolution", "bias", "noise", "velocity_noise")
        return {name: np.broadcast_to(getattr(self, name), n).copy() for name in names} | {
            "late": float(round(self.delay / step)),
            "measured": self.velocity == "measured",
            "share": step / (step + self.velocity_filter),
        }

    @staticmethod
    def step(settings, state, given, state_dot, out):
        k, n = given.instant, out.q_m.shape[0]
        now, arrived = state.queue[k % (MOST_LATE + 1)], state.queue[max(0, k - int(settings.late)) % (MOST_LATE + 1)]
        for j in range(n):
            position = given.q[j] + settings.bias[j]
            if settings.noise[j] > 0.0:
                position += settings.noise[j] * standard_normal(given.key, k, 2 * j)
            now[0, j], now[1, j] = quantised(position, settings.resolution[j]), given.q_dot[j]
            if settings.velocity_noise[j] > 0.0:
                now[1, j] += settings.velocity_noise[j] * standard_normal(given.key, k, 2 * j + 1)
        for j in range(n):
            out.q_m[j], rate = arrived[0, j], arrived[1, j]
            if not settings.measured:
                rate = (out.q_m[j] - state.last[j]) / given.period if k > 0 else 0.0
                state.last[j] = out.q_m[j]
            state.rate[j] = state.rate[j] + settings.share * (rate - state.rate[j]) if k > 0 else rate
            out.q_dot_m[j] = state.rate[j]


@kernel
def quantised(x, quantum) -> float:
    """The nearest multiple of the quantum, or x itself if it is 0."""
    return quantum * math.floor(x / quantum + 0.5) if quantum > 0.0 else x


ENCODERS: dict[str, type[Encoder]] = {cls.name: cls for cls in (PerfectEncoder, JointEncoder)}
