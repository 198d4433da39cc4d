"""The contract of an observer, which estimates the contact force of a vehicle without a force sensor."""

from __future__ import annotations  # so that help(Observer) shows short type names

import dataclasses
from dataclasses import dataclass
from typing import ClassVar

from ..stages.base import Room, Stage
from ..stages.signals import CLOCK, MEASURED, OBSERVER_GIVEN
from .base import Measurement


@dataclasses.dataclass(frozen=True)
class Observer(Stage):
    """Base class of all observers. ``given`` has the signals OBSERVER_GIVEN of :mod:`uvms_mj.stages.signals`, and
    ``out`` has f_contact_m_W and tau_contact_m_B.

    An observer runs after the tracking errors and estimates and before the task. It takes the place of the force
    sensor: no stage is given the force that navigation measures, and ``given`` has the observer's own last one.
    """

    room: ClassVar[Room] = Room(
        name="navigation",
        table="observer",
        given=lambda thrusters: OBSERVER_GIVEN,
        out=MEASURED[4:],
        noun="observer",
        theory=("force_timing", "out_of_range"),
    )

    @property
    def force_timing(self) -> tuple[float | None, float]:
        """As that of :class:`.base.Navigation`: None for the stage's period, and the lag of the estimate [s]."""
        return None, 0.0

    def out_of_range(self, measured: Measurement) -> str:
        """Theory of an observer: the reason why it does not measure at rest what its model does not explain, the wrench
        of ``measured``; empty if it does."""
        return "no closed form is known for this observer"

    @staticmethod
    def step(settings, state, given, state_dot, out):
        """Set the measured force of out, and state_dot, from settings, state and given."""
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class NoObserver(Observer):
    """No observer: the contact force is that of navigation's force sensor."""

    name = "none"
    runs: ClassVar[bool] = False


@dataclass(frozen=True)
class MotionOnly(Stage):
    """The measured pose and velocity, without the force, which an observer sets in place of a force sensor."""

    name = "sensed"
    room: ClassVar[Room] = Room("navigation", "sensed", lambda thrusters: CLOCK + MEASURED, MEASURED[:4])

    @staticmethod
    def step(settings, state, given, state_dot, out):
        out.p_WB[:], out.quat_WB[:], out.R_WB[:], out.nu[:] = given.p_WB, given.quat_WB, given.R_WB, given.nu
