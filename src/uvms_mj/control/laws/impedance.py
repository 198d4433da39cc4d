"""Impedance control: the nominal control alone."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..base import Controller, SteadyState

if TYPE_CHECKING:
    from ..theory.stability import Stability


@dataclass(frozen=True)
class Impedance(Controller):
    """Impedance control (23): exact for a perfect model without current and disturbance."""

    name = "impedance"

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.tau_nom  # eq. (23)

    def at_rest(self, setup: Any) -> SteadyState | str:
        """The static balance of eq. (5)."""
        from ..theory.balance import not_constant, static_balance

        return not_constant(setup) or self._stability(setup).checked(static_balance(setup, 0.0))

    def notes(self, setup: Any) -> Iterator[str]:
        """Warnings if the sampled law vibrates against the wall."""
        return self._stability(setup).notes(self.label())

    def _stability(self, setup: Any) -> "Stability":
        from ..theory.stability import ForceAge, Stability

        return Stability(setup, ForceAge.of(setup, setup.design.M_hat))
