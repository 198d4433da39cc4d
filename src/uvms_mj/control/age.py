"""The age of the contact force in tau: what holds or delays it between the contact and the thrust."""

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ForceAge:
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
    def of(cls, setup: Any) -> "ForceAge":
        """The chain of a run, from its :class:`uvms_mj.analysis.setup.Setup`."""
        scenario = setup.scenario
        h, control = scenario.simulation.timestep, scenario.control_period
        observed = scenario.observer.runs
        sensor = scenario.observer if observed else scenario.navigation
        rate, late = (None, 0.0) if observed else scenario.navigation.force_timing
        periods = {
            "navigation": rate or sensor.period or (h if sensor.every_step else control),
            "control": control,
            "actuation": scenario.actuation.period or h,
            "thruster": scenario.thrusters.period or h,
        }
        delays = {
            "force sensor's delay": late,
            "observer's lag": scenario.observer.age,
            "computation delay": scenario.controller.delay or 0.0,
            "thrusters' lag": scenario.thrusters.mean_delay(),
        }
        return cls(h, periods, delays)

    @property
    def holds(self) -> dict[str, float]:
        """Mean age that each period adds, by the period's name [s].

        A stage that reads a held output at its own instants, a period T' apart, finds it with a mean age of
        (T - gcd(T, T'))/2. A command that the computation delay shifts off the instants of the actuation waits for the
        next one.
        """
        h = self.timestep
        steps = [round(period / h) for period in self.periods.values()]
        readers = zip(steps, [*steps[1:], 1], strict=True)
        ages = [0.5 * (held - math.gcd(held, read)) for held, read in readers]
        shift = round(self.delays["computation delay"] / h)
        ages[1] += -shift % math.gcd(steps[1], steps[2])
        return {f"{name} period": h * age for name, age in zip(self.periods, ages, strict=True)}

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
    def command_age(self) -> float:
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


_MEASURED = ("force sensor's delay", "observer's lag", "navigation period", "control period")
_COMMAND = ("computation delay", "actuation period", "thruster period", "thrusters' lag")
