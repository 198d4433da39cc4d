"""Terminal output: progress and warnings on standard error, results on standard output."""

import contextlib
import json
import math
import sys
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from .common import printable, progress_bar
from .stop import Stop

if TYPE_CHECKING:
    from rich.table import Table

    from ..reproduce.paper.claims.base import Row

ROUNDING = 1e-9
"""Numbers smaller than this, relative or in SI units, come from rounding and are shown as zero."""


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
        column = "{task.fields[simulated]:.1f} s simulated"
        shown = progress_bar(f"{label} · compiling", self.quiet, stop, column, simulated=0.0)
        with shown as update:
            h = scenario.simulation.timestep
            yield lambda done, total: update(done, total, description=label, simulated=done * h)

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
    """Print a run in a few lines.

    Peaks and instants depend on the time step and get at most four digits. A force at rest does not depend on it and
    gets the digits that did not change in the final window, at most seven.
    """
    table = facts(printable(f"{report['scenario']} · {report['controller']} · {report['status']}"))
    for name, value in (*_contact_rows(trace, report), *_motion_rows(trace, report), *_run_rows(trace, report)):
        table.add_row(name, value)
    if report["status"] == "completed":
        table.add_row("error bars", "uvms-mj converge, with the same scenario and settings", style="dim")
    print_table(table)


def _contact_rows(trace: Any, report: dict[str, Any]) -> Iterator[tuple[str, str]]:
    from ..control.laws.ideal import TOLD_THE_TRUTH

    contact, status = report["contact"], report["status"]
    if trace.scenario.controller.uses_truth:
        yield "the law is given", TOLD_THE_TRUTH
    if contact["first_s"] is None:
        yield "contact", "none"
    else:
        touches = f"{contact['touches']} touch{'es' if contact['touches'] > 1 else ''}"
        yield "first contact", f"{contact['first_s']:.4g} s ({touches})"
        yield "peak force", f"{contact['peak_N']:.4g} N"
        if contact["settled"]:
            still = (trace.final_high[-1] - trace.final_low[-1]) / (contact["final_N"] or 1.0)
            digits = 1 + math.floor(-math.log10(max(still, 1e-6))) if status == "completed" else 4
            yield "final force", f"{contact['final_N']:.{max(4, digits)}g} N (settled)"
        elif contact["final_N"] is not None:
            rate = contact["trend_N_per_s"]
            settled = "not settled" if status in ("completed", "unstable") else f"{status} before it settled"
            if status == "completed" and rate is not None:
                settled = f"still changes by {rate:.2g} N/s"
            yield "final force", f"{contact['final_N']:.4g} N ({settled})"
    if status == "unstable":
        yield "analytic force", "not compared: the run diverged"
    elif contact["analytic_N"] is not None:
        yield "analytic force", f"{contact['analytic_N']:.7g} N"
    elif report["analytic"]["none_because"]:
        yield "analytic force", f"none: {report['analytic']['none_because']}"
    error = contact["relative_error"]
    if error is not None:
        yield "relative error", f"{error:.1e}" if abs(error) >= ROUNDING else "below 1e-9"
    noise = report["noise"]
    if noise["push_N"] is not None:
        yield "deviation of the push", f"{noise['push_N']:.3g} N"
        analytic_N, reason = noise["analytic_N"], noise["none_because"]
        yield "analytic deviation", f"{analytic_N:.4g} N" if reason is None else f"none: {reason}"


def _motion_rows(trace: Any, report: dict[str, Any]) -> Iterator[tuple[str, str]]:
    final, analytic_m = report["final"], report["analytic"]["position_m"]
    if len(trace):
        yield "final position", f"{_vector(final['position_m'], 5)} m"
        recorded = {signal.name for signal in trace.signals}
        if "p_WT" in recorded:
            yield "final position, tool", f"{_vector(trace.p_WT[-1], 5)} m"
        if "q" in recorded:
            yield "final joints", f"{_vector(trace.q[-1], 4)} rad or m"
    yield from _joint_rows(trace, report)
    if analytic_m and report["status"] != "unstable":
        yield "analytic position", f"{_vector(analytic_m, 5)} m"
    if len(trace):
        if final["s"]:
            yield "final sliding variable", " ".join(f"{value: .1e}" for value in final["s"])
        yield "largest tau", f"{'  '.join(f'{value:#.3g}' for value in trace.tau_max[-1])} N, N m"


def _joint_rows(trace: Any, report: dict[str, Any]) -> Iterator[tuple[str, str]]:
    header = trace.header
    for name, found, by, signal in (
        ("joints off their target", report["joints_off_target"], "by ", trace.scenario.joints.tracked_signal),
        ("joints at their stops", report["joints_at_stops"], "", "q"),
    ):
        if found:
            of = header.by_name[signal]
            units = dict(zip(header.components(of), header.units(of), strict=True))
            each = (f"{joint} {by}{round(value, 4) + 0.0:.4g} {units[joint]}" for joint, value in found.items())
            yield name, printable(", ".join(each))


def _run_rows(trace: Any, report: dict[str, Any]) -> Iterator[tuple[str, str]]:
    if report["saturated_s"]:
        share = report["saturated_s"] / max(report["duration_s"], 1e-300)
        yield "thrusters at their limits", f"{report['saturated_s']:.4g} s, {share:.2%} of the time"
    joints = report["saturated_joints_s"] or {}
    if any(joints.values()):
        shares = (f"{name} {time / report['duration_s']:.2%}" for name, time in joints.items() if time)
        yield "motors at their limits", f"{printable(', '.join(shares))} of the time"
    factor = report["real_time_factor"]
    if factor:
        step_us = trace.wall_time_s / max(1, trace.steps) * 1e6
        wall_time = f"{report['duration_s']:g} s in {trace.wall_time_s:.2f} s, {step_us:.2f} us a step"
        yield "real-time factor", f"{factor:.1f} ({wall_time})"
    yield "files", printable("\n".join(report["files"].values()))


def _vector(values: Any, decimals: int) -> str:
    """Numbers of equal width, so that the columns of two lines are aligned; zero has no sign."""
    return " ".join(f"{round(float(value), decimals) + 0.0: .{decimals}f}" for value in values)
