"""Workers of a Dask cluster in the shape of ``concurrent.futures``.

Start the Dask workers with one thread each: a run is native code on one core. A loop without end in a user's stage ends
the Dask worker ten seconds after the time limit of the run.
"""

import functools
import logging
import math
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
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
        self._lost = distributed.KilledWorker
        self._size, self._asked, self._closed = 0, -math.inf, False

    @property
    def size(self) -> int:
        """Number of threads of all workers, asked for every two seconds."""
        if time.monotonic() - self._asked > _ASKED_S:
            try:
                self._size, self._asked = sum(self._client.nthreads().values()), time.monotonic()
            except Exception as error:
                raise gave_up(error) from error
        return self._size

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        ours: Future[Any] = Future()
        try:
            theirs = self._client.submit(function, *args, **kwargs, pure=False)
        except Exception as error:
            raise gave_up(error) from error
        theirs.add_done_callback(functools.partial(self._pass_on, ours))
        return ours

    def _pass_on(self, ours: "Future[Any]", theirs: Any) -> None:
        if self._closed:  # Dask would wait for ever
            return
        result: Any = None
        raised: Exception | None = None
        try:
            result = theirs.result(timeout=_PATIENCE_S)
        except self._lost as error:  # Dask has tried several workers
            raised = ProcessExpired(str(error))
        except (CancelledError, TimeoutError, OSError) as error:  # of Dask
            raised = gave_up(error)
        except Exception as error:  # of the call
            raised = error
        if raised is None:
            ours.set_result(result)
        else:
            ours.set_exception(raised)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster. The scheduler forgets the calls that are not done."""
        self._closed = True
        self._client.close()
