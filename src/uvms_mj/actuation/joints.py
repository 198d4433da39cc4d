"""The contract of a joint interface, a stage that sets the torques of the joints' motors, and the torque interface.

Whatever torque the stage sets, the motor gives at most what :func:`uvms_mj.physics.tree.deliverable` says.
"""

from __future__ import annotations  # so that help(Joints) shows short type names

import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np

from ..errors import Fault
from ..physics.kernels import kernel
from ..quantities import Step
from ..stages.base import Room, Stage, shared
from ..stages.signals import joint_torque_signal, joints_given


@dataclasses.dataclass(frozen=True)
class Joints(Stage):
    """Base class of all joint interfaces. ``given`` has the signals of
    :func:`uvms_mj.stages.signals.joints_given`, and tau_q (n,) is the torque of each joint's motor [N m or N]."""

    period: Step | None = shared(None, "s", "period, a multiple of the time step; default: every step")

    every_step: ClassVar[bool] = True
    torque_controlled: ClassVar[bool] = True
    """Whether the torque follows the commanded one, which is then recorded."""
    tracked_signal: ClassVar[str] = "q"
    """The signal of :meth:`target_at`: "q" or "q_dot"."""
    room: ClassVar[Room] = Room(
        name="actuation",
        table="joints",
        given=joints_given,
        out=(joint_torque_signal(0),),
        noun="joint interface",
        arguments=("settings", "state", "given", "state_dot", "tau_q"),
        counts="joints",
    )

    def resolved(self, setup: Any) -> Joints:
        """The interface that a run uses: itself."""
        return self

    def target_at(self, setup: Any, t: float) -> np.ndarray | None:
        """The value (n,) that the interface makes the signal :attr:`tracked_signal` have at the time t [s]; None if it
        follows nothing that is known before the run."""
        return None

    def faults(self, setup: Any) -> Iterator[Fault]:
        if not setup.vehicle.arm.links:
            yield Fault("joints.name", f"{self.label()!r} is for a vehicle with joints; {setup.vehicle.body} has none")

    @staticmethod
    def step(settings, state, given, state_dot, tau_q):
        """Set tau_q (n,) and state_dot from settings, state and given."""
        raise NotImplementedError


@kernel
def commanded(given, tau_q):
    """Set the torques to the commanded ones. A stage that calls it first changes only the rest."""
    tau_q[:] = given.tau_q_cmd


@dataclasses.dataclass(frozen=True)
class Torque(Joints):
    """Torque interface: the motors give the torques that the law at the tool commands, within their limits."""

    name = "torque"

    @staticmethod
    def step(settings, state, given, state_dot, tau_q):
        commanded(given, tau_q)
