r"""PD+I control of the pose with feed-forward of a desired force. It measures no force."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...quantities import NonNegative
from ...stages.setup import SetupLike
from ..base import Controller, NonNegativeDiagonal, SteadyState, gain
from .terms import add_product, within

_PULLS = 1e-6
"""Spring force from which the integral is at its limit at rest [N, N m]."""


@dataclass(frozen=True)
class Pid(Controller):
    r"""PD+I control of the pose with compensation of weight and buoyancy, and feed-forward of a desired force.

    .. math::

        \tau = \hat g(\eta) - K_f F_d - K_d \tilde\eta - D_d \tilde\nu - \xi, \qquad
        \dot\xi = k_i K_d \tilde\eta, \quad |\xi_i| \le limit_i

    K_d and D_d come from [impedance]. Without the integral it is stiffness control after Salisbury (1980, Active
    stiffness control of a manipulator in Cartesian coordinates); PD control with compensation of gravity is after
    Takegaki and Arimoto (1981).
    """

    k_i: NonNegative = gain(2.0, "1/s", "rate of the integral: xi_dot = k_i K_d eta_e")
    limit: NonNegativeDiagonal = gain((10.0, 10.0, 10.0, 3.0, 3.0, 3.0), "N, N m", "limit of the integral term xi")

    name = "pid"
    uses_task: ClassVar[bool] = False
    states: ClassVar = {"xi": 6}
    units: ClassVar = {"xi": "N, N m"}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        state.xi[:] = within(state.xi, gains.limit)
        spring = signals.K_d * signals.eta_e
        state_dot.xi[:] = gains.k_i * spring
        tau_cmd[:] = signals.g_hat - signals.K_f * signals.F_d - spring - state.xi
        add_product(-signals.D_d, signals.nu_e, tau_cmd)

    def at_rest(self, setup: SetupLike) -> SteadyState | str:
        """On each axis the pose error is zero, or the integral is at its limit. Against a wall in front of the
        reference it is: F = (K_x (x_d - x_c) + limit_x - K_f F_d + d) / (1 + K_x / k_c)."""
        from ..theory import residuals
        from ..theory.balance import static_balance
        from ..theory.stability import Stability
        from ..theory.terms import Integral

        K_d, limit = setup.design.K_d, np.array(self.limit)
        integral = Integral(np.where(self.k_i * K_d.diagonal() > 0.0, limit, 0.0))  # elsewhere xi stays zero

        def residual(balance: Any, x: Any) -> np.ndarray:
            nu, spring = balance.measurement(x).nu, K_d @ balance.error(x)
            measured = balance.resistance(nu) + setup.design.D_d @ nu + integral.not_fed_forward(x)
            xi = -(balance.control_wrench(x) + measured + balance.K_f * balance.F_d + spring)
            return -integral.left(xi, self.k_i * spring)

        def held(state: SteadyState) -> Any:  # at a limit the integral does not answer to small motions
            spring = K_d @ state.contacts.eta_e
            return (("xi", tuple(np.where(np.abs(spring) > _PULLS, 2.0 * np.sign(spring) * limit, 0.0))),)

        compiled = residuals.pid(self.k_i, integral.limit)
        rest = static_balance(setup, 0.0, residual, integral, wrench=np.eye(6), compiled=compiled)
        return Stability(setup, held=held).checked(rest)

    def notes(self, setup: SetupLike) -> Iterator[str]:
        """Warnings if the sampled law oscillates."""
        from ..theory.stability import Stability

        return Stability(setup).notes(self.label())
