r"""Adaptive integral sliding mode impedance control."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ...quantities import NonNegative
from ...stages.setup import SetupLike
from ..base import Controller, NonNegativeDiagonal, PositiveDiagonal, SteadyState, gain
from .terms import add_product, integral_residual, within

RESTS_AT = 0.5
"""Share of the boundary layer at which the gain is at rest: K is then twice the disturbance [1]."""

if TYPE_CHECKING:
    from ..theory.stability import Stability


@dataclass(frozen=True)
class Aismc(Controller):
    r"""Adaptive integral sliding mode impedance control: the switching gain follows the size of the disturbance.

    .. math::

        \tau = \tau_{nom} - \hat M K \, sat(\sigma / \epsilon), \qquad
        \dot K_i = \gamma (|\sigma_i| - \tfrac12 \epsilon_i), \quad K_0 \le K_i \le K_{max,i}

    with the integral sliding variable sigma of :mod:`.terms`. At rest K_i sat(sigma_i / epsilon_i) is
    the unknown acceleration varphi_i, and sigma_i = epsilon_i / 2 with K_i = 2 |varphi_i|, or K_i = K_0 if this
    suffices. Either way sigma is constant, so that eq. (7) holds. The gain grows outside half of the boundary layer and
    decreases inside, as in the adaptation without overestimation of Plestan, Shtessel, Bregeault and Poznyak (2010, New
    methodologies for adaptive sliding mode control); their rate of K jumps at the threshold, this one does not. The
    integral sliding variable is after Utkin and Shi (1996).
    """

    K_0: NonNegative = gain(0.2, "m/s^2, rad/s^2", "least switching gain, and the gain at the start")
    K_max: NonNegativeDiagonal = gain(
        (3.0, 3.0, 3.0, 12.0, 12.0, 12.0), "m/s^2, rad/s^2", "greatest switching gain of each axis"
    )
    rate: NonNegative = gain(1000.0, "1/s^2", "gamma, rate of the adaptation")
    epsilon: PositiveDiagonal = gain(
        (0.02, 0.02, 0.02, 0.1, 0.1, 0.1), "m/s, rad/s", "width of the boundary layer of each axis"
    )

    name = "aismc"
    states: ClassVar = {"nu_hat": 6, "K": 6, "sigma": 6}
    units: ClassVar = {"nu_hat": "m/s, rad/s", "K": "m/s^2, rad/s^2", "sigma": "m/s, rad/s"}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        sigma = state.sigma
        integral_residual(signals, state.nu_hat, state_dot.nu_hat, sigma)
        state.K[:] = np.minimum(gains.K_max, np.maximum(gains.K_0, state.K))
        state_dot.K[:] = gains.rate * (np.abs(sigma) - RESTS_AT * gains.epsilon)
        tau_cmd[:] = signals.tau_nom
        add_product(signals.M_hat, -state.K * within(sigma / gains.epsilon, 1.0), tau_cmd)

    def at_rest(self, setup: SetupLike) -> SteadyState | str:
        """The static balance with eq. (7), if the switching gain exceeds the disturbance."""
        from ..theory.balance import static_balance, unmodelled_acceleration
        from ..theory.terms import Balance

        state = static_balance(setup, np.inf, Balance.demanded)
        if isinstance(state, str):
            return state
        phi, K = unmodelled_acceleration(setup, state), np.full(6, self.K_0)
        if self.rate:
            K = np.minimum(self.K_max, np.maximum(K, np.abs(phi) / RESTS_AT))
        if (np.abs(phi) >= K).any():
            return "the disturbance is larger than the switching gain can balance"
        return self._stability(setup, self._greatest()).checked(self._stability(setup, K).checked(state))

    def notes(self, setup: SetupLike) -> Iterator[str]:
        """Warnings if the sampled law chatters with its greatest gain. It then keeps this gain."""
        return self._stability(setup, self._greatest()).notes(f"{self.label()}, if its switching gain grows to K_max,")

    def _greatest(self) -> np.ndarray:
        return np.array(self.K_max) if self.rate else np.full(6, self.K_0)

    def _stability(self, setup: SetupLike, K: np.ndarray) -> Stability:
        """The law linear in the inner half of the boundary layer, with a switching gain (6,)."""
        from ..theory.stability import Stability

        inner = -0.25 * np.array(self.epsilon)
        return Stability(setup, about=(("K", tuple((0.999 * K).tolist())), ("nu_hat", tuple(inner.tolist()))))
