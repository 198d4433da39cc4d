"""``uvms-mj study``: many runs of one study file."""

import contextlib
import functools
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import bad_input, filling, progress_bar
from .folders import folder_for
from .options import asked_for, command, json_option, output_options, path_option, workers_option
from .stop import Stop
from .study_report import study_report
from .study_text import head, kept, plan_report, print_result

if TYPE_CHECKING:
    from ..studies.study import Study


class _Commands(click.Group):
    """``study report DIR`` and ``study list``; every other first word is the study to run."""

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> click.Context:
        if args and args[0] in self.commands:
            return super().make_context(info_name, args, parent, **extra)
        return run_study.make_context(info_name, args, parent, **extra)


@command(
    epilog="Exit status: 0 every run has its row, also one that failed, 4 likewise, but the engines differ in a run of "
    "the sample by more than run.tolerance, 2 bad input or no space, 130 interrupted (143 by SIGTERM)."
)
@click.argument("arguments", nargs=-1, metavar="STUDY [KEY=VALUE]...")
@path_option("-o", "--out", metavar="DIR", help="Folder of the results [default: runs/<name of the study>].")
@click.option("--dry-run", is_flag=True, help="Print runs, steps, keys, time and size; run nothing.")
@workers_option
@click.option("--scheduler", metavar="ADDRESS", help="Use the workers of a Dask scheduler, e.g. tcp://10.0.0.1:8786.")
@click.option("--engine", type=click.Choice(["auto", "mujoco", "free_body"]), help="In place of run.engine.")
@click.option("-s", "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Set a key; may be repeated.")
@output_options
def run_study(
    dry_run: bool, workers: int | None, scheduler: str | None, as_json: bool, quiet: bool, **asked: Any
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
    stop, shown = Stop(), dict[str, int]()
    with bad_input():
        study, folder = _chosen(**asked)
    with filling(folder, functools.partial(kept, shown, "runs")), pool_of(scheduler, workers) as executor:
        expected = head(study, executor, folder, dry_run, as_json, quiet)
        if dry_run:
            if as_json:
                click.echo(json.dumps(plan_report(study, expected, executor.size), allow_nan=False))
            return
        folder_for(str(folder))
        with _bar(as_json or quiet, stop, shown) as progress:
            study.run(folder, executor=executor, progress=progress)
    for name in study.damaged:
        click.echo(f"note: {name} was damaged; its runs were run again", err=True)
    sys.exit(print_result(study, as_json, quiet))


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


def pool_of(scheduler: str | None, workers: int | None) -> "contextlib.AbstractContextManager[Any]":
    """The workers of this machine or of a cluster."""
    from ..errors import InputError
    from ..studies.study import executor_of

    if scheduler is not None and workers is not None:
        raise InputError("--workers is for this machine; with --scheduler the cluster decides")
    return executor_of(None, workers, scheduler)


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


study.add_command(study_report)
