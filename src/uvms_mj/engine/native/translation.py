"""The name of a user's function's translation, so that a further start finds its machine code without translating it.

It is made of all that the translator may read: the code of each function that can be reached, and the values of the
names in it. Where a value is of a kind that is not known here, there is no name, and the function is translated.
"""

import sys
import sysconfig
import types
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...compiler.builtin import FUNCTIONS
from ...compiler.changes import changes_of

_NUMBERS = (bool, int, float, str, type(None), type(Ellipsis), np.bool_, np.int64, np.float64)
_INSTALLED = tuple(Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib"))


class _Unknown(Exception):
    """A value of another kind."""


def parts_of(function: types.FunctionType, records: Mapping[Any, tuple[np.dtype, str]]) -> list[bytes] | None:
    """The parts of a translation besides the package's sources; None if it is not known. ``records`` are the
    functions that stand for records, as in :func:`.compilation.native_stage`."""
    walk = _Walk(records)
    try:
        walk.function(function)
    except (_Unknown, RecursionError):
        return None
    return [*(f"{kind!r} {why}".encode() for kind, why in records.values()), *walk.parts]


def _is_ours(module: str) -> bool:
    """Whether it is a module of the package, whose sources are in the name of the translation anyway."""
    return module.partition(".")[0] == __name__.partition(".")[0]


class _Walk:
    def __init__(self, readers: Iterable[Callable]) -> None:
        self.parts: list[bytes] = []
        self._seen: dict[int, Any] = {}
        self._readers = {id(each): k for k, each in enumerate(readers)}

    def _add(self, *words: object) -> None:
        self.parts.append(repr(words).encode())

    def function(self, function: types.FunctionType) -> None:
        if id(function) in self._seen:
            self._add("again", [*self._seen].index(id(function)))
            return
        self._seen[id(function)] = function
        names = self._code(function.__code__)
        self._add(function.__name__, changes_of(function))
        self.value(function.__defaults__, names)
        self.value(function.__kwdefaults__, names)
        for name in sorted(names & function.__globals__.keys()):
            self._add(name)
            self.value(function.__globals__[name], names)
        for cell in function.__closure__ or ():
            self.value(cell.cell_contents, names)

    def _code(self, code: types.CodeType) -> set[str]:
        """Add the code of a function, and of those within it. Returns the names that it looks up."""
        names = set(code.co_names)
        self._add(code.co_filename, code.co_firstlineno, code.co_linetable, code.co_code, code.co_flags)
        self._add(code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount)
        self._add(code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
        for each in code.co_consts:
            if isinstance(each, types.CodeType):
                names |= self._code(each)
            elif isinstance(each, frozenset):
                self.value(tuple(sorted(each, key=repr)), names)
            else:
                self.value(each, names)
        return names

    def value(self, value: Any, names: set[str]) -> None:
        kind = type(value)
        if kind in _NUMBERS:
            self._add(kind.__name__, value)
        elif kind in (tuple, list):
            self._add(kind.__name__, len(value))
            for each in value:
                self.value(each, names)
        elif kind is dict:
            self.value(list(value.keys()), names)
            self.value(list(value.values()), names)
        elif kind is np.ndarray and value.dtype.kind in "fib":
            self._add(value.dtype.str, value.shape, value.tobytes())
        elif kind is types.FunctionType:
            self._called(value)
        elif kind is types.ModuleType:
            self._module(value, names)
        elif kind is type and (value.__module__ in ("builtins", "numpy") or _is_ours(value.__module__)):
            self._add(value.__module__, value.__qualname__)
        elif isinstance(getattr(value, "py_func", None), types.FunctionType):  # numba has marked it
            self.function(value.py_func)
        else:
            self._known(value)

    def _called(self, function: types.FunctionType) -> None:
        if id(function) in self._readers:
            self._add("record", self._readers[id(function)])
        elif _is_ours(function.__module__) and vars(sys.modules[function.__module__]) is function.__globals__:
            self._add(function.__module__, function.__qualname__)
        else:
            self.function(function)

    def _module(self, module: types.ModuleType, names: set[str]) -> None:
        file = getattr(module, "__file__", None)
        self._add("module", file or module.__name__)  # a user's has another name in each run
        if id(module) in self._seen or file is None or any(map(Path(file).resolve().is_relative_to, _INSTALLED)):
            return
        self._seen[id(module)] = module
        for name in sorted(names & vars(module).keys()):
            self._add(name)
            self.value(vars(module)[name], names)

    def _known(self, value: Any) -> None:
        try:
            known = value in FUNCTIONS
        except (TypeError, ValueError):
            known = False
        if not known:
            raise _Unknown(repr(value))
        self._add("of the language", getattr(value, "__name__", repr(value)))
