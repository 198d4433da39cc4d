"""Objects that are kept on disk: machine code by a fingerprint of all that it is made of."""

import atexit
import contextlib
import functools
import gc
import hashlib
import importlib.metadata
import json
import os
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import platformdirs

_PACKAGE = Path(__file__).parents[2]

_ROOMS = ("compiler", "physics", "stages", "guidance", "navigation", "control", "actuation", "plant", "engine/native")
"""The folders whose sources affect machine code. A test checks that kernels import nothing else of the package."""
_KEPT_OBJECTS = 400  # of a user's stage two: its machine code, and the name of its translation
_MIN_AGE_S = 7 * 24 * 3600.0
_VARIABLE = "UVMS_MJ_CACHE_DIR"


class CacheWarning(UserWarning):
    """Machine code can't be kept on disk."""


@contextlib.contextmanager
def uncollected() -> Iterator[None]:
    """Work without garbage collection, which would look at a growing part of it again and again."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def object_name(parts: Iterable[bytes], sources: bool = True) -> str:
    """The name of an object from what its function is made of, besides the package's sources if ``sources``."""
    return fingerprint([*_environment(), *([_sources_digest()] if sources else []), *parts])


def keep(name: str, code: bytes, symbols: Sequence[str], externals: Iterable[str]) -> None:
    """Keep an object on disk if that is possible; otherwise the next process compiles it again."""
    about: dict[str, Any] = {"symbols": [*symbols], "externals": sorted(externals)}
    about["sha256"] = _digest(name, code, about)
    with contextlib.suppress(OSError):  # e.g. on a full disk
        _write(name, code, about)


def remember(name: str, code: bytes, facts: dict[str, Any]) -> None:
    """Keep the code of a fleet on disk, with facts about it, if that is possible."""
    about: dict[str, Any] = {"symbols": [], "externals": [], "facts": facts}
    about["sha256"] = _digest(name, code, about)
    with contextlib.suppress(OSError):
        _write(name, code, about)


def recall(name: str) -> tuple[bytes, dict[str, Any]] | None:
    """The code of :func:`remember` and its facts; None if it is missing or damaged."""
    found = read(name)
    return None if found is None else (found[0], found[1]["facts"])


def read(name: str) -> tuple[bytes, dict[str, Any]] | None:
    """The code of an object on disk, and its metadata; None if it is missing or damaged."""
    folder = cache_folder()
    try:
        about = json.loads((folder / f"{name}.json").read_bytes())
        code = (folder / f"{name}.o").read_bytes()
        return (code, about) if about["sha256"] == _digest(name, code, about) else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _write(name: str, code: bytes, about: dict[str, Any]) -> None:
    folder = cache_folder()
    _prune_once(folder)
    with tempfile.TemporaryDirectory(prefix="new-", dir=folder) as new:
        for suffix, content in ((".o", code), (".json", json.dumps(about).encode())):
            part = Path(new, f"{name}{suffix}")
            part.write_bytes(content)
            os.replace(part, folder / part.name)


def _digest(name: str, code: bytes, about: dict[str, Any]) -> str:
    """Digest of an object file with its name and metadata. A damaged file, or the file of another function, could crash
    the process."""
    parts = [name, about["symbols"], about["externals"], *([about["facts"]] if "facts" in about else [])]
    return fingerprint([code, json.dumps(parts).encode()])


def fingerprint(parts: Iterable[bytes]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()[:32]


@functools.cache
def _environment() -> tuple[bytes, ...]:
    """Dependencies of all machine code: versions and processor."""
    features = llvm.get_host_cpu_features()
    return (
        *(importlib.metadata.version(name).encode() for name in ("llvmlite", "numpy")),
        sys.version.encode(),
        llvm.get_host_cpu_name().encode(),
        features.flatten().encode(),
    )


@functools.cache
def _sources_digest() -> bytes:
    """Of the package's sources, which one process reads once."""
    return fingerprint(_sources()).encode()


def _sources() -> tuple[bytes, ...]:
    """The package's sources."""
    return tuple(path.read_bytes() for room in _ROOMS for path in sorted((_PACKAGE / room).rglob("*.py")))


@functools.cache
def cache_folder() -> Path:
    """The folder of the objects. If it can't be written, a temporary one replaces it, also for child processes."""
    folder = Path(os.environ.get(_VARIABLE) or platformdirs.user_cache_dir("uvms-mj")).absolute()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        wrong, remedy = _of_others(folder)
    except OSError as error:
        wrong, remedy = str(error.strerror), f"set {_VARIABLE} to a writable folder"
    if wrong:
        note = f"machine code can't be kept in {folder} ({wrong}), so every run compiles it again: {remedy}"
        warnings.warn(note, CacheWarning, stacklevel=2)
        folder = Path(tempfile.mkdtemp(prefix="uvms-mj-cache-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        os.environ[_VARIABLE] = str(folder)
    return folder


def _of_others(folder: Path) -> tuple[str, str]:
    """Why others could put code into a folder, which this process would run, and what to do; empty texts if they can't.
    Windows has other rights, and no numbers of users."""
    about = folder.stat()
    if hasattr(os, "getuid") and about.st_uid != os.getuid():
        return "it belongs to another user", f"set {_VARIABLE} to a folder of yours"
    if about.st_mode & 0o022:
        return "other users may write there", f"chmod go-w {folder}"
    return "", ""


@functools.cache
def _prune_once(folder: Path) -> None:
    _prune(folder)


def _prune(folder: Path) -> None:
    """Delete the oldest objects. An object that is needed again is compiled again."""
    entries = []
    for path in folder.iterdir():
        with contextlib.suppress(FileNotFoundError):  # another process has moved or deleted it
            entries.append((path.stat().st_mtime, path))
    for modified, path in sorted(entries)[: -2 * _KEPT_OBJECTS]:
        if time.time() - modified > _MIN_AGE_S:
            if path.is_dir():  # left by a process that was killed in _write
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
