"""``uvms-mj controllers``, ``keys`` and ``signals``: lists of laws, scenario keys and signals."""

import dataclasses
import json
from typing import TYPE_CHECKING, Any, cast

import click

from .common import bad_input
from .console import print_table, table_of
from .options import command

if TYPE_CHECKING:
    from ..stages.base import Stage


ROOMS = (
    *("guidance", "navigation", "control", "actuation"),
    *("reference", "encoder", "wrist", "observer", "controller", "joints", "thrusters"),
)
"""The rooms, and the tables of a scenario that are called otherwise."""


@command()
@click.argument("laws", nargs=-1, metavar="[LAW]...")
def controllers(laws: tuple[str, ...]) -> None:
    """List the laws with their gains, units and defaults; LAW may be path/to/my_law.py:MyLaw."""
    with bad_input():
        from ..scenario import STAGES

        choice = STAGES["controller"]
        for law in laws or choice.shipped:
            _print_stage(choice.stage_class(law))


@command()
@click.argument("room", required=False, type=click.Choice(ROOMS))
@click.argument("names", nargs=-1, metavar="[STAGE]...")
def stages(room: str | None, names: tuple[str, ...]) -> None:
    """List the stages of all rooms, or of ROOM, with their settings, units, defaults and states; STAGE may be
    path/to/file.py:ClassName."""
    with bad_input():
        from ..control import ImpedanceTask
        from ..scenario import STAGES

        for table, choice in STAGES.items():
            if room in (None, table, choice.base.room.name) and not (names and room in STAGES and room != table):
                if table == "controller" and not names:
                    _print_stage(ImpedanceTask)
                for name in names or choice.shipped:
                    _print_stage(choice.stage_class(name))


def _print_stage(cls: "type[Stage]") -> None:
    room = cls.room
    written = "" if (cls.__doc__ or "").startswith(f"{cls.__name__}(") else cls.__doc__  # not dataclass's own
    summary_line = (written or "").strip().splitlines()
    title = f"{cls.label()}: {summary_line[0] if summary_line else ''}"
    columns = (room.setting, "default", "unit", "meaning")
    table = table_of(title, *columns, caption=f"[{room.table}]", caption_justify="left", min_width=80)
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
