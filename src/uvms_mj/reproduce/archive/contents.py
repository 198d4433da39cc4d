"""The contents of an archive of a run, a study, a result of the benchmark or the paper's runs.

It is taken from the records: the log, or version.json, has the digest of each file that the user's stages had. A file
that is another one now is refused, unless the record has its contents. No file of the user's is imported.
"""

import hashlib
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

import pyarrow.parquet as pq
import tomli_w
from pyarrow import ArrowException
from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from ...control import BUILT_IN
from ...errors import InputError, faults_of, shortened
from ...files import is_file, is_folder, parsed_toml, tables_of
from ...quantities import STRICT, leaves
from ...records.header import Header, StageSource, Status
from ...records.mcap import read, read_files
from ...scenario import CHOICES, table_at
from ...setup.world import vehicles_of
from ...stages.foreign import parted
from ...studies.bundle import HERE, files_of, with_texts
from ...studies.plan.file import PATHS
from ...studies.report.tables import without_folders
from ...studies.results import STUDY, TUNING, frame, version_of
from ...studies.study import Study
from ..bench import results
from ..bench.task import LATEX, RESULT
from .container import MANIFEST, Manifest, contents

LOG, SCENARIO = "run.mcap", "scenario.toml"
FILES, RESULTS = "files", "results"
"""Folders of an archive: what the runs read, and what came out."""
LAWS = "laws.toml"
ROWS = f"{RESULTS}/rows.parquet"
SECRET = f"{FILES}/secret"
_REPEATABLE = (Status.completed, Status.unstable)


@dataclass(frozen=True)
class Contents:
    """The members of an archive by name, its kind and name, what its kind needs, the versions that made it, and notes
    for the user."""

    kind: str
    name: str
    members: Mapping[str, bytes | Path]
    about: Mapping[str, Any]
    versions: Mapping[str, str]
    notes: tuple[str, ...] = ()


def contents_of(source: Path, secret: Path | None = None) -> Contents:
    """Contents of an archive of a log or a folder. ``secret`` is the file of a result's blind draws. Raises InputError
    if it is none that can be repeated, or a file that it needs has gone or changed."""
    if not is_folder(source):
        if not is_file(source):
            raise InputError(f"{source}: no such file or folder")
        return _of_run(source)
    kinds: dict[str, Callable[[], Contents]] = {
        RESULT: lambda: _of_bench(source, secret),
        STUDY: lambda: _of_study(source),
        "claims.json": lambda: _of_paper(source),
        LOG: lambda: _of_run(source / LOG),
    }
    found = [name for name in (*kinds, TUNING) if is_file(source / name)]
    if found == [TUNING]:
        raise InputError(f"{source}: is a tuning; archive a run, a study or a result of the benchmark with its gains")
    if not found and is_file(source / SCENARIO) and vehicles_of(source / SCENARIO):
        whole = f"`uvms-mj run {source / SCENARIO}` repeats it; a log of a vehicle without couplings can be archived"
        raise InputError(f"{source}: is the folder of a world of several vehicles, and an archive is of one; {whole}")
    if len(found) != 1:
        has = f"has {' and '.join(found)}" if found else f"has none of {', '.join(kinds)}"
        raise InputError(f"{source}: {has}; name a log, or the folder of a run, a study, a bench or the paper's runs")
    return kinds[found[0]]()


# what an archive needs to be repeated


@checked(frozen=True, config=STRICT)
class _Named:
    """The keys of a run's scenario that name files, with their paths in the archive."""

    names: dict[str, str]


@checked(frozen=True, config=STRICT)
class _Asked:
    """The options of a result of the benchmark besides its laws."""

    tasks: list[str]
    draws: str
    at_most: int


@checked(frozen=True, config=STRICT)
class _Nothing:
    pass


_NEEDED: Mapping[str, tuple[TypeAdapter, tuple[str, ...]]] = {
    "run": (TypeAdapter(_Named), (f"{RESULTS}/{LOG}",)),
    "study": (TypeAdapter(_Nothing), (STUDY, ROWS)),
    "bench": (TypeAdapter(_Asked), (LAWS, f"{RESULTS}/{RESULT}")),
    "paper": (TypeAdapter(_Named), ()),
}
"""Of each kind what archive.json says about it, and the members that it needs."""


