"""``uvms-mj controllers``, ``keys`` and ``signals``: lists of laws, scenario keys and signals."""

import dataclasses

import click

from .common import bad_input, command, toml_value
from .console import print_table


@command()
@click.argument("laws", nargs=-1, metavar="[LAW]...")
def controllers(laws: tuple[str, ...]) -> None:
    """List the laws with their gains, units and defaults; LAW may be path/to/my_law.py:MyLaw."""
    with bad_input():
        from rich.table import Table

        from ..control.loader import BUILT_IN, controller_class

        for law in laws or BUILT_IN:
            cls = controller_class(law)
            written = "" if (cls.__doc__ or "").startswith(f"{cls.__name__}(") else cls.__doc__  # not dataclass's own
            summary_line = (written or "").strip().splitlines()
            table = Table(
                title=f"{cls.label()}: {summary_line[0] if summary_line else ''}", title_justify="left", min_width=80
            )
            for column in ("gain", "default", "unit", "meaning"):
                table.add_column(column)
            for field in cls.gain_fields():
                default = "required" if field.default is dataclasses.MISSING else toml_value(field.default)
                table.add_row(field.name, default, field.metadata.get("unit", ""), field.metadata.get("meaning", ""))
            if cls.states:
                states = ", ".join(f"{name} ({size})" for name, size in cls.states.items())
                table.add_row("", "", "", f"states: {states}", style="dim")
            print_table(table)


@command()
def keys() -> None:
    """List all keys of a scenario with defaults and units."""
    from rich.table import Table

    from ..scenario import keys as scenario_keys

    table = Table(title="Keys of a scenario; `uvms-mj controllers` lists the gains of each law", title_justify="left")
    for column in ("key", "default", "meaning"):
        table.add_column(column)
    for key, default, meaning in scenario_keys():
        table.add_row(key, toml_value(default), meaning)
    print_table(table)


@command()
def signals() -> None:
    """List the signals that a law receives and the signals that a run records."""
    from rich.table import Table

    from ..stages.signals import GIVEN, RECORDED, thruster_signal

    recorded = (*RECORDED, thruster_signal(0))
    for title, listed in (
        ("Inputs of a law: signals.<name>", GIVEN),
        ("Recorded signals: trace.<name>; the states of the law are recorded too", recorded),
    ):
        table = Table(title=title, title_justify="left", min_width=80)
        for column in ("name", "shape", "unit", "frame", "meaning"):
            table.add_column(column, no_wrap=column in ("name", "shape"))
        for signal in listed:
            shape = " x ".join(map(str, signal.shape)) if signal.size else "thrusters"
            table.add_row(signal.name, shape or "scalar", signal.unit, signal.frame, signal.meaning)
        print_table(table)
