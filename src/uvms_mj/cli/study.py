"""``uvms-mj study``: many runs of one study file."""

import contextlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import EXIT_BAD_INPUT, asked_for, bad_input, command, end, json_option, output_options, path_option
from .console import print_table, printable
from .folders import folder_for
from .stop import Stop, exit_interrupted
from .study_report import report

if TYPE_CHECKING:
    import pandas as pd

    from ..studies.pool.estimate import Estimate
    from ..studies.study import Study

EXIT_CHECK_FAILS = 1


class _Commands(click.Group):
    """``study report DIR`` and ``study list``; every other first word is the study to run."""

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> click.Context:
        if args and args[0] in self.commands:
            return super().make_context(info_name, args, parent, **extra)
        return run_study.make_context(info_name, args, parent, **extra)


@command(
    epilog="Exit status: 0 every run has its row, also one that failed, 1 the engines differ, 2 bad input or no space, "
    "130 interrupted (143 by SIGTERM)."
)
@click.argument("arguments", nargs=-1, metavar="STUDY [KEY=VALUE]...")
@path_option("-o", "--out", metavar="DIR", help="Folder of the results [default: runs/<name of the study>].")
@click.option("--dry-run", is_flag=True, help="Print runs, steps, keys, time and size; run nothing.")
@click.option("-j", "--workers", type=click.IntRange(1, 4096), metavar="N", help="Processes [default: one per core].")
@click.option("--scheduler", metavar="ADDRESS", help="Use the workers of a Dask scheduler, e.g. tcp://10.0.0.1:8786.")
@click.option("--engine", type=click.Choice(["auto", "mujoco", "free_body"]), help="In place of run.engine.")
@click.option("-s", "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Set a key; may be repeated.")
@output_options
def run_study(
    arguments: tuple[str, ...],
    out: str | None,
    dry_run: bool,
    workers: int | None,
    scheduler: str | None,
    engine: str | None,
    settings: tuple[str, ...],
    as_json: bool,
    quiet: bool,
) -> None:
    """Run a study: many runs of one scenario, with laws to compare and keys that vary.

    STUDY is a TOML file, the name of one that ships (uvms-mj study list), or the folder of a study that was
    interrupted. A key to set is one of the study's tables design, keep and run, or of its base scenario.

    \b
    [base]                               the least study file
    scenario = "push_wall"
    [design]
    runs = 60
    seed = 7
    [[vary]]
    key = "wall.stiffness"
    distribution = "loguniform"
    low = 2e4
    high = 2e5

    \b
    uvms-mj study mine.toml --dry-run
    uvms-mj study mine.toml --out results
    uvms-mj study monte_carlo --out mc design.runs=100 simulation.duration=5
    uvms-mj study mine.toml --out results --scheduler tcp://10.0.0.1:8786
    uvms-mj study report results         one page: rates, distributions, maps, sensitivity, worst runs
    uvms-mj study list                   the studies that ship

    DIR/rows has one row a run as Parquet. After any interruption the same command goes on where it was, and the rows
    are the same, bit for bit, for any number of workers.
    """
    stop = Stop()
    shown: dict[str, int] = {}
    try:
        with bad_input():
            study, folder = _chosen(arguments, settings, engine, out)
            with _executor(scheduler, workers) as executor:
                expected = _head(study, executor, folder, dry_run, as_json, quiet)
                if dry_run:
                    if as_json:
                        click.echo(json.dumps(_plan_report(study, expected, executor.size), allow_nan=False))
                    return
                folder_for(str(folder))
                with _bar(as_json or quiet, stop, shown) as progress:
                    study.run(folder, executor=executor, progress=progress)
    except KeyboardInterrupt:
        end(f"interrupted{_kept(shown)}", exit_interrupted())
    except OSError as error:
        end(f"error: {error.filename or folder}: {error.strerror or error}{_kept(shown)}", EXIT_BAD_INPUT)
    for name in study.damaged:
        click.echo(f"note: {name} was damaged; its runs were run again", err=True)
    sys.exit(_report(study, as_json, quiet))


def _kept(shown: dict[str, int]) -> str:
    """How to go on after an interruption."""
    if not shown:
        return ""
    return f"; {shown['done']} of {shown['total']} runs are done and kept: the same command goes on"


def _chosen(
    arguments: tuple[str, ...], settings: tuple[str, ...], engine: str | None, out: str | None
) -> "tuple[Study, Path]":
    """The study and its folder. Raises InputError if the arguments are invalid."""
    from ..errors import InputError
    from ..studies.study import Study

    name, overrides = asked_for(arguments, settings, "study")
    if name is None:
        raise InputError("name a study: a TOML file, one of `uvms-mj study list`, or the folder of one that ran")
    if engine is not None:
        if overrides.get("run.engine", engine) != engine:
            raise InputError(f"run.engine: is given twice, {overrides['run.engine']!r} and --engine {engine}")
        overrides["run.engine"] = engine
    study = Study.load(name, overrides)
    return study, Path(out) if out is not None else study.folder or Path("runs", study.plan.name)


