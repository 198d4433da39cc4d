"""The results: of each law on each task the level that it holds, at each level that it was judged at its draws and
numbers, and what broke each failed draw.

They depend on the code, the tasks, the draws and the laws alone, so that their JSON has the same bytes for any number
of workers, on any machine of a cluster and after any interruption. Numbers have :data:`DIGITS` digits. Two results are
compared law by law, task by task and level by level, in the same draws. A result of the first version of the benchmark
has the one level of its tasks; it is read and compared with its like, and with no result of the second version.
"""

import gzip
import hashlib
import itertools
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
from ...studies.report.data import refuse_unknown
from ...studies.report.statistics import difference_of_rates, rate
from ...studies.report.tables import without_folders
from .draws import DEVELOPMENT, KNOWN, Draws
from .sequential import MOST, verdict
from .task import NAME, RESULT, VERSION, Task

if TYPE_CHECKING:
    import pandas as pd


FORMATS = {1: 1, 2: 2}
"""The format of the JSON of each version of the benchmark."""
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


def cell(task: Task, frame: "pd.DataFrame", most: int = MOST) -> dict[str, Any] | None:
    """The result of a law at a level of a task, from its rows in order, of which the test of :mod:`.sequential` takes
    what it needs, at most ``most``. None while it needs more."""
    rows = frame.to_dict("records")
    held, n = verdict((not broken(task, row) for row in rows), most)
    return None if held is None else {"held": held} | _counted(task, rows[:n])


