"""The choice of a command's runs by its arguments: the scenario of a file, a log, an archive or a row of a study."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from .archive import unpacked
from .common import printable, warn, warn_of_versions
from .options import asked_for

if TYPE_CHECKING:
    from ..engine.vehicle_run import Changes
    from ..plant.mjcf import Mjcf
    from ..records.header import Header
    from ..scenario import Scenario
    from ..setup.world import World


class Chosen(NamedTuple):
    """A scenario or a world with what else its run takes: the vehicle's model if it is a log's, and else None, the log
    rate, None for the default, and the engine."""

    scenario: "Scenario | World"
    mjcf: "Mjcf | None"
    log_rate: str | None
    engine: str


def chosen(
    arguments: tuple[str, ...],
    settings: tuple[str, ...],
    controller: str | None,
    log: str | None,
    log_rate: str | None = None,
    row: int | None = None,
    as_deployed: bool = False,
    names: Mapping[str, str] = MappingProxyType({}),
) -> Chosen:
    """The choice by the arguments of a command. ``names`` are the files of an archive by the keys that name them.
    Raises InputError if the input is invalid."""
    from ..errors import InputError
    from ..setup.world import loaded

    name, overrides = asked_for(arguments, settings)
    if as_deployed:
        from ..setup.deployment import as_deployed as deployed

        overrides = deployed(overrides)
    if row is not None and log is None:
        raise InputError(f"--row {row}: name the folder of its study with --from DIR")
    if name is not None and name.endswith(".mcap"):
        raise InputError(f"{name}: is a log, not a scenario; --from {name} uses the scenario and the vehicle of a log")
    if log is None:
        return Chosen(loaded(name or "push_wall", overrides, controller), None, log_rate, "mujoco")
    if name is not None:
        raise InputError(f"one scenario at a time, please: {name}, {log}")
    if row is not None:
        scenario, engine = row_of(log, row, overrides, controller)
        return Chosen(scenario, None, log_rate, engine)
    if Path(log, "study.toml").is_file():
        raise InputError(f"--from {log}: is the folder of a study; name one of its runs with --row N")
    if controller is not None:
        names = {key: value for key, value in names.items() if key != "controller.name"}
    return _from_log(log, {**names, **overrides}, controller, log_rate)


def one_vehicle(*asked: Any, **more: Any) -> "tuple[Scenario, Mjcf | None]":
    """Scenario and vehicle that the arguments of :func:`chosen` choose. Raises InputError for a world, too."""
    from ..errors import InputError
    from ..setup.world import World

    found = chosen(*asked, **more)
    if isinstance(found.scenario, World):
        several = "is a world of several vehicles, which World.load and uvms-mj run take; here is one vehicle needed"
        raise InputError(f"{found.scenario.name}: {several}")
    return found.scenario, found.mjcf


def of_archive(out: str | None, asked: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """The output folder and the arguments of a run that repeats an archive, which is unpacked there."""
    from ..errors import InputError
    from ..reproduce.archive.contents import LOG as MEMBER
    from ..reproduce.archive.contents import RESULTS

    if asked["row"] is not None:
        raise InputError("--row is a run of a study's folder: unpack the archive of the study with uvms-mj study")
    folder, place, manifest = unpacked(asked["log"], "run", out)
    names = {key: str((place / name).absolute()) for key, name in manifest.about["names"].items()}
    names.pop("vehicle.model", None)  # the log has it
    return str(folder), {**asked, "log": str(place / RESULTS / MEMBER), "names": names}


def _from_log(log: str, overrides: dict[str, Any], controller: str | None, log_rate: str | None) -> Chosen:
    """The scenario and the vehicle of a log. Warns if a repetition may differ from the original."""
    from ..control.base import Udp
    from ..errors import InputError
    from ..records.header import code_file
    from ..records.mcap import read_files

    header, _ = read_files(log)
    for name, then in header.sources.items():
        if not (recorded := header.scenario.named_stages[name]).of_log:
            continue
        if overrides.get(f"{name}.name", controller if name == "controller" else None) is None:
            noun, code = recorded.room.noun, code_file(name, then.source)
            option = "--controller " if name == "controller" else f"--set {name}.name="
            folder = code.rpartition("/")[0]
            beside = "".join(
                f", `--show {folder}/{name}` the file {name} that it reads beside it" for name in then.files
            )
            raise InputError(
                f"{log} was made by the {noun} {then.source}. Code from a log is never executed: name the {noun}'s "
                f"file with {option}path/to/{then.source} (`uvms-mj info {log} --show {code}` prints the recorded "
                f"code{beside})"
            )
    if isinstance(header.scenario.controller, Udp) and controller is None:
        overrides = {"controller.host": Udp.host} | overrides  # a log sends nothing to another machine
    scenario = header.scenario.updated(overrides, controller, place=log, note=warn)
    _warn_of_changes(header, scenario)
    if log_rate is None and "simulation.timestep" not in overrides:
        log_rate = repr(1.0 / (header.row_steps * scenario.simulation.timestep))
    return Chosen(scenario, None if "vehicle.model" in overrides else header.mjcf, log_rate, header.engine)


def changes_of(log: str) -> "Changes":
    """The changes that were made in the run of a log. Raises InputError if the log was cut off, and lacks them."""
    from ..errors import InputError
    from ..records.header import LIVE_NOTE, Status
    from ..records.mcap import read, read_files

    if LIVE_NOTE not in read_files(log)[0].notes:
        return ()
    outcome = read(log)[2]
    if outcome.status is Status.truncated:
        cut = "the log was cut off, and it lacks the numbers that were changed while its run went on"
        raise InputError(f"--from {log}: {cut}; its run can't be repeated")
    for step, values in outcome.changes:
        said = ", ".join(f"{key} = {value}" for key, value in values.items())
        click.echo(printable(f"again after step {step}: {said}"), err=True)
    return outcome.changes


def _warn_of_changes(header: "Header", scenario: "Scenario") -> None:
    """Warn of code of stages and of versions that differ from a log's."""
    from ..records.header import StageSource, versions

    for name, then in header.sources.items():
        if name not in scenario.named_stages:
            continue
        now = StageSource.of(scenario.named_stages[name])
        if then.sha256 and now.sha256 and now.sha256 != then.sha256:
            digests = f"sha256 {then.sha256[:12]}... then, {now.sha256[:12]}... now"
            warn(f"{now.source} differs from the recorded code: {digests}")
        files = [file for file in {**then.files, **now.files} if then.files.get(file) != now.files.get(file)]
        if now.sha256 and then.sha256 and files:
            warn(f"{now.source}: {', '.join(files)} differs from the recorded file")
    warn_of_versions(header.versions, versions())


