"""Sinks at work on a thread of their own: a run does not wait for a disk or a viewer, and an interrupt, which Python
raises on the main thread, can't tear what they write."""

import queue
import threading
from collections.abc import Sequence
from typing import Self

import numpy as np

from .recording import Header, Outcome, Sink

_WAITING = 1
"""Blocks that may wait: then the run waits for its sinks. More are not quicker, and kill -9 loses what waits."""


class Writing:
    """Hands rows to sinks, in order, on one thread; a context that waits for the last of them.

    Args:
        sinks: begun at once, on the calling thread, so that what can't be opened is known before the first step.
        header: what they begin with.
    """

    def __init__(self, sinks: Sequence[Sink], header: Header) -> None:
        self.error: BaseException | None = None
        """What a sink raised. It gets nothing more then, nor do the others."""
        self._sinks = sinks
        for sink in sinks:
            sink.begin(header)
        self._queue: queue.Queue[tuple[int, np.ndarray] | Outcome] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._work, name="uvms-mj sinks", daemon=True)
        if sinks:
            self._thread.start()

    @property
    def message(self) -> str:
        """What went wrong, for a user."""
        error = self.error
        if isinstance(error, OSError):
            return f"can't write {error.filename or 'the log'}: {error.strerror}"
        return f"a sink failed: {type(error).__name__}: {error}"

    def put(self, first: int, rows: np.ndarray) -> None:
        """Hand on rows (n, width), numbered from first. To say the same twice does no harm."""
        if self._sinks and self.error is None:
            self._queue.put((first, rows))

    def end(self, outcome: Outcome) -> None:
        """Nothing more will come."""
        if self._sinks:
            self._queue.put(outcome)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        if self._sinks and kind is None:
            self._thread.join()

    def _work(self) -> None:
        following = 0
        while True:
            item = self._queue.get()
            try:
                if isinstance(item, Outcome):
                    for sink in self._sinks if self.error is None else ():
                        sink.end(item)
                    return
                first, rows = item
                if self.error is None and first == following:
                    for sink in self._sinks:
                        sink.write(rows)
                    following += len(rows)
            except BaseException as error:  # the run's own thread tells the user
                self.error = error
                if isinstance(item, Outcome):
                    return
