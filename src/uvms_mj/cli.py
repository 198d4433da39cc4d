"""The command line. What is heavy is imported where it is used, so that ``--help`` is quick."""

import dataclasses
import json
import os
import re
import signal
import sys
from pathlib import Path
from typing import Any, NoReturn

import click

from .console import Console, print_table

EXIT_BAD_INPUT, EXIT_UNSTABLE, EXIT_INTERRUPTED = 2, 3, 130
_CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


@click.group(context_settings=_CONTEXT)
@click.version_option(package_name="uvms-mj")
def main() -> None:
    """A MuJoCo physics testbed for underwater vehicles that must touch things.

    \b
    uvms-mj run --controller gsta         the paper's scenario: push on a wall in an unknown current
    uvms-mj controllers                   the laws, their gains, units and defaults
    uvms-mj keys                          all keys of a scenario
    """


@main.command(epilog="Exit status: 0 completed, 2 bad input, 3 unstable, 130 interrupted.")
@click.argument("arguments", nargs=-1, metavar="[SCENARIO] [KEY=VALUE]...")
@click.option("-c", "--controller", metavar="LAW", help="gsta, fosm, impedance, or path/to/my_law.py:MyLaw.")
@click.option(
    "-s",
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Replace a key of the scenario; may be repeated.",
)
@click.option("-o", "--out", metavar="DIR", help="Where files go [default: runs/<time>-<scenario>-<controller>].")
@click.option("--log-rate", metavar="HZ|full", help="Samples a second; must divide the step rate [default: 1 kHz].")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on standard output and nothing else.")
@click.option("-q", "--quiet", is_flag=True, help="No progress bar and no table.")
def run(
    arguments: tuple[str, ...],
    controller: str | None,
    settings: tuple[str, ...],
    out: str | None,
    log_rate: str | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Run a scenario: a TOML file, or the name of one that ships (default: push_wall, the paper's).

    \b
    uvms-mj run --controller gsta
    uvms-mj run --controller fosm --set controller.epsilon=2e-3 --set wall.stiffness=2e4
    uvms-mj run my_scenario.toml --controller my_law.py:MyLaw --log-rate full --out results
    """
    stop = _Stop()
    os.environ.setdefault("MUJOCO_GL", "disable")  # nothing is drawn here, and looking for a display takes time
    console = Console(as_json, quiet)
    scenario = None
    try:
        with _bad_input():
            from .faults import InputError
            from .scenario import Scenario, parse_setting

            names = [a for a in arguments if "=" not in a]
            if len(names) > 1:
                raise InputError(f"one scenario at a time, please: {', '.join(names)}")
            overrides = dict(parse_setting(s) for s in (*settings, *(a for a in arguments if "=" in a)))
            scenario = Scenario.load(names[0] if names else "push_wall", overrides, controller)
            folder = _output_folder(out, scenario)
            status = _simulate(scenario, folder, log_rate, console, stop)
    except KeyboardInterrupt:
        if as_json:
            click.echo(json.dumps(_nothing_ran(scenario, controller)))
        _end("interrupted before the first step", EXIT_INTERRUPTED)
    sys.exit(status)


def _simulate(scenario: Any, folder: Path, log_rate: str | None, console: Console, stop: "_Stop") -> int:
    """Run, write, report; the exit status."""
    import warnings

    from .metrics import summary
    from .simulation import LawError, simulate
    from .trace import Status

    error = None
    with warnings.catch_warnings(), console.progress(scenario) as bar:
        warnings.showwarning = console.warn

        def progress(done: int, total: int) -> None:
            stop.check()
            bar(done, total)

        try:
            trace = simulate(scenario, log_rate=log_rate, progress=progress)
        except LawError as raised:
            trace, error = raised.trace, str(raised)
        except BaseException:
            _remove_if_empty(folder)
            raise
    stop.ignore()
    try:
        files = _write(trace, folder)
    except OSError as failure:
        files, error = {}, f"--out {folder}: can't write the trace: {failure.strerror}"
    report = summary(trace, files)
    console.report(trace, report)
    if error is not None:
        click.echo(f"error: {error}", err=True)
        return EXIT_BAD_INPUT
    if trace.status is not Status.completed:
        click.echo(f"{trace.status.name}: {trace.message}", err=True)
    return {Status.completed: 0, Status.unstable: EXIT_UNSTABLE, Status.interrupted: EXIT_INTERRUPTED}[trace.status]


def _output_folder(out: str | None, scenario: Any) -> Path:
    """The folder of a run, made and writable, before anything is computed."""
    import datetime
    import tempfile

    from .faults import InputError

    if out == "":
        raise InputError("--out '': must name a folder")
    if out is not None:
        folder = Path(out)
    else:
        now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
        words = re.sub(r"[^\w.-]+", "_", f"{scenario.name}-{scenario.controller.label()}")[:100]
        stem = Path("runs") / f"{now}-{words}"
        folder, n = stem, 2
        while folder.exists():
            folder, n = stem.with_name(f"{stem.name}-{n}"), n + 1
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(f"--out {folder}: can't write there: {error.strerror}") from None
    return folder


def _remove_if_empty(folder: Path) -> None:
    import contextlib

    with contextlib.suppress(OSError):
        folder.rmdir()
        folder.parent.rmdir()


def _write(trace: Any, folder: Path) -> dict[str, str]:
    """Write trace and scenario; what an earlier run left there is moved aside, never overwritten."""
    files = {"npz": folder / "trace.npz", "scenario": folder / "scenario.toml"}
    earlier = [path for path in files.values() if path.exists()]
    if earlier:
        n = 1
        while (aside := folder / f"earlier-{n}").exists():
            n += 1
        aside.mkdir()
        for path in earlier:
            path.rename(aside / path.name)
        click.echo(f"note: the earlier run in {folder} was moved to {aside}", err=True)
    trace.save(files["npz"])
    files["scenario"].write_text(trace.scenario.to_toml(), encoding="utf-8")
    return {kind: str(path) for kind, path in files.items()}


@main.command()
@click.argument("laws", nargs=-1, metavar="[LAW]...")
def controllers(laws: tuple[str, ...]) -> None:
    """List the laws with their gains, units and defaults; LAW may be path/to/my_law.py:MyLaw."""
    with _bad_input():
        from rich.table import Table

        from .control.loader import BUILT_IN, controller_class

        for law in laws or BUILT_IN:
            cls = controller_class(law)
            summary_line = (cls.__doc__ or "").strip().splitlines()
            table = Table(
                title=f"{cls.label()}: {summary_line[0] if summary_line else ''}", title_justify="left", min_width=80
            )
            for column in ("gain", "default", "unit", "meaning"):
                table.add_column(column)
            for field in cls.gain_fields():
                default = "required" if field.default is dataclasses.MISSING else _toml_value(field.default)
                table.add_row(field.name, default, field.metadata.get("unit", ""), field.metadata.get("meaning", ""))
            if cls.states:
                states = ", ".join(f"{name} ({size})" for name, size in cls.states.items())
                table.add_row("", "", "", f"states: {states}", style="dim")
            print_table(table)


@main.command()
def keys() -> None:
    """List all keys of a scenario with defaults and units."""
    from rich.table import Table

    from .scenario import keys as scenario_keys

    table = Table(title="Keys of a scenario; `uvms-mj controllers` lists controller.<gain>", title_justify="left")
    for column in ("key", "default", "meaning"):
        table.add_column(column)
    for key, default, meaning in scenario_keys():
        table.add_row(key, _toml_value(default), meaning)
    print_table(table)


def _toml_value(value: Any) -> str:
    if value is None:
        return "-"
    return json.dumps(list(value) if isinstance(value, tuple) else value)


def _nothing_ran(scenario: Any, controller: str | None) -> dict[str, Any]:
    """The report of a run that was interrupted before its first step."""
    name = scenario.name if scenario is not None else None
    law = scenario.controller.label() if scenario is not None else controller
    contact = dict.fromkeys(("first_s", "peak_N", "final_N", "analytic_N", "relative_error"))
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
        "final": dict.fromkeys(("position_m", "attitude_wxyz", "s", "z", "tau")),
        "analytic": dict.fromkeys(("position_m", "none_because")),
        "files": {},
    }


class _Stop:
    """Ctrl-C and SIGTERM: the first is raised where the program is, and at the next chunk should it get lost.

    Python code that C calls back can't pass an exception on, as when LLVM reports a finished object.
    """

    def __init__(self) -> None:
        self.requested = False
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, self._on_signal)

    def _on_signal(self, number: int, frame: Any) -> None:
        if not self.requested:
            self.requested = True
            raise KeyboardInterrupt

    def check(self) -> None:
        if self.requested:
            raise KeyboardInterrupt

    def ignore(self) -> None:
        """What was computed is being written; that takes less than the patience of whoever sent a signal."""
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, signal.SIG_IGN)


def _bad_input() -> Any:
    """A context manager that turns bad input into one message and exit status 2."""
    import contextlib

    @contextlib.contextmanager
    def catch() -> Any:
        try:
            yield
        except ValueError as error:
            from .faults import InputError

            if not isinstance(error, InputError):
                raise
            _end(f"error: {error}", EXIT_BAD_INPUT)

    return catch()


def _end(message: str, status: int) -> NoReturn:
    click.echo(message, err=True)
    sys.exit(status)
