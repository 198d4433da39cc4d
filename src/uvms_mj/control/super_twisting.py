"""The super-twisting algorithm, generalised and standard, with its theory: rest, sampling at the wall, certificate."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..quantities import NonNegative
from .balance import static_balance
from .base import Controller, gain
from .late_command import late_notes, swing
from .rest import SteadyState
from .sampled import Vibration, disturbance_rate, zeta_grows

if TYPE_CHECKING:
    from .certificate import Certificate

_AMPLITUDES = np.geomspace(1e-5, 2e-2, 30)
"""Amplitudes of s [m/s]. The largest is that of an impact at a few decimetres per second."""
_GROWS = 1e-3
"""A growth rate above this is more than rounding [1/s]."""
_LARGEST_S = 0.15
"""Largest s on the way with which eq. (7) still says where the vehicle goes [m/s or rad/s]."""
_STEP_S, _LONGEST_S = 5e-3, 60.0
"""Step and duration of the computation of s on the way [s]."""


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
        for i in range(6):
            tau_cmd[i] = signals.tau_nom[i] if gains.nominal else 0.0
        for j in range(6):
            s = signals.s[j]
            sgn = np.sign(s)
            root = math.sqrt(abs(s)) * sgn
            phi_1 = root + gains.beta * s
            phi_2 = 0.5 * sgn + 1.5 * gains.beta * root + gains.beta * gains.beta * s
            a = -gains.k_1 * phi_1 + state.z[j]  # eq. (24a)
            state_dot.z[j] = -gains.k_2 * phi_2  # eq. (24b)
            if gains.nominal:
                a -= signals.A[j] * s  # eq. (22); F_2 A F_2^-1 = A for diagonal matrices
            for i in range(6):
                tau_cmd[i] += signals.M_hat[i, j] * a

    def at_rest(self: Any, setup: Any) -> SteadyState | str:
        """The static balance with s = 0, if super-twisting converges."""
        if self.k_1 == 0.0 or self.k_2 == 0.0:
            return "super-twisting does not converge without k_1 and k_2"
        if disturbance_rate(setup).max() >= self.k_2 / 2.0:
            return "the disturbance changes faster than k_2/2, which super-twisting can follow"
        vibration = Vibration.of(setup)
        kept = functools.partial(_kept, self)
        state = zeta_grows(setup) or vibration.checked(static_balance(setup, np.inf, kept=kept))
        if isinstance(state, SteadyState) and 0.0 < 2.0 * state.force < swing(vibration, self.slopes)[0]:
            return "the late command does not hold against this wall"
        return state

    def notes(self: Any, setup: Any) -> Iterator[str]:
        """Warnings if the sampled law vibrates or bounces against the wall."""
        vibration = Vibration.of(setup)
        yield from vibration.notes(self.label())
        yield from late_notes(vibration, self.label(), self.slopes)
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
        from .certificate import Certificate

        return Certificate.of(self.k_1, self.k_2, self.beta, None if self.nominal else min(setup.task.A))


def _kept(law: Any, times: np.ndarray, unknown: np.ndarray) -> str:
    """The reason why s does not stay near zero under unknown accelerations phi (n, 6) at times (n,) [s]: eqs. (24b)
    and (28), each axis by itself, from s = z = 0; empty if it stays."""
    t = np.arange(0.0, min(times[-1], _LONGEST_S), _STEP_S)
    s, z, largest = np.zeros(6), np.zeros(6), 0.0
    p, q = _STEP_S * law.k_1, 1.0 + _STEP_S * law.k_1 * law.beta
    for d in np.array([np.interp(t, times, each) for each in unknown.T]).T:  # implicit Euler: q root^2 + p root = ahead
        ahead = s + _STEP_S * (z + d)
        sgn, root = np.sign(ahead), (np.sqrt(p * p + 4.0 * q * np.abs(ahead)) - p) / (2.0 * q)
        s = sgn * root * root
        z = z - _STEP_S * law.k_2 * (sgn * (0.5 + 1.5 * law.beta * root) + law.beta**2 * s)
        largest = max(largest, float(np.abs(s).max()))
    if largest < _LARGEST_S:
        return ""
    return f"super-twisting does not follow the disturbance on the way: s comes to {largest:.2g} m/s or rad/s"


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
        for i in range(6):
            tau_cmd[i] = signals.tau_nom[i]
        for j in range(6):
            s = signals.s[j]
            a = -gains.k_1 * math.sqrt(abs(s)) * np.sign(s) + state.z[j] - signals.A[j] * s  # eqs. (22), (24a)
            state_dot.z[j] = -0.5 * gains.k_2 * np.sign(s)  # eq. (24b)
            for i in range(6):
                tau_cmd[i] += signals.M_hat[i, j] * a


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
    K_f = np.diag(scenario.impedance.at_end[0][:3])
    A, zero, one = np.diag(setup.task.A[:3]), np.zeros((3, 3)), np.eye(3)
    growing = np.hstack([zero, zero, A, zero])  # A s
    growth = [-math.inf]
    for front, S in itertools.product(setup.fronts, _AMPLITUDES):
        K_c = front.stiffness * np.outer(front.normal[:3], front.normal[:3])
        desired = np.hstack([-np.linalg.solve(M_d, np.hstack([K_f @ K_c + K_d, D_d])), zero, zero])
        free = np.hstack([-np.linalg.solve(M, np.hstack([K_c, setup.vehicle.D_linear[:3, :3]])), zero, zero])
        a, b = law.slopes(S)
        u = g @ np.hstack([zero, zero, -a * one, one])
        v_dot = g @ (desired - growing) + u if law.nominal else free + u
        x_dot, z_dot = np.hstack([zero, one, zero, zero]), np.hstack([zero, zero, -b * one, zero])
        growth.append(np.linalg.eigvals(np.vstack([x_dot, v_dot, growing + v_dot - desired, z_dot])).real.max())
    return float(max(growth))
