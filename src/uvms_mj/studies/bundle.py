"""A study as it travels to a worker: its tables, and the contents of the files that they name.

A worker writes the files to a temporary folder. So a study has the same laws, metrics and vehicles on every machine,
and until its end, whatever happens to the user's files meanwhile.
"""

import functools
import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ..errors import Fault, InputError
from ..files import shipped
from ..plant.mjcf import Mjcf
from ..records.header import versions
from ..stages.base import Stage
from ..stages.contract import listed_files, wrong_files
from ..stages.foreign import SUFFIXES, parted
from ..stages.loader import load_file
from ..stages.namespace import import_folders, name_beside, source_files

if TYPE_CHECKING:
    from .plan import Plan

HERE = "<files>/"
"""Beginning of a path in the tables of a bundle, in place of the worker's folder."""
_PACKAGE = Path(__file__).parents[1]
_NO_NUMBERS = (
    *("cli", "envs", "examples", "reproduce", "views"),  # a wheel has the examples, a checkout has them elsewhere
    *(f"studies/{name}" for name in ("pages", "report", "tune")),
)
"""Folders whose code does not affect a row."""


@functools.cache
def code() -> dict[str, str]:
    """Versions of everything that affects a row, and digests of this package's sources with their presets, and of its
    vehicles."""
    digest = hashlib.sha256()
    presets = (path for room in ("actuation", "navigation") for path in (_PACKAGE / room).glob("*.toml"))
    for path in sorted([*_PACKAGE.rglob("*.py"), *presets]):
        if not path.relative_to(_PACKAGE).as_posix().startswith(_NO_NUMBERS):
            digest.update(path.read_bytes())
    vehicles = hashlib.sha256(b"".join(path.read_bytes() for _, path in sorted(shipped("models").items())))
    return versions() | {"sources": digest.hexdigest()[:12], "vehicles": vehicles.hexdigest()[:12]}


@dataclass(frozen=True)
class StudyBundle:
    """The tables of a study, with paths that begin with ``<files>/``; the contents of the files by name; and the
    code that the worker must have."""

    tables: dict[str, Any]
    files: Mapping[str, bytes] = field(repr=False)
    code: Mapping[str, str]

    @classmethod
    def of(cls, plan: "Plan") -> "StudyBundle":
        """Pack a plan. Raises InputError if a file can't be read."""
        files: dict[str, bytes] = {}
        return cls(with_texts(plan.tables, lambda text: _packed(text, files)), files, code())

    @functools.cached_property
    def digest(self) -> str:
        """Digest of tables and files: of two studies with equal digests, each run is the same."""
        digest = hashlib.sha256(json.dumps(self.tables, sort_keys=True).encode())
        for name, data in sorted(self.files.items()):
            digest.update(f"{name} {hashlib.sha256(data).hexdigest()}".encode())
        return digest.hexdigest()[:32]

    def plan(self) -> "Plan":
        """Unpack the plan on a worker, once a process. Raises InputError if this worker has other code."""
        from .plan import Plan

        ours = code()
        other = [f"{name} {ours.get(name)} there, {v} here" for name, v in self.code.items() if ours.get(name) != v]
        if other:
            raise InputError(f"a worker has other code than this machine: {'; '.join(other)}; install the same on both")
        if self.digest not in _plans:
            _plans.clear()
            folder = self._folder()

            def here(text: str) -> str:
                return text.replace(HERE, folder, 1) if text.startswith(HERE) else text

            try:
                _plans[self.digest] = Plan.from_dict(with_texts(self.tables, here))
            except InputError as error:
                said = str(error).replace(folder, "")
                raise InputError(f"with the files alone that travel to a worker: {said}{_HINT}") from None
        return _plans[self.digest]

    def _folder(self) -> str:
        """The folder with the files, written by the first worker on a machine that needs it."""
        if not self.files:
            return ""
        above = Path(tempfile.gettempdir(), f"uvms-mj-{os.getuid()}")
        above.mkdir(mode=0o700, exist_ok=True)
        if above.stat().st_uid != os.getuid():
            raise InputError(f"{above}: belongs to another user; set TMPDIR to a folder of yours")
        folder = above / self.digest
        for name, data in self.files.items():
            path = folder / name
            if not path.is_file() or path.read_bytes() != data:
                path.parent.mkdir(parents=True, exist_ok=True)
                part = path.with_name(f".{path.name}-{os.getpid()}")
                part.write_bytes(data)
                os.replace(part, path)
        return f"{folder}/"


_plans: dict[str, "Plan"] = {}
"""The last plan by the digest of its bundle."""


