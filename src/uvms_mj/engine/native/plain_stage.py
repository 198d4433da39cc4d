"""A stage as plain Python: if the language lacks what it uses, and to find the line in which a compiled one failed."""

import contextlib
import functools
import linecache
import math
import sys
import traceback
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...compiler.refusals import field_suggestion
from ...errors import error_text
from ...physics.kernels import Record
from ...stages.base import Stage, is_shipped
from ...stages.foreign import suffix_of
from .memory import OwnMemory


class StageFault(Exception):
    """A stage raised or violated its contract. The message names the stage and, where it is known, the line."""


class _Record(Record):  # type: ignore[misc]  # NumPy's stubs have its base as Any
    """A record that suggests a field's name when an unknown one is read."""

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"{type(self).__name__} has no {name!r}; {field_suggestion(name, self.dtype.names or ())}")


class PlainStage:
    """A stage's function, called from Python with the arrays of its own memory. ``library`` has the function of a stage
    in C, and calls it."""

    def __init__(self, stage: Stage, own: OwnMemory, library: Callable[..., int] | None = None) -> None:
        self.stage, self.own, self._library = stage, own, library
        records = dict(own.arrays)
        for name in ("settings", "given"):  # writing there raises
            records[name] = records[name].view()
            records[name].flags.writeable = False
        self._arguments = [_argument(called, records[name]) for name, called in own.names.items()]

    @functools.cached_property
    def function(self) -> Callable:
        return self._library or _without_numba(type(self.stage).function())

    def __call__(self) -> None:
        """Call the stage once. Raises StageFault if the stage raised or violated its contract."""
        try:
            returned = self.function(*self._arguments)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a stage may raise anything, also SystemExit
            raise StageFault(self._raised(error)) from error
        did = f"returned {returned}" if self._library and returned else self.own.wrong()
        if did:
            raise self.fault(did)

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
                self.function(*self._arguments)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            frames = traceback.extract_tb(error.__traceback__)
            return any(frame.filename == file and frame.lineno == line for frame in frames)
        return False

    def fault(self, did: str) -> StageFault:
        """The exception for a violation, which ``did`` describes as a predicate."""
        return StageFault(f"{self.who} {did}")

    def explain(self, fault: str, place: str) -> StageFault:
        """The exception for a compiled stage that stopped the run: from its violation as a predicate, or else from the
        place where it ended early. The stage is run again as plain Python with the same numbers, to find the line."""
        line = ""
        try:
            with np.errstate(all="ignore"), _first_not_finite(self._file) as found:
                self.function(*self._arguments)
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
        what = f"{self.who} {fault or f'raised {error_text(error)}'}"
        if not frames:
            return what
        last = frames[-1]
        return f"{what} in {Path(last.filename).name}, line {last.lineno}: {last.line}"


def called(stage: Stage) -> str:
    """A stage's name in messages."""
    name = f"{stage.room.noun} {stage.label()}"
    if is_shipped(stage):
        return f"the {name}"
    kind = type(stage)
    file = kind.source().rpartition(":")[0] if suffix_of(kind) else kind.function().__code__.co_filename
    return f"your {name} ({Path(file).name})"


def _argument(name: str, array: np.ndarray) -> Any:
    """An array of the stage's own memory as the stage gets it: a record with its own name, or the array."""
    if array.dtype.names is None:
        return array
    return array.view(np.dtype((type(name, (_Record,), {}), array.dtype)))[0]


def _without_numba(function: Any, seen: dict[int, Any] | None = None) -> Any:
    """A copy of a function in which every function that the user marked with ``numba.njit`` is a plain one: compiled,
    it would check no index. Functions of the same module are copied likewise."""
    seen = {} if seen is None else seen
    if id(function) in seen:
        return seen[id(function)]
    names: dict[str, Any] = {}
    copy = types.FunctionType(function.__code__, names, function.__name__, function.__defaults__, function.__closure__)
    copy.__kwdefaults__ = function.__kwdefaults__
    seen[id(function)] = copy

    def stand_in(value: Any) -> Any:
        if isinstance(getattr(value, "py_func", None), types.FunctionType):
            return _without_numba(value.py_func, seen)
        if isinstance(value, types.FunctionType) and value.__globals__ is function.__globals__:
            return _without_numba(value, seen)
        if isinstance(value, types.ModuleType) and any(hasattr(each, "py_func") for each in vars(value).values()):
            twin = types.ModuleType(value.__name__)
            vars(twin).update({name: stand_in(each) for name, each in vars(value).items()})
            return twin
        return value

    names |= {name: stand_in(value) for name, value in function.__globals__.items()}
    return copy


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
