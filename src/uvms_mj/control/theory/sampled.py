"""Limits of a sampled loop: measurements and a command that are held against the wall, and zeta of eq. (15).

The limits take the run's :class:`uvms_mj.setup.base.Setup`.
"""

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import Fault
from ...physics.flow import rate_deviation
from ..base import SteadyState
from .latency import ForceLatency

SLOWLY_DAMPED = 0.75
"""If more than this fraction of the damping against the wall is lost, a vibration lasts for many seconds."""


@dataclass(frozen=True)
class Vibration:
    """The vibration of a vehicle against a wall under a sampled law, along v = G K_f n.

    Against a spring k_c, feedback of the contact force with unit gain and age T acts as a negative damping k_c T. The
    sliding mode laws impose M_d and D_d on any vehicle: G, the matrix before D_d v in v_dot, is M_d^-1. The laws
    impedance and ideal answer to the contact force with their own M as well: G is M^-1 M_hat M_d^-1, and they feed back
    only M M_d^-1 K_f - I, which is inertia shaping, eq. (4).

    Attributes:
        setup: the run's :class:`uvms_mj.setup.base.Setup`.
        contact: one of ``setup.contacts_at_rest``, or None without any.
        shaped: whether the law answers to the contact force through its own inertia, as impedance and ideal do.
        compliant: n^T v [1/kg]. Without a positive one there is no such vibration.
        fed_back: part of it that the law feeds back [1/kg].
        damping: n^T G D_d v / n^T v [1/s].
        stiffness: n^T G K_d v / n^T v [1/s^2].
    """

    setup: Any
    contact: Any = None
    shaped: bool = False
    compliant: float = 0.0
    fed_back: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0

    @classmethod
    def of(cls, setup: Any, M_hat: np.ndarray | None = None) -> "Vibration":
        """The vibration under a law that imposes M_d, or that answers through its own inertia with M_hat (6, 6): that
        of the contact that is damped worst."""
        found = [cls._at(setup, contact, M_hat) for contact in setup.contacts_at_rest]
        return max(found, key=lambda each: (each.growth > 1.0, -each.limit), default=cls(setup))

    @classmethod
    def _at(cls, setup: Any, contact: Any, M_hat: np.ndarray | None) -> "Vibration":
        design = setup.design
        n, M_d_inv = contact.normal, design.M_d_inv
        G = M_d_inv if M_hat is None else np.linalg.solve(design.M, M_hat @ M_d_inv)
        v = G @ (np.array(setup.scenario.impedance.at_end[0]) * n)
        compliant = float(n @ v)
        fed_back = compliant - (0.0 if M_hat is None else 1.0 / design.along_normal(design.M, n))
        if compliant <= 0.0:
            return cls(setup, contact, M_hat is not None, compliant, fed_back)
        damping, stiffness = float(n @ G @ design.D_d @ v) / compliant, float(n @ G @ design.K_d @ v) / compliant
        return cls(setup, contact, M_hat is not None, compliant, fed_back, damping, stiffness)

    @property
    def limit(self) -> float:
        """Largest mean age of the fed back contact force at which the contact stays damped [s]; see :attr:`age`.

        For a sliding mode law and a wall with the damping b_c it is (D_d/K_f + b_c)/k_c. For M_d < M, inertia shaping
        takes (M/M_d - 1) k_c T from a damping of M/M_d (D_d + b_c).
        """
        if self.compliant <= 0.0 or self.fed_back <= 1e-9 * self.compliant:
            return np.inf
        contact = self.contact
        return (self.damping + self.compliant * contact.damping) / (self.fed_back * contact.stiffness)

    @functools.cached_property
    def chain(self) -> ForceLatency:
        """What holds or delays the contact force on its way to tau."""
        return ForceLatency.of(self.setup)

    @property
    def age(self) -> float:
        """Mean age of the contact force that acts as negative damping [s].

        For a law that answers through its own inertia it is the age of the force in tau. A sliding mode law takes s to
        zero in its own loop, in which the force and the velocity are of the same instant: only the age of the
        measurements counts, and :mod:`.input_delay` has the limits of a late command. The contact force itself is held
        for a time step h. A law that runs at every step on measurements of every step feeds back the force that acts.
        """
        return self.chain.mean if self.shaped else self.chain.measured

    @property
    def growth(self) -> float:
        """Growth of the vibration under a held command [1], in the longest period; 0 for a law that imposes M_d.

        Between two instants

            a = -w^2 x + u_k,    u_k = -(stiffness + fed back k_c) x_k - damping v_k,    w^2 = k_c n^T M^-1 n,

        which symplectic Euler takes over the steps of a period: the spectral radius of Phi + Gamma (du/dx, du/dv).
        Above 1 the vibration grows. The hold of D_d alone has this effect if the contact makes half a vibration in a
        period.
        """
        if not self.shaped or self.compliant <= 0.0:
            return 0.0
        scenario, design = self.setup.scenario, self.setup.design
        h, k_c = scenario.simulation.timestep, self.contact.stiffness
        gains = [self.stiffness + self.fed_back * k_c, self.damping]
        stiff = h * k_c * (1.0 / design.along_normal(design.M, self.contact.normal))  # h w^2
        step, force = np.array([[1.0 - h * stiff, h], [-stiff, 1.0]]), np.array([h * h, h])
        period = round(self.chain.periods[self.chain.longest] / h)
        whole, rest = divmod(round(self.chain.constant / h), period)
        old, new = (_held(step, force, steps) for steps in (rest, period - rest))
        free = np.linalg.matrix_power(step, period)
        # the state and the last commands u_(k-1), u_(k-2), ..., two of which act in a period
        commands = np.zeros((2, whole + 2))
        commands[:, whole + 1] = np.linalg.matrix_power(step, period - rest) @ old
        commands[:, whole] = new
        change = np.zeros((whole + 3, whole + 3))
        change[:2, :2], change[:2, 2:] = free, commands[:, 1:]
        change[:2, :2] -= np.outer(commands[:, 0], gains)
        change[2, :2] = -np.array(gains)
        for i in range(3, whole + 3):
            change[i, i - 1] = 1.0
        return float(np.abs(np.linalg.eigvals(change)).max())

    def checked(self, state: SteadyState | str) -> SteadyState | str:
        """The state at rest, or the reason why the sampled law does not come to rest against the wall."""
        if isinstance(state, SteadyState) and state.force > 0.0:
            if self.age >= self.limit:
                return f"the sampled law limit-cycles against this wall: {self._comparison()}"
            if self.growth > 1.0:
                return "the held command does not damp the vibration against this wall"
        return state

    def _comparison(self) -> str:
        return (
            f"the fed back contact force is {1e3 * self.age:.3g} ms old on average, and all of the damping is lost at "
            f"(D_d/K_f + b_c)/k_c = {1e3 * self.limit:.3g} ms"
        )

    def notes(self, label: str) -> Iterator[str]:
        """Warnings if the sampled law damps the vibration slowly, or not at all."""
        if self.contact is None:
            return
        chain, limit, age, k_c = self.chain, self.limit, self.age, self.contact.stiffness
        key, period = self.contact.key, chain.periods[chain.longest]
        here = f"at {'an' if chain.longest == 'actuation' else 'a'} {chain.longest} period of {period:g} s"
        if self.growth > 1.0:
            w = np.sqrt(k_c / self.setup.design.along_normal(self.setup.design.M, self.contact.normal))
            yield (
                f"{label} oscillates against the wall {here}: at {key}.stiffness {k_c:g} "
                f"N/m the contact vibrates faster than a held command can damp; a period below {2.5 / w:.2g} s usually "
                "suffices"
            )
        if age > SLOWLY_DAMPED * limit or (age == limit == 0.0):
            what = "limit-cycles against the wall" if age >= limit else "hardly damps the vibration against the wall"
            share = f"{min(1.0, age / limit) if limit else 1.0:.0%} of the damping D_d is lost"
            delay, longest = max(chain.delays.items(), key=lambda each: each[1])
            if longest > max(chain.holds.values()):
                here = f"with the {delay} of {longest:.4g} s"
            lost = 2.0 * (limit - chain.constant) + chain.timestep
            why = f"it holds the contact force so long that {share} at {key}.stiffness {k_c:g} N/m"
            yield f"{label} {what} {here}: {why}" + (f"; all is lost at a period of {lost:.4g} s" if lost > 0.0 else "")
            if age > 0.0:
                yield (
                    f"{self._comparison()}. Its parts: {chain.parts()}. It takes less of the largest part, or a wall, "
                    f"or a bumper before it, of less than {k_c * limit / age:.3g} N/m in all"
                )


