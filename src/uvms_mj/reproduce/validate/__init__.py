"""Runs that are compared with measurements in a pool."""

import os
from pathlib import Path
from typing import Any

from .. import PAGE as PAGE
from .. import Progress, publish, running


def repeat(
    data: str | os.PathLike,
    out: str | os.PathLike,
    *,
    progress: Progress | bool | None = None,
    workers: int | None = None,
) -> dict[str, Any]:
    """Do what ``uvms-mj validate pool`` does: simulate each trial of a folder of records, and write report.html and
    numbers.json to the folder ``out``.

    ``progress`` is True for a progress bar, or a function of the runs done and their total; ``workers`` is the number
    of processes, by default one per core. Returns the numbers. Raises InputError if the records are not valid.
    """
    from ...files import locked
    from ...records.header import versions
    from ...studies.pool.executors import executor_of
    from .data import records
    from .page import numbers, page
    from .results import compute

    trials, resting = records(str(data))
    folder = Path(out)
    with (
        locked(folder),
        running(progress) as told,
        executor_of(None, workers) as executor,
    ):
        results = compute(trials, resting, executor, told)
        found = numbers(results)
        publish(folder, page(results, versions()), numbers=found)
    return found
