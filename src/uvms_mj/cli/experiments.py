"""Experiments that are repeated: ``uvms-mj paper``, ``practicality``, ``validate`` and ``bench``."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from .archive import compared, unpacked
from .common import (
    Listing,
    Resumed,
    Stop,
    bad_input,
    draw_to_files,
    end,
    exit_interrupted,
    filling,
    print_verdicts,
    printable,
    progress_bar,
    refuse_existing,
)
from .folders import folder_for, move_aside
from .options import (
    OneOrNone,
    asked_for,
    command,
    force_option,
    json_option,
    names_in,
    output_options,
    path_option,
    scenario_argument,
    set_option,
    workers_option,
)
from .plot import figure_files, figure_options, label_option, labels_in
from .study import pool_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from ..reproduce.archive.container import Manifest
    from ..reproduce.claims import Row
    from ..scenario import Scenario


EXIT_CLAIM_FAILS = 1
_RESULTS = ("logs", "claims.csv", "claims.json", "report.html")


@command(
    epilog="Exit status: 0 every claim holds or is explained, 1 a claim fails, 2 bad input, 130 interrupted (143 "
    "SIGTERM, 129 SIGHUP)."
)
@scenario_argument
@set_option
@path_option("-o", "--out", metavar="DIR", help="Folder for all output; required unless --from is given.")
@path_option(
    "--from", "source", metavar="DIR|FILE.zip",
    help="Redraw from DIR/logs without new runs, into DIR or --out; of an archive: run it again, and compare.",
)  # fmt: skip
@json_option
def paper(
    arguments: tuple[str, ...], settings: tuple[str, ...], out: str | None, source: str | None, as_json: bool
) -> None:
    """Repeat the simulations of the paper's section 5 and check its claims.

    Output: DIR/report.html, a page to read and to print; DIR/fig01 to fig12 and overview as PNG and SVG; DIR/claims.csv
    and claims.json; and DIR/logs, the logs of all runs. Results of an earlier call in DIR are moved to a subfolder.

    \b
    uvms-mj paper --out results
    uvms-mj paper --out soft wall.stiffness=2e4
    uvms-mj paper --out gains fosm.K_s=24 gsta.k_1=8
    uvms-mj paper --from results
    """
    stop = Stop()
    draw_to_files()
    archive = source if source is not None and source.lower().endswith(".zip") else None
    running = source is None or archive is not None
    place = Path(source or out or "")
    if archive is not None:
        with bad_input():
            place, unpacked_in, manifest = unpacked(archive, "paper", out)
        out, source = str(place), None
    with filling(place, lambda: "" if running else "; the logs are complete: redraw with --from"):
        from ..files import locked

        if archive is None:
            jobs = _jobs(arguments, settings, out, source)
        else:
            jobs = _jobs_again(archive, (*arguments, *settings), unpacked_in, manifest)
        from ..reproduce.paper import runs as study
        from ..reproduce.paper import write

        logs = place / "logs"
        if source is not None:
            runs = study.load(logs, jobs)
        folder = folder_for(out or source or "")
        with locked(folder):
            if running:
                figures = (path for pattern in ("fig??.*", "overview.*") for path in folder.glob(pattern))
                move_aside(folder, [*(folder / name for name in _RESULTS), *figures], "output of an earlier call")
                logs.mkdir()
                with progress_bar("running", as_json, stop) as bar:
                    study.run(jobs, logs, bar)
                running = False
                runs = study.load(logs, jobs)
            with progress_bar("drawing", as_json, stop) as bar:
                rows = write(folder, runs, bar)
    files = {"report": folder / "report.html", "claims": folder / "claims.json", "logs": logs}
    if archive is not None and (status := compared("paper", folder, as_json)):
        sys.exit(status)
    _end(rows, None if as_json else _claims_of_the_paper, files["report"], files={k: str(v) for k, v in files.items()})


def _end(rows: "list[Row]", table: "Callable[[list[Row]], None] | None", page: Path, **places: Any) -> NoReturn:
    """Print the claims by ``table``, or as JSON with the places of the files, and end with the status of the claims."""
    failed = [row.claim.id for row in rows if row.verdict.name == "fails"]
    if table is None:
        report = {"claims": [row.as_dict() for row in rows], "failed": failed}
        click.echo(json.dumps(report | places, allow_nan=False))
    else:
        table(rows)
        click.echo(str(page))
    sys.exit(EXIT_CLAIM_FAILS if failed else 0)


def _jobs(
    arguments: tuple[str, ...], settings: tuple[str, ...], out: str | None, source: str | None
) -> "dict[str, Scenario]":
    """The runs of the study by name. Raises InputError if the arguments of the command are invalid."""
    from ..errors import InputError
    from ..reproduce.paper.runs import plan
    from ..scenario import Scenario

    if source is not None and (arguments or settings):
        raise InputError(f"--from only redraws existing runs; omit {' '.join((*arguments, *settings))}")
    if source is None and out is None:
        raise InputError("--out DIR is missing; it is the folder for the logs and the report")
    name, overrides = asked_for(arguments, settings)
    gains = _gains(overrides)
    return plan(Scenario.load(name or "push_wall", overrides), gains)


def _jobs_again(archive: str, given: tuple[str, ...], place: Path, manifest: "Manifest") -> "dict[str, Scenario]":
    """The runs of an archive by name, which is unpacked at ``place``."""
    from ..errors import InputError
    from ..records.mcap import read_files
    from ..reproduce.archive.contents import RESULTS

    if given:
        raise InputError(f"--from {archive}: repeats the runs as they were; omit {' '.join(given)}")
    names = {key: str((place / name).absolute()) for key, name in manifest.about["names"].items()}
    logs = sorted((place / RESULTS / "logs").glob("*.mcap"))
    return {log.stem: read_files(log)[0].scenario.updated(names) for log in logs}


def _gains(overrides: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Remove the gains of single laws, such as ``fosm.K_s``, from the settings and return them by law."""
    from ..control import BUILT_IN, ImpedanceTask
    from ..errors import Fault, InputError, suggestion
    from ..reproduce.paper.runs import TUNED

    gains: dict[str, dict[str, Any]] = {law: {} for law in TUNED}
    for key in list(overrides):
        law, _, gain = key.partition(".")
        if law in gains:
            fields = (*BUILT_IN[law].setting_fields(), *ImpedanceTask.setting_fields())
            choices = sorted({field.name for field in fields} - {"nominal"})
            if gain == "nominal":
                raise InputError([Fault(key, "cannot be set; the law is run both with and without nominal control")])
            if gain not in choices:
                raise InputError([Fault(key, f"{law} has no such gain; {suggestion(gain, choices)}")])
            gains[law][f"controller.{gain}"] = overrides.pop(key)
    return gains


