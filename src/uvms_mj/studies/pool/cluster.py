"""Workers of a Dask cluster in the shape of ``concurrent.futures``.

Each thread of a Dask worker passes its calls to a process of its own on the same machine (:mod:`.workers`). So a run
has one thread of computation, can be interrupted at its time limit, and does not delay the Dask worker's answers.
"""

import functools
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

from ...errors import InputError, needs_extra
from .workers import WorkerLost, Workers

_PATIENCE_S = 30.0
"""Time in which a scheduler must answer."""


class Cluster(Executor):
    """The workers of a ``dask.distributed`` scheduler, at an address such as tcp://10.0.0.1:8786. They may come and go.

    Raises:
        InputError: the extra ``cluster`` is not installed, or no scheduler answers.
    """

    def __init__(self, address: str) -> None:
        with needs_extra("cluster"):
            import distributed
        try:
            self._client = distributed.Client(address, timeout=_PATIENCE_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"--scheduler {address}: no scheduler answers: {error}") from None
        self._lost = distributed.KilledWorker

    @property
    def size(self) -> int:
        """Number of threads of all workers now."""
        return sum(self._client.nthreads().values())

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        ours: Future[Any] = Future()
        theirs = self._client.submit(_in_a_process, function, args, kwargs, pure=False)
        theirs.add_done_callback(functools.partial(self._pass_on, ours))
        return ours

    def _pass_on(self, ours: "Future[Any]", theirs: Any) -> None:
        try:
            ours.set_result(theirs.result())
        except self._lost as error:  # Dask has tried several workers
            ours.set_exception(WorkerLost(str(error)))
        except BaseException as error:
            ours.set_exception(error)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster. The scheduler forgets the calls that are not done."""
        self._client.close()


_own = threading.local()


def _in_a_process(function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    """Make a call in the process of this thread of a Dask worker."""
    if not hasattr(_own, "workers"):
        _own.workers = Workers(1)
    return _own.workers.submit(function, *args, **kwargs).result()
