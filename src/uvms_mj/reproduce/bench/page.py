"""The page of the benchmark: the level that each law holds on each task, the laws of each task in their order, a table
and the courses of the push for each task, and the worst runs."""

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...analysis.summary import NUMBERS
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
)
from ...studies.plan.metrics import COMPLETED, unit_of_column, without_unit
from ...studies.results import frame
from .draws import DEVELOPMENT
from .figures import ORDER, colours_of, courses, order
from .results import decided, drawn, ended, levels_of, may_compare
from .sequential import HELD, NOT_HELD, chance
from .task import LEVELS, Job, Task

if TYPE_CHECKING:
    import pandas as pd


_STYLE = Path(__file__).with_name("bench.css")
_LEAD = "The level of difficulty that each law holds on each task, with one set of gains for all tasks."


def _explained(found: Mapping[str, Any]) -> str:
    """The verdict and its errors, in a paragraph."""
    most = found["draws"]["most"]
    wrong, missed = chance(NOT_HELD, most)[0], 1.0 - chance(HELD, most)[0]
    return (
        "A draw is passed if the run completes and meets every criterion of its task. A level is held by Wald’s "
        f"sequential test of {HELD:.0%} of passed draws against {NOT_HELD:.0%}, at most {most} draws: a law that "
        f"passes {NOT_HELD:.0%} is said to hold it with a probability of {wrong:.1%}, and a law that passes {HELD:.0%} "
        f"is not with {missed:.1%}. A law climbs from level 1 to the first level that it does not hold. Small: draws "
        "passed at the level that it holds, and at the next. There is no total: a mean over tasks would hide a "
        f"failure. These are {drawn(found)}."
    )


_KNOWN = (
    "Gains that were chosen on known draws look better on them than they are. A result to publish has blind draws: "
    "--draws secret:FILE or seed:NUMBER, given after the law and its gains are fixed."
)


def page(found: Mapping[str, Any], jobs: Sequence[Job]) -> str:
    """The page as HTML."""
    tasks = {job.task.name: job.task for job in jobs}
    shown = dict(zip([law["label"] for law in found["laws"]], colours_of(found), strict=True))
    known = found["draws"]["kind"] == DEVELOPMENT
    sections = [
        Section(
            "held",
            "Laws and tasks",
            given(
                overview(found, tasks),
                _beside(found),
                Text(_KNOWN, "warning") if known else None,
                Picture("order", ORDER, order(found, shown)),
            ),
        )
    ]
    for name, task in tasks.items():
        own = {job.entry.label: job for job in jobs if job.task is task and job.first is not None}
        failed = worst(found, task, own)
        parts = given(
            Text(task.reason),
            Items(task.literature, "sources"),
            levels(task),
            criteria(task),
            table(found, task).shown(task.title),
            *(
                Text(f"{law['label']} can’t run: {law['tasks'][name]['reason']}", "soft")
                for law in found["laws"]
                if not law["tasks"][name]["runs"]
            ),
            _courses(found, task, own, shown) if own else None,
            Text(f"The law that is told the truth: {task.truth}", "soft") if task.truth else None,
            failed if failed.rows else None,
        )
        title = name.replace("_", " ")
        sections.append(Section(name, f"{task.number}. {task.title}", parts, link=f"{task.number} {title}"))
    sections += [
        Section("laws", "Laws", [facts((law["label"], about(law)) for law in found["laws"])]),
        Section("versions", "Versions", [versions_of(found["code"])]),
    ]
    title = f"{found['benchmark']}, version {found['version']}: "
    title += f"{_counted(len(tasks), 'task')}, {_counted(len(found['laws']), 'law')}"
    lead = [Text(_LEAD, "lead"), Text(f"{_explained(found)} Result {found['digest']}.", "soft")]
    return rendered(Page(title, lead, sections, [_STYLE]))


def _beside(found: Mapping[str, Any]) -> Text | None:
    """Which rows are another result's, in a paragraph."""
    if "beside" not in found:
        return None
    also = found["beside"]
    laws = ", ".join(also["labels"])
    said = f"Rows of another result, {also['result']}: {laws}. They are of {drawn(also)}, and have no push over time."
    return Text(f"{said} {may_compare(also)}", "soft")


def _courses(found: Mapping[str, Any], task: Task, own: Mapping[str, Job], shown: Mapping[str, str]) -> Picture:
    ladders = {law["label"]: law["tasks"][task.name] for law in found["laws"] if law["label"] in own}
    last = {label: max(ladder["levels"]) for label, ladder in ladders.items()}
    titles = {label: f"{label}, level {last[label]}" for label in own}
    rows = {
        titles[label]: _judged(frame(job.level(int(last[label]))), ladders[label], last[label])
        for label, job in own.items()
    }
    base = next(iter(own.values())).first
    assert base is not None
    return courses(task, base.base, rows, {titles[label]: shown[label] for label in own})


