r"""Observers, which estimate the contact force of a vehicle without a force sensor: their contract, and the observer of
the generalised momentum.

With the momentum :math:`\hat M \nu` in B, the paper's eq. (10) gives the wrench that the controller's model does not
explain,

.. math::

    w = \hat M \dot\nu - \hat\tau + \hat C \nu + \hat D \nu + \hat g, \qquad
    r = \frac{1}{T} \left( \hat M \nu - \hat M \nu(0) - \int (w_r + r)\, dt \right), \qquad
    w_r = \hat\tau - \hat C \nu - \hat D \nu - \hat g,

where r is De Luca's residual (De Luca and Mattone, "Actuator failure detection and isolation using generalized
momenta", ICRA 2003; De Luca, Albu-Schaeffer, Haddadin and Hirzinger, IROS 2006). Their term with the transposed
Coriolis matrix is the rate of an inertia that depends on the configuration. M_hat is constant in B, so that C_hat nu
stands in its place. Differentiated, r has no acceleration in it:

.. math::

    T \dot r + r = w = \tau_c + d,

a first-order lag of the contact wrench and of everything else that the model does not contain: the current's drag,
the disturbance, errors of the estimates and of the thrusters. Over an interval with the mean of w, r goes on by
1 - exp(-h/T) of the difference, which is exact if w is constant in the interval. At rest r = tau_c + d exactly.
"""

from __future__ import annotations  # so that help(Observer) shows short type names

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from ..errors import Fault, InputError
from ..physics.frames import to_world
from ..quantities import NonNegative, Number, Time, within
from ..stages.base import Room, Stage, setting
from ..stages.setup import ScenarioLike
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
        """As in :class:`.base.Navigation`: None for the stage's period, and the lag of the estimate [s]."""
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
    """No observer: navigation's force sensor gives the contact force."""

    name = "none"
    runs: ClassVar[bool] = False


@dataclass(frozen=True)
class MotionOnly(Stage):
    """The measured pose and velocity, without the force, which an observer sets in place of a force sensor."""

    name = "sensed"
    room: ClassVar[Room] = Room("navigation", "sensed", lambda thrusters: CLOCK + MEASURED, MEASURED[:4])

    def period_in(self, scenario: ScenarioLike) -> float:
        """The period of navigation [s]."""
        return scenario.navigation.period_in(scenario)

    @staticmethod
    def step(settings, state, given, state_dot, out):
        out.p_WB[:], out.quat_WB[:], out.R_WB[:], out.nu[:] = given.p_WB, given.quat_WB, given.R_WB, given.nu


@dataclasses.dataclass(frozen=True)
class MomentumObserver(Observer):
    """Generalised-momentum observer: the contact force from motion and commanded thrust."""

    time_constant: Annotated[Number, within(1e-6, 100.0, "s")] = setting(
        0.02, "s", "T of the first-order lag of the estimated wrench"
    )
    threshold: NonNegative = setting(
        1.0, "N", "force above which there is a contact; it ends below half of this; 0: always"
    )
    calibrate_from: Time = setting(0.0, "s", "begin of the time in which the residual is averaged as the bias")
    calibrate_until: Time = setting(0.0, "s", "end of this time, before the contact; 0: the bias is zero")

    name = "momentum_observer"
    states: ClassVar[Mapping[str, int]] = {"residual": 6, "residual_bias": 6, "in_contact": 1}
    units: ClassVar[Mapping[str, str]] = {"residual": "N, N m", "residual_bias": "N, N m", "in_contact": "1"}
    memory: ClassVar[Mapping[str, int]] = {"momentum": 6, "explained": 6, "averaged": 1}

    def check_settings(self) -> None:
        super().check_settings()
        if self.calibrate_until and self.calibrate_until <= self.calibrate_from:
            wrong = f"{self.calibrate_until!r} must be 0 or above calibrate_from, {self.calibrate_from!r}"
            raise InputError([Fault("observer.calibrate_until", wrong)], f"the settings of {self.label()}")

    @property
    def force_timing(self) -> tuple[float | None, float]:
        return None, self.time_constant

    def out_of_range(self, measured: Measurement) -> str:
        if self.calibrate_until:
            return "the bias of the observer depends on the motion in the time of its average"
        if np.linalg.norm(measured.tau_c[:3]) < self.threshold:
            return "at rest, the observed force is below observer.threshold"
        return ""

    @staticmethod
    def step(settings, state, given, state_dot, out):
        residual, bias, wrench = state.residual, state.residual_bias, out.tau_contact_m_B
        h, part = given.period, 1.0 - math.exp(-given.period / settings.time_constant)
        momentum, explained = given.M_hat @ given.nu, given.C_hat_nu + given.D_hat_nu + given.g_hat
        if given.instant > 0:
            # motion and commanded thrust of the interval that ends now
            w = (momentum - state.momentum) / h - given.tau_hat + 0.5 * (explained + state.explained)
            residual += part * (w - residual)
        state.momentum[:], state.explained[:] = momentum, explained
        calibrating = given.t < settings.calibrate_until
        if calibrating and given.t >= settings.calibrate_from:
            state.averaged[0] += 1.0
            bias += (residual - bias) / state.averaged[0]
        wrench[:] = residual - bias
        force = math.sqrt(wrench[:3] @ wrench[:3])
        limit = 0.5 * settings.threshold if state.in_contact[0] > 0.0 else settings.threshold
        state.in_contact[0] = 0.0 if calibrating or force < limit else 1.0
        if state.in_contact[0] == 0.0:
            wrench[:] = 0.0
        to_world(given.R_WB, wrench, out.f_contact_m_W)
