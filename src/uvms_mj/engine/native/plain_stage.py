"""A stage as plain Python: if the language lacks what it uses, and to find the line in which a compiled one failed."""

import contextlib
import functools
import linecache
import math
import os
import random
import re
import sys
import threading
import traceback
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...compiler.refusals import field_suggestion
from ...errors import error_text
from ...physics.kernels import Record
from ...stages.base import Stage
from ...stages.confined import users_code
from ...stages.foreign import SUFFIXES
from ...stages.namespace import is_installed, namespace_named, without_names
from .guard import end_copy
from .memory import OwnMemory, settle_modes

_READ = ("settings", "given")
"""The records that a stage may only read."""


class StageFault(Exception):
    """A stage raised or violated its contract. The message names the stage and, where it is known, the line."""


class _Record(Record):  # type: ignore[misc]  # NumPy's stubs have its base as Any
    """A record that suggests a field's name when an unknown one is read."""

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"{type(self).__name__} has no {name!r}; {field_suggestion(name, self.dtype.names or ())}")


class PlainStage:
    """A stage's function, called from Python with the arrays of its own memory. ``library`` has the function of a stage
    in C, and calls it.

    A function in Python may keep its arguments, ``PAST.append(signals.eta_e)``. Then the memory moves, and the
    kept arguments stay as they were. It may read settings and signals only. Their arrays can be written all the same,
    since libraries in C ask for that where they only read (SciPy's Rotation); so their bytes are compared after
    each call.
    """

    def __init__(self, stage: Stage, own: OwnMemory, library: Callable[..., int] | None = None) -> None:
        self.stage, self.own, self._library = stage, own, library
        self._memory: Any = None
        self._generators = _Generators()
        self._folder = os.path.dirname(getattr(sys.modules.get(type(stage).__module__), "__file__", None) or "")
        self._arguments, self._references = self._taken(), 0

    def _taken(self, readonly: bool = False) -> list[Any]:
        """The arguments of the function. With ``readonly``, writing on settings and signals raises."""
        records = dict(self.own.arrays)
        for name in _READ if readonly else ():
            records[name] = records[name].view()
            records[name].flags.writeable = False
        return [_argument(called, records[name]) for name, called in self.own.names.items()]

    def _read_bytes(self) -> tuple[bytes, ...]:
        return () if self._library else tuple(self.own.arrays[name].tobytes() for name in _READ)

    def _move(self) -> None:
        self._memory = self.own.move()
        self._arguments = self._taken()
        self._references = self._count()

    def _count(self) -> int:
        """How many references there are to the memory of the arguments."""
        return sum(map(sys.getrefcount, self._arguments), sys.getrefcount(self._memory))

    def begin(self, function: Callable, key: int) -> None:
        """Begin a run with a function, which keeps nothing of an earlier run, and the key of its random numbers."""
        self.own.start()
        if self._library:
            return
        self.function = _without_numba(function)
        self._generators = _Generators(function, key)
        self._move()

    @functools.cached_property
    def function(self) -> Callable:
        return self._library or _without_numba(type(self.stage).function())

    def __call__(self) -> None:
        """Call the stage once. Raises StageFault if the stage raised or violated its contract."""
        process, before = os.getpid(), self._read_bytes()
        try:
            with self._generators, users_code(self._folder):
                returned = self.function(*self._arguments)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a stage may raise anything, also SystemExit
            raise StageFault(self._raised(error)) from error
        finally:
            end_copy(process)
            settle_modes()
        wrote = self._read_bytes() != before
        did = f"returned {returned}" if self._library and returned else self.own.wrong()
        if wrote or did:
            raise self._writing(before) or self.fault(
                "wrote on its settings or signals, which it may only read; copy what it changes" if wrote else did
            )

    def _writing(self, before: tuple[bytes, ...]) -> StageFault | None:
        """The exception for a function that writes on its settings or signals, which were ``before`` the call: called
        again with arrays that it can only read, it raises in the line."""
        if self._library:
            return None
        for name, each in zip(_READ, before, strict=True):
            array = self.own.arrays[name]
            array[...] = np.frombuffer(each, array.dtype).reshape(array.shape)
        try:
            with np.errstate(all="ignore"):
                self.function(*self._taken(readonly=True))
        except ValueError as error:
            if "destination is read-only" in str(error) or "output array is read-only" in str(error):
                return StageFault(self._raised(error))
        except Exception:
            pass
        return None

    def fault_of(self, function: Callable) -> StageFault | None:
        """Call another function in the stage's place. Returns what it did wrong, if anything."""
        try:
            function(*self._arguments)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            return StageFault(self._raised(error))
        did = self.own.wrong()
        return self.fault(did) if did else None

    def raises_in(self, file: str, line: int) -> bool:
        """Call the stage. Returns whether it raises, and passes through this line."""
        try:
            with np.errstate(all="ignore"):
                self.function(*self._taken(readonly=True))
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            frames = traceback.extract_tb(error.__traceback__)
            return any(frame.filename == file and frame.lineno == line for frame in frames)
        return False

    def rest(self) -> None:
        """Leave what the function has kept to it. Called when its results are taken."""
        if self._memory is not None and self._count() != self._references:
            self._move()

    def fault(self, did: str) -> StageFault:
        """The exception for a violation, which ``did`` describes as a predicate."""
        return StageFault(f"{self.who} {did}")

    def explain(self, fault: str, place: str) -> StageFault:
        """The exception for a compiled stage that stopped the run: from its violation as a predicate, or else from the
        place where it ended early. The stage is run again as plain Python with the same numbers, to find the line."""
        line = ""
        try:
            with np.errstate(all="ignore"), _first_not_finite(self._file) as found:
                self.function(*self._taken(readonly=True))
            line = found.get("line", "")
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            cause = StageFault(self._raised(error, fault))
            cause.__cause__ = error
            return cause
        fault = fault or f"was stopped in {place}"
        return self.fault(fault + (f"; the first number that is not finite arises in {line}" if line else ""))

    @functools.cached_property
    def _file(self) -> str:
        return type(self.stage).function().__code__.co_filename

    @property
    def who(self) -> str:
        return called(self.stage)

    def _raised(self, error: BaseException, fault: str = "") -> str:
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == self._file]
        what = f"{self.who} {fault or f'raised {without_names(error_text(error))}'}"
        if not frames:
            return what
        last = frames[-1]
        return f"{what} in {Path(last.filename).name}, line {last.lineno}: {last.line}"


