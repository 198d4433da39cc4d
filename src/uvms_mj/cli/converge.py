"""``uvms-mj converge``."""

import json
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from .common import EXIT_BAD_INPUT, EXIT_UNSTABLE, bad_input, end, progress_bar
from .console import Console, print_table, table_of, warn
from .options import command, output_options, run_options
from .run import chosen
from .stop import Stop

if TYPE_CHECKING:
    from ..studies.convergence import Convergence, Estimate


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
    scenario, period = found.scenario, found.scenario.controller.period
    sampled = "the law at every step" if period is None else f"the law every {period:g} s"
    title = f"{scenario.name} · {scenario.controller.label()} · {scenario.simulation.duration:g} s, {sampled}"
    table = table_of(title, "metric", fixed=("metric",), min_width=60)
    for h in found.timesteps:
        table.add_column(f"h = {h:g} s", justify="right")
    table.add_column("order", justify="right")
    table.add_column("tends to", no_wrap=True)
    table.add_column("remark")
    for each in found.estimates:
        values = ("-" if value is None else f"{value:.7g}" for value in each.values)
        order = "-" if each.order is None else f"{each.order:.2f}"
        table.add_row(each.name, *values, order, with_error(each), each.remark)
    print_table(table)


def with_error(estimate: "Estimate") -> str:
    """A number to the second digit of its uncertainty, ``17.872 ± 0.013``; the number alone if that is rounding."""
    from ..studies.convergence import RESOLUTION, ROUNDING

    value, uncertainty = estimate.value, estimate.uncertainty
    if value is None or uncertainty is None:
        return "-"
    if uncertainty <= max(RESOLUTION, ROUNDING * abs(value)):
        return f"{value:.9g}" if abs(value) > RESOLUTION else "0"
    last = math.floor(math.log10(uncertainty)) - 1
    if abs(value) < 10.0**last:
        return f"0 ± {uncertainty:#.2g}"
    digits = math.floor(math.log10(abs(value))) - last + 1
    both = f"{value:#.{max(1, digits)}g} ± {uncertainty:#.2g} "
    return both.replace(". ", " ").replace(".e", "e").strip()
