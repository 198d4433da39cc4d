"""``uvms-mj controllers``, ``stages``, ``keys``, ``signals`` and ``metrics``: lists of laws, stages, scenario keys,
signals and metrics."""

import dataclasses
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import click

from .common import bad_input
from .console import print_table, table_of
from .options import command

if TYPE_CHECKING:
    from ..stages.base import Stage
    from ..stages.loader import Choice


@command()
@click.argument("laws", nargs=-1, metavar="[LAW]...")
def controllers(laws: tuple[str, ...]) -> None:
    """List the laws with their gains, units and defaults; LAW may be path/to/my_law.py:MyLaw."""
    with bad_input():
        from ..scenario import STAGES

        choice = STAGES["controller"]
        _print_stages([choice.stage_class(law) for law in laws or choice.shipped])


@command()
@click.argument("names", nargs=-1, metavar="[ROOM] [STAGE]...")
def stages(names: tuple[str, ...]) -> None:
    """List stages with their settings, units, defaults and states: all of them, those of ROOM (guidance, navigation,
    control, actuation, or a table of a scenario), or each STAGE by its name or path/to/file.py:ClassName.

    \b
    uvms-mj stages navigation
    uvms-mj stages gsta t200
    """
    with bad_input():
        from ..scenario import STAGES

        room = next((word for word in names[:1] if word in _rooms()), None)
        choices = [choice for table, choice in STAGES.items() if room in (None, table, choice.base.room.name)]
        if wanted := names[1:] if room else names:
            _print_stages([cls for name in wanted for cls in _named(name, choices, room)])
        else:
            _print_stages([cls for choice in choices for cls in _shipped(choice).values()])


def _rooms() -> set[str]:
    """The names of the rooms, and of the tables of their stages."""
    from ..scenario import STAGES

    return {word for table, choice in STAGES.items() for word in (table, choice.base.room.name)}


def _shipped(choice: "Choice[Any]") -> "dict[str, type[Stage]]":
    """The shipped stages of a table by name; before the laws, the task."""
    from ..control import Controller, ImpedanceTask

    return ({"task": ImpedanceTask} if choice.base is Controller else {}) | dict(choice.shipped)


def _named(name: str, choices: "list[Choice[Any]]", room: str | None) -> "list[type[Stage]]":
    """The stages of a name among these choices, those of a room if one is given. Raises InputError if there is none."""
    from ..errors import InputError, suggestion
    from ..stages.loader import give_one, stages_in, users_stages

    shipped = [_shipped(choice) for choice in choices]
    if found := [cls for stages in shipped for key, cls in stages.items() if name in (key, cls.label())]:
        return found
    file, _, class_name = name.rpartition(":")
    if file.endswith(".py"):
        there = stages_in(file, "")
        of_class = [choice for choice in choices if issubclass(there.get(class_name, object), choice.base)]
        if of_class or room:  # of another room, the choice says so
            return [(of_class or choices)[0].stage_class(name)]
        raise InputError(
            f"no stage {class_name!r} in {file}; {suggestion(class_name, there) if there else 'it has none'}"
        )
    if name.endswith(".py"):
        raise InputError(f"{name!r} names no class; {give_one(name, users_stages(name, ''))}")
    rooms = set() if room or name in _rooms() else _rooms()
    known = {each for stages in shipped for each in stages} | rooms
    hint, own = suggestion(name, known), "for your own give path/to/file.py:ClassName"
    raise InputError(f"no stage {name!r}{f' in {room}' if room else ''}; {hint}; {own}")


def _print_stages(listed: "Sequence[type[Stage]]") -> None:
    """Print a table for each stage, with the name of the scenario's table before the first one of it."""
    table = ""
    for cls in listed:
        if cls.room.table != table:
            click.echo(f"[{cls.room.table}]\n")
        table = cls.room.table
        _print_stage(cls)


def _print_stage(cls: "type[Stage]") -> None:
    room = cls.room
    written = "" if (cls.__doc__ or "").startswith(f"{cls.__name__}(") else cls.__doc__  # not dataclass's own
    summary_line = (written or "").strip().splitlines()
    title = f"{cls.label()}: {summary_line[0] if summary_line else ''}"
    table = table_of(title, room.setting, "default", "unit", "meaning", min_width=80)
    fields, preset_of = _own_settings(cls)
    for field in fields:
        default = "required" if field.default is dataclasses.MISSING else toml_value(field.default)
        table.add_row(field.name, default, field.metadata.get("unit", ""), field.metadata.get("meaning", ""))
    if preset_of:
        table.add_row("", "", "", f"all other settings as in {preset_of}", style="dim")
    if cls.states:
        states = ", ".join(f"{name} ({size})" for name, size in cls.states.items())
        table.add_row("", "", "", f"states: {states}", style="dim")
    print_table(table)
    click.echo()


