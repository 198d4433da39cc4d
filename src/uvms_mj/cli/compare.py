"""``uvms-mj compare``: one HTML page for any logs."""

from pathlib import Path

import click

from .common import bad_input, command, draw_to_files, force_option, path_option, refuse_existing
from .logs import loaded


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
        pictures = [
            report.Picture(what, f"{caption}: {report.named(traces)}.", figures.plot(traces, what))
            for what, caption in captions.items()
            if what != "sliding" or any("s" in trace.arrays for trace in traces.values())
        ]
        names = ", ".join(dict.fromkeys(trace.scenario.name for trace in traces.values()))
        pages.write(Path(out), report.page(f"{names}: {report.named(traces)}", traces, pictures))
        click.echo(out)


_CAPTIONS = {
    "position": "Position in W and its reference",
    "force": "Contact force",
    "sliding": "Sliding variable",
    "tau": "Thrust",
}
