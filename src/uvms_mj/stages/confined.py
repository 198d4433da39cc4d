"""Runs in which a user's code may not look around: it reads the files beside its own, and nothing else of the machine.

While a user's module is loaded, or a user's stage runs as plain Python, files elsewhere, sockets, processes, frames of
callers and the objects of the collector are refused. This keeps a benchmark's draws from a law that looks for them by
mistake or by habit; it is no wall against malice. Machine code of a user's, as of C, is not confined.
"""

import contextlib
import os
import sys
import sysconfig
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

_INSTALLED = tuple(
    {os.path.realpath(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib", "purelib", "platlib")}
)
_PACKAGE = str(Path(__file__).resolve().parents[1])
_IMPORT = "<frozen importlib._bootstrap"
"""Beginning of the name of the file of a frame that loads a module."""
_HARMLESS = (
    *("import", "compile", "exec", "object.__getattr__", "object.__setattr__", "object.__delattr__", "builtins.id"),
    *("code.__new__", "function.__new__", "marshal.loads", "marshal.dumps", "array.__new__", "time.sleep"),
    *("sys.excepthook", "sys.unraisablehook", "pickle.find_class"),
)
"""Python's audit events of a user's code that show nothing of the machine. Any other one is refused, but for reading
files, which depends on the place."""


class _State(threading.local):
    confined = False
    folders: tuple[str, ...] = ()


_state = _State()
_hooked = threading.Event()


@contextlib.contextmanager
def confined(on: bool = True) -> Iterator[None]:
    """Confine the code of users in this thread."""
    if on and not _hooked.is_set():
        sys.addaudithook(_hook)  # it can't be taken away again; it does nothing outside of users' code
        _hooked.set()
    before, _state.confined = _state.confined, on or _state.confined
    try:
        yield
    finally:
        _state.confined = before


@contextlib.contextmanager
def users_code(folder: str) -> Iterator[None]:
    """Mark code of a user, whose files are in a folder."""
    if not _state.confined:
        yield
        return
    _state.folders = (*_state.folders, os.path.realpath(folder))
    try:
        yield
    finally:
        _state.folders = _state.folders[:-1]


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    folders = _state.folders
    if not folders:
        return
    _state.folders = ()  # what this function does is not the user's
    try:
        if event in ("open", "os.listdir", "os.scandir"):
            wrong = _elsewhere(arguments, folders, event)
        else:
            wrong = event if event not in _HARMLESS and _asked_by_user(folders) else ""
    finally:
        _state.folders = folders
    if wrong:
        raise PermissionError(f"{wrong}: in this study a user's code reads the files beside its own alone")


def _asked_by_user(folders: tuple[str, ...]) -> bool:
    """Whether a user's function is behind the event, and not a module that is being imported."""
    frame: FrameType | None = sys._getframe(2)
    while frame is not None and not frame.f_code.co_filename.startswith(_IMPORT):
        if _inside(os.path.realpath(frame.f_code.co_filename), folders):
            return True
        frame = frame.f_back
    return False


def _elsewhere(arguments: tuple[Any, ...], folders: tuple[str, ...], event: str) -> str:
    """The fault of opening a file; empty if there is none."""
    path, *how = arguments
    if isinstance(path, int):
        return ""
    mode, flags = (*how, None, None)[:2] if event == "open" else (None, None)
    writes = isinstance(mode, str) and set(mode) & set("wax+")
    writes = writes or (isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR))
    place = os.path.realpath(os.fsdecode(path or "."))
    return str(path) if writes or not _inside(place, (*folders, *_INSTALLED, _PACKAGE)) else ""


def _inside(place: str, folders: Iterable[str]) -> bool:
    return any(place == each or place.startswith(each + os.sep) for each in folders)
