"""The contract of navigation: a stage that sets the measurements."""

from __future__ import annotations  # so that help(Navigation) shows short type names

import dataclasses
from typing import ClassVar

from ..stages.base import Room, Stage
from ..stages.signals import CLOCK, KNOWN, TRUE


@dataclasses.dataclass(frozen=True)
class Navigation(Stage):
    """Base class of all navigation. ``given`` has the signals CLOCK and TRUE of :mod:`uvms_mj.stages.signals`, and
    ``out`` has KNOWN."""

    room: ClassVar[Room] = Room("navigation", "navigation", lambda thrusters: CLOCK + TRUE, KNOWN, "navigation stage")

    @staticmethod
    def step(settings, state, given, state_dot, out):
        """Set the measurements of out, and state_dot, from settings, state and given."""
        raise NotImplementedError
