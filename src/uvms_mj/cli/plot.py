"""``uvms-mj plot``: plots of logs."""

from pathlib import Path

import click

from .common import bad_input, command, draw_to_files, force_option, path_option, refuse_existing

WHATS = ("position", "force", "sliding", "tau", "integral", "summary")
"""The choices of :mod:`uvms_mj.views.figures`, repeated here because its import is too slow for ``--help``."""
FORMATS = ("png", "svg", "pdf")


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
        from .logs import loaded

        path = Path(out) if out is not None else Path(logs[0]).parent / f"{what}.png"
        kind = path.suffix.removeprefix(".")
        if kind not in FORMATS:
            raise InputError(f"--out {path}: the name must end in one of .{', .'.join(FORMATS)}")
        refuse_existing("--out", path, force)
        (written,) = figures.save(figures.plot(loaded(logs), what), path.with_suffix(""), (kind,))
        click.echo(str(written))
