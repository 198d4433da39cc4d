"""Sinks at work on a thread of their own: a run does not wait for a disk or a viewer, and an interrupt, which Python
raises on the main thread, can't tear what they write.

KeyboardInterrupt can come between any two bytecodes of the main thread, also while it holds a lock of ``queue.Queue``,
and then both threads would wait for ever. So blocks go through ``SimpleQueue.put``, one call of C, and where the main
thread has to wait it polls.
"""

import queue
import threading
import time
from collections.abc import Sequence
from typing import Self

import numpy as np

from .recording import Header, Outcome, Sink

_WAITING = 1
"""Blocks that may wait: then the run waits for its sinks. More are not quicker, and kill -9 loses what waits."""
_LOOKS_EVERY_S = 0.0005


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
        self._queue: queue.SimpleQueue[tuple[int, np.ndarray] | Outcome] = queue.SimpleQueue()
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
            self._hand_over((first, rows))

    def end(self, outcome: Outcome) -> None:
        """Nothing more will come."""
        if self._sinks:
            self._hand_over(outcome)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        if self._sinks and kind is None:
            self._thread.join()

    def _hand_over(self, item: tuple[int, np.ndarray] | Outcome) -> None:
        while self._queue.qsize() >= _WAITING:
            time.sleep(_LOOKS_EVERY_S)
        self._queue.put(item)

    def _work(self) -> None:
        following = 0
        item: tuple[int, np.ndarray] | Outcome | None = None
        while not isinstance(item, Outcome):
            try:
                item = self._queue.get()
                if isinstance(item, Outcome):
                    for sink in self._sinks if self.error is None else ():
                        sink.end(item)
                elif self.error is None and item[0] == following:
                    for sink in self._sinks:
                        sink.write(item[1])
                    following += len(item[1])
            except BaseException as error:  # the run's own thread tells the user
                self.error = error
