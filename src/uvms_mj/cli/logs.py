"""``uvms-mj info``, ``uvms-mj export`` and ``uvms-mj replay``: inspect, convert and show logs."""

import gc
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .archive import about
from .common import Console, Listing, bad_input, end, exit_interrupted, log_tables, printable, refuse_existing, warn
from .folders import SCENARIO, log_of
from .options import (
    asked_for,
    command,
    force_option,
    json_option,
    names_in,
    number,
    path_argument,
    path_option,
    scenario_argument,
    set_option,
)

if TYPE_CHECKING:
    from ..records.trace import Trace

FORMATS = ("csv", "parquet", "npz", "mat")


@command()
@path_argument("log", metavar="LOG")
@click.option("--show", metavar="NAME", help="Print one of the files in the log, for example scenario.toml.")
@json_option
def info(log: str, show: str | None, as_json: bool) -> None:
    """Print the contents of a log: the run's table, signals, topics, versions, files; or of an archive.

    LOG is a run's log, or a table in TOML that maps the columns of a real vehicle's log to signals; plot, compare and
    export log take it, too. Or it is the folder of a world, with a log of each vehicle, or an archive, FILE.zip: every
    digest is checked, and nothing is executed.

    \b
    uvms-mj info results/run.mcap
    uvms-mj info dive.toml
    uvms-mj info results/run.mcap --show scenario.toml
    uvms-mj info study.zip
    """
    with bad_input():
        if log.lower().endswith(".zip"):
            _of_archive(log, show, as_json)
            return
        if Path(log).is_dir():
            _of_world(log, show, as_json)
            return
        from ..analysis.summary import summary
        from ..errors import InputError, suggestion
        from ..records.mcap import read
        from ..records.trace import Trace

        if Path(log).suffix.lower() == ".toml":
            from ..records.measured import load

            (header, rows, outcome), files = load(log), dict[str, bytes]()
        else:
            header, rows, outcome, files = read(log)
        if show is not None:
            if show not in files:
                raise InputError(f"--show {show}: the log has no such file; {suggestion(show, files)}")
            if not as_json:
                sys.stdout.buffer.write(files[show])
                return
            try:
                click.echo(json.dumps({show: files[show].decode()}))
            except UnicodeDecodeError:
                raise InputError(f"--show {show}: is no text; leave out --json") from None
            return
        trace = Trace.of(header, rows, outcome)
        say_if_truncated(log, trace)
        report = summary(trace, {"mcap": log})
        if as_json:
            stages = {
                name: {"source": s.source, "sha256": s.sha256, "files": s.digests} for name, s in header.sources.items()
            }
            about = {"versions": dict(header.versions), "law": stages["controller"], "stages": stages}
            about |= {"engine": header.engine}
            signals = {s.name: {"shape": list(s.shape), "unit": s.unit, "frame": s.frame} for s in trace.signals}
            attached = {name: len(data) for name, data in files.items()}
            click.echo(json.dumps(report | about | {"rows": len(trace), "signals": signals, "attachments": attached}))
            return
        Console(as_json=False, quiet=False).report({"": trace}, report)
        log_tables(Path(log), trace, files)
        say_how_measured(trace)


def _of_world(folder: str, show: str | None, as_json: bool) -> None:
    """Print the contents of each vehicle's log in the folder of a world. Raises InputError for another folder."""
    from ..errors import InputError

    logs = logs_of(folder)
    if logs == (folder,) or not logs:
        raise InputError(f"{folder}: is a folder; name a log in it, run.mcap")
    if show is not None or as_json:
        raise InputError(f"{folder}: is of a world; with --show and --json name one log: {', '.join(logs)}")
    for log in logs:
        assert info.callback is not None
        info.callback(log, None, False)


def _of_archive(path: str, show: str | None, as_json: bool) -> None:
    """Print the contents of an archive whose digests are right, or one of its files."""
    from ..errors import InputError, suggestion
    from ..reproduce.archive.container import contents, read

    manifest = read(Path(path))
    if show is not None:
        if show not in manifest.members:
            raise InputError(f"--show {show}: the archive has no such file; {suggestion(show, manifest.members)}")
        sys.stdout.buffer.write(contents(Path(path), manifest, show))
        return
    if as_json:
        click.echo(json.dumps(about(manifest)))
        return
    rows = [(name, f"{each.size}", each.sha256[:16]) for name, each in manifest.members.items()]
    Listing(f"{manifest.kind} {manifest.name}", ("file", "bytes", "sha256"), rows, right=("bytes",), width=70).show()
    click.echo(printable("\n".join(f"{name}: {version}" for name, version in manifest.versions.items())))
    click.echo(printable(f"sha256 of {manifest.digest}; every digest is right\n{manifest.command}"))


