"""A stage of a notebook's cell, written to a file with everything that it uses.

Workers of a study are other processes, and a log keeps the code of a stage as text. Both need the source, which a
class of a cell has in no file that an import could find.
"""

import ast
import builtins
import linecache
import sys
import types
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import InputError
from ..files import parsed
from .base import Stage

_PLAIN = (bool, int, float, complex, str, bytes, type(None))
_MOST_NUMBERS = 10_000
"""Most numbers of an array that is written as text."""


def _definition(node_type: type[ast.stmt], name: str, code: types.CodeType) -> str:
    """The source of a class or of a function by this name, in the cell or file with this code; empty if it is not
    known."""
    lines = linecache.getlines(code.co_filename)
    for node in ast.walk(parsed("".join(lines))):
        if isinstance(node, node_type) and node.name == name:  # type: ignore[attr-defined]  # both kinds have it
            first = min([node.lineno, *(each.lineno for each in node.decorator_list)])  # type: ignore[attr-defined]
            if first <= code.co_firstlineno <= (node.end_lineno or first):
                return "".join(lines[first - 1 : node.end_lineno])
    return ""


def class_source(kind: type[Stage]) -> str:
    """The source of a class that was defined in a cell, from the cell that defines its function. Raises OSError if the
    cell is not known."""
    if source := _definition(ast.ClassDef, kind.__name__, kind.function().__code__):
        return source
    raise OSError("source code not available")


def module_source(kind: type[Stage]) -> str:
    """The text of a file that defines a class of a cell alone: imports, constants and functions that it uses, then the
    class.

    Raises InputError if it uses something that has no such text; the message names it.
    """
    known = vars(sys.modules[kind.__module__])
    found: dict[str, str] = {}
    try:
        _define(kind.__name__, class_source(kind), known, found)
    except OSError:
        raise InputError(f"{kind.__name__}: its source is not available; define it in a cell or in a file") from None
    except _NoText as error:
        raise InputError(f"{kind.__name__} uses {error}, which has no text; define the class in a file") from None
    imports = [text for text in found.values() if text.startswith(("import ", "from "))]
    rest = [text for text in found.values() if text not in imports]
    return "\n".join(sorted(set(imports))) + "\n\n\n" + "\n\n".join(text.rstrip("\n") for text in rest) + "\n"


class _NoText(Exception):
    """A value can't be written as source."""


def _define(name: str, source: str, known: Mapping[str, Any], found: dict[str, str]) -> None:
    """Add the source of a function or a class by its name, after all that it uses from the names of its module."""
    found[name] = ""  # it may use itself
    used = {node.id for node in ast.walk(parsed(source)) if isinstance(node, ast.Name)}
    for each in sorted(used - {name}):
        if each in known and each not in found and not hasattr(builtins, each):
            _add(each, known[each], known, found)
    del found[name]
    found[name] = source


def _add(name: str, value: Any, known: Mapping[str, Any], found: dict[str, str]) -> None:
    if isinstance(value, types.ModuleType):
        found[name] = f"import {value.__name__} as {name}"
        return
    home, own = getattr(value, "__module__", None), getattr(value, "__name__", None)
    if isinstance(home, str) and isinstance(own, str) and home != known.get("__name__"):
        if getattr(sys.modules.get(home), own, None) is not value:
            raise _NoText(name)
        found[name] = f"from {home} import {own} as {name}"
    elif isinstance(value, type) and issubclass(value, Stage):
        _define(name, class_source(value), known, found)
    elif isinstance(value, types.FunctionType):
        if not (source := _definition(ast.FunctionDef, value.__name__, value.__code__)):
            raise _NoText(name)
        _define(name, source, known, found)
    else:
        found[name] = f"{name} = {_text(name, value, found)}"


def _text(name: str, value: Any, found: dict[str, str]) -> str:
    """A constant as source."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "bif" and value.size <= _MOST_NUMBERS:
        found["numpy"] = "import numpy"
        return f"numpy.array({value.tolist()!r}, dtype='{value.dtype}').reshape({value.shape})"
    if isinstance(value, np.generic):
        value = value.item()
    if type(value) in _PLAIN and repr(value) not in ("inf", "-inf", "nan"):
        return repr(value)
    if isinstance(value, tuple | list) and type(value) in (tuple, list):
        parts = ", ".join(_text(name, each, found) for each in value)
        return f"[{parts}]" if isinstance(value, list) else f"({parts}{',' * (len(value) == 1)})"
    raise _NoText(name)
