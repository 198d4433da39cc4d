"""``uvms-mj bench``: laws on Contact-10, and what is made of a result."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .archive import compared, unpacked
from .common import Listing, Resumed, bad_input, draw_to_files, printable, refuse_existing
from .options import (
    OneOrNone,
    command,
    force_option,
    json_option,
    names_in,
    output_options,
    path_option,
    workers_option,
)
from .plot import figure_files, figure_options, label_option, labels_in
from .study import pool_of

if TYPE_CHECKING:
    from collections.abc import Mapping

_with_option = path_option(
    "--with",
    "beside",
    metavar="RESULT",
    help="Also have the laws of another result in table, page and figure: shipped, bench.json or FILE:LAW.",
)


@command(
    epilog="Exit status: 0 every law has its rows, also where it fails, 1 with --from: a number differs, 2 bad input "
    "or no space, 130 interrupted (143 SIGTERM, 129 SIGHUP)."
)
@click.argument("laws", nargs=-1, metavar="[LAW [KEY=VALUE]...]...")
@path_option("-o", "--out", metavar="DIR", help="Folder of the results [default: runs/bench].")
@click.option("--tasks", "only", multiple=True, metavar="NAME[,NAME]", help="Some of the tasks; may be repeated.")
@click.option(
    "--draws",
    default="development",
    metavar="WHICH",
    help="development, secret:FILE or seed:NUMBER [default: development].",
)
@click.option("--at-most", type=click.IntRange(1), metavar="N", help="At most N draws of each level, for a look.")
@click.option("--tune", type=click.IntRange(0), default=0, metavar="N", help="Also judge each law with tuned gains.")
@_with_option
@path_option("--from", "archive", metavar="FILE.zip", help="Repeat the result of an archive, and compare its bytes.")
@workers_option
@click.option("--scheduler", metavar="ADDRESS", help="Use the workers of a Dask scheduler, e.g. tcp://10.0.0.1:8786.")
@output_options
def run_bench(
    laws: tuple[str, ...],
    out: str | None,
    only: tuple[str, ...],
    draws: str,
    at_most: int | None,
    tune: int,
    beside: str | None,
    archive: str | None,
    workers: int | None,
    scheduler: str | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Measure laws on Contact-10: ten tasks of contact under water, five levels of difficulty each.

    A law climbs from level 1 of each task to the first level that it does not hold in 90 % of draws, by a sequential
    test. LAW is a shipped law, a file (my_law.py:MyLaw, my_law.c, libmy_law.so:my_law, my_law.fmu), or a TOML file with
    [[laws]], as study files have them; without one, all shipped laws. Settings after a law are its own, and the same
    for all tasks: controller.*, task.*, impedance.*, observer.*, actuation.*, and label=NAME.

    \b
    uvms-mj bench                                   all shipped laws, some minutes
    uvms-mj bench gsta my_law.py:MyLaw --out mine
    uvms-mj bench my_law.py:MyLaw --with shipped    one table with the shipped laws
    uvms-mj bench gsta controller.k_1=8 label=stiff --out stiff
    uvms-mj bench my_laws.toml --tasks arm,waves --at-most 5
    uvms-mj bench --from bench.zip --out repeated   a result of an archive again
    uvms-mj bench tasks                             the tasks and what passes them
    uvms-mj bench compare mine/bench.json:MyLaw shipped:gsta

    The draws of the development are known to everybody, and gains can be chosen on them. A result to publish has blind
    draws, which are given after the laws and their gains are fixed: of a number, or of a file that nobody has seen. The
    result has the digest of the file, which can be published before.

    \b
    head -c 32 /dev/urandom > secret
    uvms-mj bench my_law.py:MyLaw --draws secret:secret --out blind
    uvms-mj bench my_law.py:MyLaw --draws seed:20270101 --out blind

    With --tune N each law has a second row, with the gains that N trials found: of each trial one development draw of
    each level of each task. N is the same for all laws; DIR/laws.toml has the gains.

    \b
    uvms-mj bench --tune 60 --draws seed:20270101 --out tuned

    DIR/report.html is the page, DIR/bench.json has everything and is the same, byte for byte, for any number of
    workers, and DIR/table.tex is for a paper. DIR/LAW/TASK/level-N is a study, for `uvms-mj study report` and `uvms-mj
    run --from`. After any interruption the same command goes on where it was, and where a law is added, it alone runs.
    """
    resumed = Resumed("levels")
    draw_to_files()
    folder = Path(out or Path("runs", "bench"))
    with resumed.filling(folder), pool_of(scheduler, workers) as executor:
        from ..errors import InputError
        from ..reproduce.archive.contents import LAWS
        from ..reproduce.bench import LATEX, MOST, PAGE, RESULT, bench
        from ..reproduce.bench.draws import DEVELOPMENT

        names = names_in("--tasks", only)
        if archive is not None:
            if laws or names or at_most is not None or tune or draws != DEVELOPMENT:
                raise InputError(f"--from {archive}: repeats the result as it was; leave out laws, tasks and draws")
            folder, place, manifest = unpacked(archive, "bench", out)
            laws, names = (str(place / LAWS),), manifest.about["tasks"]
            at_most, draws = manifest.about["at_most"], manifest.about["draws"]
            draws = draws.replace("secret:", f"secret:{place.absolute()}/", 1)
        counted = "trials, then levels" if tune else "levels"
        with resumed.bar("measuring", as_json or quiet, f"{{done:.1f}} of {{total}} {counted}") as update:
            most = MOST if at_most is None else at_most
            how = {"draws": draws, "at_most": most, "tune": tune, "beside": beside or ""}
            found = bench(laws, folder, only=names, **how, progress=update, executor=executor)
    files = {"result": str(folder / RESULT), "report": str(folder / PAGE), "latex": str(folder / LATEX)}
    if as_json:
        click.echo(json.dumps({"digest": found["digest"], "levels": _held(found), **files}, allow_nan=False))
    elif not quiet:
        _levels_held(found)
        click.echo(printable("\n".join((files["report"], files["result"]))))
    if archive is not None:
        sys.exit(compared("bench", folder, quiet))


