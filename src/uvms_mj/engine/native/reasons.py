"""Numba's reasons for not compiling a user's stage, in the words and with the line of the user's function."""

import ast
import inspect
import re
import textwrap
import types
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ...files import parsed

_NAME = re.compile(r"NameError: name '(\w+)' is not defined")
_COPY = re.compile(r"Function\(<built-in function array>\).* array\((nestedarray|array)\(")


def in_users_words(reason: str, function: types.FunctionType, arguments: Sequence[np.dtype]) -> str:
    """The reason for which numba can't compile a stage's function, with what is to write instead where that is known.

    ``arguments`` are the dtypes of the function's arguments.
    """
    if _COPY.search(reason):
        return f"{reason}; in the function a tuple is an array already, and x.copy() copies an array"
    if (found := _NAME.match(reason)) is not None:
        uses = (node.lineno for node in _nodes(function) if isinstance(node, ast.Name) and node.id == found[1])
        return f"{found[0]}{_place(function, next(uses, 0))}"
    if reason.startswith(("Cannot cast", "AssertionError")):
        return next(_whole_arrays(function, arguments), reason)
    return reason


def _whole_arrays(function: types.FunctionType, arguments: Sequence[np.dtype]) -> Iterator[str]:
    """A sentence for each assignment to a whole array of a record, ``state.xi = ...``, which numba does not know."""
    names = function.__code__.co_varnames
    shapes = {
        (argument, word): dtype[word].shape
        for argument, dtype in zip(names, arguments, strict=False)
        for word in dtype.names or ()
    }
    for node in _nodes(function):
        for target in node.targets if isinstance(node, ast.Assign) else ():
            match target:
                case ast.Attribute(ast.Name(record), word) if shape := shapes.get((record, word)):
                    field, place = f"{record}.{word}", _place(function, node.lineno)
                    yield f"{field} is an array: write {field}[{'0' if shape == (1,) else ':'}] = ...{place}"


def _nodes(function: types.FunctionType) -> list[ast.stmt | ast.expr]:
    """The statements and expressions of a function's source in the order of its lines. One typed at a prompt has no
    source, and none of them."""
    try:
        tree = parsed(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError):
        return []
    found = [node for node in ast.walk(tree) if isinstance(node, ast.stmt | ast.expr)]
    return sorted(found, key=lambda node: node.lineno)


def _place(function: types.FunctionType, line: int) -> str:
    """The file and the line, counted from that of ``def``; empty for line 0."""
    code = function.__code__
    return f" ({Path(code.co_filename).name}, line {code.co_firstlineno + line - 1})" if line else ""
