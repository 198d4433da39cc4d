"""Experiments that are repeated: ``uvms-mj paper``, ``practicality`` and ``validate``."""

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
    progress_bar,
)
from .folders import move_aside
from .options import asked_for, command, json_option, path_option, scenario_argument, set_option, workers_option

if TYPE_CHECKING:
    from collections.abc import Callable

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
        folder = Path(out or source or "")
        with locked(folder):
            if running:
                figures = (path for pattern in ("fig??.*", "overview.*") for path in folder.glob(pattern))
                move_aside(folder, [*(folder / name for name in _RESULTS), *figures], "output of an earlier call")
                with locked(logs), progress_bar("running", as_json, stop) as bar:
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
