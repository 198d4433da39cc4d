"""Checks of the arguments of an environment. Each gives a value that can be used, or raises InputError."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..errors import Fault, InputError, suggestion
from ..scenario import Scenario


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
