"""Latency: the age of the contact force in tau, and the age at which it takes all of the damping against the wall."""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

_MOST_STEPS = 100_000
"""Longest common period over which ages are averaged [steps]; of a longer one, its beginning."""
_MEASURED = ("force sensor's delay", "observer's lag", "navigation period", "control period")
_COMMAND = ("computation delay", "actuation period", "thruster period", "thrusters' lag")


@dataclass(frozen=True)
class ForceLatency:
    """The chain from the contact force to the thrust.

    Attributes:
        timestep: h [s].
        periods: periods of the stages from the measurement to the thrust in their order, by name [s].
        delays: delays on the way, by name [s].
    """

    timestep: float
    periods: Mapping[str, float]
    delays: Mapping[str, float]

    @classmethod
    def of(cls, setup: Any, period: float | None = None) -> "ForceLatency":
        """The chain of a run, from its :class:`uvms_mj.setup.base.Setup`; default of the control period [s]: its
        own."""
        scenario = setup.scenario
        h, control = scenario.simulation.timestep, period or scenario.control_period
        observed = scenario.observer.runs
        sensor = scenario.observer if observed else scenario.navigation
        rate, late = sensor.force_timing
        periods = {
            "navigation": rate or sensor.period or (h if sensor.every_step else control),
            "control": control,
            "actuation": scenario.actuation.period or h,
            "thruster": scenario.thrusters.period or h,
        }
        delays = {
            "observer's lag" if observed else "force sensor's delay": late,
            "computation delay": scenario.controller.delay or 0.0,
            "thrusters' lag": scenario.thrusters.mean_delay(),
        }
        return cls(h, periods, delays)

    @functools.cached_property
    def ages(self) -> dict[str, float]:
        """Mean age that each period and each delay adds, by its name [s]: the stages are asked backwards, from all
        steps of a common period."""
        h, ages = self.timestep, dict(self.delays)
        steps = {name: round(period / h) for name, period in self.periods.items()}
        k = np.arange(min(math.lcm(*steps.values()), _MOST_STEPS))
        for name in reversed(steps):
            if name == "control":
                k = k - round(self.delays["computation delay"] / h)
            ages[f"{name} period"] = h * float((k % steps[name]).mean())
            k = k - k % steps[name]
        return ages

    @property
    def mean(self) -> float:
        """Mean age of the contact force in tau [s]."""
        return math.fsum(self.ages.values())

    @property
    def measured(self) -> float:
        """The part of it up to the command [s]: explicit Euler holds the measurements in zeta for the control period,
        too."""
        return math.fsum(self.ages.get(name, 0.0) for name in _MEASURED)

    @property
    def command_latency(self) -> float:
        """Mean age of the command that acts, the hold of the control period included [s]."""
        return math.fsum(self.ages[name] for name in (*_COMMAND, "control period"))

    @property
    def longest(self) -> str:
        """Name of the longest period; of equal ones, the law's."""
        return max(("control", "navigation", "actuation", "thruster"), key=self.periods.__getitem__)

    def parts(self, names: tuple[str, ...] = ()) -> str:
        """The parts of the age, the largest first, as text; only those of ``names`` if it is given."""
        parts = sorted(self.ages.items(), key=lambda part: -part[1])
        return ", ".join(f"{n} {1e3 * age:.3g} ms" for n, age in parts if age > 1e-9 and (n in names or not names))

    def command_parts(self) -> str:
        """The parts behind the command, with the control period, as text."""
        return self.parts((*_COMMAND, "control period"))


@dataclass(frozen=True)
class ForceAge:
    """What an old contact force does to the damping against the wall, in closed form, along v = G K_f n.

    Against a spring k_c, feedback of the contact force with unit gain and age T acts as a negative damping k_c T. The
    sliding mode laws impose M_d and D_d on any vehicle: G, the matrix before D_d v in v_dot, is M_d^-1. The laws
    impedance and ideal answer to the contact force with their own M as well: G is M^-1 M_hat M_d^-1, and they feed back
    only M M_d^-1 K_f - I, which is inertia shaping, eq. (4).

    Attributes:
        chain: what holds or delays the contact force on its way to tau.
        contact: one of ``setup.contacts_at_rest``; None without any.
        age: mean age of the force that acts as negative damping [s]. For a law that answers through its own inertia it
            is the age of the force in tau. A sliding mode law takes s to zero in its own loop, in which the force and
            the velocity are of the same instant: only the age of the measurements counts. A law that runs at every step
            on measurements of every step feeds back the force that acts.
        limit: the age that takes all of the damping [s]. For a sliding mode law and a wall with the damping b_c it is
            (D_d/K_f + b_c)/k_c. For M_d < M, inertia shaping takes (M/M_d - 1) k_c T from a damping of
            M/M_d (D_d + b_c).
    """

    chain: ForceLatency
    contact: Any
    age: float
    limit: float

    @classmethod
    def of(cls, setup: Any, M_hat: np.ndarray | None = None) -> "ForceAge":
        """The age under a law that imposes M_d, or that answers through its own inertia with M_hat (6, 6), at the
        contact that allows the least."""
        chain = ForceLatency.of(setup)
        limits = [(_limit(setup, contact, M_hat), contact) for contact in setup.contacts_at_rest]
        limit, contact = min(limits, key=lambda each: each[0], default=(math.inf, None))
        return cls(chain, contact, chain.measured if M_hat is None else chain.mean, limit)

    @property
    def share(self) -> float:
        """Part of the damping that is lost [1]."""
        return self.age / self.limit if self.limit > 0.0 else math.inf

    def comparison(self) -> str:
        """Age and limit as a sentence without its stop."""
        return (
            f"the fed back contact force is {1e3 * self.age:.3g} ms old on average, and all of the damping is lost at "
            f"(D_d/K_f + b_c)/k_c = {1e3 * self.limit:.3g} ms"
        )


def _limit(setup: Any, contact: Any, M_hat: np.ndarray | None) -> float:
    design, n = setup.design, contact.normal
    G = design.M_d_inv if M_hat is None else np.linalg.solve(design.M, M_hat @ design.M_d_inv)
    v = G @ (np.array(setup.scenario.impedance.at_end[0]) * n)
    compliant = float(n @ v)
    fed_back = compliant - (0.0 if M_hat is None else 1.0 / design.along_normal(design.M, n))
    if compliant <= 0.0 or fed_back <= 1e-9 * compliant:
        return math.inf
    damping = float(n @ G @ design.D_d @ v) / compliant
    return (damping + compliant * contact.damping) / (fed_back * contact.stiffness)