def _own_settings(cls: "type[Stage]") -> "tuple[list[dataclasses.Field], str]":
    """The settings to list, and for a preset, which has other defaults only, the name of the stage that it derives
    from."""
    from ..stages.base import is_of_the_package

    fields, parent = list(cls.setting_fields()), cast("type[Stage]", cls.__mro__[1])
    if not is_of_the_package(cls) or not is_of_the_package(parent):
        return fields, ""
    before = {field.name: field.default for field in parent.setting_fields()}
    own = [field for field in fields if field.name not in before or before[field.name] != field.default]
    return own, parent.label()


def toml_value(value: Any) -> str:
    if value is None:
        return "-"
    from ..files import plain

    return json.dumps(plain(value))


@command()
def keys() -> None:
    """List all keys of a scenario with defaults and units."""
    from ..scenario import keys as scenario_keys

    title = "Keys of a scenario; `uvms-mj stages` lists the settings of each stage"
    table = table_of(title, "key", "default", "meaning")
    for key, default, meaning in scenario_keys():
        table.add_row(key, toml_value(default), meaning)
    print_table(table)


@command()
def signals() -> None:
    """List the signals that each stage receives and sets, and the signals that a run records."""
    from ..scenario import STAGES
    from ..stages.joint_signals import JOINT_SIGNALS, joints_given
    from ..stages.signals import DELAYED, MEASURED, RECORDED, SCHEDULED, contact_signals, thruster_signal

    of_contacts = {signal.name for signal in contact_signals(0)}
    of_joints = {signal.name for signal in (*JOINT_SIGNALS, *joints_given(0))}
    rooms = [choice.base.room for choice in STAGES.values()]
    inputs = [(f"Inputs of the {room.noun}: {room.arguments[2]}.<name>", room.given(0)) for room in rooms]
    outputs = [
        (f"Outputs of the {room.noun}: {room.arguments[4]}.<name>", room.out) for room in rooms if len(room.out) > 1
    ]
    recorded = (
        "Recorded signals: trace.<name>; the states of the stages are recorded too",
        (*RECORDED, *MEASURED, *SCHEDULED, *DELAYED, *contact_signals(0), thruster_signal(0), *JOINT_SIGNALS),
    )
    for title, listed in (*inputs, *outputs, recorded):
        columns = ("name", "shape", "unit", "frame", "meaning")
        table = table_of(title, *columns, fixed=("name", "shape"), min_width=80)
        for signal in listed:
            counted = (
                "contacts" if signal.name in of_contacts else "joints" if signal.name in of_joints else "thrusters"
            )
            shape = " x ".join(str(length) if length else counted for length in signal.shape)
            table.add_row(signal.name, shape or "scalar", signal.unit, signal.frame, signal.meaning)
        print_table(table)


@command()
@click.argument("words", nargs=-1, metavar="[WORD]...")
def metrics(words: tuple[str, ...]) -> None:
    """List the metrics that a study can keep: all of them, or those with each WORD in their name or meaning.

    They are the names in keep.metrics and [success] of a study, and in [objective] and [[constraint]] of a tuning. A
    metric of your own is path/to/file.py:function.

    \b
    uvms-mj metrics contact
    """
    with bad_input():
        from ..errors import InputError
        from ..studies.plan.metric import MEANINGS, columns_of, unit_of_column

        wanted = [word.lower() for word in words]
        found = {name: said for name, said in MEANINGS.items() if all(w in f"{name} {said}".lower() for w in wanted)}
        if not found:
            raise InputError(f"no metric with {' and '.join(map(repr, words))}; `uvms-mj metrics` lists all of them")
        table = table_of("Metrics of a run", "name", "unit", "meaning", fixed=("name",), min_width=80)
        for name, said in found.items():
            parts = [column.removeprefix(f"{name}.") for column in columns_of(name)]
            table.add_row(name, unit_of_column(name), said + (f"; .{', .'.join(parts)}" if parts != [name] else ""))
        print_table(table)
