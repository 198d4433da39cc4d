"""The base scenario and the laws of a study, and whether they can run with the keys that vary."""

import dataclasses
import functools
import hashlib
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from ...control import Controller
from ...errors import Fault, InputError, suggestion
from ...files import atomic_write, plain, shortened
from ...quantities import overrides_of
from ...scenario import Scenario
from ...setup.checks import checked
from ...setup.world import VEHICLES, World, checked_world, loaded
from ...stages.written import module_source
from .file import Distribution, Grid, StudyFile, Values, Vary, absolute, anchored
from .places import missing, overlap, overrides_at, sets_in_vain

_OF_STUDY = ("design", "keep", "run")
_NOT_OF_BASE = ("laws", "vary", "design", "keep", "run", "success")
MOST_CHECKED = 50
"""A longer list of numbers is checked at its least and its greatest one."""
MOST_DRAWS = 20
"""A law is given up if none of so many draws can run."""


@dataclass(frozen=True, eq=False)
class Law:
    """A law of a study. ``source`` is its name or ``path.py:Class``, ``overrides`` are dotted keys of this law alone,
    ``scenario`` is the base scenario with both. In a world ``source`` is the law of all vehicles, or empty where each
    keeps its own."""

    label: str
    source: str
    overrides: Mapping[str, Any]
    scenario: Scenario | World

    @functools.cached_property
    def tables(self) -> dict[str, Any]:
        """The tables of its scenario."""
        return self.scenario.to_dict()

    @property
    def written(self) -> dict[str, Any]:
        """Its entry in a study file."""
        named = {"name": self.source} if self.source else {}
        return {**named, "label": self.label, **plain(self.overrides)}

    @property
    def chosen(self) -> dict[str, str]:
        """The override by which it is chosen."""
        return {"controller.name": self.source} if self.source else {}


