"""One run: ``uvms-mj run``, and ``uvms-mj sitl`` with an autopilot in the loop."""

import contextlib
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import click

from .archive import compared, unpacked
from .common import (
    EXIT_BAD_INPUT,
    EXIT_UNSTABLE,
    Console,
    Stop,
    bad_input,
    end,
    ended,
    exit_interrupted,
    label_of,
    printable,
    warn,
    warn_of_versions,
)
from .folders import LOG, RunFolder, log_of, output_folder, remove_if_empty
from .live import Live, live_options
from .options import asked_for, command, output_options, path_option, run_options, scenario_argument, set_option

if TYPE_CHECKING:
    from typing_extensions import TypeIs

    from ..engine.vehicle_run import Changes, Peer
    from ..plant.mjcf import Mjcf
    from ..records.header import Header, Sink
    from ..scenario import Scenario
    from ..setup.world import World


@command(
    epilog="Exit status: 0 completed, 1 differs from the archive that it repeats, 2 bad input or a law that failed, 3 "
    "unstable, 130 interrupted (143 SIGTERM, 129 SIGHUP)."
)
@run_options(
    "Repeat the run of a log, run.mcap, with its scenario and vehicle; of an archive, FILE.zip, with its laws; with "
    "--row, of a study's folder."
)
@click.option("--row", type=click.IntRange(min=0), metavar="N", help="Repeat this row of the study in --from DIR.")
@path_option("-o", "--out", metavar="DIR", help="Output folder [default: runs/<time>-<scenario>-<controller>].")
@click.option("--log-rate", metavar="HZ|full", help="Samples per second; must divide the step rate [default: 1 kHz].")
@click.option("--engine", metavar="NAME", help="mujoco [default], or free_body: one vehicle without MuJoCo, faster.")
@click.option(
    "--as-deployed", is_flag=True, help="Commands as a real vehicle takes them: late, slow, whole microseconds."
)
@live_options
@click.option("--speed", metavar="N|max", help="With --live foxglove: times real time [default: 1], or as it runs.")
@click.option("--port", type=click.IntRange(0, 65535), metavar="P", help="TCP port of --live foxglove [default: 8765].")
@click.option(
    "--host", metavar="ADDRESS", help="Address of --live foxglove [default: 127.0.0.1]. Others may then connect."
)
@output_options
def run(
    out: str | None,
    log_rate: str | None,
    engine: str | None,
    live: str | None,
    viewer: bool,
    speed: str | None,
    port: int | None,
    host: str | None,
    as_json: bool,
    quiet: bool,
    **asked: Any,
) -> None:
    """Run a scenario: a TOML file, or the name of a built-in one (default: push_wall, the paper's).

    The samples are written to DIR/run.mcap during the run. The log stays readable if the run stops early.

    \b
    uvms-mj run --controller gsta
    uvms-mj run --controller fosm --set controller.epsilon=2e-3 --set wall.stiffness=2e4
    uvms-mj run my_scenario.toml --controller my_law.py:MyLaw --log-rate full --out results
    uvms-mj run --from results/run.mcap --set current.speed=0.3
    uvms-mj run --from study --row 17 --viewer
    uvms-mj run --from run.zip --out repeated
    uvms-mj run --live foxglove
    uvms-mj run --engine free_body
    uvms-mj run --as-deployed vehicle.model=bluerov2_heavy thrusters.voltage=14 thrusters.mixer=linear
    """
    stop = Stop()
    console = Console(as_json, quiet)
    scenario: Scenario | World | None = None
    files: dict[str, Path] = {}
    try:
        with bad_input(), console.alone():
            from ..files import locked

            deployed = asked["as_deployed"]
            shown = Live(live, viewer, speed, port, host)
            if (world := _world_of(**asked)) is not None:
                scenario = world
                sys.exit(_run_world(world, out, files, log_rate, engine, shown, console, stop))
            again = asked["log"] is not None and asked["log"].lower().endswith(".zip")
            if again:
                out, asked = _unpacked(out, asked)
            as_it_was = again and not (asked["arguments"] or asked["settings"] or asked["controller"] or deployed)
            found, mjcf, log_rate, recorded = _chosen(**asked, log_rate=log_rate)
            scenario = found
            if _is_world(found):  # a row of a study
                sys.exit(_run_world(found, out, files, log_rate, engine or recorded, shown, console, stop))
            changes = () if asked["log"] is None or asked["row"] is not None else _changes_of(asked["log"])
            if deployed and not quiet:
                _say_what_is_left(found, mjcf)
            folder, made = output_folder(out, found)
            with locked(folder), contextlib.closing(shown):
                try:
                    status = run_and_report(
                        found,
                        mjcf,
                        folder,
                        files,
                        log_rate,
                        recorded if engine is None else engine,
                        shown,
                        console,
                        stop,
                        changes=changes,
                    )
                    if as_it_was and status in (0, EXIT_UNSTABLE):
                        status = compared("run", folder, quiet) or status
                finally:  # within the lock: the folder of another run, which has not written yet, is empty too
                    remove_if_empty(made)
    except KeyboardInterrupt:
        if as_json:
            click.echo(json.dumps(_nothing_ran(scenario, asked["controller"], _existing(files))))
        end("interrupted before the first step", exit_interrupted())
    sys.exit(status)


