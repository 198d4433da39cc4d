"""The tasks of the benchmark: study files, each with its number, version, reason, literature and pass criteria."""

import functools
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import InputError, suggestion
from ...files import tables_of
from ...studies.plan import Plan
from .. import PAGE as PAGE

NAME = "Contact-10"
RESULT, LATEX = "bench.json", "table.tex"
"""Names of the result and of the LaTeX table in the folder."""
FOLDER = Path(__file__).with_name("tasks")


@dataclass(frozen=True)
class Task:
    """A task.

    Attributes:
        name: of its study file.
        title: one line.
        number: its place in the table.
        version: goes up with each change that may change a result.
        reason: why a law should pass it.
        literature: where the problem is from.
        criteria: the least and the greatest value of each metric that a run must meet besides its completion.
        why: the reason for each criterion.
        truth: what the law does here that knows the truth, if it is not itself or can't pass; empty otherwise.
        tables: those of its study file.
    """

    name: str
    title: str
    number: int
    version: int
    reason: str
    literature: Sequence[str]
    criteria: Mapping[str, tuple[float, float]]
    why: Mapping[str, str]
    truth: str
    tables: Mapping[str, Any]

    @classmethod
    def load(cls, path: Path) -> "Task":
        """Read a study file of the package."""
        tables = tables_of(path, "study")
        about = tables["about"]
        return cls(
            name=path.stem,
            title=tables["description"],
            number=about["number"],
            version=about["version"],
            reason=" ".join(about["reason"].split()),
            literature=about["literature"],
            criteria={name: (float(low), float(high)) for name, (low, high) in tables["success"].items()},
            why=about["criteria"],
            truth=" ".join(about.get("truth", "").split()),
            tables=tables,
        )

    @property
    def digest(self) -> str:
        """Digest of everything in the file that a run or its verdict depends on."""
        ours = {name: value for name, value in self.tables.items() if name not in ("about", "description")}
        ours |= {"yardstick": self.yardstick}
        return hashlib.sha256(json.dumps(ours, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def draws(self) -> int:
        """Number of draws."""
        return int(self.tables["design"]["runs"])

    @property
    def yardstick(self) -> Mapping[str, Any]:
        """The law and the keys that stand for the law that knows the truth; see :func:`plan_of`."""
        return dict(self.tables["about"].get("yardstick", {}))


@functools.cache
def tasks() -> Mapping[str, Task]:
    """The ten tasks by name, in order."""
    each = sorted((Task.load(path) for path in FOLDER.glob("*.toml")), key=lambda task: task.number)
    return {task.name: task for task in each}


def chosen(names: Sequence[str]) -> list[Task]:
    """The tasks of these names, or all, in their order. Raises InputError for another name."""
    known = tasks()
    for name in names:
        if name not in known:
            raise InputError(f"no task {name!r}; {suggestion(name, known)}")
    return [task for name, task in known.items() if not names or name in names]


def plan_of(task: Task, law: Mapping[str, Any], draws: int | None = None, knows: bool = False) -> Plan:
    """The runs of a law, a table of ``[[laws]]``, on a task: all of its draws, or the first few. Raises InputError if
    the law can't run there.

    A law may know the truth at B (``knows``). Where the task has a yardstick in its place, the yardstick's law runs
    with its keys, which do not vary then.
    """
    tables = {name: value for name, value in task.tables.items() if name != "about"} | {"laws": [dict(law)]}
    if knows and task.yardstick:
        keys = dict(task.yardstick["keys"])
        tables["laws"] = [{"name": task.yardstick["law"], "label": law["label"], **keys}]
        left = [entry for entry in tables["vary"] if entry.get("key", "").partition(".")[0] not in _tables(keys)]
        tables["vary"] = left
    overrides = {} if draws is None else {"design.runs": draws}
    return Plan.from_dict(tables, FOLDER, overrides, place=task.name)


def _tables(keys: Mapping[str, Any]) -> set[str]:
    return {key.partition(".")[0] for key in keys}