def row_of(folder: str, row: int, overrides: dict[str, Any], controller: str | None) -> "tuple[Scenario | World, str]":
    """Scenario, or world, and engine of a run of a study, by the study's folder and the run's row.

    The row names the engine; for a run that is not done yet the study chooses it. Of the files that the study names
    only the row's are imported, and only if they have not changed. Warns if the code has
    changed. Raises InputError if there is no such run, or one of its files has changed, which is a warning if a law,
    another stage or the vehicle is named anew.
    """
    from ..errors import InputError
    from ..studies.bundle import StudyBundle, changed_files, renamed
    from ..studies.plan import Plan
    from ..studies.results import STUDY, about_of, changes, version_of
    from ..studies.rows import chosen_engine
    from ..studies.study import Study

    if not Path(folder).is_dir():
        raise InputError(f"--row is a run of a study: --from {folder} must be the study's folder")
    plan = Study.load(folder).plan_of_results
    if not 0 <= row < plan.runs:
        raise InputError(f"--row {row}: the study in {folder} has the rows 0 to {plan.runs - 1}")
    named = {*overrides, *(("controller.name",) if controller else ())}
    names = {name for key, name in plan.names(row).items() if key not in named}
    then = version_of(Path(folder))
    if files := sorted({file for name in names for file in changed_files(name, then["files"])}):
        raise InputError(_changed(folder, row, files))
    plan = Plan.that_ran(Path(folder, STUDY), trusted=names)
    scenario = plan.scenario_or_world(row)
    if overrides or controller:
        scenario = scenario.updated(overrides, controller, place=f"row {row} of {folder}", note=warn)
    now = about_of(plan, StudyBundle.of(replace(plan, tables=scenario.to_dict())))
    now["files"] = renamed(now["files"], then["files"])
    of_row = {name: digest for name, digest in then["files"].items() if name in now["files"]}
    code, files = changes(then | {"files": of_row}, now)
    if files and not named:  # e.g. a file beside the law's that an import finds first
        raise InputError(_changed(folder, row, files))
    if code or files:
        warn(f"the run may differ from the row: {'; '.join([*code, *(f'{name} changed' for name in files)])}")
    engine = _engine_of(Path(folder), row) or plan.engine
    return scenario, chosen_engine(scenario) if engine in ("auto", "gpu") else engine  # free_body has a GPU's bits


def _changed(folder: str, row: int, files: list[str]) -> str:
    return (
        f"row {row} of {folder}: since the study began, {', '.join(files)} changed; restore what it was, or name "
        "the file to run it as it is: -c path/to/law.py:Law, or a key, vehicle.model=path"
    )


def _engine_of(folder: Path, row: int) -> str:
    """The engine of a row; empty for a run that is not done yet or could not begin."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        found = pq.read_table(folder / "rows", columns=["engine"], filters=[("index", "==", row)])["engine"].to_pylist()
    except (OSError, pa.ArrowException):
        return ""
    return found[0] if found else ""
