"""Places of numbers in a scenario: a dotted key, also of one wall, ``walls[0].friction``, or a component of one,
``initial.position[0]``."""

import copy
import difflib
import functools
import operator
import re
from collections.abc import Mapping
from typing import Annotated, Any

from ...errors import suggestion
from ...quantities import refusing
from ...scenario import LISTS, Scenario
from ...setup.world import OF_ONE, VEHICLES, World
from ...stages.signals import OWN_UNIT

_LIST = rf"({'|'.join(LISTS)})\[(\d+)\]"
_OF_VEHICLE = rf"(?:{VEHICLES}\[\w+\]\.)?"
_PLACE = re.compile(rf"({_OF_VEHICLE}(?:{_LIST.replace('(', '(?:')}|[\w-]+)\.[\w-]+)((?:\[\d+\]|\.[\w-]+)*)")
_LISTED = re.compile(_LIST)
_PART = re.compile(r"\[(\d+)\]|\.([\w-]+)")


Place = Annotated[
    str,
    refusing(
        lambda text: not _PLACE.fullmatch(text),
        "is not a dotted key such as wall.stiffness, or a component as initial.position[0]",
    ),
]
"""A dotted key, or a component of one, in a validated table."""


def parsed(place: str) -> tuple[str, list[int | str]]:
    """The dotted key of a place and the way to its component: ("initial.position", [0])."""
    found = _PLACE.fullmatch(place)
    assert found is not None
    return found[1], [int(index) if index else word for index, word in _PART.findall(found[2])]


def of_vehicle(place: str) -> tuple[str, str]:
    """The vehicle of a place in a world, and the place in its scenario; no vehicle for a place of the world, of every
    vehicle, or in the scenario of one."""
    found = OF_ONE.fullmatch(place)
    return (found[1], found[2]) if found else ("", place)


def overlap(one: str, other: str) -> bool:
    """Whether two places are the same, or one is a component of the other. A place of every vehicle is one of each."""
    (vehicle, one), (another, other) = of_vehicle(one), of_vehicle(other)
    if vehicle and another and vehicle != another:
        return False
    return one == other or one.startswith((f"{other}[", f"{other}.")) or other.startswith((f"{one}[", f"{one}."))


def sets_in_vain(key: str, place: str) -> bool:
    """Whether a key has no effect where a place varies: it is the same one, or of one vehicle, and every vehicle's
    varies."""
    return key == place or (of_vehicle(place)[0] == "" and of_vehicle(key)[1] == place)


def table_in(name: str, tables: Mapping[str, Any]) -> Any:
    """The table of a key without its last word, also of one wall, ``walls[0]``, or of a vehicle,
    ``vehicles[left].controller``; None if there is none."""
    vehicle, name = of_vehicle(name)
    if vehicle:
        own = {each["name"]: each for each in tables.get(VEHICLES, ())}
        return table_in(name, own[vehicle]) if vehicle in own else None
    if (found := _LISTED.fullmatch(name)) is None:
        return tables.get(name)
    listed = tables.get(found[1], [])
    return listed[int(found[2])] if int(found[2]) < len(listed) else None


def value_at(place: str, tables: Mapping[str, Any]) -> Any:
    """The value of a place in the tables of a scenario."""
    key, parts = parsed(place)
    table, _, word = key.rpartition(".")
    return functools.reduce(operator.getitem, parts, table_in(table, tables)[word])


def overrides_at(values: Mapping[str, Any], tables: Mapping[str, Any]) -> dict[str, Any]:
    """Overrides by dotted key, from values by place. A component replaces its number in the value of ``tables``,
    the tables of the scenario."""
    overrides: dict[str, Any] = {}
    for place, value in values.items():
        key, parts = parsed(place)
        if not parts:
            overrides[key] = value
            continue
        table, _, word = key.rpartition(".")
        whole = overrides.setdefault(key, copy.deepcopy(table_in(table, tables)[word]))
        functools.reduce(operator.getitem, parts[:-1], whole)[parts[-1]] = value
    return overrides


def missing(place: str, tables: Mapping[str, Any]) -> str:
    """The reason why the tables of a scenario lack a component; empty for a whole key, which the scenario checks."""
    key, parts = parsed(place)
    table, _, word = key.rpartition(".")
    own = table_in(table, tables)
    vehicle, _ = of_vehicle(key)
    names = [each["name"] for each in tables.get(VEHICLES, ())]
    if vehicle and vehicle not in names:
        return f"the world has {', '.join(names)}" if names else "the base scenario is of one vehicle"
    if own is None and (found := _LISTED.fullmatch(table)):
        return f"the scenario has {len(tables.get(found[1], []))} [[{found[1]}]]"
    if not parts:
        return ""
    if own is None and names:
        of_one = f"{VEHICLES}[{vehicle or names[0]}].{of_vehicle(place)[1]}"
        return f"no table {table!r} of the world; of one vehicle it is {of_one}"
    if own is None:
        return f"no table {table!r}; {suggestion(table, (t for t in tables if isinstance(tables[t], dict)))}"
    if word not in own:
        close = difflib.get_close_matches(word, own, 1)
        hint = f"did you mean {close[0]!r}?" if close else "give it a value in [base] to vary a component"
        return f"{key} has no components in the base scenario; {hint}"
    inner, seen = own[word], key
    for part in parts:
        if isinstance(part, int) and isinstance(inner, list):
            if part >= len(inner):
                return f"{seen} has {len(inner)} components{f', [0] to [{len(inner) - 1}]' if inner else ''}"
            inner, seen = inner[part], f"{seen}[{part}]"
        elif isinstance(inner, Mapping) and part in inner:
            inner, seen = inner[str(part)], f"{seen}.{part}"
        else:
            return f"{seen} has no component {part!r}"
    return ""


def unit_of(place: str, scenario: Scenario | World) -> str:
    """The unit of a place; empty if its number has none. Of two units, "N, N m", the first belongs to the first three
    components of six."""
    vehicle, place = of_vehicle(place)
    if isinstance(scenario, World):
        scenario = scenario.scenarios.get(vehicle) or next(iter(scenario.scenarios.values()))
    key, parts = parsed(place)
    table, _, word = key.rpartition(".")
    found = _LISTED.fullmatch(table)
    own = getattr(scenario, found[1])[int(found[2])] if found else getattr(scenario, table, None)
    field = getattr(own, "__dataclass_fields__", {}).get(word)
    if field is None:
        return ""
    brackets = re.findall(r"\[([^\]]*)\]", field.metadata.get("meaning", ""))
    unit = str(field.metadata.get("unit", brackets[-1] if brackets else ""))
    each = [part.strip() for part in unit.split(",")]
    if len(parts) == 1 and isinstance(parts[0], int) and len(each) == 2:
        unit = each[parts[0] >= 3]
    return "" if unit in ("1", "-", OWN_UNIT) else unit
