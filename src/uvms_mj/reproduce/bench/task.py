"""The tasks of the benchmark: study files, each with its number, version, reason, literature and pass criteria;
and the laws on the benchmark, as a user names them: a shipped name, a file, or a TOML file with ``[[laws]]``.
"""

import functools
import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...control import BUILT_IN
from ...errors import Fault, InputError, shortened, suggestion
from ...files import parse_setting, plain, tables_of
from ...quantities import leaves
from ...stages.foreign import parted
from ...studies.bundle import StudyBundle
from ...studies.plan import Plan
from ...studies.plan.file import PATHS, absolute
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
        tables: the tables of its study file.
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


TABLES = ("controller", "task", "impedance", "observer", "actuation")
"""The tables of a scenario that belong to a law: its gains, its sliding variable, the impedance that it imposes, its
observer of the contact force and its allocation."""
OF_TASKS = {
    **dict.fromkeys(("controller.period", "controller.delay"), "the control rate"),
    "task.frame": "the frame",
    **dict.fromkeys(("impedance.F_d", "impedance.schedule"), "the demanded push"),
}
"""Keys of these tables that a task sets, with what they are."""
_LABEL = re.compile(r"[^./:][^/:]{0,59}")
_NO_LABELS = (RESULT, LATEX, PAGE)


@dataclass(frozen=True)
class Entry:
    """A law on the benchmark.

    Attributes:
        label: its name in tables, and of its folder.
        source: a shipped name, or path/to/file.py:Class, path/to/file.c, path/to/library.so:NAME, path/to/file.fmu.
        settings: dotted keys, the same for all tasks.
        tuned: dotted keys for single tasks, in place of the settings; the second table has them.
    """

    label: str
    source: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    tuned: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def table(self, task: Task | None = None) -> dict[str, Any]:
        """The law as a table of ``[[laws]]``, with the gains of a task or of all tasks."""
        own = self.tuned.get(task.name, {}) if task is not None else {}
        return {"name": self.source, "label": self.label, **self.settings, **own}

    def plan(self, task: Task, draws: int | None = None, tuned: bool = False) -> Plan:
        """Its runs on a task. Raises InputError if it can't run there."""
        knows = self.source in BUILT_IN and BUILT_IN[self.source].uses_truth
        return plan_of(task, self.table(task if tuned else None), draws, knows)


def entries_of(words: Sequence[str], known: Iterable[str]) -> list[Entry]:
    """The laws that the words of a command name: ``LAW [KEY=VALUE]... LAW ...``; none: all shipped ones.

    A setting belongs to the law before it; ``label=NAME`` names it. ``known`` are the names of tasks.
    Raises InputError with every error.
    """
    if not words:
        return [Entry(name, name) for name in BUILT_IN]
    given: list[tuple[str, dict[str, Any]]] = []
    for word in words:
        if "=" not in word:
            given.append((word, {}))
        elif not given:
            raise InputError(f"{word}: a setting follows its law: LAW {word}")
        else:
            key, value = parse_setting(word)
            if key in given[-1][1]:
                raise InputError(f"{key}: is given twice for {given[-1][0]}")
            given[-1][1][key] = value
    tables: list[tuple[dict[str, Any], Path, str]] = []
    for law, settings in given:
        if law.endswith(".toml"):
            if settings:
                raise InputError(f"{law}: has settings of its own; write {', '.join(settings)} there")
            tables += _of_file(Path(law))
        else:
            tables.append(({"name": law, **settings}, Path.cwd(), law))
    found, faults = list[Entry](), list[Fault]()
    for table, folder, place in tables:
        entry = _entry(table, folder, place, tuple(known), faults)
        if entry is not None and any(entry.label == each.label for each in found):
            faults.append(Fault(place, f"{entry.label!r} is used twice; give each law a label: label=NAME"))
        elif entry is not None:
            found.append(entry)
    if faults:
        raise InputError(faults, "bench")
    return found