def _claims_of_the_paper(rows: "list[Row]") -> None:
    def cells(row: "Row", value: str) -> tuple[str, ...]:
        claim = row.claim
        return claim.text, claim.quantity, claim.paper, value, claim.predicate

    print_verdicts("claims of the paper", ("claim", "quantity", "paper", "ours", "threshold"), rows, cells)
    for name, meaning in {row.verdict.name: row.verdict.value for row in rows}.items():
        click.echo(f"{name}: {meaning}")
    for row in rows:
        if row.verdict.name == "explained":
            click.echo(f"\n{row.claim.text}\nWhy this does not hold here: {row.claim.explanation}")


@command(
    epilog="Exit status: 0 every claim holds, 1 a claim fails, 2 bad input or no space, 130 interrupted (143 "
    "SIGTERM, 129 SIGHUP)."
)
@set_option
@path_option("-o", "--out", metavar="DIR", help="Folder of the results [default: runs/practicality].")
@workers_option
@json_option
def practicality(settings: tuple[str, ...], out: str | None, workers: int | None, as_json: bool) -> None:
    """From ideal to real: where each of the paper's laws stops working.

    The BlueROV2 Heavy presses on a wall in a current that it does not know. Its control rate, force sensor, thrusters,
    battery, wall and model go from ideal to real, one after the other and together. DIR/report.html has the claims with
    their measured values, the boundary of each law along each axis, maps, and the steps to a pool. DIR has one study
    for each axis, which `uvms-mj study report` and `uvms-mj run --from` read. It takes some minutes; after any
    interruption the same command goes on where it was.

    \b
    uvms-mj practicality --out real
    uvms-mj practicality --out heavy_tuhh --set vehicle.model=bluerov2_heavy_tuhh
    """
    resumed = Resumed("runs")
    draw_to_files()
    folder = Path(out or Path("runs", "practicality"))
    with resumed.filling(folder):
        from ..reproduce.practicality import PAGE, repeat

        overrides = asked_for((), settings)[1]
        with resumed.bar("running", as_json) as update:
            rows = repeat(folder, overrides, progress=update, workers=workers)
    page = folder / PAGE
    _end(rows, None if as_json else _claims_of_practicality, page, report=str(page))


def _claims_of_practicality(rows: "list[Row]") -> None:
    def cells(row: "Row", value: str) -> tuple[str, ...]:
        claim = row.claim
        return claim.text, f"{claim.quantity}: {value}\n{row.measured.detail}", claim.predicate

    print_verdicts("claims", ("claim", "measured", "threshold"), rows, cells)