def _world_of(
    arguments: tuple[str, ...],
    settings: tuple[str, ...],
    controller: str | None,
    log: str | None,
    row: int | None,
    as_deployed: bool,
) -> "World | None":
    """The world that the arguments of the command name; None if they name one vehicle. Raises InputError if the input
    is invalid."""
    from ..setup.world import World, vehicles_of

    name, overrides = asked_for(arguments, settings)
    if name is None or log is not None or name.endswith(".mcap") or not vehicles_of(name):
        return None
    if as_deployed:
        from ..setup.deployment import as_deployed as deployed

        overrides = deployed(overrides)
    return World.load(name, overrides, controller)


def _run_world(
    world: "World",
    out: str | None,
    files: dict[str, Path],
    log_rate: str | None,
    engine: str | None,
    shown: Live,
    console: Console,
    stop: Stop,
) -> int:
    """Run a world, write a log for each vehicle and report each; return the exit status."""
    from ..analysis.metrics import AROUND_THE_END_S
    from ..analysis.summary import ending, fluctuates, summary
    from ..control.base import NoClosedForm
    from ..engine.run import simulate
    from ..engine.vehicle_run import LawError, SinkError
    from ..errors import InputError
    from ..files import locked
    from ..records.mcap import McapLog
    from ..setup.coupled_rest import coupled_rest

    if shown.asked_for:
        raise InputError("a viewer shows one vehicle during its run; uvms-mj replay DIR shows a world afterwards")
    folder, made = output_folder(out, world)
    if world.couplings and not console.quiet:
        rest = coupled_rest(world)
        said = [f"no closed form of the loads: {rest.reason}"] if isinstance(rest, NoClosedForm) else rest.announced
        click.echo(printable("\n".join(said)), err=True)
    half = max(AROUND_THE_END_S, 0.5 * world.simulation.duration)
    kept = half if any(map(fluctuates, world.scenarios.values())) else AROUND_THE_END_S
    with locked(folder):
        try:
            sinks: dict[str, list[Sink]] = {name: [McapLog(folder / log_of(name))] for name in world.scenarios}
            next(iter(sinks.values())).insert(0, RunFolder(folder, files, made_of(world), world))
            with console.running(world, stop) as progress:
                traces = simulate(
                    world, log_rate=log_rate, progress=progress, sinks=sinks, keep_s=kept, engine=engine or "mujoco"
                )
        except (LawError, SinkError) as raised:
            click.echo(printable(f"error: {raised}"), err=True)
            return EXIT_BAD_INPUT
        except OSError as raised:
            raise InputError(f"{raised.filename or f'--out {folder}'}: {raised.strerror}") from None
        finally:
            remove_if_empty(made)
    stop.ignore()
    there, status = _existing(files), 0
    reports = {name: summary(trace, {"mcap": there[name]}) for name, trace in traces.items()}
    console.reports(traces, {"scenario": world.name, "vehicles": reports, "files": {"scenario": there["scenario"]}})
    for name, trace in traces.items():
        for note in ending(trace):
            warn(f"{name}: {note}")
        status = max(status, ended(trace, f"{name}: "))
    return status