def _held(step: np.ndarray, force: np.ndarray, steps: int) -> np.ndarray:
    """Effect (2,) on position and velocity of a command that is held for a number of time steps."""
    return np.linalg.solve(np.eye(2) - step, (np.eye(2) - np.linalg.matrix_power(step, steps)) @ force)


MOST_WAITING = 1000
"""Control periods that a computation delay may last."""


def delay_faults(scenario: Any) -> Iterator[Fault]:
    """Errors in the computation delay: it is a multiple of the time step, and not too many control periods long."""
    h, delay = scenario.simulation.timestep, scenario.controller.delay
    if delay is None:
        return
    if abs(delay / h - round(delay / h)) > 1e-6:
        n = int(delay / h)
        nearest = f"the nearest are {n * h:g} and {(n + 1) * h:g} s"
        yield Fault("controller.delay", f"{delay:g} s is not a multiple of the time step {h:g} s; {nearest}")
    elif delay > MOST_WAITING * scenario.control_period * (1.0 + 1e-9):
        longest = f"{MOST_WAITING} control periods of {scenario.control_period:g} s"
        yield Fault(
            "controller.delay", f"{delay:g} s must be at most {MOST_WAITING * scenario.control_period:g} s, {longest}"
        )


def zeta_limit(setup: Any) -> float:
    """Control period above which the explicit Euler steps of zeta, eq. (15), grow: |1 + A T| > 1 [s]."""
    fastest = max(abs(a) for a in setup.task.A)
    return 2.0 / fastest if fastest > 0.0 else np.inf


