"""The tasks of the benchmark: study files, each with its number, version, reason, literature, pass criteria and levels
of difficulty; and the laws on the benchmark, as a user names them: a shipped name, a file, or a TOML file with
``[[laws]]``.
"""

import functools
import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...analysis.summary import COURSES
from ...control import BUILT_IN, SHIPPED
from ...errors import Fault, InputError, shortened, suggestion
from ...files import parse_setting, plain, tables_of
from ...quantities import leaves
from ...stages.foreign import parted
from ...studies.bundle import StudyBundle
from ...studies.plan import Plan
from ...studies.plan.file import PATHS, absolute
from .. import PAGE as PAGE
from .draws import KNOWN, Draws
from .sequential import MOST

NAME, VERSION = "Contact-10", 2
RESULT, LATEX = "bench.json", "table.tex"
"""Names of the result and of the LaTeX table in the folder."""
FOLDER = Path(__file__).with_name("tasks")
LEVELS = (1, 2, 3, 4, 5)
METRICS = (
    *("hold.error_N", "hold.bias_N", "hold.worst_N", "hold.lost_s", "hold.contacts", "hold.path_error_m"),
    *("hold.turn_error_deg", "contact.peak_N", "contact.settling_s", "contact.touches", "effort_N2s", "saturated_s"),
    *("chattering_N_per_s", *COURSES),
)
"""The metrics of each draw."""


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
        truth: a sentence on the row of the law that is told the truth; empty if nothing is to say.
        levels: one sentence a level: its difficulty.
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
    levels: Sequence[str]
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
            levels=about["levels"],
            tables=tables,
        )

    @property
    def digest(self) -> str:
        """Digest of everything in the file that a run or its verdict depends on."""
        ours = {name: value for name, value in self.tables.items() if name not in ("about", "description")}
        return hashlib.sha256(json.dumps(ours, sort_keys=True).encode()).hexdigest()[:16]

    def at(self, level: int, knows: bool = False) -> tuple[dict[str, Any], dict[str, Any]]:
        """The study file of a level, without its laws and its design, and the keys of its base scenario that are the
        level's own.

        In ``[levels]`` stands a list of one value a level: of keys of the base in ``base``, and of each entry of
        ``vary`` in ``low`` and ``high``, or in ``values``. ``[yardstick]`` has such keys of the yardstick alone
        (``knows``), in ``base``, and in ``levels`` with one value a level; a key that it has does not vary. In ``told``
        stands for a key of the yardstick's the drawn key whose number it has; ``law`` and ``gains`` name its structure.
        """
        tables = {name: value for name, value in self.tables.items() if name not in ("about", "levels", "yardstick")}
        levels, i = self.tables["levels"], LEVELS.index(level)
        yardstick = self.tables.get("yardstick", {}) if knows else {}
        fixed = dict(leaves(yardstick.get("base", {}), lists=False)) | _column(yardstick.get("levels", {}), i)
        vary = [*tables.get("vary", ()), *(_at(entry, i) for entry in levels.get("vary", ()))]
        tables |= {"keep": {"metrics": METRICS}, "run": tables["run"] | {"confined": True}}
        vary = [entry for entry in vary if not {entry.get("key"), *entry.get("keys", ())} & fixed.keys()]
        tables["vary"] = [_told(entry, yardstick.get("told", {})) for entry in vary]
        return tables, {"simulation.law_seed": 0} | _column(levels.get("base", {}), i) | fixed


def _column(table: Mapping[str, Any], i: int) -> dict[str, Any]:
    """The values of a level, by dotted key, from lists of one value a level."""
    return {key: values[i] for key, values in leaves(table, lists=False)}


def _at(entry: Mapping[str, Any], i: int) -> dict[str, Any]:
    """An entry of ``[[levels.vary]]`` at a level."""
    return {key: value[i] if key in ("low", "high", "values") else value for key, value in entry.items()}


