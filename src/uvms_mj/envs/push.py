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
import functools
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, get_args

import numpy as np

from ..control.design import demanded_force
from ..engine.simulation import Simulation
from ..errors import Fault, InputError, suggestion
from ..quantities import overrides_of
from ..scenario import Scenario

OBSERVED = ("p_WB", "quat_WB", "nu", "f_contact_m_W", "p_d", "quat_d")
"""Signals of the observation, if none are given."""
SPAN = 4.0
"""Largest factor by which an action changes a gain."""
Action = Literal["wrench", "thrusts", "gains"]
_REPLACED = {"wrench": {"controller.name": "external"}, "thrusts": {"actuation.name": "external"}}
"""The stage that the caller replaces, by the action."""
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
        **unknown: Any,
    ) -> None:
        faults = [Fault(name, f"no such argument; {suggestion(name, ARGUMENTS)}") for name in unknown]
        chosen = (
            scenario.updated(overrides or {}) if isinstance(scenario, Scenario) else Scenario.load(scenario, overrides)
        )
        if action not in get_args(Action):
            faults.append(Fault("action", f"{action!r}: must be 'wrench', 'thrusts' or 'gains'"))
        self.action, self.scenario = action, chosen.updated(_REPLACED.get(action, {}))
        if force_d is None:
            force_d = demanded_force(self.scenario, self.scenario.wall.stiffness)
        checked = functools.partial(_checked, faults)
        self.randomise = checked(_bounds, randomise)
        wanted = "a positive force [N]; without it, it is the one that the scenario's impedance demands"
        self.force_d = checked(_positive, "force_d", force_d, ((), (1,)), wanted)
        self.wrench_scale = checked(_positive, "wrench_scale", wrench_scale, ((6,),), "six positive numbers [N, N m]")
        self.thrust_scale = checked(_positive, "thrust_scale", thrust_scale, ((),), "a positive thrust [N]")
        self.effort_weight = checked(_positive, "effort_weight", effort_weight, ((),), "zero or positive", zero=True)
        self._base = checked(_base_gains, self.scenario, gains) if action == "gains" else {}
        self.steps_each = checked(_steps_each, self.scenario.simulation.timestep, control_rate)
        self.rng = checked(_random, seed)
        if faults:
            raise InputError(faults, "push")
        self.simulation = Simulation(self.scenario)
        _try_out(self.simulation, self.randomise)
        absent = [name for name in _names("observe", observe) if name not in self.simulation.signals]
        if absent:
            choices = list(self.simulation.signals)
            raise InputError([Fault("observe", f"no signal {name!r}; {suggestion(name, choices)}") for name in absent])
        self._observed = tuple(observe)
        thrusters = len(self.simulation.setup.vehicle.thrusters)
        self.size = {"wrench": 6, "thrusts": thrusters, "gains": len(self._base)}[action]

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
            self.rng = _random(seed)
        drawn = {key: self.rng.uniform(low, high) for key, (low, high) in self.randomise.items()}
        number = int(self.rng.integers(2**31))
        self.simulation.reset(seed=number, overrides={**self._base, **drawn, **overrides_of(overrides)})
        return self.observation()

    def apply(self, action: np.ndarray) -> None:
        """Set the command of the next control step from an action (size,).

        Raises:
            InputError: the action has another shape, or a number that is not finite.
        """
        numbers = _numbers(action)
        if numbers.shape != (self.size,) or not np.isfinite(numbers).all():
            raise InputError([Fault("action", f"{action!r}: must be {self.size} finite numbers")])
        clipped = np.clip(numbers, -1.0, 1.0)
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
        force_d = self.force_d.item()
        off = (float(row["impulse"] - impulse) / T - force_d) / force_d
        spent = float(((row["effort"] - effort) / (T * self.wrench_scale**2)).mean())
        return math.exp(-off * off) - self.effort_weight.item() * spent

    def observation(self) -> Observation:
        """The observed signals as copies."""
        row = self.simulation.signals
        numbers = {name: row[name] for name in self._observed} | {"force_d": self.force_d}
        return {name: np.array(each, dtype=float, ndmin=1) for name, each in numbers.items()}


ARGUMENTS = [name for name in inspect.signature(Push).parameters if name != "unknown"]


def _checked(faults: list[Fault], check: Callable[..., Any], *given: Any, **options: Any) -> Any:
    """The result of a check. The errors of an InputError are added to a list."""
    try:
        return check(*given, **options)
    except InputError as error:
        faults += error.faults


def _positive(key: str, given: Any, shapes: tuple[tuple[int, ...], ...], wanted: str, zero: bool = False) -> np.ndarray:
    """Positive numbers of one of some shapes, or with ``zero`` also zeros."""
    numbers = _numbers(given)
    good = np.isfinite(numbers) & ((numbers > 0.0) | (zero & (numbers == 0.0)))
    if numbers.shape not in shapes or not good.all():
        raise InputError([Fault(key, f"{given!r}: must be {wanted}")])
    return numbers


def _numbers(value: Any) -> np.ndarray:
    """A value as an array of numbers; NaN if it is anything else."""
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        return np.array(math.nan)


def _names(key: str, given: Any) -> Sequence[str]:
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise InputError([Fault(key, f"{given!r}: must be a list of names")])
    return given


def _random(seed: Any) -> np.random.Generator:
    if not isinstance(seed, int | np.integer | None) or (seed is not None and seed < 0):
        raise InputError([Fault("seed", f"{seed!r}: must be an integer, at least 0")])
    return np.random.default_rng(seed)


def _bounds(randomise: Any) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Bounds as arrays."""
    found, faults = {}, []
    for key, given in overrides_of(randomise, "randomise").items():
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
    return found


def _try_out(simulation: Simulation, randomise: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Check by a reset that an episode may begin at either end of the bounds. Raises InputError if it may not."""
    try:
        for end in (0, 1):
            simulation.reset({key: bounds[end] for key, bounds in randomise.items()})
    except InputError as error:
        faults = [Fault(f"randomise[{fault.key!r}]", fault.message) for fault in error.faults]
        raise InputError(faults, "push") from None
    simulation.reset()


def _base_gains(scenario: Scenario, gains: Any) -> dict[str, float]:
    """The scenario's values of the gains by dotted key."""
    law, gains = scenario.controller, _names("gains", gains)
    known = [field.name for field in dataclasses.fields(law) if isinstance(getattr(law, field.name), float)]
    wrong = [name for name in gains if name not in known]
    if wrong or not gains:
        hint = suggestion(wrong[0], known) if wrong else f"choose from {', '.join(known)}"
        raise InputError([Fault("gains", f"{list(gains)!r}: must be gains of {law.label()} that are numbers; {hint}")])
    return {f"controller.{name}": float(getattr(law, name)) for name in gains}


def _steps_each(timestep: float, control_rate: Any) -> int:
    rate = _numbers(control_rate)
    steps = round(1.0 / (timestep * float(rate))) if rate.shape == () and 0.0 < rate < math.inf else 0
    if steps < 1 or abs(steps * timestep * float(rate) - 1.0) > 1e-6:
        raise InputError(
            [Fault("control_rate", f"{control_rate!r} Hz: must divide the step rate of {1.0 / timestep:.6g} Hz")]
        )
    return steps
