"""The runs of the benchmark: a study for each law and task, one after the other on the same workers.

The page: laws and tasks in one table, a table and the courses of the push for each task, the worst runs; and the
table as LaTeX, for the package booktabs.
"""

import math
import shlex
import warnings
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...analysis.hold import HOLD_S
from ...analysis.summary import COURSES, PARTS
from ...control import BUILT_IN
from ...control.task import Schedule
from ...engine.run import PlainPythonWarning
from ...engine.simulation import Simulation
from ...errors import Fault, InputError
from ...studies.bundle import code
from ...studies.pages import (
    Cell,
    Items,
    Page,
    Picture,
    Section,
    Table,
    Text,
    facts,
    given,
    keyed,
    marked,
    number,
    rendered,
    versions_of,
    write,
)
from ...studies.plan import Plan
from ...studies.plan.metrics import COMPLETED, unit_of_column, without_unit
from ...studies.pool.executors import executor_of
from ...studies.report.tables import latex
from ...studies.study import Study
from ...views import colours
from ...views.figures.style import GREY, LINE, SMALL, panels, styled
from .. import Progress
from . import results
from .results import broken
from .task import LATEX, PAGE, RESULT, Entry, Task, identity, with_bare_names

if TYPE_CHECKING:
    import pandas as pd


TUNED = "tuned"
"""Folder of the studies with tuned gains, in the folder of their law."""


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
            job.task.name: {"settings": with_bare_names(entry.tuned[job.task.name]), **_cell(job, frames, False)}
            for job in mine
            if job.tuned
        }
    return found


def _cell(job: Job, frames: "Mapping[tuple[str, str, bool], pd.DataFrame]", knows: bool) -> dict[str, Any]:
    if job.plan is None:
        return results.refused(job.reason)
    found = results.cell(job.task, frames[job.entry.label, job.task.name, job.tuned])
    return found | ({"truth": job.task.truth} if knows and job.task.truth else {})


def latex_table(found: Mapping[str, Any]) -> str:
    """Of each law and task the number of draws that the law passes, and below it the interval of their share; a dash
    where it can't run, with the reason below the table. It fits the width of a page of two columns, 7.16 in, at 10 pt.

    The heads are the numbers of the tasks; comments have their names, versions and the digest of the result.
    """
    tasks = found["tasks"]
    lines = [f"% {found['benchmark']}, result {found['digest']}: draws passed, 95 % interval of Wilson in per cent"]
    lines += [
        f"% {task['number']}: {name}, version {task['version']}, digest {task['digest']}"
        for name, task in tasks.items()
    ]
    space = f"@{{\\hspace{{{SPACE_PT}pt}}}}"
    lines += ["% \\usepackage{booktabs}", f"\\begin{{tabular}}{{l{f'{space}r' * len(tasks)}}}", "\\toprule"]
    lines += [" & ".join(["law", *(str(task["number"]) for task in tasks.values())]) + " \\\\", "\\midrule"]
    notes = []
    for key in ("tasks", "tuned"):
        rows = [law for law in found["laws"] if key in law]
        if key == "tuned" and rows:
            lines += ["\\midrule", f"\\multicolumn{{{1 + len(tasks)}}}{{l}}{{gains tuned for each task}} \\\\"]
        for law in rows:
            cells = [_texts(law[key].get(name)) for name in tasks]
            lines.append(" & ".join([_label(law["label"]), *(passed for passed, _ in cells)]) + " \\\\")
            lines.append(" & ".join(["", *(interval for _, interval in cells)]) + " \\\\")
            notes += [
                f"% {law['label']} on {name}: {' '.join(cell['reason'].split())}"
                for name, cell in law[key].items()
                if not cell["runs"]
            ]
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}", *notes]) + "\n"


SPACE_PT = 6
"""Space between the columns of the LaTeX table [pt]."""
LABEL_PT = 160
"""Width in which the labels of laws are set [pt]."""
_NARROW = frozenset("abcdefghijklnopqrstuvxyz0123456789 _-.,+=()")
"""Letters below 6 pt; others have at most 11 pt."""


def _label(label: str) -> str:
    """A label in LaTeX. A long one has several lines, and may be broken everywhere."""
    if sum(6 if letter in _NARROW else 11 for letter in label) <= LABEL_PT:
        return latex(label)
    broken = "\\allowbreak{}".join(map(latex, label))
    return f"\\parbox[t]{{{LABEL_PT}pt}}{{\\raggedright {broken}\\strut}}"


