"""First-order sliding mode with a boundary layer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...quantities import NonNegative, Positive
from ..base import Controller, SteadyState, gain
from .terms import add_product, within


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

    def at_rest(self, setup: Any) -> SteadyState | str:
        """The static balance inside the boundary layer."""
        from ..theory.balance import static_balance
        from ..theory.boundary_layer import Layer
        from ..theory.sampled import Vibration, not_constant, zeta_grows

        if reason := not_constant(setup):
            return reason
        if self.K_s == 0.0 and 0.0 in setup.task.A:
            return "with a zero in A and K_s = 0, s drifts"
        if Layer.of(self, setup).chatters:
            return "the sampled first-order law chatters at this step"
        state = zeta_grows(setup) or static_balance(setup, self.K_s / self.epsilon)
        if isinstance(state, SteadyState) and np.abs(np.asarray(state.s)).max() >= self.epsilon:
            return "the first-order law is outside its boundary layer"
        return Vibration.of(setup).checked(state)

    def notes(self, setup: Any) -> Iterator[str]:
        """Warnings if the sampled law chatters, or vibrates against the wall."""
        from ..theory.boundary_layer import Layer, boundary_layer_limit
        from ..theory.input_delay import input_delay_notes
        from ..theory.sampled import Vibration

        period, layer = setup.scenario.control_period, Layer.of(self, setup)
        if period >= (limit := boundary_layer_limit(self, setup)):
            yield (
                f"{self.label()} chatters at a control period of {period:g} s: K_s = {self.K_s:g} and epsilon = "
                f"{self.epsilon:g} need a period below {limit:.4g} s"
            )
        elif layer.chatters:
            yield (
                f"{self.label()} chatters with a velocity every {layer.period:g} s, and velocity and command together "
                f"{layer.late:g} s late: K_s = {self.K_s:g} needs an epsilon above "
                f"{self.epsilon * layer.rate / layer.fastest:.4g}"
            )
        vibration = Vibration.of(setup)
        yield from vibration.notes(self.label())
        yield from input_delay_notes(vibration, self.label(), lambda S: (self.K_s / max(S, self.epsilon), 0.0))
