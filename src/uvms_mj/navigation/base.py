"""The contract of navigation, a stage that sets the measurements, and perfect sensing."""

from __future__ import annotations  # so that help(Navigation) shows short type names

import dataclasses
from collections.abc import Callable, Mapping
from typing import ClassVar

import numpy as np

from ..physics.frames import quat_product
from ..physics.kernels import kernel
from ..stages.base import Room, Stage
from ..stages.setup import SetupLike
from ..stages.signals import CLOCK, MEASURED, TRUE
from .channel import Channel


@dataclasses.dataclass(frozen=True)
class Measurement:
    """Measurements of a vehicle at rest: position (3,) in W, attitude (4,), velocity (6,) and contact wrench (6,), both
    in B."""

    position: np.ndarray
    quat: np.ndarray
    nu: np.ndarray
    tau_c: np.ndarray


RestErrors = Callable[[np.ndarray, np.ndarray, np.ndarray], Measurement]
"""Mean measurements of a vehicle at rest from its true position, attitude and contact wrench."""


def no_errors(position: np.ndarray, quat: np.ndarray, tau_c: np.ndarray) -> Measurement:
    """The truth of a vehicle at rest."""
    return Measurement(position, quat, np.zeros(6), tau_c)


@dataclasses.dataclass(frozen=True, eq=False)
class ConstantErrors:
    """Measurements with constant errors: :data:`RestErrors`.

    Attributes:
        position_scale, position_bias: (3,) factor of the position, and its bias [m].
        turn: (4,) turn of the measured body from the true one.
        nu: (6,) measured velocity of a vehicle at rest [m/s, rad/s].
        scale, bias: (6,) factor of the contact wrench, and its bias [N, N m].
        drift, z_0: (3,) force that is missing per height above z_0 [N/m, m].
    """

    position_scale: np.ndarray
    position_bias: np.ndarray
    turn: np.ndarray
    nu: np.ndarray
    scale: np.ndarray
    bias: np.ndarray
    drift: np.ndarray
    z_0: float

    def __call__(self, position: np.ndarray, quat: np.ndarray, tau_c: np.ndarray) -> Measurement:
        wrench = tau_c.copy()
        wrench[:3] -= self.drift * (position[2] - self.z_0)
        measured = self.position_scale * position + self.position_bias
        return Measurement(measured, quat_product(quat, self.turn), self.nu, self.scale * wrench + self.bias)


@dataclasses.dataclass(frozen=True)
class Navigation(Stage):
    """Base class of all navigation. ``given`` has the signals CLOCK and TRUE of :mod:`uvms_mj.stages.signals`, and
    ``out`` has MEASURED."""

    room: ClassVar[Room] = Room(
        "navigation",
        "navigation",
        lambda thrusters: CLOCK + TRUE,
        MEASURED,
        noun="navigation stage",
        words=("sensor",),
    )

    @property
    def white_channels(self) -> Mapping[str, Channel]:
        """The channels of white noise by quantity, for the closed form of the noise; empty if none is known."""
        return {}

    @property
    def force_timing(self) -> tuple[float | None, float]:
        """Time from one sample of the contact force to the next, None for the stage's period, and the mean time that a
        sample takes to arrive [s]."""
        return None, 0.0

    @property
    def velocity_timing(self) -> tuple[float | None, float]:
        """The same of the velocity."""
        return None, 0.0

    def rest_errors(self, setup: SetupLike) -> RestErrors | str:
        """Theory of navigation: the measurements of a vehicle at rest, or the reason why they are not known."""
        return "no closed form is known for this navigation"

    def out_of_range(self, measured: Measurement) -> str:
        """The reason why these measurements of a vehicle at rest are impossible; empty if they are not."""
        return ""

    @staticmethod
    def step(settings, state, given, state_dot, out):
        """Set the measurements of out, and state_dot, from settings, state and given."""
        raise NotImplementedError


@kernel
def perfect(true, measured):
    """Set the measurements ``measured`` to the truth. A stage that calls it first changes only the rest."""
    measured.p_WB[:], measured.quat_WB[:], measured.R_WB[:] = true.p_WB, true.quat_WB, true.R_WB
    measured.nu[:] = true.nu
    measured.f_contact_m_W[:], measured.tau_contact_m_B[:] = true.f_springs_W, true.tau_springs_B


@dataclasses.dataclass(frozen=True)
class Perfect(Navigation):
    """Perfect sensing: pose, velocity and contact force of the same instant, without an error."""

    name = "perfect"

    def rest_errors(self, setup: SetupLike) -> RestErrors | str:
        return no_errors

    @staticmethod
    def step(settings, state, given, state_dot, out):
        perfect(given, out)
