"""The super-twisting algorithm, generalised and standard."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ...physics.kernels import called_on, kernel
from ...quantities import NonNegative
from ...stages.setup import SetupLike
from ..base import Controller, SteadyState, gain
from .terms import add_product

if TYPE_CHECKING:
    from ..theory.certificate import Certificate
    from ..theory.stability import Stability

_LARGEST_S = 0.15
"""Largest s on the way with which eq. (7) still says where the vehicle goes [m/s or rad/s]."""
_STEP_S, _LONGEST_S = 5e-3, 60.0
"""Step and duration of the computation of s on the way [s]."""
_BIASED = 1e-3
"""Shift of the mean push, over the push or 1 N, from which there is no closed form [1]."""
_STARTS, _PERIODS = 200, 1500
"""Starts of the sampled axis, and control periods until its chatter lasts, and over which its mean is taken."""
_MOST_STEPS = round(_LONGEST_S / _STEP_S) + 1
_AXIS = np.dtype([(name, "f8") for name in ("k_1", "k_2", "beta", "period", "largest")], align=True)
"""The gains of one axis, and the largest result."""


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

    def at_rest(self: Any, setup: SetupLike) -> SteadyState | str:
        """The static balance with s = 0, if super-twisting converges."""
        from ..theory.balance import disturbance_rate, static_balance
        from ..theory.stability import zeta_grows

        if self.k_1 == 0.0 or self.k_2 == 0.0:
            return "super-twisting does not converge without k_1 and k_2"
        if disturbance_rate(setup).max() >= self.k_2 / 2.0:
            return "the disturbance changes faster than k_2/2, which super-twisting can follow"
        kept = functools.partial(_kept_near_zero, self)
        state = zeta_grows(setup) or _stability(setup).checked(static_balance(setup, np.inf, kept=kept))
        bias = _chatter_bias(self, setup) if isinstance(state, SteadyState) and state.force > 0.0 else 0.0
        if isinstance(state, SteadyState) and bias > _BIASED * max(1.0, state.force):
            return f"the chatter of the sampled law shifts the mean push by up to {bias:.2g} N"
        return state

    def notes(self: Any, setup: SetupLike) -> Iterator[str]:
        """Warnings if the sampled law vibrates or bounces against the wall, its chatter shifts the push, or waves are
        faster than it follows."""
        from ..design import demanded_force
        from ..theory.waves import sea_rate

        rates = sea_rate(setup)
        if (rate := float(rates.max())) >= self.k_2 / 2.0:
            worst = int(rates.argmax())
            yield (
                f"the waves push the vehicle at rest with M_hat^-1 tau_sea, which changes by up to {rate:.3g} "
                f"{'m/s^3' if worst < 3 else 'rad/s^3'} in {'XYZKMN'[worst]}, faster than k_2/2 = {self.k_2 / 2.0:g}: "
                "s may leave zero there"
            )
        yield from _stability(setup).notes(self.label())
        bias, force = _chatter_bias(self, setup), demanded_force(setup.scenario)
        if bias > _BIASED * max(1.0, force if math.isfinite(force) else 0.0):
            yield (
                f"the chatter of {self.label()} at a control period of {setup.scenario.control_period:g} s shifts the "
                f"mean of s, and the mean push by up to {bias:.2g} N: it falls with the square of the period"
            )

    def certificate(self: Any, setup: SetupLike) -> Certificate:
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
    at_rest, notes, certificate = Gsta.at_rest, Gsta.notes, Gsta.certificate

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        s, sgn = signals.s, np.sign(signals.s)
        a = -gains.k_1 * np.sqrt(np.abs(s)) * sgn + state.z - signals.A * s  # eqs. (22), (24a)
        state_dot.z[:] = -0.5 * gains.k_2 * sgn  # eq. (24b)
        tau_cmd[:] = signals.tau_nom
        add_product(signals.M_hat, a, tau_cmd)


def _stability(setup: SetupLike) -> Stability:
    from ..theory.stability import ForceAge, Stability

    return Stability(setup, ForceAge.of(setup), layer=0.0)


@functools.lru_cache(maxsize=64)
def mean_of_chatter(k_1: float, k_2: float, beta: float, period: float) -> float:
    """Largest mean of s [m/s or rad/s] in the chatter of one axis of eqs. (24) and (28), sampled by explicit Euler:

    s' = s + T (-k_1 phi_1(s) + z), z' = z - T k_2 phi_2(s).

    With beta = 0 it is the same for every T in the coordinates s / T^2 and z / T. The chatter depends on where it
    begins, since z has steps of k_2 T / 2: the result is the largest one of many starts. A constant disturbance shifts
    z alone."""
    rng, starts, axis = np.random.default_rng(0), np.zeros((_STARTS, 2)), np.zeros(1, _AXIS)
    starts[:, 0] = k_1 * k_1 * period * period * rng.uniform(-3.0, 3.0, _STARTS)
    starts[:, 1] = k_2 * period * rng.uniform(-3.0, 3.0, _STARTS)
    axis["k_1"], axis["k_2"], axis["beta"], axis["period"] = k_1, k_2, beta, period
    called_on(_chattering, axis, starts)(_STARTS)
    return float(axis["largest"][0] / _PERIODS)


@kernel
def _chattering(axis, starts, count):
    """Set the largest sum of s over the chatter of the starts (count, 2), s and z."""
    k_1, k_2, beta, period = axis.k_1, axis.k_2, axis.beta, axis.period
    for n in range(count):
        s, z, total = starts[n, 0], starts[n, 1], 0.0
        for i in range(2 * _PERIODS):
            sgn = np.sign(s)
            root = math.sqrt(abs(s)) * sgn
            rate = -k_1 * (root + beta * s) + z
            z -= period * k_2 * (0.5 * sgn + 1.5 * beta * root + beta * beta * s)
            s += period * rate
            if i >= _PERIODS:
                total += s
        if math.isnan(total) or abs(total) > axis.largest:
            axis.largest = abs(total)


@kernel
def _followed(axis, unknown, steps):
    """Set the largest s of the axes under unknown accelerations (steps, 6)."""
    s, z, k_1, k_2, beta = np.zeros(6), np.zeros(6), axis.k_1, axis.k_2, axis.beta
    p, q = _STEP_S * k_1, 1.0 + _STEP_S * k_1 * beta
    for n in range(steps):  # implicit Euler: q root^2 + p root = ahead
        for i in range(6):
            ahead = s[i] + _STEP_S * (z[i] + unknown[n, i])
            sgn, root = np.sign(ahead), (math.sqrt(p * p + 4.0 * q * abs(ahead)) - p) / (2.0 * q)
            s[i] = sgn * root * root
            z[i] -= _STEP_S * k_2 * (sgn * (0.5 + 1.5 * beta * root) + beta * beta * s[i])
            axis.largest = max(axis.largest, abs(s[i]))


def _chatter_bias(law: Any, setup: SetupLike) -> float:
    """Bound on the shift of the mean push by chatter [N]: A s = -w with the mean of s, so that each contact yields M_d
    A s along its normal."""
    with np.errstate(all="ignore"):
        s = mean_of_chatter(law.k_1, law.k_2, law.beta, setup.scenario.control_period)
    wrench = np.abs(setup.design.M_d) @ np.abs(np.array(setup.task.A)) * s
    normals = [np.abs(contact.normal) for contact in setup.contacts_at_rest]
    bound = max((float(normal @ wrench) for normal in normals), default=0.0)
    return bound if math.isfinite(bound) else math.inf


def _kept_near_zero(law: Any, times: np.ndarray, unknown: np.ndarray) -> str:
    """The reason why s does not stay near zero under unknown accelerations phi (n, 6) at times (n,) [s]: eqs. (24b)
    and (28), each axis by itself, from s = z = 0; empty if it stays."""
    t = np.arange(0.0, min(times[-1], _LONGEST_S), _STEP_S)
    rows, axis = np.zeros((_MOST_STEPS, 6)), np.zeros(1, _AXIS)
    rows[: len(t)] = np.array([np.interp(t, times, each) for each in unknown.T]).T
    axis["k_1"], axis["k_2"], axis["beta"] = law.k_1, law.k_2, law.beta
    called_on(_followed, axis, rows)(len(t))
    largest = float(axis["largest"][0])
    if largest < _LARGEST_S:
        return ""
    return f"super-twisting does not follow the disturbance on the way: s comes to {largest:.2g} m/s or rad/s"
