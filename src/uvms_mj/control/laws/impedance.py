"""Impedance control: the nominal control alone, and with the truth, a yardstick."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ...stages.setup import SetupLike
from ..base import Controller, SteadyState
from .terms import add_product

if TYPE_CHECKING:
    from ..theory.stability import Stability


@dataclass(frozen=True)
class Impedance(Controller):
    """Impedance control (23): exact for a perfect model without current and disturbance."""

    name = "impedance"

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.tau_nom  # eq. (23)

    def at_rest(self, setup: SetupLike) -> SteadyState | str:
        """The static balance of equation (5)."""
        from ..theory.balance import not_constant, static_balance

        return not_constant(setup) or self._stability(setup).checked(static_balance(setup, 0.0))

    def notes(self, setup: SetupLike) -> Iterator[str]:
        """Warnings if the sampled law vibrates against the wall."""
        return self._stability(setup).notes(self.label())

    def _stability(self, setup: SetupLike) -> "Stability":
        from ..theory.stability import ForceAge, Stability

        return Stability(setup, ForceAge.of(setup, setup.design.M_hat))


TOLD_THE_TRUTH = "the truth, current and disturbance included: a yardstick, not a law for a real vehicle"
"""Text in all outputs that describes the signals given to the ideal law."""


@dataclass(frozen=True)
class Ideal(Controller):
    """Ideal impedance control (13), a yardstick: it uses the true model, current and disturbance."""

    name = "ideal"
    uses_truth: ClassVar[bool] = True

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        nu_r_dot = signals.nu_d_dot - signals.nu_c_dot - signals.w  # w has the desired impedance and K_f (tau_c - F_d)
        tau_cmd[:] = signals.C_nu_r + signals.D_nu_r + signals.g_eta - signals.tau_dist - signals.tau_contact_m_B
        add_product(signals.M, nu_r_dot, tau_cmd)

    def at_rest(self, setup: SetupLike) -> SteadyState | str:
        """The static balance with s = 0."""
        from ..theory.balance import static_balance

        if not np.array_equal(setup.vehicle.B, setup.nominal.B):
            return "the ideal law does not know the offsets of the thrusters"
        return self._stability(setup).checked(static_balance(setup, np.inf))

    def notes(self, setup: SetupLike) -> Iterator[str]:
        """Warnings if the sampled law vibrates against the wall."""
        return self._stability(setup).notes(self.label())

    def _stability(self, setup: SetupLike) -> "Stability":
        from ..theory.stability import ForceAge, Stability

        return Stability(setup, ForceAge.of(setup, setup.design.M))
