"""Workers of a Dask cluster in the shape of ``concurrent.futures``.

Start the Dask workers with one thread each: a run is native code on one core. A loop without end in a user's stage ends
the Dask worker ten seconds after the time limit of the run.
"""

import logging
import math
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor
from dataclasses import dataclass
from typing import Any

from pebble import ProcessExpired

from ...errors import InputError, needs_extra
from .workers import gave_up

_PATIENCE_S = 30.0
"""Time in which a scheduler must answer."""
_ASKED_S = 2.0
"""Time from one look at the number of workers to the next."""


class Cluster(Executor):
    """The workers of a ``dask.distributed`` scheduler, at an address such as tcp://10.0.0.1:8786. They may come and go.

    Raises:
        InputError: the extra ``cluster`` is not installed, or no scheduler answers.
    """

    def __init__(self, address: str) -> None:
        with needs_extra("cluster"):
            import distributed
        for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
            logging.getLogger(name).setLevel(logging.CRITICAL)  # the command has its own messages
        try:
            self._client = distributed.Client(address, timeout=_PATIENCE_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"--scheduler {address}: no scheduler answers: {error}") from None
        self._size, self._asked = 0, -math.inf

    @property
    def size(self) -> int:
        """Number of threads of all workers, asked for every two seconds."""
        if time.monotonic() - self._asked > _ASKED_S:
            try:
                self._size, self._asked = sum(self._client.nthreads().values()), time.monotonic()
            except Exception as error:
                raise gave_up(error) from error
        return self._size

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:
        try:
            return _Job(self._client.submit(function, *args, **kwargs, pure=False))
        except Exception as error:
            raise gave_up(error) from error

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster. The scheduler forgets the calls that are not done."""
        self._client.close()


@dataclass(frozen=True)
class _Job:
    """A future of Dask with the errors of a pool."""

    theirs: Any

    def done(self) -> bool:
        return bool(self.theirs.done())

    def result(self) -> Any:
        from distributed import KilledWorker

        try:
            return self.theirs.result(timeout=_PATIENCE_S)
        except KilledWorker as error:  # Dask has tried several workers
            raise ProcessExpired(str(error)) from error
        except (CancelledError, TimeoutError, OSError) as error:
            raise gave_up(error) from error
