"""The table of laws and tasks as LaTeX, for the package booktabs."""

from collections.abc import Mapping
from typing import Any

from ...studies.report.numbers import latex


def table(found: Mapping[str, Any]) -> str:
    """Of each law and task the number of draws that the law passes; a dash where it can't run, with the reason below.

    The heads are the numbers of the tasks; comments have their names, versions and the digest of the result.
    """
    tasks = found["tasks"]
    lines = [f"% {found['benchmark']}, result {found['digest']}: draws passed, 95 % interval of Wilson in per cent"]
    lines += [
        f"% {task['number']}: {name}, version {task['version']}, digest {task['digest']}"
        for name, task in tasks.items()
    ]
    lines += ["% \\usepackage{booktabs}", f"\\begin{{tabular}}{{l{'r' * len(tasks)}}}", "\\toprule"]
    lines += [" & ".join(["law", *(str(task["number"]) for task in tasks.values())]) + " \\\\", "\\midrule"]
    notes = []
    for key in ("tasks", "tuned"):
        rows = [law for law in found["laws"] if key in law]
        if key == "tuned" and rows:
            lines += ["\\midrule", f"\\multicolumn{{{1 + len(tasks)}}}{{l}}{{gains tuned for each task}} \\\\"]
        for law in rows:
            cells = [_text(law[key].get(name)) for name in tasks]
            lines.append(" & ".join([latex(law["label"]), *cells]) + " \\\\")
            notes += [
                f"% {law['label']} on {name}: {' '.join(cell['reason'].split())}"
                for name, cell in law[key].items()
                if not cell["runs"]
            ]
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}", *notes]) + "\n"


def _text(cell: Mapping[str, Any] | None) -> str:
    if cell is None or not cell["runs"]:
        return "--"
    low, high = (f"{100.0 * each:.0f}" for each in cell["interval"])
    return f"{cell['passed']}/{cell['draws']} {{\\scriptsize {low}--{high}}}"
