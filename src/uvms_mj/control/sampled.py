"""Limits of a sampled loop: measurements and a command that are held against the wall, and zeta of eq. (15).

The limits take the run's :class:`uvms_mj.analysis.setup.Setup`.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ..errors import Fault
from ..physics.varying import rate_deviation
from .rest import SteadyState

SLOWLY_DAMPED = 0.75
"""If more than this fraction of the damping against the wall is lost, a vibration lasts for many seconds."""


_NO_CONTACT = (False, 0.0, 0.0, 0.0, 0.0)
"""Fields of the vibration of a vehicle without any contact."""


@dataclass(frozen=True)
class Vibration:
    """The vibration of a vehicle against a wall under a sampled law, along v = G K_f n.

    Against a spring k_c, feedback of the contact force with unit gain and age T acts as a negative damping k_c T. The
    sliding mode laws impose M_d and D_d on any vehicle: G, the matrix before D_d v in v_dot, is M_d^-1. The laws
    impedance and ideal answer to the contact force with their own M as well: G is M^-1 M_hat M_d^-1, and they feed back
    only M M_d^-1 K_f - I, which is inertia shaping, eq. (4).

    Attributes:
        setup: the run's :class:`uvms_mj.analysis.setup.Setup`.
        front: the contact, one of ``setup.fronts``, or None without any.
        shaped: whether the law answers to the contact force through its own inertia, as impedance and ideal do.
        compliant: n^T v [1/kg]. Without a positive one there is no such vibration.
        fed_back: part of it that the law feeds back [1/kg].
        damping: n^T G D_d v / n^T v [1/s].
        stiffness: n^T G K_d v / n^T v [1/s^2].
    """

    setup: Any
    front: Any
    shaped: bool
    compliant: float
    fed_back: float
    damping: float
    stiffness: float

    @classmethod
    def of(cls, setup: Any, M_hat: np.ndarray | None = None) -> "Vibration":
        """The vibration under a law that imposes M_d, or that answers through its own inertia with M_hat (6, 6): that
        of the contact that is damped worst."""
        found = [cls._at(setup, front, M_hat) for front in setup.fronts]
        return max(found, key=lambda each: (each.growth > 1.0, -each.limit), default=cls(setup, None, *_NO_CONTACT))

    @classmethod
    def _at(cls, setup: Any, front: Any, M_hat: np.ndarray | None) -> "Vibration":
        design = setup.design
        n, M_d_inv = front.normal, design.M_d_inv
        G = M_d_inv if M_hat is None else np.linalg.solve(design.M, M_hat @ M_d_inv)
        v = G @ (np.array(setup.scenario.impedance.at_end[0]) * n)
        compliant = float(n @ v)
        fed_back = compliant - (0.0 if M_hat is None else 1.0 / design.along_normal(design.M, n))
        if compliant <= 0.0:
            return cls(setup, front, M_hat is not None, compliant, fed_back, 0.0, 0.0)
        damping, stiffness = float(n @ G @ design.D_d @ v) / compliant, float(n @ G @ design.K_d @ v) / compliant
        return cls(setup, front, M_hat is not None, compliant, fed_back, damping, stiffness)

    @property
    def limit(self) -> float:
        """Largest mean age of the fed back contact force at which the contact stays damped [s]; see :attr:`age`.

        For a sliding mode law and a wall with the damping b_c it is (D_d/K_f + b_c)/k_c. For M_d < M, inertia shaping
        takes (M/M_d - 1) k_c T from a damping of M/M_d (D_d + b_c).
        """
        if self.compliant <= 0.0 or self.fed_back <= 1e-9 * self.compliant:
            return np.inf
        front = self.front
        return (self.damping + self.compliant * front.damping) / (self.fed_back * front.stiffness)

    @property
    def age(self) -> float:
        """Mean age of the contact force in tau relative to the force in the contact itself [s].

        Navigation, law and thrusters each hold their output for a period T. A stage that reads it at its own instants,
        a period T' apart, finds it with a mean age of (T - gcd(T, T'))/2. The contact force itself is held for a time
        step h. A law that runs at every step on measurements of every step feeds back the force that acts. The time
        that a sample takes to arrive adds to it, or the lag of an observer, and so does the thrusters' delay of slow
        changes.
        """
        scenario = self.setup.scenario
        h = scenario.simulation.timestep
        steps = [n for period in self._periods.values() if (n := round(period / h)) > 1]  # one of a step holds nothing
        holds = sum(held - math.gcd(held, read) for held, read in pairwise([*steps, 1]))
        return self._sensor.force_timing[1] + 0.5 * h * holds + scenario.thrusters.mean_delay()

    @property
    def _sensor(self) -> Any:
        """The stage that sets the measured force: the observer if there is one, otherwise navigation."""
        scenario = self.setup.scenario
        return scenario.observer if scenario.observer.runs else scenario.navigation

    @property
    def _periods(self) -> dict[str, float]:
        """Periods of the stages from the measurement to the thrust, by name [s]."""
        scenario = self.setup.scenario
        control = scenario.control_period
        sensor = self._sensor
        own = scenario.simulation.timestep if sensor.every_step else control
        force = sensor.force_timing[0] or sensor.period or own
        return {
            "navigation": force,
            "control": control,
            "actuation": scenario.actuation.period or scenario.simulation.timestep,
            "thruster": scenario.thrusters.period or scenario.simulation.timestep,
        }

    @property
    def _longest(self) -> str:
        """Name of the longest period; of equal ones, the law's."""
        return max(("control", "navigation", "actuation", "thruster"), key=self._periods.__getitem__)

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
        h, k_c = scenario.simulation.timestep, self.front.stiffness
        gains = [self.stiffness + self.fed_back * k_c, self.damping]
        stiff = h * k_c * (1.0 / design.along_normal(design.M, self.front.normal))  # h w^2
        step, force = np.array([[1.0 - h * stiff, h], [-stiff, 1.0]]), np.array([h * h, h])
        free = np.linalg.matrix_power(step, round(self._periods[self._longest] / h))
        forced = np.linalg.solve(np.eye(2) - step, (np.eye(2) - free) @ force)
        return float(np.abs(np.linalg.eigvals(free - np.outer(forced, gains))).max())

    def checked(self, state: SteadyState | str) -> SteadyState | str:
        """The state at rest, or the reason why the sampled law does not come to rest against the wall."""
        if isinstance(state, SteadyState) and state.force > 0.0:
            if self.age >= self.limit:
                lags = self.setup.scenario.thrusters.mean_delay() > 0.0
                return f"the {'law with lagging thrusters' if lags else 'sampled law'} limit-cycles against this wall"
            if self.growth > 1.0:
                return "the held command does not damp the vibration against this wall"
        return state

    def notes(self, label: str) -> Iterator[str]:
        """Warnings if the sampled law damps the vibration slowly, or not at all."""
        if self.front is None:
            return
        longest, k_c, key = self._longest, self.front.stiffness, self.front.key
        here = f"at {'an' if longest == 'actuation' else 'a'} {longest} period of {self._periods[longest]:g} s"
        if self.growth > 1.0:
            w = np.sqrt(k_c / self.setup.design.along_normal(self.setup.design.M, self.front.normal))
            yield (
                f"{label} oscillates against the wall {here}: at {key}.stiffness {k_c:g} "
                f"N/m the contact vibrates faster than a held command can damp; a period below {2.5 / w:.2g} s usually "
                "suffices"
            )
        limit, age = self.limit, self.age
        if self.setup.scenario.observer.runs and age > SLOWLY_DAMPED * limit:
            yield (
                f"{label} {'vibrates' if age >= limit else 'hardly damps the vibration'} against the wall with this "
                f"observer: its estimate of the contact force is {age:.3g} s old, and all of the damping D_d is lost "
                f"at {limit:.3g} s with {key}.stiffness {k_c:g} N/m"
            )
            return
        if age > SLOWLY_DAMPED * limit or (age == limit == 0.0):
            lost = 2.0 * limit + self.setup.scenario.simulation.timestep
            what = "limit-cycles against the wall" if age >= limit else "hardly damps the vibration against the wall"
            share = f"{min(1.0, age / limit) if limit else 1.0:.0%} of the damping D_d is lost"
            delay = self.setup.scenario.thrusters.mean_delay()
            if delay > 0.0:
                yield (
                    f"{label} {what} with thrusters that lag by {delay:.3g} s: the contact force acts on the thrust so "
                    f"late that {share} at {key}.stiffness {k_c:g} N/m; its mean age is {age:.3g} s, and all is lost "
                    f"at {limit:.3g} s"
                )
                return
            yield (
                f"{label} {what} {here}: it holds the contact force so long that {share} at {key}.stiffness {k_c:g} "
                f"N/m; all is lost at a period of {lost:.4g} s"
            )


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
