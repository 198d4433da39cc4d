"""Shared parts of the commands: exit status, messages for bad input, signals, folders."""

import contextlib
import functools
import json
import logging
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

import click

from .console import printable

EXIT_BAD_INPUT, EXIT_UNSTABLE = 2, 3


class _Command(click.Command):
    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Refuse an option that is given twice; click would silently take the last."""
        _, _, given = self.make_parser(ctx).parse_args(args=list(args))
        for each in given:
            if isinstance(each, click.Option) and not (each.multiple or each.is_flag) and given.count(each) > 1:
                raise click.UsageError(f"{max(each.opts, key=len)} is given more than once; give it once", ctx)
        return super().parse_args(ctx, args)


command = functools.partial(click.command, cls=_Command)

scenario_argument = click.argument("arguments", nargs=-1, metavar="[SCENARIO] [KEY=VALUE]...")
set_option = click.option(
    "-s",
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Set a key of the scenario; may be repeated.",
)
json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object on standard output and nothing else."
)
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Print no progress bar and no table.")


def _named(context: click.Context, option: click.Parameter, value: Any) -> Any:
    if value == "" or (isinstance(value, tuple) and "" in value):
        raise click.BadParameter("must not be empty")
    return value


def path_argument(name: str, **attributes: Any) -> Any:
    """An argument with the path of one or several files; it must not be empty."""
    return click.argument(name, callback=_named, **attributes)


def path_option(*names: str, **attributes: Any) -> Any:
    """An option with the path of a file or folder; it must not be empty."""
    return click.option(*names, callback=_named, **attributes)


force_option = click.option("-f", "--force", is_flag=True, help="Replace FILE if it exists.")


def refuse_existing(option: str, path: Path, force: bool) -> None:
    """Raise InputError if the path exists and ``force`` is not set."""
    from ..errors import InputError

    if os.path.lexists(path) and not force:
        raise InputError(f"{option} {path}: exists; choose another name, or replace it with --force")


def asked_for(arguments: Sequence[str], settings: Sequence[str]) -> tuple[str | None, dict[str, Any]]:
    """The name of the scenario, if one is given, and the settings by key.

    Raises:
        InputError: several scenarios are named, or a setting is not valid.
    """
    from ..errors import InputError
    from ..files import parse_setting

    names = [a for a in arguments if "=" not in a]
    if "" in names:
        raise InputError("the name of a scenario must not be empty")
    if len(names) > 1:
        raise InputError(f"one scenario at a time, please: {', '.join(names)}")
    overrides: dict[str, Any] = {}
    for key, value in map(parse_setting, (*settings, *(a for a in arguments if "=" in a))):
        if key in overrides and overrides[key] != value:
            raise InputError(f"--set {key}: is given twice, {overrides[key]!r} and {value!r}")
        overrides[key] = value
    return (names[0] if names else None), overrides


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


def folder_for(name: str) -> Path:
    """Create a folder if needed and check that it is writable, before anything is computed.

    Raises:
        InputError: the folder cannot be created or written to.
    """
    from ..errors import InputError

    folder = Path(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(f"--out {name}: can't write there: {error.strerror}") from None
    return folder


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Lock a folder against other runs. The lock belongs to the process and leaves no file.

    Raises:
        InputError: another run is writing there.
    """
    import fcntl

    from ..errors import InputError

    place = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"--out {folder}: another run is writing there; choose another folder") from None
        except OSError:  # the file system has no locks
            pass
        yield
    finally:
        os.close(place)


def move_aside(folder: Path, paths: Iterable[Path], what: str) -> None:
    """Move earlier results to a subfolder: logs are not overwritten, and old pictures not mixed with new logs."""
    earlier = [path for path in paths if path.exists()]
    if earlier:
        n = 1
        while (aside := folder / f"earlier-{n}").exists():
            n += 1
        aside.mkdir()
        for path in earlier:
            path.rename(aside / path.name)
        click.echo(f"note: {what} in {folder} was moved to {aside}", err=True)


def draw_to_files() -> None:
    """Make matplotlib draw to files only, whatever window system is set, and hide its warnings, such as those about its
    cache. Call this before matplotlib is imported."""
    os.environ["MPLBACKEND"] = "agg"
    logging.getLogger("matplotlib").setLevel(logging.ERROR)


@contextlib.contextmanager
def progress_bar(what: str, hidden: bool, stop: Stop) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on terminals. Yields a function of the numbers done and total, which also checks for signals."""
    if hidden or not sys.stderr.isatty():
        yield lambda done, total: stop.check()
        return
    import rich.console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=rich.console.Console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None)

        def advance(done: int, total: int) -> None:
            stop.check()
            progress.update(task, completed=done, total=total)

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


def end(message: str, status: int) -> NoReturn:
    click.echo(printable(message), err=True)
    sys.exit(status)


def exit_interrupted() -> int:
    """Exit status after a signal, as in shells: 130 for Ctrl-C, 143 for SIGTERM."""
    return 128 + (Stop.received or signal.SIGINT)


def toml_value(value: Any) -> str:
    if value is None:
        return "-"
    return json.dumps(list(value) if isinstance(value, tuple) else value)