def made_of(world: "World | None" = None) -> list[str]:
    """The names of the files that are made from the logs of a run or a world, and go with them."""
    from .logs import FORMATS
    from .plot import WHATS

    logs = [LOG] if world is None else [log_of(name) for name in world.scenarios]
    suffixes = [f".{kind}" for kind in (*FORMATS, "mp4")]
    return [f"{what}.png" for what in WHATS] + [str(Path(log).with_suffix(each)) for log in logs for each in suffixes]


def _is_world(scenario: "Scenario | World") -> "TypeIs[World]":
    from ..setup.world import World

    return isinstance(scenario, World)


def chosen(*asked: Any, **more: Any) -> "tuple[Scenario, Mjcf | None, str | None, str]":
    """Scenario, vehicle, log rate and engine of a command for one vehicle, by its arguments. The vehicle is None unless
    it is a log's. Raises InputError if the input is invalid."""
    scenario, mjcf, log_rate, engine = _chosen(*asked, **more)
    if _is_world(scenario):
        from ..errors import InputError

        raise InputError(f"{scenario.name}: is a world of several vehicles; here is one vehicle needed")
    return scenario, mjcf, log_rate, engine


def _chosen(
    arguments: tuple[str, ...],
    settings: tuple[str, ...],
    controller: str | None,
    log: str | None,
    log_rate: str | None,
    row: int | None = None,
    as_deployed: bool = False,
    names: Mapping[str, str] = MappingProxyType({}),
) -> "tuple[Scenario | World, Mjcf | None, str | None, str]":
    """Scenario, or world of a study's row, vehicle, log rate and engine of a run, by the arguments of the command. The
    vehicle is None unless it is a log's. ``names`` are the files of an archive by the keys that name them. Raises
    InputError if the input is invalid."""
    from ..errors import InputError
    from ..scenario import Scenario

    name, overrides = asked_for(arguments, settings)
    if as_deployed:
        from ..setup.deployment import as_deployed as deployed

        overrides = deployed(overrides)
    if row is not None and log is None:
        raise InputError(f"--row {row}: name the folder of its study with --from DIR")
    if name is not None and name.endswith(".mcap"):
        raise InputError(f"{name}: is a log, not a scenario; --from {name} uses the scenario and the vehicle of a log")
    if log is None:
        return Scenario.load(name or "push_wall", overrides, controller), None, log_rate, "mujoco"
    if name is not None:
        raise InputError(f"one scenario at a time, please: {name}, {log}")
    if row is not None:
        scenario, engine = row_of(log, row, overrides, controller)
        return scenario, None, log_rate, engine
    if Path(log, "study.toml").is_file():
        raise InputError(f"--from {log}: is the folder of a study; name one of its runs with --row N")
    if controller is not None:
        names = {key: value for key, value in names.items() if key != "controller.name"}
    return _from_log(log, {**names, **overrides}, controller, log_rate)


def _unpacked(out: str | None, asked: dict[str, Any]) -> tuple[str, dict[str, Any]]:
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


def _say_what_is_left(scenario: "Scenario", mjcf: "Mjcf | None") -> None:
    """Print what the thrusters' commands leave of the demanded push, before the run."""
    from ..setup.base import set_up
    from ..setup.deployment import resolution

    found = resolution(set_up(scenario, mjcf))
    quantum = getattr(scenario.thrusters, "quantum", 0.0)
    said = f"what is left of the push is not known: {found}" if isinstance(found, str) else found.text(quantum)
    click.echo(printable(f"as deployed: {said}"), err=True)