def called(stage: Stage) -> str:
    """A stage's name in messages."""
    name = f"{stage.room.noun} {stage.label()}"
    if stage.is_shipped:
        return f"the {name}"
    kind = type(stage)
    foreign = kind.file_suffix() in SUFFIXES
    file = kind.source().rpartition(":")[0] if foreign else kind.function().__code__.co_filename
    return f"your {name} ({Path(file).name})"


def _argument(name: str, array: np.ndarray) -> Any:
    """An array of the stage's own memory as the stage gets it: a record with its own name, or the array."""
    if array.dtype.names is None:
        return array
    return array.view(np.dtype((_record(name), array.dtype)))[0]


@functools.cache
def _record(name: str) -> type:
    return type(name, (_Record,), {})


class _Generators:
    """A context with states of their own of the random numbers of Python and NumPy, ``random`` and ``np.random``, for a
    function whose file names them. They begin each run from its key; the generators of the process stay as they are.

    The process has one of each. So a run in another thread waits until the call in hand has given them back."""

    _alone = threading.RLock()

    def __init__(self, function: Callable | None = None, key: int = 0) -> None:
        texts = list(_texts_of(function)) if function is not None else []
        self._numpy = self._python = None
        if any("random" in text for text in texts):
            self._numpy = np.random.MT19937(key)
        if any(_IMPORTS_RANDOM.search(text) for text in texts):
            self._python = random.Random(key).getstate()  # copying it takes long

    def __enter__(self) -> None:
        if self._numpy is not None or self._python is not None:
            self._alone.acquire()
        if self._numpy is not None:
            self._outer_numpy = np.random.get_bit_generator()
            np.random.set_bit_generator(self._numpy)
        if self._python is not None:
            self._outer_python = random.getstate()
            random.setstate(self._python)

    def __exit__(self, *exception: object) -> None:
        if self._numpy is not None:
            np.random.set_bit_generator(self._outer_numpy)
        if self._python is not None:
            self._python = random.getstate()
            random.setstate(self._outer_python)
        if self._numpy is not None or self._python is not None:
            self._alone.release()


