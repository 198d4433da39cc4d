"""Checks of the keys that vary, before the first run: that every law has them, and that their extremes can run."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...engine.checks import checked
from ...errors import Fault, InputError, suggestion
from .draws import Variation
from .entries import Law
from .places import missing, overlap, overrides_at

MOST_CHECKED = 50
"""A longer list of numbers is checked at its least and its greatest one."""
MOST_DRAWS = 20
"""A law is given up if none of so many draws can run."""


def combination_faults(
    variations: Sequence[Variation], laws: list[Law], overrides: Mapping[str, Any], all_laws: bool
) -> Iterator[Fault]:
    """Errors for keys that are given twice, and, if ``laws`` has all of them, for labels that are not of a law."""
    seen: dict[str, str] = {}
    known = [law.label for law in laws]
    for each in variations:
        for i, label in enumerate(each.laws):
            if all_laws and label not in known:
                yield Fault(f"{each.place}.laws[{i}]", f"no law {label!r}; {suggestion(label, known)}")
        for place in each.keys:
            twice = next((other for other in seen if overlap(place, other)), None)
            if twice is not None:
                yield Fault(each.place, f"{place} varies in {seen[twice]} already, as {twice}")
            if place in overrides:
                yield Fault(place, f"{each.place} varies this key: setting it has no effect")
            for i, law in enumerate(laws):
                if place in law.overrides and each.covers(law.label):
                    yield Fault(f"laws[{i}].{place}", f"{each.place} varies this key: setting it has no effect")
            seen[place] = each.place


@dataclass(frozen=True, eq=False)
class KeyChecks:
    """Checks of a study's keys: that every law has them, and that their extremes can run.

    An extreme that can't run with the other keys at their base values is tried as it is drawn, with the other keys of
    that draw. A single draw that can't run is no error of the study: its row has the reason.
    """

    variations: Sequence[Variation]
    laws: Sequence[Law]
    points: Sequence[tuple[Any, ...]]

    def faults(self) -> list[Fault]:
        """Every error."""
        found: dict[Fault, None] = {}  # in order, and without those that several laws share
        first = 0
        for each in self.variations:
            columns = range(first, first := first + len(each.keys))
            for law in self.laws:
                if each.covers(law.label):
                    found |= dict.fromkeys(self._of(each, law, columns))
        return list(found) or [fault for law in self.laws for fault in self._none_runs(law)]

    def _of(self, each: Variation, law: Law, columns: range) -> Iterator[Fault]:
        absent = [Fault(each.place, f"{place}: {why}") for place in each.keys if (why := missing(place, law.tables))]
        if absent:
            yield from absent
            return
        found: dict[str, list[str]] = {}
        for where, values in self._extremes(each, columns):
            try:
                scenario = law.scenario.updated(overrides_at(dict(zip(each.keys, values, strict=True)), law.tables))
            except InputError as error:
                ends = "; a truncated_normal has a least and a greatest value" if where == ".deviation" else ""
                for fault in error.faults:
                    found.setdefault(f"{fault}{self._hint(fault, law) or ends}", []).append(where)
                continue
            try:
                checked(scenario)
            except InputError as error:
                if not self._runs_as_drawn(law, columns, values):
                    for fault in error.faults:
                        found.setdefault(str(fault), []).append(where)
        for message, places in found.items():  # the same for several values: it is an error of the key
            yield Fault(each.place + (places[0] if len(set(places)) == 1 else ""), message)

    def _extremes(self, each: Variation, columns: range) -> Iterator[tuple[str, tuple[Any, ...]]]:
        """Where the extreme values of an entry are in the study file, and the values of its keys."""
        numbers = all(isinstance(value, float) for level in each.levels for value in level)
        if each.grid:
            yield ".low", each.levels[0]
            yield ".high", each.levels[-1]
        elif each.levels and numbers and len(each.levels) > MOST_CHECKED:
            yield ".values", min(each.levels)
            yield ".values", max(each.levels)
        elif each.levels:
            yield from ((f".values[{i}]", level) for i, level in enumerate(each.levels))
        elif "low" in each.parameters[0]:
            for end in ("low", "high"):
                yield f".{end}", tuple(parameters[end] for parameters in each.parameters)
        elif self.points:
            drawn = self._drawn(columns)
            yield ".deviation", min(drawn)
            yield ".deviation", max(drawn)

    def _drawn(self, columns: range) -> list[tuple[Any, ...]]:
        return [point[columns.start : columns.stop] for point in self.points]

    def _hint(self, fault: Fault, law: Law) -> str:
        """Which laws have a gain that this law lacks."""
        table, _, word = fault.key.partition(".")
        if table != "controller" or word in law.tables["controller"]:
            return ""
        having = [f'"{other.label}"' for other in self.laws if word in other.tables["controller"]]
        return f"; to vary it for the laws that have it, give laws = [{', '.join(having)}]" if having else ""

    def _runs_as_drawn(self, law: Law, columns: range, values: tuple[Any, ...]) -> bool:
        """Whether the draw with these values, or with the ones nearest to them, can run."""
        drawn = self._drawn(columns)
        if values in drawn:
            nearest = drawn.index(values)
        elif drawn and isinstance(values[0], float):
            nearest = min(range(len(drawn)), key=lambda i: abs(drawn[i][0] - values[0]))
        else:
            return False
        try:
            return not self._faults_of_draw(law, nearest)
        except LookupError:
            return False

    def _faults_of_draw(self, law: Law, draw: int) -> Sequence[Fault]:
        """Errors of a draw that cannot run."""
        keys = [(key, each.covers(law.label)) for each in self.variations for key in each.keys]
        given = {key: x for (key, covered), x in zip(keys, self.points[draw], strict=True) if covered}
        try:
            checked(law.scenario.updated(overrides_at(given, law.tables)))
        except InputError as error:
            return error.faults
        return ()

    def _none_runs(self, law: Law) -> list[Fault]:
        """Errors if none of several draws can run: those of the last one."""
        some = np.unique(np.linspace(0, len(self.points) - 1, MOST_DRAWS).astype(int)) if self.points else ()
        faults: Sequence[Fault] = ()
        for draw in some:
            faults = self._faults_of_draw(law, int(draw))
            if not faults:
                break
        return [Fault("vary", f"no draw can run with {law.label}: {fault}") for fault in faults]
