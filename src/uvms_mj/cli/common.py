"""Shared parts of the commands: signals, exit status, messages for bad input, a progress bar."""

import contextlib
import functools
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

if TYPE_CHECKING:
    from ..records.trace import Trace


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


EXIT_BAD_INPUT, EXIT_UNSTABLE, EXIT_ENGINES_DIFFER = 2, 3, 4


def refuse_existing(option: str, path: Path, force: bool) -> None:
    """Raise InputError if the path exists and ``force`` is not set."""
    from ..errors import InputError

    if os.path.lexists(path) and not force:
        raise InputError(f"{option} {path}: exists; choose another name, or replace it with --force")


def draw_to_files() -> None:
    """Make matplotlib draw to files only, whatever window system is set, and hide its warnings, such as those about its
    cache. Call this before matplotlib is imported."""
    os.environ["MPLBACKEND"] = "agg"
    logging.getLogger("matplotlib").setLevel(logging.ERROR)


@contextlib.contextmanager
def progress_bar(
    what: str, hidden: bool, stop: Stop, text: str = "{share:.0%}", **fields: Any
) -> Iterator[Callable[..., None]]:
    """:func:`..views.progress.bar`, whose function also checks for signals."""
    if hidden:
        yield lambda *counts, **fields: stop.check()
        return
    from ..views.progress import bar

    with bar(what, text, **fields) as update:

        def advance(done: int, total: int, **fields: Any) -> None:
            stop.check()
            update(done, total, **fields)

        yield advance


@contextlib.contextmanager
def bad_input() -> Iterator[None]:
    """Turn an InputError into one message and exit status 2.

    Raises:
        KeyboardInterrupt: a signal came, and an import or a compiler replaced its exception by another one.
    """
    try:
        yield
    except Exception as error:
        from ..errors import InputError

        if Stop.received is not None:
            raise KeyboardInterrupt from None
        if not isinstance(error, InputError):
            raise
        end(f"error: {error}", EXIT_BAD_INPUT)


@contextlib.contextmanager
def filling(folder: Path, note: Callable[[], str] = str) -> Iterator[None]:
    """:func:`bad_input` for a command that fills a folder. A signal, and a file that can't be written, also end it with
    one message, to which ``note`` adds what is kept."""
    try:
        with bad_input():
            yield
    except KeyboardInterrupt:
        end(f"interrupted{note()}", exit_interrupted())
    except OSError as error:
        end(f"error: {error.filename or folder}: {error.strerror or error}{note()}", EXIT_BAD_INPUT)


def printable(text: str) -> str:
    """Text with control characters escaped: names of files, or in a log, must not control the terminal."""
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)


def end(message: str, status: int) -> NoReturn:
    click.echo(printable(message), err=True)
    sys.exit(status)


def ended(trace: "Trace") -> int:
    """Print why a run did not complete, and return the exit status."""
    status = trace.status.name
    if status != "completed":
        click.echo(f"{status}: {trace.message}", err=True)
    return {"unstable": EXIT_UNSTABLE, "interrupted": exit_interrupted()}.get(status, 0)
