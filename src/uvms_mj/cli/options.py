"""Options and arguments that several commands have."""

import contextlib
import functools
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import click

from .common import warn


class _Command(click.Command):
    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Refuse an option that is given twice; click would silently take the last."""
        _, _, given = self.make_parser(ctx).parse_args(args=list(args))
        for each in given:
            if isinstance(each, click.Option) and not (each.multiple or each.is_flag) and given.count(each) > 1:
                raise click.UsageError(f"{max(each.opts, key=len)} is given more than once; give it once", ctx)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Print each warning as one line."""
        with warnings.catch_warnings():
            warnings.showwarning = warn  # Python's own hook; catch_warnings restores it
            return super().invoke(ctx)


command = functools.partial(click.command, cls=_Command)


class OneOrNone(click.Group):
    """A group whose command ``otherwise`` is meant where the first word is no command of the group."""

    otherwise: click.Command

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> click.Context:
        if args and args[0] in self.commands:
            return super().make_context(info_name, args, parent, **extra)
        return self.otherwise.make_context(info_name, args, parent, **extra)


scenario_argument = click.argument("arguments", nargs=-1, metavar="[SCENARIO] [KEY=VALUE]...")
set_option = click.option(
    *("-s", "--set", "settings"),
    multiple=True,
    metavar="KEY=VALUE",
    help="Set a key of the scenario; may be repeated. Where it names another stage or law, the settings of the "
    "scenario's own one are left out, and a warning names them.",
)


def _reserve(context: click.Context, option: click.Parameter, value: bool) -> bool:
    """Reserve standard output for JSON: what machine code of the user's prints goes to standard error."""
    with contextlib.suppress(OSError, AttributeError, ValueError):  # standard output is no file
        if value and not context.resilient_parsing and sys.stdout.fileno() == 1:
            sys.stdout.flush()
            sys.stdout = os.fdopen(os.dup(1), "w", encoding=sys.stdout.encoding, errors=sys.stdout.errors)
            os.dup2(2, 1)
    return value


json_option = click.option(
    "--json",
    "as_json",
    is_flag=True,
    callback=_reserve,
    help="Print one JSON object on standard output and nothing else.",
)
_quiet_option = click.option("-q", "--quiet", is_flag=True, help="Print no progress bar and no table.")


def _named(context: click.Context, option: click.Parameter, value: Any) -> Any:
    if value == "" or (isinstance(value, tuple) and "" in value):
        raise click.BadParameter("must not be empty")
    return value


path_argument = functools.partial(click.argument, callback=_named)
path_option = functools.partial(click.option, callback=_named)
"""An argument and an option with the path of a file or folder; it must not be empty."""

_LAWS = (
    "gsta, sta, fosm, impedance, pid, admittance, parallel, dob_impedance, aismc, ideal, ideal_admittance, "
    "ideal_parallel, none, udp for a law in another program, or your own: my_law.py:MyLaw, my_law.c, "
    "libmy_law.so:my_law or my_law.fmu."
)


def run_options(from_help: str, laws: str = _LAWS) -> Callable[[Any], Any]:
    """The options of all commands that run one scenario, as ``arguments``, ``controller``, ``settings`` and ``log``:
    effect of ``--from LOG``, choices of ``--controller``."""
    law_option = click.option("-c", "--controller", metavar="LAW", help=laws)
    from_option = path_option("--from", "log", metavar="LOG", help=from_help)
    return lambda function: scenario_argument(law_option(set_option(from_option(function))))


def output_options(function: Any) -> Any:
    """The options ``--json`` and ``--quiet``."""
    return json_option(_quiet_option(function))


workers_option = click.option(
    "-j", "--workers", type=click.IntRange(1, 4096), metavar="N", help="Processes [default: one per core]."
)
force_option = click.option("-f", "--force", is_flag=True, help="Replace FILE if it exists.")


def names_in(option: str, words: Sequence[str]) -> list[str]:
    """The names in the words of an option, which may be separated by commas. Raises InputError for an empty one."""
    from ..errors import InputError

    names = [name.strip() for word in words for name in word.split(",")]
    if "" in names:
        raise InputError(f"{option} {','.join(words)}: a name is empty; write NAME or NAME,NAME")
    return names


def number(option: str, text: str, unit: str, low: float, high: float) -> float:
    """The number of an option's text. Raises InputError if it is none, or out of range."""
    from ..errors import InputError, number_hint

    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{option} {text!r}: is not a finite number{number_hint(text, unit)}") from None
    if not low <= value <= high:
        raise InputError(f"{option} {text}: must be from {low:g} to {high:g} {unit}")
    return value


def set_by_option(overrides: dict[str, Any], key: str, value: Any, option: str) -> None:
    """Set a key that has an option of its own, unless ``value`` is None. Raises InputError if it is also set to another
    value."""
    from ..errors import InputError

    if value is not None and overrides.setdefault(key, value) != value:
        raise InputError(f"{key}: is given twice, {overrides[key]!r} and {option} {value}")


def asked_for(
    arguments: Sequence[str], settings: Sequence[str], noun: str = "scenario"
) -> tuple[str | None, dict[str, Any]]:
    """The name of the scenario, if one is given, and the settings by key. Raises InputError if several are named, or a
    setting is not valid. ``noun`` is the word for a scenario in messages."""
    from ..errors import InputError
    from ..files import parse_setting
    from ..scenario import keys
    from ..stages.foreign import parted

    names = [a for a in arguments if "=" not in a]
    if "" in names:
        raise InputError(f"the name of a {noun} must not be empty")
    if keys_given := {key for key, *_ in keys()} & set(names):
        key = min(keys_given)
        raise InputError(f"{key}: is a key, not the name of a {noun}; give its value in the same word, {key}=VALUE")
    if len(names) > 1:
        raise InputError(f"one {noun} at a time, please: {', '.join(names)}")
    if names and parted(names[0])[0]:
        raise InputError(_not_code(names[0], noun))
    overrides: dict[str, Any] = {}
    for key, value in map(parse_setting, (*settings, *(a for a in arguments if "=" in a))):
        if key in overrides and overrides[key] != value:
            raise InputError(f"--set {key}: is given twice, {overrides[key]!r} and {value!r}")
        overrides[key] = value
    return (names[0] if names else None), overrides


def _not_code(name: str, noun: str) -> str:
    """The error of ``file.py``, ``file.py:Class`` or ``file.c`` in place of a scenario. Raises InputError if the file
    can't be loaded."""
    from ..stages.foreign import parted
    from ..stages.loader import users_stages

    file, class_name = parted(name)
    what = "Python" if file.endswith(".py") else "code"
    if noun != "scenario":
        return f"{name}: is {what}, not a {noun}"
    stages = users_stages(file, "", class_name)
    if class_name in stages:
        stages = {class_name: stages[class_name]}
    options = {name: f"--set {cls.room.table}.name=" for name, cls in stages.items()}
    uses = [f"{option.replace('--set controller.name=', '--controller ')}{file}:{n}" for n, option in options.items()]
    what = (
        f"a {stages[class_name].room.noun}"
        if class_name in stages
        else "a Python file"
        if what == "Python"
        else "a file of code"
    )
    return f"{name}: is {what}, not a scenario" + (f": use {' or '.join(uses)}" if uses else "")
