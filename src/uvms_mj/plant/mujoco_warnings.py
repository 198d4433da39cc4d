"""MuJoCo's warnings as Python warnings. By default MuJoCo writes them to MUJOCO_LOG.TXT in the working folder."""

import contextlib
import threading
import warnings
from collections.abc import Callable, Iterator

import mujoco


class MujocoWarning(UserWarning):
    """A warning of MuJoCo, e.g. of a state that is not finite."""


_lock = threading.Lock()
_collecting: dict[int, list[str]] = {}
"""Texts by thread: MuJoCo has one handler per process and calls it on the thread that steps."""
_before: list[Callable[[str], None] | None] = []


def _collect(text: str) -> None:
    texts = _collecting.get(threading.get_ident())
    if texts is not None:
        texts.append(text)
    elif _before and _before[0] is not None:
        _before[0](text)


@contextlib.contextmanager
def mujoco_warnings() -> Iterator[None]:
    """Collect this thread's warnings from MuJoCo, and issue each different one once at the end."""
    thread = threading.get_ident()
    with _lock:
        if not _collecting:
            _before[:] = [mujoco.get_mju_user_warning()]
            mujoco.set_mju_user_warning(_collect)
        outer = _collecting.get(thread)
        texts: list[str] = []
        _collecting[thread] = texts
    try:
        yield
    finally:
        with _lock:
            if outer is None:
                del _collecting[thread]
            else:
                _collecting[thread] = outer
            if not _collecting:
                mujoco.set_mju_user_warning(_before[0])
        for text in dict.fromkeys(texts):
            warnings.warn(f"MuJoCo: {text}", MujocoWarning, stacklevel=4)
