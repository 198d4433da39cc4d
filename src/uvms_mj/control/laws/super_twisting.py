"""The super-twisting algorithm, generalised and standard."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ...quantities import NonNegative
from ..base import Controller, SteadyState, gain
from .terms import add_product

if TYPE_CHECKING:
    from ..theory.certificate import Certificate

_GROWS = 1e-3
"""A growth rate above this is more than rounding [1/s]."""


@dataclass(frozen=True)
class Gsta(Controller):
    """Super-twisting impedance control (22)-(24): a continuous input that rejects disturbances of bounded rate."""

    k_1: NonNegative = gain(5.0, "m^(1/2)/s^(3/2)", "gain of phi_1, eq. (24a)")
    k_2: NonNegative = gain(10.0, "m/s^3", "gain of phi_2, eq. (24b)")
    beta: NonNegative = gain(5.0, "(s/m)^(1/2)", "linear part of phi_1 and phi_2; 0 gives the standard super-twisting")
    nominal: bool = gain(True, "-", "false: only the GSTA term, without the nominal control (23) and F_2 A F_2^-1 s")

    name = "gsta"
    states: ClassVar = {"z": 6}
    units: ClassVar = {"z": "m/s^2, rad/s^2"}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        s, sgn = signals.s, np.sign(signals.s)
        root = np.sqrt(np.abs(s)) * sgn
        phi_1 = root + gains.beta * s
        phi_2 = 0.5 * sgn + 1.5 * gains.beta * root + gains.beta * gains.beta * s
        a = -gains.k_1 * phi_1 + state.z  # eq. (24a)
        state_dot.z[:] = -gains.k_2 * phi_2  # eq. (24b)
        tau_cmd[:] = 0.0
        if gains.nominal:
            a -= signals.A * s  # eq. (22); F_2 A F_2^-1 = A for diagonal matrices
            tau_cmd[:] = signals.tau_nom
        add_product(signals.M_hat, a, tau_cmd)

    def at_rest(self: Any, setup: Any) -> SteadyState | str:
        """The static balance with s = 0, if super-twisting converges."""
        from ..theory.balance import static_balance
        from ..theory.input_delay import swing
        from ..theory.sampled import Vibration, disturbance_rate, zeta_grows
        from ..theory.super_twisting import kept_near_zero

        if self.k_1 == 0.0 or self.k_2 == 0.0:
            return "super-twisting does not converge without k_1 and k_2"
        if disturbance_rate(setup).max() >= self.k_2 / 2.0:
            return "the disturbance changes faster than k_2/2, which super-twisting can follow"
        vibration = Vibration.of(setup)
        kept = functools.partial(kept_near_zero, self)
        state = zeta_grows(setup) or vibration.checked(static_balance(setup, np.inf, kept=kept))
        if isinstance(state, SteadyState) and 0.0 < 2.0 * state.force < swing(vibration, self.slopes)[0]:
            return "the late command does not hold against this wall"
        return state

    def notes(self: Any, setup: Any) -> Iterator[str]:
        """Warnings if the sampled law vibrates or bounces against the wall."""
        from ..theory.input_delay import input_delay_notes
        from ..theory.sampled import Vibration
        from ..theory.super_twisting import bouncing_growth

        vibration = Vibration.of(setup)
        yield from vibration.notes(self.label())
        yield from input_delay_notes(vibration, self.label(), self.slopes)
        if bouncing_growth(self, setup) > _GROWS:
            yield (
                f"{self.label()} may bounce or oscillate against the wall without end: with these gains and "
                "estimates it compensates the contact force too late"
            )

    def slopes(self: Any, S: float) -> tuple[float, float]:
        """Slopes of k_1 phi_1 and k_2 phi_2 for an amplitude S of s [1/s, 1/s^2]."""
        return self.k_1 * (S**-0.5 + self.beta), self.k_2 * (0.5 / S + 1.5 * self.beta * S**-0.5 + self.beta**2)

    def certificate(self: Any, setup: Any) -> Certificate:
        """The certificate of the gains, for the worst axis."""
        from ..theory.certificate import Certificate

        return Certificate.of(self.k_1, self.k_2, self.beta, None if self.nominal else min(setup.task.A))


@dataclass(frozen=True)
class Sta(Controller):
    """Standard super-twisting impedance control: (22)-(24) with beta = 0, without the linear terms of the GSTA."""

    k_1: NonNegative = gain(5.0, "m^(1/2)/s^(3/2)", "gain of phi_1 = |s|^(1/2) sgn(s)")
    k_2: NonNegative = gain(10.0, "m/s^3", "gain of phi_2 = sgn(s)/2")

    name = "sta"
    states: ClassVar = {"z": 6}
    units: ClassVar = {"z": "m/s^2, rad/s^2"}
    beta: ClassVar = 0.0
    nominal: ClassVar = True
    at_rest, notes, certificate, slopes = Gsta.at_rest, Gsta.notes, Gsta.certificate, Gsta.slopes

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        s, sgn = signals.s, np.sign(signals.s)
        a = -gains.k_1 * np.sqrt(np.abs(s)) * sgn + state.z - signals.A * s  # eqs. (22), (24a)
        state_dot.z[:] = -0.5 * gains.k_2 * sgn  # eq. (24b)
        tau_cmd[:] = signals.tau_nom
        add_product(signals.M_hat, a, tau_cmd)
