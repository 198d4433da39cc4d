"""Compilation of pure Python functions to machine code before the run, with a cache on disk.

A function marked as a kernel (:mod:`.physics.kernels`) stays a plain Python function; numba compiles it together with
each entry point that calls it. The machine code of an entry point is kept as an object file, so that a warm start loads
it in milliseconds and does not import numba. Numba's own cache would need that import, and it checks only the file of
the compiled function. Here an object's name is a fingerprint of all sources that affect it, so that an edit to any of
them leads to a new object.
"""

import atexit
import contextlib
import ctypes
import functools
import hashlib
import importlib.metadata
import json
import os
import re
import shutil
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import platformdirs

from ...physics.kernels import kernels

_PACKAGE = Path(__file__).parents[2]
_CORE = (
    "physics/contact.py",
    "control/task.py",
    "control/tracking.py",
    "physics/model.py",
    "physics/fossen.py",
    "physics/frames.py",
    "physics/hydrodynamics.py",
    "physics/kernels.py",
    "engine/native/arena.py",
    "engine/native/callback.py",
    "engine/native/checked_arrays.py",
    "engine/native/compilation.py",
    "engine/native/guarded.py",
    "engine/native/intrinsics.py",
    "engine/native/laws.py",
    "engine/native/layouts.py",
    "engine/native/loop.py",
    "engine/native/memory.py",
    "engine/native/sources.py",
    "guidance/filtered_steps.py",
    "stages/signals.py",
    "navigation/truth.py",
)
"""The files that affect the machine code of the core. A test checks that they import no others of the package."""
_KEPT_OBJECTS = 200
_MIN_AGE_S = 7 * 24 * 3600.0
_INLINED = {"error_model": "numpy", "forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_DISABLE = "NUMBA_DISABLE_JIT"
"""Environment variable for debugging: a user's law then runs as plain Python, the core still as machine code."""
_VARIABLE = "UVMS_MJ_CACHE_DIR"
_lock = threading.RLock()
_engines: list[llvm.ExecutionEngine] = []  # machine code lives as long as its engine


@dataclass(frozen=True)
class NativeFunction:
    """Machine code: its address, and a ctypes function to call it from Python."""

    address: int
    ctypes: Any


class CacheWarning(UserWarning):
    """Machine code can't be kept on disk."""


class NotCompiled(Exception):
    """Numba can't compile a function; the message is numba's reason."""


def native_function(
    function: Callable,
    arguments: int,
    returns: bool,
    *,
    parts: Iterable[bytes] = (),
    prepare: Callable[[], Callable] | None = None,
    self_contained: bool = True,
    law: bool = False,
) -> NativeFunction:
    """A C function of 64-bit integers from a Python function, loaded from disk or compiled.

    Args:
        function: the function to compile.
        arguments: the number of its arguments.
        returns: whether it returns a 64-bit integer or nothing.
        parts: contents that the machine code depends on, besides the core's sources.
        prepare: returns the function to compile in place of ``function``; called only if no object is on disk.
        self_contained: whether it neither raises nor allocates, and so runs without numba's runtime.
        law: whether to check indices and shapes in all compiled code.

    Raises:
        NotCompiled: numba can't compile the function.
    """
    if not self_contained and os.environ.get(_DISABLE, "0") not in ("", "0"):
        raise NotCompiled(f"{_DISABLE} is set")
    name = _fingerprint([*_environment(), function.__qualname__.encode(), *parts])
    with _lock:
        loaded = _load(name, self_contained)
        if loaded is None:
            with _compiler():
                loaded = _compile(prepare() if prepare else function, arguments, returns, name, law)
    result = ctypes.c_int64 if returns else None
    return NativeFunction(loaded, ctypes.CFUNCTYPE(result, *[ctypes.c_int64] * arguments)(loaded))


@contextlib.contextmanager
def _compiler() -> Iterator[None]:
    """Within this context numba compiles, whether or not NUMBA_DISABLE_JIT is set."""
    import numba

    config: Any = numba.config
    before, config.DISABLE_JIT = config.DISABLE_JIT, 0
    try:
        yield
    finally:
        config.DISABLE_JIT = before


def _compile(function: Callable, arguments: int, returns: bool, name: str, law: bool) -> int:
    """Compile a function, keep its object on disk and return its address."""
    import numba
    from numba import types

    from ..native import intrinsics
    from .guarded import guarded

    intrinsics.register()
    for each in kernels:
        _make_compilable(each)
    signature = (types.int64 if returns else types.void)(*[types.int64] * arguments)
    try:
        with guarded(law):
            compiled: Any = numba.cfunc(signature, error_model="numpy")(function)
        library = compiled._library
        code = library.serialize_using_object_code()[2][0]
    except Exception as error:  # for unsupported code numba raises not only its own exceptions
        raise NotCompiled(_reason(error)) from error
    _engines.append(compiled)
    declared = {f.name for f in library._final_module.functions if f.is_declaration and f.name[:5] != "llvm."}
    about = {"symbol": compiled.native_name, "externals": sorted(declared)}
    about["sha256"] = _digest(code, about)
    if _stands_alone(str(library._final_module)):
        with contextlib.suppress(OSError):  # e.g. on a full disk: then the next process compiles it again
            _keep(name, code, about)
    return int(compiled.address)


def _stands_alone(code: str) -> bool:
    """Whether code, given as LLVM's text, uses no Python objects of the compiling process, as printing does.

    Numba keeps such objects in an environment for each function. Numba's own functions, whose mangled names begin with
    ``5numba``, use it only for the texts of exceptions.
    """
    return all(owner.startswith("5numba") for owner in re.findall(r"load [^@\n]*@\"?_ZN08NumbaEnv(\w+)", code))


def _keep(name: str, code: bytes, about: dict[str, Any]) -> None:
    folder = _folder()
    _prune(folder)
    with tempfile.TemporaryDirectory(prefix="new-", dir=folder) as new:
        for suffix, content in ((".o", code), (".json", json.dumps(about).encode())):
            part = Path(new, f"{name}{suffix}")
            part.write_bytes(content)
            os.replace(part, folder / part.name)


@functools.cache
def _make_compilable(function: Callable) -> None:
    """Register a kernel with numba as a function that compiled code may call; once for each kernel."""
    from numba.extending import register_jitable

    register_jitable(**_INLINED)(function)


def _reason(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return next((line for line in lines if not line.startswith("Failed in")), type(error).__name__)


_WRAPPER = (
    "NRT_MemInfo_call_dtor",
    "NRT_Free",
    "numba_do_raise",
    "numba_gil_ensure",
    "numba_gil_release",
    "numba_runtime_build_excinfo_struct",
    "numba_unpickle",
)
"""Symbols that the wrapper of every compiled function refers to and calls only for an uncaught exception."""


def _load(name: str, self_contained: bool) -> int | None:
    """The address of a function from its object on disk; None if the object is missing, damaged or can't be linked."""
    folder = _folder()
    try:
        about = json.loads((folder / f"{name}.json").read_bytes())
        code = (folder / f"{name}.o").read_bytes()
        if about["sha256"] != _digest(code, about):
            return None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    _initialize()
    if not self_contained:
        from numba.core.registry import cpu_target

        cpu_target.target_context.refresh()  # registers the symbols of numba's runtime with LLVM
    process = ctypes.CDLL(None)
    for external in about["externals"]:  # LLVM silently links a call of an unknown symbol to address 0
        if llvm.address_of_symbol(external) is None and not hasattr(process, external):
            if not (self_contained and external in _WRAPPER):
                return None
            llvm.add_symbol(external, _abort())
    machine = llvm.Target.from_default_triple().create_target_machine(jit=True, codemodel="jitdefault")
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return engine.get_function_address(about["symbol"])


@functools.cache
def _initialize() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()


@functools.cache
def _abort() -> int:
    """Address of C's ``abort``, in place of the symbols that a wrapper refers to and never calls."""
    address = ctypes.cast(ctypes.CDLL(None).abort, ctypes.c_void_p).value
    assert address is not None
    return address


def _digest(code: bytes, about: dict[str, Any]) -> str:
    """Digest of an object file and its metadata. A damaged or forged file could crash the process."""
    return _fingerprint([code, json.dumps([about["symbol"], about["externals"]]).encode()])


def _fingerprint(parts: Iterable[bytes]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()[:32]


@functools.cache
def _environment() -> tuple[bytes, ...]:
    """Dependencies of machine code besides its function: versions, processor, the core's sources."""
    features = llvm.get_host_cpu_features()
    return (
        *(importlib.metadata.version(name).encode() for name in ("numba", "llvmlite", "numpy")),
        sys.version.encode(),
        llvm.get_host_cpu_name().encode(),
        features.flatten().encode(),
        *((_PACKAGE / name).read_bytes() for name in _CORE),
    )


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


def _prune(folder: Path) -> None:
    """Delete the oldest objects. An object that is needed again is compiled again."""
    entries = []
    for path in folder.iterdir():
        with contextlib.suppress(FileNotFoundError):  # another process has moved or deleted it
            entries.append((path.stat().st_mtime, path))
    for modified, path in sorted(entries)[: -2 * _KEPT_OBJECTS]:
        if time.time() - modified > _MIN_AGE_S:
            if path.is_dir():  # left by a process that was killed in _keep
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