def _counted(task: Task, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    draws: list[dict[str, Any]] = []
    for row in rows:
        broke = broken(task, row)
        each = {"draw": row["draw"], "seed": row["seed"], "passed": not broke, "broke": broke, "status": row["status"]}
        if row["message"]:
            each["message"] = without_folders(row["message"])
        ended = row["status"] != COMPLETED  # early: its peak and its effort belong to the time before
        draws.append(each | {name: None if ended else rounded(_number(row.get(name))) for name in KEPT})
    passed, n = sum(each["passed"] for each in draws), len(draws)
    share = rate(passed, n, n)
    return {
        "passed": passed,
        "draws": n,
        "interval": [rounded(share.low), rounded(share.high)],
        "broke": {name: sum(name in each["broke"] for each in draws) for name in (COMPLETED, *task.criteria)},
        "used": {
            name: _used([each[name] for each in draws], high) for name, (_, high) in task.criteria.items() if high
        },
        "metrics": {name: _spread([each[name] for each in draws]) for name in COSTS},
        "rows": draws,
    }


MARGIN = 0.9
"""Share of the draws whose use of a criterion's bound is told [1]."""


def _used(values: Sequence[float | None], bound: float) -> float | None:
    """The margin of a criterion: the share of its upper bound that 90 % of the draws stay within [1], as the smallest
    value that so many draws have. Below 1 there is room. None if more than 10 % of the draws lack the number."""
    order = sorted(math.inf if value is None else abs(value) for value in values)
    return rounded(order[math.ceil(MARGIN * len(order)) - 1] / bound)


def _spread(values: Sequence[float | None]) -> dict[str, Any]:
    """Median and largest magnitude of a metric over all draws, in which a missing number is larger than any other, so
    that a failed run can't improve them; None stands for it. And the number of missing values."""
    order = sorted(math.inf if value is None else abs(value) for value in values)
    middle = 0.5 * (order[(len(order) - 1) // 2] + order[len(order) // 2])
    return {"median": rounded(middle), "worst": rounded(order[-1]), "missing": sum(value is None for value in values)}


def ladder(levels: Mapping[int, Mapping[str, Any]]) -> dict[str, Any]:
    """The result of a law on a task, from its cells by level: the level that it holds, below which it holds all, 0 if
    none; and the cells."""
    held = 0
    while levels.get(held + 1, {}).get("held"):
        held += 1
    return {"runs": True, "level": held, "levels": {str(level): dict(found) for level, found in levels.items()}}


def decided(ladder: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    """The level whose numbers a table has, and its cell: the level that a law holds, or level 1 if it holds none."""
    level = str(max(1, ladder["level"]))
    return level, ladder["levels"][level]


def ended(ladder: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]] | None:
    """The level that ended a ladder and its cell; None if a law holds all."""
    level = str(ladder["level"] + 1)
    return (level, ladder["levels"][level]) if level in ladder["levels"] else None


def refused(reason: str) -> dict[str, Any]:
    """The result of a law that can't run on a task."""
    return {"runs": False, "reason": reason}


def document(
    tasks: Sequence[Task],
    laws: Sequence[Mapping[str, Any]],
    code: Mapping[str, str],
    draws: Draws = KNOWN,
    most: int = MOST,
) -> dict[str, Any]:
    """The whole result; each of ``laws`` has its label, its identity and its ladders."""
    found: dict[str, Any] = {
        "benchmark": NAME,
        "version": VERSION,
        "format": FORMATS[VERSION],
        "code": dict(code),
        "draws": draws.named() | {"most": most},
        "tasks": {
            task.name: {
                "number": task.number,
                "version": task.version,
                "digest": task.digest,
                "title": task.title,
                "levels": list(task.levels),
                "criteria": {name: list(limit) for name, limit in task.criteria.items()},
            }
            for task in tasks
        },
        "laws": list(laws),
    }
    return found | {"digest": digest(found)}


def version(found: Mapping[str, Any]) -> int:
    """The version of the benchmark that a result is of; the first did not say it."""
    return int(found.get("version", 1))


def levels_of(task: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The cells of a law on a task by level; of a result of version 1 the cell of its draws. Empty if it can't run."""
    if not task["runs"]:
        return {}
    return dict(task["levels"]) if "levels" in task else {"1": task}


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
FIRST_VERSION = Path(__file__).with_name("shipped_version_1.json.gz")
"""The last result of all shipped laws on the first version of the benchmark."""


def shipped(path: Path = SHIPPED) -> dict[str, Any]:
    """The result of all shipped laws on all tasks, as the package has it."""
    return parsed(gzip.decompress(path.read_bytes()), path.name)


def parsed(data: bytes, place: str) -> dict[str, Any]:
    """A result from its JSON. Raises InputError if it is none, or was changed."""
    try:
        found = json.loads(data)
        if not isinstance(found, dict) or found.get("benchmark") != NAME:
            raise InputError(f"{place}: is not a result of uvms-mj bench")
        if found.get("format") != FORMATS.get(version(found)):
            known = " and ".join(map(str, FORMATS.values()))
            raise InputError(f"{place}: has the format {found.get('format')}; this version reads {known}")
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"{place}: is not JSON: {error}") from None
    if found.get("digest") != digest(found):
        raise InputError(f"{place}: was changed since it was written: its digest is another one")
    return found


OF_PACKAGE = {"shipped": SHIPPED, "shipped-version-1": FIRST_VERSION}
"""The names of the results that the package has."""


_NO_DRAW = "no draw is in both"


def compared(first: str, second: str = "") -> dict[str, Any]:
    """Compare two results, each ``FILE`` or ``FILE:LABEL``, or their folders; ``shipped`` is the result of the shipped
    laws. Of one result compare every two laws.

    Returns pairs of laws, each with its tasks; whether their numbers may be compared, and why; and notes: about tasks
    of different versions, which are left out, and about laws of one file alone. Raises InputError if a file is no
    result, or there is nothing to compare: no task, no law, or no draw that both ran.
    """
    a, one = _read(first)
    b, other = _read(second) if second else (a, one)
    if version(a) != version(b):
        of = f"{first} is of version {version(a)} of {NAME}, {second} of version {version(b)}"
        raise InputError(f"{of}: their tasks and draws differ, and nothing can be compared")
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
    pairs, alone = _pairs(a, b, one, other) if second else ([*itertools.combinations(a["laws"], 2)], [])
    notes += alone
    if not second and (one or not pairs):
        raise InputError(f"{first}: is one law; name a second result, or a result of several laws")
    if not pairs:
        labels = " and ".join(", ".join(repr(law["label"]) for law in each["laws"]) for each in (a, b))
        raise InputError(f"no law is in both: {labels}; name one in each, FILE.json:LAW")
    found = [
        {"first": mine["label"], "second": theirs["label"], "same_law": mine["digest"] == theirs["digest"]}
        | {"tasks": {name: _task(mine["tasks"][name], theirs["tasks"][name]) for name in tasks}}
        for mine, theirs in pairs
    ]
    if all(task.get("reason") == _NO_DRAW for pair in found for task in pair["tasks"].values()):
        raise InputError(f"nothing to compare: {_NO_DRAW}; {first} has {drawn(a)}, {second} has {drawn(b)}")
    return {"results": [a["digest"], b["digest"]], "pairs": found, **_validity(a, b, tasks), "notes": notes}


def renamed(found: Mapping[str, Any], words: Mapping[str, str]) -> dict[str, Any]:
    """A result, or a comparison of two, with words in place of the names of laws and tasks. Raises InputError for a
    name that is not in it, and for two laws with the same words."""
    pairs, laws = found.get("pairs", []), found.get("laws", [])
    labels = [law["label"] for law in laws] or [*dict.fromkeys(pair[k] for pair in pairs for k in ("first", "second"))]
    named = [*dict.fromkeys(name for each in (*laws, *pairs) for name in each["tasks"])]
    refuse_unknown(words, [*labels, *named], labels)

    def of(name: str) -> str:
        return words.get(name, name)

    def tasks(given: Mapping[str, Any]) -> dict[str, Any]:
        return {of(name): each for name, each in given.items()}

    other = {
        "laws": [{**law, "label": of(law["label"]), "tasks": tasks(law["tasks"])} for law in laws],
        "pairs": [
            {**pair, "first": of(pair["first"]), "second": of(pair["second"]), "tasks": tasks(pair["tasks"])}
            for pair in pairs
        ],
        "tasks": tasks(found.get("tasks", {})),
    }
    if also := found.get("beside"):
        other["beside"] = {**also, "labels": [of(label) for label in also["labels"]]}
    return {**found, **{key: each for key, each in other.items() if key in found}}


def refuse_other_tasks(given: str, tasks: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise InputError unless a result to stand beside another one, if it is given, has its tasks, whose versions and
    digests are as in bench.json."""
    if not given:
        return
    other = _read(given)[0]
    if version(other) != VERSION:
        raise InputError(f"--with {given}: is of version {version(other)} of {NAME}, not of version {VERSION}")
    theirs = other["tasks"]
    same = ("version", "digest")
    if wrong := [name for name, its in tasks.items() if any(theirs.get(name, {}).get(key) != its[key] for key in same)]:
        raise InputError(f"--with {given}: lacks these tasks, or has other versions of them: {', '.join(wrong)}")


def beside(found: Mapping[str, Any], given: str) -> dict[str, Any]:
    """A result with the rows of another one below its own, for a table, a page and a figure: ``given`` is its file or
    folder, on request with one law, ``FILE:LABEL``, or ``shipped``. A law that both have is there once.

    The entry ``beside`` has the labels of the other's laws, its digest, its draws, and as :func:`compared` whether
    their numbers may be compared. The tasks must be the same (:func:`refuse_other_tasks`). Raises InputError if the
    other has no other law.
    """
    other, label = _read(given)
    mine, labels = {law["digest"] for law in found["laws"]}, {law["label"] for law in found["laws"]}
    laws = [
        {**law, "tasks": {name: law["tasks"][name] for name in found["tasks"]}}
        for law in other["laws"]
        if law["digest"] not in mine and label in ("", law["label"])
    ]
    if not laws:
        raise InputError(f"--with {given}: has no other law than this result")
    of = Path(given.rpartition(":")[0] or given).stem
    laws = [{**law, "label": f"{law['label']} ({of})"} if law["label"] in labels else law for law in laws]
    about = {"labels": [law["label"] for law in laws], "result": other["digest"], "draws": other["draws"]}
    about |= _validity(found, other, list(found["tasks"]))
    return {**found, "laws": [*found["laws"], *laws], "beside": about}


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


def may_compare(also: Mapping[str, Any]) -> str:
    """Whether the rows of two results may be compared, in a sentence."""
    how = {True: "may be compared", False: "may not be compared", None: "are not known to be comparable"}
    return f"Their numbers {how[also['valid']]}: {also['why']}."


def _same_draws(mine: Mapping[str, Any], theirs: Mapping[str, Any]) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """The rows of the draws that both laws have on a task, at all levels."""
    x, y = (rows_of(each) for each in (mine, theirs))
    return [(row, y[key]) for key, row in x.items() if key in y and row["seed"] == y[key]["seed"]]


def rows_of(task: Mapping[str, Any]) -> dict[tuple[str, int], dict[str, Any]]:
    """The rows of a law on a task by level and draw."""
    return {(level, row["draw"]): row for level, each in levels_of(task).items() for row in each["rows"]}


def _read(given: str) -> tuple[dict[str, Any], str]:
    """A result, and the label that its name asks for."""
    file, colon, label = (given, "", "") if os.path.exists(given) or ":" not in given else given.rpartition(":")
    file = str(Path(file, RESULT)) if is_folder(file) else file
    if colon and not label:
        raise InputError(f"{given}: the label of a law is empty")
    if is_file(file):
        found = parsed(Path(file).read_bytes(), file)
    elif file in OF_PACKAGE:
        found = shipped(OF_PACKAGE[file])
    else:
        raise InputError(f"{file}: no such file; {' and '.join(OF_PACKAGE)} are results of the shipped laws")
    labels = [law["label"] for law in found["laws"]]
    if label and label not in labels:
        raise InputError(f"{given}: no law {label!r}; {suggestion(label, labels)}")
    return found, label


def result_of(given: str) -> dict[str, Any]:
    """A result by its file or folder, on request with one law, ``FILE:LABEL``, or ``shipped``. Raises InputError for
    others, and for a result of the first version."""
    found, label = _read(given)
    if version(found) != VERSION:
        raise InputError(f"{given}: is of version {version(found)} of {NAME}, not of version {VERSION}")
    return {**found, "laws": [law for law in found["laws"] if label in ("", law["label"])]}


def drawn(found: Mapping[str, Any]) -> str:
    """The draws of a result in words."""
    draws = found["draws"]
    if draws["kind"] == DEVELOPMENT:
        return "known draws, for development"
    if draws["kind"] == "seed":
        return f"blind draws of the seed {draws['seed']}"
    return f"blind draws of a secret with the SHA-256 {draws['digest']}"


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
    """The levels that both laws hold; of the levels at which both were judged the draws that both ran, paired: how many
    each passes, difference of the shares with its interval."""
    if not (mine["runs"] and theirs["runs"]):
        return {"reason": mine.get("reason") or theirs.get("reason")}
    rows = _same_draws(mine, theirs)
    if not rows:
        return {"reason": _NO_DRAW}
    passed = np.array([[row["passed"] for row in pair] for pair in rows], dtype=float)
    difference = difference_of_rates(passed[:, 1] - passed[:, 0])
    levels = [each.get("level") for each in (mine, theirs)]
    better = "second" if difference.value > 0.0 else "first" if difference.value < 0.0 else None
    return {
        "levels": levels,
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
    """The cells of a task in a table: the level that each law holds, if the result has levels, and what it passes of
    the draws that both ran; the better one of the two, by how many points of the share of draws, and the interval."""
    if "reason" in task:
        return [name, "-", "-", "-", "-", _NO_DRAW if task["reason"] == _NO_DRAW else "can't run", "", ""]
    n, (low, high) = task["draws"], task["interval"]
    each = [
        f"{passed}/{n}" if level is None else f"level {level}, {passed}/{n}"
        for level, passed in zip(task["levels"], task["passed"], strict=True)
    ]
    counts = [name, *each, *map(str, task["only"])]
    if task["same_numbers"] or task["better"] is None:
        return [*counts, "the same numbers" if task["same_numbers"] else "neither", "", ""]
    sign = 1.0 if task["better"] == "second" else -1.0
    low, high = sorted((sign * low, sign * high))
    better = labels[task["better"] == "second"] + ("" if task["resolved"] else ", not resolved")
    points = [f"{100.0 * each:+.0f}" for each in (sign * task["difference"], low, high)]
    return [*counts, better, points[0], f"{points[1]} to {points[2]}"]
