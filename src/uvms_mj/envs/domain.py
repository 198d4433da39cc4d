"""The draws at the beginning of an episode: the ``[[vary]]`` of a study, with its keys and its distributions.

An episode draws each entry at random from the numbers of its own seed. The design of the study, such as a grid or Sobol
points, is of its runs and not of episodes: values and points of a grid are equally likely.

Checks of an environment's arguments give a value that can be used, or raise InputError.
"""

import dataclasses
import functools
import math
import os
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import Fault, InputError, suggestion
from ..quantities import overrides_of
from ..scenario import Scenario
from ..setup.world import World
from ..studies.plan.file import Vary, entries
from ..studies.plan.laws import KeyChecks, Law, combination_faults
from ..studies.plan.places import overrides_at, parsed
from ..studies.plan.plan import Plan


def checked(faults: list[Fault], check: Callable[..., Any], *given: Any, **options: Any) -> Any:
    """The result of a check. The errors of an InputError are added to a list."""
    try:
        return check(*given, **options)
    except InputError as error:
        faults += error.faults


def positive(key: str, given: Any, shapes: tuple[tuple[int, ...], ...], wanted: str, zero: bool = False) -> np.ndarray:
    """Positive numbers of one of some shapes, or with ``zero`` also zeros."""
    found = numbers(given)
    good = np.isfinite(found) & ((found > 0.0) | (zero & (found == 0.0)))
    if found.shape not in shapes or not good.all():
        raise InputError([Fault(key, f"{given!r}: must be {wanted}")])
    return found


def numbers(value: Any) -> np.ndarray:
    """A value as an array of numbers; NaN if it is anything else."""
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        return np.array(math.nan)


def names(key: str, given: Any) -> Sequence[str]:
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise InputError([Fault(key, f"{given!r}: must be a list of names")])
    return given


def generator(seed: Any) -> np.random.Generator:
    """The random numbers of a seed; without one, of the system's."""
    if not isinstance(seed, int | np.integer | None) or isinstance(seed, bool) or (seed is not None and seed < 0):
        raise InputError([Fault("seed", f"{seed!r}: must be an integer, at least 0")])
    return np.random.default_rng(seed)


def generators(seed: Any, n: Any) -> list[np.random.Generator]:
    """The random numbers of n runs; run i has the seed ``seed + i``."""
    if type(n) is not int or n < 1:
        raise InputError([Fault("n", f"{n!r}: must be a positive number of runs")])
    generator(seed)
    return [generator(None if seed is None else seed + i) for i in range(n)]


def finite(key: str, given: Any) -> float:
    number = numbers(given)
    if number.shape != () or not np.isfinite(number):
        raise InputError([Fault(key, f"{given!r}: must be a finite number")])
    return float(number)


def function(key: str, given: Any) -> Any:
    if given is not None and not callable(given):
        raise InputError([Fault(key, f"{given!r}: must be a function of uvms_mj.envs.Seen")])
    return given


def base_gains(scenario: Scenario, gains: Any) -> dict[str, float]:
    """The scenario's values of the gains by dotted key."""
    law, gains = scenario.controller, names("gains", gains)
    known = [field.name for field in dataclasses.fields(law) if isinstance(getattr(law, field.name), float)]
    wrong = [name for name in gains if name not in known]
    if wrong or not gains:
        hint = suggestion(wrong[0], known) if wrong else f"choose from {', '.join(known)}"
        raise InputError([Fault("gains", f"{list(gains)!r}: must be gains of {law.label()} that are numbers; {hint}")])
    return {f"controller.{name}": float(getattr(law, name)) for name in gains}


def steps_each(timestep: float, control_rate: Any) -> int:
    rate = numbers(control_rate)
    steps = round(1.0 / (timestep * float(rate))) if rate.shape == () and 0.0 < rate < math.inf else 0
    if steps < 1 or abs(steps * timestep * float(rate) - 1.0) > 1e-6:
        raise InputError(
            [Fault("control_rate", f"{control_rate!r} Hz: must divide the step rate of {1.0 / timestep:.6g} Hz")]
        )
    return steps


WORD = "randomise"
_TRIED = 8
"""Draws with which an extreme value is tried if it can't run alone."""


