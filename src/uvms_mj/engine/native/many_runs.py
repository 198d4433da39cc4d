"""Many runs in one call of machine code: their steps, and their numbers as one table."""

import functools
from typing import Any

import numpy as np

from .compilation import NativeFunction, native_functions
from .memory import call_code, floats
from .record import NUMBERS

_PLACES, _TABLE = np.dtype(("i8", (NUMBERS,))), np.dtype(("f8", (NUMBERS,)))


def take_steps(runs, first, last, n, step, advance, control):
    """Take n time steps in each of the runs ``first`` to ``last``, by the addresses of their records, and prepare the
    next one: its stages up to index ``control``. ``step`` and ``advance`` are addresses of machine code."""
    for i in range(first, last):
        call_code(step, runs[i], n, 1)
        call_code(advance, runs[i], control)


def gather(runs, n, places, count, table):
    """Copy ``count`` numbers of each of n runs to the rows of a table, by their places in the record."""
    for i in range(n):
        numbers = floats(runs[i], NUMBERS)
        for k in range(count):
            table[i * count + k] = numbers[places[k]]


def scatter(runs, n, places, count, table):
    """Copy the rows of a table to the records, the reverse of :func:`gather`."""
    for i in range(n):
        numbers = floats(runs[i], NUMBERS)
        for k in range(count):
            numbers[places[k]] = table[i * count + k]


@functools.cache
def many_runs() -> dict[str, NativeFunction]:
    """The machine code of this module, by name."""
    copy: list[np.dtype | str] = [_PLACES, "i8", _PLACES, "i8", _TABLE]
    parts: dict[Any, list[np.dtype | str]] = {take_steps: [_PLACES, *["i8"] * 6], gather: copy, scatter: copy}
    return {each.__name__: code for each, code in zip(parts, native_functions(parts), strict=True)}