def refuse_unfit(path: Path, manifest: Manifest) -> None:
    """Raise InputError if an archive lacks what its kind needs, or names a file outside of itself."""
    adapter, needed = _NEEDED[manifest.kind]
    try:
        about = adapter.validate_python(manifest.about)
    except ValidationError as error:
        raise InputError(f"{path}: is refused: {MANIFEST}: about: {InputError(faults_of(error))}") from None
    if missing := [name for name in needed if name not in manifest.members]:
        raise InputError(f"{path}: is refused: an archive of a {manifest.kind} has {', '.join(missing)}")
    for key, name in about.names.items() if isinstance(about, _Named) else ():
        known = key in PATHS or key.endswith("].name")
        if not known or (parted(name)[0] or name) not in manifest.members:
            raise InputError(f"{path}: is refused: {MANIFEST}: about: {key} = {shortened(name)} is no file in it")
    named = dict.fromkeys((*needed, SCENARIO))  # a run is repeated by its log, and unpacked by its scenario
    for table in (name for name in named if name.endswith(".toml") and name in manifest.members):
        try:
            tables = parsed_toml(contents(path, manifest, table).decode())
        except ValueError as error:
            raise InputError(f"{path}: is refused: {table}: {error}") from None
        for key, text in leaves(tables):
            file = PurePath(parted(text)[0] or text) if isinstance(text, str) else PurePath()
            if file.is_absolute() or ".." in file.parts:
                raise InputError(f"{path}: is refused: {table}: {key} = {shortened(text)} is no file in it")
    if manifest.kind == "study":
        try:
            pq.read_table(io.BytesIO(contents(path, manifest, ROWS)))
        except (ArrowException, OSError) as error:
            raise InputError(f"{path}: is refused: {ROWS} can't be read: {error}") from None
    if manifest.kind == "bench":
        results.parsed(contents(path, manifest, f"{RESULTS}/{RESULT}"), f"{path}: is refused: {RESULTS}/{RESULT}")


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


# a run


def _of_run(log: Path) -> Contents:
    header, _, outcome, _ = read(log)
    if header.measured:
        raise InputError(f"{log}: is the log of a real vehicle, which can't be repeated")
    if outcome.status not in _REPEATABLE:
        raise InputError(f"{log}: the run did not end: {outcome.status.value}; a repetition could not be compared")
    if any(header.scenario.vehicle.name in each.vehicles for each in header.scenario.couplings):
        raise InputError(f"{log}: is coupled to other vehicles of its world, which one log does not have")
    for name, stage in header.scenario.named_stages.items():
        if stage.by_caller or stage.name == "udp":
            raise InputError(f"{log}: {name} {stage.label()} got its numbers from another program, which is no file")
    notes: list[str] = []
    members, names = _files_of_run(log, header, notes)
    members[f"{RESULTS}/{LOG}"] = log
    members[SCENARIO] = _portable(header, names)
    return Contents("run", header.scenario.name, members, {"names": names}, header.versions, tuple(notes))


def _portable(header: Header, names: Mapping[str, str]) -> bytes:
    """scenario.toml with paths in the archive."""
    tables = header.portable_scenario()
    for key, value in names.items():
        table, _, word = key.rpartition(".")
        table_at(tables, table)[word] = value
    return tomli_w.dumps(tables).encode()


def _files_of_run(log: Path, header: Header, notes: list[str]) -> tuple[dict[str, bytes | Path], dict[str, str]]:
    """The files of a run's own vehicle and stages, and the keys that name them, with their paths in the archive."""
    members, names = dict[str, bytes | Path](), dict[str, str]()
    there = _named_beside(log)
    model = header.portable_scenario()["vehicle"]["model"]
    if PurePath(model).suffix:
        members |= {f"{FILES}/vehicle/{name}": data for name, data in header.mjcf.files.items()}
        names["vehicle.model"] = f"{FILES}/vehicle/{header.mjcf.name}"
    if (motion := getattr(header.scenario.joints, "motion_file", None)) is not None:
        wrong = "an older version wrote the log, without the numbers of joints.motion_file"
        raise InputError(f"{log}: {wrong}, {Path(motion).name}: make the run again")
    folders: dict[Any, str] = {}
    for name, stage in header.sources.items():
        if stage.source in CHOICES[name.partition("[")[0]].shipped:
            continue
        path = there.get(name)
        own = path is not None and path.name == parted(stage.source)[0]
        key = path.parent if own and path is not None else name  # stages of one folder stay together
        folder = folders.setdefault(key, f"{FILES}/stages-{len(folders)}")
        for each, data in _files_of_stage(log, stage, path if own else None, notes).items():
            if members.setdefault(f"{folder}/{each}", data) != data:
                raise InputError(f"{log}: two stages of one folder have another {each} each")
        names[f"{name}.name"] = f"{folder}/{stage.source}"
    return members, names


