"""``uvms-mj converge``."""

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from .common import EXIT_BAD_INPUT, EXIT_UNSTABLE, bad_input, end, progress_bar
from .console import Console, Table, warn
from .options import command, output_options, run_options
from .run import chosen
from .stop import Stop

if TYPE_CHECKING:
    from ..studies.convergence import Convergence


@command(epilog="Exit status: 0 completed, 2 bad input, 3 a run was unstable, 130 interrupted (143 by SIGTERM).")
@run_options("Use scenario and vehicle of a log, run.mcap.")
@click.option(
    "-m",
    "--metric",
    "metrics",
    multiple=True,
    metavar="NAME",
    help="A result, by its key in the JSON of uvms-mj run, such as contact.peak_N or final.s; may be repeated; "
    "`list` prints all.",
)
@output_options
def converge(metrics: tuple[str, ...], as_json: bool, quiet: bool, **asked: Any) -> None:
    """Compute error bars for a run's results: repeat the run at h, h/2 and h/4, and extrapolate.

    h is the scenario's time step. The three runs take seven times as long as the first one and write no files.

    \b
    uvms-mj converge
    uvms-mj converge --controller fosm --set wall.stiffness=2e4
    uvms-mj converge --metric contact.peak_N --metric final.s
    uvms-mj converge my_scenario.toml --set simulation.timestep=5e-5
    """
    stop = Stop()
    console = Console(as_json, quiet)
    with bad_input():
        from ..engine.run import LawError
        from ..studies.convergence import DEFAULT, METRICS, NotCompletedError
        from ..studies.convergence import converge as runs_of

        if "list" in metrics:
            click.echo("\n".join(METRICS))
            return
        scenario, mjcf, *_ = chosen(**asked, log_rate=None)
        try:
            with console.alone(), progress_bar("running", as_json or quiet, stop) as bar:
                found = runs_of(scenario, metrics or DEFAULT, mjcf=mjcf, progress=bar)
        except NotCompletedError as error:
            end(str(error), EXIT_UNSTABLE)
        except LawError as error:
            end(f"error: {error}", EXIT_BAD_INPUT)
    for note in found.notes:
        warn(note)
    if as_json:
        click.echo(json.dumps(_report(found), allow_nan=False))
    elif not quiet:
        _table(found)


def _report(found: "Convergence") -> dict[str, object]:
    return {
        "scenario": found.scenario.name,
        "controller": found.scenario.controller.label(),
        "timesteps_s": found.timesteps,
        "warnings": found.notes,
        "metrics": [asdict(estimate) for estimate in found.estimates],
    }


def _table(found: "Convergence") -> None:
    heads, *rows = found.table()
    right = [head for head in heads if head.startswith(("h =", "order"))]
    Table(found.title, heads, rows, right=right, fixed=(heads[0], "tends to"), width=60).show()
