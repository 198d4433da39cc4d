"""Checks of the keys that vary, before the first run: that every law has them, and that their extremes can run."""

import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..analysis.sampling import checked
from ..errors import Fault, InputError
from ..plant.mjcf import Mjcf
from ..scenario import Scenario
from .draws import Variation
from .entries import Law, unknown_labels
from .places import missing, overrides_at, parsed

MOST_CHECKED = 50
"""A longer list of numbers is checked at its least and its greatest one."""


def combination_faults(
    variations: Sequence[Variation], laws: list[Law], overrides: Mapping[str, Any]
) -> Iterator[Fault]:
    """Errors for keys that are given twice, and for labels that are not of a law."""
    seen: dict[str, str] = {}
    for each in variations:
        if laws:
            yield from unknown_labels(each.laws, laws, each.place)
        for place in each.keys:
            key = parsed(place)[0]
            twice = next((other for other in seen if place in (other, parsed(other)[0]) or other == key), None)
            if twice is not None:
                yield Fault(each.place, f"{place} varies in {seen[twice]} already, as {twice}")
            if place in overrides or key in overrides and place == key:
                yield Fault(key, f"{each.place} varies this key: setting it has no effect")
            for i, law in enumerate(laws):
                if place in law.overrides and each.covers(law.label):
                    yield Fault(f"laws[{i}].{place}", f"{each.place} varies this key: setting it has no effect")
            seen[place] = each.place


def key_faults(variations: Sequence[Variation], laws: Sequence[Law], points: Sequence[tuple[Any, ...]]) -> list[Fault]:
    """Errors for keys that a law lacks, and for extremes that a scenario refuses or that can't run.

    An extreme that can't run with the other keys at their base values is tried as it is drawn, with the other keys of
    that draw. A single draw that can't run is no error of the study: its row has the reason.
    """
    faults: dict[tuple[str, str], Fault] = {}
    first = 0
    for each in variations:
        columns = range(first, first := first + len(each.keys))
        for law in laws:
            if each.covers(law.label):
                for fault in _faults(each, law, laws, variations, points, columns):
                    faults.setdefault((fault.key, fault.message), fault)
    return list(faults.values())


def _faults(
    each: Variation,
    law: Law,
    laws: Sequence[Law],
    variations: Sequence[Variation],
    points: Sequence[tuple[Any, ...]],
    columns: range,
) -> Iterator[Fault]:
    absent = [Fault(each.place, f"{place}: {why}") for place in each.keys if (why := missing(place, law.tables))]
    if absent:
        yield from absent
        return
    drawn = [tuple(point[i] for i in columns) for point in points]
    for where, values in _extremes(each, drawn):
        place = f"{each.place}{where}"
        try:
            scenario = law.scenario.updated(overrides_at(dict(zip(each.keys, values, strict=True)), law.tables))
        except InputError as error:
            yield from (Fault(place, f"{fault}{_hint(fault, law, laws)}") for fault in error.faults)
            if not where:  # no such key, whatever the value
                return
            continue
        try:
            _can_run(scenario)
        except InputError as error:
            if not _runs_as_drawn(law, variations, points, drawn, values):
                yield from (Fault(place, str(fault)) for fault in error.faults)


def _extremes(each: Variation, drawn: Sequence[tuple[Any, ...]]) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """Where the extreme values of an entry are in the study file, and the values of its keys."""
    if each.distribution:
        if "low" in each.parameters[0]:
            for end in ("low", "high"):
                yield f".{end}", tuple(parameters[end] for parameters in each.parameters)
        elif drawn:
            yield ".deviation", min(drawn)
            yield ".deviation", max(drawn)
        return
    numbers = all(isinstance(value, float) for level in each.levels for value in level)
    if each.grid:
        yield ".low", each.levels[0]
        yield ".high", each.levels[-1]
    elif numbers and len(each.levels) > MOST_CHECKED:
        yield ".values", min(each.levels)
        yield ".values", max(each.levels)
    else:
        yield from ((f".values[{i}]", level) for i, level in enumerate(each.levels))


def _hint(fault: Fault, law: Law, laws: Sequence[Law]) -> str:
    """Which laws have a gain that this law lacks."""
    table, _, word = fault.key.partition(".")
    if table != "controller" or word in law.tables["controller"]:
        return ""
    having = [f'"{other.label}"' for other in laws if word in other.tables["controller"]]
    return f"; to vary it for the laws that have it, give laws = [{', '.join(having)}]" if having else ""


@functools.lru_cache(maxsize=8)
def _mjcf(model: str) -> Mjcf:
    return Mjcf.find(model)


def _can_run(scenario: Scenario) -> None:
    """Raise InputError if a scenario cannot run."""
    checked(scenario, _mjcf(scenario.vehicle.model))


def _runs_as_drawn(
    law: Law,
    variations: Sequence[Variation],
    points: Sequence[tuple[Any, ...]],
    drawn: Sequence[tuple[Any, ...]],
    values: tuple[Any, ...],
) -> bool:
    """Whether the draw with these values, or with the ones nearest to them, can run."""
    if values in drawn:
        nearest = drawn.index(values)
    elif all(isinstance(value, float) for value in values):
        nearest = min(range(len(drawn)), key=lambda i: abs(drawn[i][0] - values[0]))
    else:
        return False
    keys = [(key, each.covers(law.label)) for each in variations for key in each.keys]
    given = {key: x for (key, covered), x in zip(keys, points[nearest], strict=True) if covered}
    try:
        _can_run(law.scenario.updated(overrides_at(given, law.tables)))
    except (InputError, LookupError):
        return False
    return True
