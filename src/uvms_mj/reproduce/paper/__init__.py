"""The paper's section 5, repeated: its runs, figures and claims."""

import csv
import io
import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from .. import Progress, publish, running

if TYPE_CHECKING:
    from ...scenario import Scenario
    from ..claims import Row
    from .runs import Runs


def repeat(
    out: str | os.PathLike,
    scenario: "Scenario | None" = None,
    gains: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    *,
    progress: Progress | bool | None = None,
    workers: int | None = None,
) -> "list[Row]":
    """Do what ``uvms-mj paper`` does: run everything, and write logs, figures, claims and report.html to a new folder.

    Args:
        out: the folder; it must not have the logs of an earlier call.
        scenario: the common settings; default: the paper's.
        gains: dotted keys of a law, by its name, ``{"fosm": {"controller.K_s": 24.0}}``.
        progress: True for a progress bar, or a function of the steps done and their total.
        workers: simultaneous runs; default: one per core.

    Returns the claims with their verdicts. Raises InputError if a run can't be done, or the folder has logs.
    """
    from ...errors import InputError
    from ...files import locked
    from ...scenario import Scenario
    from .runs import load, plan, run

    logs = Path(out, "logs")
    if logs.exists():
        raise InputError(f"{logs}: exists; choose another folder")
    jobs = plan(scenario or Scenario(), gains)
    with locked(logs), running(progress) as told:
        run(jobs, logs, told, workers)
    return write(Path(out), load(logs, jobs), lambda done, total: None)


def write(folder: Path, runs: "Runs", progress: Progress) -> "list[Row]":
    """Write figures, claims.csv, claims.json and report.html to a folder, from the runs. Returns the claims."""
    from ...studies import pages
    from ...views import figures
    from ..claims import judged
    from . import report
    from .claims import CLAIMS
    from .runs import LABELS

    rows = judged(CLAIMS, runs)
    drawn = figures.paper(runs.traces, runs.fine)
    for i, (name, figure) in enumerate(drawn.items()):
        progress(i, len(drawn))
        figures.save(figure, folder / name)
    dicts = [row.as_dict() for row in rows]
    table = io.StringIO()
    writer = csv.DictWriter(table, dicts[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(dicts)
    pages.write(folder / "claims.csv", table.getvalue())
    traces = {LABELS[name]: trace for name, trace in runs.traces.items()}
    pictures = [report.Picture(name, report.CAPTIONS[name], drawn[name]) for name in report.CAPTIONS]
    title = "Super-twisting impedance control: the paper’s section 5, run again"
    publish(folder, report.page(title, traces, pictures, rows), claims=dicts)
    return rows
