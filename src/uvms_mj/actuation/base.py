"""The contract of actuation, a stage that sets the thrusts, and the shipped stages."""

from __future__ import annotations  # so that help(Actuation) shows short type names

import dataclasses
from typing import ClassVar

import numpy as np

from ..physics.kernels import kernel
from ..quantities import Step
from ..stages.base import Room, Stage, shared
from ..stages.signals import actuation_given, thruster_signal


@dataclasses.dataclass(frozen=True)
class Actuation(Stage):
    """Base class of all actuation. ``given`` has the signals of :func:`uvms_mj.stages.signals.actuation_given`, and
    u (n,) is the thrust of each thruster [N]."""

    period: Step | None = shared(None, "s", "period, a multiple of the time step; default: every step")

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
        return np.linalg.pinv(B)


@kernel
def pseudo_inverse(given, u):
    """Set u = B^+ tau_cmd (eq. 25) within the thrusters' limits. A stage that calls it first changes only the rest."""
    B_pinv, u_min, u_max = given.B_pinv, given.u_min, given.u_max
    a, b, c = given.tau_cmd[0], given.tau_cmd[1], given.tau_cmd[2]
    d, e, f = given.tau_cmd[3], given.tau_cmd[4], given.tau_cmd[5]
    for k in range(u.shape[0]):
        total = (B_pinv[k, 0] * a + B_pinv[k, 1] * b) + (B_pinv[k, 2] * c + B_pinv[k, 3] * d)
        total += B_pinv[k, 4] * e + B_pinv[k, 5] * f
        u[k] = min(u_max[k], max(u_min[k], total))


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
