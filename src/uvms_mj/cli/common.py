"""Shared parts of the commands: signals, exit status, messages for bad input, progress on standard error, tables on
standard output."""

import contextlib
import functools
import json
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

if TYPE_CHECKING:
    from ..records.trace import Trace
    from ..reproduce.claims import Row


STOPPING = tuple(
    number
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN
)
"""The signals that stop a command: Ctrl-C, SIGTERM, and the signal of a closed terminal, unless nohup ignores it."""


class Stop:
    """Handler of the signals :data:`STOPPING`.

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
        for each in STOPPING:
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
            if number[0] in STOPPING:
                now = time.monotonic()
                if cls._first is None:
                    cls._first = now
                elif now - cls._first > cls._PATIENCE_S:
                    os._exit(128 + number[0])

    def check(self) -> None:
        if self.requested:
            raise KeyboardInterrupt

    def heed(self) -> None:
        """Heed signals again, after :meth:`ignore`."""
        self.requested = False
        for each in STOPPING:
            signal.signal(each, self._on_signal)

    def ignore(self) -> None:
        """Ignore signals while the last results are written. :meth:`watch` still ends a write that hangs."""
        for each in STOPPING:
            signal.signal(each, signal.SIG_IGN)


@functools.cache
def _watched() -> int:
    """Write end of the pipe on which C reports signals to the watching thread."""
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    threading.Thread(target=Stop.watch, args=(read_end,), name="uvms-mj signals", daemon=True).start()
    return write_end


def exit_interrupted() -> int:
    """Exit status after a signal, as in shells: 130 for Ctrl-C, 143 for SIGTERM, 129 for a closed terminal."""
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


class Resumed:
    """A command that fills a folder run by run, and goes on after an interruption: its signals, its progress, and the
    word of what is kept."""

    def __init__(self, noun: str) -> None:
        """``noun`` is the word for what is counted, runs or trials."""
        self.stop, self._noun = Stop(), noun
        self._counts: tuple[int, int] | None = None

    def filling(self, folder: Path) -> contextlib.AbstractContextManager[None]:
        """:func:`filling`, which says how much is kept and how to go on."""
        return filling(folder, self._kept)

    def _kept(self) -> str:
        if self._counts is None:
            return ""
        done, total = self._counts
        return f"; {round(done, 1):g} of {total} {self._noun} are done and kept: the same command goes on"

    @contextlib.contextmanager
    def bar(self, what: str, hidden: bool, text: str = "{share:.0%}", **fields: Any) -> Iterator[Callable[..., None]]:
        """:func:`progress_bar`. Its function counts what is kept, but for phases of other names than running."""
        with progress_bar(what, hidden, self.stop, text, **fields) as update:

            def advance(done: int, total: int, **fields: Any) -> None:
                if fields.get("what", "running") == "running":
                    self._counts = done, total
                update(done, total, **fields)

            yield advance


def printable(text: str) -> str:
    """Text with control characters escaped: names of files, or in a log, must not control the terminal."""
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)


def end(message: str, status: int) -> NoReturn:
    click.echo(printable(message), err=True)
    sys.exit(status)


def ended(trace: "Trace", whose: str = "") -> int:
    """Print why a run did not complete, after ``whose`` it is, and return the exit status."""
    status = trace.status.name
    if status != "completed":
        click.echo(printable(f"{whose}{status}: {trace.message}"), err=True)
    return {"unstable": EXIT_UNSTABLE, "interrupted": exit_interrupted()}.get(status, 0)


def warn_of_versions(then: Mapping[str, str], now: Mapping[str, str]) -> None:
    """Warn of the versions with which a record was made, where this machine has others."""
    changed = [f"{k} {v} then, {now[k]} now" for k, v in then.items() if now.get(k, v) != v]
    if changed:
        warn(f"the repetition may differ in its last bits: {'; '.join(changed)}")


def warn(message: object, *_: Any, **__: Any) -> None:
    """Print a warning as one line. Python gives its hook for warnings the further arguments."""
    click.echo(f"warning: {printable(str(message))}", err=True)


def label_of(scenario: Any) -> str:
    """The law of a scenario; of a world, the names of its vehicles."""
    return scenario.label if hasattr(scenario, "scenarios") else scenario.controller.label()


def scenarios_of(scenario: Any) -> Mapping[str, Any]:
    """The scenario of each vehicle of a world by the vehicle's name; of one vehicle alone the name is empty."""
    return getattr(scenario, "scenarios", {"": scenario})


class Console:
    """Prints progress and warnings to standard error and the result to standard output."""

    def __init__(self, as_json: bool, quiet: bool) -> None:
        self.as_json, self.quiet = as_json, quiet
        self._out = sys.stdout

    def alone(self) -> contextlib.AbstractContextManager[Any]:
        """A context in which a law's own prints go to standard error if standard output is reserved for JSON."""
        return contextlib.redirect_stdout(sys.stderr) if self.as_json else contextlib.nullcontext()

    @contextlib.contextmanager
    def running(self, scenario: Any, stop: Stop) -> Iterator[Callable[[int, int], None]]:
        """Context of a run: yields a function of the steps done and their total.

        The function draws a progress bar if standard error is a terminal, and checks for signals.
        """
        label = f"{scenario.name} · {label_of(scenario)}"
        shown = progress_bar(f"{label} · compiling", self.quiet, stop, "{simulated:.1f} s simulated", simulated=0.0)
        with shown as update:
            h = scenario.simulation.timestep
            yield lambda done, total: update(done, total, what=label, simulated=done * h)

    def report(self, traces: Mapping[str, Any], report: dict[str, Any]) -> None:
        """Print the report of a run, or a table of each vehicle. The name of one vehicle alone is empty."""
        if self.as_json:
            click.echo(json.dumps(report, allow_nan=False), file=self._out)
        elif not self.quiet:
            for name, trace in traces.items():
                _run_table(trace, report["vehicles"][name] if name else report, f"{name} · " if name else "")