def zeta_grows(setup: Any) -> str:
    """The reason why there is no rest if zeta grows at the control period; empty if it does not."""
    grows = setup.scenario.control_period > zeta_limit(setup)
    return "the sampled zeta, eq. (15), grows without bound at this control period" if grows else ""


def disturbance_rate(setup: Any) -> np.ndarray:
    """Bound (6,) on the rate of M_hat^-1 tau_dist, which eq. (28) has to follow [m/s^3, rad/s^3]. Of a Gauss-Markov
    process it is the rate that one in 5e8 of its nodes exceeds. The drag of a tether is not in it."""
    disturbance = setup.scenario.disturbance
    rate = 2.0 * np.pi * np.abs(np.array(disturbance.amplitude) * np.array(disturbance.frequency_hz))
    if disturbance.table is not None:
        table = np.array(disturbance.table)
        rate += np.abs(np.diff(table[:, 1:], axis=0) / np.diff(table[:, :1], axis=0)).max(axis=0, initial=0.0)
    if any(disturbance.deviation):
        rate += 6.0 * rate_deviation(np.array(disturbance.deviation), disturbance.correlation_time, disturbance.spacing)
    return np.abs(np.linalg.inv(setup.design.M_hat)) @ rate


def not_constant(setup: Any) -> str:
    """The reason why a law without an integral term does not rest under a disturbance; empty if it is constant."""
    return "the disturbance is not constant" if disturbance_rate(setup).any() else ""
