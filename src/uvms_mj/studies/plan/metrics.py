"""The metrics of a study: numbers of a run's summary by their names, functions of the user's, and success by them.

A run is a success if it completed and has settled, or is within the limits of the study's table ``[success]``.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...analysis.summary import NUMBERS, Number
from ...errors import Fault, InputError, shortened, suggestion
from ...files import is_file
from ...quantities import leaves
from ...stages.loader import load_file
from ...stages.signals import COMPONENTS
from .file import absolute

if TYPE_CHECKING:
    import pandas as pd

    from ...records.trace import Trace

COMPLETED = "completed"
SETTLED = "contact.settled"

Limit = bool | tuple[float, float]


def metric_of(name: str) -> "Callable[[Any], Any]":
    """The function of a trace that gives a metric, by its place in a summary or from ``path/to/file.py:function``. A
    function for a world is given the traces of all vehicles by their names.

    Raises:
        InputError: there is no such metric, or the file can't be loaded.
    """
    _, own = parted(name)
    if own in NUMBERS and NUMBERS[own].not_kept:
        raise InputError(f"{name!r} {NUMBERS[own].not_kept}")
    if (number := number_of(name)) is not None:
        return number.of
    file, colon, word = name.rpartition(":")
    if not colon or not file.endswith(".py"):
        hint = suggestion(name, METRICS)
        raise InputError(f"no metric {name!r}; {hint}; for your own give path/to/file.py:function")
    path = Path(file)
    if not is_file(path):
        raise InputError(f"no file {file!r}" + ("" if path.is_absolute() else f" (looked in {Path.cwd()})"))
    try:
        functions = {key: value for key, value in vars(load_file(path.absolute(), "")).items() if callable(value)}
    except InputError as error:
        raise InputError([Fault("", fault.message) for fault in error.faults]) from None
    if word not in functions:
        raise InputError(f"no function {word!r} in {file}; {suggestion(word, functions)}")
    return functions[word]


BEFORE: Mapping[str, type] = {"index": int, "draw": int, "law": str, "repeat": int, "seed": int}
"""The columns of every row that stand before the keys that vary, with their types."""
AFTER: Mapping[str, type] = {
    **dict.fromkeys(("status", "message"), str),
    **dict.fromkeys(("steps", "warnings"), int),
    **{"success": bool, "engine": str},
}
"""The columns that stand between the keys that vary and the metrics."""
OF_ROWS = (*BEFORE, *AFTER)
METRICS = {name: each for name, each in NUMBERS.items() if not each.not_kept}
"""The numbers that a study can keep, most of them of ``uvms-mj run --json``."""


def parted(name: str) -> tuple[str, str]:
    """The vehicle of a metric in a world, ``left.contact.peak_N``, and the metric's name of one vehicle; no vehicle for
    a metric of a single vehicle, and for a function."""
    vehicle, _, own = name.partition(".")
    return (vehicle, own) if name not in NUMBERS and own in NUMBERS else ("", name)


def number_of(place: str) -> Number | None:
    """The number of a run that a metric is, also of one vehicle of a world; None for a function of the user's."""
    return METRICS.get(parted(place)[1])


def of_each(metrics: Sequence[str], vehicles: Sequence[str]) -> list[str]:
    """The metrics of a world: one without the name of a vehicle is of each vehicle."""
    many = [[f"{each}.{name}" for each in vehicles] if name in NUMBERS and vehicles else [name] for name in metrics]
    return [name for names in many for name in names]


def is_settled(column: str) -> bool:
    """Whether a column says that the force of a vehicle has settled."""
    return parted(column)[1] == SETTLED


def columns_of(place: str) -> list[str]:
    """The columns of a metric that is a :func:`number_of` a run."""
    number = number_of(place)
    assert number is not None
    size = number.size
    if size == 1:
        return [place]
    return [f"{place}.{each}" for each in COMPONENTS.get(size) or [f"{i:02d}" for i in range(size)]]


def meaning_of(column: str) -> str:
    """The metric of a column in words, from its definition; empty for a function of the user's."""
    number = number_of(column) or number_of(column.rpartition(".")[0])
    return "" if number is None else number.meaning


def column_is_taken(name: str, others: Sequence[str], varied: Sequence[str]) -> bool:
    """Whether a user's metric could have a column of a row, of other metrics or of keys that vary."""
    column = name.rpartition(":")[2]
    tables = {place.partition(".")[0] for place in (*METRICS, *varied, *filter(number_of, others))}
    return column in OF_ROWS or column in tables or any(column == other.rpartition(":")[2] for other in others)


