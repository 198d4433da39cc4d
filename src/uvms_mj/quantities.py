"""Types of the quantities in scenarios and gains: finite numbers and vectors with their ranges.

The ranges are far wider than any vehicle needs. Within them, no product in the equations overflows.
"""

import dataclasses
import itertools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Annotated, Any

from annotated_types import Ge, Le
from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field

from .errors import InputError

Real = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e12, le=1e12)]
"""A finite number."""
Positive = Annotated[Real, Ge(1e-12), Le(1e12)]
NonNegative = Annotated[Real, Ge(0), Le(1e12)]
_Validator = AfterValidator | BeforeValidator


def within(low: float, high: float, unit: str) -> _Validator:
    """A validator for a range; its message includes the unit."""
    return refusing(lambda value: not low <= value <= high, f"must be from {low:g} to {high:g} {unit}".rstrip())


def refusing(wrong: Callable[[Any], bool], text: str, kind: type[_Validator] = AfterValidator) -> _Validator:
    """A validator that refuses a wrong value with a text; a BeforeValidator has it as it is given."""

    def check(value: Any) -> Any:
        if wrong(value):
            raise ValueError(text)
        return value

    return kind(check)


def repeated(n: int) -> BeforeValidator:
    """A validator that takes one number for n equal ones."""

    def fill(value: Any) -> Any:
        return (value,) * n if isinstance(value, int | float) and not isinstance(value, bool) else value

    return BeforeValidator(fill)