def _judged(rows: "pd.DataFrame", ladder: Mapping[str, Any], level: str) -> "pd.DataFrame":
    """The draws that decided a level."""
    return rows.iloc[: ladder["levels"][level]["draws"]]


def _counted(n: int, noun: str) -> str:
    return f"{n} {noun}{'' if n == 1 else 's'}"


def about(law: Mapping[str, Any]) -> str:
    """A law's name, its settings, the trials that chose them, and its digest."""
    parts = [law["name"], settings_text(law["settings"]), settings_text(law["gains"])]
    parts += [f"the best of {law['trials']} trials" if law.get("trials") else "", f"digest {law['digest']}"]
    return "; ".join(part for part in parts if part)


def settings_text(settings: Mapping[str, Any]) -> str:
    """Settings in a line. A long list has its first numbers."""

    def value(x: Any) -> str:
        return f"[{x[0]}, ... {len(x)} numbers]" if isinstance(x, list) and len(x) > 8 else str(x)

    return ", ".join(f"{key} = {value(each)}" for key, each in settings.items())


def overview(found: Mapping[str, Any], tasks: Mapping[str, Task]) -> Table:
    """The level that each law holds on each task, and the draws that decided it."""
    shown = dict(zip([law["label"] for law in found["laws"]], colours_of(found), strict=True))
    heads = [
        marked('<strong>{}</strong><a href="#{}">{}</a>', task.number, task.name, task.name.replace("_", " "))
        for task in tasks.values()
    ]
    rows = [
        (
            keyed(shown[law["label"]], marked("{} <small>is told the truth</small>", law["label"]))
            if law["knows_the_truth"]
            else keyed(shown[law["label"]], law["label"]),
            [_level_cell(law["tasks"][name]) for name in tasks],
        )
        for law in found["laws"]
    ]
    return Table("law", heads, rows, "passed", "Level held, of 5", style=f"min-width: {7 + 5.2 * len(tasks)}rem")


def _level_cell(ladder: Mapping[str, Any]) -> Cell:
    if not ladder["runs"]:
        return Cell(marked("<strong>{}</strong>", "can’t run"), "none")
    counts = [
        f"{cell['passed']}/{cell['draws']}" for level, cell in ladder["levels"].items() if int(level) >= ladder["level"]
    ]
    return Cell(
        marked("<strong>{}</strong><small>{}</small>", ladder["level"], ", ".join(counts)), f"level-{ladder['level']}"
    )


def levels(task: Task) -> Table:
    """Each level of a task, and its difficulty."""
    return Table(
        "level",
        ["difficulty"],
        [(str(i), [text]) for i, text in zip(LEVELS, task.levels, strict=True)],
        "levels",
        "Levels",
    )


def criteria(task: Task) -> Table:
    """Each criterion: its metric, its bounds, and the reason for them."""
    rows = [
        (marked("<code>{}</code>", name), [bounds(name, limit), task.why[name]])
        for name, limit in task.criteria.items()
    ]
    caption = f"A draw is passed if the run completes and meets these, version {task.version}"
    return Table("metric", ["bounds", "why"], rows, "criteria", "Criteria", caption)


def bounds(name: str, limit: Sequence[float]) -> str:
    """The bounds of a criterion with their unit."""
    low, high = limit
    unit = unit_of_column(name)
    unit = f" {unit}" if unit else ""
    if low == high:
        return f"{number(low)}{unit}"
    return f"at most {number(high)}{unit}" if low == 0.0 else f"{number(low)} to {number(high)}{unit}"