class _Exports(click.Group):
    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Take a log where no other thing is named."""
        named = args and (args[0] in self.commands or args[0] in ("-h", "--help"))
        return super().parse_args(ctx, args if named else [_LOG, *args])


_LOG = "log"


@click.group(cls=_Exports)
def export() -> None:
    """Write a log in another format, the plant for another program, or a law for a vehicle.

    \b
    uvms-mj export results/run.mcap --to csv            the samples of a log; export log --help
    uvms-mj export fmu push_wall --out plant.fmu        the plant as an FMU; export fmu --help
    uvms-mj export plugin bluerov2_heavy --out plugin   the water as a plugin of MuJoCo; export plugin --help
    uvms-mj export law gsta push_wall --target armv7    a law for the processor of a vehicle; export law --help
    """


@command(_LOG)
@path_argument("log", metavar="LOG")
@click.option("--to", "kind", type=click.Choice(FORMATS), help="Format [default: by the ending of --out].")
@path_option("-o", "--out", metavar="FILE", help="Output file [default: beside the log].")
@click.option(
    "--signals",
    "chosen",
    multiple=True,
    metavar="NAME[,NAME]",
    help="Signals, or in CSV and Parquet components such as tau.x; t is always there; may be repeated [default: all].",
)
@click.option("--rate", metavar="HZ", help="Rows per second, which must divide the log's own [default: all rows].")
@force_option
def export_log(
    log: str, kind: str | None, out: str | None, chosen: tuple[str, ...], rate: str | None, force: bool
) -> None:
    """Write a log's samples in another format, with their units. uvms-mj info LOG lists the signals.

    \b
    uvms-mj export results/run.mcap --to csv
    uvms-mj export results/run.mcap --out force.parquet
    uvms-mj export results/run.mcap --to csv --signals p_WB,tau.x --rate 50
    """
    with bad_input():
        from ..errors import InputError
        from ..records.export import export as write

        suffix = Path(out or "").suffix.lower().removeprefix(".")
        if kind is None and suffix not in FORMATS:
            raise InputError(f"--to: name a format, one of {', '.join(FORMATS)}")
        if suffix in FORMATS and kind not in (None, suffix):
            raise InputError(f"--out {out}: does not fit --to {kind}; the name must end in .{kind}")
        kind = kind or suffix
        path = Path(out) if out is not None else Path(log).with_suffix(f".{kind}")
        names = names_in("--signals", chosen)
        (trace,) = loaded((log,)).values()
        if rate is not None:
            trace = trace.at_rate(number("--rate", rate, "Hz", 1e-9, 1e9))
        write(trace.header, trace.arrays, kind, path, force, names)
        click.echo(str(path))


@command("fmu")
@scenario_argument
@set_option
@path_option("-o", "--out", metavar="FILE", help="Output file, NAME.fmu [default: plant.fmu].")
@click.option("--with-law", is_flag=True, help="With the law of the scenario inside, and no inputs.")
@force_option
def export_fmu(
    arguments: tuple[str, ...], settings: tuple[str, ...], out: str | None, with_law: bool, force: bool
) -> None:
    """Write the plant of a scenario as an FMU of FMI 2.0, for Simulink, OSP, FMPy and others.

    Its inputs are the wrench tau_cmd, or with actuation.name=external the thrusts; its outputs are all signals of a
    run, and its parameters are keys of wall, current, initial state, disturbance and seed. It is machine code, without
    Python where it runs, for Linux on x86-64.

    \b
    uvms-mj export fmu push_wall current.speed=0.3 --out plant.fmu
    uvms-mj export fmu push_wall --with-law --out closed.fmu
    """
    with bad_input():
        from ..engine.plant_fmu import write_fmu
        from ..errors import InputError
        from ..scenario import Scenario

        name, overrides = asked_for(arguments, settings)
        path = Path(out or "plant.fmu")
        if path.suffix != ".fmu":
            raise InputError(f"--out {path}: must end in .fmu")
        refuse_existing("--out", path, force)
        parameters = write_fmu(Scenario.load(name or "push_wall", overrides), path, with_law)
        click.echo(f"{path}: {path.stat().st_size / 1000:.0f} kB; parameters {', '.join(parameters)}, simulation.seed")


@command("plugin")
@click.argument("vehicle")
@path_option(
    "-o", "--out", metavar="DIR", help="Folder of the files; it must not exist, or be empty [default: plugin]."
)
def export_plugin(vehicle: str, out: str | None) -> None:
    """Write the water of a vehicle as a plugin of the installed MuJoCo: for simulate, rollout, C++ and ROS 2's host.

    VEHICLE is the name of one that ships, or a file. DIR gets a library and the vehicle's MJCF, which asks for it: its
    added mass is in mjData.M, and its drag, weight and buoyancy act in the current of the attribute current.

    \b
    uvms-mj export plugin bluerov2_heavy --out plugin
    simulate plugin/bluerov2_heavy.xml          with libuvms_mj_water_0.so in its folder mujoco_plugin
    """
    with bad_input():
        from ..engine.water_plugin import write_plugin
        from ..errors import InputError
        from ..files import locked

        folder = Path(out or "plugin")
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"--out {folder}: is not an empty folder; choose another")
        with locked(folder):
            for path in write_plugin(vehicle, folder):
                click.echo(str(path))


@command("law")
@click.argument("law")
@scenario_argument
@set_option
@click.option(
    "-t", "--target", "targets", multiple=True, metavar="T[,T]",
    help="Processors: x86_64, aarch64, armv7 or thumbv7em; may be repeated [default: x86_64].",
)  # fmt: skip
@path_option("-o", "--out", metavar="DIR", help="Folder of the files [default: NAME of the library].")
@click.option("--name", metavar="NAME", help="Name of the library and its functions [default: the law's].")
@click.option(
    "--reference", type=click.Choice(["guidance", "caller"]), default="guidance", show_default=True,
    help="Whose reference: of the scenario's guidance, inside, or one that you give to each call.",
)  # fmt: skip
@click.option("--no-test", is_flag=True, help="Do not run the test here, natively or in an emulator.")
@force_option
def export_law(
    law: str,
    arguments: tuple[str, ...],
    settings: tuple[str, ...],
    targets: tuple[str, ...],
    out: str | None,
    name: str | None,
    reference: str,
    no_test: bool,
    force: bool,
) -> None:
    """Write a law with its control system as a library in C, for the processor of a vehicle.

    LAW is one that ships, or a file of yours, law.py:Law or law.c. The library takes measurements and gives thrusts,
    and pulse widths with thrusters.name=t200: tracking, model, task, law, delay and allocation, each the machine code
    of the run. DIR gets for each target libNAME.a and, for Linux, libNAME.so; NAME.h for C99 and C++17; test.c, which
    compares 1,200 recorded steps bit for bit; loop.c, which answers a run over UDP, with the target's processor in the
    loop, and takes measurements over UDP or a serial line on the vehicle; NAME.toml with gains and digests;
    scenario.toml; a README with a compiler's line for each target.

    \b
    uvms-mj export law gsta push_wall controller.period=0.01 --target aarch64,armv7 --out gsta
    uvms-mj export law my_law.py:MyLaw vehicle.model=bluerov2_heavy thrusters.name=t200 --target armv7
    uvms-mj run -c gsta/x86_64/libgsta.so:gsta_law        the library as a law again
    uvms-mj run -c udp controller.export=NUMBER           the program loop.c answers; NUMBER is in its README

    \b
    x86_64      Linux on x86-64
    aarch64     Linux on ARM with 64 bits: Raspberry Pi 3 to 5, Jetson
    armv7       Linux on ARM with 32 bits: BlueOS on a Raspberry Pi
    thumbv7em   Cortex-M7 with a double-precision unit, without an operating system

    It needs the extra c: pip install 'uvms-mj[c]'.
    """
    with bad_input():
        # NumPy's threads otherwise look for work for a tenth of a second after its import, on the core of the tools
        os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")
        from ..engine.law_library.linking import MACHINES, Work
        from ..errors import Fault, InputError, suggestion

        if "=" in law:
            raise InputError(f"{law}: name the law first, as in uvms-mj export law gsta {law}")
        chosen = list(dict.fromkeys(names_in("--target", targets))) or ["x86_64"]
        for target in chosen:
            if target not in MACHINES:
                raise InputError(f"--target {target}: is not known; {suggestion(target, MACHINES)}")
        with Work(chosen, not no_test) as work:
            scenario_name, overrides = asked_for(arguments, settings)
            if "controller.name" in overrides:
                raise InputError([Fault("controller.name", f"the law is the first word, {law}; leave the key out")])
            from ..engine.law_library.library import name_of, write_library
            from ..files import locked
            from ..scenario import Scenario

            scenario = Scenario.load(scenario_name or "push_wall", overrides, law)
            name = name or name_of(scenario)
            folder = Path(out or name)
            if folder.exists() and not folder.is_dir():
                raise InputError(f"--out {folder}: is a file; name a folder")
            if folder.exists() and any(folder.iterdir()) and not force:
                raise InputError(f"--out {folder}: is not an empty folder; choose another, or add --force")
            with locked(folder):
                library = write_library(scenario, folder, chosen, name, reference == "guidance", not no_test, work)
            gc.freeze()  # no collection looks now at all that was made meanwhile
            gc.unfreeze()
        for note in library.notes:
            warn(note)
        for each in library.targets:
            if each.foreign:
                of = f"{each.target}: the law's C takes {', '.join(each.foreign)} from the C library there"
                warn(f"{of}; test.c says on the target whether it has the bits of the run")
            sizes = f"code {each.code} bytes, constants {each.constants}, record {library.record}"
            ran = f"; {each.equal} of {library.steps} steps equal, stack {each.stack}" if each.equal is not None else ""
            click.echo(f"{folder / next(iter(each.files))}: {sizes}{ran}")
        click.echo(f"{folder / 'README.md'}: one step each {library.period:g} s")


for _each in (export_log, export_fmu, export_plugin, export_law):
    export.add_command(_each)


@command()
@click.argument("logs", nargs=-1, required=True, metavar="LOG...")
@path_option("--save", metavar="FILE.rrd", help="Write a Rerun recording with its views; open no window.")
@click.option("--web", is_flag=True, help="Serve the web viewer on 127.0.0.1 until Ctrl-C; open no window.")
@force_option
def replay(logs: tuple[str, ...], save: str | None, web: bool, force: bool) -> None:
    """Show a log in the Rerun viewer. Several logs are shown together, each in its colour.

    \b
    uvms-mj replay results/run.mcap
    uvms-mj replay gsta/run.mcap fosm/run.mcap --web
    uvms-mj replay results/run.mcap --save run.rrd
    """
    with bad_input():
        from ..errors import InputError

        if save is not None and web:
            raise InputError("--save and --web exclude each other; choose one")
        if save is not None and Path(save).suffix.lower() != ".rrd":
            raise InputError(f"--save {save}: the name must end in .rrd")
        if save is not None:
            refuse_existing("--save", Path(save), force)
        traces = loaded(logs)
        from ..views import rerun as rerun_view

        try:
            if save is not None:
                rerun_view.save(traces, Path(save))
                click.echo(save)
            elif web:
                rerun_view.serve(traces)  # prints the address; Ctrl-C ends it
            else:
                rerun_view.show(traces)
        except KeyboardInterrupt:
            end("stopped", exit_interrupted())


def loaded(logs: tuple[str, ...]) -> "dict[str, Trace]":
    """The traces of several logs by :func:`labels`. Warns of truncated logs."""
    from ..records.trace import Trace

    logs = tuple(each for log in logs for each in logs_of(log))
    traces = [Trace.load(log) for log in logs]
    for log, trace in zip(logs, traces, strict=True):
        say_if_truncated(log, trace)
        say_how_measured(trace)
    return dict(zip(labels(logs, traces), traces, strict=True))


def logs_of(log: str) -> tuple[str, ...]:
    """The logs of the vehicles in the folder of a world, or the one log that is named."""
    from ..files import is_file
    from ..setup.world import vehicles_of

    scenario = Path(log) / SCENARIO
    names = vehicles_of(scenario) if is_file(scenario) else []
    there = (Path(log) / log_of(name) for name in names)
    if not names:
        return (log,)
    return tuple(str(path) for path in there if path.exists())


def labels(logs: "tuple[str, ...]", traces: "list[Trace]") -> list[str]:
    """Names for several logs: of vehicles in one world their names; otherwise their laws if these differ, else their
    folders, else their file names."""
    from ..setup.world import one_world

    if one_world([trace.scenario for trace in traces]):
        return [trace.scenario.vehicle.name for trace in traces]
    laws = [trace.scenario.controller.label() for trace in traces]
    folders = [Path(log).absolute().parent.name for log in logs]
    stems = [Path(log).stem for log in logs]
    for names in (laws, folders, stems, [f"{law} {folder}" for law, folder in zip(laws, folders, strict=True)]):
        if len(set(names)) == len(names):
            return names
    return [f"{law} {i + 1}" for i, law in enumerate(laws)]


def say_how_measured(trace: "Trace") -> None:
    """Print how the log of a real vehicle was read: its clock, its gaps and what is missing."""
    if trace.header.measured:
        for note in trace.notes:
            click.echo(printable(note), err=True)


def say_if_truncated(log: str, trace: "Trace") -> None:
    from ..records.header import Status

    if trace.status is Status.truncated:
        warn(f"{log}: {trace.message}")
