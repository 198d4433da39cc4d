"""Worker processes of this machine in the shape of ``concurrent.futures``, by the library pebble.

A worker is a process with one thread of computation. It is started once, and ends with the process that started it,
however that ends. A call whose worker ends raises pebble's ProcessExpired; another worker takes its place, and the
other calls go on. The processes of the library loky do not import the user's script, so it needs no guard.
"""

import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

from loky.backend import get_context
from pebble import CONSTS, ProcessPool

from ...errors import InputError

_STARTS = 5
"""Pools of processes that are started in all. A pool breaks if a process ends outside a call, e.g. while it starts."""
CONSTS.channel_lock_timeout = 10.0  # [s] for a lock of pebble's whose owner was killed; 60 by default
_ONE_THREAD = ("OMP", "OPENBLAS", "MKL", "VECLIB_MAXIMUM", "NUMEXPR", "BLIS", "POLARS_MAX")


def gave_up(error: BaseException) -> InputError:
    """The error of an executor that cannot go on."""
    what = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return InputError(f"the workers can't go on: {what}; what is done is kept, and the same command goes on")


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Workers(Executor):
    """Worker processes of this machine; ``workers`` is their number, by default that of the cores that this process may
    use."""

    def __init__(self, workers: int | None = None) -> None:
        self.size = workers or cores()
        self._starts, self._closed = 0, False
        self._start()

    def _start(self) -> None:
        self._starts += 1
        self._pool = ProcessPool(self.size, initializer=_begin, context=get_context("loky"))

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        if not self._pool.active and not self._closed and self._starts < _STARTS:
            self._start()
        if not self._pool.active and not self._closed:
            raise InputError("worker processes end while they start, see above")
        return self._pool.schedule(function, args=args, kwargs=kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers, without ``wait`` also those that are in a call."""
        self._closed = True
        self._pool.close() if wait else self._pool.stop()
        self._pool.join()


def _begin() -> None:
    """Prepare a worker, before it imports anything large."""
    os.environ.update({f"{name}_NUM_THREADS": "1" for name in _ONE_THREAD})
    os.environ |= {"MUJOCO_GL": "disable", "PYDANTIC_DISABLE_PLUGINS": "__all__"}
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that started it
    os.dup2(2, 1)  # standard output is for the result alone
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process when its parent has ended, also in the middle of a call: nobody waits for it."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(0)