@dataclass(frozen=True)
class Domain:
    """Entries of ``[[vary]]`` for a scenario.

    Attributes:
        variations: the entries by the argument that gives them, for messages.
        scenario: of all episodes.
    """

    variations: Mapping[str, Vary]
    scenario: Scenario

    @property
    def places(self) -> tuple[str, ...]:
        """The dotted keys that vary, or components of them."""
        return tuple(place for each in self.variations.values() for place in each.places)

    def draw(self, rng: np.random.Generator) -> dict[str, Any]:
        """Overrides of one episode by dotted key."""
        return self.at([rng.random() for _ in self.variations])

    def at(self, u: Sequence[float]) -> dict[str, Any]:
        """Overrides by dotted key, at one number from 0 to 1 for each entry."""
        values: dict[str, Any] = {}
        for each, x in zip(self.variations.values(), u, strict=True):
            drawn = each.at(np.array([x]))
            values |= {place: value for place, (value,) in zip(each.places, drawn, strict=True)}
        return overrides_at(values, self._tables)

    @functools.cached_property
    def _tables(self) -> dict[str, Any]:
        return self.scenario.to_dict()

    def named(self, fault: Fault) -> Fault:
        """An error of a key, with the argument that gives the entry of this key."""
        for where, each in self.variations.items():
            if any(parsed(place)[0] == fault.key for place in each.places):
                return Fault(where, fault.message if fault.key in where else str(fault))
        return fault

    def check(self, fixed: Mapping[str, Any], replaced: Container[str]) -> None:
        """Check the entries as a study's are checked.

        Args:
            fixed: overrides of the scenario by dotted key, which no entry may vary.
            replaced: keys that the action sets.

        Raises:
            InputError: an entry varies what an environment can't, or has values with which no run can begin.
        """
        faults: list[Fault] = []
        for where, each in self.variations.items():
            if each.laws is not None:
                faults.append(Fault(where, "laws: an environment has no laws to choose from; leave laws out"))
            for place in each.places:
                key = parsed(place)[0]
                if key == "simulation.timestep":
                    faults.append(Fault(where, f"{key}: all episodes have one time step"))
                if key in replaced:
                    faults.append(Fault(where, f"{key}: is set by the action"))
        law = Law("this environment", "", {}, self.scenario)
        faults += combination_faults(self.variations, [law], fixed, False)
        if self.variations and not faults:
            dice = np.random.default_rng(0)
            points = [self._values([dice.random() for _ in self.variations]) for _ in range(_TRIED)]
            faults = KeyChecks(self.variations, [law], points).faults()
        if faults:
            raise InputError(faults, "push")

    def _values(self, u: Sequence[float]) -> tuple[Any, ...]:
        """The values of all places at one number from 0 to 1 for each entry."""
        each = zip(self.variations.values(), u, strict=True)
        return tuple(value for entry, x in each for (value,) in entry.at(np.array([x])))


def domain_of(randomise: Any) -> tuple[Scenario | None, dict[str, Vary]]:
    """The base scenario of a study and its entries of ``[[vary]]``, from its name or its path. Otherwise there is no
    scenario, and the entries come from :func:`variations_of`. Raises InputError if it is invalid."""
    if not isinstance(randomise, str | os.PathLike):
        return None, variations_of(randomise)
    plan = Plan.load(randomise)
    if isinstance(plan.base, World):
        raise InputError(f"randomise: {randomise} is a study of a world; an environment has one vehicle")
    return plan.base, {f"{randomise}: vary[{i}]": each for i, each in enumerate(plan.variations)}


def variations_of(randomise: Any) -> dict[str, Vary]:
    """The entries of ``[[vary]]`` by the argument that gives them: of a list of tables, or of a mapping from keys to a
    lower and an upper bound. Raises InputError if they are invalid."""
    faults: list[Fault] = []
    if isinstance(randomise, Sequence):
        tables, words = list(randomise), [f"{WORD}[{i}]" for i in range(len(randomise))]
    else:
        tables, words = [], []
        for key, bounds in overrides_of(randomise, WORD).items():
            try:
                low, high = (np.array(each, dtype=float) for each in bounds)
                if low.shape != high.shape or low.ndim > 1 or not (low <= high).all():
                    raise ValueError
            except (TypeError, ValueError):
                faults.append(Fault(f"{WORD}[{key!r}]", f"{bounds!r}: must be a lower and an upper bound"))
                continue
            places = [key] if low.ndim == 0 else [f"{key}[{i}]" for i in range(low.size)]
            for place, a, b in zip(places, low.reshape(-1).tolist(), high.reshape(-1).tolist(), strict=True):
                drawn = {"distribution": "uniform", "low": a, "high": b} if a < b else {"values": [a]}
                tables.append({"key": place} | drawn)
                words.append(f"{WORD}[{place!r}]")
    found = entries(tables, faults)
    if faults:
        raise InputError([_named(fault, words) for fault in faults])
    return dict(zip(words, found.values(), strict=True))


def _named(fault: Fault, words: Sequence[str]) -> Fault:
    """An error of an entry with the argument that gives it in place of ``vary[0]``."""
    for i, word in enumerate(words):
        if fault.key.startswith(f"vary[{i}]"):
            return Fault(word + fault.key.removeprefix(f"vary[{i}]"), fault.message)
    return fault
