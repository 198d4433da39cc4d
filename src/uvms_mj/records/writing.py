"""Writing of rows to sinks on a separate thread.

A run does not wait for a disk or a viewer unless they fall behind. Python raises KeyboardInterrupt on the main thread
only, so an interrupt can't leave a block half written.

KeyboardInterrupt can come between any two bytecodes of the main thread, even while it holds a lock of ``queue.Queue``.
Both threads would then wait forever. Blocks therefore go through ``SimpleQueue.put``, which is one call of C, and the
main thread polls when it has to wait. The thread starts by one call of C, too: ``threading.Thread.start`` waits at a
lock, and an interrupt there ends in RuntimeError.
"""

import _thread
import queue
import time
from collections.abc import Sequence
from typing import Self

import numpy as np

from .header import Header, Outcome, Sink

_WAITING = 1
"""Length of the queue, in blocks. When it is full, the run waits. A longer one is no faster, and kill -9 loses more."""
_LOOKS_EVERY_S = 0.0005


class Writing:
    """Passes rows to the sinks in order, on a thread of its own. Leaving the context waits for the last row.

    The sinks begin on the calling thread, so that a sink that can't be opened fails before the first step."""

    def __init__(self, sinks: Sequence[Sink], header: Header) -> None:
        self.error: BaseException | None = None
        """The exception that a sink raised, or None. No sink is called after it."""
        self._sinks = sinks
        for sink in sinks:
            sink.begin(header)
        self._queue: queue.SimpleQueue[tuple[int, np.ndarray] | Outcome] = queue.SimpleQueue()
        self._at_work = bool(sinks)
        if sinks:
            _thread.start_new_thread(self._work, ())

    @property
    def message(self) -> str:
        """The error, as a message for the user."""
        error = self.error
        if isinstance(error, OSError):
            return f"can't write {error.filename or 'the log'}: {error.strerror}"
        return f"a sink failed: {type(error).__name__}: {error}"

    def put(self, first: int, rows: np.ndarray) -> None:
        """Pass on rows (n, width), numbered from first. Passing on the same rows again has no effect."""
        if self._sinks and self.error is None:
            self._hand_over((first, rows))

    def end(self, outcome: Outcome) -> None:
        """Pass on the outcome, after the last rows."""
        if self._sinks:
            self._hand_over(outcome)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        while kind is None and self._at_work:
            time.sleep(_LOOKS_EVERY_S)

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
            except BaseException as error:  # the thread of the run reports it to the user
                self.error = error
        self._at_work = False