@dataclass(frozen=True)
class Listing:
    """A table as data: a command prints it, and a page of the reference has it.

    Attributes:
        columns: the heads; none for a table of names and values.
        rows: the cells, as texts or as rich has them.
        notes: texts below the rows.
        right, fixed: the columns that are aligned to the right, and the columns that do not wrap.
        width: least width in characters.
        ruled: whether there is a line between two rows.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    notes: Sequence[str] = ()
    right: Container[str] = ()
    fixed: Container[str] = ()
    width: int | None = None
    ruled: bool = False

    def show(self, names: Container[str] | None = None) -> None:
        """Print it, as wide as the terminal, or 120 columns without one; only the rows of these names if some are
        given. Brackets are units, not markup."""
        import rich.console
        import rich.table

        heads = [
            rich.table.Column(
                head, justify="right" if head in self.right else "left", no_wrap=head in self.fixed, overflow="fold"
            )
            for head in self.columns
        ]
        table = rich.table.Table(
            *heads,
            title=self.title,
            title_justify="left",
            show_header=bool(heads),
            show_lines=self.ruled,
            min_width=self.width,
        )
        rows = self.rows if names is None else [row for row in self.rows if row[0] in names]
        for row in rows:
            table.add_row(*row)
        for note in self.notes:
            table.add_row(*[""] * (len(heads) - 1), note, style="dim")
        if rows or names is None:
            width = None if sys.stdout.isatty() else 120
            rich.console.Console(width=width, markup=False, highlight=False).print(table)


def facts(title: str, rows: Iterable[Sequence[Any]], **looks: Any) -> Listing:
    """A table of names and values."""
    return Listing(title, (), [*rows], width=60, **looks)


def log_tables(path: Any, trace: Any, files: Mapping[str, bytes]) -> None:
    """Print the contents of a log: its rows, attachments, law, versions and topics."""
    from ..records.mcap.layout import Format
    from ..records.mcap.topics import below

    header = trace.header
    rate = 1.0 / (header.row_steps * header.scenario.simulation.timestep)
    rows = [
        ("file", f"{path}, {path.stat().st_size / 1e6:.1f} MB"),
        ("rows", f"{len(trace)} at {rate:g} Hz, {trace.t[0]:g} to {trace.t[-1]:g} s" if len(trace) else "0"),
    ]
    for name, stage in header.sources.items():
        if stage.sha256 or name == "controller":
            digest = f", sha256 {stage.sha256}" if stage.sha256 else ""
            rows.append(("law" if name == "controller" else name, f"{stage.source}{digest}"))
    rows += [
        ("vehicle", header.mjcf.name),
        ("engine", header.engine),
        ("attachments", "\n".join(f"{name}, {len(data) / 1e3:.1f} kB" for name, data in files.items())),
        ("versions", ", ".join(f"{name} {version}" for name, version in header.versions.items())),
    ]
    facts("contents of the log", [(name, printable(value)) for name, value in rows]).show()
    topics = [
        (below(header) + each.name, each.type, each.frame, each.unit, each.meaning) for each in Format(header).topics
    ]
    Listing("topics", ("topic", "type", "frame", "unit", "meaning"), topics, fixed=("topic", "type"), width=60).show()


def print_verdicts(
    title: str, heads: Sequence[str], rows: "Sequence[Row]", cells: "Callable[[Row, str], tuple[str, ...]]"
) -> None:
    """Print claims with their verdicts; ``cells`` gives the cells of a row, from its value as text."""
    from rich.text import Text

    from ..studies.pages import number

    colours = {"holds": "green", "explained": "yellow", "fails": "bold red"}
    shown = []
    for row in rows:
        unit, verdict = "" if row.claim.unit == "1" else f" {row.claim.unit}", row.verdict.name
        shown.append((*cells(row, number(row.measured.value) + unit), Text(verdict, style=colours[verdict])))
    Listing(title, (*heads, "verdict"), shown, fixed=("verdict",), ruled=True).show()


def _run_table(trace: Any, report: dict[str, Any], whose: str = "") -> None:
    from rich.text import Text

    from ..analysis.summary import heading, rows

    table: list[tuple[Any, ...]] = [(name, printable(value)) for name, value in rows(trace, report)]
    if report["status"] == "completed" and not (
        trace.scenario.controller.external or trace.header.measured
    ):  # which can't be repeated
        bars = ("error bars", "uvms-mj converge, with the same scenario and settings")
        table.append(tuple(Text(each, style="dim") for each in bars))
    facts(printable(f"{whose}{heading(report)}"), table).show()
