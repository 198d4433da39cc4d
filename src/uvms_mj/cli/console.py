"""Terminal output: progress and warnings on standard error, results on standard output."""

import contextlib
import json
import sys
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from .common import printable, progress_bar
from .stop import Stop

if TYPE_CHECKING:
    from rich.table import Table

    from ..reproduce.claims import Row


def warn(message: object, *_: Any, **__: Any) -> None:
    """Print a warning as one line. The further arguments are those that Python gives its hook for warnings."""
    click.echo(f"warning: {printable(str(message))}", err=True)


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
        label = f"{scenario.name} · {scenario.controller.label()}"
        shown = progress_bar(f"{label} · compiling", self.quiet, stop, "{simulated:.1f} s simulated", simulated=0.0)
        with shown as update:
            h = scenario.simulation.timestep
            yield lambda done, total: update(done, total, what=label, simulated=done * h)

    def report(self, trace: Any, report: dict[str, Any]) -> None:
        if self.as_json:
            click.echo(json.dumps(report, allow_nan=False), file=self._out)
        elif not self.quiet:
            _run_table(trace, report)


def log_tables(path: Any, trace: Any, files: Mapping[str, bytes]) -> None:
    """Print the contents of a log: its rows, attachments, law, versions and topics."""
    from ..records.mcap.layout import Format

    header = trace.header
    table = facts("contents of the log")
    table.add_row("file", f"{printable(str(path))}, {path.stat().st_size / 1e6:.1f} MB")
    rate = 1.0 / (header.row_steps * header.scenario.simulation.timestep)
    table.add_row("rows", f"{len(trace)} at {rate:g} Hz, {trace.t[0]:g} to {trace.t[-1]:g} s" if len(trace) else "0")
    for name, stage in header.sources.items():
        if stage.sha256 or name == "controller":
            digest = f", sha256 {stage.sha256}" if stage.sha256 else ""
            table.add_row("law" if name == "controller" else name, printable(f"{stage.source}{digest}"))
    table.add_row("vehicle", printable(header.mjcf.name))
    table.add_row("engine", printable(header.engine))
    attached = "\n".join(f"{name}, {len(data) / 1e3:.1f} kB" for name, data in files.items())
    table.add_row("attachments", printable(attached))
    table.add_row("versions", printable(", ".join(f"{name} {version}" for name, version in header.versions.items())))
    print_table(table)
    columns = ("topic", "type", "frame", "unit", "meaning")
    table = table_of("topics", *columns, fixed=("topic", "type"), min_width=60)
    for topic in Format(header).topics:
        table.add_row(topic.name, topic.type, topic.frame, topic.unit, topic.meaning)
    print_table(table)


def table_of(title: str, *columns: str, fixed: Container[str] = (), **look: Any) -> "Table":
    """An empty table; columns in ``fixed`` do not wrap."""
    from rich.table import Column, Table

    return Table(*(Column(each, no_wrap=each in fixed) for each in columns), title=title, title_justify="left", **look)


def facts(title: str) -> "Table":
    """An empty table of names and values."""
    return table_of(title, show_header=False, min_width=60)


def print_table(table: Any) -> None:
    """Print a table as wide as the terminal, or 120 columns without one. Brackets are units, not markup."""
    import rich.console

    rich.console.Console(width=None if sys.stdout.isatty() else 120, markup=False, highlight=False).print(table)


def print_verdicts(
    title: str, heads: Sequence[str], rows: "Sequence[Row]", cells: "Callable[[Row, str], tuple[str, ...]]"
) -> None:
    """Print claims with their verdicts; ``cells`` gives those of a row, from its value as text."""
    from rich.text import Text

    from ..studies.pages import number

    colours = {"holds": "green", "explained": "yellow", "fails": "bold red"}
    table = table_of(title, show_lines=True)
    for head in (*heads, "verdict"):
        table.add_column(head, no_wrap=head == "verdict", overflow="fold")
    for row in rows:
        unit, verdict = "" if row.claim.unit == "1" else f" {row.claim.unit}", row.verdict.name
        table.add_row(*cells(row, number(row.measured.value) + unit), Text(verdict, style=colours[verdict]))
    print_table(table)


def _run_table(trace: Any, report: dict[str, Any]) -> None:
    from ..analysis.run_table import heading, rows

    table = facts(printable(heading(report)))
    for name, value in rows(trace, report):
        table.add_row(name, printable(value))
    if report["status"] == "completed":
        table.add_row("error bars", "uvms-mj converge, with the same scenario and settings", style="dim")
    print_table(table)
