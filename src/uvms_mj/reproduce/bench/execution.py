"""The runs of the benchmark: a study for each law and task, one after the other on the same workers."""

import warnings
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...control import BUILT_IN
from ...engine.run import PlainPythonWarning
from ...engine.simulation import Simulation
from ...errors import Fault, InputError
from ...studies.pages import write
from ...studies.plan import Plan
from ...studies.pool.bundle import code
from ...studies.pool.executors import executor_of
from ...studies.study import Study
from .. import Progress
from . import results
from .task import LATEX, PAGE, RESULT, Entry, Task, identity

if TYPE_CHECKING:
    import pandas as pd

TUNED = "tuned"
"""Folder of the studies with tuned gains, in that of their law."""


@dataclass(frozen=True)
class Job:
    """A law on a task: its plan, or why it can't run there; its folder."""

    entry: Entry
    task: Task
    tuned: bool
    folder: Path
    plan: Plan | None
    reason: str = ""


def jobs(entries: Sequence[Entry], tasks: Sequence[Task], folder: Path, draws: int | None) -> list[Job]:
    """Every law on every task, and again where it has tuned gains. Raises InputError for a law that can't run on any
    task, and for tuned gains that can't."""
    found = []
    for entry in entries:
        mine = [_job(entry, task, folder, draws) for task in tasks]
        if all(job.plan is None for job in mine):
            reasons = list(dict.fromkeys(job.reason for job in mine))
            raise InputError(f"{entry.label}: can't run on any task: {reasons[0]}")
        for task in tasks:
            if task.name in entry.tuned:
                own = folder / entry.label / TUNED / task.name
                mine.append(Job(entry, task, True, own, entry.plan(task, draws, tuned=True)))
        found += mine
    return found


def _job(entry: Entry, task: Task, folder: Path, draws: int | None) -> Job:
    own = folder / entry.label / task.name
    try:
        return Job(entry, task, False, own, entry.plan(task, draws))
    except InputError as error:
        return Job(entry, task, False, own, None, "; ".join(dict.fromkeys(map(_reason, error.faults))))


def _reason(fault: Fault) -> str:
    """An error of a plan for readers who know the law, not the study file."""
    key = fault.key.removeprefix("laws[0].")
    return fault.message if key.startswith(("vary", "laws[0]", "name")) or not key else f"{key}: {fault.message}"


def warn_of_slow_laws(planned: Sequence[Job]) -> None:
    """Warn of each law of a user's that runs as plain Python: its runs take minutes in place of seconds."""
    first = {job.entry.label: job.plan for job in reversed(planned) if job.plan and job.entry.source not in BUILT_IN}
    for plan in first.values():
        with Simulation(plan.scenario(0), engine=plan.engine, looks=False) as sim:
            for note in sim.slow_stages:
                warnings.warn(note, PlainPythonWarning, stacklevel=2)


def execute(
    planned: Sequence[Job],
    folder: Path,
    told: Progress,
    workers: int | None,
    executor: Executor | None,
) -> dict[str, Any]:
    """Run what the folder lacks, and write the result, the page and the LaTeX table. Returns the result."""
    from .page import latex_table, page

    entries = list({job.entry.label: job.entry for job in planned}.values())
    tasks = list({job.task.name: job.task for job in planned}.values())
    total, before = sum(job.plan.runs for job in planned if job.plan), 0
    frames: dict[tuple[str, str, bool], pd.DataFrame] = {}
    with executor_of(executor, workers) as pool:
        for job in planned:
            if job.plan is None:
                continue

            def advance(what: str, done: int, failed: int, runs: int, before: int = before) -> None:
                told(before + done, total)

            study = Study(job.plan).run(job.folder, executor=pool, progress=advance)
            frames[job.entry.label, job.task.name, job.tuned] = study.frame
            before += job.plan.runs
    laws = [_law([job for job in planned if job.entry is entry], frames) for entry in entries]
    found = results.document(tasks, laws, code())
    write(folder / RESULT, results.text(found))
    write(folder / LATEX, latex_table(found))
    write(folder / PAGE, page(found, planned, frames, folder))
    return found


def _law(mine: Sequence[Job], frames: "Mapping[tuple[str, str, bool], pd.DataFrame]") -> dict[str, Any]:
    """A law in the result: label, identity, cells by task, and cells with tuned gains."""
    entry = mine[0].entry
    plan = next(job.plan for job in mine if job.plan is not None)
    knows = entry.source in BUILT_IN and BUILT_IN[entry.source].uses_truth
    found: dict[str, Any] = {"label": entry.label, "knows_the_truth": knows, **identity(plan)}
    found["tasks"] = {job.task.name: _cell(job, frames, knows) for job in mine if not job.tuned}
    if entry.tuned:
        found["tuned"] = {
            job.task.name: {"settings": dict(entry.tuned[job.task.name]), **_cell(job, frames, False)}
            for job in mine
            if job.tuned
        }
    return found


def _cell(job: Job, frames: "Mapping[tuple[str, str, bool], pd.DataFrame]", knows: bool) -> dict[str, Any]:
    if job.plan is None:
        return results.refused(job.reason)
    found = results.cell(job.task, frames[job.entry.label, job.task.name, job.tuned])
    return found | ({"truth": job.task.truth} if knows and job.task.truth else {})