def _held(found: "Mapping[str, Any]") -> dict[str, dict[str, Any]]:
    """The level held by law and task; None where the law can't run."""
    return {
        law["label"]: {name: task["level"] if task["runs"] else None for name, task in law["tasks"].items()}
        for law in found["laws"]
    }


def _levels_held(found: "Mapping[str, Any]") -> None:
    from ..reproduce.bench.results import drawn

    tasks = found["tasks"]
    heads = [str(task["number"]) for task in tasks.values()]
    rows = [
        (law["label"], *(str(each["level"]) if each["runs"] else "-" for each in law["tasks"].values()))
        for law in found["laws"]
    ]
    title = f"{found['benchmark']}, version {found['version']}: level held, of 5; {drawn(found)}"
    Listing(title, ("law", *heads), rows, right=heads, fixed=heads, width=40).show()
    click.echo("; ".join(f"{task['number']} {name}" for name, task in tasks.items()))
    for law in found["laws"]:
        whys = {each["reason"]: name for name, each in law["tasks"].items() if not each["runs"]}
        for why in whys:
            where = ", ".join(name for name, each in law["tasks"].items() if each.get("reason") == why)
            click.echo(printable(f"- {law['label']} can't run {where}: {why}"))


@click.group(cls=OneOrNone, short_help="Measure laws on ten tasks of contact, the same for everybody.")
def bench() -> None:
    """Measure laws on Contact-10, or look at its tasks and results."""


bench.otherwise = run_bench


@command("tasks")
@json_option
def bench_tasks(as_json: bool) -> None:
    """List the tasks with their versions, their levels, and the criteria that a run must meet."""
    with bad_input():
        from ..reproduce.bench.page import bounds
        from ..reproduce.bench.task import tasks

        each = tasks()
    if as_json:
        numbers = {
            name: {"number": t.number, "version": t.version, "digest": t.digest, "criteria": dict(t.criteria)}
            | {"levels": list(t.levels)}
            for name, t in each.items()
        }
        click.echo(json.dumps(numbers))
        return
    for name, task in each.items():
        click.echo(f"{task.number}. {name}, version {task.version}: {task.title}")
        click.echo(f"   {task.reason}")
        for level, difficulty in enumerate(task.levels, 1):
            click.echo(f"   level {level}: {difficulty}")
        for metric, limit in task.criteria.items():
            click.echo(f"   {metric} {bounds(metric, limit)}: {task.why[metric]}")


