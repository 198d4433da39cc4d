"""Placeholder for a user's law in a loaded log. It has gains and states, and can be shown and compared but not run."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..stages.signals import OWN_UNIT
from .base import Controller, gain


class RecordedLaw(Controller):
    """Base of the placeholders for a user's law in a loaded trace."""


def recorded_law(source: str, table: Mapping[str, Any], states: Mapping[str, int]) -> type[RecordedLaw]:
    """Make a placeholder class with the gains of a ``[controller]`` table.

    Args:
        source: ``file.py:ClassName``.
        table: gains by name: numbers, flags and lists of numbers.
        states: sizes of the states by name.

    Raises:
        InputError: a gain has another type, or its name is not a Python identifier.
    """
    file, _, label = source.rpartition(":")
    if not file or Path(file).name != file or not label.isidentifier() or not isinstance(table, Mapping):
        raise InputError(f"the law is {source!r}: must be file.py:ClassName")
    shared = {f.name for f in dataclasses.fields(Controller)} | {"name"}
    fields = []
    for name, value in table.items():
        if name in shared:
            continue
        kind: Any = tuple[float, ...] if isinstance(value, list | tuple) else type(value)
        if not name.isidentifier() or hasattr(Controller, name) or kind not in (bool, int, float, tuple[float, ...]):
            raise InputError(
                f"the gain controller.{name} = {value!r} of {source} is not a number, a flag or a list of numbers"
            )
        default = tuple(value) if isinstance(value, list | tuple) else value
        fields.append((name, kind, gain(default, OWN_UNIT, f"gain of {label}")))
    namespace = {"states": dict(states), "source": classmethod(lambda cls: source), "__doc__": f"{source}, recorded."}
    try:
        return dataclasses.make_dataclass(label, fields, bases=(RecordedLaw,), namespace=namespace, frozen=True)
    except (TypeError, SyntaxError) as error:
        raise InputError(f"the gains of {source}: {error}") from None
