"""A study as it travels to a worker: its tables, and the contents of the files that they name.

A worker writes the files to a temporary folder. So a study has the same laws, metrics and vehicles on every machine,
and until its end, whatever happens to the user's files meanwhile.
"""

import functools
import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...engine.native.stage_code import source_files
from ...errors import InputError
from ...plant.mjcf import Mjcf
from ...records.header import versions
from ...stages.loader import load_file

if TYPE_CHECKING:
    from ..plan import Plan

_HERE = "<files>/"
"""Beginning of a path in the tables of a parcel, in place of the worker's folder."""
_PACKAGE = Path(__file__).parents[2]
_NO_NUMBERS = (
    *("cli", "envs", "views"),
    *(f"studies/{name}" for name in ("dataset.py", "pages", "paper", "plan/success.py", "report", "tune")),
)
"""Folders whose code does not affect a row."""


@functools.cache
def code() -> dict[str, str]:
    """Versions of everything that affects a row, and a digest of this package's sources."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        if not path.relative_to(_PACKAGE).as_posix().startswith(_NO_NUMBERS):
            digest.update(path.read_bytes())
    return versions() | {"sources": digest.hexdigest()[:12]}


@dataclass(frozen=True)
class Parcel:
    """The tables of a study, with paths that begin with ``<files>/``; the contents of the files by name; and the
    code that the worker must have."""

    tables: dict[str, Any]
    files: Mapping[str, bytes] = field(repr=False)
    code: Mapping[str, str]

    @classmethod
    def of(cls, plan: "Plan") -> "Parcel":
        """Pack a plan. Raises InputError if a file can't be read."""
        files: dict[str, bytes] = {}
        return cls(_changed(plan.tables, lambda text: _packed(text, files)), files, code())

    @functools.cached_property
    def digest(self) -> str:
        """Digest of tables and files: of two studies with equal digests, each run is the same."""
        digest = hashlib.sha256(json.dumps(self.tables, sort_keys=True).encode())
        for name, data in sorted(self.files.items()):
            digest.update(f"{name} {hashlib.sha256(data).hexdigest()}".encode())
        return digest.hexdigest()[:32]

    def plan(self) -> "Plan":
        """Unpack the plan on a worker, once a process. Raises InputError if this worker has other code."""
        from ..plan import Plan

        ours = code()
        other = [f"{name} {ours.get(name)} there, {v} here" for name, v in self.code.items() if ours.get(name) != v]
        if other:
            raise InputError(f"a worker has other code than this machine: {'; '.join(other)}; install the same on both")
        if self.digest not in _plans:
            _plans.clear()
            folder = self._folder()

            def here(text: str) -> str:
                return text.replace(_HERE, folder, 1) if text.startswith(_HERE) else text

            _plans[self.digest] = Plan.from_dict(_changed(self.tables, here))
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
"""The last plan by the digest of its parcel."""


def _changed(value: Any, change: Callable[[str], str]) -> Any:
    """A value of a table with each text in it changed."""
    if isinstance(value, Mapping):
        return {key: _changed(each, change) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_changed(each, change) for each in value]
    return change(value) if isinstance(value, str) else value


def _packed(value: str, files: dict[str, bytes]) -> str:
    """A text of a table; the name of a file is packed."""
    file, colon, name = value.rpartition(":") if ".py:" in value else (value, "", "")
    path = Path(file)
    if not path.is_absolute() or path.suffix not in (".py", ".xml") or not path.is_file():
        return value
    pack = _pack_code if path.suffix == ".py" else _pack_vehicle
    return f"{_HERE}{pack(path, files)}{colon}{name}"


def _pack_code(path: Path, files: dict[str, bytes]) -> str:
    """Pack a file of Python with the files that it imports. Returns its name."""
    path = path.resolve()
    sources = source_files(load_file(path, "study"))
    roots = [path.parent, *sorted((Path(p).resolve() for p in sys.path if p), key=lambda p: -len(p.parts))]
    name = f"code-{_short(str(path).encode())}"
    for source in sources:
        root = next((root for root in roots if source.is_relative_to(root)), source.parent)
        files[f"{name}/{source.relative_to(root)}"] = source.read_bytes()
    return f"{name}/{path.name}"


def _pack_vehicle(path: Path, files: dict[str, bytes]) -> str:
    """Pack a vehicle's model with all its files. Returns its name."""
    mjcf = Mjcf.find(str(path))
    folder = f"vehicle-{_short(str(path).encode())}"
    for name, data in mjcf.files.items():
        files[f"{folder}/{name}"] = data
    return f"{folder}/{mjcf.name}"


def _short(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:8]
