"""Presets of the sensors from ``presets.toml``, which has their sources: classes with other defaults."""

from __future__ import annotations

import dataclasses
import inspect
import tomllib
from pathlib import Path
from typing import Any

from .sensors import Sensors


def preset(name: str, about: str, source: str, **defaults: Any) -> type[Sensors]:
    """Sensors with other defaults, under a name of their own."""
    fields = {field.name: field for field in dataclasses.fields(Sensors)}
    changed = []
    for key, value in defaults.items():
        default = tuple(value) if isinstance(value, list) else value
        changed.append((key, fields[key].type, dataclasses.field(default=default, metadata=fields[key].metadata)))
    doc = f"{about}\n\n{inspect.cleandoc(source)}"
    class_name = "".join(word.capitalize() for word in name.split("_"))
    namespace = {"name": name, "__doc__": doc, "__module__": __name__}
    return dataclasses.make_dataclass(class_name, changed, bases=(Sensors,), namespace=namespace, frozen=True)


_TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
PRESETS: tuple[type[Sensors], ...] = tuple(preset(name, **table) for name, table in _TABLES.items())
"""All presets."""
globals().update({cls.__name__: cls for cls in PRESETS})  # where pickle looks for them
