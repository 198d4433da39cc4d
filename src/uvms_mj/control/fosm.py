"""First-order sliding mode with a boundary layer."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..quantities import NonNegative, Positive
from .age import ForceAge
from .balance import static_balance
from .base import Controller, gain
from .late_command import late_notes
from .rest import SteadyState
from .sampled import Vibration, not_constant, zeta_grows


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

    def at_rest(self, setup: Any) -> SteadyState | str:
        """The static balance inside the boundary layer."""
        if reason := not_constant(setup):
            return reason
        if self.K_s == 0.0 and 0.0 in setup.task.A:
            return "with a zero in A and K_s = 0, s drifts"
        if _Layer.of(self, setup).chatters:
            return "the sampled first-order law chatters at this step"
        state = zeta_grows(setup) or static_balance(setup, self.K_s / self.epsilon)
        if isinstance(state, SteadyState) and np.abs(np.asarray(state.s)).max() >= self.epsilon:
            return "the first-order law is outside its boundary layer"
        return Vibration.of(setup).checked(state)

    def notes(self, setup: Any) -> Iterator[str]:
        """Warnings if the sampled law chatters, or vibrates against the wall."""
        period, layer = setup.scenario.control_period, _Layer.of(self, setup)
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
        yield from late_notes(vibration, self.label(), lambda S: (self.K_s / max(S, self.epsilon), 0.0))


@dataclass(frozen=True)
class _Layer:
    """The sampled loop of s inside the boundary layer, s_(k+1) = s_k - rate period s_(k-m) with m = late/period.

    Attributes:
        rate: fastest rate of s [1/s].
        period: the longer one of the control period and the time between two velocities [s].
        late: age of a velocity when the law reads it, and of the command when it acts [s].
    """

    rate: float
    period: float
    late: float

    @classmethod
    def of(cls, law: Fosm, setup: Any) -> _Layer:
        scenario, chain = setup.scenario, ForceAge.of(setup)
        own, late = scenario.navigation.velocity_timing
        held = chain.holds["actuation period"] + chain.holds["thruster period"]
        period = max(scenario.control_period, own or scenario.navigation.period or 0.0)
        return cls(_rate(law, setup), period, late + held + chain.delays["computation delay"])

    @property
    def fastest(self) -> float:
        """Rate above which the loop is unstable [1/s].

        On the unit circle z^(m+1) - z^m + rate period = 0 has rate period = 2 sin(pi/(2 (2 m + 1))): 2 for m = 0, and
        pi/(2 late) for a short period.
        """
        return 2.0 * math.sin(0.5 * math.pi / (2.0 * self.late / self.period + 1.0)) / self.period

    @property
    def chatters(self) -> bool:
        return self.rate >= self.fastest


def boundary_layer_limit(law: Fosm, setup: Any) -> float:
    """Largest control period at which the first-order law does not chatter inside its boundary layer [s].

    In the layer, s_dot = -(M^-1 M_hat K_s/epsilon - A) s + ... With explicit sampling this is stable if the period is
    below 2 divided by the fastest rate.
    """
    rate = _rate(law, setup)
    return 2.0 / rate if rate > 0 else np.inf


def _rate(law: Fosm, setup: Any) -> float:
    gain = np.linalg.solve(setup.design.M, setup.design.M_hat) * law.K_s / law.epsilon
    return float(np.abs(np.linalg.eigvals(gain - np.diag(setup.task.A))).max())
