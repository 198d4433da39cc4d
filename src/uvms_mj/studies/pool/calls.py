"""Calls on an executor of the shape of ``concurrent.futures``: Workers, a cluster, or one of the user's."""

import os
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from itertools import compress
from operator import not_
from typing import Any

from pebble import ProcessExpired

from ...errors import InputError
from .workers import gave_up

_AHEAD = 3
"""Calls that an executor is given ahead, for each of its workers."""
_LOOK_S = 5e-3
"""Time from one look at the futures to the next."""


def each_call(
    executor: Executor,
    function: Callable[..., Any],
    calls: Iterable[tuple[Any, ...]],
    done: Callable[[tuple[Any, ...], Any], Sequence[tuple[Any, ...]]],
    tick: Callable[[], None],
) -> None:
    """Make calls ``function(*call)`` on an executor, a few ahead for each of its workers.

    ``done`` is called on this thread with a call and its result, or its ProcessExpired, and returns the calls to make
    instead. ``tick`` is called after each call, and five times per second; an exception that it raises ends everything.
    A future needs ``done()`` and ``result()``, as also the jobs of submitit have them.

    Raises:
        InputError: the executor or its workers can't go on.
    """
    again: list[tuple[Any, ...]] = []
    source, flying, told = iter(calls), list[tuple[tuple[Any, ...], Any]](), time.monotonic()
    while True:
        while len(flying) < _AHEAD * _size(executor):
            call = again.pop(0) if again else next(source, None)
            if call is None:
                break
            try:
                flying.append((call, executor.submit(function, *call)))
            except RuntimeError as error:
                raise gave_up(error) from error
        if not flying:
            return
        over = [future.done() for _, future in flying]
        ended, flying = list(compress(flying, over)), list(compress(flying, map(not_, over)))
        for call, future in ended:
            answer = _result(future)
            # of a broken executor: it starts anew, or refuses the call
            again.extend([call] if isinstance(answer, BrokenExecutor) else done(call, answer))
            tick()
        if not ended:
            time.sleep(_LOOK_S)
        if time.monotonic() - told > 0.2:
            told = time.monotonic()
            tick()


def _result(future: Any) -> Any:
    """The result of a future, or the error that its worker, or all of them, ended."""
    try:
        return future.result()
    except (ProcessExpired, BrokenExecutor) as lost:
        return lost
    except CancelledError as error:
        raise gave_up(error) from error
    except ModuleNotFoundError as error:
        raise InputError(f"a worker lacks {error.name}: install the same packages there as here") from error


def _size(executor: Executor) -> int:
    """Number of workers of an executor now; a new worker of a cluster is given calls as soon as it is there."""
    return max(1, int(getattr(executor, "size", 0) or getattr(executor, "_max_workers", 0) or os.cpu_count() or 1))