def _texts(cell: Mapping[str, Any] | None) -> tuple[str, str]:
    """The number of draws that are passed, and the interval of their share."""
    if cell is None or not cell["runs"]:
        return "--", ""
    low, high = (f"{100.0 * each:.0f}" for each in cell["interval"])
    return f"{cell['passed']}/{cell['draws']}", f"{{\\scriptsize {low}--{high}}}"


_COLUMNS, _HEIGHT = 5, 1.15
_TOP = 2.5
"""Top of a panel over the largest demanded push; a push above is drawn there."""
_CAPTION = (
    "Push over time. Line: median over the draws of the mean in each sixtieth of the run. Shade: from the least to the "
    "greatest push of all draws, at every step. Thin line: the failed draw with the largest error. Dashed: the "
    "demanded push. Grey: the hold, in which the push is judged. A push above the panel is drawn at its top."
)


def demanded(scenario: Any, t: np.ndarray) -> np.ndarray:
    """The demanded push |F_d| of a scenario at times t (n,) [N]."""
    impedance = scenario.impedance
    if not impedance.schedule:
        return np.full(len(t), np.linalg.norm(impedance.F_d[:3]))
    settings = SimpleNamespace(**Schedule().constants(SimpleNamespace(scenario=scenario)))
    out = SimpleNamespace(K_f=np.zeros(6), F_d=np.zeros(6))
    push = []
    for each in t:
        Schedule.step(settings, None, SimpleNamespace(t=each), None, out)
        push.append(float(np.linalg.norm(out.F_d[:3])))
    return np.array(push)


def courses(
    task: Task, jobs: "Mapping[str, Job]", rows: "Mapping[str, pd.DataFrame]", colours: Mapping[str, str]
) -> Picture | None:
    """The figure of a task; None if no law runs on it."""
    if not rows:
        return None
    some = next(iter(jobs.values())).plan
    assert some is not None
    duration = some.base.simulation.duration
    t = (np.arange(PARTS) + 0.5) * duration / PARTS
    push = demanded(some.base, t)
    top = _TOP * float(push.max())
    with styled():
        figure, drawn = panels(len(rows), _COLUMNS, 0.1, _HEIGHT, sharex=True, sharey=True)
        for ax, (label, frame) in zip(drawn, rows.items(), strict=True):
            mean, least, greatest = (_matrix(frame, name) for name in COURSES)
            ax.axvspan(duration - HOLD_S, duration, color=GREY, alpha=0.12, linewidth=0.0)
            if np.isfinite(mean).any():
                low, high = (np.clip(edge, 0.0, top) for edge in (_least(least), -_least(-greatest)))
                ax.fill_between(t, low, high, color=colours[label], alpha=0.25, linewidth=0.0)
                ax.plot(t, np.clip(_median(mean), 0.0, top), color=colours[label], linewidth=1.2 * LINE)
            worst = _worst(task, frame)
            if worst is not None:
                ax.plot(t, np.clip(mean[worst], 0.0, top), color="#000000", linewidth=0.5 * LINE)
            ax.plot(t, push, color="#000000", linestyle="--", linewidth=0.6 * LINE)
            ax.set_title(label, fontsize=SMALL, loc="left")
            ax.set_ylim(0.0, top)
            ax.set_xlim(0.0, duration)
        place = drawn[0].get_subplotspec()
        columns = place.get_gridspec().ncols if place is not None else 1
        for ax in drawn[-columns:]:  # also above the end of a row that is not full
            ax.tick_params(labelbottom=True)
        figure.supxlabel("time [s]", fontsize=SMALL)
        figure.supylabel("push [N]", fontsize=SMALL)
    return Picture(f"courses-{task.name}", _CAPTION, figure)


def _matrix(frame: "pd.DataFrame", name: str) -> np.ndarray:
    """(draws, parts) of a course."""
    columns = [f"{name}.{i:02d}" for i in range(PARTS)]
    return frame[columns].to_numpy(dtype=float)


def _least(values: np.ndarray) -> np.ndarray:
    return np.nanmin(np.where(np.isnan(values), np.inf, values), axis=0)


def _median(values: np.ndarray) -> np.ndarray:
    """Median of each column; nan where most values are missing."""
    return np.median(np.where(np.isnan(values), np.nan, values), axis=0)


def _worst(task: Task, frame: "pd.DataFrame") -> int | None:
    """The position of the failed draw with the largest error; None if none fails."""
    failed = [i for i, row in enumerate(frame.to_dict("records")) if broken(task, row)]
    if not failed:
        return None
    errors = frame["hold.error_N"].fillna(np.inf).to_numpy(dtype=float)
    return max(failed, key=lambda i: errors[i])


