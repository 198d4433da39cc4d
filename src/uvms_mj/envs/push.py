r"""The task of both environments: push on the wall with a desired force, at a control rate.

**Action** (array, each entry from -1 to 1), one of

- ``wrench``: tau_cmd divided by ``wrench_scale``; allocation and thrusters follow as for a law;
- ``thrusts``: the thrust of each thruster divided by ``thrust_scale``;
- ``gains``: gains of the scenario's law: a multiplies a gain of the scenario by :math:`4^a`.

**Observation**: signals of the simulation by name: what navigation and guidance give the law (:data:`OBSERVED`), and
``force_d``, the desired pushing force [N].

**Reward** of a control step of length T, with the mean pushing force :math:`\bar F` and the mean square of tau, both
integrated at every time step,

.. math::

    r = \exp\left(-\left(\frac{\bar F - F_d}{F_d}\right)^2\right)
        - c\, \frac{1}{6} \sum_{i=1}^6 \frac{1}{T \tau_i^2} \int \tau_i(t)^2\, dt

where :math:`\tau_i` is ``wrench_scale`` and c ``effort_weight``. A vehicle that does not touch the wall gets
exp(-1) = 0.37 less its effort. A run that diverges ends with the reward -1.

**Randomisation**: ``randomise = {"current.speed": (0.0, 0.5), ...}`` draws each key uniformly at every reset.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from ..analysis.rest import demanded_force
from ..engine.simulation import Diverged, Simulation
from ..errors import Fault, InputError, suggestion
from ..scenario import Scenario

OBSERVED = ("p_WB", "quat_WB", "nu", "f_contact_m_W", "p_d", "quat_d")
"""Signals of the observation, if none are given."""
SPAN = 4.0
"""Largest factor by which an action changes a gain."""
Action = Literal["wrench", "thrusts", "gains"]
Observation = dict[str, np.ndarray]


class Push:
    """Pushing on the wall as a sequence of control steps.

    Args:
        scenario: the scenario, its name or the path of its file. An episode lasts ``simulation.duration``.
        overrides: dotted keys and values that replace the scenario's.
        action: "wrench", "thrusts" or "gains".
        control_rate: control steps per second [Hz]; must divide the step rate.
        gains: names of the gains that an action changes, for "gains".
        force_d: desired pushing force [N]; default: the one that the scenario's impedance demands.
        observe: names of the observed signals.
        wrench_scale: (6,) wrench at action 1, and the unit of the effort [N, N m].
        thrust_scale: thrust at action 1 [N].
        effort_weight: weight c of the effort in the reward.
        randomise: lower and upper bound by dotted key; a vector's bounds are vectors.
        seed: seed of the first episodes, until :meth:`reset` is given one.

    Raises:
        InputError: an argument is wrong; lists every error.
    """

    def __init__(
        self,
        scenario: Scenario | str = "push_wall",
        *,
        overrides: Mapping[str, Any] | None = None,
        action: Action = "wrench",
        control_rate: float = 50.0,
        gains: Sequence[str] = ("k_1", "k_2"),
        force_d: float | None = None,
        observe: Sequence[str] = OBSERVED,
        wrench_scale: Sequence[float] = (40.0, 40.0, 40.0, 10.0, 10.0, 10.0),
        thrust_scale: float = 20.0,
        effort_weight: float = 0.1,
        randomise: Mapping[str, tuple[Any, Any]] | None = None,
        seed: int | None = None,
    ) -> None:
        chosen = (
            scenario.updated(overrides or {}) if isinstance(scenario, Scenario) else Scenario.load(scenario, overrides)
        )
        self.scenario = _with_action(chosen, action)
        self.randomise = _bounds(self.scenario, randomise or {})
        self.wrench_scale = np.array(wrench_scale, dtype=float)
        self.thrust_scale, self.effort_weight = float(thrust_scale), float(effort_weight)
        demanded = demanded_force(self.scenario, self.scenario.wall.stiffness)
        self.force_d = np.array([demanded if force_d is None else float(force_d)])
        self._base = _base_gains(self.scenario, gains) if action == "gains" else {}
        self.steps_each = _steps_each(self.scenario.simulation.timestep, control_rate)
        self._refuse(action)
        self.action, self.rng = action, np.random.default_rng(seed)
        self.simulation = Simulation(self.scenario)
        unknown = [name for name in observe if name not in self.simulation.signals]
        if unknown:
            choices = list(self.simulation.signals)
            raise InputError([Fault("observe", f"no signal {name!r}; {suggestion(name, choices)}") for name in unknown])
        self._observed = tuple(observe)
        self.size = {"wrench": 6, "thrusts": len(self.simulation.setup.vehicle.thrusters), "gains": len(self._base)}[
            action
        ]

    def _refuse(self, action: str) -> None:
        force_d, scale, thrust, weight = self.force_d[0], self.wrench_scale, self.thrust_scale, self.effort_weight
        force = "a positive force [N]; without it, it is the one that the scenario's impedance demands"
        six = scale.shape == (6,) and bool((scale > 0.0).all())
        checks = (
            ("action", action, action in ("wrench", "thrusts", "gains"), "'wrench', 'thrusts' or 'gains'"),
            ("force_d", float(force_d), 0.0 < force_d < math.inf, force),
            ("wrench_scale", scale.tolist(), six, "six positive numbers [N, N m]"),
            ("thrust_scale", thrust, 0.0 < thrust < math.inf, "a positive thrust [N]"),
            ("effort_weight", weight, 0.0 <= weight < math.inf, "zero or positive"),
        )
        wrong = [Fault(name, f"{value!r}: must be {wanted}") for name, value, good, wanted in checks if not good]
        if wrong:
            raise InputError(wrong, "push")

    @property
    def over(self) -> bool:
        """Whether the episode has reached the scenario's duration."""
        return self.simulation.steps >= self.scenario.steps

    def reset(self, seed: int | None = None, overrides: Mapping[str, Any] | None = None) -> Observation:
        """Begin an episode.

        Args:
            seed: seed of this and all later episodes; default: go on with the present numbers.
            overrides: dotted keys and values for this episode, after the random ones.
        """
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        drawn = {key: _drawn(self.rng.uniform(low, high)) for key, (low, high) in self.randomise.items()}
        number = int(self.rng.integers(2**31))
        self.simulation.reset(seed=number, overrides={**self._base, **drawn, **(overrides or {})})
        return self.observation()

    def apply(self, action: np.ndarray) -> None:
        """Set the command of the next control step from an action (size,)."""
        clipped = np.clip(action, -1.0, 1.0)
        if self.action == "wrench":
            self.simulation.tau_cmd[:] = self.wrench_scale * clipped
        elif self.action == "thrusts":
            self.simulation.u[:] = self.thrust_scale * clipped
        else:
            factors = SPAN**clipped
            self.simulation.set(
                {key: value * float(f) for (key, value), f in zip(self._base.items(), factors, strict=True)}
            )

    def advance(self, steps: int) -> float:
        """Do time steps and return the reward. Raises Diverged if a bound is left."""
        row = self.simulation.signals
        impulse, effort = float(row["impulse"]), row["effort"].copy()
        self.simulation.step(steps)
        T = steps * self.scenario.simulation.timestep
        force_d = float(self.force_d[0])
        off = (float(row["impulse"] - impulse) / T - force_d) / force_d
        spent = float(((row["effort"] - effort) / (T * self.wrench_scale**2)).mean())
        return math.exp(-off * off) - self.effort_weight * spent

    def observation(self) -> Observation:
        """The observed signals as copies."""
        row = self.simulation.signals
        observed = {name: np.array(row[name], dtype=float, ndmin=1) for name in self._observed}
        return observed | {"force_d": self.force_d.copy()}