def _from_log(
    log: str, overrides: dict[str, Any], controller: str | None, log_rate: str | None
) -> "tuple[Scenario, Mjcf | None, str | None, str]":
    """Scenario, vehicle, log rate and engine of a log. Warns if a repetition may differ from the original."""
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
    return scenario, None if "vehicle.model" in overrides else header.mjcf, log_rate, header.engine


def _changes_of(log: str) -> "Changes":
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


def run_and_report(
    scenario: "Scenario",
    mjcf: "Mjcf | None",
    folder: Path,
    files: dict[str, Path],
    log_rate: str | None,
    engine: str,
    shown: Live,
    console: Console,
    stop: Stop,
    peer: "Peer | None" = None,
    changes: "Changes" = (),
) -> int:
    """Run, write and report; return the exit status. The files that the run opens are added to ``files``. ``peer`` is
    as in :func:`uvms_mj.engine.run.simulate`, and ``changes`` are made in the run as :class:`.Again` does."""
    from ..analysis.metrics import AROUND_THE_END_S
    from ..analysis.summary import ending, fluctuates, summary
    from ..engine.run import simulate
    from ..engine.vehicle_run import Again, LawError, SinkError
    from ..errors import InputError
    from ..records.header import Status
    from ..records.mcap import McapLog

    sinks: list[Sink] = [RunFolder(folder, files, made_of()), McapLog(folder / LOG)]
    viewers, guides = shown.open()
    error, half = None, max(AROUND_THE_END_S, 0.5 * scenario.simulation.duration)
    with console.running(scenario, stop) as progress:
        try:
            trace = simulate(
                scenario,
                log_rate=log_rate,
                progress=progress,
                sinks=[*viewers, *sinks],  # without a display or a port it fails before anything is written
                keep_s=half if fluctuates(scenario) else AROUND_THE_END_S,  # for the push's deviation
                engine=engine,
                mjcf=mjcf,
                peer=peer,
                guides=[*([Again(changes)] if changes else []), *guides],
            )
        except (LawError, SinkError) as raised:
            trace, error = raised.trace, str(raised)
        except InputError:
            raise
        except OSError as raised:
            raise InputError(f"{raised.filename or f'--out {folder}'}: {raised.strerror}") from None
    stop.ignore()
    report = summary(trace, _existing(files))
    console.report(trace, report)
    if error is not None:
        click.echo(printable(f"error: {error}"), err=True)
        shown.stay(stop)
        return EXIT_BAD_INPUT
    for note in ending(trace):
        warn(note)
    if trace.status is not Status.interrupted:
        shown.stay(stop)
    return ended(trace)


def _existing(files: dict[str, Path]) -> dict[str, str]:
    return {kind: str(path) for kind, path in files.items() if path.exists()}


def _nothing_ran(scenario: "Scenario | World | None", controller: str | None, files: dict[str, str]) -> dict[str, Any]:
    """The report of a run that was interrupted before its first step."""
    from ..analysis.summary import summary_of_none

    known: dict[str, Any] = {
        "controller": controller,
        "status": "interrupted",
        "message": "interrupted before the first step",
    }
    if scenario is not None:
        known |= {
            "scenario": scenario.name,
            "controller": label_of(scenario),
            "timestep_s": scenario.simulation.timestep,
        }
    return summary_of_none(known, files)


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


