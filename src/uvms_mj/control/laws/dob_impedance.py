r"""Impedance control with a disturbance observer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...stages.setup import SetupLike
from ..base import Controller, NonNegativeDiagonal, SteadyState, gain
from .terms import add_product, integral_residual


@dataclass(frozen=True)
class DobImpedance(Controller):
    r"""Impedance control (23) with a disturbance observer: the residual of the momentum, a low-pass of the disturbance.

    .. math::

        \tau = \tau_{nom} - \hat d, \qquad
        \hat d = \hat M \Omega \left(\nu - \nu(0) - \int \hat M^{-1} (\tau + \tau_c - \hat C \nu - \hat D \nu - \hat g
            + \hat d) \, dt\right)

    Under this law the integrand is dot nu_d - w, and hat d = M_hat Omega sigma with the sigma of
    :mod:`uvms_mj.control.laws.terms`: the observer is a linear sliding mode law with an integral sliding variable. With
    varphi = M_hat^-1 d, each axis has

    .. math:: \dot\sigma = \varphi - \Omega \sigma, \qquad \frac{d}{dt} \Omega \sigma = \Omega (\varphi - \Omega \sigma)

    After the momentum observer of De Luca and Mattone (2003, Actuator failure detection and isolation using generalized
    momenta), and Chen, Yang, Guo and Li (2016, Disturbance-observer-based control and related methods).
    """

    bandwidth: NonNegativeDiagonal = gain((20.0,) * 6, "1/s", "Omega, bandwidth of the observer of each axis")

    name = "dob_impedance"
    states: ClassVar = {"nu_hat": 6, "sigma": 6, "d_hat": 6}
    units: ClassVar = {"nu_hat": "m/s, rad/s", "sigma": "m/s, rad/s", "d_hat": "N, N m"}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        integral_residual(signals, state.nu_hat, state_dot.nu_hat, state.sigma)
        state.d_hat[:] = 0.0
        add_product(signals.M_hat * gains.bandwidth, state.sigma, state.d_hat)  # M_hat Omega sigma
        tau_cmd[:] = signals.tau_nom - state.d_hat

    def at_rest(self, setup: SetupLike) -> SteadyState | str:
        """The static balance with eq. (7)."""
        from ..theory.balance import not_constant, static_balance
        from ..theory.stability import Stability
        from ..theory.terms import Balance

        if reason := not_constant(setup):
            return reason
        if 0.0 in self.bandwidth:
            return "with a bandwidth of 0 the observer does not reject the disturbance"
        return Stability(setup).checked(static_balance(setup, np.inf, Balance.demanded))

    def notes(self, setup: SetupLike) -> Iterator[str]:
        """Warnings if the sampled law oscillates."""
        from ..theory.stability import Stability

        return Stability(setup).notes(self.label())
