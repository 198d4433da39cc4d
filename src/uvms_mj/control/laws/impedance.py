"""Impedance control: the nominal control alone."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ..base import Controller, SteadyState


@dataclass(frozen=True)
class Impedance(Controller):
    """Impedance control (23): exact for a perfect model without current and disturbance."""

    name = "impedance"

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.tau_nom  # eq. (23)

    def at_rest(self, setup: Any) -> SteadyState | str:
        """The static balance of eq. (5)."""
        from ..theory.balance import static_balance
        from ..theory.sampled import Vibration, not_constant

        return not_constant(setup) or Vibration.of(setup, setup.design.M_hat).checked(static_balance(setup, 0.0))

    def notes(self, setup: Any) -> Iterator[str]:
        """Warnings if the sampled law vibrates against the wall."""
        from ..theory.sampled import Vibration

        return Vibration.of(setup, setup.design.M_hat).notes(self.label())
