"""First-order sliding mode with a boundary layer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...quantities import NonNegative, Positive
from ...stages.setup import SetupLike
from ..base import Controller, SteadyState, gain
from .terms import add_product, within

if TYPE_CHECKING:
    from ..theory.stability import Stability


@dataclass(frozen=True)
class Fosm(Controller):
    """First-order sliding mode impedance control (31)-(32), with a saturated linear term instead of the sign."""

    K_s: NonNegative = gain(19.0, "m/s^2, rad/s^2", "switching gain, eq. (31)")
    epsilon: Positive = gain(1e-3, "m/s, rad/s", "width of the boundary layer, eq. (31)")

    name = "fosm"

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        sat = within(signals.s / gains.epsilon, 1.0)  # eq. (32)
        tau_cmd[:] = signals.tau_nom
        add_product(signals.M_hat * -gains.K_s, sat, tau_cmd)  # eq. (31)

    def at_rest(self, setup: SetupLike) -> SteadyState | str:
        """The static balance inside the boundary layer."""
        from ..theory.balance import not_constant, static_balance
        from ..theory.stability import zeta_grows

        if reason := not_constant(setup):
            return reason
        if self.K_s == 0.0 and 0.0 in setup.task.A:
            return "with a zero in A and K_s = 0, s drifts"
        stability = self._stability(setup)
        if reason := zeta_grows(setup) or stability.free_reason:
            return reason
        state = static_balance(setup, self.K_s / self.epsilon)
        if isinstance(state, SteadyState) and np.abs(np.asarray(state.s)).max() >= self.epsilon:
            return "the first-order law is outside its boundary layer"
        return stability.checked(state)

    def notes(self, setup: SetupLike) -> Iterator[str]:
        """Warnings if the sampled law chatters, or vibrates against the wall."""
        return self._stability(setup).notes(self.label())

    def _stability(self, setup: SetupLike) -> Stability:
        from ..theory.stability import ForceAge, Stability

        return Stability(setup, ForceAge.of(setup), layer=self.epsilon)
