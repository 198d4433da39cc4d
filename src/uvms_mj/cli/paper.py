"""``uvms-mj paper``: runs, figures and claims of the paper's section 5."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import draw_to_files, filling, progress_bar
from .console import print_verdicts
from .folders import alone_in, folder_for, move_aside
from .options import asked_for, command, json_option, path_option, scenario_argument, set_option
from .stop import Stop

if TYPE_CHECKING:
    from ..reproduce.claims import Row
    from ..scenario import Scenario

EXIT_CLAIM_FAILS = 1
_RESULTS = ("logs", "claims.csv", "claims.json", "report.html")


@command(
    epilog="Exit status: 0 every claim holds or is explained, 1 a claim fails, 2 bad input, 130 interrupted (143 by "
    "SIGTERM)."
)
@scenario_argument
@set_option
@path_option("-o", "--out", metavar="DIR", help="Folder for all output; required unless --from is given.")
@path_option("--from", "source", metavar="DIR", help="Redraw from DIR/logs without new runs, into DIR or --out.")
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
    running = source is None
    place = Path(source or out or "")
    with filling(place, lambda: "" if running else "; the logs are complete: redraw with --from"):
        jobs = _jobs(arguments, settings, out, source)
        from ..reproduce.paper import runs as study
        from ..reproduce.paper import write

        logs = place / "logs"
        if source is not None:
            runs = study.load(logs, jobs)
        folder = folder_for(out or source or "")
        with alone_in(folder):
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
    failed = [row.claim.id for row in rows if row.verdict.name == "fails"]
    if as_json:
        files = {"report": folder / "report.html", "claims": folder / "claims.json", "logs": logs}
        report = {"claims": [row.as_dict() for row in rows], "failed": failed}
        click.echo(json.dumps(report | {"files": {kind: str(path) for kind, path in files.items()}}, allow_nan=False))
    else:
        _table(rows)
        click.echo(str(folder / "report.html"))
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


def _table(rows: "list[Row]") -> None:
    def cells(row: "Row", value: str) -> tuple[str, ...]:
        claim = row.claim
        return claim.text, claim.quantity, claim.paper, value, claim.predicate

    print_verdicts("claims of the paper", ("claim", "quantity", "paper", "ours", "threshold"), rows, cells)
    for name, meaning in {row.verdict.name: row.verdict.value for row in rows}.items():
        click.echo(f"{name}: {meaning}")
    for row in rows:
        if row.verdict.name == "explained":
            click.echo(f"\n{row.claim.text}\nWhy this does not hold here: {row.claim.explanation}")