@command(epilog="Exit status: as of uvms-mj run; Ctrl-C ends the session, and its log is whole.")
@scenario_argument
@set_option
@path_option("-o", "--out", metavar="DIR", help="Output folder [default: runs/<time>-<scenario>-<controller>].")
@click.option("--rate", type=float, default=400.0, show_default=True, metavar="HZ", help="Frames a simulated second.")
@click.option("--depth", type=float, default=5.0, show_default=True, metavar="M", help="Depth of the origin of W.")
@click.option(
    "--instance", type=click.IntRange(0, 99), default=0, metavar="N", help="ArduPilot's -I N: port 9002 + 10 N."
)
@click.option("--port", type=click.IntRange(1, 65535), metavar="P", help="UDP port, in place of the instance's.")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on. Beyond this machine's own, others may command; a warning says so.",
)
@click.option("--motors", metavar="1,-2,...", help="Of each thruster its motor, and its sign [default: by geometry].")
@click.option("--engine", metavar="NAME", help="free_body where it can [default], or mujoco.")
@click.option("--log-rate", metavar="HZ|full", help="Samples per second; must divide the step rate [default: 100].")
@live_options
@click.option("-q", "--quiet", is_flag=True, help="Print no progress bar and no table.")
def sitl(
    arguments: tuple[str, ...],
    settings: tuple[str, ...],
    out: str | None,
    rate: float,
    depth: float,
    instance: int,
    port: int | None,
    host: str,
    motors: str | None,
    engine: str | None,
    log_rate: str | None,
    live: str | None,
    viewer: bool,
    quiet: bool,
) -> None:
    """Be the physics of an ArduSub: its pulse widths move a vehicle in our water, in lockstep.

    The plant owns time: it steps when the autopilot has sent a frame, and the autopilot's clock follows the plant's.
    The scenario has wall, current, sensors and thrusters. The log has the pulse widths and the numbers of
    the frames.

    \b
    uvms-mj sitl vehicle.model=bluerov2_heavy
    ardusub -w --model JSON:127.0.0.1 --speedup 1 --home 33.810313,-118.393867,0,0 --defaults sub-6dof.parm
    """
    from ..engine.ardupilot import PORT, ArduPilot, given_motors, motors_of, steps_of
    from ..errors import InputError
    from ..files import locked
    from ..scenario import Scenario
    from ..setup.base import set_up
    from ..studies.rows import chosen_engine

    stop, console, files = Stop(), Console(False, quiet), dict[str, Path]()
    status = 0
    with bad_input(), console.alone():
        name, overrides = asked_for(arguments, settings)
        given: dict[str, Any] = {"controller.name": "external", "actuation.name": "autopilot", "thrusters.name": "t200"}
        given |= {"simulation.duration": 3600.0}
        scenario = Scenario.load(name or "push_wall", given | overrides)
        if not (scenario.controller.external and scenario.actuation.name == "autopilot"):
            wrong = "with sitl an autopilot commands: leave out controller.name and actuation.name"
            raise InputError(wrong)
        if not host or not math.isfinite(depth):
            raise InputError("--host must not be empty, and --depth must be a finite number")
        shown = Live(live, viewer, "max" if live == "foxglove" else None)  # the autopilot has the pace
        setup = set_up(scenario)
        frame = "given"
        if motors is not None:
            channels, signs = given_motors(motors, len(setup.vehicle.thrusters))
        else:
            frame, channels, signs = motors_of(setup.vehicle.B)
        steps = steps_of(rate, scenario.simulation.timestep)
        place = PORT + 10 * instance if port is None else port
        folder, made = output_folder(out, scenario)
        with locked(folder), contextlib.closing(shown):
            peer = ArduPilot(channels, signs, steps, depth, place, host)
            try:
                if not quiet:
                    click.echo(
                        f"frame {frame}; waits for an autopilot on UDP {host}:{place}, --model JSON:{host}", err=True
                    )
                kind = engine or chosen_engine(scenario)
                status = run_and_report(
                    scenario, None, folder, files, log_rate or "100", kind, shown, console, stop, peer
                )
            finally:
                peer.close()
                remove_if_empty(made)
                if not quiet:
                    click.echo(f"autopilot: {peer.counts}; the plant waited {peer.waited_s:.2f} s for them", err=True)
    sys.exit(status)