def split_overrides(
    tables: Mapping[str, Any], overrides: Mapping[str, Any] | None, faults: list[Fault]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The tables of a study file with the overrides of its own keys, and the overrides of the base scenario."""
    changed, of_base = dict(tables), {}
    for key, value in overrides_of(overrides).items():
        table, dot, word = key.partition(".")
        if table in _OF_STUDY and dot:
            inner = changed.get(table, {})
            if isinstance(inner, Mapping):  # otherwise the validator reports it
                changed[table] = {**inner, word: value}
        elif key in ("name", "description"):
            changed[key] = value
        elif key == "simulation.seed":
            faults.append(Fault(key, "the study sets it for each run; set design.seed"))
        elif table in {field.name for field in dataclasses.fields(StudyFile)}:
            faults.append(Fault(key, "can't be set; change it in the study file"))
        else:
            of_base[key] = value
    return changed, of_base


def _flat(tables: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Dotted keys of nested tables, or of dotted keys."""
    flat: dict[str, Any] = {}
    for table, value in tables.items():
        flat |= {f"{table}.{word}": each for word, each in value.items()} if isinstance(value, dict) else {table: value}
    return {key: anchored(key, value, folder) for key, value in flat.items()}


def _prefixed(fault: Fault, place: str) -> Fault:
    return Fault(f"{place}.{fault.key}" if fault.key else place, fault.message)


def base_of(
    table: Mapping[str, Any],
    folder: Path,
    overrides: Mapping[str, Any],
    faults: list[Fault],
    trusted: Container[str] | None = None,
) -> Scenario | World | None:
    """The base scenario, or the world. Errors are appended to ``faults``. It is then without the keys that have an
    error, so that the laws and the keys that vary can be checked; None if there is none. ``trusted`` is as in
    :meth:`.Scenario.from_dict`."""
    if any(fault.key.partition(".")[0] == "base" for fault in faults):
        return None
    rest = dict(table)
    for word in [word for word in rest if word in _NOT_OF_BASE]:
        faults.append(Fault(f"base.{word}", "is of the study, not of its base scenario: write it above [base]"))
        del rest[word]
    named = absolute(rest.pop("scenario", None), folder)
    inline = rest if named is None and VEHICLES in rest else None
    own = {**_flat({} if inline else rest, folder), **overrides}
    for attempt in range(2):
        try:
            if inline:
                return World.from_dict(inline, own, None, folder, trusted=trusted)
            if named is None:
                return Scenario.from_dict({}, own, trusted=trusted)
            return loaded(named, own, trusted=trusted)
        except InputError as error:
            wrong = error
        if attempt == 0:
            faults += [fault if fault.key in overrides else _prefixed(fault, "base") for fault in wrong.faults]
            bad = {fault.key.partition("[")[0] for fault in wrong.faults}
            own = {key: value for key, value in own.items() if key not in bad}
    return None


def laws_of(
    given: list[Any] | None,
    base: Scenario | World,
    folder: Path,
    faults: list[Fault],
    notes: list[str],
    trusted: Container[str] | None = None,
) -> list[Law]:
    """The laws of a study; default: the base scenario's. Errors are appended to ``faults``, and to ``notes`` sentences
    with the settings of the base scenario that a law leaves out. ``trusted`` is as in :meth:`.Scenario.from_dict`."""
    laws: list[Law] = []
    if given == []:
        faults.append(Fault("laws", "is empty; leave it out for the law of the base scenario"))
    for i, entry in enumerate([{}] if given is None else given):
        place = f"laws[{i}]"
        if isinstance(entry, type) and issubclass(entry, Controller):
            entry = entry()
        if isinstance(entry, Controller):
            entry = _table_of_law(entry)
        if not isinstance(entry, str | Mapping):
            faults.append(Fault(place, f'{shortened(entry)} is neither a law, "gsta", nor a table {{name = "gsta"}}'))
            continue
        table = {"name": entry} if isinstance(entry, str) else dict(entry)
        source, label = absolute(table.pop("name", None), folder), table.pop("label", None)
        left_out: list[str] = []
        found = _law(source, label, _flat(table, folder), base, place, faults, left_out, trusted)
        notes += [f"{place}: {said}" for said in left_out]
        if found is not None and any(found.label == law.label for law in laws):
            faults.append(Fault(f"{place}.label", f"{found.label!r} is used twice; give each law a label"))
        elif found is not None:
            laws.append(found)
    return laws


def _table_of_law(law: Controller) -> dict[str, Any]:
    """The table of a law that is given as an object, with the settings that differ from their defaults. The class of a
    notebook's cell is written to a file of its own, in the user's folder of data. Raises InputError if it can't
    be written."""
    source = law.source()
    if source.startswith("<session>"):
        text = module_source(type(law))
        folder = platformdirs.user_data_path("uvms-mj") / "laws" / hashlib.sha256(text.encode()).hexdigest()[:16]
        file = folder / f"{type(law).__name__.lower()}.py"
        if not file.is_file():
            folder.mkdir(parents=True, exist_ok=True)
            with atomic_write(file) as part:
                part.write_text(text, encoding="utf-8")
        source = f"{file}:{type(law).__name__}"
    given = {field.name: getattr(law, field.name) for field in law.setting_fields() if field.repr}
    own = {f.name for f in law.setting_fields() if given[f.name] != f.default}
    return {"name": source, "controller": plain({name: given[name] for name in own})}


def _law(
    source: Any,
    label: Any,
    overrides: dict[str, Any],
    base: Scenario | World,
    place: str,
    faults: list[Fault],
    left_out: list[str],
    trusted: Container[str] | None,
) -> Law | None:
    """One law. Errors are appended to ``faults``; then it is None."""
    wrong = [
        Fault(f"{place}.{name}", f"{shortened(value)} is not a text")
        for name, value in (("name", source), ("label", label))
        if not (value is None or (isinstance(value, str) and value))
    ]
    if "controller.name" in overrides:
        wrong.append(Fault(f"{place}.controller.name", "give the law as name"))
    if "simulation.seed" in overrides:
        wrong.append(Fault(f"{place}.simulation.seed", "the study sets it for each run, from design.seed"))
    if wrong:
        faults += wrong
        return None
    try:
        scenario = base.updated(overrides, source, note=left_out.append, trusted=trusted)
    except InputError as error:
        prefixed = [_prefixed(fault, place) for fault in error.faults]
        faults += [Fault(fault.key.replace(".controller.name", ".name"), fault.message) for fault in prefixed]
        return None
    each = [*scenario.scenarios.values()] if isinstance(scenario, World) else [scenario]
    for stage in (stage for own in each for stage in (own.controller, own.actuation)):
        if stage.by_caller:
            out = f"{stage.label()} gets {stage.by_caller} from outside of the run"
            faults.append(Fault(f"{place}.name", f"{out}; a study needs another {stage.room.noun}"))
    if isinstance(scenario, World):
        overrides = {scenario.named(key): value for key, value in overrides.items()}
        label = label or " and ".join(dict.fromkeys(own.controller.label() for own in each))
        return Law(label, source or "", plain(overrides), scenario)
    law = scenario.controller
    return Law(label or law.label(), law.source(), plain(overrides), scenario)


def combination_faults(
    variations: Mapping[str, Vary], laws: list[Law], overrides: Mapping[str, Any], all_laws: bool
) -> Iterator[Fault]:
    """Errors for keys that are given twice, and, if ``laws`` has all of them, for labels that are not of a law."""
    seen: dict[str, str] = {}
    known = [law.label for law in laws]
    for where, each in variations.items():
        for i, label in enumerate(each.laws or ()):
            if all_laws and label not in known:
                yield Fault(f"{where}.laws[{i}]", f"no law {label!r}; {suggestion(label, known)}")
        for place in each.places:
            twice = next((other for other in seen if overlap(place, other)), None)
            if twice is not None:
                yield Fault(where, f"{place} varies in {seen[twice]} already, as {twice}")
            given = [key for key in overrides if sets_in_vain(key, place)]
            given += [
                f"laws[{i}].{key}"
                for i, law in enumerate(laws)
                for key in law.overrides
                if sets_in_vain(key, place) and each.covers(law.label)
            ]
            yield from (Fault(key, f"{where} varies this key: setting it has no effect") for key in given)
            seen[place] = where


@dataclass(frozen=True, eq=False)
class KeyChecks:
    """Checks of a study's keys: that every law has them, and that their extremes can run.

    An extreme that can't run with the other keys at their base values is tried as it is drawn, with the other keys of
    that draw. A single draw that can't run is no error of the study: its row has the reason.
    """

    variations: Mapping[str, Vary]
    laws: Sequence[Law]
    points: Sequence[tuple[Any, ...]]

    def faults(self) -> list[Fault]:
        """Every error."""
        found: dict[Fault, None] = {}  # in order, and each error once that several laws share
        first = 0
        for where, each in self.variations.items():
            drawn = [point[first : first + len(each.places)] for point in self.points]
            first += len(each.places)
            for law in self.laws:
                if each.covers(law.label):
                    found |= dict.fromkeys(self._of(where, each, law, drawn))
        return list(found) or [fault for law in self.laws for fault in self._none_runs(law)]

    def _of(self, where: str, each: Vary, law: Law, drawn: list[tuple[Any, ...]]) -> Iterator[Fault]:
        absent = [Fault(where, f"{place}: {why}") for place in each.places if (why := missing(place, law.tables))]
        if absent:
            yield from absent
            return
        found: dict[str, list[str]] = {}
        for end, values in _extremes(each, drawn):
            try:
                scenario = law.scenario.updated(overrides_at(dict(zip(each.places, values, strict=True)), law.tables))
            except InputError as error:
                bounded = "; a truncated_normal has a least and a greatest value" if end == ".deviation" else ""
                for fault in error.faults:
                    found.setdefault(f"{fault}{self._hint(fault, law) or bounded}", []).append(end)
                continue
            try:
                _check(scenario)
            except InputError as error:
                if not self._runs_as_drawn(law, drawn, values):
                    for fault in error.faults:
                        found.setdefault(str(fault), []).append(end)
        for message, ends in found.items():  # the same for several values: it is an error of the key
            yield Fault(where + (ends[0] if len(set(ends)) == 1 else ""), message)

    def _hint(self, fault: Fault, law: Law) -> str:
        """Which laws have a gain that this law lacks."""
        table, _, word = fault.key.partition(".")
        if table != "controller" or "controller" not in law.tables or word in law.tables["controller"]:
            return ""
        having = [f'"{other.label}"' for other in self.laws if word in other.tables["controller"]]
        return f"; to vary it for the laws that have it, give laws = [{', '.join(having)}]" if having else ""

    def _runs_as_drawn(self, law: Law, drawn: list[tuple[Any, ...]], values: tuple[Any, ...]) -> bool:
        """Whether the draw with these values, or with the nearest values, can run."""
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
        places = [(place, each.covers(law.label)) for each in self.variations.values() for place in each.places]
        given = {place: x for (place, covered), x in zip(places, self.points[draw], strict=True) if covered}
        try:
            _check(law.scenario.updated(overrides_at(given, law.tables)))
        except InputError as error:
            return error.faults
        return ()

    def _none_runs(self, law: Law) -> list[Fault]:
        """The last draw's errors, if none of several draws can run."""
        some = np.unique(np.linspace(0, len(self.points) - 1, MOST_DRAWS).astype(int)) if self.points else ()
        faults: Sequence[Fault] = ()
        for draw in some:
            faults = self._faults_of_draw(law, int(draw))
            if not faults:
                break
        return [Fault("vary", f"no draw can run with {law.label}: {fault}") for fault in faults]


def _check(scenario: Scenario | World) -> None:
    """Raise InputError if a scenario or a world can't run."""
    if isinstance(scenario, World):
        checked_world(scenario)
    else:
        checked(scenario)


def _extremes(each: Vary, drawn: list[tuple[Any, ...]]) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """Where the extreme values of an entry are in it, and the values of its places."""
    if isinstance(each, Values):
        numbers = all(isinstance(value, float) for level in each.levels for value in level)
        if numbers and len(each.levels) > MOST_CHECKED:
            yield from ((".values", end(each.levels)) for end in (min, max))
        else:
            yield from ((f".values[{i}]", level) for i, level in enumerate(each.levels))
    elif isinstance(each, Grid) or (isinstance(each, Distribution) and each.low is not None):
        yield from ((".low", each.low), (".high", each.high))
    elif drawn:
        yield from ((".deviation", end(drawn)) for end in (min, max))
