"""Compiling with numba, and a disk cache that can't be stale.

Numba's own cache looks at the file of the compiled function only: an edit to a file that it imports goes unseen. Here every cache
folder is named by a fingerprint of all the sources that can reach the machine code, so that an edit simply leads to another folder.
"""

import ast
import functools
import hashlib
import os
import shutil
import sys
import sysconfig
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numba
import numpy as np
import platformdirs
from numba.core import config

_PACKAGE = Path(__file__).parent
_CORE = (
    "compilation.py",
    "control/task.py",
    "estimates.py",
    "fossen.py",
    "frames.py",
    "hydrodynamics.py",
    "native/callback.py",
    "native/laws.py",
    "native/layouts.py",
    "native/loop.py",
    "native/symbols.py",
    "reference.py",
    "signals.py",
)
"""All that can reach the machine code of the core; an import contract keeps these files from using others of the package."""
_FOREIGN = tuple(
    Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib")
)
_KEPT_FOLDERS = 48
_MIN_AGE_S = 7 * 24 * 3600.0
_lock = threading.RLock()


def fingerprint(parts: Iterable[bytes]) -> str:
    """A short name for a sequence of byte strings."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()[:24]


@functools.cache
def _package_fingerprint() -> str:
    sources = ((_PACKAGE / name).read_bytes() for name in _CORE)
    return fingerprint([numba.__version__.encode(), np.__version__.encode(), sys.version.encode(), *sources])


@functools.cache
def _root() -> Path:
    """The cache's root: NUMBA_CACHE_DIR if set, else the user's cache folder, else (read-only home) a temporary one."""
    wanted = os.environ.get("NUMBA_CACHE_DIR")
    root = Path(wanted) / "uvms-mj" if wanted else Path(platformdirs.user_cache_dir("uvms-mj"))
    try:
        root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=root):
            pass
    except OSError:
        root = Path(tempfile.mkdtemp(prefix="uvms-mj-cache-"))
    return root


def _prune(root: Path) -> None:
    """Forget the folders of sources long gone; a folder in use by another process is young, or is simply made again."""
    folders = sorted((f for f in root.iterdir() if f.is_dir()), key=lambda f: f.stat().st_mtime)
    for folder in folders[:-_KEPT_FOLDERS]:
        if time.time() - folder.stat().st_mtime > _MIN_AGE_S:
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def cache_folder(name: str) -> Iterator[None]:
    """Functions decorated with ``cache=True`` inside are cached in the folder of that name (and of this package's sources)."""
    with _lock:
        folder = _root() / f"{_package_fingerprint()[:12]}-{name}"
        if not folder.exists():
            _prune(_root())
            folder.mkdir(parents=True, exist_ok=True)
        before, config.CACHE_DIR = config.CACHE_DIR, str(folder)
        try:
            yield
        finally:
            config.CACHE_DIR = before


def kernel(function):
    """Compile a pure function of floats, arrays and records; it runs inside the step and can be called from Python as well.

    Inlined where it is called: there the shapes are known, and a product with a 6x6 matrix takes a third of the time.
    """
    with cache_folder("core"):
        return numba.njit(cache=True, error_model="numpy", forceinline=True)(function)


def source_files(module: ModuleType) -> list[Path]:
    """The file of a module and those of all it imports, however deep, but for installed packages and the standard library.

    Imports are read from the source: a constant taken from another file leaves no trace in the module itself.
    """
    found: dict[Path, None] = {}
    todo = [Path(str(module.__file__)).resolve()]
    while todo:
        path = todo.pop()
        if path in found or not path.is_file() or path.suffix != ".py":
            continue
        if found and any(path.is_relative_to(folder) for folder in (*_FOREIGN, _PACKAGE)):
            continue
        found[path] = None
        for node in ast.walk(ast.parse(path.read_bytes())):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            todo += [origin for name in names if (origin := _origin(name)) is not None]
    return sorted(found)


def _origin(name: str) -> Path | None:
    loaded = sys.modules.get(name)
    if loaded is not None:
        file = getattr(loaded, "__file__", None)
        return Path(file).resolve() if file else None
    try:
        spec = find_spec(name)
    except (ImportError, ValueError, AttributeError):
        return None
    return Path(spec.origin).resolve() if spec is not None and spec.origin and spec.has_location else None


def global_values(module: ModuleType) -> bytes:
    """The plain values among a module's globals, which numba freezes into the machine code."""
    kinds = (bool, int, float, complex, str, tuple, np.ndarray, np.generic)
    values = {name: value for name, value in vars(module).items() if isinstance(value, kinds) and name[:2] != "__"}
    return b"".join(
        name.encode() + (value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
        for name, value in sorted(values.items())
    )
