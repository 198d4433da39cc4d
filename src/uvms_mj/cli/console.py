"""Terminal output: progress and warnings on standard error, results on standard output."""

import contextlib
import json
import sys
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from .common import Stop, printable, progress_bar

if TYPE_CHECKING:
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


@dataclass(frozen=True)
class Table:
    """A table as data: a command prints it, and a page of the reference has it.

    Attributes:
        columns: the heads; none for a table of names and values.
        rows: the cells, as texts or as rich has them.
        notes: texts below the rows.
        right, fixed: the columns that are aligned to the right, and those that do not wrap.
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


def facts(title: str, rows: Iterable[Sequence[Any]], **looks: Any) -> Table:
    """A table of names and values."""
    return Table(title, (), [*rows], width=60, **looks)


def log_tables(path: Any, trace: Any, files: Mapping[str, bytes]) -> None:
    """Print the contents of a log: its rows, attachments, law, versions and topics."""
    from ..records.mcap.layout import Format

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
    topics = [(each.name, each.type, each.frame, each.unit, each.meaning) for each in Format(header).topics]
    Table("topics", ("topic", "type", "frame", "unit", "meaning"), topics, fixed=("topic", "type"), width=60).show()


def print_verdicts(
    title: str, heads: Sequence[str], rows: "Sequence[Row]", cells: "Callable[[Row, str], tuple[str, ...]]"
) -> None:
    """Print claims with their verdicts; ``cells`` gives those of a row, from its value as text."""
    from rich.text import Text

    from ..studies.pages import number

    colours = {"holds": "green", "explained": "yellow", "fails": "bold red"}
    shown = []
    for row in rows:
        unit, verdict = "" if row.claim.unit == "1" else f" {row.claim.unit}", row.verdict.name
        shown.append((*cells(row, number(row.measured.value) + unit), Text(verdict, style=colours[verdict])))
    Table(title, (*heads, "verdict"), shown, fixed=("verdict",), ruled=True).show()


def _run_table(trace: Any, report: dict[str, Any]) -> None:
    from rich.text import Text

    from ..analysis.summary import heading, rows

    table: list[tuple[Any, ...]] = [(name, printable(value)) for name, value in rows(trace, report)]
    if report["status"] == "completed" and not trace.scenario.controller.external:  # which can't be repeated
        bars = ("error bars", "uvms-mj converge, with the same scenario and settings")
        table.append(tuple(Text(each, style="dim") for each in bars))
    facts(printable(heading(report)), table).show()