def of_length(n: int) -> AfterValidator:
    """A validator for the length of a list."""

    def check(value: tuple[Any, ...]) -> tuple[Any, ...]:
        if len(value) != n:
            raise ValueError(f"has {len(value)} values; {n} are needed")
        return value

    return AfterValidator(check)


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A finite number; :func:`within` adds the range."""
Whole = Annotated[int, Field(strict=True)]
"""A whole number, no text and no truth value; :func:`within` adds the range."""
Switch = Annotated[bool, Field(strict=True)]
"""true or false, and no word or number for it."""
Step = Annotated[Number, within(1e-7, 1.0, "s")]
"""A time step or a sampling period."""
Duration = Annotated[Number, within(1e-7, 1e7, "s")]
"""A simulated time."""
Time = Annotated[Number, within(0.0, 1e7, "s")]
"""An instant of a run."""
Coordinate = Annotated[Number, within(-1e6, 1e6, "m")]
"""A position. Up to this limit a double resolves better than a nanometre."""
Angle = Annotated[Number, within(-1e6, 1e6, "deg")]
Factor = Annotated[Number, within(-1e3, 1e3, "")]
PositiveFactor = Annotated[Number, within(1e-3, 1e3, "")]

Position = Annotated[tuple[Coordinate, ...], of_length(3)]
Angles = Annotated[tuple[Angle, ...], of_length(3)]
Moderate = Annotated[Real, Ge(-1e6), Le(1e6)]
Vector3 = Annotated[tuple[Moderate, ...], of_length(3)]
Vector6 = Annotated[tuple[Real, ...], of_length(6)]
Twist = Annotated[tuple[Annotated[Number, within(-100.0, 100.0, "m/s, rad/s")], ...], of_length(6)]
Wrench = Annotated[tuple[Annotated[Number, within(-1e6, 1e6, "N, N m")], ...], of_length(6)]
Frequencies = Annotated[tuple[Annotated[Number, within(0.0, 1e7, "Hz")], ...], of_length(6)]
Stiffnesses = Annotated[tuple[Annotated[Number, within(0.0, 1e9, "N/m, N m")], ...], of_length(6)]
Factors = Annotated[tuple[Annotated[Number, within(0.0, 1e6, "")], ...], of_length(6)]


def _matrix(limit: float, unit: str, word: str = "") -> Any:
    """A 6x6 matrix, given as six numbers (its diagonal) or as six rows of six numbers, or a word in its place."""
    either = f'"{word}", ' if word else ""

    def six(row: Any) -> bool:
        return isinstance(row, (list, tuple)) and len(row) == 6

    def numbers(row: Any) -> bool:
        return six(row) and set(map(type, row)) <= {int, float}

    def check(value: Any) -> Any:
        if value is None or (word and value == word):
            return value
        diagonal = numbers(value)
        if not diagonal and not (six(value) and all(map(numbers, value))):
            raise ValueError(f"must be {either}six numbers, a diagonal, or six rows of six numbers")
        rows = [value] if diagonal else value
        if not all(map(limit.__ge__, map(abs, itertools.chain.from_iterable(rows)))):
            raise ValueError(f"must have numbers from {-limit:g} to {limit:g} {unit}")
        rows = [tuple(map(float, row)) for row in rows]
        return rows[0] if diagonal else tuple(rows)

    return Annotated[tuple[Any, ...] | str | None, BeforeValidator(check)]


Inertia = _matrix(1e9, "kg, kg m, kg m^2", "natural")
Damping = _matrix(1e9, "N s/m, N s, N m s")


STRICT = ConfigDict(extra="forbid", arbitrary_types_allowed=True, defer_build=True)
"""Configuration of all validated dataclasses, tables of a scenario or files of a log: an unknown key is an error. Only
controllers are validated in another way, because a user writes them as dataclasses of the standard library. A validator
is made at its first use: most commands use few of them."""
Lowercase = BeforeValidator(lambda value: value.lower() if isinstance(value, str) else value)


def leaves(value: Any, key: str = "", lists: bool = True) -> Iterator[tuple[str, Any]]:
    """Every leaf of nested tables by its place, ``contact.peak_N``, and unless a list is a leaf, ``final.s[0]``."""
    if isinstance(value, Mapping):
        for name, each in value.items():
            yield from leaves(each, f"{key}.{name}" if key else name, lists)
    elif lists and isinstance(value, list | tuple):
        for i, each in enumerate(value):
            yield from leaves(each, f"{key}[{i}]")
    else:
        yield key, value


_COMMON = [n for n in range(15, 361, 15) if n % 30 == 0 or n % 45 == 0]
"""Angles that are often written in radians [deg]."""


def radians_notes(tables: Mapping[str, Any]) -> list[str]:
    """A note for each key in degrees, one that ends in ``_deg``, whose numbers are all common angles in
    radians, with at least two decimals: 1.57 for 90 degrees."""
    found: dict[str, list[float]] = {}
    for key, value in leaves(tables):
        key = key.rpartition("[")[0] if key.endswith("]") else key
        if key.endswith("_deg") and isinstance(value, int | float) and value:
            found.setdefault(key, []).append(float(value))
    notes = []
    for key, values in found.items():
        meant = [_meant(value) for value in values]
        if None not in meant:
            said = ", ".join(f"{value:g}" for value in values)
            turned = ", ".join(f"{degrees:g}" for degrees in meant)
            notes.append(f"{key} is in degrees; {said} looks like radians, of {turned} deg")
    return notes


def _meant(value: float) -> int | None:
    """The common angle [deg] that a number gives in radians, rounded or cut to its decimals, at least two; None if
    there is none."""
    unit = 10.0 ** -len(repr(value).partition(".")[2])
    same = (n for n in _COMMON if unit < 0.05 and -1e-12 <= math.radians(n) - abs(value) + 0.5 * unit < 1.5 * unit)
    n = next(same, None)
    return None if n is None else round(math.copysign(n, value))


def overrides_of(given: Any, place: str = "overrides") -> dict[str, Any]:
    """Overrides by dotted key, with numbers and lists in place of NumPy's scalars and arrays. None has no overrides.

    Raises:
        InputError: ``given`` is not a mapping, or a key is not a text.
    """
    if given is None:
        return {}
    if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
        raise InputError(f"{place}: {given!r} is not a mapping from dotted keys to values, {{'wall.stiffness': 1e4}}")
    return {key: value.tolist() if hasattr(value, "tolist") else value for key, value in given.items()}


def doc(meaning: str, default: Any = dataclasses.MISSING) -> Any:
    """A field with its default, if it has one, and a one-line meaning for lists of keys."""
    return dataclasses.field(default=default, metadata={"meaning": meaning})


_IN_BRACKETS = re.compile(r"\[([^\[\]]*)\](?=$|;)")


def unit_of(field: dataclasses.Field) -> str:
    """The unit of a setting or of a key, from its own entry or from the brackets in its meaning; empty without one."""
    found = _IN_BRACKETS.findall(field.metadata.get("meaning", ""))
    return str(field.metadata.get("unit", found[-1] if found else ""))


def default_of(table: Any, name: str) -> Any:
    """The default of a field of a table."""
    return next(f.default for f in dataclasses.fields(table) if f.name == name)


def idle(table: Any, key: str, names: Iterable[str], reason: str) -> Iterator[str]:
    """A sentence that the named keys of a table have no effect, as far as they differ from their defaults; ``key`` is
    the table's."""
    given = [f"{key}.{name}" for name in names if getattr(table, name) != default_of(table, name)]
    if given:
        yield f"{', '.join(given)} {'have' if len(given) > 1 else 'has'} no effect: {reason}"
