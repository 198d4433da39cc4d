"""One HTML page about any runs: numbers, figures, differences, versions."""

import os
from collections.abc import Mapping
from pathlib import Path

from ..records.trace import Trace
from ..studies import pages
from ..views import figures
from .paper import report

_CAPTIONS = {
    "position": "Position in W and its reference",
    "force": "Contact force",
    "sliding": "Sliding variable",
    "tau": "Thrust",
}
"""Captions of the figures of a page."""


def compare(traces: Mapping[str, Trace], path: str | os.PathLike) -> None:
    """Write the page that ``uvms-mj compare`` writes about runs, by their names in it. Raises InputError if the file
    can't be written."""
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
    pages.write(Path(path), report.page(f"{names}: {report.named(traces)}", traces, pictures))
