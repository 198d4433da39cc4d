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

from ...control import BUILT_IN
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
    """The result of a law on a task, from its rows."""
    draws: list[dict[str, Any]] = []
    for row in frame.to_dict("records"):
        broke = broken(task, row)
        each = {"draw": row["draw"], "seed": row["seed"], "passed": not broke, "broke": broke, "status": row["status"]}
        if row["message"]:
            each["message"] = without_folders(row["message"])
        ended = row["status"] != COMPLETED  # early: its peak and its effort belong to the time before
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
    that a failed run can't improve them; None stands for it. And the number of missing values."""
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
    return _json(found, "", 0) + "\n"


def _json(value: Any, name: str, depth: int) -> str:
    """A value of the result as JSON. ``name`` is its key, or for a row "row" and for a metric's numbers "metric"."""
    numbers = isinstance(value, list) and all(isinstance(each, int | float) for each in value)
    if name in ("row", "metric") or numbers or not value or not isinstance(value, list | Mapping):
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    below = "\n" + " " * (depth + 1)
    if isinstance(value, list):
        each = [_json(item, "row" if name == "rows" else "", depth + 1) for item in value]
        return f"[{below}{f',{below}'.join(each)}\n{' ' * depth}]"
    inner = {key: _json(item, "metric" if name == "metrics" else key, depth + 1) for key, item in value.items()}
    each = [f"{json.dumps(key, ensure_ascii=False)}: {item}" for key, item in inner.items()]
    return f"{{{below}{f',{below}'.join(each)}\n{' ' * depth}}}"


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
    """Compare two results, each ``FILE`` or ``FILE:LABEL``, or their folders; ``shipped`` is the result of the shipped
    laws.

    Returns pairs of laws, each with its tasks; whether their numbers may be compared, and why; and notes: about tasks
    of different versions, which are left out, and about laws of one file alone. Raises InputError if a file is no
    result, or there is nothing to compare.
    """
    (a, one), (b, other) = (_read(given) for given in (first, second))
    notes = _alone(a["tasks"], b["tasks"])
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
    return {"results": [a["digest"], b["digest"]], "pairs": found, **_validity(a, b, tasks), "notes": notes}


def _validity(a: Mapping[str, Any], b: Mapping[str, Any], tasks: Sequence[str]) -> dict[str, Any]:
    """Whether a difference between two results is one of the laws: ``valid`` is True, False, or None where nothing
    shows it; ``why`` is a sentence. Other code computes the same where a law that both have has the same numbers."""
    names = [name for name in {**a["code"], **b["code"]} if a["code"].get(name) != b["code"].get(name)]
    if not names:
        return {"valid": True, "why": "the tasks, their draws, the code and the machine are the same"}
    said = [f"{name}: {a['code'].get(name, 'not written')} and {b['code'].get(name, 'not written')}" for name in names]
    differs = f"the code or the machine differs ({'; '.join(said)})"
    theirs = {law["digest"]: law for law in b["laws"]}
    both = {law["label"]: (law, theirs[law["digest"]]) for law in a["laws"] if law["digest"] in theirs}
    draws = [
        (label, row == other)
        for label, (mine, its) in both.items()
        for name in tasks
        for row, other in _same_draws(mine["tasks"][name], its["tasks"][name])
    ]
    if not draws:
        some = next((law["label"] for each in (b, a) for law in each["laws"] if law["name"] in BUILT_IN), "gsta")
        hint = f"run {some} with both: its numbers show whether they compute the same"
        return {"valid": None, "why": f"{differs}, and no law is in both; {hint}"}
    other = sum(not same for _, same in draws)
    laws = ", ".join(dict.fromkeys(label for label, _ in draws))
    if other:
        return {"valid": False, "why": f"{differs}, and {laws} has other numbers in {other} of {len(draws)} draws"}
    return {"valid": True, "why": f"{differs}, and {laws} has the same numbers in {len(draws)} of {len(draws)} draws"}


def _same_draws(mine: Mapping[str, Any], theirs: Mapping[str, Any]) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """The rows of the draws that both cells of a task have."""
    x, y = ({row["draw"]: row for row in each.get("rows", ())} for each in (mine, theirs))
    return [(row, y[draw]) for draw, row in x.items() if draw in y]


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
    rows = _same_draws(mine, theirs)
    if not rows:
        return {"reason": "no draw is in both"}
    passed = np.array([[row["passed"] for row in pair] for pair in rows], dtype=float)
    difference = difference_of_rates(passed[:, 1] - passed[:, 0])
    better = "second" if difference.value > 0.0 else "first" if difference.value < 0.0 else None
    return {
        "draws": len(rows),
        "passed": [int(n) for n in passed.sum(axis=0)],
        "only": [int((passed[:, 0] > passed[:, 1]).sum()), int((passed[:, 1] > passed[:, 0]).sum())],
        "better": better,
        "resolved": difference.low > 0.0 or difference.high < 0.0,
        "difference": rounded(difference.value),
        "interval": [rounded(difference.low), rounded(difference.high)],
        "same_numbers": all(one == other for one, other in rows),
        "error_N": [_median([pair[k] for pair in rows]) for k in range(2)],
    }


def _median(rows: Sequence[Mapping[str, Any]]) -> float | None:
    values = [row["hold.error_N"] for row in rows]
    return rounded(float(np.median([np.inf if value is None else value for value in values])))


def sentences(name: str, task: Mapping[str, Any], labels: Sequence[str]) -> list[str]:
    """The cells of a task in a table: what each law passes, the better one of the two, by how many points of the share
    of draws, and the interval of it."""
    if "reason" in task:
        return [name, "-", "-", "-", "-", "can't run", "", ""]
    n, (a, b), (low, high) = task["draws"], task["passed"], task["interval"]
    counts = [name, f"{a}/{n}", f"{b}/{n}", *map(str, task["only"])]
    if task["same_numbers"] or task["better"] is None:
        return [*counts, "the same numbers" if task["same_numbers"] else "neither", "", ""]
    sign = 1.0 if task["better"] == "second" else -1.0
    low, high = sorted((sign * low, sign * high))
    better = labels[task["better"] == "second"] + ("" if task["resolved"] else ", not resolved")
    points = [f"{100.0 * each:+.0f}" for each in (sign * task["difference"], low, high)]
    return [*counts, better, points[0], f"{points[1]} to {points[2]}"]
