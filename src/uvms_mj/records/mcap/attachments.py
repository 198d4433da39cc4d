"""A run's header and outcome as attachments, which make a log self-contained, and their reconstruction from them.

The contents of the attachments are never executed and never written to disk.
"""

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import PurePath
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from ...control.base import NoClosedForm, SteadyState
from ...errors import InputError, faults_of
from ...files import parsed_toml
from ...plant.geometry import Geometry
from ...plant.mjcf import Mjcf
from ...quantities import STRICT, NonNegative, Real
from ...scenario import STAGE_LISTS, STAGES, Scenario
from ...stages.loader import Choice, placeholder_stage
from ...stages.signals import BAND, IN_TASK_FRAME, OF_JOINTS, PUSH, RECORDED, Signal
from ..header import Header, Outcome, StageSource, code_file

MOST_BYTES = 256_000_000
"""Largest total size of a log's attached files [bytes]."""
_MOST_VALUES = 200_000
"""Largest number of values (numbers, texts, lists) in one JSON file. Reading takes some 100 bytes of memory for each. A
mesh is one text."""
FORMAT = 1
"""Version of the log format, for a change of run.json or of the topic of a signal. A new signal is not a change."""
_NEEDED = frozenset(
    (
        *("t", "p_WB", "quat_WB", "nu", "p_d", "p_d_dot", "eta_e", "nu_e", "tau", "f_contact_W"),
        *("tau_variation", "tau_step_max", "tau_max", "effort", "saturation_time", "force_peak", "impulse"),
        *("wall_work", "touches", "first_contact", "final_impulse", "final_low", "final_high"),
    )
)
"""Signals that every log has. Metrics and views work without the others."""


@checked(frozen=True, config=STRICT | ConfigDict(extra="ignore"))
class _Version:
    """The part of run.json that every format has."""

    format: int
    versions: dict[str, str]


@checked(frozen=True, config=STRICT)
class _SignalEntry:
    name: str
    shape: tuple[Annotated[int, Field(ge=1, le=100_000)], ...]
    unit: str
    frame: str
    meaning: str


@checked(frozen=True, config=STRICT)
class _Rest:
    force: NonNegative
    position: Annotated[tuple[Real, ...], Field(min_length=3, max_length=3)] | None
    quat: Annotated[tuple[Real, ...], Field(min_length=4, max_length=4)] | None
    s: Annotated[tuple[Real, ...], Field(min_length=6, max_length=6)] | None
    tau: Annotated[tuple[Real, ...], Field(min_length=6, max_length=6)] | None


@checked(frozen=True, config=STRICT)
class _StageEntry:
    source: str
    sha256: str | None
    states: dict[str, Annotated[int, Field(ge=1, le=100_000)]]


@checked(frozen=True, config=STRICT)
class _Run:
    format: int
    vehicle: str
    engine: str
    row_steps: Annotated[int, Field(ge=1)]
    signals: tuple[_SignalEntry, ...]
    stages: dict[str, _StageEntry]
    analytic: _Rest | None
    no_analytic_because: str
    notes: tuple[str, ...]
    versions: dict[str, str]


_VERSION, _RUN, _END = TypeAdapter(_Version), TypeAdapter(_Run), TypeAdapter(Outcome)
"""Validators of run.json, of any format and of this one, and of outcome.json."""


def header_files(header: Header) -> dict[str, bytes]:
    """The files of a header, by name: run.json, scenario.toml, geometry.json, model/..., law/..."""
    rest = header.analytic
    run = _Run(
        format=FORMAT,
        vehicle=header.mjcf.name,
        engine=header.engine,
        row_steps=header.row_steps,
        signals=tuple(_SignalEntry(s.name, s.shape, s.unit, s.frame, s.meaning) for s in header.signals),
        stages={name: _StageEntry(s.source, s.sha256, dict(s.states)) for name, s in header.sources.items()},
        analytic=None
        if isinstance(rest, NoClosedForm)
        else _Rest(rest.force, *(each if each is None else tuple(each.tolist()) for each in _arrays(rest))),
        no_analytic_because=rest.reason if isinstance(rest, NoClosedForm) else "",
        notes=tuple(without_paths(note) for note in header.notes),
        versions=dict(header.versions),
    )
    files = {
        "run.json": _RUN.dump_json(run, indent=1),
        "scenario.toml": tomli_w.dumps(header.portable_scenario()).encode(),
        "geometry.json": header.geometry.to_json(),
    }
    files |= {f"model/{name}": data for name, data in header.mjcf.files.items()}
    for table, s in header.sources.items():
        code = code_file(table, s.source)
        files |= {f"{PurePath(code).parent}/{name}": data for name, data in s.files.items()}
        files |= {code: s.code.encode()} if s.code else {}
    refuse_large(files)
    return files