def table(found: Mapping[str, Any], task: Task) -> Table:
    """The numbers of each law on a task, at the level that it holds, or at level 1; and what ended its ladder."""
    heads = [
        *("level", "passed", "error, median [N]", "bias, median [N]", "peak, worst [N]", "effort, median [N² s]"),
        *("over ideal’s", "chatter, median [N/s]", "at limits, worst [s]", "of the bounds", "the next level fails by"),
    ]
    ideal = next((law["tasks"][task.name] for law in found["laws"] if law["knows_the_truth"]), None)
    rows = []
    for law in found["laws"]:
        ladder = law["tasks"].get(task.name)
        if ladder is None:
            continue
        if not ladder["runs"]:
            rows.append((law["label"], ["can’t run", *[""] * (len(heads) - 1)]))
            continue
        level, cell = decided(ladder)
        spread = cell["metrics"]
        numbers = [
            *(short(spread[name], "median") for name in ("hold.error_N", "hold.bias_N")),
            short(spread["contact.peak_N"], "worst"),
            short(spread["effort_N2s"], "median"),
            _over(spread, ideal, level),
            short(spread["chattering_N_per_s"], "median"),
            short(spread["saturated_s"], "worst"),
        ]
        passed = f"{cell['passed']}/{cell['draws']}"
        rows.append((law["label"], [str(ladder["level"]), passed, *numbers, _used(cell), fails(ladder, task)]))
    meanings = (f"{head}: {NUMBERS[name].meaning}" for head, name in _OVER_A_WINDOW.items())
    return Table("law", heads, rows, caption="; ".join(meanings))


_OVER_A_WINDOW = {"error": "hold.error_N", "bias": "hold.bias_N", "chatter": "chattering_N_per_s"}
"""The numbers of the end of a run by their heads."""


def _used(cell: Mapping[str, Any]) -> str:
    """The share of each criterion's bound that nine draws of ten stay within."""
    return ", ".join(
        f"{without_unit(name).rpartition('.')[2]} {'never' if share is None else f'{100.0 * share:.0f} %'}"
        for name, share in cell["used"].items()
    )


def _over(spread: Mapping[str, Any], ideal: Mapping[str, Any] | None, level: str) -> str:
    """The median effort over the yardstick's at the same level."""
    its = levels_of(ideal).get(level) if ideal is not None else None
    value = spread["effort_N2s"]["median"]
    least = its["metrics"]["effort_N2s"]["median"] if its is not None else None
    return "" if value is None or not least else number(value / least, 3)


def fails(ladder: Mapping[str, Any], task: Task) -> str:
    """The end of a ladder: the draws passed, the 95 % interval of their share, as of a number of draws that was fixed
    before; each criterion that broke draws, in how many, and the median of its broken numbers."""
    last = ended(ladder)
    if last is None:
        return ""
    level, cell = last
    said = []
    for name, n in cell["broke"].items():
        if not n:
            continue
        if name == COMPLETED:
            said.append(f"{n} of {cell['draws']} did not complete")
            continue
        values = sorted(math.inf if row[name] is None else row[name] for row in cell["rows"] if name in row["broke"])
        middle = values[len(values) // 2]
        unit = unit_of_column(name)
        size = "missing" if math.isinf(middle) else f"{number(middle, 3)} {unit}".rstrip()
        limit = bounds(name, task.criteria[name])
        said.append(f"{without_unit(name).rpartition('.')[2]} {size} in {n} of {cell['draws']} ({limit})")
    low, high = (f"{100.0 * each:.0f}" for each in cell["interval"])
    return f"level {level}, {cell['passed']}/{cell['draws']} passed ({low} to {high} %): {', '.join(said)}"


def short(spread: Mapping[str, Any], which: str) -> str:
    """A number of a table; "never" where it is missing."""
    value = spread[which]
    return "never" if value is None else number(value, 3)


def worst(found: Mapping[str, Any], task: Task, own: Mapping[str, Job]) -> Table:
    """Of each law its failed draw with the largest error at the level that ended its ladder, and the command that
    repeats it."""
    rows = []
    for law in found["laws"]:
        last = ended(law["tasks"][task.name]) if law["label"] in own else None
        failed = [row for row in last[1]["rows"] if not row["passed"]] if last is not None else []
        if last is not None and failed:
            row = max(failed, key=lambda row: math.inf if row["hold.error_N"] is None else row["hold.error_N"])
            place = shlex.quote(str(own[law["label"]].level(int(last[0]))))
            command = f"uvms-mj run --from {place} --row {row['draw']} --out again"
            rows.append((law["label"], [last[0], str(row["draw"]), why(row, task), marked("<code>{}</code>", command)]))
    return Table("law", ["level", "draw", "its worst failed draw", "again"], rows, "worst", "Worst draws")


def why(row: Mapping[str, Any], task: Task) -> str:
    """The cause that broke a draw, with its numbers."""
    if row["broke"] == [COMPLETED]:
        return f"{row['status']}: {row.get('message', '')}"
    parts = []
    for name in row["broke"]:
        value = "missing" if row[name] is None else f"{number(row[name], 3)} {unit_of_column(name)}".rstrip()
        parts.append(f"{without_unit(name)} {value} ({bounds(name, task.criteria[name])})")
    return ", ".join(parts)
