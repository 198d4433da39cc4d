"""The first-order law inside its boundary layer, sampled: when it chatters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .latency import ForceLatency


@dataclass(frozen=True)
class Layer:
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
    def of(cls, law: Any, setup: Any) -> Layer:
        scenario, chain = setup.scenario, ForceLatency.of(setup)
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


def boundary_layer_limit(law: Any, setup: Any) -> float:
    """Largest control period at which the first-order law does not chatter inside its boundary layer [s].

    In the layer, s_dot = -(M^-1 M_hat K_s/epsilon - A) s + ... With explicit sampling this is stable if the period is
    below 2 divided by the fastest rate.
    """
    rate = _rate(law, setup)
    return 2.0 / rate if rate > 0 else np.inf


def _rate(law: Any, setup: Any) -> float:
    gain = np.linalg.solve(setup.design.M, setup.design.M_hat) * law.K_s / law.epsilon
    return float(np.abs(np.linalg.eigvals(gain - np.diag(setup.task.A))).max())