@contextlib.contextmanager
def _executor(scheduler: str | None, workers: int | None) -> "Iterator[Any]":
    """The workers of this machine or of a cluster."""
    from ..errors import InputError

    if scheduler is None:
        from ..studies.pool.workers import Workers

        pool: Any = Workers(workers)
    else:
        from ..studies.pool.cluster import Cluster

        if workers is not None:
            raise InputError("--workers is for this machine; with --scheduler the cluster decides")
        pool = Cluster(scheduler)
    try:
        yield pool
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _head(study: "Study", executor: Any, folder: Path, dry_run: bool, as_json: bool, quiet: bool) -> "Estimate | None":
    """Print runs, steps, keys, time and size before the study starts. Returns the estimate."""
    if not dry_run and (as_json or quiet):
        return None
    from ..studies.pool.estimate import estimate

    plan, size = study.plan, max(1, executor.size)
    expected = estimate(plan, size)
    if as_json:
        return expected
    lines = [
        plan.text(),
        f"time: about {_duration(expected.seconds)} on {size} worker{'s' if size > 1 else ''}",
        f"disk: {expected.rows_bytes / 1e6:.2g} MB of rows in {folder}{_logs_size(plan.logs, expected.log_bytes)}",
    ]
    click.echo(printable("\n".join(lines)), err=not dry_run)
    return expected


def _logs_size(logs: Any, each: int) -> str:
    if logs.kind == "none":
        return ""
    number = {"failed": "", "worst": f"{logs.k or 5} x ", "listed": f"{len(set(logs.indices))} x "}[logs.kind]
    return f", and logs of {number}{each / 1e6:.2g} MB" + (" for each run that fails" if logs.kind == "failed" else "")


def _duration(seconds: float) -> str:
    if seconds < 100.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


@contextlib.contextmanager
def _bar(hidden: bool, stop: Stop, shown: dict[str, int]) -> Iterator[Callable[[str, int, int, int], None]]:
    """A progress bar on terminals. Yields the study's progress function, which also checks for signals and keeps the
    numbers of runs in ``shown``."""
    column = "{task.completed:.0f} of {task.total} runs, {task.fields[failed]} failed"
    with progress_bar("starting", hidden, stop, column, failed=0) as update:

        def progress(what: str, done: int, failed: int, total: int) -> None:
            if what == "running":
                shown.update(done=done, total=total)
            update(done, total, description=what, failed=failed)

        yield progress


def _plan_report(study: "Study", expected: Any, workers: int) -> dict[str, Any]:
    """The object that ``--dry-run --json`` prints."""
    plan = study.plan
    return {
        "study": plan.name,
        "runs": plan.runs,
        "steps": plan.steps,
        "laws": [law.label for law in plan.laws],
        "varied": list(plan.varied),
        "workers": workers,
        "seconds": expected.seconds,
        "rows_bytes": expected.rows_bytes,
        "log_bytes": expected.log_bytes,
        "notes": list(plan.notes),
    }


def _report(study: "Study", as_json: bool, quiet: bool) -> int:
    """Print what came out; return the exit status."""
    from ..studies.check import largest

    rows, found = study.frame, study.check
    failed = [] if found is None else found[~found["within"]].to_dict("records")
    assert study.folder is not None
    if as_json:
        differences = [] if found is None else largest(found).drop(columns="index").to_dict("records")
        report = {
            "study": study.plan.name,
            "runs": len(rows),
            "status": rows["status"].value_counts().to_dict(),
            "engine": rows["engine"].value_counts().to_dict(),
            "check": {"within": not failed, "largest": differences},
            "folder": str(study.folder),
        }
        click.echo(json.dumps(_finite(report), allow_nan=False))
    elif not quiet:
        _table(study, rows)
        if found is not None:
            _print_check(found, largest(found))
        click.echo(f"{study.folder}{os.sep}rows")
    for each in failed:
        click.echo(
            f"error: row {each['index']}, {each['law']}: {each['number']} differs by {each['difference']:.2g} between "
            f"free_body and mujoco; run.tolerance is {each['tolerance']:g}",
            err=True,
        )
    return EXIT_CHECK_FAILS if failed else 0


def _finite(value: Any) -> Any:
    """The same value with None for numbers that JSON lacks."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return None if (isinstance(value, float) and abs(value) in (float("inf"),)) or value != value else value


def _table(study: "Study", rows: "pd.DataFrame") -> None:
    """Runs by law and status."""
    from rich.table import Table

    statuses = [each for each in rows["status"].unique() if each != "completed"]
    table = Table(title=study.plan.name, title_justify="left", min_width=60)
    for name in ("law", "runs", "completed", *statuses):
        table.add_column(name, justify="left" if name == "law" else "right", no_wrap=True)
    for law in study.plan.laws:
        own = rows.loc[rows["law"] == law.label, "status"]
        table.add_row(law.label, str(len(own)), *(str((own == each).sum()) for each in ("completed", *statuses)))
    print_table(table)


def _print_check(found: "pd.DataFrame", largest: "pd.DataFrame") -> None:
    click.echo(f"free_body against mujoco, {found['index'].nunique()} runs, largest differences:")
    for each in largest.to_dict("records"):
        click.echo(f"  {each['number']}: {each['difference']:.1e} (row {each['index']}, {each['law']})")


@click.group(cls=_Commands, short_help="Run a study: many runs with laws to compare and keys that vary.")
def study() -> None:
    """Run a study, or look at one."""


@study.command("list")
@json_option
def list_studies(as_json: bool) -> None:
    """List the studies that ship."""
    with bad_input():
        from ..files import shipped
        from ..studies.plan import Plan

        plans = {name: Plan.load(name) for name in shipped("studies")}
    if as_json:
        click.echo(json.dumps({name: plan.description for name, plan in plans.items()}))
        return
    for name, plan in plans.items():
        click.echo(f"{name}: {plan.runs} runs of {', '.join(law.label for law in plan.laws)}. {plan.description}")


study.add_command(report)
