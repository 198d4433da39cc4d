"""``uvms-mj practicality``: where the paper's laws stop working on a real vehicle."""

import functools
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .common import draw_to_files, filling, progress_bar
from .console import print_verdicts
from .options import asked_for, command, json_option, path_option, set_option, workers_option
from .stop import Stop
from .study import kept

if TYPE_CHECKING:
    from ..reproduce.claims import Row

EXIT_CLAIM_FAILS = 1


@command(
    epilog="Exit status: 0 every claim holds, 1 a claim fails, 2 bad input or no space, 130 interrupted (143 by "
    "SIGTERM)."
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
    stop, shown = Stop(), dict[str, int]()
    draw_to_files()
    folder = Path(out or Path("runs", "practicality"))
    with filling(folder, functools.partial(kept, shown, "runs")):
        from ..reproduce.practicality import PAGE, repeat

        overrides = asked_for((), settings)[1]
        with progress_bar("running", as_json, stop) as update:

            def progress(done: int, total: int) -> None:
                shown.update(done=done, total=total)
                update(done, total)

            rows = repeat(folder, overrides, progress=progress, workers=workers)
    claims = [row.as_dict() for row in rows]
    failed = [row.claim.id for row in rows if row.verdict.name == "fails"]
    if as_json:
        click.echo(json.dumps({"claims": claims, "failed": failed, "report": str(folder / PAGE)}, allow_nan=False))
    else:
        _table(rows)
        click.echo(str(folder / PAGE))
    sys.exit(EXIT_CLAIM_FAILS if failed else 0)


def _table(rows: "list[Row]") -> None:
    def cells(row: "Row", value: str) -> tuple[str, ...]:
        claim = row.claim
        return claim.text, f"{claim.quantity}: {value}\n{row.measured.detail}", claim.predicate

    print_verdicts("claims", ("claim", "measured", "threshold"), rows, cells)
