"""Contact-10: ten tasks of contact under water that laws are measured on, by the same numbers for everybody."""

import os
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...files import locked
from .. import Progress, running
from .task import LATEX as LATEX
from .task import PAGE as PAGE
from .task import RESULT as RESULT
from .task import Entry, chosen, entries_of, tasks


def bench(
    laws: Sequence[str | Entry] = (),
    out: str | os.PathLike = "runs/bench",
    *,
    only: Sequence[str] = (),
    draws: int | None = None,
    progress: Progress | bool | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
) -> dict[str, Any]:
    """Do what ``uvms-mj bench`` does: run what the folder lacks, write bench.json, report.html and table.tex to it, and
    return the contents of bench.json. Called again after an interruption, it goes on.

    Args:
        laws: as on the command line, ``["gsta", "controller.k_1=8", "my_law.py:MyLaw"]``, or entries; default: all
            shipped laws.
        out: the folder.
        only: names of tasks; default: all ten.
        draws: the first draws of each task, for a look; default: all.
        progress: True for a progress bar, or a function of the runs done and their total.
        workers: processes on this machine; default: one per core.
        executor: in place of them, as in :meth:`uvms_mj.studies.study.Study.run`.

    Raises InputError if a law can't run on any task, or the folder has other runs.
    """
    from .execution import execute, jobs, warn_of_slow_laws

    entries = [law for law in laws if isinstance(law, Entry)]
    words = [law for law in laws if not isinstance(law, Entry)]
    entries += entries_of(words, tasks()) if words or not entries else []
    folder, some = Path(out), chosen(only)
    if draws is not None and not 1 <= draws <= min(task.draws for task in some):
        raise InputError(f"draws: {draws} must be from 1 to {min(task.draws for task in some)}")
    planned = jobs(entries, some, folder, draws)
    warn_of_slow_laws(planned)
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder), running(progress) as told:
        return execute(planned, folder, told, workers, executor)
