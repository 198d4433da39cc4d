"""A law that a log knows by its gains and states alone: it can be shown and compared, and never runs."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..faults import InputError
from ..signals import OWN_UNIT
from .base import Controller, gain


class RecordedLaw(Controller):
    """Base of what stands for a user's law in a trace that was loaded."""


def recorded_law(source: str, table: Mapping[str, Any], states: Mapping[str, int]) -> type[RecordedLaw]:
    """A class with the gains of a ``[controller]`` table.

    Args:
        source: ``file.py:ClassName``.
        table: gains by name, plain numbers, flags and lists of numbers.
        states: names and sizes.

    Raises:
        InputError: a gain is none of these, or has no name that Python allows.
    """
    file, _, label = source.rpartition(":")
    if not file or Path(file).name != file or not label.isidentifier() or not isinstance(table, Mapping):
        raise InputError(f"the law {source!r} is no file.py:ClassName")
    shared = {f.name for f in dataclasses.fields(Controller)} | {"name"}
    fields = []
    for name, value in table.items():
        if name in shared:
            continue
        kind: Any = tuple[float, ...] if isinstance(value, list | tuple) else type(value)
        if not name.isidentifier() or hasattr(Controller, name) or kind not in (bool, int, float, tuple[float, ...]):
            raise InputError(f"the gain controller.{name} = {value!r} of {source} is no number, flag or list")
        default = tuple(value) if isinstance(value, list | tuple) else value
        fields.append((name, kind, gain(default, OWN_UNIT, f"gain of {label}")))
    namespace = {"states": dict(states), "source": classmethod(lambda cls: source), "__doc__": f"{source}, recorded."}
    try:
        return dataclasses.make_dataclass(label, fields, bases=(RecordedLaw,), namespace=namespace, frozen=True)
    except (TypeError, SyntaxError) as error:
        raise InputError(f"the gains of {source}: {error}") from None