@command("compare", epilog="Exit status: 0, also where the results differ, 2 bad input or nothing to compare.")
@click.argument("first", metavar="A.json[:LAW]")
@click.argument("second", metavar="[B.json[:LAW]]", required=False)
@label_option
@path_option("-o", "--out", metavar="FILE.tex", help="Also write the table as LaTeX.")
@force_option
@json_option
def bench_compare(
    first: str, second: str | None, labels: tuple[str, ...], out: str | None, force: bool, as_json: bool
) -> None:
    """Compare two results of the benchmark, law by law and task by task, in the same draws; of one result every two
    laws.

    Of each task: the level that each law holds, and of the draws that both ran, at the levels at which both were
    judged, the draws that each law passes, the draws that one of them alone passes, the better law, by how many points
    of the share of draws, and the interval; "not resolved" if the interval has zero. Below it stands whether the
    comparison is valid, and why: other code is no fault where a law that is in both results has the same numbers.

    Laws are paired by their labels; with one law in each file, or with :LAW behind both names, these two are a pair.
    The file "shipped" is the result of the shipped laws, "shipped-version-1" their result on the first version of the
    benchmark, which is compared with its like alone. Tasks whose version or contents differ are left out, with a note.

    \b
    uvms-mj bench compare before/bench.json after/bench.json       or their folders, before and after
    uvms-mj bench compare mine/bench.json:MyLaw shipped:gsta
    uvms-mj bench compare mine blind --out table.tex
    uvms-mj bench compare mine --label my_law=ours                  every two laws of one result
    """
    with bad_input():
        from ..errors import InputError
        from ..files import atomic_write
        from ..reproduce.bench.latex import comparison
        from ..reproduce.bench.results import compared, renamed, sentences
        from ..studies.report.latex import COLUMN_PT
        from ..studies.report.statistics import of_many

        if out is not None:
            if Path(out).suffix != ".tex":
                raise InputError(f"--out {out}: the name must end in .tex")
            refuse_existing("--out", Path(out), force)
        found = renamed(compared(first, second or ""), labels_in(labels))
        tables = comparison(found) if out is not None else []
        if out is not None:
            with atomic_write(Path(out)) as part:
                part.write_text("\n\\bigskip\n\n".join(table.text for table in tables), encoding="utf-8")
    if as_json:
        click.echo(json.dumps(found, allow_nan=False))
        return
    for pair in found["pairs"]:
        labels = (pair["first"], pair["second"])
        heads = ("task", *labels, "only first", "only second", "better", "by points", "95 % interval")
        rows = [tuple(sentences(name, task, labels)) for name, task in pair["tasks"].items()]
        title = f"{pair['first']} and {pair['second']}: draws passed"
        Listing(title, heads, rows, right=heads[1:], width=80).show()
    if together := of_many(sum("interval" in task for pair in found["pairs"] for task in pair["tasks"].values())):
        click.echo(together)
    valid = {True: "valid", False: "not valid", None: "not known to be valid"}[found["valid"]]
    click.echo(printable(f"{valid}: {found['why']}"))
    wide = [f"{out}: {table.fits}" for table in tables if table.width > COLUMN_PT]
    for note in (*found["notes"], *dict.fromkeys(wide)):
        click.echo(printable(f"note: {note}"), err=True)


def _result(given: str, beside: str | None, labels: tuple[str, ...]) -> "Mapping[str, Any]":
    """A result of the benchmark, with the rows of another one below its own if it is given, and with its labels."""
    from ..reproduce.bench.results import beside as with_rows_of
    from ..reproduce.bench.results import refuse_other_tasks, renamed, result_of

    found = result_of(given)
    if beside:
        refuse_other_tasks(beside, found["tasks"])
        found = with_rows_of(found, beside)
    return renamed(found, labels_in(labels))


@command("plot")
@click.argument("result", metavar="RESULT[:LAW]")
@_with_option
@figure_options
def bench_plot(
    result: str,
    beside: str | None,
    kinds: tuple[str, ...],
    width: str | None,
    height: str | None,
    labels: tuple[str, ...],
    fonts: str,
    out: str | None,
    force: bool,
) -> None:
    """Draw the laws of each task in their order, as on the page: a full step is a level. RESULT is a folder of a
    benchmark, its bench.json, or shipped. Nothing runs. Without --out the file is order.png.

    \b
    uvms-mj bench plot blind --with shipped:gsta --out order.pdf --width page --fonts serif
    """
    draw_to_files()
    with bad_input():
        from ..reproduce.bench.figures import colours_of, order
        from ..views import figures
        from ..views.figures.style import PAGE_IN, height_of, typeset, width_of

        stem, formats = figure_files(kinds, out, Path("order"), force)
        found = _result(result, beside, labels)
        shown = dict(zip([law["label"] for law in found["laws"]], colours_of(found), strict=True))
        with typeset(fonts, width_of(width, PAGE_IN)):
            drawn = order(found, shown)
        drawn.set_figheight(height_of(height, drawn.get_figheight()))
        for written in figures.save(drawn, stem, formats):
            click.echo(str(written))


@command("table")
@click.argument("result", metavar="RESULT[:LAW]")
@_with_option
@label_option
@path_option("-o", "--out", metavar="FILE.tex", help="File of the table [default: print].")
@force_option
def bench_table(result: str, beside: str | None, labels: tuple[str, ...], out: str | None, force: bool) -> None:
    """Write the table of a result as LaTeX: of each law and task the level that it holds, and the draws passed at the
    next. RESULT is a folder of a benchmark, its bench.json, or shipped. Nothing runs. It needs the package booktabs.

    \b
    uvms-mj bench table blind --with shipped:gsta --out table.tex
    """
    with bad_input():
        from ..errors import InputError
        from ..files import atomic_write
        from ..reproduce.bench.latex import latex_table
        from ..studies.report.latex import COLUMN_PT

        if out is not None:
            if Path(out).suffix != ".tex":
                raise InputError(f"--out {out}: the name must end in .tex")
            refuse_existing("--out", Path(out), force)
        table = latex_table(_result(result, beside, labels))
        if out is None:
            click.echo(table.text, nl=False)
            return
        with atomic_write(Path(out)) as part:
            part.write_text(table.text, encoding="utf-8")
        click.echo(printable(out))
        if table.width > COLUMN_PT:
            click.echo(printable(f"note: {out}: {table.fits}"), err=True)


for each in (bench_tasks, bench_compare, bench_plot, bench_table):
    bench.add_command(each)
