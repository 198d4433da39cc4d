"""The page of the benchmark: the level that each law holds on each task, the laws of each task in their order, a table
and the courses of the push for each task, the worst runs; and the table as LaTeX, for the package booktabs."""

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...analysis.hold import HOLD_S
from ...analysis.summary import COURSES, NUMBERS, PARTS
from ...control.task import Schedule
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
from ...studies.report.latex import Column, LatexTable, Stacked, label
from ...studies.report.statistics import of_many
from ...studies.results import frame
from ...views import colours
from ...views.figures.style import GREY, LINE, SMALL, panels, styled
from .draws import DEVELOPMENT
from .results import broken, drawn, levels_of
from .sequential import HELD, NOT_HELD, chance
from .task import LEVELS, Job, Task

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


def decided(ladder: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    """The level whose numbers a table has, and its cell: the level that a law holds, or level 1 if it holds none."""
    level = str(max(1, ladder["level"]))
    return level, ladder["levels"][level]


def ended(ladder: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]] | None:
    """The level that ended a ladder and its cell; None if a law holds all."""
    level = str(ladder["level"] + 1)
    return (level, ladder["levels"][level]) if level in ladder["levels"] else None


def latex_table(found: Mapping[str, Any]) -> str:
    """Of each law and task the level that the law holds, and below it the draws passed at this level and at the next; a
    dash where it can't run, with the reason below the table. It fits the width of a page of two columns, 516 pt, at
    10 pt.

    The heads are the numbers of the tasks; comments have their names, versions, the draws and the digest of the result.
    """
    tasks = found["tasks"]
    lines = [
        f"% {found['benchmark']} version {found['version']}, result {found['digest']}: levels held; {drawn(found)}",
        f"% A draw is judged by the push of the hold, the last {HOLD_S:g} s, and by the other criteria of its task.",
    ]
    lines += [
        f"% {task['number']}: {name}, version {task['version']}, digest {task['digest']}"
        for name, task in tasks.items()
    ]
    space = f"@{{\\hspace{{{SPACE_PT}pt}}}}"
    lines += ["% \\usepackage{booktabs}", f"\\begin{{tabular}}{{l{f'{space}r' * len(tasks)}}}", "\\toprule"]
    lines += [" & ".join(["law", *(str(task["number"]) for task in tasks.values())]) + " \\\\", "\\midrule"]
    notes = []
    also = found.get("beside", {"labels": []})
    if also["labels"]:
        notes += [f"% from {also['labels'][0]} on: result {also['result']}; {drawn(also)}", f"% {_may_compare(also)}"]
    for law in found["laws"]:
        if law["label"] in also["labels"][:1]:
            lines.append("\\midrule")
        cells = [_texts(law["tasks"][name]) for name in tasks]
        lines.append(" & ".join([label(law["label"], LABEL_PT), *(level for level, _ in cells)]) + " \\\\")
        lines.append(" & ".join(["", *(counts for _, counts in cells)]) + " \\\\")
        notes += [
            f"% {law['label']} on {name}: {' '.join(ladder['reason'].split())}"
            for name, ladder in law["tasks"].items()
            if not ladder["runs"]
        ]
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}", *notes]) + "\n"


def comparison(found: Mapping[str, Any]) -> list[LatexTable]:
    """The pairs of :func:`.results.compared` as tables for a paper: of each task the levels that both laws hold, and
    below them the draws passed; the draws that one alone passes; the difference of the shares, and its interval."""
    return [_pair(pair, [f"results {' and '.join(found['results'])}", _may_compare(found)]) for pair in found["pairs"]]


def _pair(pair: Mapping[str, Any], comments: Sequence[str]) -> LatexTable:
    labels, tasks = (pair["first"], pair["second"]), pair["tasks"]
    missing = Stacked("–")
    columns = [
        Column(label, "level", [missing if "reason" in task else _judged_by(task, k) for task in tasks.values()])
        for k, label in enumerate(labels)
    ]
    alone = [missing if "reason" in task else Stacked(" : ".join(map(str, task["only"]))) for task in tasks.values()]
    change = [missing if "reason" in task else _change(task) for task in tasks.values()]
    columns += [Column("alone", "[draws]", alone), Column("difference", "[points]", change)]
    n = sum("reason" not in task for task in tasks.values())
    said = [
        "Level that a law holds, and the draws that it passes of those that both ran.",
        f"alone: draws that {labels[0]} alone passes, and that {labels[1]} alone passes.",
        f"difference: {labels[1]} minus {labels[0]} of the share of passed draws, with its 95 % interval; "
        f"without zero in it, it is resolved. {of_many(n)}",
        *(f"{name}: {task['reason']}." for name, task in tasks.items() if "reason" in task),
    ]
    return LatexTable("task", list(tasks), columns, " ".join(said), comments)


def _judged_by(task: Mapping[str, Any], k: int) -> Stacked:
    level, counts = task["levels"][k], f"{task['passed'][k]}/{task['draws']}"
    return Stacked(counts) if level is None else Stacked(str(level), counts)