def kept_column(name: str, metrics: Sequence[str], folder: Path) -> tuple[str, str]:
    """The metric among the kept ones, and the column of the rows, that a name means: the metric's own, its
    function's alone, or the name of a component, ``final.position_m.x``. A path is relative to ``folder``. A vector has
    no column of its own name. Raises InputError if nothing that is kept has this name."""
    for metric in metrics:
        function = metric.rpartition(":")[2]
        for written, called in ((name, function), (absolute(name, folder), metric)):
            if written == called or written.startswith(f"{called}."):
                column = function + written.removeprefix(called)
                if number_of(metric) and column not in (metric, *columns_of(metric)):
                    raise InputError(f"is not a component of {metric}: {', '.join(columns_of(metric))}")
                return metric, column
    raise InputError(f"is not one of keep.metrics; {suggestion(name, [each.rpartition(':')[2] for each in metrics])}")


def users_numbers(place: str, trace: "Trace | Mapping[str, Trace]") -> dict[str, float | None]:
    """The numbers of a user's metric by column: the function's name, or ``name.key`` for each key of a dictionary. The
    function is given a trace, or of a world the traces by the vehicles' names. It is loaded anew, since what its file
    has kept is of another run."""
    name = place.rpartition(":")[2]
    value = metric_of(place)(trace)
    each = {f"{name}.{key}": v for key, v in value.items()} if isinstance(value, Mapping) else {name: value}
    return {column: _number(column, v) for column, v in each.items()}


def _number(column: str, value: Any) -> float | None:
    """A number, also an infinite one, or None for a missing one or nan. Raises TypeError for anything else."""
    if value is None:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TypeError(
            f"metric {column}: {shortened(value)} is not a number; return a number or a dict of numbers"
        ) from None
    return None if math.isnan(number) else number


_UNITS = {
    **{"N2s": "N² s", "Ns": "N s", "N": "N", "Nm": "N m", "s": "s", "m": "m", "J": "J", "rad": "rad", "deg": "deg"},
    **{"N_per_s": "N/s", "m_per_s3": "m/s³"},
}
_SUFFIX = re.compile(rf"_({'|'.join(_UNITS)})(?=(?:\.[^.]*)?$)")


def unit_of_column(column: str) -> str:
    """The unit in the name of a column of the rows, ``contact.peak_N``; empty without one."""
    found = _SUFFIX.search(column)
    return _UNITS[found[1]] if found else ""


def without_unit(column: str) -> str:
    """The name of a column without its unit: ``contact.peak``. Of a function of a file, the function's name."""
    return _SUFFIX.sub("", column.rpartition(":")[2])


def limits(given: Mapping[str, Any], metrics: Sequence[str], folder: Path, faults: list[Fault]) -> dict[str, Limit]:
    """The limits of the table ``[success]`` by column of the rows: true or false, or the least and the greatest value.

    A name is as for :func:`kept_column`. Errors are appended to ``faults``.
    """
    found: dict[str, Limit] = {}
    for name, value in leaves(given, lists=False):
        place = f"success.{name}"
        try:
            metric, column = kept_column(name, metrics, folder)
            if number_of(metric) and column not in columns_of(metric):
                raise InputError(f"has components: give {' or '.join(columns_of(metric))}")
            if column in found:
                raise InputError("is given twice")
            found[column] = _limit(value, metric)
        except InputError as error:
            faults += [Fault(place, fault.message) for fault in error.faults]
    return found


def _limit(value: Any, metric: str) -> Limit:
    """A limit of a metric. Raises InputError if it is not one."""
    number = number_of(metric)
    kind = None if number is None else number.kind
    wanted = "true or false" if kind is bool else "a range [low, high]"
    if kind is str:
        raise InputError("is a text, which has no limits")
    if kind is not None and isinstance(value, bool) != (kind is bool):
        raise InputError(f"{shortened(value)} must be {wanted}")
    if isinstance(value, bool):
        return value
    if not _is_range(value):
        either = "" if kind is not None else "true, false, or "
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
        return all(value == True for column, value in row.items() if is_settled(column))  # noqa: E712  # not nan
    return all(_within(row.get(column), limit) for column, limit in given.items())


def _within(value: Any, limit: Limit) -> bool:
    if value is None:
        return False
    return bool(value == limit) if isinstance(limit, bool) else bool(limit[0] <= value <= limit[1])


def successes(frame: "pd.DataFrame", given: Mapping[str, Limit]) -> np.ndarray:
    """Whether each row (n,) is a success: the column ``success``, or what it would be in rows without it."""
    if "success" in frame:
        return frame["success"].to_numpy(dtype=bool)
    needed = [name for name in frame.columns if name in ("status", *given) or (not given and is_settled(name))]
    return np.array([succeeded(row, given) for row in frame[needed].to_dict("records")], dtype=bool)


def in_words(given: Mapping[str, Limit], settled: bool) -> str:
    """The definition of success. ``settled`` is whether the rows have :data:`SETTLED`."""
    if not given:
        return "a run succeeds if it completed" + (" and has settled" if settled else "")
    parts = [
        f"{name} is {str(limit).lower()}" if isinstance(limit, bool) else f"{name} is from {limit[0]:g} to {limit[1]:g}"
        for name, limit in given.items()
    ]
    return f"a run succeeds if it completed, and {', and '.join(parts)}"