_HINT = (
    "; a class lists what its file reads beside it, files = ['policy.npz'], and a file of metrics does so at its top"
)


def with_texts(value: Any, change: Callable[[str], str]) -> Any:
    """A value of a table with each text in it changed."""
    if isinstance(value, Mapping):
        return {key: with_texts(each, change) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [with_texts(each, change) for each in value]
    return change(value) if isinstance(value, str) else value


def _packed(value: str, files: dict[str, bytes]) -> str:
    """A text of a table; the name of a file is packed."""
    file, name = parted(value)
    path = Path(file or value)
    pack = _PACKS.get(path.suffix)
    if pack is None or not path.is_absolute() or not path.is_file():
        return value
    return f"{HERE}{pack(path, files, name)}{f':{name}' if name else ''}"


def _pack_code(path: Path, files: dict[str, bytes], function: str) -> str:
    """Pack a file of Python, of C or a library with the files that it imports or includes, and the files that it lists.
    Returns its name."""
    path = path.resolve()
    module = load_file(path, "study", function)
    name = _code_name(path)
    for source in (*source_files(module), *_listed(module)):
        files[f"{name}/{name_beside(path, source)}"] = source.read_bytes()
    return f"{name}/{path.name}"


def _listed(module: ModuleType) -> list[Path]:
    """The files that the classes of a module list, and the files of its own list, for metrics. Raises InputError if the
    latter is wrong."""
    file = Path(str(module.__file__))
    own = vars(module).get("files", ())
    if wrong := list(wrong_files(own, file.parent)):
        raise InputError([Fault("", f"{file.name}: {each}") for each in wrong])
    kinds = [each for each in vars(module).values() if isinstance(each, type) and issubclass(each, Stage)]
    return [path for kind in kinds for path in listed_files(kind).values()] + [file.parent / name for name in own]


def _code_name(path: Path) -> str:
    """The folder of a bundle for a file of Python."""
    return f"code-{_short(str(path).encode())}"


def files_of(value: str, then: Mapping[str, str]) -> tuple[str, dict[str, bytes]]:
    """A text of a study's table as a worker has it, and the files that it needs, by their names in ``then``, the
    digests by name of version.json: as they are now, empty where one has gone. Nothing is imported."""
    now: dict[str, bytes] = {}
    file, _ = parted(value)
    if file and Path(file).is_file():
        path = Path(file).resolve()
        folder = f"{_code_name(path)}/"
        now = {f"{folder}{path.name}": path.read_bytes()}
        for name in (name for name in then if name.startswith(folder)):
            there = [root / name.removeprefix(folder) for root in import_folders(path)]
            now[name] = next((each.read_bytes() for each in there if each.is_file()), b"")
        return value.replace(file, f"{HERE}{folder}{path.name}", 1), now
    return (value if file else _packed(value, now)), now


def changed_files(value: str, then: Mapping[str, str]) -> list[str]:
    """Names of the files that a text of a study's table needs and that are not in ``then``, the digests by name
    of version.json. Nothing is imported."""
    now = files_of(value, then)[1]
    return [Path(name).name for name, data in now.items() if hashlib.sha256(data).hexdigest() != then.get(name)]


def renamed(now: Mapping[str, str], then: Mapping[str, str]) -> dict[str, str]:
    """The digests ``now`` by name, with the name of ``then`` for a file that is in another folder now, as it was."""
    kept = {(name.partition("/")[2], digest): name for name, digest in then.items()}
    return {
        name if name in then else kept.get((name.partition("/")[2], digest), name): digest
        for name, digest in now.items()
    }


def _pack_vehicle(path: Path, files: dict[str, bytes], _: str) -> str:
    """Pack a vehicle's model with all its files. Returns its name."""
    mjcf = Mjcf.find(str(path))
    folder = f"vehicle-{_short(str(path).encode())}"
    for name, data in mjcf.files.items():
        files[f"{folder}/{name}"] = data
    return f"{folder}/{mjcf.name}"


def _pack_table(path: Path, files: dict[str, bytes], _: str) -> str:
    """Pack a file of numbers. Returns its name."""
    name = f"file-{_short(str(path).encode())}/{path.name}"
    files[name] = path.read_bytes()
    return name


_PACKS: Mapping[str, Callable[[Path, dict[str, bytes], str], str]] = {
    **dict.fromkeys((".py", *SUFFIXES), _pack_code),
    ".xml": _pack_vehicle,
    ".csv": _pack_table,
}
"""How a file of a table is packed, by its suffix."""


def _short(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:8]
