"""``uvms-mj bench``: laws on the ten tasks of Contact-10, and two results compared."""

import functools
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import bad_input, draw_to_files, filling, printable, progress_bar
from .console import Table
from .options import command, json_option, names_in, output_options, path_option, workers_option
from .stop import Stop
from .study import kept, pool_of

if TYPE_CHECKING:
    from collections.abc import Mapping


class _Commands(click.Group):
    """``bench compare`` and ``bench tasks``; every other first word is a law."""

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> click.Context:
        if args and args[0] in self.commands:
            return super().make_context(info_name, args, parent, **extra)
        return run_bench.make_context(info_name, args, parent, **extra)


@command(
    epilog="Exit status: 0 every law has its rows, also where it fails, 2 bad input or no space, 130 interrupted (143 "
    "by SIGTERM)."
)
@click.argument("laws", nargs=-1, metavar="[LAW [KEY=VALUE]...]...")
@path_option("-o", "--out", metavar="DIR", help="Folder of the results [default: runs/bench].")
@click.option("--tasks", "only", multiple=True, metavar="NAME[,NAME]", help="Some of the tasks; may be repeated.")
@click.option("--draws", type=click.IntRange(1), metavar="N", help="The first N draws of each task, for a look.")
@workers_option
@click.option("--scheduler", metavar="ADDRESS", help="Use the workers of a Dask scheduler, e.g. tcp://10.0.0.1:8786.")
@output_options
def run_bench(
    laws: tuple[str, ...],
    out: str | None,
    only: tuple[str, ...],
    draws: int | None,
    workers: int | None,
    scheduler: str | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Measure laws on Contact-10: ten tasks of contact under water, 20 draws each, the same for everybody.

    LAW is a shipped law, a file (my_law.py:MyLaw, my_law.c, libmy_law.so:my_law, my_law.fmu), or a TOML file with
    [[laws]], as study files have them; without one, all shipped laws. Settings after a law are its own, and the same
    for all tasks: controller.*, task.*, impedance.*, observer.*, actuation.*, and label=NAME.

    \b
    uvms-mj bench                                   all shipped laws, some minutes
    uvms-mj bench gsta my_law.py:MyLaw --out mine
    uvms-mj bench gsta controller.k_1=8 label=stiff --out stiff
    uvms-mj bench my_laws.toml --tasks slide,force_sensor --draws 5
    uvms-mj bench tasks                             the tasks and what passes them
    uvms-mj bench compare mine/bench.json:MyLaw shipped:gsta

    Gains for single tasks are in a file, and have a table of their own:

    \b
    [[laws]]
    name = "gsta"
    label = "gsta, tuned"
    [laws.tuned.force_sensor]
    controller.k_1 = 1.0

    DIR/report.html is the page, DIR/bench.json has everything and is the same, byte for byte, for any number of
    workers, and DIR/table.tex is for a paper. DIR/LAW/TASK is a study, for `uvms-mj study report` and `uvms-mj run
    --from`. After any interruption the same command goes on where it was, and where a law is added, it alone runs.
    """
    stop, shown = Stop(), dict[str, int]()
    draw_to_files()
    folder = Path(out or Path("runs", "bench"))
    with filling(folder, functools.partial(kept, shown, "runs")), pool_of(scheduler, workers) as executor:
        from ..reproduce.bench import LATEX, PAGE, RESULT, bench

        text = "{done:.0f} of {total} runs"
        with progress_bar("running", as_json or quiet, stop, text) as update:

            def progress(done: int, total: int) -> None:
                shown.update(done=done, total=total)
                update(done, total)

            names = names_in("--tasks", only)
            found = bench(laws, folder, only=names, draws=draws, progress=progress, executor=executor)
    files = {"result": str(folder / RESULT), "report": str(folder / PAGE), "latex": str(folder / LATEX)}
    if as_json:
        click.echo(json.dumps({"digest": found["digest"], "passed": _passed(found), **files}, allow_nan=False))
    elif not quiet:
        _table(found)
        click.echo(printable("\n".join((files["report"], files["result"]))))


def _passed(found: "Mapping[str, Any]") -> dict[str, dict[str, Any]]:
    """Draws passed by law and task; None where the law can't run."""
    return {
        law["label"]: {name: cell["passed"] if cell["runs"] else None for name, cell in law["tasks"].items()}
        for law in found["laws"]
    }


def _table(found: "Mapping[str, Any]") -> None:
    tasks = found["tasks"]
    heads = [str(task["number"]) for task in tasks.values()]
    rows = [
        (law["label"], *(f"{c['passed']}/{c['draws']}" if c["runs"] else "-" for c in law["tasks"].values()))
        for law in found["laws"]
    ]
    Table(f"{found['benchmark']}: draws passed", ("law", *heads), rows, right=heads, fixed=heads, width=40).show()
    click.echo("; ".join(f"{task['number']} {name}" for name, task in tasks.items()))
    for law in found["laws"]:
        whys = {cell["reason"]: name for name, cell in law["tasks"].items() if not cell["runs"]}
        for why in whys:
            where = ", ".join(name for name, cell in law["tasks"].items() if cell.get("reason") == why)
            click.echo(printable(f"- {law['label']} can't run {where}: {why}"))


@click.group(cls=_Commands, short_help="Measure laws on ten tasks of contact, the same for everybody.")
def bench() -> None:
    """Measure laws on Contact-10, or look at its tasks and results."""


@command("tasks")
@json_option
def bench_tasks(as_json: bool) -> None:
    """List the tasks: what each asks for, its version, and the criteria that a run must meet."""
    with bad_input():
        from ..reproduce.bench.page import bounds
        from ..reproduce.bench.task import tasks

        each = tasks()
    if as_json:
        numbers = {
            name: {"number": t.number, "version": t.version, "digest": t.digest, "criteria": dict(t.criteria)}
            for name, t in each.items()
        }
        click.echo(json.dumps(numbers))
        return
    for name, task in each.items():
        click.echo(f"{task.number}. {name}, version {task.version}: {task.title}")
        click.echo(f"   {task.reason}")
        for metric, limit in task.criteria.items():
            click.echo(f"   {metric} {bounds(metric, limit)}: {task.why[metric]}")


@command("compare", epilog="Exit status: 0, also where the results differ, 2 bad input or nothing to compare.")
@click.argument("first", metavar="A.json[:LAW]")
@click.argument("second", metavar="B.json[:LAW]")
@json_option
def bench_compare(first: str, second: str, as_json: bool) -> None:
    """Compare two results of the benchmark, law by law and task by task, in the same draws.

    Laws are paired by their labels; with one law in each file, or with :LAW behind both names, these two are a pair.
    The file "shipped" is the result of the shipped laws. Tasks whose version or contents differ are left out, with a
    note.

    \b
    uvms-mj bench compare before/bench.json after/bench.json       or their folders, before and after
    uvms-mj bench compare mine/bench.json:MyLaw shipped:gsta
    """
    with bad_input():
        from ..reproduce.bench.compare import compared, sentences

        found = compared(first, second)
    if as_json:
        click.echo(json.dumps(found, allow_nan=False))
        return
    for pair in found["pairs"]:
        heads = ("task", pair["first"], pair["second"], "only first", "only second", "difference", "95 % interval")
        rows = [tuple(sentences(name, task)) for name, task in pair["tasks"].items()]
        title = f"{pair['first']} and {pair['second']}: draws passed"
        Table(title, heads, rows, right=heads[1:], width=80).show()
    for note in found["notes"]:
        click.echo(printable(f"note: {note}"), err=True)


for each in (bench_tasks, bench_compare):
    bench.add_command(each)
