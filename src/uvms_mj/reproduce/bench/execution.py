"""The runs of the benchmark: of each law and task a ladder of levels, from the first one up to the first that the law
does not hold. A level is a study, whose draws run until the test of :mod:`.sequential` has its verdict."""

import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from ...control import BUILT_IN
from ...engine.simulation import Simulation
from ...engine.vehicle_run import PlainPythonWarning
from ...errors import Fault, InputError
from ...studies.bundle import code
from ...studies.pages import write
from ...studies.pool.executors import size_of
from ...studies.study import Study
from .. import Progress
from . import results
from .draws import Draws
from .latex import latex_table
from .page import page
from .task import LATEX, LEVELS, PAGE, RESULT, Entry, Job, Task, law_of

LEAST = 6
"""Draws that run at once: most levels that a law does not hold are decided by them."""


def jobs(entries: Sequence[Entry], tasks: Sequence[Task], folder: Path, draws: Draws, most: int) -> list[Job]:
    """Every law on every task. Raises InputError for a law that can't run on any task."""
    found = []
    for entry in entries:
        mine = [_job(entry, task, folder / entry.label / task.name, draws, most) for task in tasks]
        if all(job.first is None for job in mine):
            reasons = list(dict.fromkeys(job.reason for job in mine))
            raise InputError(f"{entry.label}: can't run on any task: {reasons[0]}")
        found += mine
    return found


def _job(entry: Entry, task: Task, folder: Path, draws: Draws, most: int) -> Job:
    try:
        return Job(entry, task, folder, draws, most, entry.plan(task, LEVELS[0], draws, most))
    except InputError as error:
        return Job(entry, task, folder, draws, most, None, "; ".join(dict.fromkeys(map(_reason, error.faults))))


def _reason(fault: Fault) -> str:
    """An error of a plan for readers who know the law, not the study file."""
    key = fault.key.removeprefix("laws[0].")
    return fault.message if key.startswith(("vary", "laws[0]", "name")) or not key else f"{key}: {fault.message}"


def warn_of_slow_laws(planned: Sequence[Job]) -> None:
    """Warn of each law of a user's that runs as plain Python: its runs take minutes in place of seconds."""
    first = {job.entry.label: job.first for job in reversed(planned) if job.first and job.entry.source not in BUILT_IN}
    for plan in first.values():
        with Simulation(plan.scenario(0), engine=plan.engine, looks=False) as sim:
            for note in sim.slow_stages:
                warnings.warn(note, PlainPythonWarning, stacklevel=2)


def execute(planned: Sequence[Job], folder: Path, told: Progress, pool: Executor, beside: str = "") -> dict[str, Any]:
    """Run what the folder lacks, and write the result, the page and the LaTeX table, both with the laws of the result
    ``beside``, if it is given. Returns the result. ``told`` is
    called with the levels that are done, and their number; a ladder that ends has done all of its levels."""
    entries = list({job.entry.label: job.entry for job in planned}.values())
    tasks = list({job.task.name: job.task for job in planned}.values())
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for i, job in enumerate(planned):

        def advance(levels: float, i: int = i) -> None:
            told(i * len(LEVELS) + levels, len(planned) * len(LEVELS))

        found[job.entry.label, job.task.name] = climbed(job, pool, advance)
        advance(len(LEVELS))
    laws = [_law([job for job in planned if job.entry is entry], found) for entry in entries]
    document = results.document(tasks, laws, code(), planned[0].draws, planned[0].most)
    write(folder / RESULT, results.text(document))
    shown = results.beside(document, beside) if beside else document
    write(folder / LATEX, latex_table(shown).text)
    write(folder / PAGE, page(shown, planned))
    return document


def climbed(job: Job, pool: Executor, advance: Callable[[float], None]) -> dict[str, Any]:
    """The ladder of a law on a task. ``advance`` is called with the levels that are done."""
    if job.first is None:
        return results.refused(job.reason)
    levels: dict[int, dict[str, Any]] = {}
    for level in LEVELS:
        levels[level] = _judged(job, level, pool, advance)
        if not levels[level]["held"]:
            break
    return results.ladder(levels)


def _judged(job: Job, level: int, pool: Executor, advance: Callable[[float], None]) -> dict[str, Any]:
    """The cell of a level. So many draws run at once as the pool has workers; the verdict does not depend on it."""
    study, until = Study(job.plan(level)), 0

    def progress(what: str, done: int, failed: int, runs: int) -> None:
        advance(level - 1 + done / (done + job.most))

    found = None
    while found is None:
        until = min(until + max(LEAST, size_of(pool)), job.most)
        study.run(job.level(level), executor=pool, progress=progress, until=until)
        found = results.cell(job.task, study.frame, job.most)
    return found


def _law(mine: Sequence[Job], found: dict[tuple[str, str], dict[str, Any]]) -> dict[str, Any]:
    """A law in the result: label, identity, and its ladders by task."""
    entry = mine[0].entry
    plan = next(job.first for job in mine if job.first is not None)
    law: dict[str, Any] = {"label": entry.label, "knows_the_truth": entry.knows, **entry.budget}
    law |= law_of(entry, plan)
    return law | {"tasks": {job.task.name: found[entry.label, job.task.name] for job in mine}}
