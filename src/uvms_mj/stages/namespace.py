"""Users' modules in namespaces: a file is loaded with all modules and packages beside it, apart from all others.

A namespace is loaded for one run. Two files ``utils.py`` never meet in it, an edited module is seen by the next one,
and what a module keeps ends with it. Its modules are in ``sys.modules`` under names of its own, where tracebacks and
``inspect`` find them, and leave it with the last object that is made of them. All other modules, as installed ones,
belong to the process.
"""

import ast
import builtins
import contextlib
import importlib.machinery
import importlib.metadata
import importlib.util
import itertools
import os
import re
import sys
import sysconfig
import threading
import weakref
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

from ..files import parsed
from .confined import users_code

PREFIX = "uvms_mj_users_"
_NAME = re.compile(rf"{PREFIX}\d+\.")
_PACKAGE = Path(__file__).parents[1]
_FOREIGN = tuple(Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib"))
_numbers = itertools.count(1)
_namespaces: "weakref.WeakValueDictionary[str, Namespace]" = weakref.WeakValueDictionary()


class Namespace:
    """The modules of a folder, each loaded at its first import.

    Args:
        folder: the folder of the user's file.
        unpickled: makes a stage of the namespace again where it is unpickled, from its table, source and settings.
        codes: the code of modules that are not read again, by their path.

    Attributes:
        modules: the modules that are loaded, by their full name.
        shared: names of modules whose state is outside: the user's own ones that are not beside the file, and modules
            in machine code.
    """

    def __init__(self, folder: Path, unpickled: Callable[..., Any], codes: dict[str, CodeType] | None = None) -> None:
        self.unpickled = unpickled
        self.folder, self.name = folder, f"{PREFIX}{next(_numbers)}"
        self.codes = {} if codes is None else codes
        self.modules: dict[str, ModuleType] = {}
        self.shared: dict[str, None] = {}
        self.builtins = {**vars(builtins), "__import__": partial(self._import)}  # no function of the user's, to compile
        self._known: dict[str, bool] = {}
        self._before = Counter(sys.path)
        self._lock, self._depth = threading.RLock(), 0
        self._names: list[str] = []
        self._top = self._finder(str(folder))
        _namespaces[self.name] = self
        weakref.finalize(self, _forget, self._names).atexit = False
        root = ModuleType(self.name)
        root.__path__ = [str(folder)]
        self.add(root)

    def again(self) -> "Namespace":
        """A new namespace with the same code, without the values that the modules have kept."""
        return Namespace(self.folder, self.unpickled, self.codes)

    def load(self, path: Path) -> ModuleType:
        """The module of a file of Python in the folder, which may raise anything."""
        name = f"{self.name}.{path.stem.replace('.', '_')}"
        with self._present():
            if name in sys.modules:
                return sys.modules[name]
            loader = _Source(self, name, str(path))
            spec = importlib.util.spec_from_file_location(name, path, loader=loader)
            assert spec is not None
            module = importlib.util.module_from_spec(spec)
            self._names.append(name)
            sys.modules[name] = module  # dataclasses look up their module there
            try:
                loader.exec_module(module)
            except BaseException:
                del sys.modules[name]
                raise
        return module

    def outside(self) -> list[str]:
        """Names of what the modules use and share with all others: modules, and libraries that ``ctypes`` has
        loaded."""
        libraries = {
            str(value._name or name)
            for module in self.modules.values()
            for name, value in list(vars(module).items())
            if "CDLL" in {each.__name__ for each in type(value).__mro__ if each.__module__ == "ctypes"}
        }
        return sorted({*self.shared, *libraries})

    def add(self, module: ModuleType) -> None:
        """Take a module that was made here."""
        vars(module)["__builtins__"] = self.builtins  # by which what is made of it keeps the namespace
        with self._present():
            self._names.append(module.__name__)
            sys.modules[module.__name__] = module

    def has(self, name: str) -> bool:
        """Whether a module of this name, without dots, is beside the file."""
        if name not in self._known:
            self._known[name] = self._has(name)
        return self._known[name]

    def files(self, name: str) -> list[Path]:
        """The files of a module beside the file, and of the packages around it, by its name with dots."""
        found, place = list[Path](), [str(self.folder)]
        for part in name.split("."):
            spec = next(filter(None, (self._finder(each).find_spec(part) for each in place)), None)
            if spec is None:
                break
            if spec.has_location and spec.origin:
                found.append(Path(spec.origin))
            place = list(spec.submodule_search_locations or ())
        return found

    def find(self, name: str, path: Sequence[str]) -> importlib.machinery.ModuleSpec | None:
        """Where a module is, for Python's import."""
        spec = next(filter(None, (self._finder(each).find_spec(name) for each in path)), None)
        if spec is not None:
            self._names.append(name)
        return spec

    def _finder(self, folder: str) -> importlib.machinery.FileFinder:
        machinery: Any = importlib.machinery  # which calls its argument, a class or not
        return machinery.FileFinder(
            folder,
            (partial(_Extension, self), machinery.EXTENSION_SUFFIXES),
            (partial(_Source, self), machinery.SOURCE_SUFFIXES),
        )

    def _has(self, name: str) -> bool:
        if name in (_PACKAGE.name, "__main__") or name in sys.builtin_module_names:
            return False
        spec = self._top.find_spec(name)
        if spec is None or spec.loader is not None:
            return spec is not None
        return _spec_of(name) is None  # a folder without __init__.py gives way to a package of this name

    def _import(self, name: str, globals: Any = None, locals: Any = None, fromlist: Any = (), level: int = 0) -> Any:
        """The function behind ``import`` in the modules of the namespace."""
        first = name.partition(".")[0]
        new = first not in self._known
        if level == 0 and not self.has(first):
            found = builtins.__import__(name, globals, locals, fromlist, level)
            if new:
                try:
                    self._note(first)
                except ImportError:
                    del self._known[first]  # so that it is refused again
                    raise
            return found
        try:
            with self._present():
                whole = name if level else f"{self.name}.{name}"
                found = builtins.__import__(whole, globals, locals, fromlist, level)
                return found if fromlist or level else sys.modules[f"{self.name}.{first}"]
        except ImportError as error:
            error.msg = without_names(error.msg)
            raise

    def _note(self, name: str) -> None:
        """Keep the name of a module of the user's that all namespaces share. Raises ImportError if it is not what the
        user's file means by this name: another module, or an older text."""
        module = sys.modules.get(name)
        file = getattr(module, "__file__", None)
        if module is None or not file or name == _PACKAGE.name or is_installed(Path(file).resolve()):
            return
        self.shared[name] = None
        remedy = "a process loads it once, since it is not beside the user's file: put it there, or begin a new process"
        added = list(Counter(sys.path) - self._before)  # by this file
        meant = importlib.machinery.PathFinder.find_spec(name, added)
        if meant is not None and meant.has_location and Path(str(meant.origin)).resolve() != Path(file).resolve():
            raise ImportError(f"{name} would be {file} in place of {meant.origin}; {remedy}")
        spec = module.__spec__
        about = os.stat(getattr(module.__loader__, "archive", file))
        stamp = about.st_mtime_ns, about.st_size
        if _stamps.setdefault(name, (spec, stamp))[0] is not spec:  # loaded again
            _stamps[name] = spec, stamp
        if _stamps[name][1] != stamp:
            raise ImportError(f"{name}, {file}, has changed; {remedy}")

    @contextlib.contextmanager
    def _present(self) -> Iterator[None]:
        """Have the modules themselves in ``sys.modules``, and afterwards what stands there for them."""
        with self._lock:
            self._depth += 1
            sys.modules.update(self.modules)
            try:
                yield
            finally:
                self._depth -= 1
                if not self._depth:
                    for name in self._names:
                        if isinstance(module := sys.modules.get(name), ModuleType) and type(module) is not _Seen:
                            self.modules[name] = module
                            sys.modules[name] = _Seen(name, self)


class _Seen(ModuleType):
    """The entry of ``sys.modules`` for a module of a namespace: it shows the module and does not keep it."""

    def __init__(self, name: str, namespace: Namespace) -> None:
        super().__init__(name)
        super().__setattr__("_namespace", weakref.ref(namespace))

    @property
    def __dict__(self) -> Any:
        namespace = super().__getattribute__("_namespace")()
        return {} if namespace is None else vars(namespace.modules[self.__name__])

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__[name]
        except KeyError:
            raise AttributeError(f"module {without_names(self.__name__)!r} has no attribute {name!r}") from None


def _forget(names: list[str]) -> None:
    for name in names:
        sys.modules.pop(name, None)


_texts: dict[str, tuple[bytes, CodeType]] = {}
"""The last text of each module, and its code."""


class _Source(importlib.machinery.SourceFileLoader):
    """Loads a module from its text. Python's byte-code cache misses the second of two edits within a second."""

    def __init__(self, namespace: Namespace, name: str, path: str) -> None:
        super().__init__(name, path)
        self._namespace = namespace

    def get_code(self, fullname: str) -> Any:
        path, codes = self.get_filename(fullname), self._namespace.codes
        if path not in codes:
            text = self.get_data(path)
            if path not in _texts or _texts[path][0] != text:
                _texts[path] = text, self.source_to_code(text, path)
            codes[path] = _texts[path][1]
        return codes[path]

    def exec_module(self, module: ModuleType) -> None:
        vars(module)["__builtins__"] = self._namespace.builtins
        with users_code(str(self._namespace.folder)):
            super().exec_module(module)


_extensions: dict[str, tuple[tuple[int, int], ModuleType, Any]] = {}
"""The modules in machine code that this process has loaded, by their path: when, itself, and its spec."""


_stamps: dict[str, tuple[Any, tuple[int, int]]] = {}
"""The shared modules of the user's that this process has loaded, by their name: the spec by which, and when it was
written."""


class _Extension:
    """Gives a module in machine code, which a process can load only once: all namespaces share it."""

    def __init__(self, namespace: Namespace, name: str, path: str) -> None:
        self._namespace, self._name, self._path = namespace, name.rpartition(".")[2], path

    def create_module(self, spec: Any) -> ModuleType:
        about = os.stat(self._path)
        stamp = about.st_mtime_ns, about.st_size
        if self._path not in _extensions:
            name = f"uvms_mj_extension_{len(_extensions)}.{self._name}"
            own = importlib.util.spec_from_file_location(name, self._path)
            assert own is not None
            assert own.loader is not None
            module = importlib.util.module_from_spec(own)
            sys.modules[name] = module
            own.loader.exec_module(module)
            _extensions[self._path] = stamp, module, own
        then, module, _ = _extensions[self._path]
        if then != stamp:
            wrong = "has changed since this process loaded it, and machine code is loaded once: begin a new process"
            raise ImportError(f"{Path(self._path).name} {wrong}")
        self._namespace.shared[self._name] = None
        return module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = _extensions[self._path][2]  # which import has replaced


class _Finder:
    """Finds the modules of namespaces for Python's import."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> Any:
        if not name.startswith(PREFIX) or path is None:
            return None
        namespace = _namespaces.get(name.partition(".")[0])
        return None if namespace is None else namespace.find(name, path)


sys.meta_path.insert(0, _Finder)


def namespace_named(module: str) -> Namespace | None:
    """The namespace of a module of this name; None for a module of no namespace."""
    return _namespaces.get(module.partition(".")[0])


def namespace_of(kind: type) -> Namespace | None:
    """The namespace of a class; None for one that was not loaded into one."""
    return namespace_named(kind.__module__)


def is_same_code(kind: type, other: type) -> bool:
    """Whether two classes were made by the same code of Python, beside the same other modules."""
    a, b = namespace_of(kind), namespace_of(other)
    return a is not None and b is not None and bool(a.codes) and a.codes == b.codes and not (a.shared or b.shared)


def without_names(text: str) -> str:
    """A text in which modules have the names by which the user imports them."""
    return _NAME.sub("", text)


def is_installed(path: Path) -> bool:
    """Whether a file belongs to an installed package or to the standard library. In a folder of ``sys.path`` a package
    is installed if metadata beside it list it."""
    if any(path.is_relative_to(folder) for folder in _FOREIGN) or "dist-packages" in path.parts:
        return True
    folders = {Path(each).resolve() for each in sys.path if each}
    return any(path.relative_to(each).parts[0] in _listed(each) for each in folders & {*path.parents})


@cache
def _listed(folder: Path) -> frozenset[str]:
    """The files and folders of packages that are installed in a folder."""
    found = importlib.metadata.distributions(path=[str(folder)])
    return frozenset(file.parts[0] for each in found if each.read_text("RECORD") for file in each.files or ())


def source_files(module: ModuleType) -> list[Path]:
    """Files of a module and of its direct and indirect imports, except installed packages and the standard library; of
    a stage in C or a library, its file.

    Imports are read from the source, because a constant imported from another file leaves no trace in the module, and
    one within a function may not have been made yet.
    """
    namespace = namespace_named(module.__name__)
    todo = [Path(str(module.__file__)).resolve()]
    found: dict[Path, None] = {}
    while todo:
        path = todo.pop()
        if path in found or not path.is_file():
            continue
        if found and (is_installed(path) or path.is_relative_to(_PACKAGE)):
            continue
        found[path] = None
        if path.suffix == ".py":
            todo += [each.resolve() for name in _imported(path, namespace) for each in _origins(name, namespace)]
    return sorted(found)


def import_folders(path: Path) -> list[Path]:
    """The folders from which a file of Python imports, its own first."""
    return [path.parent, *sorted((Path(p).resolve() for p in sys.path if p), key=lambda p: -len(p.parts))]


def name_beside(path: Path, source: Path) -> str:
    """The name that a file has where all that a file ``path`` imports is in one folder."""
    folder = next((each for each in import_folders(path) if source.is_relative_to(each)), source.parent)
    return source.relative_to(folder).as_posix()


def _imported(path: Path, namespace: Namespace | None) -> Iterator[str]:
    """The names of modules that a file may import; of a package beside the user's file also by relative ones."""
    for node in ast.walk(parsed(path.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = node.module or ""
            if node.level:
                folder = namespace.folder.resolve() if namespace else None
                package = [path, *path.parents][node.level]
                if folder is None or not package.is_relative_to(folder):
                    continue
                above = ".".join(filter(None, (*package.relative_to(folder).parts, above)))
            yield from filter(None, (above, *(".".join(filter(None, (above, alias.name))) for alias in node.names)))


def _origins(name: str, namespace: Namespace | None) -> list[Path]:
    """The files of a module and of the packages around it."""
    if namespace is not None and namespace.has(name.partition(".")[0]):
        return namespace.files(name)
    first = _spec_of(name.partition(".")[0])
    if first is not None and first.has_location and is_installed(Path(str(first.origin)).resolve()):
        return []  # to find a module in it, Python would import it
    spec = _spec_of(name)
    own = spec is not None and spec.has_location and str(spec.origin).endswith(".py")
    return [Path(str(spec.origin))] if own and spec else []


def _spec_of(name: str) -> Any:
    """The spec of a module that Python's own import finds in a file, or None."""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError, AttributeError):
        return None
    return spec if spec is not None and spec.origin else None
