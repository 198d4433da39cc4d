"""Pictures of logs: ``uvms-mj plot``, ``compare`` and ``video``."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import Stop, bad_input, draw_to_files, end, exit_interrupted, printable, progress_bar, refuse_existing
from .logs import loaded
from .options import command, force_option, names_in, number, path_option

if TYPE_CHECKING:
    from ..records.trace import Trace


WHATS = ("position", "attitude", "velocity", "force", "sliding", "tau", "thrusters", "integral", "joints", "summary")
"""The choices of :mod:`uvms_mj.views.figures`, repeated here because its import is too slow for ``--help``."""
FORMATS = ("png", "svg", "pdf", "pgf")
FONTS = ("sans", "serif", "cm", "latex")


label_option = click.option(
    "--label",
    "labels",
    multiple=True,
    metavar="NAME=TEXT",
    help="TEXT in place of the name of a law or of another name that stands there; may be repeated.",
)


def labels_in(words: Sequence[str]) -> dict[str, str]:
    """The texts by name of the option ``--label``. Raises InputError for one without a name or a text."""
    from ..errors import InputError

    found: dict[str, str] = {}
    for word in words:
        name, _, text = word.partition("=")
        if not (name and text.strip()):
            raise InputError(f"--label {word}: write NAME=TEXT")
        if name in found:
            raise InputError(f"--label {word}: {name} has the text {found[name]!r} already")
        found[name] = text
    return found


def figure_options(function: Any) -> Any:
    """Options of the commands that draw figures: formats, size, fonts, labels, file."""
    for option in (
        force_option,
        path_option("-o", "--out", metavar="FILE", help=f"Output file, .{', .'.join(FORMATS)}."),
        click.option(
            "--fonts",
            default="sans",
            show_default=True,
            metavar="NAME",
            help="sans, serif (Times), cm (Computer Modern), or latex: LaTeX sets the texts of a pdf or pgf.",
        ),
        label_option,
        click.option("--height", metavar="HEIGHT", help="A length, 60mm [default: by the panels]."),
        click.option(
            "--width",
            metavar="WIDTH",
            help="column (252pt of TeX) or page (516pt), as IEEE has them, also by the names ieee-column, ieee-page; "
            "elsevier-column, -middle, -page (90, 140, 190mm); or a length in in, cm, mm or pt of TeX: 88mm.",
        ),
        click.option(
            "--format",
            "kinds",
            multiple=True,
            metavar="NAME[,NAME]",
            help=f"{', '.join(FORMATS)}; several write a file each [default: by FILE's ending, or png].",
        ),
    ):
        function = option(function)
    return function


def figure_files(kinds: Sequence[str], out: str | None, default: Path, force: bool) -> tuple[Path, list[str]]:
    """The path without ending and the formats of a figure. Raises InputError if they do not fit, or a file exists."""
    from ..errors import InputError

    names = names_in("--format", kinds)
    for each in names:
        if each not in FORMATS:
            raise InputError(f"--format {each}: choose from {', '.join(FORMATS)}")
    path = Path(out) if out is not None else default
    ending = path.suffix.removeprefix(".")
    if out is not None and ending not in FORMATS:
        raise InputError(f"--out {path}: the name must end in one of .{', .'.join(FORMATS)}")
    if out is not None and names and ending not in names:
        raise InputError(f"--out {path}: does not fit --format {','.join(names)}; the name must end in .{names[0]}")
    stem = path.with_name(path.stem) if out is not None else default
    chosen = list(dict.fromkeys(names)) or [ending if out is not None else "png"]
    for each in chosen:
        refuse_existing("--out", stem.with_name(f"{stem.name}.{each}"), force)
    return stem, chosen


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
@figure_options
def plot(
    logs: tuple[str, ...],
    whats: tuple[str, ...],
    start: str | None,
    end: str | None,
    kinds: tuple[str, ...],
    width: str | None,
    height: str | None,
    labels: tuple[str, ...],
    fonts: str,
    out: str | None,
    force: bool,
) -> None:
    """Plot a log, or several logs on the same axes, each in the colour of its law. Without --out the file is NAME.png
    beside the first LOG.

    In a plot of the force, "expected" is K_x (x_d - x_c), for a rigid wall, and "analytic" the law's closed form of the
    force at rest at this wall. A .pgf, and a .pdf with --fonts latex, need a LaTeX. uvms-mj info LOG lists the recorded
    signals.

    \b
    uvms-mj plot results/run.mcap
    uvms-mj plot results/run.mcap --what force --out force.svg
    uvms-mj plot results/run.mcap --what tau.x,p_WB --from 5 --to 6 --width 12cm
    uvms-mj plot gsta/run.mcap fosm/run.mcap --what tau
    uvms-mj plot results/run.mcap --what force --format pdf,pgf --width column --height 50mm --fonts cm
    """
    draw_to_files()
    with bad_input():
        from ..studies.report.data import refuse_unknown
        from ..views import figures

        names = names_in("--what", whats) or ["summary"]
        beside = Path(logs[0])
        default = (beside if beside.is_dir() else beside.parent) / "_".join(names)[:60]
        stem, formats = figure_files(kinds, out, default, force)
        given, words = loaded(logs), labels_in(labels)
        refuse_unknown(words, list(given), list(given))
        traces = {words.get(label, label): _between(label, trace, start, end) for label, trace in given.items()}
        for written in figures.save(figures.plot(traces, names, width, fonts, height), stem, formats):
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
    """Write one HTML page about one or several logs: numbers, figures, differences, versions. It prints which signals
    of logs with the same times differ from the first log.

    \b
    uvms-mj compare gsta/run.mcap fosm/run.mcap
    uvms-mj compare runs/*/run.mcap --out monday.html
    uvms-mj compare results/run.mcap dive.toml          beside the log of a real vehicle
    """
    draw_to_files()
    with bad_input():
        from ..errors import InputError

        if Path(out).suffix.lower() not in (".html", ".htm"):
            raise InputError(f"--out {out!r}: the name must end in .html")
        refuse_existing("--out", Path(out), force)
        from ..reproduce.paper.report import compare as write

        traces = loaded(logs)
        write(traces, out)
    (first, to), *others = traces.items()
    for label, trace in others:
        if (apart := trace.apart(to)) is not None:
            click.echo(printable(f"{label} and {first}: {_of_signals(apart, len({*trace} & {*to}))}"))
    click.echo(out)


def _of_signals(apart: "Sequence[str]", n: int) -> str:
    """A sentence about signals that differ, of n."""
    if not apart:
        return f"all {n} signals equal, bit for bit"
    return f"{len(apart)} of {n} signals differ: {', '.join(apart[:3])}{', ...' if len(apart) > 3 else ''}"


VIDEOS = ("mp4", "gif", "png")
VIEWS = ("overview", "side", "top", "behind", "close", "follow", "surface")
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
        if kind not in VIDEOS:
            raise InputError(f"--out {path}: the name must end in one of .{', .'.join(VIDEOS)}")
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
        traces = {name: each.between(low, high) for name, each in loaded((log,)).items()}
        trace = traces if len(traces) > 1 else next(iter(traces.values()))
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
