"""``uvms-mj run``."""

import json
import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import (
    EXIT_BAD_INPUT,
    EXIT_UNSTABLE,
    Stop,
    alone_in,
    asked_for,
    bad_input,
    command,
    end,
    exit_interrupted,
    folder_for,
    json_option,
    move_aside,
    path_option,
    quiet_option,
    scenario_argument,
    set_option,
)
from .console import Console

if TYPE_CHECKING:
    from ..plant.mjcf import Mjcf
    from ..records.header import Header, Sink
    from ..scenario import Scenario


@command(
    epilog="Exit status: 0 completed, 2 bad input or a law that failed, 3 unstable, 130 interrupted (143 by SIGTERM)."
)
@scenario_argument
@click.option(
    "-c", "--controller", metavar="LAW", help="gsta, sta, fosm, impedance, ideal, or path/to/my_law.py:MyLaw."
)
@set_option
@path_option("--from", "log", metavar="LOG", help="Repeat the run of a log, run.mcap, with its scenario and vehicle.")
@path_option("-o", "--out", metavar="DIR", help="Output folder [default: runs/<time>-<scenario>-<controller>].")
@click.option("--log-rate", metavar="HZ|full", help="Samples per second; must divide the step rate [default: 1 kHz].")
@click.option("--viewer", is_flag=True, help="Open the Rerun viewer and stream to it during the run.")
@json_option
@quiet_option
def run(
    arguments: tuple[str, ...],
    controller: str | None,
    settings: tuple[str, ...],
    log: str | None,
    out: str | None,
    log_rate: str | None,
    viewer: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Run a scenario: a TOML file, or the name of a built-in one (default: push_wall, the paper's).

    The samples are written to DIR/run.mcap during the run. The log stays readable if the run stops early.

    \b
    uvms-mj run --controller gsta
    uvms-mj run --controller fosm --set controller.epsilon=2e-3 --set wall.stiffness=2e4
    uvms-mj run my_scenario.toml --controller my_law.py:MyLaw --log-rate full --out results
    uvms-mj run --from results/run.mcap --set current.speed=0.3
    """
    stop = Stop()
    console = Console(as_json, quiet)
    scenario = None
    files: dict[str, Path] = {}
    try:
        with bad_input(), console.alone():
            from ..errors import InputError
            from ..scenario import Scenario

            name, overrides = asked_for(arguments, settings)
            if name is not None and log is not None:
                raise InputError(f"one scenario at a time, please: {name}, {log}")
            mjcf: Mjcf | None = None
            if log is not None:
                scenario, mjcf, log_rate = from_log(log, overrides, controller, log_rate)
            else:
                scenario = Scenario.load(name or "push_wall", overrides, controller)
            folder, made = _output_folder(out, scenario)
            try:
                with alone_in(folder):
                    status = _simulate(scenario, mjcf, folder, files, log_rate, viewer, console, stop)
            finally:
                _remove_if_empty(made)
    except KeyboardInterrupt:
        if as_json:
            click.echo(json.dumps(_nothing_ran(scenario, controller) | {"files": _existing(files)}))
        end("interrupted before the first step", exit_interrupted())
    sys.exit(status)


def from_log(
    log: str, overrides: dict[str, Any], controller: str | None, log_rate: str | None
) -> "tuple[Scenario, Mjcf | None, str | None]":
    """Scenario, vehicle and log rate of a log. Warns if a repetition may differ from the original."""
    from ..errors import InputError
    from ..records.header import StageSource, versions
    from ..records.mcap import read_files
    from ..scenario import Scenario
    from ..stages.recorded import Recorded

    header, _ = read_files(log)
    recorded = header.law.source
    tables = header.scenario.to_dict()
    if isinstance(header.scenario.controller, Recorded):
        if controller is None:
            raise InputError(
                f"{log} was made by the law {recorded}. Code from a log is never executed: name the law's file with "
                f"--controller path/to/{recorded} (`uvms-mj info {log} --show law/{recorded.partition(':')[0]}` prints "
                "the recorded code)"
            )
        if controller.rpartition(":")[2] == recorded.rpartition(":")[2]:
            tables["controller"]["name"] = controller  # the same class: keep its recorded gains
    scenario = Scenario.from_dict(tables, overrides, controller, place=log)
    law = StageSource.of(scenario.controller)
    if header.law.sha256 and law.sha256 and law.sha256 != header.law.sha256:
        click.echo(
            f"warning: {law.source} differs from the recorded code: sha256 {header.law.sha256[:12]}... then, "
            f"{law.sha256[:12]}... now",
            err=True,
        )
    now = versions()
    changed = [f"{k} {then} then, {now[k]} now" for k, then in header.versions.items() if now.get(k, then) != then]
    if changed:
        click.echo(f"warning: the repetition may differ in its last bits: {'; '.join(changed)}", err=True)
    if log_rate is None and "simulation.timestep" not in overrides:
        log_rate = repr(1.0 / (header.row_steps * scenario.simulation.timestep))
    return scenario, None if "vehicle.model" in overrides else header.mjcf, log_rate


def _simulate(
    scenario: "Scenario",
    mjcf: "Mjcf | None",
    folder: Path,
    files: dict[str, Path],
    log_rate: str | None,
    viewer: bool,
    console: Console,
    stop: Stop,
) -> int:
    """Run, write and report; return the exit status. The files that the run opens are added to ``files``."""
    import warnings

    from ..analysis.summary import AROUND_THE_END_S, summary
    from ..engine.run import LawError, SinkError, simulate
    from ..errors import InputError
    from ..records.header import Status
    from ..records.mcap import McapLog

    sinks: list[Sink] = [_Folder(folder, files), McapLog(folder / _LOG)]
    if viewer:
        from ..views.rerun import LiveView

        sinks.insert(0, LiveView())  # first: without a display it fails before anything is written
    error = None
    with warnings.catch_warnings(), console.progress(scenario) as bar:
        warnings.showwarning = console.warn

        def progress(done: int, total: int) -> None:
            stop.check()
            bar(done, total)

        try:
            trace = simulate(
                scenario, log_rate=log_rate, progress=progress, sinks=sinks, keep_s=AROUND_THE_END_S, mjcf=mjcf
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
        click.echo(f"error: {error}", err=True)
        return EXIT_BAD_INPUT
    if trace.status is not Status.completed:
        click.echo(f"{trace.status.name}: {trace.message}", err=True)
    return {Status.unstable: EXIT_UNSTABLE, Status.interrupted: exit_interrupted()}.get(trace.status, 0)


_LOG, _SCENARIO = "run.mcap", "scenario.toml"


def _existing(files: dict[str, Path]) -> dict[str, str]:
    return {kind: str(path) for kind, path in files.items() if path.exists()}


class _Folder:
    """The first sink: moves the files of an earlier run to a subfolder and writes scenario.toml."""

    def __init__(self, folder: Path, files: dict[str, Path]) -> None:
        self.folder, self.files = folder, files

    def begin(self, header: "Header") -> None:
        paths = {"mcap": self.folder / _LOG, "scenario": self.folder / _SCENARIO}
        move_aside(self.folder, paths.values(), "the earlier run")
        self.files |= paths
        paths["scenario"].write_text(header.scenario.to_toml(), encoding="utf-8")

    def write(self, rows: Any) -> None:
        pass

    def end(self, outcome: Any) -> None:
        pass


def _output_folder(out: str | None, scenario: "Scenario") -> tuple[Path, list[Path]]:
    """Create the folder of a run before anything is computed. Returns it and all new folders, inner first."""
    import datetime
    import itertools

    if out is not None:
        folder = Path(out)
        made = _missing(folder)
        return folder_for(out), made
    now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    words = re.sub(r"[^\w.-]+", "_", f"{scenario.name}-{scenario.controller.label()}")[:100]
    stem = folder = Path("runs") / f"{now}-{words}"
    for n in itertools.count(2):
        made = _missing(folder)
        try:
            folder.mkdir(parents=True)
        except FileExistsError:  # another run started in the same second
            folder = stem.with_name(f"{stem.name}-{n}")
            continue
        except OSError:
            pass
        break
    return folder_for(str(folder)), made


def _missing(folder: Path) -> list[Path]:
    """The folder and its parents that do not exist yet, inner first."""
    return [path for path in (folder, *folder.parents) if not os.path.exists(path)]


def _remove_if_empty(folders: list[Path]) -> None:
    import contextlib

    with contextlib.suppress(OSError):
        for folder in folders:
            folder.rmdir()


def _nothing_ran(scenario: "Scenario | None", controller: str | None) -> dict[str, Any]:
    """The report of a run that was interrupted before its first step."""
    name = scenario.name if scenario is not None else None
    law = scenario.controller.label() if scenario is not None else controller
    contact = dict.fromkeys(("first_s", "peak_N", "impulse_Ns", "final_N", "analytic_N", "relative_error"))
    return {
        "scenario": name,
        "controller": law,
        "status": "interrupted",
        "message": "interrupted before the first step",
        "warnings": [],
        "steps": 0,
        "timestep_s": scenario.simulation.timestep if scenario is not None else None,
        "duration_s": 0.0,
        "wall_time_s": 0.0,
        "real_time_factor": None,
        "contact": contact | {"touches": 0, "settled": False},
        "effort_N2s": None,
        "saturated_s": None,
        "final": dict.fromkeys(("position_m", "attitude_wxyz", "s", "z", "tau")),
        "analytic": dict.fromkeys(("position_m", "none_because")),
    }