def _of_file(path: Path) -> list[tuple[dict[str, Any], Path, str]]:
    """The tables of a file of laws."""
    tables = tables_of(path, "file of laws") if path.is_file() else None
    if tables is None:
        raise InputError(f"{path}: no such file")
    laws = tables.pop("laws", None)
    tables.pop("name")
    if not isinstance(laws, list) or not laws or not all(isinstance(law, Mapping) for law in laws):
        raise InputError(f'{path}: has no laws: write [[laws]] and below it name = "gsta", controller.k_1 = 8.0')
    if tables:
        raise InputError(f"{path}: {', '.join(tables)}: a file of laws has [[laws]] alone")
    return [(dict(law), path.parent, f"{path}: laws[{i}]") for i, law in enumerate(laws)]


def _entry(table: dict[str, Any], folder: Path, place: str, known: Sequence[str], faults: list[Fault]) -> Entry | None:
    """The entry of a table of ``[[laws]]``. Errors are appended to ``faults``."""
    before = len(faults)
    source, label, tuned = table.pop("name", None), table.pop("label", None), table.pop("tuned", {})
    if not isinstance(source, str) or not source:
        faults.append(Fault(place, f"name: {shortened(source)} is not a law; give a name or a file"))
        return None
    if source in known:
        faults.append(Fault(place, f"is a task, not a law: --tasks {source}"))
        return None
    source = absolute(source, folder)
    if label is None:
        file, name = parted(source)
        label = (name or Path(file).stem) if file else source
    if not isinstance(label, str) or not _LABEL.fullmatch(label) or not label.isprintable() or label in _NO_LABELS:
        wanted = "must be a text of 1 to 60 characters without / and :, which names a folder"
        faults.append(Fault(place, f"label: {shortened(label)} {wanted}"))
    settings = _settings(table, folder, place, faults)
    if not isinstance(tuned, Mapping):
        faults.append(Fault(place, "tuned: must be tables by task, [laws.tuned.slide]"))
        tuned = {}
    own = {}
    for task, keys in tuned.items():
        if task not in known:
            faults.append(Fault(place, f"tuned.{task}: no such task; {suggestion(task, known)}"))
        elif isinstance(keys, Mapping) and keys:
            own[task] = _settings(keys, folder, f"{place}: tuned.{task}", faults)
        else:
            faults.append(Fault(place, f"tuned.{task}: must be a table of settings"))
    return Entry(label, source, settings, own) if len(faults) == before else None


def _settings(table: Mapping[str, Any], folder: Path, place: str, faults: list[Fault]) -> dict[str, Any]:
    """The dotted keys of a table, with files in ``folder``. Keys that belong to the task are errors."""
    found = {}
    for key, value in leaves(table, lists=False):
        name, dot, word = key.partition(".")
        if key == "controller.name":
            faults.append(Fault(place, f"{key}: give the law itself"))
        elif key in OF_TASKS:
            faults.append(Fault(place, f"{key}: the task sets {OF_TASKS[key]}, for all laws alike"))
        elif name not in TABLES or not dot or not word:
            allowed = ", ".join(f"{each}.*" for each in TABLES)
            faults.append(Fault(place, f"{key}: belongs to the task; a law has {allowed}, and label"))
        else:
            found[key] = absolute(plain(value), folder) if key in PATHS else plain(value)
    return found


def with_bare_names(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings with the names of files without their folders."""
    return {key: Path(value).name if key in PATHS else value for key, value in settings.items()}


def identity(plan: Plan) -> dict[str, Any]:
    """What decides a law: its name without folders, its settings with their defaults, its files by their digests, and a
    digest of all of it."""
    law = plan.laws[0]
    files = StudyBundle.of(plan).files
    gains = {k: v for k, v in law.scenario.to_dict()["controller"].items() if k not in ("name", "period", "delay")}
    others = {key: value for key, value in law.overrides.items() if not key.startswith("controller.")}
    digests: dict[str, str] = {}
    for name, data in files.items():
        if name.startswith("code-"):
            own, digest = name.partition("/")[2], hashlib.sha256(data).hexdigest()
            # of two folders, such as a law's and an allocation's, each may have a file of this name
            digests[own] = " ".join(sorted({digest, *digests.get(own, "").split()}))
    found: dict[str, Any] = {
        "name": Path(law.source).name,
        "gains": gains,
        "settings": with_bare_names(others),
        "files": dict(sorted(digests.items())),
    }
    found["digest"] = hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()[:16]
    return found
