"""A table of thrusters in CSV: a row each, with name, position and direction in B, and limits of the thrust.

The unit of a column is in its head. ``name``; the position ``x``, ``y``, ``z`` with ``_m``, ``_cm`` or ``_mm``; the
direction of positive thrust as ``dx``, ``dy``, ``dz``, a vector of any length, or as ``yaw_deg`` and ``pitch_deg`` of a
frame whose x axis it is, where a pitch of -90 points up; and, if the thrust has limits, ``min`` and ``max`` with ``_N``
or ``_kgf``.
"""

import csv
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import Fault, InputError, number_hint, suggestion
from ..files import text_of
from ..physics.frames import quat_from_euler_deg, rotation_matrix

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
FORCES = {"N": 1.0, "kgf": 9.80665}
ANGLES = {"deg": 1.0}
_UNITS: Mapping[str, Mapping[str, float]] = {
    **dict.fromkeys(("x", "y", "z"), LENGTHS),
    **dict.fromkeys(("min", "max"), FORCES),
    **dict.fromkeys(("yaw", "pitch"), ANGLES),
}
"""The units of each quantity, with their factors to SI or degrees."""
_DIRECTION = ("dx", "dy", "dz")
COLUMNS = "name, x_m, y_m, z_m, dx, dy, dz (or yaw_deg, pitch_deg), min_N, max_N"
_FARTHEST, _STRONGEST = 100.0, 1e6
_NAME = re.compile(r"[A-Za-z]\w{0,63}", re.ASCII)


@dataclass(frozen=True)
class Thruster:
    """One thruster: position (3,) [m], unit direction of positive thrust (3,), both in B, and limits [N] or None."""

    name: str
    position: tuple[float, float, float]
    direction: tuple[float, float, float]
    limits: tuple[float, float] | None


def read_thrusters(path: Path) -> list[Thruster]:
    """The thrusters of a CSV file. Raises InputError with the row and the column of each error; a row is counted by its
    line in the file."""
    try:
        lines = text_of(path).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: can't read it: {getattr(error, 'strerror', None) or error}") from None
    numbered = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not numbered:
        raise InputError(f"{path}: is empty; its columns are {COLUMNS}")
    separator = max(",;\t", key=numbered[0][1].count)
    rows = [(n, [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]) for n, line in numbered]
    heads, faults = rows[0][1], list[Fault]()
    scales = _scales(heads, faults)
    if faults:
        raise InputError(faults, str(path))
    found: list[Thruster] = []
    for n, cells in rows[1:]:
        if len(cells) != len(heads):
            faults.append(Fault(f"row {n}", f"has {len(cells)} values; the head has {len(heads)} columns"))
            continue
        values = dict(zip(heads, cells, strict=True))
        name = values["name"]
        if not _NAME.fullmatch(name):
            wrong = f"{name!r} must be a word of letters, digits and _ that begins with a letter"
            faults.append(Fault(f"row {n}, column name", wrong))
        elif name in (each.name for each in found):
            faults.append(Fault(f"row {n}, column name", f"{name!r} is given twice"))
        numbers = _numbers(n, {head: values[head] for head in heads if head != "name"}, scales, faults)
        thruster = None if numbers is None else _thruster(n, name, numbers, heads, faults)
        if thruster is not None:
            found.append(thruster)
    if not faults and not found:
        faults.append(Fault("", "has no thruster below its head"))
    if faults:
        raise InputError(faults, str(path))
    return found


def _scales(heads: list[str], faults: list[Fault]) -> dict[str, tuple[str, float]]:
    """The quantity of each column and the factor of its unit. Appends errors of the head."""
    found: dict[str, tuple[str, float]] = {}
    for head in heads:
        word, _, unit = head.partition("_")
        if head in ("name", *_DIRECTION):
            quantity, factor = head, 1.0
        elif word in _UNITS and unit in _UNITS[word]:
            quantity, factor = word, _UNITS[word][unit]
        elif word in _UNITS:
            choices = " or ".join(f"{word}_{unit}" for unit in _UNITS[word])
            faults.append(Fault(f"column {head!r}", f"its unit is missing or unknown: write {choices}"))
            continue
        else:
            known = [*_DIRECTION, "name", *(f"{word}_{unit}" for word, units in _UNITS.items() for unit in units)]
            faults.append(Fault(f"column {head!r}", f"is not known; {suggestion(head, known)}"))
            continue
        if quantity in (other for other, _ in found.values()):
            faults.append(Fault(f"column {head!r}", f"{quantity} is given twice"))
        found[head] = quantity, factor
    given = {quantity for quantity, _ in found.values()}
    missing = [word for word in ("name", "x", "y", "z") if word not in given]
    vector, angles = given & {*_DIRECTION}, given & {"yaw", "pitch"}
    if not faults and missing:
        faults.append(Fault("", f"lacks {', '.join(missing)}; its columns are {COLUMNS}"))
    elif not faults and (bool(vector) == bool(angles) or (vector and len(vector) < 3)):
        faults.append(Fault("", "needs a direction: dx, dy and dz, or yaw_deg and pitch_deg"))
    if not faults and len(given & {"min", "max"}) == 1:
        faults.append(Fault("", "needs both limits, min and max, or neither"))
    return found


def _numbers(
    n: int, cells: Mapping[str, str], scales: Mapping[str, tuple[str, float]], faults: list[Fault]
) -> dict[str, float] | None:
    """The numbers of a row by quantity in SI or degrees; limits that are left empty are left out."""
    found, before = dict[str, float](), len(faults)
    for head, text in cells.items():
        quantity, factor = scales[head]
        if not text and quantity in ("min", "max"):
            continue
        try:
            value = float(text) * factor
        except ValueError:
            value = math.nan
        most = {"min": _STRONGEST, "max": _STRONGEST, "x": _FARTHEST, "y": _FARTHEST, "z": _FARTHEST}.get(quantity, 1e6)
        if math.isnan(value):
            unit = head.partition("_")[2]
            faults.append(Fault(f"row {n}, column {head}", f"{text!r} is not a number{number_hint(text, unit)}"))
        elif abs(value) > most:
            faults.append(Fault(f"row {n}, column {head}", f"{text} is beyond {most / factor:g}"))
        found[quantity] = value
    return found if len(faults) == before else None


def _thruster(
    n: int, name: str, numbers: Mapping[str, float], heads: list[str], faults: list[Fault]
) -> Thruster | None:
    if "dx" in numbers:
        direction = np.array([numbers[word] for word in _DIRECTION])
    else:
        direction = rotation_matrix(quat_from_euler_deg(0.0, numbers.get("pitch", 0.0), numbers.get("yaw", 0.0)))[:, 0]
        direction = np.where(np.abs(direction) < 1e-15, 0.0, direction)
    length = float(np.linalg.norm(direction))
    if length < 1e-6:
        faults.append(Fault(f"row {n}, columns dx, dy, dz", "the direction has no length"))
        return None
    low, high = numbers.get("min"), numbers.get("max")
    if (low is None) != (high is None):
        missing = next(head for head in heads if head.startswith("min" if low is None else "max"))
        faults.append(Fault(f"row {n}, column {missing}", "is empty; give both limits or neither"))
        return None
    if low is not None and high is not None and not low < high:
        faults.append(Fault(f"row {n}", f"the least thrust, {low:g} N, must be below the greatest, {high:g} N"))
        return None
    x, y, z = (direction / length).tolist()
    limits = None if low is None or high is None else (low, high)
    return Thruster(name, (numbers["x"], numbers["y"], numbers["z"]), (x, y, z), limits)