_STYLE = Path(__file__).with_name("bench.css")
_LEAD = "Draws that each law passes on each task, with one set of gains for all tasks."
_PASSED = (
    "A draw is passed if the run completes and meets every criterion of its task. The interval is Wilson’s, 95 %. "
    "There is no total: a mean over tasks would hide a failure."
)
_TUNED = "Gains of single tasks, which their author chose for them. They are not comparable with the table above."


def page(
    found: Mapping[str, Any],
    jobs: "Sequence[Job]",
    frames: "Mapping[tuple[str, str, bool], pd.DataFrame]",
    folder: Path,
) -> str:
    """The page as HTML."""
    tasks = {job.task.name: job.task for job in jobs}
    shown = dict(zip([law["label"] for law in found["laws"]], colours_of(found), strict=True))
    sections = [
        Section("passed", "Laws and tasks", [overview(found, tasks, "tasks", "Draws passed"), *truths(found, tasks)])
    ]
    tuned = overview(found, tasks, "tuned", "Draws passed with tuned gains")
    if tuned.rows:
        settings = [
            (f"{law['label']}, {task}", settings_text(cell["settings"]))
            for law in found["laws"]
            for task, cell in law.get("tuned", {}).items()
        ]
        sections.append(Section("tuned", "Tuned gains", [Text(_TUNED, "soft"), tuned, facts(settings)]))
    for name, task in tasks.items():
        own = {job.entry.label: job for job in jobs if job.task is task and not job.tuned and job.plan is not None}
        rows = {label: frames[label, name, False] for label in own}
        failed = worst(found, task, folder)
        parts = given(
            Text(task.reason),
            Items(task.literature, "sources"),
            criteria(task, max((len(frame) for frame in rows.values()), default=0)),
            table(found, task, "tasks").shown(task.title),
            *(
                Text(f"{law['label']} can’t run: {law['tasks'][name]['reason']}", "soft")
                for law in found["laws"]
                if not law["tasks"][name]["runs"]
            ),
            courses(task, own, rows, {label: shown[label] for label in own}),
            failed if failed.rows else None,
        )
        title = name.replace("_", " ")
        sections.append(Section(name, f"{task.number}. {task.title}", parts, link=f"{task.number} {title}"))
    sections += [
        Section("laws", "Laws", [facts((law["label"], about(law)) for law in found["laws"])]),
        Section("versions", "Versions", [versions_of(found["code"])]),
    ]
    title = f"{found['benchmark']}: {_counted(len(tasks), 'task')}, {_counted(len(found['laws']), 'law')}"
    lead = [Text(_LEAD, "lead"), Text(f"{_PASSED} Result {found['digest']}.", "soft")]
    return rendered(Page(title, lead, sections, [_STYLE]))


def _counted(n: int, noun: str) -> str:
    return f"{n} {noun}{'' if n == 1 else 's'}"


def colours_of(found: Mapping[str, Any]) -> list[str]:
    """A colour for each law."""
    return colours.hex_of_runs([law["name"] for law in found["laws"]])


def about(law: Mapping[str, Any]) -> str:
    """A law's name, its settings and its digest."""
    parts = [law["name"], settings_text(law["settings"]), settings_text(law["gains"]), f"digest {law['digest']}"]
    return "; ".join(part for part in parts if part)


def settings_text(settings: Mapping[str, Any]) -> str:
    """Settings in a line. A long list has its first numbers."""

    def value(x: Any) -> str:
        return f"[{x[0]}, ... {len(x)} numbers]" if isinstance(x, list) and len(x) > 8 else str(x)

    return ", ".join(f"{key} = {value(each)}" for key, each in settings.items())


def overview(found: Mapping[str, Any], tasks: Mapping[str, Task], key: str, label: str) -> Table:
    """The draws that each law passes on each task, with the interval. ``key`` is "tasks" or "tuned"."""
    shown = dict(zip([law["label"] for law in found["laws"]], colours_of(found), strict=True))
    heads = [
        marked('<strong>{}</strong><a href="#{}">{}</a>', task.number, task.name, task.name.replace("_", " "))
        for task in tasks.values()
    ]
    rows = [
        (
            keyed(shown[law["label"]], marked("{} <small>knows the truth</small>", law["label"]))
            if law["knows_the_truth"]
            else keyed(shown[law["label"]], law["label"]),
            [_draws_cell(law[key].get(name)) for name in tasks],
        )
        for law in found["laws"]
        if key in law
    ]
    return Table("law", heads, rows, "passed", label, style=f"min-width: {7 + 5.2 * len(tasks)}rem")