def _named_beside(log: Path) -> dict[str, Path]:
    """The files of the stages in the scenario beside a log; empty without one. Nothing is imported."""
    beside = log.with_name(SCENARIO)
    if not is_file(beside):
        return {}
    found = {}
    tables = tables_of(beside, "scenario")
    for name in CHOICES:
        given = tables.get(name)
        each = {f"{name}[{i}]": table for i, table in enumerate(given)} if isinstance(given, list) else {name: given}
        for place, table in each.items():
            file, _ = parted(table.get("name") if isinstance(table, dict) else None)
            if file:
                found[place] = Path(log.parent, file)
    return found


def _files_of_stage(log: Path, stage: StageSource, path: Path | None, notes: list[str]) -> dict[str, bytes]:
    """The file of a stage and the files that it imports or lists, as they were in the run; ``path`` is where it was."""
    file = parted(stage.source)[0]
    if not file or stage.sha256 is None:
        raise InputError(f"{log}: {stage.source} was defined in a session and is in no file; write it to one")
    now = path.read_bytes() if path is not None and is_file(path) else None
    data = stage.code.encode()
    if _sha256(data) != stage.sha256:  # machine code, or a text that is not UTF-8
        if now is None:
            place = path or f"a {SCENARIO} beside the log that names it"
            raise InputError(f"{log}: the log has the digest of {file} alone, and there is no {place}")
        if _sha256(now) != stage.sha256:
            digests = f"sha256 {stage.sha256[:12]}... then, {_sha256(now)[:12]}... now"
            raise InputError(f"{path}: changed since the run ({digests}), and the log has its digest alone")
        data = now
    changed = [file] if now is not None and now != data else []
    for name, then in stage.files.items():
        if path is not None and is_file(path.parent / name) and (path.parent / name).read_bytes() != then:
            changed.append(name)
    notes += [f"{name} changed since the run: the archive has it as it was in the run" for name in changed]
    return {file: data, **stage.files}


# a study


def _of_study(folder: Path) -> Contents:
    study = Study.load(folder)
    plan, rows = study.plan_of_results, frame(folder)
    if len(rows) != plan.runs:
        raise InputError(f"{folder}: has {len(rows)} of {plan.runs} runs; the same command goes on with the study")
    about = version_of(folder)
    members = dict[str, bytes | Path]()
    tables = _packed(tables_of(folder / STUDY, "study"), about["files"], folder, members)
    members[STUDY] = tomli_w.dumps(tables).encode()
    members[ROWS] = _rows_file(rows)
    for log in sorted((folder / "logs").glob("*.mcap")):
        members[f"{RESULTS}/logs/{log.name}"] = log
    return Contents("study", plan.name, members, {}, about["code"])


def _rows_file(rows: Any) -> bytes:
    """Rows as Parquet, with the names of files in place of their paths."""
    file = io.BytesIO()
    bare_rows(rows).to_parquet(file, index=False)
    return file.getvalue()


def bare_rows(rows: Any) -> Any:
    """Rows with the names of files in place of their paths."""
    texts = [name for name in rows if rows[name].dtype == object or str(rows[name].dtype).startswith("str")]
    bare = {name: rows[name].map(lambda value, told=name == "message": _bare(value, told)) for name in texts}
    return rows.assign(**bare)


def _bare(value: Any, told: bool) -> Any:
    """A value without folders; a text that is ``told`` may begin with a path, any other that does is one."""
    if not isinstance(value, str):
        return value
    return PurePath(value).name if not told and PurePath(value).is_absolute() else without_folders(value)


