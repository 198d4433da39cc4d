"""``uvms-mj plot`` and ``uvms-mj compare``: plots of logs, and one HTML page for any logs."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .common import bad_input, draw_to_files, refuse_existing
from .logs import loaded
from .options import command, force_option, names_in, number, path_option

if TYPE_CHECKING:
    from ..records.trace import Trace

WHATS = ("position", "attitude", "velocity", "force", "sliding", "tau", "thrusters", "integral", "joints", "summary")
"""The choices of :mod:`uvms_mj.views.figures`, repeated here because its import is too slow for ``--help``."""
FORMATS = ("png", "svg", "pdf", "pgf")
WIDTHS = {"column": 3.4, "page": 7.1}
"""Widths of a figure by name [in]."""


@command()
@click.argument("logs", nargs=-1, required=True, metavar="LOG...")
@click.option(
    "--what",
    "whats",
    multiple=True,
    metavar="NAME[,NAME]",
    help=f"What to plot: {', '.join(WHATS)}, a recorded signal or a component of one, such as nu or tau.x; "
    "may be repeated [default: summary].",
)
@click.option("--from", "start", metavar="SECONDS", help="Plot from this time on [default: the start].")
@click.option("--to", "end", metavar="SECONDS", help="Plot up to this time [default: the end].")
@click.option("--width", metavar="CM", help="Width in cm, or column (8.6) or page (18).")
@path_option(
    "-o",
    "--out",
    metavar="FILE",
    help="Output file, .png, .svg, .pdf or .pgf [default: NAME.png beside the first LOG].",
)
@force_option
def plot(
    logs: tuple[str, ...],
    whats: tuple[str, ...],
    start: str | None,
    end: str | None,
    width: str | None,
    out: str | None,
    force: bool,
) -> None:
    """Plot a log, or several logs on the same axes, each in the colour of its law.

    In a plot of the force, "expected" is K_x (x_d - x_c), for a rigid wall, and "analytic" the law's closed form of the
    force at rest at this wall. A .pgf needs a LaTeX to measure its texts. uvms-mj info LOG lists the recorded signals.

    \b
    uvms-mj plot results/run.mcap
    uvms-mj plot results/run.mcap --what force --out force.svg
    uvms-mj plot results/run.mcap --what tau.x,p_WB --from 5 --to 6 --width 12
    uvms-mj plot gsta/run.mcap fosm/run.mcap --what tau
    """
    draw_to_files()
    with bad_input():
        from ..errors import InputError
        from ..views import figures

        names = names_in("--what", whats) or ["summary"]
        path = Path(out) if out is not None else Path(logs[0]).parent / f"{'_'.join(names)[:60]}.png"
        kind = path.suffix.removeprefix(".")
        if kind not in FORMATS:
            raise InputError(f"--out {path}: the name must end in one of .{', .'.join(FORMATS)}")
        refuse_existing("--out", path, force)
        inches = None if width is None else WIDTHS.get(width) or number("--width", width, "cm", 4.0, 100.0) / 2.54
        traces = {label: _between(label, trace, start, end) for label, trace in loaded(logs).items()}
        (written,) = figures.save(figures.plot(traces, names, inches), path.with_name(path.stem), (kind,))
        click.echo(str(written))


def _between(label: str, trace: "Trace", start: str | None, end: str | None) -> "Trace":
    """The rows of a trace from a time to a time [s]. Raises InputError unless there are two rows between them."""
    from ..errors import InputError

    low = None if start is None else number("--from", start, "s", 0.0, 1e7)
    high = None if end is None else number("--to", end, "s", 0.0, 1e7)
    try:
        return trace.between(low, high)
    except InputError as error:
        raise InputError(f"{label}: {error}") from None


@command()
@click.argument("logs", nargs=-1, required=True, metavar="LOG...")
@path_option("-o", "--out", default="compare.html", show_default=True, metavar="FILE.html", help="File for the page.")
@force_option
def compare(logs: tuple[str, ...], out: str, force: bool) -> None:
    """Write one HTML page about one or several logs: numbers, figures, differences, versions.

    \b
    uvms-mj compare gsta/run.mcap fosm/run.mcap
    uvms-mj compare runs/*/run.mcap --out monday.html
    """
    draw_to_files()
    with bad_input():
        from ..errors import InputError

        if Path(out).suffix.lower() not in (".html", ".htm"):
            raise InputError(f"--out {out!r}: the name must end in .html")
        refuse_existing("--out", Path(out), force)
        from ..reproduce.comparison import compare as write

        write(loaded(logs), out)
        click.echo(out)
