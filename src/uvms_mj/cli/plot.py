"""``uvms-mj plot`` and ``uvms-mj compare``: plots of logs, and one HTML page for any logs."""

from pathlib import Path

import click

from .common import bad_input, draw_to_files, refuse_existing
from .logs import loaded
from .options import command, force_option, path_option

WHATS = ("position", "force", "sliding", "tau", "integral", "joints", "summary")
"""The choices of :mod:`uvms_mj.views.figures`, repeated here because its import is too slow for ``--help``."""
FORMATS = ("png", "svg", "pdf")
_CAPTIONS = {
    "position": "Position in W and its reference",
    "force": "Contact force",
    "sliding": "Sliding variable",
    "tau": "Thrust",
}
"""Captions of the figures of a page."""


@command()
@click.argument("logs", nargs=-1, required=True, metavar="LOG...")
@click.option("--what", type=click.Choice(WHATS), default="summary", show_default=True, help="Signals to plot.")
@path_option(
    "-o", "--out", metavar="FILE", help="Output file, .png, .svg or .pdf [default: WHAT.png beside the first LOG]."
)
@force_option
def plot(logs: tuple[str, ...], what: str, out: str | None, force: bool) -> None:
    """Plot a log, or several logs on the same axes, each in the colour of its law.

    In a plot of the force, "expected" is K_x (x_d - x_c), for a rigid wall, and "analytic" the law's closed form of the
    force at rest at this wall.

    \b
    uvms-mj plot results/run.mcap
    uvms-mj plot results/run.mcap --what force --out force.svg
    uvms-mj plot gsta/run.mcap fosm/run.mcap --what tau
    """
    draw_to_files()
    with bad_input():
        from ..errors import InputError
        from ..views import figures

        path = Path(out) if out is not None else Path(logs[0]).parent / f"{what}.png"
        kind = path.suffix.removeprefix(".")
        if kind not in FORMATS:
            raise InputError(f"--out {path}: the name must end in one of .{', .'.join(FORMATS)}")
        refuse_existing("--out", path, force)
        (written,) = figures.save(figures.plot(loaded(logs), what), path.with_suffix(""), (kind,))
        click.echo(str(written))


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
        from ..studies import pages
        from ..studies.paper import report
        from ..views import figures

        traces = loaded(logs)
        captions = dict(_CAPTIONS)
        if any(trace.header.law.states for trace in traces.values()):
            captions["integral"] = "The laws' own states"
        if any(trace.header.geometry.links for trace in traces.values()):
            captions["joints"] = "Joints"
        pictures = [
            report.Picture(what, f"{caption}: {report.named(traces)}.", figures.plot(traces, what))
            for what, caption in captions.items()
            if what != "sliding" or any("s" in trace.arrays for trace in traces.values())
        ]
        names = ", ".join(dict.fromkeys(trace.scenario.name for trace in traces.values()))
        pages.write(Path(out), report.page(f"{names}: {report.named(traces)}", traces, pictures))
        click.echo(out)
