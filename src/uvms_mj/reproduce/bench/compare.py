"""Two results, law by law and task by task, in the same draws."""

import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError, suggestion
from ...files import is_file, is_folder
from ...studies.report.statistics import difference_of_rates
from .results import parsed, rounded, shipped
from .task import RESULT

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
