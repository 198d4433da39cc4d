"""Shared parts of the commands: exit status, messages for bad input, a progress bar."""

import contextlib
import logging
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from .stop import Stop, exit_interrupted

if TYPE_CHECKING:
    from ..records.trace import Trace

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
