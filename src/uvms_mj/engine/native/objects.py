"""The objects of machine code on disk, and their way into the process.

The machine code of a function is kept as an object file, so that a warm start loads it in milliseconds. Its name is a
fingerprint of all that affects it, so that an edit to any source leads to a new object.
"""

import atexit
import contextlib
import ctypes
import functools
import hashlib
import importlib.metadata
import json
import os
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import platformdirs

_PACKAGE = Path(__file__).parents[2]
_ROOMS = ("compiler", "physics", "stages", "guidance", "navigation", "control", "actuation", "engine/native")
"""The folders whose sources affect machine code. A test checks that kernels import nothing else of the package."""
_KEPT_OBJECTS = 200
_MIN_AGE_S = 7 * 24 * 3600.0
_VARIABLE = "UVMS_MJ_CACHE_DIR"
_engines: list[llvm.ExecutionEngine] = []  # machine code lives as long as its engine


class CacheWarning(UserWarning):
    """Machine code can't be kept on disk."""


@functools.cache
def target_machine() -> llvm.TargetMachine:
    """This processor."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple()
    reloc = "static" if target.name.startswith("x86") else "default"
    features = llvm.get_host_cpu_features().flatten()
    return target.create_target_machine(llvm.get_host_cpu_name(), features, 3, reloc, codemodel="jitdefault", jit=True)


def object_name(parts: Iterable[bytes], sources: bool = True) -> str:
    """The name of an object from what its function is made of, besides the package's sources if ``sources``."""
    return _fingerprint([*_environment(), *(_sources() if sources else ()), *parts])


def keep(name: str, code: bytes, symbols: Sequence[str], externals: Iterable[str]) -> None:
    """Keep an object on disk if that is possible; otherwise the next process compiles it again."""
    about: dict[str, Any] = {"symbols": [*symbols], "externals": sorted(externals)}
    about["sha256"] = _digest(code, about)
    with contextlib.suppress(OSError):  # e.g. on a full disk
        _write(name, code, about)


def load(name: str) -> tuple[int, ...] | None:
    """The addresses of the functions of an object on disk; None if it is missing, damaged or can't be linked."""
    folder = _folder()
    try:
        about = json.loads((folder / f"{name}.json").read_bytes())
        code = (folder / f"{name}.o").read_bytes()
        if about["sha256"] != _digest(code, about):
            return None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return link(code, about["symbols"], about["externals"])


def link(code: bytes, symbols: Iterable[str], externals: Iterable[str]) -> tuple[int, ...] | None:
    """The addresses of functions of an object file; None if a symbol that it uses is unknown in this process."""
    machine = target_machine()
    process = ctypes.CDLL(None)
    for external in externals:  # LLVM silently links a call of an unknown symbol to address 0
        if llvm.address_of_symbol(external) is None and not hasattr(process, external):
            return None
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return tuple(engine.get_function_address(symbol) for symbol in symbols)


def _write(name: str, code: bytes, about: dict[str, Any]) -> None:
    folder = _folder()
    _prune_once(folder)
    with tempfile.TemporaryDirectory(prefix="new-", dir=folder) as new:
        for suffix, content in ((".o", code), (".json", json.dumps(about).encode())):
            part = Path(new, f"{name}{suffix}")
            part.write_bytes(content)
            os.replace(part, folder / part.name)


def _digest(code: bytes, about: dict[str, Any]) -> str:
    """Digest of an object file and its metadata. A damaged or forged file could crash the process."""
    return _fingerprint([code, json.dumps([about["symbols"], about["externals"]]).encode()])


def _fingerprint(parts: Iterable[bytes]) -> str:
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
def _sources() -> tuple[bytes, ...]:
    """The package's sources."""
    return tuple(path.read_bytes() for room in _ROOMS for path in sorted((_PACKAGE / room).rglob("*.py")))


@functools.cache
def _folder() -> Path:
    """The folder of the objects. If it can't be written, a temporary one replaces it, also for child processes."""
    folder = Path(os.environ.get(_VARIABLE) or platformdirs.user_cache_dir("uvms-mj"))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        note = f"machine code can't be kept in {folder} ({error.strerror}), so every run compiles it again: "
        warnings.warn(f"{note}set {_VARIABLE} to a writable folder", CacheWarning, stacklevel=2)
        folder = Path(tempfile.mkdtemp(prefix="uvms-mj-cache-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        os.environ[_VARIABLE] = str(folder)
    return folder


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
