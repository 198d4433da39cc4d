"""The metrics of a study: numbers of a run's summary by their names, and functions of the user's."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..analysis.summary import NUMBERS
from ..errors import Fault, InputError, suggestion
from ..stages.loader import load_file

if TYPE_CHECKING:
    from ..records.trace import Trace

NOT_METRICS = {
    **dict.fromkeys(("scenario", "controller", "warnings"), "is the same for many runs; see the scenario"),
    **dict.fromkeys(("status", "message", "steps"), "is a column of every row; leave it out"),
    **dict.fromkeys(("timestep_s", "duration_s"), "follows from steps and simulation.timestep; leave it out"),
    **dict.fromkeys(("wall_time_s", "real_time_factor"), "differs from one execution to the next, and rows must not"),
}
"""Numbers of a summary that are not metrics of a study, with the reason."""


def metric_of(name: str) -> "Callable[[Trace], Any]":
    """The function of a trace that gives a metric, by its place in a summary or from ``path/to/file.py:function``.

    Raises:
        InputError: there is no such metric, or the file can't be loaded.
    """
    if name in NOT_METRICS:
        raise InputError(f"{name!r} {NOT_METRICS[name]}")
    if name in NUMBERS:
        return NUMBERS[name]
    file, colon, word = name.rpartition(":")
    if not colon or not file.endswith(".py"):
        hint = suggestion(name, set(NUMBERS) - set(NOT_METRICS))
        raise InputError(f"no metric {name!r}; {hint}; for your own give path/to/file.py:function")
    path = Path(file)
    if not path.is_file():
        raise InputError(f"no file {file!r} (looked in {Path.cwd()})")
    try:
        functions = {key: value for key, value in vars(load_file(path.absolute(), "")).items() if callable(value)}
    except InputError as error:
        raise InputError([Fault("", fault.message) for fault in error.faults]) from None
    if word not in functions:
        raise InputError(f"no function {word!r} in {file}; {suggestion(word, functions)}")
    return functions[word]
