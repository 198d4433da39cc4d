"""``uvms-mj validate``: runs that are compared with measurements."""

import json
from pathlib import Path
from typing import Any

import click

from .common import draw_to_files, filling, progress_bar
from .console import Table
from .options import command, json_option, path_option, workers_option
from .stop import Stop


@click.group()
def validate() -> None:
    """Compare runs with measurements.

    \b
    uvms-mj validate pool --data pool_2023
    """


@command(epilog="Exit status: 0 completed, 2 bad input or no space, 130 interrupted (143 by SIGTERM).")
@path_option("--data", required=True, metavar="DIR", help="Folder of the records.")
@path_option("-o", "--out", metavar="DIR", help="Folder of the results [default: runs/validate-pool].")
@workers_option
@json_option
def pool(data: str, out: str | None, workers: int | None, as_json: bool) -> None:
    """A vehicle that floats in a pool while its arm moves.

    For every trial in DIR the vehicle floats freely, its thrusters off, and the arm is driven along the measured joint
    angles. The page report.html has measured and simulated roll, pitch and yaw, their errors, those without the links'
    added mass and drag, with lumped added mass, with a fitted metacentric height and of naive models (hydrostatics
    alone, a constant pitch), and the motion that would tell these models apart. A trial whose two instruments disagree
    is named and counts in no mean. A trial is NAME_mocap.csv, NAME_imu.csv and NAME_joint_states.csv, as Kolano and
    Davidson publish them in UVMS-SysID-with-EAs. It takes about a minute.

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
    _table(found)
    click.echo(str(folder / PAGE))


def _table(found: dict[str, Any]) -> None:
    heads = ("mean [deg]", "median [deg]", "trials")
    rows = [
        (name, f"{mean:.3f}", f"{found['median_rms_pitch_deg'][name]:.3f}", str(found["judged_on"][name]))
        for name, mean in found["mean_rms_pitch_deg"].items()
    ]
    title = f"{len(found['trials'])} trials: rms error of the pitch"
    Table(title, ("model", *heads), rows, right=heads, fixed=heads).show()
    click.echo(f"height fitted on {', '.join(found['fitted_on'])}, and judged on the others")
    if found["disagreeing"]:
        differ = dict(zip(found["trials"], found["instruments_differ_deg"], strict=True))
        names = ", ".join(f"{name} ({differ[name]:.1f} deg)" for name in found["disagreeing"])
        click.echo(
            f"left out, since the two instruments differ by more than {found['agree_within_deg']:g} deg: {names}"
        )


validate.add_command(pool)
