"""``uvms-mj tune``: gains for an objective and constraints over a study's runs."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import EXIT_ENGINES_DIFFER, Listing, Resumed, bad_input, draw_to_files, printable
from .options import asked_for, command, output_options, path_option, set_by_option, workers_option
from .study import duration, engines_differ, finite, pool_of

if TYPE_CHECKING:
    from ..studies.tune import Tuning

EXIT_NOT_FOUND = 1


@command(
    epilog="Exit status: 0 gains were found, 4 likewise, but with them the engines differ by more than run.tolerance, "
    "1 no trial is feasible, 2 bad input or no space, 130 interrupted (143 SIGTERM, 129 SIGHUP)."
)
@click.argument("arguments", nargs=-1, metavar="TUNE [KEY=VALUE]...")
@path_option("-o", "--out", metavar="DIR", help="Folder of the results [default: runs/<name of the tuning>].")
@click.option("--dry-run", is_flag=True, help="Print gains, objective, runs and time; run nothing.")
@click.option("-n", "--trials", type=click.IntRange(1), metavar="N", help="In place of tune.trials.")
@workers_option
@click.option("--scheduler", metavar="ADDRESS", help="Use the workers of a Dask scheduler, e.g. tcp://10.0.0.1:8786.")
@click.option("-s", "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Set a key; may be repeated.")
@output_options
def tune(dry_run: bool, workers: int | None, scheduler: str | None, as_json: bool, quiet: bool, **asked: Any) -> None:
    """Find gains by Optuna, for an objective and constraints over the runs of a study.

    TUNE is a TOML file, or the folder of a tuning that was interrupted. It is a study file of one law, with tables for
    the gains, the objective and the constraints. Trial 0 has the file's own gains.

    \b
    [base]                               a tuning file
    scenario = "push_wall"
    [[vary]]
    key = "current.speed"
    values = [0.0, 0.25, 0.5]
    [[gain]]
    key = "controller.k_1"
    low = 1.0
    high = 20.0
    [objective]
    metric = "contact.peak_N"
    over = "max"
    [[constraint]]
    metric = "contact.settled"
    at_least = 1.0

    \b
    uvms-mj tune mine.toml --dry-run
    uvms-mj tune mine.toml --out found --trials 200
    uvms-mj run found/found.toml

    DIR gets found.toml, trials.parquet and report.html. A trial in which a run does not complete is infeasible. After
    any interruption the same command goes on where it was. The result is the same for any number of workers.
    """
    resumed = Resumed("trials")
    draw_to_files()
    with bad_input():
        tuning, folder = _chosen(**asked)
    with resumed.filling(folder):
        tuning.refuse_another(folder)
        with pool_of(scheduler, workers) as executor:
            if dry_run or not (as_json or quiet):
                _head(tuning, executor.size, folder, dry_run, as_json)
            if dry_run:
                return
            text = "{done:.0f} of {total} trials, best {best}"
            with resumed.bar("tuning", as_json or quiet, text, best="-") as update:

                def progress(done: int, total: int, best: float | None) -> None:
                    update(done, total, best="-" if best is None else f"{best:.4g}")

                tuning.run(folder, executor=executor, progress=progress)
        status = _result(tuning, folder, as_json, quiet)
    sys.exit(status)


def _chosen(
    arguments: tuple[str, ...], settings: tuple[str, ...], trials: int | None, out: str | None
) -> "tuple[Tuning, Path]":
    """The tuning and its folder. Raises InputError if the arguments are invalid, or optuna is missing."""
    from ..errors import InputError
    from ..studies.tune import Tuning
    from ..studies.tune.search import optuna

    optuna()
    name, overrides = asked_for(arguments, settings, "tuning")
    if name is None:
        raise InputError("name a tuning: a TOML file, or the folder of one that was interrupted")
    set_by_option(overrides, "tune.trials", trials, "--trials")
    tuning = Tuning.load(name, overrides)
    given = Path(name) if Path(name).is_dir() else Path("runs", tuning.name)
    return tuning, given if out is None else Path(out)


def _head(tuning: "Tuning", workers: int, folder: Path, dry_run: bool, as_json: bool) -> None:
    """Print what will be searched and how long it takes."""
    from ..studies.pool.execution import estimate

    plan, trials = tuning.plan, tuning.search.trials
    seconds = trials * estimate(plan, max(1, workers)).seconds
    if as_json:
        report = {
            "tuning": tuning.name,
            "trials": trials,
            "runs": trials * plan.runs,
            "steps": trials * plan.steps,
            "law": plan.laws[0].label,
            "gains": [gain.key for gain in tuning.gains],
            "objective": tuning.objective.label,
            "constraints": [each.label for each in tuning.constraints],
            "workers": workers,
            "seconds": seconds,
        }
        click.echo(json.dumps(report, allow_nan=False))
        return
    lines = [plan.text(), *tuning.text(), f"time: about {duration(seconds)} on {workers} workers; folder: {folder}"]
    click.echo(printable("\n".join(lines)), err=not dry_run)


def _result(tuning: "Tuning", folder: Path, as_json: bool, quiet: bool) -> int:
    """Write the page, print what was found, and return the exit status."""
    from ..studies.rows import largest

    trials, best = tuning.trials(folder), tuning.best(folder)
    checked = None if best is None else tuning.study_of(folder, best).check
    page = tuning.report(folder)
    failed = [] if checked is None else checked[~checked["within"]].to_dict("records")
    if as_json:
        differences = [] if checked is None else largest(checked).drop(columns="index").to_dict("records")
        report = {
            "tuning": tuning.name,
            "trials": len(trials),
            "feasible": sum(each.outcome.state == "feasible" for each in trials),
            "baseline": _numbers(tuning, trials[0]),
            "best": None if best is None else _numbers(tuning, best),
            "check": {"within": not failed, "largest": differences},
            "folder": str(folder),
        }
        click.echo(json.dumps(finite(report), allow_nan=False))
    elif not quiet:
        _found_gains(tuning, trials[0], best).show()
        click.echo(page)
    if best is None:
        worst = trials[-1].outcome.message
        click.echo(f"no feasible trial among {len(trials)}; the last one: {printable(worst)}", err=True)
    elif not (as_json or quiet):
        click.echo(f"uvms-mj run {folder / 'found.toml'}")
    for each in failed:
        click.echo(f"note: row {each['index']} with the found gains: {engines_differ(each)}", err=True)
    return EXIT_NOT_FOUND if best is None else EXIT_ENGINES_DIFFER if failed else 0


def _numbers(tuning: "Tuning", trial: Any) -> dict[str, Any]:
    """A trial as one object."""
    labels = [each.label for each in tuning.constraints]
    return {
        "trial": trial.number,
        "state": trial.outcome.state,
        "gains": dict(trial.gains),
        "objective": trial.outcome.objective,
        "constraints": dict(zip(labels, trial.outcome.constraints, strict=True)),
    }


def _found_gains(tuning: "Tuning", baseline: Any, best: Any) -> Listing:
    """The baseline beside the best trial."""
    shown = [("the file's own", baseline), *([] if best is None else [(f"found, trial {best.number}", best)])]
    heads, trials = [head for head, _ in shown], [trial for _, trial in shown]
    rows: list[tuple[str, ...]] = [
        (name, *("-" if value is None else f"{value:.6g}" for value in values))
        for name, *values in tuning.compared(trials)
    ]
    rows.append(("state", *(trial.outcome.state for trial in trials)))
    return Listing(tuning.name, ("", *heads), rows, right=heads, width=60)
