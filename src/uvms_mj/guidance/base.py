"""The contract of guidance: a stage that sets the reference."""

from __future__ import annotations  # so that help(Guidance) shows short type names

import dataclasses
from typing import ClassVar

from ..physics.kernels import kernel
from ..stages.base import Room, Stage
from ..stages.signals import CLOCK, KNOWN, REFERENCE


@dataclasses.dataclass(frozen=True)
class Guidance(Stage):
    """Base class of all guidance. ``given`` has the signals CLOCK and KNOWN of :mod:`uvms_mj.stages.signals`, and ``out``
    has REFERENCE."""

    room: ClassVar[Room] = Room("guidance", "reference", lambda thrusters: CLOCK + KNOWN, REFERENCE, "guidance stage")

    @staticmethod
    def step(settings, state, given, state_dot, out):
        """Set p_d, p_d_dot, p_d_ddot and quat_d of out, and state_dot, from settings, state and given."""
        raise NotImplementedError


@kernel
def hold(given, out):
    """Keep the pose of the first instant at rest. A stage that calls it first sets only the rest of its reference."""
    for i in range(3):
        out.p_d_dot[i] = 0.0
        out.p_d_ddot[i] = 0.0
        if given.instant == 0:
            out.p_d[i] = given.p_WB[i]
    if given.instant == 0:
        for i in range(4):
            out.quat_d[i] = given.quat_WB[i]
