"""Latency, the age of the contact force in tau: what holds or delays it between the contact and the thrust."""

import itertools
import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ForceLatency:
    """The chain from the contact force to the thrust.

    Attributes:
        timestep: h [s].
        periods: periods of the stages from the measurement to the thrust in their order, by name [s].
        delays: delays on the way, by name [s].
    """

    timestep: float
    periods: dict[str, float]
    delays: dict[str, float]

    @classmethod
    def of(cls, setup: Any) -> "ForceLatency":
        """The chain of a run, from its :class:`uvms_mj.setup.base.Setup`."""
        scenario = setup.scenario
        h, control = scenario.simulation.timestep, scenario.control_period
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

    @property
    def holds(self) -> dict[str, float]:
        """Mean age that each period adds, by the period's name [s].

        A stage of one step holds nothing. One that holds its output for a period T is read by the next one that holds
        its own, at instants a period T' apart, with a mean age of (T - gcd(T, T'))/2. A computation delay shifts the
        output off these instants, and it waits for the next one.
        """
        h, names = self.timestep, list(self.periods)
        steps = [round(period / h) for period in self.periods.values()]
        ages, shift = dict.fromkeys(names, 0.0), round(self.delays["computation delay"] / h)
        holding = [i for i, held in enumerate(steps) if held > 1]
        for i, reader in itertools.pairwise([*holding, len(steps)]):
            common = math.gcd(steps[i], steps[reader]) if reader < len(steps) else 1
            ages[names[i]] = 0.5 * (steps[i] - common)
            if i <= _LAW < reader:
                ages[names[i]] += -shift % common
        return {f"{name} period": h * age for name, age in ages.items()}

    @property
    def mean(self) -> float:
        """Mean age of the contact force in tau [s]."""
        return math.fsum([*self.holds.values(), *self.delays.values()])

    @property
    def measured(self) -> float:
        """The part of it up to the command [s]: explicit Euler holds the measurements in zeta for the control period,
        too."""
        return self._sum(_MEASURED)

    @property
    def late(self) -> float:
        """The part of it behind the command [s]."""
        return self._sum(_COMMAND)

    @property
    def command_latency(self) -> float:
        """Mean age of the command that acts, the hold of the control period included [s]."""
        return self.late + self.holds["control period"]

    @property
    def constant(self) -> float:
        """The part of it that no period changes [s]."""
        return math.fsum(self.delays.values())

    def _sum(self, names: tuple[str, ...]) -> float:
        return math.fsum(age for name, age in {**self.holds, **self.delays}.items() if name in names)

    @property
    def longest(self) -> str:
        """Name of the longest period; of equal ones, the law's."""
        return max(("control", "navigation", "actuation", "thruster"), key=self.periods.__getitem__)

    def parts(self, names: tuple[str, ...] = ()) -> str:
        """The parts of the age, the largest first, as text; only those of ``names`` if it is given."""
        parts = sorted({**self.holds, **self.delays}.items(), key=lambda part: -part[1])
        return ", ".join(f"{n} {1e3 * age:.3g} ms" for n, age in parts if age > 1e-9 and (n in names or not names))

    def command_parts(self) -> str:
        """The parts behind the command, with the control period, as text."""
        return self.parts((*_COMMAND, "control period"))


_LAW = 1  # the law's place among the periods
_MEASURED = ("force sensor's delay", "observer's lag", "navigation period", "control period")
_COMMAND = ("computation delay", "actuation period", "thruster period", "thrusters' lag")
