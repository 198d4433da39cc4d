"""Calls on an executor of the shape of ``concurrent.futures``: Workers, a cluster, or one of the user's."""

import collections
import functools
import os
import queue
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from typing import Any

from pebble import ProcessExpired

from ...errors import InputError
from .workers import gave_up

_AHEAD = 3
"""Calls that an executor is given ahead, for each of its workers."""


def each_call(
    executor: Executor,
    function: Callable[..., Any],
    calls: Iterable[tuple[Any, ...]],
    done: Callable[[tuple[Any, ...], Any], Sequence[tuple[Any, ...]]],
    tick: Callable[[], None],
) -> None:
    """Make calls ``function(*call)`` on an executor, a few ahead for each of its workers.

    ``done`` is called on this thread with a call and its result, or its ProcessExpired, and returns the calls to make
    instead. ``tick`` is called five times per second; an exception that it raises ends everything.

    Raises:
        InputError: the executor or its workers can't go on.
    """
    waiting: collections.deque[tuple[Any, ...]] = collections.deque()
    source, flying, asked = iter(calls), 0, list[tuple[tuple[Any, ...], Any]]()
    ended: queue.SimpleQueue[tuple[tuple[Any, ...], Future[Any]]] = queue.SimpleQueue()
    while True:
        while flying < _AHEAD * _size(executor):
            call = waiting.popleft() if waiting else next(source, None)
            if call is None:
                break
            try:
                future = executor.submit(function, *call)
            except RuntimeError as error:
                raise gave_up(error) from error
            if hasattr(future, "add_done_callback"):
                future.add_done_callback(functools.partial(_put, ended, call))
            else:  # a job of submitit
                asked.append((call, future))
            flying += 1
        if not flying:
            return
        for each in [each for each in asked if each[1].done()]:
            asked.remove(each)
            ended.put(each)
        try:
            call, future = ended.get(timeout=0.2)
        except queue.Empty:
            tick()
            continue
        flying -= 1
        answer = _result(future)
        again = isinstance(answer, BrokenExecutor)  # the executor starts anew, or refuses the call
        waiting.extend([call] if again else done(call, answer))
        tick()


def _put(ended: "queue.SimpleQueue[Any]", call: tuple[Any, ...], future: "Future[Any]") -> None:
    ended.put((call, future))


def _result(future: "Future[Any]") -> Any:
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
