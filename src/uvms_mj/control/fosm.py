"""First-order sliding mode with a boundary layer."""

from __future__ import annotations

from dataclasses import dataclass

from .base import Controller, NonNegative, Positive, gain


@dataclass(frozen=True)
class Fosm(Controller):
    """First-order sliding mode impedance control (31)-(32), with a saturated linear term instead of the sign."""

    K_s: NonNegative = gain(19.0, "m/s^2, rad/s^2", "switching gain, eq. (31)")
    epsilon: Positive = gain(1e-3, "m/s, rad/s", "width of the boundary layer, eq. (31)")

    name = "fosm"

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            tau_cmd[i] = signals.tau_nom[i]
        for j in range(6):
            sat = min(1.0, max(-1.0, signals.s[j] / gains.epsilon))  # eq. (32)
            for i in range(6):
                tau_cmd[i] -= signals.M_hat[i, j] * gains.K_s * sat  # eq. (31)
