"""The contract of an observer, which estimates the contact force of a vehicle without a force sensor."""

from __future__ import annotations  # so that help(Observer) shows short type names

import dataclasses
from typing import ClassVar

from ..stages.base import Room, Stage
from ..stages.signals import KNOWN, OBSERVER_GIVEN


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
        out=KNOWN[4:],
        noun="observer",
        theory=("age",),
    )

    @property
    def age(self) -> float:
        """Mean age of the estimated force, from its first-order lag [s]."""
        return 0.0

    @staticmethod
    def step(settings, state, given, state_dot, out):
        """Set the measured force of out, and state_dot, from settings, state and given."""
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class NoObserver(Observer):
    """No observer: the contact force is that of navigation's force sensor."""

    name = "none"
    runs: ClassVar[bool] = False

    @staticmethod
    def step(settings, state, given, state_dot, out):
        pass
