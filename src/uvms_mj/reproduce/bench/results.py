"""The results: of each law on each task how many draws it passes, its numbers, and what broke each failed draw.

They depend on the code, the tasks and the laws alone, so that their JSON has the same bytes for any number of workers,
on any machine of a cluster and after any interruption. Numbers have :data:`DIGITS` digits. Two results are compared law
by law and task by task, in the same draws.
"""

import gzip
import hashlib
import json
import math
import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InputError, suggestion
from ...files import is_file, is_folder
from ...studies.plan.metrics import COMPLETED
from ...studies.report.statistics import difference_of_rates, rate
from ...studies.report.tables import without_folders
from .task import NAME, RESULT, Task

if TYPE_CHECKING:
    import pandas as pd


FORMAT = 1
DIGITS = 6
COSTS = (
    *("hold.error_N", "hold.bias_N", "hold.worst_N", "contact.peak_N", "contact.settling_s", "hold.lost_s"),
    *("hold.path_error_m", "hold.turn_error_deg", "saturated_s", "effort_N2s", "chattering_N_per_s"),
)
"""The metrics of which a large magnitude is bad: the result has their medians and their worst values."""
KEPT = (*COSTS, "hold.contacts", "contact.touches")
"""The metrics of each draw in the result."""


def rounded(value: Any) -> float | None:
    """A number with :data:`DIGITS` digits; None if it is missing or not finite."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{value:.{DIGITS}g}") + 0.0  # no -0.0


def broken(task: Task, row: Mapping[str, Any]) -> list[str]:
    """The criteria that a row does not meet: "completed" alone if the run did not complete. A number that is missing
    meets nothing."""
    if row["status"] != COMPLETED:
        return [COMPLETED]
    return [name for name, (low, high) in task.criteria.items() if not low <= _number(row.get(name)) <= high]


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def cell(task: Task, frame: "pd.DataFrame") -> dict[str, Any]:
    """What a law does on a task, from its rows."""
    draws: list[dict[str, Any]] = []
    for row in frame.to_dict("records"):
        broke = broken(task, row)
        each = {"draw": row["draw"], "seed": row["seed"], "passed": not broke, "broke": broke, "status": row["status"]}
        if row["message"]:
            each["message"] = without_folders(row["message"])
        ended = row["status"] != COMPLETED  # early: its peak and its effort are those of the time before
        draws.append(each | {name: None if ended else rounded(_number(row.get(name))) for name in KEPT})
    passed, n = sum(each["passed"] for each in draws), len(draws)
    share = rate(passed, n, n)
    return {
        "runs": True,
        "passed": passed,
        "draws": n,
        "interval": [rounded(share.low), rounded(share.high)],
        "broke": {name: sum(name in each["broke"] for each in draws) for name in (COMPLETED, *task.criteria)},
        "metrics": {name: _spread([each[name] for each in draws]) for name in COSTS},
        "rows": draws,
    }


def _spread(values: Sequence[float | None]) -> dict[str, Any]:
    """Median and largest magnitude of a metric over all draws, in which a missing number is larger than any other, so
    that a failed run can't improve them; None stands for it. And the number of those that are missing."""
    order = sorted(math.inf if value is None else abs(value) for value in values)
    middle = 0.5 * (order[(len(order) - 1) // 2] + order[len(order) // 2])
    return {"median": rounded(middle), "worst": rounded(order[-1]), "missing": sum(value is None for value in values)}


def refused(reason: str) -> dict[str, Any]:
    """The cell of a law that can't run on a task."""
    return {"runs": False, "reason": reason}


def document(tasks: Sequence[Task], laws: Sequence[Mapping[str, Any]], code: Mapping[str, str]) -> dict[str, Any]:
    """The whole result; each of ``laws`` has its label, its identity and its cells."""
    found: dict[str, Any] = {
        "benchmark": NAME,
        "format": FORMAT,
        "code": dict(code),
        "tasks": {
            task.name: {
                "number": task.number,
                "version": task.version,
                "digest": task.digest,
                "title": task.title,
                "criteria": {name: list(limit) for name, limit in task.criteria.items()},
            }
            for task in tasks
        },
        "laws": list(laws),
    }
    return found | {"digest": digest(found)}


def digest(found: Mapping[str, Any]) -> str:
    """Digest of a result without its own."""
    whole = {name: value for name, value in found.items() if name != "digest"}
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()[:32]


def text(found: Mapping[str, Any]) -> str:
    """The result as JSON; each draw, each metric and each list of numbers is one line."""
    lines, marks = list[str](), dict[str, str]()

    def marked(value: Any) -> str:
        mark = f"@{len(marks)}@"
        marks[mark] = json.dumps(value, ensure_ascii=False, allow_nan=False)
        return mark

    def shortened(value: Any, name: str = "") -> Any:
        if name == "rows":
            return [marked(row) for row in value]
        if name == "metrics":
            return {key: marked(spread) for key, spread in value.items()}
        if isinstance(value, Mapping):
            return {key: shortened(each, key) for key, each in value.items()}
        if isinstance(value, list) and all(isinstance(each, int | float) for each in value):
            return marked(value)
        return [shortened(each) for each in value] if isinstance(value, list) else value

    for line in json.dumps(shortened(found), indent=1, ensure_ascii=False, allow_nan=False).split("\n"):
        mark = line.rpartition('"@')[2].rpartition('@"')[0]
        lines.append(line.replace(f'"@{mark}@"', marks[f"@{mark}@"]) if mark.isdecimal() else line)
    return "\n".join(lines) + "\n"


SHIPPED = Path(__file__).with_name("shipped.json.gz")
"""The result of all shipped laws."""


def shipped() -> dict[str, Any]:
    """The result of all shipped laws on all tasks, as the package has it."""
    return parsed(gzip.decompress(SHIPPED.read_bytes()), SHIPPED.name)


def parsed(data: bytes, place: str) -> dict[str, Any]:
    """A result from its JSON. Raises InputError if it is none, or was changed."""
    try:
        found = json.loads(data)
        if not isinstance(found, dict) or found.get("benchmark") != NAME:
            raise InputError(f"{place}: is not a result of uvms-mj bench")
        if found.get("format") != FORMAT:
            raise InputError(f"{place}: has the format {found.get('format')}; this version reads {FORMAT}")
    except (ValueError, RecursionError) as error:
        raise InputError(f"{place}: is not JSON: {error}") from None
    if found.get("digest") != digest(found):
        raise InputError(f"{place}: was changed since it was written: its digest is another one")
    return found


OF_PACKAGE = "shipped"
"""The name of the result that the package has."""


def compared(first: str, second: str) -> dict[str, Any]:
    """Compare two results, each ``FILE`` or ``FILE:LABEL``, or their folders; ``shipped`` is that of the shipped laws.

    Returns pairs of laws, each with its tasks, and notes: about tasks of different versions, which are left out, about
    different code, and about laws of one file alone. Raises InputError if a file is no result, or there is nothing to
    compare.
    """
    (a, one), (b, other) = (_read(given) for given in (first, second))
    notes = [_of_code(name, a["code"].get(name), b["code"].get(name)) for name in {**a["code"], **b["code"]}]
    notes = [note for note in notes if note]
    notes += _alone(a["tasks"], b["tasks"])
    tasks = []
    for name in (name for name in a["tasks"] if name in b["tasks"]):
        mine, theirs = a["tasks"][name], b["tasks"][name]
        if (mine["version"], mine["digest"]) != (theirs["version"], theirs["digest"]):
            versions = f"{mine['version']} ({mine['digest']}) and {theirs['version']} ({theirs['digest']})"
            notes.append(f"{name} is left out: its versions are {versions}")
        else:
            tasks.append(name)
    if not tasks:
        raise InputError(f"nothing to compare: {'; '.join(notes)}")
    pairs, alone = _pairs(a, b, one, other)
    notes += alone
    if not pairs:
        labels = " and ".join(", ".join(law["label"] for law in each["laws"]) for each in (a, b))
        raise InputError(f"no law is in both: {labels}; name one in each, FILE.json:LAW")
    found = [
        {"first": mine["label"], "second": theirs["label"], "same_law": mine["digest"] == theirs["digest"]}
        | {"tasks": {name: _task(mine["tasks"][name], theirs["tasks"][name]) for name in tasks}}
        for mine, theirs in pairs
    ]
    return {"results": [a["digest"], b["digest"]], "pairs": found, "notes": notes}


def _read(given: str) -> tuple[dict[str, Any], str]:
    """A result, and the label that its name asks for."""
    file, colon, label = (given, "", "") if os.path.exists(given) or ":" not in given else given.rpartition(":")
    file = str(Path(file, RESULT)) if is_folder(file) else file
    if colon and not label:
        raise InputError(f"{given}: the label of a law is empty")
    if is_file(file):
        found = parsed(Path(file).read_bytes(), file)
    elif file == OF_PACKAGE:
        found = shipped()
    else:
        raise InputError(f"{file}: no such file; {OF_PACKAGE} is the result of the shipped laws")
    labels = [law["label"] for law in found["laws"]]
    if label and label not in labels:
        raise InputError(f"{given}: no law {label!r}; {suggestion(label, labels)}")
    return found, label


def _of_code(name: str, one: Any, other: Any) -> str:
    return "" if one == other else f"{name} differs: {one} and {other}"


def _pairs(
    a: Mapping[str, Any], b: Mapping[str, Any], one: str, other: str
) -> tuple[list[tuple[Mapping[str, Any], Mapping[str, Any]]], list[str]]:
    """The laws to compare, and notes about the others."""
    mine, theirs = ({law["label"]: law for law in each["laws"]} for each in (a, b))
    if one and other:
        return [(mine[one], theirs[other])], []
    if len(mine) == len(theirs) == 1:
        return [(*mine.values(), *theirs.values())], []
    wanted = [label for label in mine if label in theirs and (one or other or label) == label]
    return [(mine[label], theirs[label]) for label in wanted], [] if one or other else _alone(mine, theirs)


def _alone(a: Collection[str], b: Collection[str]) -> list[str]:
    """Notes about names that one result alone has."""
    found = {"first": [name for name in a if name not in b], "second": [name for name in b if name not in a]}
    return [f"in the {which} result alone: {', '.join(names)}" for which, names in found.items() if names]


def _task(mine: Mapping[str, Any], theirs: Mapping[str, Any]) -> dict[str, Any]:
    """The draws that both laws ran, paired: how many each passes, difference of the shares with its interval."""
    if not (mine["runs"] and theirs["runs"]):
        return {"reason": mine.get("reason") or theirs.get("reason")}
    x, y = ({row["draw"]: row for row in each["rows"]} for each in (mine, theirs))
    draws = [draw for draw in x if draw in y]
    passed = np.array([[x[draw]["passed"], y[draw]["passed"]] for draw in draws], dtype=float)
    difference = difference_of_rates(passed[:, 1] - passed[:, 0])
    return {
        "draws": len(draws),
        "passed": [int(n) for n in passed.sum(axis=0)],
        "only": [int((passed[:, 0] > passed[:, 1]).sum()), int((passed[:, 1] > passed[:, 0]).sum())],
        "difference": rounded(difference.value),
        "interval": [rounded(difference.low), rounded(difference.high)],
        "same_numbers": [x[draw] for draw in draws] == [y[draw] for draw in draws],
        "error_N": [_median(x, draws), _median(y, draws)],
    }


def _median(rows: Mapping[int, Mapping[str, Any]], draws: Sequence[int]) -> float | None:
    values = [rows[draw]["hold.error_N"] for draw in draws]
    return rounded(float(np.median([np.inf if value is None else value for value in values])))


def sentences(name: str, task: Mapping[str, Any]) -> list[str]:
    """The cells of a task in a table."""
    if "reason" in task:
        return [name, "-", "-", "-", "-", "can't run", ""]
    n, (a, b), (low, high) = task["draws"], task["passed"], task["interval"]
    if task["same_numbers"]:
        return [name, f"{a}/{n}", f"{b}/{n}", *map(str, task["only"]), "the same numbers", ""]
    percent = [f"{100.0 * each:+.0f} %" for each in (task["difference"], low, high)]
    return [name, f"{a}/{n}", f"{b}/{n}", *map(str, task["only"]), percent[0], f"{percent[1]} to {percent[2]}"]