def _packed(value: Any, then: Mapping[str, str], folder: Path, members: dict[str, bytes | Path]) -> Any:
    """A value of a study's table with paths in the archive; the files, which must be as they were, become members."""

    def pack(text: str) -> str:
        named = parted(text)[0] or text
        if not PurePath(named).is_absolute():
            return text
        if (parted(text)[0] or PurePath(text).suffix in (".xml", ".csv")) and not is_file(named):
            raise InputError(f"{folder}: {named}: no such file")
        changed, files = files_of(text, then)
        wrong = [Path(name).name for name, data in files.items() if _sha256(data) != then.get(name)]
        if wrong:
            what = f"since the study began, {', '.join(wrong)} changed or went"
            raise InputError(f"{folder}: {what}; restore what it was: {named}")
        members.update({f"{FILES}/{name}": data for name, data in files.items()})
        return changed.replace(HERE, f"{FILES}/", 1)

    return with_texts(value, pack)


# a result of the benchmark


def _of_bench(folder: Path, secret: Path | None) -> Contents:
    data = (folder / RESULT).read_bytes()
    found = results.parsed(data, str(folder / RESULT))
    if "levels" not in next(iter(found["tasks"].values())):
        raise InputError(f"{folder}: is of the first version of the benchmark, whose tasks this version has not")
    members: dict[str, bytes | Path] = {f"{RESULTS}/{RESULT}": data}
    if is_file(folder / LATEX):
        members[f"{RESULTS}/{LATEX}"] = folder / LATEX
    laws = [_law(folder, law, members) for law in found["laws"]]
    members[LAWS] = tomli_w.dumps({"laws": laws}).encode()
    drawn, draws = found["draws"], found["draws"]["kind"]
    if drawn["kind"] == "seed":
        draws = f"seed:{drawn['seed']}"
    if drawn["kind"] == "secret":
        if secret is None:
            raise InputError(f"{folder}: its draws are of a secret file; name it with --secret FILE")
        if not is_file(secret) or _sha256(secret.read_bytes()) != drawn["digest"]:
            raise InputError(f"--secret {secret}: is not the file of these draws, sha256 {drawn['digest'][:12]}...")
        draws, members[SECRET] = f"secret:{SECRET}", secret
    about = {"tasks": list(found["tasks"]), "draws": draws, "at_most": drawn["most"]}
    return Contents("bench", f"{found['benchmark']} {found['digest']}", members, about, found["code"])


def _law(folder: Path, law: Mapping[str, Any], members: dict[str, bytes | Path]) -> dict[str, Any]:
    """The table of a law, from a study of its first level, with paths in the archive."""
    label = law["label"]
    if law["knows_the_truth"]:
        return {"name": next(name for name, each in BUILT_IN.items() if each.uses_truth), "label": label}
    studies = [folder / label / task / "level-1" for task, each in law["tasks"].items() if each["runs"]]
    study = next((each for each in studies if is_file(each / STUDY)), None)
    if study is None:
        raise InputError(f"{folder}: {label}: no study of its first level, which has its settings")
    then = version_of(study)["files"]
    packed = dict[str, bytes | Path]()
    table = _packed(tables_of(study / STUDY, "study")["laws"][0], then, study, packed)
    digests = {each for name, each in then.items() if name.startswith("code-")}
    if digests != {each for text in law["files"].values() for each in text.split()}:
        raise InputError(f"{study}: has other files of {label} than {folder / RESULT}")
    members |= packed
    return table | {key: law[key] for key in ("trials",) if key in law}


# the paper's runs


def _of_paper(folder: Path) -> Contents:
    logs = sorted((folder / "logs").glob("*.mcap"))
    if not logs:
        raise InputError(f"{folder}: has no logs")
    header, members = read_files(logs[0])[0], dict[str, bytes | Path]()
    names = dict[str, str]()
    if PurePath(header.portable_scenario()["vehicle"]["model"]).suffix:
        members |= {f"{FILES}/vehicle/{name}": data for name, data in header.mjcf.files.items()}
        names["vehicle.model"] = f"{FILES}/vehicle/{header.mjcf.name}"
    members |= {f"{RESULTS}/logs/{log.name}": log for log in logs}
    members |= {f"{RESULTS}/{name}": folder / name for name in ("claims.json", "claims.csv") if is_file(folder / name)}
    return Contents("paper", "the paper's section 5", members, {"names": names}, header.versions)
