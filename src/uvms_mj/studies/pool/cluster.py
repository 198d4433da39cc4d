"""Workers of a Dask cluster in the shape of ``concurrent.futures``."""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

from ...errors import InputError, needs_extra

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