@click.group()
def validate() -> None:
    """Compare runs with measurements.

    \b
    uvms-mj validate pool --data pool_2023
    uvms-mj validate speed
    """


@command(epilog="Exit status: 0 completed, 2 bad input or no space, 130 interrupted (143 SIGTERM, 129 SIGHUP).")
@path_option("--data", required=True, metavar="DIR", help="Folder of the records.")
@path_option("-o", "--out", metavar="DIR", help="Folder of the results [default: runs/validate-pool].")
@workers_option
@json_option
def pool(data: str, out: str | None, workers: int | None, as_json: bool) -> None:
    """A vehicle that floats in a pool while its arm moves.

    For every trial in DIR the vehicle floats freely, its thrusters off, and the arm is driven along the measured joint
    angles. The page report.html has measured and simulated roll, pitch and yaw, and their errors; the errors of models
    without the links' added mass and drag, with lumped added mass, with a fitted metacentric height, and of naive
    models (hydrostatics alone, a constant pitch); and the motion that would tell these models apart. A trial whose two
    instruments disagree is named and counts in no mean. A trial is NAME_mocap.csv, NAME_imu.csv and
    NAME_joint_states.csv, as Kolano and Davidson publish them in UVMS-SysID-with-EAs. It takes about a minute.

    \b
    uvms-mj validate pool --data pool_2023 --out pool
    """
    draw_to_files()
    folder, stop = Path(out or Path("runs", "validate-pool")), Stop()
    with filling(folder):
        from ..reproduce.validate import PAGE, repeat

        with progress_bar("running", as_json, stop) as update:
            found = repeat(data, folder, progress=update, workers=workers)
    if as_json:
        click.echo(json.dumps(found | {"report": str(folder / PAGE)}, allow_nan=False))
        return
    _errors_of_the_pool(found)
    click.echo(str(folder / PAGE))


def _errors_of_the_pool(found: dict[str, Any]) -> None:
    heads = ("mean [deg]", "median [deg]", "trials")
    rows = [
        (name, f"{mean:.3f}", f"{found['median_rms_pitch_deg'][name]:.3f}", str(found["judged_on"][name]))
        for name, mean in found["mean_rms_pitch_deg"].items()
    ]
    title = f"{len(found['trials'])} trials: rms error of the pitch"
    Listing(title, ("model", *heads), rows, right=heads, fixed=heads).show()
    click.echo(f"height fitted on {', '.join(found['fitted_on'])}, and judged on the others")
    if found["disagreeing"]:
        differ = dict(zip(found["trials"], found["instruments_differ_deg"], strict=True))
        names = ", ".join(f"{name} ({differ[name]:.1f} deg)" for name in found["disagreeing"])
        click.echo(
            f"left out, since the two instruments differ by more than {found['agree_within_deg']:g} deg: {names}"
        )


@command(epilog="Exit status: 0 within the bound, 1 beyond it, 130 interrupted (143 SIGTERM, 129 SIGHUP).")
@json_option
def speed(as_json: bool) -> None:
    """The speed ahead of a real BlueROV2 Heavy in MANUAL, by the axis of its pilot.

    A laboratory measured speed = 0.692 (axis - 0.096) m/s at the pilot's gain of 0.5. The run has the T200's curve at
    15 V, ArduSub's linear mixer, and the vehicle as it ships; nothing is fitted. It takes some seconds.

    \b
    uvms-mj validate speed
    """
    stop = Stop()
    try:
        from ..reproduce.validate.speed import AXES, BOUND, VOLTAGE, rms_error, speeds

        with progress_bar("running", as_json, stop) as update:
            found = speeds(progress=lambda done: update(done, len(AXES)))
    except KeyboardInterrupt:
        end("interrupted", exit_interrupted())
    error, by_formula = rms_error(found), rms_error(found, "closed_form")
    if as_json:
        rows = [vars(each) for each in found]
        click.echo(json.dumps({"speeds_m_per_s": rows, "rms_error": error, "closed_form_rms_error": by_formula}))
    else:
        heads = ("measured [m/s]", "run [m/s]", "closed form [m/s]")
        cells = [(f"{x.axis:g}", *(f"{v:.4f}" for v in (x.measured, x.run, x.closed_form))) for x in found]
        title = f"speed ahead of a Heavy at {VOLTAGE:g} V"
        Listing(title, ("axis", *heads), cells, right=("axis", *heads), fixed=heads).show()
        click.echo(
            f"rms error of the run {error:.1%} of the mean speed, at most {BOUND:.0%}; "
            f"of the closed form {by_formula:.1%}"
        )
    sys.exit(int(error > BOUND))


validate.add_command(pool)
validate.add_command(speed)


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