def truths(found: Mapping[str, Any], tasks: Mapping[str, Task]) -> list[Text]:
    """Sentences about the law that knows the truth, on tasks where it is not itself, or can't pass."""
    said: dict[str, list[str]] = {}
    for name, task in tasks.items():
        if any("truth" in law["tasks"][name] for law in found["laws"]):
            said.setdefault(task.truth, []).append(name.replace("_", " "))
    return [Text(f"* {', '.join(names)}: {sentence}", "soft") for sentence, names in said.items()]


def _draws_cell(cell: Mapping[str, Any] | None) -> Cell:
    if cell is None:
        return Cell("", "none")
    if not cell["runs"]:
        return Cell(marked("<strong>{}</strong>", "can’t run"), "none")
    share = cell["passed"] / cell["draws"]
    look = "all" if share == 1.0 else "most" if share > 0.5 else "some" if share > 0.0 else "no"
    mark = "*" if "truth" in cell else ""
    text = f"{cell['passed']}/{cell['draws']}{mark}"
    return Cell(marked("<strong>{}</strong><small>{}</small>", text, interval(cell)), look)


def interval(cell: Mapping[str, Any]) -> str:
    """The interval of a share [%]."""
    low, high = cell["interval"]
    return f"{100.0 * low:.0f} to {100.0 * high:.0f} %"


def criteria(task: Task, draws: int) -> Table:
    """Each criterion: what it bounds, its bounds, and why."""
    rows = [
        (marked("<code>{}</code>", name), [bounds(name, limit), task.why[name]])
        for name, limit in task.criteria.items()
    ]
    caption = f"Passed if the run completes and meets these, version {task.version}, {draws} draws"
    return Table("metric", ["bounds", "why"], rows, "criteria", "Criteria", caption)


def bounds(name: str, limit: Sequence[float]) -> str:
    """The bounds of a criterion with their unit."""
    low, high = limit
    unit = unit_of_column(name)
    unit = f" {unit}" if unit else ""
    if low == high:
        return f"{number(low)}{unit}"
    return f"at most {number(high)}{unit}" if low == 0.0 else f"{number(low)} to {number(high)}{unit}"


def table(found: Mapping[str, Any], task: Task, key: str) -> Table:
    """The numbers of each law on a task."""
    heads = [
        *("passed", "error, median [N]", "error, worst [N]", "peak, worst [N]", "settling, median [s]"),
        *("contact lost, worst [s]", "effort, median [N² s]", "chatter, median [N/s]", "failed by"),
    ]
    rows = []
    for law in found["laws"]:
        cell = law[key].get(task.name)
        if cell is None:
            continue
        if not cell["runs"]:
            rows.append((law["label"], ["can’t run", *[""] * (len(heads) - 1)]))
            continue
        spread = cell["metrics"]
        places = [
            *(("hold.error_N", "median"), ("hold.error_N", "worst"), ("contact.peak_N", "worst")),
            *(("contact.settling_s", "median"), ("hold.lost_s", "worst"), ("effort_N2s", "median")),
            ("chattering_N_per_s", "median"),
        ]
        numbers = [short(spread[name], which) for name, which in places]
        broke = [f"{without_unit(name).rpartition('.')[2]} {n}" for name, n in cell["broke"].items() if n]
        rows.append((law["label"], [f"{cell['passed']}/{cell['draws']}", *numbers, ", ".join(broke)]))
    return Table("law", heads, rows)


def short(spread: Mapping[str, Any], which: str) -> str:
    """A number of a table; "never" where it is missing."""
    value = spread[which]
    return "never" if value is None else number(value, 3)


def worst(found: Mapping[str, Any], task: Task, folder: Path) -> Table:
    """Of each law its failed draw with the largest error, and the command that repeats it."""
    rows = []
    for law in found["laws"]:
        cell = law["tasks"][task.name]
        failed = [row for row in cell.get("rows", ()) if not row["passed"]]
        if failed:
            row = max(failed, key=lambda row: math.inf if row["hold.error_N"] is None else row["hold.error_N"])
            place = shlex.quote(str(folder / law["label"] / task.name))
            command = f"uvms-mj run --from {place} --row {row['draw']} --out again"
            rows.append((law["label"], [str(row["draw"]), why(row, task), marked("<code>{}</code>", command)]))
    return Table("law", ["draw", "its worst failed draw", "again"], rows, "worst", "Worst draws")


def why(row: Mapping[str, Any], task: Task) -> str:
    """What broke a draw, with its numbers."""
    if row["broke"] == [COMPLETED]:
        return f"{row['status']}: {row.get('message', '')}"
    parts = []
    for name in row["broke"]:
        value = "missing" if row[name] is None else f"{number(row[name], 3)} {unit_of_column(name)}".rstrip()
        parts.append(f"{without_unit(name)} {value} ({bounds(name, task.criteria[name])})")
    return ", ".join(parts)