_IMPORTS_RANDOM = re.compile(r"^\s*(import|from)\s[^#\n]*\brandom\b", re.MULTILINE)


def _texts_of(function: Any) -> Iterator[str]:
    """The text of a function's file, and of the modules beside it."""
    namespace = namespace_named(function.__module__)
    for file in (function.__code__.co_filename, *(namespace.codes if namespace else ())):
        yield "".join(linecache.getlines(file, function.__globals__))


def _without_numba(function: Any) -> Any:
    """The function; or its copy in which every function that the user marked with ``numba.njit`` is a plain one:
    compiled, it would check no index. Functions of the user's modules are copied likewise, and share their names."""
    copies: dict[int, Any] = {}

    def of(function: types.FunctionType) -> types.FunctionType:
        names = globals_of(function.__globals__)
        code, closure = function.__code__, function.__closure__
        copy = types.FunctionType(code, names, function.__name__, function.__defaults__, closure)
        copy.__kwdefaults__ = function.__kwdefaults__
        return copy

    def globals_of(names: dict[str, Any]) -> dict[str, Any]:
        if id(names) not in copies:
            copies[id(names)] = copy = {}
            copy |= {name: stand_in(value, names) for name, value in names.items()}
        return copies[id(names)]

    def stand_in(value: Any, names: dict[str, Any]) -> Any:
        if (plain := _py_func(value)) is not None:
            return of(plain)
        if isinstance(value, types.FunctionType) and value.__globals__ is names:
            return of(value)
        if isinstance(value, types.ModuleType) and _marks(vars(value)):
            twin = types.ModuleType(value.__name__)
            vars(twin).update(globals_of(vars(value)))
            return twin
        return value

    modules = [each for each in function.__globals__.values() if isinstance(each, types.ModuleType)]
    return of(function) if any(map(_marks, [function.__globals__, *map(vars, modules)])) else function


def _py_func(value: Any) -> types.FunctionType | None:
    """The function that numba has compiled. Asked of the object's own names: an object may make up others, as
    ``ctypes.cdll`` does."""
    try:
        found = object.__getattribute__(value, "__dict__").get("py_func")
    except AttributeError:
        return None
    return found if isinstance(found, types.FunctionType) else None


def _marks(names: dict[str, Any]) -> bool:
    """Whether a function that is marked is among the names of a module of the user's."""
    file = names.get("__file__")
    if file and is_installed(Path(file)):
        return False
    return any(_py_func(value) is not None for value in list(names.values()))


@contextlib.contextmanager
def _first_not_finite(file: str) -> Iterator[dict[str, str]]:
    """Trace the lines of a file. ``line`` of the dictionary is the first line after which a local variable is not
    finite."""
    found: dict[str, str] = {}

    def look(frame: Any, number: int) -> None:
        if "line" not in found and any(not _finite(value) for value in frame.f_locals.values()):
            found["line"] = f"{Path(file).name}, line {number}: {linecache.getline(file, number).strip()}"

    def trace(frame: Any, event: str, argument: Any) -> Any:
        if frame.f_code.co_filename != file:
            return None
        last = frame.f_lineno

        def each(frame: Any, event: str, argument: Any) -> Any:
            nonlocal last
            if event in ("line", "return"):
                look(frame, last)
                last = frame.f_lineno
            return each

        return each

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        yield found
    finally:
        sys.settrace(before)


def _finite(value: Any) -> bool:
    """Whether a local variable is finite, as far as the stage has made it: an infinite limit may be given to it."""
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, np.void | np.ndarray) and not value.flags.writeable:
        return True
    if isinstance(value, np.void):
        return all(_finite(value[name]) for name in value.dtype.names or ())
    if isinstance(value, np.ndarray) and value.dtype.kind == "f" and value.size <= 10_000:
        return bool(np.isfinite(value).all())
    return True
