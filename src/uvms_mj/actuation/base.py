"""The contract of actuation: a stage that sets the thrusts."""

from __future__ import annotations  # so that help(Actuation) shows short type names

import dataclasses
from typing import ClassVar

from ..stages.base import Room, Stage
from ..stages.signals import actuation_given, thruster_signal

ACTUATION = Room(
    name="actuation",
    table="actuation",
    given=actuation_given,
    out=(thruster_signal(0),),
    noun="actuation stage",
    arguments=("settings", "state", "given", "state_dot", "u"),
)


@dataclasses.dataclass(frozen=True)
class Actuation(Stage):
    """Base class of all actuation. ``given`` has the signals of :func:`uvms_mj.stages.signals.actuation_given`, and
    u (n,) is the thrust of each thruster [N]."""

    room: ClassVar[Room] = ACTUATION

    @staticmethod
    def step(settings, state, given, state_dot, u):
        """Set u (n,) and state_dot from settings, state and given."""
        raise NotImplementedError
