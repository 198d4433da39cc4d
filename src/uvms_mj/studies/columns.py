"""The columns of a study's metrics."""

import functools
import math
from collections.abc import Mapping
from typing import Any

from ..records.trace import Trace
from ..stages.signals import AXES
from .metric import metric_of

COMPONENTS: Mapping[str, tuple[str, ...]] = {
    "contact.first_s": (),
    "contact.touches": (),
    "contact.peak_N": (),
    "contact.impulse_Ns": (),
    "contact.final_N": (),
    "contact.settled": (),
    "contact.analytic_N": (),
    "contact.relative_error": (),
    "effort_N2s": (),
    "saturated_s": (),
    "final.position_m": AXES[:3],
    "final.attitude_wxyz": ("w", *AXES[:3]),
    "final.s": AXES,
    "final.z": AXES,
    "final.tau": AXES,
    "analytic.position_m": AXES[:3],
    "analytic.none_because": (),
}
"""The numbers of ``uvms-mj run --json`` that a study can keep, each with the names of its components."""


def columns_of(place: str) -> list[str]:
    """The columns of a metric of :data:`COMPONENTS`."""
    return [f"{place}.{each}" for each in COMPONENTS[place]] or [place]


_function = functools.cache(metric_of)


def users_numbers(place: str, trace: Trace) -> dict[str, float | None]:
    """The numbers of a user's metric by column: the function's name, or ``name.key`` for each key of a dictionary."""
    name = place.rpartition(":")[2]
    value = _function(place)(trace)
    each = {f"{name}.{key}": v for key, v in value.items()} if isinstance(value, Mapping) else {name: value}
    return {column: _number(column, v) for column, v in each.items()}


def _number(column: str, value: Any) -> float | None:
    """A finite number, or None for a missing one or one that is not finite. Raises TypeError for anything else."""
    if value is None:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TypeError(f"metric {column}: {value!r} is not a number; return a number or a dict of numbers") from None
    return number if math.isfinite(number) else None