def refuse_large(files: Mapping[str, bytes]) -> None:
    """Check that files are not so large that reading them would take too much time or memory.

    Raises:
        InputError: a file, or all files together, are too large; names the file, or the largest of them.
    """
    total = sum(map(len, files.values()))
    if total > MOST_BYTES:
        largest = max(files, key=lambda name: len(files[name]))
        raise InputError(
            f"its files have {total / 1e6:.4g} MB, the largest is {largest}; at most {MOST_BYTES / 1e6:g} MB is allowed"
        )
    for name, data in files.items():
        if name.endswith(".json") and sum(map(data.count, (b",", b"[", b"{"))) > _MOST_VALUES:
            raise InputError(f"{name}: has more than {_MOST_VALUES} values")


def header_of(files: Mapping[str, bytes]) -> Header:
    """The header from the files of :func:`header_files`. Raises InputError if a file is missing or invalid."""
    missing = [name for name in ("run.json", "scenario.toml", "geometry.json") if name not in files]
    if missing:
        raise InputError(f"{', '.join(missing)} is missing")
    run = _run_of(files["run.json"])
    try:
        tables = parsed_toml(files["scenario.toml"].decode())
    except ValueError as error:
        raise InputError(f"scenario.toml: {error}") from None
    listed = {name: tables.get(name, []) for name in STAGE_LISTS}
    its_tables: dict[str, tuple[Choice, Any]] = {name: (choice, tables.get(name)) for name, choice in STAGES.items()}
    for name, each in listed.items():
        if not isinstance(each, list):
            raise InputError(f"scenario.toml: {name} is not a list")
        its_tables |= {f"{name}[{i}]": (STAGE_LISTS[name], table) for i, table in enumerate(each)}
    if set(run.stages) != set(its_tables):
        raise InputError(f"run.json: stages must have the entries {', '.join(its_tables)}")
    sources, known = {}, {}
    for name, (choice, table) in its_tables.items():
        entry, noun = run.stages.get(name), choice.base.room.noun
        if entry is None or not isinstance(table, dict) or table.get("name") != entry.source:
            raise InputError(f"scenario.toml and run.json name different {noun}s")
        code = files.get(code_file(name, entry.source), b"").decode(errors="replace")
        sources[name] = StageSource(entry.source, entry.sha256, code, entry.states)
        if entry.source not in choice.shipped:
            sources[name] = replace(sources[name], files=_listed(files, code_file(name, entry.source)))
            known[name] = placeholder_stage(choice.base, entry.source, table, entry.states, name)
    scenario = Scenario.from_dict(tables, place="scenario.toml", known=known)
    if scenario.vehicle.model != PurePath(scenario.vehicle.model).name:
        raise InputError(f"scenario.toml: vehicle.model {scenario.vehicle.model!r} is not in the log")
    signals = tuple(Signal(s.name, s.shape, s.unit, s.frame, s.meaning) for s in run.signals)
    stages = scenario.named_stages
    differ = any(not _same_states(stages[name].states, source.states) for name, source in sources.items())
    states = {
        scenario.recorded_name(table, name): size
        for table, source in sources.items()
        for name, size in source.states.items()
    }
    if differ or not _are_sound(signals, states):
        version = run.versions.get("uvms-mj", "of another version")
        raise InputError(f"run.json: its signals differ from this version's; the log was written by uvms-mj {version}")
    geometry = Geometry.from_json(files["geometry.json"])
    wrong = [s.name for s in signals if geometry.links and s.name in OF_JOINTS and s.shape != (len(geometry.links),)]
    if wrong:
        raise InputError(f"run.json: {', '.join(wrong)} must have {len(geometry.links)} numbers, one a joint")
    models = {name.removeprefix("model/"): data for name, data in files.items() if name.startswith("model/")}
    for name in models:
        if not name.strip(".") or not name.isprintable() or "/" in name or "\\" in name:
            raise InputError(f"model/{name}: is not a file name without folders")
    if run.vehicle not in models:
        raise InputError(f"model/{run.vehicle} is missing")
    rest = run.analytic
    return Header(
        scenario=scenario,
        signals=signals,
        row_steps=run.row_steps,
        rest=NoClosedForm(run.no_analytic_because)
        if rest is None
        else SteadyState(rest.force, *(each if each is None else np.array(each) for each in _arrays(rest))),
        notes=run.notes,
        mjcf=Mjcf(run.vehicle, models),
        geometry=geometry,
        sources=sources,
        versions=run.versions,
        engine=run.engine,
    )


