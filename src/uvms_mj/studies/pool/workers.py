"""Worker processes of this machine in the shape of ``concurrent.futures``.

A worker is a process with one thread of computation. It is started once. When the process that started it ends, however
it ends, so does the worker.
"""

import contextlib
import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from multiprocessing.connection import Connection, Pipe
from typing import Any

from ...errors import InputError

_STARTS = 3
"""Worker processes that may end while they start."""
_THREADS = ("OMP", "OPENBLAS", "MKL", "NUMBA", "VECLIB_MAXIMUM", "NUMEXPR", "BLIS", "POLARS_MAX")
_QUIET = {"MUJOCO_GL": "disable", "PYDANTIC_DISABLE_PLUGINS": "__all__"}


class WorkerLost(RuntimeError):
    """A worker process ended during a call."""


def gave_up(error: BaseException) -> InputError:
    """The error of an executor that cannot go on."""
    what = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return InputError(f"the workers can't go on: {what}; what is done is kept, and the same command goes on")


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Workers(Executor):
    """Worker processes of this machine.

    A call whose worker ends raises :class:`WorkerLost`, and the other calls go on: another worker takes its place. No
    module of the user's is imported in a worker, so a script needs no guard.

    Args:
        workers: their number; default: the cores that this process may use.
    """

    def __init__(self, workers: int | None = None) -> None:
        self.size = workers or cores()
        self._calls: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._processes: list[_Worker] = []
        self._closed = False
        self._threads = [threading.Thread(target=self._serve, daemon=True) for _ in range(self.size)]
        for thread in self._threads:
            thread.start()

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        if self._closed:
            raise RuntimeError("the workers are shut down")
        future: Future[Any] = Future()
        self._calls.put((future, (function, args, kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers, without ``wait`` also those that are in a call."""
        self._closed = True
        for _ in self._threads:
            self._calls.put(None)
        if not wait:
            for worker in list(self._processes):
                worker.kill()
        else:
            for thread in self._threads:
                thread.join()

    def _serve(self) -> None:
        """Pass calls to one worker, one after the other."""
        worker = None
        while (task := self._calls.get()) is not None:
            future, call = task
            if not future.set_running_or_notify_cancel():
                continue
            try:
                worker = worker or self._started()
                result, raised = worker.call(call)
            except BaseException as error:  # of this process, e.g. no memory for another one
                result, raised = None, error
            if isinstance(raised, WorkerLost) and worker is not None:
                self._processes.remove(worker)
                worker = None
            if raised is None:
                future.set_result(result)
            else:
                future.set_exception(raised)
        if worker is not None:
            worker.kill()

    def _started(self) -> "_Worker":
        """A new worker that has imported what it needs. Raises InputError if it can't."""
        for _ in range(_STARTS):
            worker = _Worker()
            self._processes.append(worker)
            lost = worker.answer()[1]
            if lost is None or self._closed:
                return worker
            self._processes.remove(worker)
        raise InputError(f"worker processes can't start, see above: {lost}")


class _Worker:
    """One process, and this end of the pipe to it."""

    def __init__(self) -> None:
        self._pipe, theirs = Pipe()
        one = {f"{name}_NUM_THREADS": "1" for name in _THREADS}
        code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve({theirs.fileno()})"
        self._process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.DEVNULL,
            stdout=2,  # standard output is for the result alone
            pass_fds=[theirs.fileno()],
            env={**os.environ, **one, **_QUIET},
            start_new_session=True,  # Ctrl-C is for this process
        )
        theirs.close()

    def call(self, call: Any) -> tuple[Any, BaseException | None]:
        """The result of a call, or the exception that it raised, or WorkerLost."""
        with contextlib.suppress(OSError):  # the answer is then that the worker is lost
            self._pipe.send_bytes(pickle.dumps(call))
        return self.answer()

    def answer(self) -> tuple[Any, BaseException | None]:
        """The next answer of the worker."""
        try:
            return pickle.loads(self._pipe.recv_bytes())
        except (EOFError, OSError):
            self.kill()
            status = self._process.returncode
            how = f"by signal {-status}" if status < 0 else f"with status {status}"
            return None, WorkerLost(f"a worker process ended {how}")

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()


def serve(descriptor: int) -> None:
    """Answer calls until the other end of the pipe is closed: the life of a worker."""
    pipe, calls = Connection(descriptor), queue.SimpleQueue[bytes]()

    def read() -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                calls.put(pipe.recv_bytes())
        os._exit(0)  # also in the middle of a call: nobody waits for it

    threading.Thread(target=read, daemon=True).start()
    from .. import rows  # noqa: F401  # imports what every call needs

    pipe.send_bytes(pickle.dumps((None, None)))
    while True:
        try:
            function, args, kwargs = pickle.loads(calls.get())
            answer = pickle.dumps((function(*args, **kwargs), None))
        except Exception as error:
            answer = _pickled(error)
        pipe.send_bytes(answer)


def _pickled(error: Exception) -> bytes:
    """An exception as an answer; its text alone if it can't be copied."""
    try:
        data = pickle.dumps((None, error))
        pickle.loads(data)
    except Exception:
        data = pickle.dumps((None, RuntimeError(f"{type(error).__name__}: {error}")))
    return data
