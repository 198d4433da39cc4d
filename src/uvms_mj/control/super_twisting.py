"""Theory of super-twisting, generalised and standard: rest, sampling against the wall, certificate.

The functions are methods of :class:`.gsta.Gsta` and :class:`.sta.Sta`. Standard super-twisting has beta = 0 and always
contains the nominal control.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from .balance import static_balance
from .rest import SteadyState
from .sampled import Vibration, disturbance_rate, zeta_grows

if TYPE_CHECKING:
    from .certificate import Certificate

_AMPLITUDES = np.geomspace(1e-5, 2e-2, 30)
"""Amplitudes of s [m/s]. The largest is that of an impact at a few decimetres per second."""
_GROWS = 1e-3
"""A growth rate above this is more than rounding [1/s]."""


def at_rest(self: Any, setup: Any) -> SteadyState | str:
    """The static balance with s = 0, if super-twisting converges."""
    if self.k_1 == 0.0 or self.k_2 == 0.0:
        return "super-twisting does not converge without k_1 and k_2"
    if disturbance_rate(setup).max() >= self.k_2 / 2.0:
        return "the disturbance changes faster than k_2/2, which super-twisting can follow"
    return zeta_grows(setup) or Vibration.of(setup).checked(static_balance(setup, np.inf))


def notes(self: Any, setup: Any) -> Iterator[str]:
    """Warnings if the sampled law vibrates or bounces against the wall."""
    yield from Vibration.of(setup).notes(self.label())
    if bouncing_growth(self, setup) > _GROWS:
        yield (
            f"{self.label()} may bounce or oscillate against the wall without end: with these gains and "
            "estimates it compensates the contact force too late"
        )


def certificate(self: Any, setup: Any) -> "Certificate":
    """The certificate of the gains, for the worst axis."""
    from .certificate import Certificate

    beta, nominal = getattr(self, "beta", 0.0), getattr(self, "nominal", True)
    return Certificate.of(self.k_1, self.k_2, beta, None if nominal else min(setup.task.A))


def bouncing_growth(law: Any, setup: Any) -> float:
    """Largest growth rate, over the amplitude of s, of a vibration against the wall under super-twisting [1/s].

    With the nominal control, the vehicle's response to a contact force is g = M^-1 M_hat times the one that M_d
    prescribes; without it, M_d/M times. If this is too small, super-twisting has to supply the rest at the contact's
    frequency. For an amplitude S, phi_1 and phi_2 have the slopes a = k_1 (S^(-1/2) + beta) and
    b = k_2 (1/(2 S) + 3/2 beta S^(-1/2) + beta^2). With K_c = k_c n n^T along the wall's normal, linearized at rest
    and for translation only,

        v_des_dot = -M_d^-1 ((K_f K_c + K_d) x + D_d v),    s_dot = A s + v_dot - v_des_dot,    z_dot = -b s,
        v_dot = g (v_des_dot - A s - a s + z), or without nominal control  -M^-1 (K_c x + D v) + g (z - a s).

    A positive value means that a vibration grows if it begins large enough; a small one always decays.
    """
    scenario, design = setup.scenario, setup.design
    M, M_d, D_d, K_d = (each[:3, :3] for each in (design.M, design.M_d, design.D_d, design.K_d))
    g = scenario.estimates.inertia * np.eye(3)
    if setup.vehicle is not setup.nominal:
        g = np.linalg.solve(M, design.M_hat[:3, :3])
    beta, n = getattr(law, "beta", 0.0), design.normal[:3]
    K_c, K_f = scenario.wall.stiffness * np.outer(n, n), np.diag(scenario.impedance.K_f[:3])
    A, zero, one = np.diag(setup.task.A[:3]), np.zeros((3, 3)), np.eye(3)
    desired = np.hstack([-np.linalg.solve(M_d, np.hstack([K_f @ K_c + K_d, D_d])), zero, zero])
    free = np.hstack([-np.linalg.solve(M, np.hstack([K_c, setup.vehicle.D_linear[:3, :3]])), zero, zero])
    growing = np.hstack([zero, zero, A, zero])  # A s
    growth = []
    for S in _AMPLITUDES:
        a, b = law.k_1 * (S**-0.5 + beta), law.k_2 * (0.5 / S + 1.5 * beta * S**-0.5 + beta**2)
        u = g @ np.hstack([zero, zero, -a * one, one])
        v_dot = g @ (desired - growing) + u if getattr(law, "nominal", True) else free + u
        x_dot, z_dot = np.hstack([zero, one, zero, zero]), np.hstack([zero, zero, -b * one, zero])
        growth.append(np.linalg.eigvals(np.vstack([x_dot, v_dot, growing + v_dot - desired, z_dot])).real.max())
    return float(max(growth))
