"""What a user sees in a terminal: progress and warnings on standard error, results on standard output."""

import contextlib
import json
import sys
from collections.abc import Mapping
from typing import Any

import click


def printable(text: str) -> str:
    """Text in which control characters are spelt out: a name in a log, or of a file, must not steer the terminal."""
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)


class Console:
    """What the user sees: progress and warnings on standard error, the result on standard output."""

    def __init__(self, as_json: bool, quiet: bool) -> None:
        self.as_json, self.quiet = as_json, quiet
        self._out = sys.stdout

    def alone(self) -> contextlib.AbstractContextManager[Any]:
        """Where standard output is for one JSON object, what a law prints goes to standard error."""
        return contextlib.redirect_stdout(sys.stderr) if self.as_json else contextlib.nullcontext()

    def warn(self, message: Any, category: Any, *_: Any, **__: Any) -> None:
        click.echo(f"warning: {printable(str(message))}", err=True)

    def progress(self, scenario: Any) -> Any:
        """A context manager that gives a function of steps done and their number; it draws where somebody looks."""
        if self.quiet or not sys.stderr.isatty():
            return contextlib.nullcontext(lambda done, total: None)
        return _bar(scenario)

    def report(self, trace: Any, report: dict[str, Any]) -> None:
        if self.as_json:
            click.echo(json.dumps(report, allow_nan=False), file=self._out)
        elif not self.quiet:
            _run_table(trace, report)


def _bar(scenario: Any) -> Any:
    import rich.console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    @contextlib.contextmanager
    def bar() -> Any:
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[simulated]:.1f} s simulated"),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=rich.console.Console(stderr=True), transient=True) as progress:
            label = f"{scenario.name} · {scenario.controller.label()}"
            task = progress.add_task(f"{label} · compiling", total=None, simulated=0.0)

            def advance(done: int, total: int) -> None:
                simulated = done * scenario.simulation.timestep
                progress.update(task, description=label, completed=done, total=total, simulated=simulated)

            yield advance

    return bar()


def log_tables(path: Any, trace: Any, files: Mapping[str, bytes]) -> None:
    """What a log holds: its samples, its files, and what made it."""
    from rich.table import Table

    from .mcap_log.layout import Format

    header = trace.header
    table = Table(title="what the log holds", show_header=False, title_justify="left", min_width=60)
    table.add_row("file", f"{printable(str(path))}, {path.stat().st_size / 1e6:.1f} MB")
    rate = 1.0 / (header.row_steps * header.scenario.simulation.timestep)
    table.add_row("rows", f"{len(trace)} at {rate:g} Hz, {trace.t[0]:g} to {trace.t[-1]:g} s" if len(trace) else "0")
    digest = f", sha256 {header.law.sha256}" if header.law.sha256 else ""
    table.add_row("law", printable(f"{header.law.source}{digest}"))
    table.add_row("vehicle", printable(header.mjcf.name))
    attachments = "\n".join(f"{printable(name)}, {len(data) / 1e3:.1f} kB" for name, data in files.items())
    table.add_row("attachments", attachments)
    versions = ", ".join(f"{name} {version}" for name, version in header.versions.items())
    table.add_row("versions", printable(versions))
    print_table(table)
    table = Table(title="topics", title_justify="left", min_width=60)
    for column in ("topic", "type", "frame", "unit", "meaning"):
        table.add_column(column, no_wrap=column in ("topic", "type"))
    for topic in Format(header).topics:
        table.add_row(topic.name, topic.type, topic.frame, topic.unit, topic.meaning)
    print_table(table)


def print_table(table: Any) -> None:
    """A table as wide as the terminal, or 120 columns where there is none; brackets are units, not markup."""
    import rich.console

    rich.console.Console(width=None if sys.stdout.isatty() else 120, markup=False, highlight=False).print(table)


def _run_table(trace: Any, report: dict[str, Any]) -> None:
    from rich.table import Table

    from .control.ideal import TOLD_THE_TRUTH

    contact, final = report["contact"], report["final"]
    table = Table(
        title=printable(f"{report['scenario']} · {report['controller']} · {report['status']}"),
        show_header=False,
        title_justify="left",
        min_width=60,
    )
    some = len(trace) > 0

    def vector(values: Any, form: str) -> str:
        return "  ".join(format(v, form) for v in values).replace("-0.00000", "0.00000")

    if trace.scenario.controller.uses_truth:
        table.add_row("the law is given", TOLD_THE_TRUTH)
    if contact["first_s"] is None:
        table.add_row("contact", "none")
    else:
        table.add_row("first contact", f"{contact['first_s']:.4f} s ({contact['touches']} touches)")
        table.add_row("peak force", f"{contact['peak_N']:.4f} N")
    if contact["final_N"] is not None and contact["first_s"] is not None:
        settled = "settled" if contact["settled"] else "not settled"
        table.add_row("final force", f"{contact['final_N']:.6f} N ({settled})")
    if contact["analytic_N"] is not None:
        table.add_row("analytic force", f"{contact['analytic_N']:.6f} N")
        table.add_row(
            "relative error", f"{contact['relative_error']:.1e}" if contact["relative_error"] is not None else "-"
        )
    elif report["analytic"]["none_because"]:
        table.add_row("analytic force", f"none: {report['analytic']['none_because']}")
    if some:
        table.add_row("final position", f"{vector(final['position_m'], '.5f')} m")
    if report["analytic"]["position_m"]:
        table.add_row("analytic position", f"{vector(report['analytic']['position_m'], '.5f')} m")
    if some:
        table.add_row("final sliding variable", vector(final["s"], ".1e"))
        table.add_row("largest tau", f"{vector(trace.tau_max[-1], '.4g')} N, N m")
        if report["saturated_s"]:
            share = report["saturated_s"] / max(report["duration_s"], 1e-300)
            table.add_row("thrusters at their limits", f"{report['saturated_s']:.4g} s, {share:.2%} of the time")
    factor = report["real_time_factor"]
    if factor:
        step_us = trace.wall_time_s / max(1, trace.steps) * 1e6
        table.add_row(
            "real-time factor",
            f"{factor:.1f} ({report['duration_s']:g} s in {trace.wall_time_s:.2f} s, {step_us:.2f} us a step)",
        )
    table.add_row("files", printable("\n".join(report["files"].values())))
    print_table(table)
