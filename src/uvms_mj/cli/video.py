"""``uvms-mj video``: a moving picture of a log, or a still one."""

from pathlib import Path

import click

from .common import bad_input, draw_to_files, end, progress_bar, refuse_existing
from .logs import loaded
from .options import command, force_option, names_in, number, path_option
from .stop import Stop, exit_interrupted

FORMATS = ("mp4", "gif", "png")
VIEWS = ("overview", "side", "top", "behind", "close", "follow")
"""Endings and views of :mod:`uvms_mj.views.video`, repeated here because its import is too slow for ``--help``."""


@command()
@click.argument("log", metavar="LOG")
@path_option("-o", "--out", metavar="FILE", help="Output file, .mp4, .gif or .png [default: run.mp4 beside LOG].")
@click.option("--speed", metavar="FACTOR", default="1", show_default=True, help="Simulated seconds per second.")
@click.option("--from", "start", metavar="SECONDS", help="Begin at this time [default: the start].")
@click.option("--to", "until", metavar="SECONDS", help="End at this time [default: the end].")
@click.option("--at", metavar="SECONDS", help="Of a .png: its time [default: the end].")
@click.option(
    "--view",
    metavar="NAME",
    default="overview",
    show_default=True,
    help=f"Camera: {', '.join(VIEWS)}; or AZIMUTH,ELEVATION[,DISTANCE] in degrees and m, such as 74,-20,2.5.",
)
@click.option(
    "--plots",
    "plots",
    multiple=True,
    metavar="NAME[,NAME]",
    help="Plots beside the scene: the quantities and signals of uvms-mj plot, or none "
    "[default: force,position,sliding].",
)
@click.option("--size", metavar="WxH", help="Pixels, even numbers [default: 1280x720; of a GIF 800x450].")
@click.option("--fps", metavar="HZ", help="Pictures per second [default: 30; of a GIF 15].")
@force_option
def video(
    log: str,
    out: str | None,
    speed: str,
    start: str | None,
    until: str | None,
    at: str | None,
    view: str,
    plots: tuple[str, ...],
    size: str | None,
    fps: str | None,
    force: bool,
) -> None:
    """Make a video of a log: the scene under water, with arrows of the contact force and the current, and plots that
    grow beside it. A FILE that ends in .png is one picture.

    Of the forces between two pictures the largest is shown. It draws without a window, also without a display.
    Videos need pip install 'uvms-mj[video]', which brings ffmpeg; a PNG does not.

    \b
    uvms-mj video results/run.mcap --out push.mp4
    uvms-mj video results/run.mcap --out push.gif --from 1 --to 10 --speed 2
    uvms-mj video results/run.mcap --out impact.mp4 --from 5 --to 6.5 --speed 0.1 --view close --plots force,tau.x
    uvms-mj video results/run.mcap --out phone.mp4 --size 720x1280 --view follow
    uvms-mj video results/run.mcap --out rest.png --at 12.5 --plots none --view 60,-15,1.5
    """
    stop = Stop()
    draw_to_files()
    with bad_input():
        from ..errors import InputError

        path = Path(out) if out is not None else Path(log).with_suffix(".mp4")
        kind = path.suffix.lower().removeprefix(".")
        if kind not in FORMATS:
            raise InputError(f"--out {path}: the name must end in one of .{', .'.join(FORMATS)}")
        if kind != "png" and at is not None:
            raise InputError("--at is for a .png; --from and --to choose the part of a video")
        refuse_existing("--out", path, force)
        pixels = None if size is None else _pixels(size)
        names = [] if plots == ("none",) else names_in("--plots", plots) if plots else None
        rate = number("--speed", speed, "s/s", 1e-3, 1e3)
        frames = None if fps is None else number("--fps", fps, "Hz", 1.0, 240.0)
        low = None if start is None else number("--from", start, "s", 0.0, 1e7)
        high = None if until is None else number("--to", until, "s", 0.0, 1e7)
        instant = None if at is None else number("--at", at, "s", 0.0, 1e7)
        (trace,) = loaded((log,)).values()
        trace = trace.between(low, high)
        from ..views import video as views

        if kind == "png":
            from ..files import atomic_write

            picture = views.still(trace, instant, view=view, plots=names, size=pixels or views.SIZE)
            with atomic_write(path) as part:
                picture.save(part, optimize=True)
        else:
            try:
                with progress_bar("drawing", False, stop, "{done} of {total} pictures") as bar:
                    views.video(trace, path, speed=rate, view=view, plots=names, size=pixels, fps=frames, progress=bar)
            except KeyboardInterrupt:
                end("interrupted", exit_interrupted())
        click.echo(str(path))


def _pixels(size: str) -> tuple[int, int]:
    from ..errors import InputError

    width, x, height = size.lower().partition("x")
    if not (x and width.isdecimal() and height.isdecimal()):
        raise InputError(f"--size {size}: give width and height in pixels, 1280x720")
    return int(width), int(height)