def _told(entry: Mapping[str, Any], told: Mapping[str, Any]) -> Mapping[str, Any]:
    """An entry of ``[[vary]]`` whose numbers also the keys have that are told its key. It is then drawn anew: the keys
    of an entry decide its stream."""
    keys = [key for key, drawn in leaves(told, lists=False) if drawn == entry.get("key")]
    return entry if not keys else {"keys": [entry["key"], *keys]} | {k: v for k, v in entry.items() if k != "key"}


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
        trials: the budget of the search that chose its gains (:mod:`.tuning`); 0 if none did.
    """

    label: str
    source: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    trials: int = 0

    @property
    def knows(self) -> bool:
        """Whether the law is told the truth: the yardstick."""
        return self.source in SHIPPED and SHIPPED[self.source].uses_truth

    @property
    def budget(self) -> dict[str, int]:
        """The budget of its gains, in a file of laws and in a result; empty if no search chose them."""
        return {"trials": self.trials} if self.trials else {}

    def plan(self, task: Task, level: int, draws: Draws = KNOWN, most: int = MOST) -> Plan:
        """Its runs at a level of a task, at most so many draws. Raises InputError if it can't run there."""
        tables, overrides = task.at(level, self.knows)
        law = {"name": self.source, "label": self.label, **self.settings}
        yardstick = task.tables.get("yardstick", {})
        if self.knows and "law" in yardstick:
            law = {"name": yardstick["law"], "label": self.label, **yardstick.get("gains", {})}
        tables |= {"laws": [law], "design": {"kind": "random", "runs": most, "seed": draws.seed(task.name, level)}}
        return Plan.from_dict(tables, FOLDER, overrides, place=task.name)


@dataclass(frozen=True)
class Job:
    """A law on a task: its folder, and the plan of its first level, or why it can't run there."""

    entry: Entry
    task: Task
    folder: Path
    draws: Draws
    most: int
    first: Plan | None
    reason: str = ""

    def level(self, level: int) -> Path:
        """The folder of a level's study."""
        return self.folder / f"level-{level}"

    def plan(self, level: int) -> Plan:
        """The draws of a level."""
        return self.entry.plan(self.task, level, self.draws, self.most)


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
    source, label = table.pop("name", None), table.pop("label", None)
    if not isinstance(source, str) or not source:
        faults.append(Fault(place, f"name: {shortened(source)} is not a law; give a name or a file"))
        return None
    if source in known:
        faults.append(Fault(place, f"is a task, not a law: --tasks {source}"))
        return None
    source = absolute(source, folder)
    if label is None:
        file, name = parted(source)
        label = (name or Path(file).stem) if file else Path(source).name
    if not isinstance(label, str) or not _LABEL.fullmatch(label) or not label.isprintable() or label in _NO_LABELS:
        wanted = "must be a text of 1 to 60 characters without / and :, which names a folder"
        faults.append(Fault(place, f"label: {shortened(label)} {wanted}"))
    trials = table.pop("trials", 0)
    if not isinstance(trials, int) or isinstance(trials, bool) or trials < 0:
        faults.append(Fault(place, f"trials: {shortened(trials)} must be a number of trials, 0 or more"))
    settings = _settings(table, folder, place, faults)
    return Entry(label, source, settings, trials) if len(faults) == before else None


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
    """The identity of a law: its name without folders, its settings with their defaults, its files by their digests,
    and a digest of all of it."""
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
    return _digested(found)


def law_of(entry: Entry, plan: Plan) -> dict[str, Any]:
    """:func:`identity` of an entry, of which a plan is. The yardstick's structure is each task's, and in its digest."""
    if not entry.knows:
        return identity(plan)
    own = {"name": entry.source, "gains": {}, "settings": with_bare_names(entry.settings), "files": {}}
    return _digested(own)


def _digested(found: dict[str, Any]) -> dict[str, Any]:
    return found | {"digest": hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()[:16]}