def _with_action(scenario: Scenario, action: str) -> Scenario:
    """The scenario with the stage that the caller replaces."""
    if action == "wrench":
        return scenario.updated({}, "external")
    return scenario.updated({"actuation.name": "external"}) if action == "thrusts" else scenario


def _bounds(scenario: Scenario, randomise: Mapping[str, tuple[Any, Any]]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Bounds as arrays. Both ends must be valid values of the scenario's keys."""
    found, faults = {}, []
    for key, given in randomise.items():
        try:
            low, high = (np.array(each, dtype=float) for each in given)
            if low.shape != high.shape or not (low <= high).all():
                raise ValueError
        except (TypeError, ValueError):
            faults.append(Fault(f"randomise[{key!r}]", f"{given!r}: must be a lower and an upper bound"))
            continue
        found[key] = low, high
    if faults:
        raise InputError(faults)
    for end in (0, 1):
        scenario.updated({key: _drawn(bounds[end]) for key, bounds in found.items()})
    return found


def _drawn(value: np.ndarray | float) -> Any:
    return np.asarray(value).tolist()


def _base_gains(scenario: Scenario, gains: Sequence[str]) -> dict[str, float]:
    """The scenario's values of the gains by dotted key."""
    law = scenario.controller
    known = [field.name for field in dataclasses.fields(law) if isinstance(getattr(law, field.name), float)]
    wrong = [name for name in gains if name not in known]
    if wrong or not gains:
        hint = suggestion(wrong[0], known) if wrong else f"choose from {', '.join(known)}"
        raise InputError([Fault("gains", f"{list(gains)!r}: must be gains of {law.label()} that are numbers; {hint}")])
    return {f"controller.{name}": float(getattr(law, name)) for name in gains}


def _steps_each(timestep: float, control_rate: float) -> int:
    steps = round(1.0 / (timestep * control_rate)) if 0.0 < control_rate < math.inf else 0
    if steps < 1 or abs(steps * timestep * control_rate - 1.0) > 1e-6:
        raise InputError(
            [Fault("control_rate", f"{control_rate!r} Hz: must divide the step rate of {1.0 / timestep:.6g} Hz")]
        )
    return steps


__all__ = ["OBSERVED", "Diverged", "Push"]
