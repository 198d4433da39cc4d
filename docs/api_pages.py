"""Pages of the API: a class is shown as its user makes it, with the type, the meaning and the unit of each setting."""

import dataclasses
import enum
import inspect
import re
import typing
from collections.abc import Iterator
from typing import Any

from sphinx.application import Sphinx
from sphinx.util.rst import escape
from sphinx.util.typing import restify, stringify_annotation


class _Default(str):
    """A default in words of its own."""

    __repr__ = str.__str__


def _signature(app: Sphinx, what: str, name: str, obj: Any, options: Any, args: str, returns: str) -> Any:
    """The fields of a dataclass in the order of its constructor, nothing where a user makes no object of the class, and
    None for any other object."""
    if what in ("class", "exception") and (issubclass(obj, enum.Enum) or typing.Protocol in obj.__bases__):
        return "", ""
    if what not in ("class", "exception") or not dataclasses.is_dataclass(obj):
        return None
    parameters = [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY if field.kw_only else inspect.Parameter.POSITIONAL_OR_KEYWORD,
            default=_default(field),
        )
        for field in _fields(obj)
    ]
    return str(inspect.Signature(parameters)), ""


def _fields(cls: Any) -> list[dataclasses.Field]:
    return sorted((field for field in dataclasses.fields(cls) if field.init), key=lambda field: field.kw_only)


def _default(field: dataclasses.Field) -> Any:
    """A default as it is typed: an object with its own defaults by its class."""
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    if field.default is dataclasses.MISSING:
        return inspect.Parameter.empty
    if dataclasses.is_dataclass(field.default) and field.default == type(field.default)():  # type: ignore[operator]
        return _Default(f"{type(field.default).__name__}()")
    return field.default


def _docstring(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Add a class's base, its settings and the members of an enumeration to its docstring, before its errors."""
    if what not in ("class", "exception"):
        return
    marked = (":raises", ":param", ".. attribute::")
    first = next((i for i, line in enumerate(lines) if line.startswith(marked)), len(lines))
    added = [*_base(obj), *_settings(obj)]
    if issubclass(obj, enum.Enum):
        added += ["", *(f"* ``{each.name}``: {escape(str(each.value))}." for each in obj), ""]
    if added:
        lines[first:first] = [*([""] if first else []), *added]


def _base(cls: type) -> Iterator[str]:
    """The first base with a public name."""
    base = next(each for each in cls.__mro__[1:] if not each.__name__.startswith("_"))
    if base not in (object, enum.Enum, typing.Protocol):
        yield f":Base class: {restify(base, 'smart')}"


def _settings(cls: Any) -> Iterator[str]:
    """The fields of a dataclass that have a meaning. A type is its base: ranges are the validator's matter."""
    fields = [field for field in _fields(cls) if "meaning" in field.metadata] if dataclasses.is_dataclass(cls) else []
    types = typing.get_type_hints(cls) if fields else {}
    for field in fields:
        unit = f" [{field.metadata['unit']}]" if field.metadata.get("unit", "-") != "-" else ""
        yield f":param {field.name}: {_escaped(field.metadata['meaning'] + unit)}."
        yield f":type {field.name}: {stringify_annotation(types[field.name], 'smart')}"


def _escaped(text: str) -> str:
    """Plain text as reStructuredText, with its code and its roles as they are."""
    parts = re.split(r"(``.+?``|:\w+:`[^`]+`)", text)
    return "".join(part if i % 2 else escape(part) for i, part in enumerate(parts))


def _whole(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Keep the first words of an attribute's docstring before Napoleon, which takes words before a colon for a type."""
    if what in ("attribute", "property") and lines:
        lines[:1] = lines[0].split(" ", 1)  # it looks at the first line alone


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("autodoc-process-signature", _signature)
    app.connect("autodoc-process-docstring", _whole, priority=400)
    app.connect("autodoc-process-docstring", _docstring, priority=600)
    return {"parallel_read_safe": False, "parallel_write_safe": False}