def _change(task: Mapping[str, Any]) -> Stacked:
    if task["same_numbers"]:
        return Stacked("same runs")
    value, low, high = (
        f"{round(100.0 * each) + 0:+d}".replace("-", "−") for each in (task["difference"], *task["interval"])
    )
    return Stacked(value, f"{low} to {high}")


def _may_compare(also: Mapping[str, Any]) -> str:
    """Whether the rows of two results may be compared, in a sentence."""
    how = {True: "may be compared", False: "may not be compared", None: "are not known to be comparable"}
    return f"Their numbers {how[also['valid']]}: {also['why']}."


SPACE_PT = 6
"""Space between the columns of the LaTeX table [pt]."""
LABEL_PT = 160
"""Width in which the labels of laws are set [pt]."""


def _texts(ladder: Mapping[str, Any]) -> tuple[str, str]:
    """The level that a law holds, and the draws that it passes at the level that ended its ladder."""
    if not ladder["runs"]:
        return "--", ""
    last = ended(ladder)
    return str(ladder["level"]), "" if last is None else f"{{\\scriptsize {last[1]['passed']}/{last[1]['draws']}}}"


_COLUMNS, _HEIGHT = 5, 1.15
_TOP = 2.5
"""Top of a panel over the largest demanded push; a push above is drawn there."""
_CAPTION = (
    "Push over time, at the first level that a law does not hold, or at level 5. Line: median over the draws of the "
    "mean in each sixtieth of the run. Shade: from the least to the greatest push of all draws, at every step. Thin "
    "line: the failed draw with the largest error. Dashed: the demanded push. Grey: the hold, in which the push is "
    "judged. A push above the panel is drawn at its top."
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


def courses(task: Task, base: Any, rows: "Mapping[str, pd.DataFrame]", colours: Mapping[str, str]) -> Picture:
    """The figure of a task.

    Args:
        base: a scenario of the task.
        rows: the draws of each law at the level that ended its ladder, or at the last one, by the title of its panel.
        colours: by the same titles.
    """
    duration = base.simulation.duration
    t = (np.arange(PARTS) + 0.5) * duration / PARTS
    push = demanded(base, t)
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
        _label_last(drawn)
        figure.supxlabel("time [s]", fontsize=SMALL)
        figure.supylabel("push [N]", fontsize=SMALL)
    return Picture(f"courses-{task.name}", _CAPTION, figure)


def _label_last(axes: "Sequence[Axes]") -> None:
    """Number the time or the levels below the last panel of each column, also above the end of a row that is not
    full."""
    place = axes[0].get_subplotspec()
    for ax in axes[-(place.get_gridspec().ncols if place is not None else 1) :]:
        ax.tick_params(labelbottom=True)


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
                Picture("order", _ORDER, order(found, shown)),
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
    return Text(f"{said} {_may_compare(also)}", "soft")


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


def colours_of(found: Mapping[str, Any]) -> list[str]:
    """A colour for each law."""
    return colours.hex_of_runs([law["name"] for law in found["laws"]])


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


_ORDER = (
    "The laws of each task in order: by the level that they hold, and by the share of the draws that they pass at the "
    "next. A full step is a level."
)


def order(found: Mapping[str, Any], shown: Mapping[str, str]) -> Any:
    """A figure with a panel a task: the laws as bars, in the order of their levels."""
    names = list(found["tasks"])
    with styled():
        figure, drawn_in = panels(len(names), _COLUMNS, 0.1, 0.35 + 0.13 * len(found["laws"]), sharex=True)
        for ax, name in zip(drawn_in, names, strict=True):
            lengths = {law["label"]: reach(law["tasks"][name]) for law in found["laws"] if law["tasks"][name]["runs"]}
            labels = sorted(lengths, key=lambda label: lengths[label])
            ax.barh(
                range(len(labels)),
                [lengths[each] for each in labels],
                color=[shown[each] for each in labels],
                height=0.7,
                alpha=0.5,
            )
            for i, label in enumerate(labels):
                ax.text(0.06, i, label, va="center", fontsize=SMALL, parse_math=False)
            ax.set_yticks([])
            ax.set_xlim(0.0, len(LEVELS))
            ax.set_xticks(range(len(LEVELS) + 1))
            ax.set_title(f"{found['tasks'][name]['number']} {name.replace('_', ' ')}", fontsize=SMALL, loc="left")
        _label_last(drawn_in)
        figure.supxlabel("level", fontsize=SMALL)
    return figure


def reach(ladder: Mapping[str, Any]) -> float:
    """The level that a law holds, and the share of the draws that it passes at the next one [1], which orders laws that
    hold the same level."""
    last = ended(ladder)
    return ladder["level"] + (0.0 if last is None else last[1]["passed"] / last[1]["draws"])


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
    """What broke a draw, with its numbers."""
    if row["broke"] == [COMPLETED]:
        return f"{row['status']}: {row.get('message', '')}"
    parts = []
    for name in row["broke"]:
        value = "missing" if row[name] is None else f"{number(row[name], 3)} {unit_of_column(name)}".rstrip()
        parts.append(f"{without_unit(name)} {value} ({bounds(name, task.criteria[name])})")
    return ", ".join(parts)
