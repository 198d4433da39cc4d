"""Ctrl-C and SIGTERM."""

import functools
import os
import signal
import threading
import time
from typing import Any


class Stop:
    """Handler of Ctrl-C and SIGTERM.

    The first signal raises KeyboardInterrupt in the main thread. If the program still runs 5 s later, for example
    because a disk hangs, the next signal ends it immediately.

    The exception is lost if Python runs in a callback from C, as when LLVM reports a finished object; :meth:`check`
    raises it again. If the main thread is in machine code that never returns, such as a law with an endless loop, a
    second thread ends the program.
    """

    _PATIENCE_S = 5.0
    _first: float | None = None
    """Time of the first signal since the last Stop was made [s]."""
    received: int | None = None
    """Number of the signal that was received since the last Stop was made."""

    def __init__(self) -> None:
        self.requested = False
        Stop._first = Stop.received = None
        signal.set_wakeup_fd(_watched(), warn_on_full_buffer=False)
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, self._on_signal)

    def _on_signal(self, number: int, frame: Any) -> None:
        if not self.requested:
            self.requested = True
            Stop.received = number
            raise KeyboardInterrupt

    @classmethod
    def watch(cls, read_end: int) -> None:
        """End the program at a late second signal. C writes signals to the pipe even if the main thread is busy."""
        while number := os.read(read_end, 1):
            if number[0] in (signal.SIGINT, signal.SIGTERM):
                now = time.monotonic()
                if cls._first is None:
                    cls._first = now
                elif now - cls._first > cls._PATIENCE_S:
                    os._exit(128 + number[0])

    def check(self) -> None:
        if self.requested:
            raise KeyboardInterrupt

    def ignore(self) -> None:
        """Ignore signals while the last results are written. :meth:`watch` still ends a write that hangs."""
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, signal.SIG_IGN)


@functools.cache
def _watched() -> int:
    """Write end of the pipe on which C reports signals to the watching thread."""
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    threading.Thread(target=Stop.watch, args=(read_end,), name="uvms-mj signals", daemon=True).start()
    return write_end


def exit_interrupted() -> int:
    """Exit status after a signal, as in shells: 130 for Ctrl-C, 143 for SIGTERM."""
    return 128 + (Stop.received or signal.SIGINT)
