"""Success of a run: that it completed and has settled, or is within the limits of the study's table ``[success]``."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import Fault, InputError, shortened
from ...quantities import leaves
from .metric import COMPONENTS, FLAGS, TEXTS, columns_of, kept_column

if TYPE_CHECKING:
    import pandas as pd

COMPLETED = "completed"
SETTLED = "contact.settled"

Limit = bool | tuple[float, float]


def limits(given: Mapping[str, Any], metrics: Sequence[str], folder: Path, faults: list[Fault]) -> dict[str, Limit]:
    """The limits of the table ``[success]`` by column of the rows: true or false, or the least and the greatest value.

    A name is that of :func:`.metric.kept_column`. Errors are appended to ``faults``.
    """
    found: dict[str, Limit] = {}
    for name, value in leaves(given, lists=False):
        place = f"success.{name}"
        try:
            metric, column = kept_column(name, metrics, folder)
            if metric in COMPONENTS and column not in columns_of(metric):
                raise InputError(f"has components: give {' or '.join(columns_of(metric))}")
            if column in found:
                raise InputError("is given twice")
            found[column] = _limit(value, metric)
        except InputError as error:
            faults += [Fault(place, fault.message) for fault in error.faults]
    return found


def _limit(value: Any, metric: str) -> Limit:
    """A limit of a metric. Raises InputError if it is not one."""
    wanted = "true or false" if metric in FLAGS else "a range [low, high]"
    if metric in TEXTS:
        raise InputError("is a text, which has no limits")
    if metric in COMPONENTS and isinstance(value, bool) != (metric in FLAGS):
        raise InputError(f"{shortened(value)} must be {wanted}")
    if isinstance(value, bool):
        return value
    if not _is_range(value):
        either = "" if metric in COMPONENTS else "true, false, or "
        raise InputError(f"{shortened(value)} must be {either}{wanted}")
    return float(value[0]), float(value[1])


def _is_range(value: Any) -> bool:
    numbers = isinstance(value, list | tuple) and len(value) == 2 and all(type(each) in (int, float) for each in value)
    return numbers and not any(map(math.isnan, value)) and value[0] <= value[1]


def succeeded(row: Mapping[str, Any], given: Mapping[str, Limit]) -> bool:
    """Whether a run with the columns ``row`` is a success."""
    if row["status"] != COMPLETED:
        return False
    if not given:
        return bool(row.get(SETTLED, True) == True)  # noqa: E712  # None and nan are not
    return all(_within(row.get(column), limit) for column, limit in given.items())


def _within(value: Any, limit: Limit) -> bool:
    if value is None:
        return False
    return bool(value == limit) if isinstance(limit, bool) else bool(limit[0] <= value <= limit[1])


def successes(frame: "pd.DataFrame", given: Mapping[str, Limit]) -> np.ndarray:
    """Whether each row (n,) is a success: the column ``success``, or what it would be in rows without it."""
    if "success" in frame:
        return frame["success"].to_numpy(dtype=bool)
    return np.array([succeeded(row, given) for row in frame.to_dict("records")], dtype=bool)


def in_words(given: Mapping[str, Limit], settled: bool) -> str:
    """The definition of success. ``settled`` is whether the rows have :data:`SETTLED`."""
    if not given:
        return "a run succeeds if it completed" + (" and has settled" if settled else "")
    parts = [
        f"{name} is {str(limit).lower()}" if isinstance(limit, bool) else f"{name} is from {limit[0]:g} to {limit[1]:g}"
        for name, limit in given.items()
    ]
    return f"a run succeeds if it completed, and {', and '.join(parts)}"
