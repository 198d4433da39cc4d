"""Placeholder for a user's stage in a loaded log. It has settings and states; it can be shown and compared, not run."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from ..errors import InputError
from .base import Stage, setting
from .signals import OWN_UNIT

_Stage = TypeVar("_Stage", bound=Stage)


class Recorded:
    """Base of the placeholders for a user's stage in a loaded trace."""


def recorded_stage(
    base: type[_Stage], source: str, table: Mapping[str, Any], states: Mapping[str, Any]
) -> type[_Stage]:
    """Make a placeholder class with the settings of a table of a scenario, and the sizes of its states by name. Raises
    InputError if a setting has another type, or its name is not a Python identifier."""
    room = base.room
    file, _, label = source.rpartition(":")
    if not file or Path(file).name != file or not label.isidentifier() or not isinstance(table, Mapping):
        raise InputError(f"the {room.noun} is {source!r}: must be file.py:ClassName")
    shared = {f.name for f in dataclasses.fields(base)} | {"name", *room.reserved}
    fields = []
    for name, value in table.items():
        if name in shared:
            continue
        kind: Any = tuple[float, ...] if isinstance(value, list | tuple) else type(value)
        if not name.isidentifier() or hasattr(base, name) or kind not in (bool, int, float, tuple[float, ...]):
            wanted = "is not a number, a flag or a list of numbers"
            raise InputError(f"the {room.setting} {room.table}.{name} = {value!r} of {source} {wanted}")
        default = tuple(value) if isinstance(value, list | tuple) else value
        fields.append((name, kind, setting(default, OWN_UNIT, f"{room.setting} of {label}")))
    namespace = {"states": dict(states), "source": classmethod(lambda cls: source), "__doc__": f"{source}, recorded."}
    try:
        return dataclasses.make_dataclass(label, fields, bases=(Recorded, base), namespace=namespace, frozen=True)
    except (TypeError, SyntaxError) as error:
        raise InputError(f"the {room.setting}s of {source}: {error}") from None
