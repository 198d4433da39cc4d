"""Practicality: the paper's laws on a real vehicle, from ideal to real along each axis."""

import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from .. import PAGE as PAGE
from .. import Progress, publish, running

if TYPE_CHECKING:
    from ..claims import Row
    from .results import Results


def repeat(
    out: str | os.PathLike,
    overrides: Mapping[str, Any] = MappingProxyType({}),
    *,
    progress: Progress | bool | None = None,
    workers: int | None = None,
) -> "list[Row]":
    """Do what ``uvms-mj practicality`` does: run all studies, and write claims.json and report.html to the folder.
    Called again after an interruption, it goes on.

    Args:
        out: the folder.
        overrides: dotted keys with values, of all studies.
        progress: True for a progress bar, or a function of the runs done and their total.
        workers: processes; default: one per core.

    Returns the claims with their verdicts. Raises InputError if an override is invalid, or the folder has other
    studies.
    """
    from ...records.header import versions
    from ..claims import judged
    from .page import page
    from .results import CLAIMS

    folder = Path(out)
    with running(progress) as told:
        results = _run(folder, overrides, told, workers)
    rows = judged(CLAIMS, results)
    publish(folder, page(results, rows, versions()), claims=[row.as_dict() for row in rows])
    return rows


def _run(folder: Path, overrides: Mapping[str, Any], told: Progress, workers: int | None) -> "Results":
    """Run what the folder lacks of all studies."""
    from ...studies.pool.executors import executor_of
    from ...studies.study import Study
    from .results import Results, plans

    planned = plans(dict(overrides))
    total, before, frames = sum(plan.runs for plan in planned.values()), 0, {}
    with executor_of(None, workers) as pool:
        for name, plan in planned.items():

            def advance(_: str, done: int, failed: int, runs: int, before: int = before) -> None:
                told(before + done, total)

            frames[name] = Study(plan).run(folder / name, executor=pool, progress=advance).frame
            before += plan.runs
    return Results(planned, frames)
