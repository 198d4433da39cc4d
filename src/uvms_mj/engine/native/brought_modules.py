"""Modules in Python that an FMU brings with it, apart from the process's own."""

import builtins
import contextlib
import importlib.machinery
import importlib.util
import sys
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, ClassVar


def modules_of(resources: Path) -> frozenset[str]:
    """The names of the modules in Python that an FMU brings, as PythonFMU makes them, without modules of machine code,
    which a process loads once."""
    found = {each.stem for each in resources.glob("*.py")}
    for each in resources.iterdir() if found else ():
        if each.is_dir() and next(each.rglob("*.py"), None) and not next(each.rglob("*.so"), None):
            found.add(each.name)
    return frozenset(found - sys.stdlib_module_names)


class BroughtModules:
    """The modules in Python that an FMU brings, for one instance: it finds them whenever it imports one, and no other
    one finds them.

    Args:
        folder: where the FMU is unpacked.
        names: of its modules that have no dots.
    """

    _lock: ClassVar = threading.RLock()

    def __init__(self, folder: Path, names: frozenset[str]) -> None:
        self._folder, self._names, self._depth = folder, names, 0
        self._loaded: dict[str, Any] = {}
        self._builtins = {**vars(builtins), "__import__": self._import}

    @contextlib.contextmanager
    def present(self) -> Iterator[None]:
        """A context in which ``sys.modules`` has these modules under their names, and afterwards what it had before."""
        if not self._names:
            yield
            return
        with self._lock:
            self._depth += 1
            if self._depth == 1:
                aside = self._taken()
                sys.modules.update(self._loaded)
                sys.meta_path.insert(0, self)
            try:
                yield
            finally:
                self._depth -= 1
                if not self._depth:
                    sys.meta_path.remove(self)
                    self._loaded = self._taken()
                    sys.modules.update(aside)
                    sys.path[:] = [each for each in sys.path if not Path(each).is_relative_to(self._folder)]

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        """Where a module is, for Python's import."""
        if name.partition(".")[0] not in self._names:
            return None
        kinds: Any = (partial(_Brought, self._builtins), importlib.machinery.SOURCE_SUFFIXES)
        places = [str(self._folder / "resources")] if path is None else path
        found = (importlib.machinery.FileFinder(each, kinds).find_spec(name) for each in places)
        return next((spec for spec in found if spec is not None and spec.loader is not None), None)

    def _taken(self) -> dict[str, Any]:
        """Take the modules of these names out of ``sys.modules``."""
        found = {name: module for name, module in sys.modules.items() if name.partition(".")[0] in self._names}
        for name in found:
            del sys.modules[name]
        return found

    def _import(self, name: str, globals: Any = None, locals: Any = None, fromlist: Any = (), level: int = 0) -> Any:
        """The function behind ``import`` in these modules, also during a run."""
        if level == 0 and name.partition(".")[0] not in self._names:
            return builtins.__import__(name, globals, locals, fromlist, level)
        known = self._loaded.get(name) if level == 0 else None
        if known is not None and all(hasattr(known, each) for each in fromlist or ()):  # as in each step
            return known if fromlist else self._loaded[name.partition(".")[0]]
        with self.present():
            return builtins.__import__(name, globals, locals, fromlist, level)


class _Brought(importlib.machinery.SourceFileLoader):
    def __init__(self, own: dict[str, Any], name: str, path: str) -> None:
        super().__init__(name, path)
        self._own = own

    def exec_module(self, module: Any) -> None:
        vars(module)["__builtins__"] = self._own  # which its functions keep
        super().exec_module(module)
