"""Tables of the benchmark for a paper, in LaTeX with the package booktabs: the levels of a result, and two results that
are compared."""

from collections.abc import Mapping, Sequence
from typing import Any

from ...analysis.hold import HOLD_S
from ...studies.report.latex import Column, LatexTable, Stacked, label
from ...studies.report.statistics import of_many
from .results import drawn, ended, may_compare


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
        notes += [f"% from {also['labels'][0]} on: result {also['result']}; {drawn(also)}", f"% {may_compare(also)}"]
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
    return [_pair(pair, [f"results {' and '.join(found['results'])}", may_compare(found)]) for pair in found["pairs"]]


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
