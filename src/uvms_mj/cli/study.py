"""``uvms-mj study``: many runs of one study file, what they will take, what came out, and a page about them."""

import contextlib
import json
import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .archive import compared, unpacked
from .common import (
    EXIT_ENGINES_DIFFER,
    Listing,
    Resumed,
    bad_input,
    draw_to_files,
    printable,
    refuse_existing,
)
from .options import (
    OneOrNone,
    asked_for,
    command,
    force_option,
    json_option,
    names_in,
    output_options,
    path_argument,
    path_option,
    set_by_option,
    workers_option,
)
from .plot import figure_files, figure_options, label_option, labels_in

if TYPE_CHECKING:
    from ..studies.pool.execution import Estimate
    from ..studies.study import Study


@command(
    epilog="Exit status: 0 every run has its row, also one that failed, 1 with --from: a row differs, 4 the engines "
    "differ in a run of the sample by more than run.tolerance, 2 bad input or no space, 130 interrupted (143 SIGTERM, "
    "129 SIGHUP)."
)
@click.argument("arguments", nargs=-1, metavar="STUDY [KEY=VALUE]...")
@path_option("-o", "--out", metavar="DIR", help="Folder of the results [default: runs/<name of the study>].")
@path_option("--from", "archive", metavar="FILE.zip", help="Repeat the study of an archive, and compare each row.")
@click.option("--dry-run", is_flag=True, help="Print runs, steps, keys, time and size; run nothing.")
@workers_option
@click.option("--scheduler", metavar="ADDRESS", help="Use the workers of a Dask scheduler, e.g. tcp://10.0.0.1:8786.")
@click.option("--engine", type=click.Choice(["auto", "mujoco", "free_body", "gpu"]), help="In place of run.engine.")
@click.option("-s", "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Set a key; may be repeated.")
@output_options
def run_study(
    dry_run: bool,
    workers: int | None,
    scheduler: str | None,
    archive: str | None,
    as_json: bool,
    quiet: bool,
    **asked: Any,
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
    uvms-mj study --from study.zip --out repeated
    uvms-mj study report results         one page: rates, distributions, maps, sensitivity, worst runs
    uvms-mj study plot results           one figure of it, for a paper
    uvms-mj study table results          a table by law, or of every two, as LaTeX or CSV
    uvms-mj study list                   the studies that ship

    DIR/rows has one row a run as Parquet. After any interruption the same command goes on where it was, and the rows
    are the same, bit for bit, for any number of workers.
    """
    resumed = Resumed("runs")
    with bad_input():
        if archive is not None:
            asked = _unpacked(archive, asked)
        study, folder = _chosen(**asked)
    with resumed.filling(folder), pool_of(scheduler, workers) as executor:
        expected = head(study, executor, folder, dry_run, as_json, quiet)
        if dry_run:
            if as_json:
                click.echo(json.dumps(plan_report(study, expected, executor.size), allow_nan=False))
            return
        text = "{done:.0f} of {total} runs, {failed} failed"
        with resumed.bar("starting", as_json or quiet, text, failed=0) as update:

            def progress(what: str, done: int, failed: int, total: int) -> None:
                update(done, total, what=what, failed=failed)

            study.run(folder, executor=executor, progress=progress)
    for name in study.damaged:
        click.echo(f"note: {name} was damaged; its runs were run again", err=True)
    status = print_result(study, as_json, quiet)
    if archive is not None:
        status = compared("study", folder, quiet) or status
    sys.exit(status)


def _unpacked(archive: str, asked: dict[str, Any]) -> dict[str, Any]:
    """The arguments of a study that repeats an archive, which is unpacked in its folder."""
    from ..errors import InputError
    from ..studies.results import STUDY

    if asked["arguments"] or asked["settings"] or asked["engine"]:
        raise InputError(f"--from {archive}: repeats the study as it was; leave out the study, its keys and --engine")
    folder, place, _ = unpacked(archive, "study", asked["out"])
    return {**asked, "arguments": (str(place / STUDY),), "out": str(folder)}


def _chosen(
    arguments: tuple[str, ...], settings: tuple[str, ...], engine: str | None, out: str | None
) -> "tuple[Study, Path]":
    """The study and its folder. Raises InputError if the arguments are invalid."""
    from ..errors import InputError
    from ..studies.study import Study

    name, overrides = asked_for(arguments, settings, "study")
    if name is None:
        raise InputError("name a study: a TOML file, one of `uvms-mj study list`, or the folder of one that ran")
    set_by_option(overrides, "run.engine", engine, "--engine")
    study = Study.load(name, overrides)
    return study, Path(out) if out is not None else study.folder or Path("runs", study.plan.name)


def pool_of(scheduler: str | None, workers: int | None) -> "contextlib.AbstractContextManager[Any]":
    """The workers of this machine or of a cluster."""
    from ..errors import InputError
    from ..studies.pool.executors import executor_of

    if scheduler is not None and workers is not None:
        raise InputError("--workers is for this machine; with --scheduler the cluster decides")
    if scheduler is not None:
        logging.disable()  # of Dask: this command has its own messages
    return executor_of(None, workers, scheduler)


@click.group(cls=OneOrNone, short_help="Run a study: many runs with laws to compare and keys that vary.")
def study() -> None:
    """Run a study, or look at one."""


study.otherwise = run_study


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


@command("report")
@path_argument("folder", metavar="DIR")
@path_option("-o", "--out", metavar="FILE.html", help="File for the page [default: DIR/report.html, replaced].")
@force_option
def study_report(folder: str, out: str | None, force: bool) -> None:
    """Write one HTML page about the results of a study, also while it runs: success rates, distributions, maps over
    the varied keys, sensitivity, differences between every two laws, and the runs to look at.

    \b
    uvms-mj study report runs/monte_carlo
    uvms-mj study report results --out monday.html
    """
    draw_to_files()
    with bad_input():
        from ..errors import InputError

        if out is not None:
            if Path(out).suffix.lower() not in (".html", ".htm"):
                raise InputError(f"--out {out!r}: the name must end in .html")
            refuse_existing("--out", Path(out), force)
        from ..studies.study import Study

        if not Path(folder).is_dir():
            raise InputError(f"{folder}: is not a folder with the results of a study")
        click.echo(Study.load(folder).report(out))


@study.command("plot")
@path_argument("folder", metavar="DIR")
@click.option(
    "--what", default="overview", show_default=True, metavar="NAME", help="overview, distributions, map, sensitivity."
)
@click.option(
    "--over", metavar="KEY[,KEY]", help="Of a map: one or two varied keys [default: the keys that matter most]."
)
@click.option(
    "--metrics",
    multiple=True,
    metavar="NAME[,NAME]",
    help="Of distributions and maps: kept metrics; may be repeated [default: all that vary, or the most telling].",
)
@figure_options
def study_plot(
    folder: str,
    what: str,
    over: str | None,
    metrics: tuple[str, ...],
    kinds: tuple[str, ...],
    width: str | None,
    height: str | None,
    labels: tuple[str, ...],
    fonts: str,
    out: str | None,
    force: bool,
) -> None:
    """Draw one figure of a study's report. Without --out the file is NAME.png in DIR.

    \b
    uvms-mj study plot results --what distributions --metrics contact.peak_N,contact.final_N
    uvms-mj study plot results --what map --over current.speed,wall.stiffness --format pdf --width page
    uvms-mj study plot results --what distributions --label my_law=ours --label contact.peak_N="largest push"
    """
    draw_to_files()
    with bad_input():
        from ..errors import InputError
        from ..studies.study import Study
        from ..views import figures

        if not Path(folder).is_dir():
            raise InputError(f"{folder}: is not a folder with the results of a study")
        stem, formats = figure_files(kinds, out, Path(folder, what), force)
        drawn: Any = Study.load(folder).plot(
            what,
            over=names_in("--over", [over] if over else []),
            metrics=names_in("--metrics", metrics),
            width=width,
            height=height,
            fonts=fonts,
            labels=labels_in(labels),
        )
        for written in figures.save(drawn, stem, formats):
            click.echo(str(written))


@study.command("table")
@path_argument("folder", metavar="DIR")
@click.option(
    "--metrics",
    multiple=True,
    metavar="NAME[,NAME]",
    help="Kept metrics, as in uvms-mj metrics; may be repeated [default: the first three that vary].",
)
@click.option("--pairs", is_flag=True, help="Compare every two laws, with intervals of the differences.")
@label_option
@path_option("-o", "--out", metavar="FILE", help="Write .tex or .csv [default: print].")
@force_option
def study_table(
    folder: str, metrics: tuple[str, ...], pairs: bool, labels: tuple[str, ...], out: str | None, force: bool
) -> None:
    """Print or write a table of a study for a paper: of each law its rate of success with the 95 % interval, and of
    each metric the median with the quantiles of 5 and 95 %, in the digits that they support. With --pairs it has the
    differences of every two laws in the same draws with their 95 % intervals; * marks a difference that is resolved
    also if all intervals of the table shall hold at once. The LaTeX is for the package booktabs; a table that is wider
    than a column says so. A .csv has all digits.

    \b
    uvms-mj study table results
    uvms-mj study table results --metrics contact.peak_N,contact.final_N --out table.tex
    uvms-mj study table results --out table.csv
    uvms-mj study table results --pairs --metrics contact.peak_N --out pairs.tex
    """
    with bad_input():
        from ..errors import InputError
        from ..studies.report.latex import COLUMN_PT
        from ..studies.report.tables import note, printed
        from ..studies.study import Study

        if not Path(folder).is_dir():
            raise InputError(f"{folder}: is not a folder with the results of a study")
        study = Study.load(folder)
        names, words = names_in("--metrics", metrics), labels_in(labels)
        if out is not None:
            refuse_existing("--out", Path(out), force)
            study.save_table(out, names, pairs=pairs, labels=words)
        found = study.statistics(names, pairs=pairs, labels=words)
        table = printed(found)
    if out is not None:
        click.echo(out)
        if Path(out).suffix.lower() == ".tex" and table.width > COLUMN_PT:
            click.echo(f"note: {out}: {table.fits}", err=True)
        return
    laws = [*map(printable, table.names)]
    rows = [
        (printable(f"{each.head} {each.below}".strip()), *(cell.text for cell in each.cells)) for each in table.columns
    ]
    Listing(study.title, ("", *laws), rows, right=laws, width=60).show()
    click.echo(printable(note(found)))


def head(study: "Study", executor: Any, folder: Path, dry_run: bool, as_json: bool, quiet: bool) -> "Estimate | None":
    """Print runs, steps, keys, time and size before the study starts. Returns the estimate. Raises InputError if the
    folder has another study."""
    if not dry_run and (as_json or quiet):
        return None
    from ..studies.bundle import StudyBundle
    from ..studies.pool.execution import estimate
    from ..studies.results import STUDY, about_of, refuse_another, share_done

    bundle = StudyBundle.of(study.plan)
    refuse_another(folder / STUDY, study.plan.tables, about_of(study.plan, bundle))
    bundle.plan()  # as a worker will
    plan, size, done = study.plan, max(1, executor.size), share_done(folder, study.plan)
    expected = estimate(plan, size)
    if as_json:
        return expected
    rest = f" for the last {1.0 - done:.0%}, the others are done" if done else ""
    workers = f"{size} worker{'s' if size > 1 else ''}"
    time = (
        f"about {duration(expected.seconds * (1.0 - done))} on {workers}{rest}" if done < 1.0 else "every run is done"
    )
    lines = [
        plan.text(),
        f"time: {time}",
        f"disk: {expected.rows_bytes / 1e6:.2g} MB of rows in {folder}{_logs_size(plan.logs, expected.log_bytes)}",
    ]
    click.echo(printable("\n".join(lines)), err=not dry_run)
    return expected


def _logs_size(logs: Any, each: int) -> str:
    if logs.kind == "none":
        return ""
    number = {"failed": "", "worst": f"{logs.k} x ", "listed": f"{len(set(logs.indices))} x "}[logs.kind]
    return f", and logs of {number}{each / 1e6:.2g} MB" + (" for each run that fails" if logs.kind == "failed" else "")


def duration(seconds: float) -> str:
    if seconds < 100.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def plan_report(study: "Study", expected: Any, workers: int) -> dict[str, Any]:
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


def print_result(study: "Study", as_json: bool, quiet: bool) -> int:
    """Print what came out; return the exit status."""
    from ..studies.rows import largest, pair_of

    rows, found = study.frame, study.check
    failed = [] if found is None else found[~found["within"]].to_dict("records")
    assert study.folder is not None
    if as_json:
        differences = [] if found is None else largest(found).drop(columns="index").to_dict("records")
        numbers = {
            "study": study.plan.name,
            "runs": len(rows),
            "status": rows["status"].value_counts().to_dict(),
            "engine": rows["engine"].value_counts().to_dict(),
            "check": {"within": not failed, "largest": differences},
            "folder": str(study.folder),
        }
        click.echo(json.dumps(finite(numbers), allow_nan=False))
    elif not quiet:
        _print_laws(study)
        if found is not None:
            click.echo(
                f"{' against '.join(pair_of(study.plan))}, {found['index'].nunique()} runs, largest differences:"
            )
            for each in largest(found).to_dict("records"):
                click.echo(f"  {each['number']}: {each['difference']:.1e} (row {each['index']}, {each['law']})")
        click.echo(f"{study.folder}{os.sep}rows")
    for (law, status), group in rows[~rows["status"].isin(("completed", "unstable"))].groupby(["law", "status"]):
        why = printable(str(group["message"].iloc[0]))
        click.echo(f"note: {law}: {len(group)} {status}; row {group['index'].iloc[0]}: {why}", err=True)
    for each in failed:
        differ = engines_differ(each, pair_of(study.plan))
        click.echo(f"note: row {each['index']}, {each['law']}: {differ}", err=True)
    return EXIT_ENGINES_DIFFER if failed else 0


def engines_differ(found: dict[str, Any], engines: Sequence[str] = ("free_body", "mujoco")) -> str:
    """A difference between two engines above the tolerance, in words."""
    return (
        f"{found['number']} differs by {found['difference']:.4g} between {' and '.join(engines)}, which exceeds "
        f"run.tolerance, {found['tolerance']:g}"
    )


def finite(value: Any) -> Any:
    """The same value with None for numbers that JSON lacks."""
    if isinstance(value, dict):
        return {key: finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [finite(each) for each in value]
    return None if value != value or value in (float("inf"), -float("inf")) else value


def _print_laws(study: "Study") -> None:
    """Runs by law and status, and their successes."""
    from ..studies.plan.metrics import in_words

    heads, *rows = study.table()
    Listing(study.plan.name, heads, rows, right=heads[1:], fixed=heads, width=60).show()
    click.echo(f"{in_words(study.plan.success, 'contact.settled' in study.frame)}")


for each in (study_report, study_plot, study_table):
    study.add_command(each)
