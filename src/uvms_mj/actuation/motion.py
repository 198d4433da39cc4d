"""Given motions of joints: a table over time, in a scenario or in a CSV file, and its interpolation.

A motion is made of segments, polynomials of third order that are held before the first and after the last time. Linear
interpolation has straight segments. Cubic interpolation is the cubic spline with zero velocity at both ends, so that
velocity and acceleration are continuous in between.
"""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import AfterValidator
from pydantic.dataclasses import dataclass as table

from ..errors import Fault, InputError
from ..physics.kernels import kernel
from ..quantities import STRICT, Number, Time

MOST_TIMES = 100_000
_SEARCH = 20
"""Halvings of a search among at most 2^20 segments."""

Coordinates = Annotated[tuple[Number, ...], "a number for each joint"]


@table(frozen=True, config=STRICT)
class Waypoint:
    time: Time
    joints: Coordinates


def in_time(waypoints: tuple[Waypoint, ...]) -> tuple[Waypoint, ...]:
    for before, after in itertools.pairwise(waypoints):
        if after.time <= before.time:
            raise ValueError(f"has the time {after.time:g} s after {before.time:g} s; the times must increase")
    return waypoints


Waypoints = Annotated[tuple[Waypoint, ...], AfterValidator(in_time)]


def read_motion(path: str, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) [s] and values (m, n) of a CSV file with the columns ``time`` and one for each joint, by its name.
    Other columns are ignored.

    Raises:
        InputError: the file can't be read, lacks a column, has an entry that is no finite number, or times that do not
            increase; names the line.
    """
    key = "joints.motion_file"
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.reader(file))
    except (OSError, ValueError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError([Fault(key, f"can't read {Path(path).absolute()}: {reason}")]) from None
    header = [word.strip() for word in rows[0]] if rows else []
    wanted = ["time", *joints]
    missing = [name for name in wanted if name not in header]
    if missing:
        there = f"its columns are {', '.join(header[:30])}" if header else "it is empty"
        raise InputError([Fault(key, f"{path}: has no column {', '.join(missing)}; {there}")])
    places = [header.index(name) for name in wanted]
    numbers: list[list[float]] = []
    for line, row in enumerate(rows[1:], 2):
        if not any(word.strip() for word in row):
            continue
        try:
            values = [float(row[i]) for i in places]
        except (ValueError, IndexError):
            values = [math.nan]
        if not all(map(math.isfinite, values)):
            raise InputError([Fault(key, f"{path}, line {line}: has no number in a column of {', '.join(wanted)}")])
        if numbers and values[0] <= numbers[-1][0]:
            after = f"the time {values[0]:g} s does not increase after {numbers[-1][0]:g} s"
            raise InputError([Fault(key, f"{path}, line {line}: {after}")])
        numbers.append(values)
    if not 1 <= len(numbers) <= MOST_TIMES:
        raise InputError([Fault(key, f"{path}: has {len(numbers)} times; 1 to {MOST_TIMES} are allowed")])
    found = np.array(numbers)
    return found[:, 0], found[:, 1:]


def segments(times: np.ndarray, values: np.ndarray, interpolation: str) -> dict[str, np.ndarray]:
    """The constants of :func:`segment_at` and :func:`value_at` for values (m, n) at times (m,), "linear" or "cubic".

    Their number is a power of two, so that few lengths of a motion have machine code of their own.
    """
    from scipy.interpolate import CubicSpline  # imported where it is used, because it takes long

    m, n = values.shape
    rest = np.zeros((1, 4, n))
    first, last = rest.copy(), rest.copy()
    first[0, 3], last[0, 3] = values[0], values[-1]
    between = np.zeros((m - 1, 4, n))
    if m > 1 and interpolation == "cubic":
        between = np.moveaxis(CubicSpline(times, values, bc_type="clamped").c, 1, 0)
    elif m > 1:
        between[:, 2], between[:, 3] = np.diff(values, axis=0) / np.diff(times)[:, None], values[:-1]
    size = 1 << m.bit_length()  # m + 1 segments at most
    begins, coefficients = np.full(size, np.inf), np.zeros((size, 4, n))
    begins[0], begins[1 : m + 1] = -np.inf, times
    coefficients[: m + 1] = np.concatenate([first, between, last])
    return {"begins": begins, "coefficients": coefficients}


@kernel
def segment_at(begins, t) -> int:
    """Index of the piece of the time t."""
    n, size = 0, begins.shape[0]
    for _ in range(_SEARCH):
        size = size >> 1
        if begins[n + size] <= t:
            n += size
    return n


@kernel
def value_at(begins, c, n, j, t) -> float:
    """The value of joint j in piece n at the time t."""
    x = t - begins[n] if n > 0 else 0.0
    return ((c[n, 0, j] * x + c[n, 1, j]) * x + c[n, 2, j]) * x + c[n, 3, j]


@kernel
def rate_at(begins, c, n, j, t) -> float:
    """Its derivative by time."""
    x = t - begins[n] if n > 0 else 0.0
    return (3.0 * c[n, 0, j] * x + 2.0 * c[n, 1, j]) * x + c[n, 2, j]
