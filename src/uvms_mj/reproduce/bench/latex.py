"""Tables of the benchmark for a paper, in LaTeX with the package booktabs: the levels of a result, and two results that
are compared."""

from collections.abc import Mapping, Sequence
from typing import Any

from ...analysis.hold import HOLD_S
from ...studies.report.latex import Column, LatexTable, Stacked
from ...studies.report.statistics import of_many
from .results import drawn, ended, may_compare
from .task import LEVELS


def latex_table(found: Mapping[str, Any]) -> LatexTable:
    """Of each law and task the level that the law holds, and below it the draws passed at the level that ended its
    ladder; a dash where it can't run, with the reason in a comment. Of all tasks it fits a page of two columns, 516 pt.

    The heads are the numbers of the tasks, whose names the note has; comments have their versions, the draws and the
    digest of the result.
    """
    tasks, also = found["tasks"], found.get("beside", {"labels": []})
    comments = [
        f"{found['benchmark']} version {found['version']}, result {found['digest']}: levels held; {drawn(found)}",
        f"A draw is judged by the push of the hold, the last {HOLD_S:g} s, and by the other criteria of its task.",
        *(
            f"{each['number']}: {name}, version {each['version']}, digest {each['digest']}"
            for name, each in tasks.items()
        ),
    ]
    said = [f"Level that a law holds, of {len(LEVELS)}, and below it the draws that it passes at the next level."]
    said += ["; ".join(f"{each['number']}: {name.replace('_', ' ')}" for name, each in tasks.items()) + "."]
    said += [f"{drawn(found).capitalize()}."]
    labels = [law["label"] for law in found["laws"]]
    if also["labels"]:
        first = also["labels"][0]
        comments += [f"from {first} on: result {also['result']}; {drawn(also)}", may_compare(also)]
        said += [f"From {first} on: {drawn(also)}."] if drawn(also) != drawn(found) else []
    for law in found["laws"]:
        ladders = law["tasks"].items()
        whys = [(name, " ".join(each["reason"].split())) for name, each in ladders if not each["runs"]]
        comments += [f"{law['label']} on {name}: {why}" for name, why in whys]
    columns = [
        Column(str(each["number"]), "", [_held(law["tasks"][name]) for law in found["laws"]])
        for name, each in tasks.items()
    ]
    ruled = [labels.index(label) for label in also["labels"][:1]]
    return LatexTable("law", labels, columns, " ".join(said), comments, ruled)


def _held(ladder: Mapping[str, Any]) -> Stacked:
    """The level that a law holds, and the draws that it passes at the level that ended its ladder."""
    if not ladder["runs"]:
        return Stacked("–")
    last = ended(ladder)
    return Stacked(str(ladder["level"]), "" if last is None else f"{last[1]['passed']}/{last[1]['draws']}")


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
        "Level that a law holds, and the draws that it passes of the draws that both ran.",
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
