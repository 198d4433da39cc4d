"""A law as plain Python: used if numba can't compile it, and to find the line in which a compiled law failed."""

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

from ...control.base import Controller
from ...stages.base import is_shipped
from ...stages.contract import field_suggestion
from .arena import NEARBY, Arena


class LawFault(Exception):
    """A law raised or violated its contract. The message names the law and, where it is known, the line."""


class _Record(np.record):  # type: ignore[misc]  # NumPy's stubs have it as Any
    """A record that suggests a field's name when an unknown one is read."""

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"{type(self).__name__} has no {name!r}; {field_suggestion(name, self.dtype.names or ())}")


class PlainLaw:
    """A controller's law, called from Python with the arrays of an arena."""

    def __init__(self, controller: Controller, arena: Arena) -> None:
        self.controller, self.arena = controller, arena
        gains = arena.arrays["gains"].view()
        gains.flags.writeable = False  # writing to a gain raises
        records = {**arena.arrays, "gains": gains}
        given = ("gains", "state", "signals", "state_dot")
        self._arguments = [
            records[name].view(np.dtype((type(name, (_Record,), {}), records[name].dtype)))[0] for name in given
        ]
        self._arguments.append(arena.arrays["tau_cmd"])

    @functools.cached_property
    def _function(self) -> Callable:
        return _with_helpers(type(self.controller).function(), _guarded)

    def __call__(self) -> None:
        """Call the law once.

        Raises:
            LawFault: the law raised or violated its contract.
        """
        try:
            self._function(*self._arguments)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a law may raise anything, also SystemExit
            raise LawFault(self._raised(error)) from error
        did = self.arena.overrun(NEARBY) or self.arena.changed_gain() or self.arena.not_finite()
        if did:
            raise self.fault(did)

    def fault(self, did: str) -> LawFault:
        """The exception for a violation, which ``did`` describes as a predicate."""
        return LawFault(f"{self.who} {did}")

    def explain(self, fault: str) -> LawFault:
        """The exception for a compiled law that stopped the run. The law is run again as plain Python with the same
        numbers, to find the line.

        Args:
            fault: the law's violation as a predicate; empty if the law raised.
        """
        function, line = _with_helpers(type(self.controller).function(), _plain), ""
        try:
            with np.errstate(divide="raise", invalid="raise" if not fault else "ignore"):
                with _first_not_finite(self._file) as found:
                    function(*self._arguments)
                line = found.get("line", "")
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            cause = LawFault(self._raised(error, fault))
            cause.__cause__ = error
            return cause
        if not fault:
            fault = f"raised {self._compiled_exception()} as machine code, but nothing as plain Python"
        return self.fault(fault + (f"; the first number that is not finite arises in {line}" if line else ""))

    def _compiled_exception(self) -> str:
        """The exception that the compiled law raises, as text."""
        from .guarded import guarded, guarded_function

        records = [self.arena.arrays[name][0] for name in ("gains", "state", "signals", "state_dot")]
        try:
            with guarded(True):
                guarded_function(type(self.controller).function(), error_model="python")(*records, self._arguments[4])
        except Exception as error:
            return _named_error(error)
        return "an exception"

    @functools.cached_property
    def _file(self) -> str:
        return type(self.controller).function().__code__.co_filename

    @property
    def who(self) -> str:
        """The law's name in messages."""
        label = self.controller.label()
        if is_shipped(self.controller):
            return f"the law {label}"
        return f"your law {label} ({Path(self._file).name})"

    def _raised(self, error: BaseException, fault: str = "") -> str:
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == self._file]
        what = f"{self.who} {fault or f'raised {_named_error(error)}'}"
        if not frames:
            return what
        last = frames[-1]
        return f"{what} in {Path(last.filename).name}, line {last.lineno}: {last.line}"


def _named_error(error: BaseException) -> str:
    try:
        text = " ".join(str(error).split())
    except Exception:  # a user's exception may fail in __str__
        text = ""
    return f"{type(error).__name__}: {text[:300]}" if text else type(error).__name__


def _with_helpers(function: Any, helper: Callable[[Any, Any], Any], seen: dict[int, Any] | None = None) -> Any:
    """A copy of a function in which every function marked with ``numba.njit`` is replaced by ``helper(plain copy,
    compiled function)``. Functions of the same module are copied likewise."""
    seen = {} if seen is None else seen
    if id(function) in seen:
        return seen[id(function)]
    names: dict[str, Any] = {}
    copy = types.FunctionType(function.__code__, names, function.__name__, function.__defaults__, function.__closure__)
    copy.__kwdefaults__ = function.__kwdefaults__
    seen[id(function)] = copy

    def stand_in(value: Any) -> Any:
        if isinstance(getattr(value, "py_func", None), types.FunctionType):
            return helper(_with_helpers(value.py_func, helper, seen), value)
        if isinstance(value, types.FunctionType) and value.__globals__ is function.__globals__:
            return _with_helpers(value, helper, seen)
        if isinstance(value, types.ModuleType) and any(hasattr(each, "py_func") for each in vars(value).values()):
            twin = types.ModuleType(value.__name__)
            vars(twin).update({name: stand_in(each) for name, each in vars(value).items()})
            return twin
        return value

    names |= {name: stand_in(value) for name, value in function.__globals__.items()}
    return copy


def _plain(function: Any, compiled: Any) -> Any:
    """A helper as plain Python."""
    return function


def _guarded(function: Any, compiled: Any) -> Any:
    """A helper as machine code that checks indices and shapes, or as plain Python if numba can't compile it."""
    from .guarded import NumbaError, guarded, twin

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        try:
            with guarded(True):
                return twin(compiled)(*arguments)
        except NumbaError:
            return function(*arguments)

    return call


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
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, np.ndarray) and value.dtype.kind == "f" and value.size <= 10_000:
        return bool(np.isfinite(value).all())
    return True
