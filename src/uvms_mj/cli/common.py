"""Shared parts of the commands: options, exit status, messages for bad input, a progress bar."""

import contextlib
import functools
import logging
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from .stop import Stop, exit_interrupted

if TYPE_CHECKING:
    from ..records.trace import Trace

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
    *("-s", "--set", "settings"),
    multiple=True,
    metavar="KEY=VALUE",
    help="Set a key of the scenario; may be repeated. Where it names another stage or law, the settings of the "
    "scenario's own one are left out, and a warning names them.",
)
json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object on standard output and nothing else."
)
_quiet_option = click.option("-q", "--quiet", is_flag=True, help="Print no progress bar and no table.")


def _named(context: click.Context, option: click.Parameter, value: Any) -> Any:
    if value == "" or (isinstance(value, tuple) and "" in value):
        raise click.BadParameter("must not be empty")
    return value


path_argument = functools.partial(click.argument, callback=_named)
path_option = functools.partial(click.option, callback=_named)
"""An argument and an option with the path of a file or folder; it must not be empty."""

_LAWS = "gsta, sta, fosm, impedance, ideal, or path/to/my_law.py:MyLaw."


def run_options(from_help: str, laws: str = _LAWS) -> Callable[[Any], Any]:
    """The options of all commands that run one scenario, as ``arguments``, ``controller``, ``settings`` and ``log``:
    effect of ``--from LOG``, choices of ``--controller``."""
    law_option = click.option("-c", "--controller", metavar="LAW", help=laws)
    from_option = path_option("--from", "log", metavar="LOG", help=from_help)
    return lambda function: scenario_argument(law_option(set_option(from_option(function))))


def output_options(function: Any) -> Any:
    """The options ``--json`` and ``--quiet``."""
    return json_option(_quiet_option(function))


force_option = click.option("-f", "--force", is_flag=True, help="Replace FILE if it exists.")


def refuse_existing(option: str, path: Path, force: bool) -> None:
    """Raise InputError if the path exists and ``force`` is not set."""
    from ..errors import InputError

    if os.path.lexists(path) and not force:
        raise InputError(f"{option} {path}: exists; choose another name, or replace it with --force")


def asked_for(
    arguments: Sequence[str], settings: Sequence[str], noun: str = "scenario"
) -> tuple[str | None, dict[str, Any]]:
    """The name of the scenario, if one is given, and the settings by key. Raises InputError if several are named, or a
    setting is not valid. ``noun`` is the word for a scenario in messages."""
    from ..errors import InputError
    from ..files import parse_setting

    names = [a for a in arguments if "=" not in a]
    if "" in names:
        raise InputError(f"the name of a {noun} must not be empty")
    if len(names) > 1:
        raise InputError(f"one {noun} at a time, please: {', '.join(names)}")
    overrides: dict[str, Any] = {}
    for key, value in map(parse_setting, (*settings, *(a for a in arguments if "=" in a))):
        if key in overrides and overrides[key] != value:
            raise InputError(f"--set {key}: is given twice, {overrides[key]!r} and {value!r}")
        overrides[key] = value
    return (names[0] if names else None), overrides


def draw_to_files() -> None:
    """Make matplotlib draw to files only, whatever window system is set, and hide its warnings, such as those about its
    cache. Call this before matplotlib is imported."""
    os.environ["MPLBACKEND"] = "agg"
    logging.getLogger("matplotlib").setLevel(logging.ERROR)


@contextlib.contextmanager
def progress_bar(
    what: str, hidden: bool, stop: Stop, column: str | None = None, **fields: Any
) -> Iterator[Callable[..., None]]:
    """A progress bar on terminals, with the share done or another column beside it, which shows ``fields``. Yields a
    function of the counts done and in total, and of fields of the task such as its description. The function also
    checks for signals."""
    if hidden or not sys.stderr.isatty():
        yield lambda *counts, **fields: stop.check()
        return
    import rich.console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TimeRemainingColumn

    columns = ("{task.description}", BarColumn(), column or TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=rich.console.Console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None, **fields)

        def advance(done: int, total: int, **fields: Any) -> None:
            stop.check()
            progress.update(task, completed=done, total=total, **fields)

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
