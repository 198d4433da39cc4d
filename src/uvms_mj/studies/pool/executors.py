"""Calls on an executor of the shape of ``concurrent.futures``: the processes of this machine, a Dask cluster
(:class:`Cluster`), or another one, such as submitit's.
"""

import contextlib
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from typing import Any

from loky import ProcessPoolExecutor

from ...errors import InputError, needs_extra

_AHEAD = 3
"""Calls that an executor is given ahead, for each of its workers."""
_LOOK_S = 0.2
"""Longest time from one look at the futures to the next."""
ATTEMPTS = 3
"""Workers that a call may end before it is given up."""
_STARTS = 3
"""Processes that are started for a worker, if they end while they start."""
_THREADS = ("OMP", "OPENBLAS", "MKL", "VECLIB_MAXIMUM", "NUMEXPR", "BLIS", "POLARS_MAX")
_ENVIRONMENT = {f"{name}_NUM_THREADS": "1" for name in _THREADS} | {
    "MUJOCO_GL": "disable",
    "PYDANTIC_DISABLE_PLUGINS": "__all__",
}
"""Environment of a worker, which has one thread of computation and no display."""


class WorkerLost(Exception):
    """The worker of a call ended during it."""


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Workers(Executor):
    """Worker processes of this machine; ``workers`` is their number, by default the number of cores that this process
    may use.

    Each thread of a pool has a process of its own, so that one that ends loses its own call only: it raises
    :class:`WorkerLost`, and the next call of the thread starts another process. The processes of the library loky do
    not import the user's script, so it needs no guard. They end with the process that started them, however that ends.
    """

    def __init__(self, workers: int | None = None) -> None:
        self.size = workers or cores()
        self._threads = ThreadPoolExecutor(self.size)
        # loky begins a worker anew when its memory has grown by 300 MB, which long traces need: no run is lost
        warnings.filterwarnings("ignore", "A worker was restarted", UserWarning, "loky")
        self._own, self._lock = threading.local(), threading.Lock()
        self._processes: set[ProcessPoolExecutor] | None = set()

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        return self._threads.submit(self._call, function, *args, **kwargs)

    def _call(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:
        """Make a call in the process of this thread."""
        process = getattr(self._own, "process", None) or self._started()
        try:
            return process.submit(function, *args, **kwargs).result()
        except BrokenExecutor as error:
            self._own.process = None
            raise WorkerLost(str(error)) from error

    def _started(self) -> ProcessPoolExecutor:
        """A process for this thread, which has answered once."""
        for _ in range(_STARTS):
            with self._lock:
                if self._processes is None:
                    raise CancelledError
                process = ProcessPoolExecutor(1, initializer=_begin, env=_ENVIRONMENT)
                self._processes.add(process)
            with contextlib.suppress(BrokenExecutor):
                process.submit(int).result()
                self._own.process = process
                return process
        raise InputError("worker processes end while they start, see above")

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers, without ``wait`` also during a call."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        with self._lock:
            processes, self._processes = self._processes or set(), None
        for process in processes:
            process.shutdown(wait=False, kill_workers=True)


def _begin() -> None:
    """Prepare a worker."""
    for each in (signal.SIGINT, signal.SIGHUP):  # Ctrl-C and a closed terminal are for the process that started it
        signal.signal(each, signal.SIG_IGN)
    os.dup2(2, 1)  # standard output is for the result alone
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process when its parent has ended, also in the middle of a call: nobody waits for it."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(0)


@contextlib.contextmanager
def executor_of(given: Executor | None, workers: int | None, scheduler: str | None = None) -> Iterator[Executor]:
    """The given executor, which stays open, or new workers of this machine or of a Dask scheduler, which end here."""
    if given is not None:
        yield given
        return
    own: Executor = Workers(workers) if scheduler is None else Cluster(scheduler)
    try:
        yield own
    finally:
        own.shutdown(wait=False, cancel_futures=True)


def size_of(executor: Executor) -> int:
    """Number of workers of an executor now."""
    return max(1, int(getattr(executor, "size", 0) or getattr(executor, "_max_workers", 0) or os.cpu_count() or 1))


def each_call(
    executor: Executor,
    function: Callable[..., Any],
    calls: Iterable[tuple[Any, ...]],
    done: Callable[[tuple[Any, ...], Any], Any],
    tick: Callable[[], None],
    parts: Callable[[tuple[Any, ...]], Sequence[tuple[Any, ...]]] = lambda call: (),
) -> None:
    """Make calls ``function(*call)`` on an executor, a few ahead for each of its workers.

    A call whose worker ended is made again in its ``parts``. One without parts is given up after :data:`ATTEMPTS`
    workers: something else may have ended the first ones.

    Args:
        done: is called on this thread with a call and its result; or with :class:`WorkerLost` if it was given up.
        tick: is called after each call, and five times per second; an exception that it raises ends everything.

    A future needs ``done()`` and ``result()``, as also the jobs of submitit have them.

    Raises:
        InputError: the executor or its workers can't go on.
    """
    again: list[tuple[tuple[Any, ...], int]] = []  # calls with the workers that they ended
    source, flying, told, room = ((call, 0) for call in calls), dict[Any, tuple[tuple[Any, ...], int]](), -_LOOK_S, 0
    while True:
        look = time.monotonic() - told > _LOOK_S
        try:
            room = _AHEAD * size_of(executor) if look else room
            while len(flying) < room and (following := again.pop(0) if again else next(source, None)) is not None:
                flying[executor.submit(function, *following[0])] = following
        except (RuntimeError, OSError, CancelledError) as error:
            raise gave_up(error) from error
        if not flying:
            return
        if look:
            told = time.monotonic()
            tick()
        _wait(flying)
        for future in [future for future in flying if future.done()]:
            call, ended = flying.pop(future)
            answer = _result(future, getattr(executor, "worker_lost", WorkerLost))
            if isinstance(answer, BrokenExecutor):  # it starts anew, or refuses the call
                again.append((call, ended))
            elif isinstance(answer, WorkerLost) and (smaller := parts(call)):
                again += [(each, 0) for each in smaller]
            elif isinstance(answer, WorkerLost) and ended + 1 < ATTEMPTS:
                again.append((call, ended + 1))
            else:
                done(call, answer)
            tick()


def _wait(futures: Iterable[Any]) -> None:
    """Wait for one of some futures, but no longer than for the next look. Jobs of another kind are asked only then."""
    own = [future for future in futures if isinstance(future, Future)]
    if own:
        wait(own, _LOOK_S, FIRST_COMPLETED)
    elif not any(future.done() for future in futures):
        time.sleep(_LOOK_S)


def _result(future: Any, lost: type[BaseException]) -> Any:
    """The result of a future, or the error that its worker, or all of them, ended."""
    try:
        return future.result()
    except lost as error:
        return WorkerLost(str(error))
    except BrokenExecutor as error:
        return error
    except CancelledError as error:
        raise gave_up(error) from error
    except ModuleNotFoundError as error:
        raise InputError(f"a worker lacks {error.name}: install the same packages there as here") from error


def gave_up(error: BaseException) -> InputError:
    """The error of an executor that cannot go on."""
    what = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return InputError(f"the workers can't go on: {what}; the finished runs are kept, and the same command goes on")


_PATIENCE_S = 30.0
"""Time in which a scheduler must answer."""


class Cluster(Executor):
    """The workers of a ``dask.distributed`` scheduler, at an address such as tcp://10.0.0.1:8786. They may come and go.

    Start the Dask workers with one thread each: a run is native code on one core. A loop without end in a user's stage
    ends the Dask worker ten seconds after the time limit of the run.

    Raises:
        InputError: the extra ``cluster`` is not installed, or no scheduler answers.
    """

    def __init__(self, address: str) -> None:
        with needs_extra("cluster"):
            import distributed
        self.worker_lost = distributed.KilledWorker  # Dask has tried several
        try:
            self._client = distributed.Client(address, timeout=_PATIENCE_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"--scheduler {address}: no scheduler answers: {error}") from None
        self._calls = self._client.get_executor(pure=False)

    @property
    def size(self) -> int:
        """Number of threads of all workers now."""
        return sum(self._client.nthreads().values())

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        return self._calls.submit(function, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster. The scheduler forgets the calls that are not done."""
        self._client.close()
