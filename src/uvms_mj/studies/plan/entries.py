"""The base scenario and the laws of a study file, with absolute paths."""

import dataclasses
import functools
import warnings
from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

from ...errors import Fault, InputError
from ...files import is_file, plain, shortened, tables_of, toml_path
from ...quantities import overrides_of
from ...scenario import STAGES, Scenario
from .study_file import StudyFile, Vary

_OF_STUDY = ("design", "keep", "run")
_NOT_OF_BASE = ("laws", "vary", "design", "keep", "run", "success")
PATHS = ("vehicle.model", "joints.motion_file", *(f"{table}.name" for table in STAGES))
"""The dotted keys whose value may be the path of a file."""
_SUFFIXES = (".py", ".xml", ".toml", ".csv")


@dataclasses.dataclass(frozen=True, eq=False)
class Law:
    """A law of a study. ``source`` is its name or ``path.py:Class``, ``overrides`` are dotted keys of this law alone,
    ``scenario`` is the base scenario with both."""

    label: str
    source: str
    overrides: Mapping[str, Any]
    scenario: Scenario

    @functools.cached_property
    def tables(self) -> dict[str, Any]:
        """The tables of its scenario."""
        return self.scenario.to_dict()


def absolute(value: Any, folder: Path) -> Any:
    """A value with an absolute path in the folder, if it names a file: ``model.xml`` or ``law.py:Class``. Text without
    the ending of such a file is the path of one only if it is there."""
    if not isinstance(value, str) or not value:
        return value
    file = Path(value.split(":")[0])
    return str((folder / value).absolute()) if file.suffix in _SUFFIXES or is_file(folder / file) else value


def with_absolute_values(vary: Vary, folder: Path) -> Vary:
    """An entry of vary whose values are absolute paths, if its key names files."""
    if vary.key not in PATHS or vary.values is None:
        return vary
    return dataclasses.replace(vary, values=[absolute(value, folder) for value in vary.values])


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
    return {key: absolute(value, folder) if key in PATHS else value for key, value in flat.items()}


def _prefixed(fault: Fault, place: str) -> Fault:
    return Fault(f"{place}.{fault.key}" if fault.key else place, fault.message)


def base_of(
    table: Mapping[str, Any],
    folder: Path,
    overrides: Mapping[str, Any],
    faults: list[Fault],
    trusted: Container[str] | None = None,
) -> Scenario | None:
    """The base scenario. Errors are appended to ``faults``. It is then the scenario without the keys that have an
    error, so that the laws and the keys that vary can be checked; None if there is none. ``trusted`` is that of
    :meth:`.Scenario.from_dict`."""
    if any(fault.key.partition(".")[0] == "base" for fault in faults):
        return None
    rest = dict(table)
    for word in [word for word in rest if word in _NOT_OF_BASE]:
        faults.append(Fault(f"base.{word}", "is of the study, not of its base scenario: write it above [base]"))
        del rest[word]
    named = absolute(rest.pop("scenario", None), folder)
    own = {**_flat(rest, folder), **overrides}
    for attempt in range(2):
        try:
            if named is None:
                return Scenario.from_dict({}, own, trusted=trusted)
            path = toml_path(named, "scenario", "scenarios")
            tables, place = tables_of(path, "scenario"), str(named)
            return Scenario.from_dict(tables, own, None, path.parent, place, note=warnings.warn, trusted=trusted)
        except InputError as error:
            wrong = error
        if attempt == 0:
            faults += [fault if fault.key in overrides else _prefixed(fault, "base") for fault in wrong.faults]
            bad = {fault.key.partition("[")[0] for fault in wrong.faults}
            own = {key: value for key, value in own.items() if key not in bad}
    return None


def laws_of(
    given: list[Any] | None,
    base: Scenario,
    folder: Path,
    faults: list[Fault],
    notes: list[str],
    trusted: Container[str] | None = None,
) -> list[Law]:
    """The laws of a study; default: the base scenario's. Errors are appended to ``faults``, and to ``notes`` sentences
    with the settings of the base scenario that a law leaves out. ``trusted`` is that of :meth:`.Scenario.from_dict`."""
    laws: list[Law] = []
    if given == []:
        faults.append(Fault("laws", "is empty; leave it out for the law of the base scenario"))
    for i, entry in enumerate([{}] if given is None else given):
        place = f"laws[{i}]"
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


def _law(
    source: Any,
    label: Any,
    overrides: dict[str, Any],
    base: Scenario,
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
    for stage in (scenario.controller, scenario.actuation):
        if stage.by_caller:
            out = f"{stage.label()} leaves {stage.by_caller} to the caller of a Simulation"
            faults.append(Fault(f"{place}.name", f"{out}; a study needs another {stage.room.noun}"))
    law = scenario.controller
    return Law(label or law.label(), law.source(), plain(overrides), scenario)
