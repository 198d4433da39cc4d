"""Contact-10: ten tasks of contact under water that laws are measured on, by the same numbers for everybody."""

import os
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from ...errors import InputError, shortened
from ...files import locked
from ...studies.pool.executors import executor_of
from .. import Progress, running
from .draws import DEVELOPMENT, Draws
from .results import refuse_other_tasks
from .sequential import MOST as MOST
from .task import LATEX as LATEX
from .task import PAGE as PAGE
from .task import RESULT as RESULT
from .task import Entry, chosen, entries_of, tasks


def bench(
    laws: Sequence[str | Entry] = (),
    out: str | os.PathLike = "runs/bench",
    *,
    only: Sequence[str] = (),
    draws: str = DEVELOPMENT,
    at_most: int = MOST,
    tune: int = 0,
    beside: str = "",
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
        draws: ``"development"``, the known draws; ``"secret:FILE"`` or ``"seed:NUMBER"``, blind ones.
        at_most: draws of each level after which the test is cut; with fewer than 60, for a look, its errors are larger.
        tune: trials of a search for gains, for each law; the law is then judged with its own gains and with the best.
        beside: another result, whose laws table.tex and report.html have below these: ``"shipped"``, a file or a
            folder, ``"FILE:LAW"``. It must have the same tasks.
        progress: True for a progress bar, or a function of the levels done and their total, before them of the trials.
        workers: processes on this machine; default: one per core.
        executor: in place of them, as in :meth:`uvms_mj.studies.study.Study.run`.

    Raises InputError if a law can't run on any task, or the folder has other runs.
    """
    from .execution import execute, jobs, warn_of_slow_laws
    from .tuning import tuned_laws

    entries = [law for law in laws if isinstance(law, Entry)]
    words = [law for law in laws if not isinstance(law, Entry)]
    entries += entries_of(words, tasks()) if words or not entries else []
    folder, some, drawn = Path(out), chosen(only), Draws.parsed(draws)
    if not 1 <= at_most <= MOST:
        raise InputError(f"at_most: {shortened(at_most)} must be from 1 to {MOST}")
    planned = jobs(entries, some, folder, drawn, at_most)
    refuse_other_tasks(beside, {task.name: {"version": task.version, "digest": task.digest} for task in some})
    warn_of_slow_laws(planned)
    with locked(folder), running(progress) as told, executor_of(executor, workers) as pool:
        if tune:
            entries = tuned_laws(entries, some, folder, tune, pool, told)
            planned = jobs(entries, some, folder, drawn, at_most)
        return execute(planned, folder, told, pool, beside)