def _listed(files: Mapping[str, bytes], code: str) -> dict[str, bytes]:
    """The files of a log that a stage listed, by name; ``code`` is the name of its own."""
    folder = f"{PurePath(code).parent}/"
    return {name.removeprefix(folder): data for name, data in files.items() if name.startswith(folder) and name != code}


def _arrays(rest: SteadyState | _Rest) -> tuple[Any, ...]:
    return rest.position, rest.quat, rest.s, rest.tau


def _run_of(data: bytes) -> _Run:
    """The contents of run.json. Raises InputError if they are invalid, or of another format."""
    try:
        version = _VERSION.validate_json(data)
        if version.format != FORMAT:
            writer = f"uvms-mj {version.versions.get('uvms-mj', 'of another version')}"
            later = " or later" if version.format > FORMAT else ""
            raise InputError(
                f"has log format {version.format}, which {writer}{later} reads; this version reads format {FORMAT}"
            )
        return _RUN.validate_json(data)
    except ValidationError as error:
        raise InputError(faults_of(error), "run.json") from None


def _same_states(declared: Mapping[str, Any], recorded: Mapping[str, int]) -> bool:
    """Whether recorded sizes of states are a class's, of which one may be the number of thrusters or joints."""
    sizes = {name: recorded.get(name) if isinstance(size, str) else size for name, size in declared.items()}
    return sizes == dict(recorded)


def _are_sound(signals: tuple[Signal, ...], states: Mapping[str, int]) -> bool:
    """Whether signals begin with t, are all there that a log needs, and stand in this version's table."""
    found = {s.name: (s.shape, s.unit, s.frame) for s in signals}
    table = {s.name: (s.shape, s.unit, s.frame) for s in RECORDED}
    banded = {PUSH.name: (PUSH.shape, PUSH.unit, PUSH.frame)} | found

    def agrees(name: str, facts: tuple[tuple[int, ...], str, str]) -> bool:
        shape, unit, frame = facts
        frame = "B" if "p_WT" in found and frame == "T" and name in IN_TASK_FRAME else frame
        return (shape, unit, frame) == table.get(name, (shape, unit, frame))

    return (
        len(found) == len(signals) > 0
        and signals[0].name == "t"
        and found.keys() >= {*_NEEDED, *states}
        and all(name.isidentifier() and agrees(name, facts) for name, facts in found.items())
        and all(found[name][0] == (size,) for name, size in states.items())
        and len(found.get("u", ((1,),))[0]) == 1  # a load has no thrusts
        and all(
            found.get(low) == found.get(high) in (None, banded[name])
            for name, (low, high) in BAND.items()
            if name in banded
        )
    )


def outcome_file(outcome: Outcome) -> bytes:
    return _END.dump_json(dataclasses.replace(outcome, message=without_paths(outcome.message)))


def outcome_of(data: bytes) -> Outcome:
    """The outcome from the contents of outcome.json; raises InputError if they are invalid."""
    try:
        return _END.validate_json(data)
    except ValidationError as error:
        raise InputError(faults_of(error), "outcome.json") from None


_QUOTED = re.compile(r"""(['"])(?:file://)?(?:[A-Za-z]:[/\\]|[/\\]|~)[^'"\n]*[/\\]([^'"/\\\n]*\1)""")
_BARE = re.compile(r"(?<![\w.:/])(?:file://)?(?:[A-Za-z]:)?~?[/\\](?:[^\s'\"/\\:]+[/\\])+")


def without_paths(text: str) -> str:
    """Remove the folders from file paths in a text. A path in quotes may contain spaces; any other ends at a space."""
    return _BARE.sub("", _QUOTED.sub(r"\1\2", text))
