"""Calls of functions of the language: which function has which writer, and how its arguments are read.

Arguments are bound by the names and the order that NumPy itself gives them; whatever a writer does not take is a lack.
"""

from __future__ import annotations  # the binding of arguments reads the names of types

import ast
import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from .arrays import Arrays
from .values import BOOL, FLOAT, INT, Value, items_of, scalar, shown

Writer = Callable[["Arrays", Sequence[ast.expr], Mapping[str, ast.expr]], "Value | None"]
FUNCTIONS: dict[Any, Writer] = {}
"""Functions that write the code of a call, by the function that is called."""
METHODS: dict[str, Any] = {}
"""NumPy's function for a method of an array, whose first argument is the array."""
PROPERTIES: dict[str, Callable[[Arrays, Value], Value]] = {}
"""Functions that write the code of an attribute of an array."""

# An argument is read by the annotation of its parameter.
Node = ast.expr  # as it is
Array = Value  # of a tuple, the array of its items
Floats = Value  # an array or a number, of floats
Square = Value  # a square matrix of floats
Parts = list[Value]  # the arrays of a tuple
Whole = int  # an integer that is known when compiling
Flag = bool  # True or False
Known = Any  # whatever Python has, if it is known when compiling
Sizes = tuple[int, ...]
Type = np.dtype


def entry(*functions: Any, method: str = "") -> Callable[[Callable], Callable]:
    """Mark what writes the code of a call of these functions; of a method, too, the first one's.

    Its parameters are the call's, with NumPy's names, after ``at``, which writes. One that has a default may be
    left out, or None.
    """

    def mark(writer: Callable) -> Callable:
        parameters = [*inspect.signature(writer).parameters.values()][1:]
        FUNCTIONS.update({each: _bound(writer, parameters, each) for each in functions})
        if method:
            METHODS[method] = functions[0]
        return writer

    return mark


def _bound(writer: Callable, parameters: Sequence[inspect.Parameter], function: Any) -> Writer:
    """The writer of a call from one that takes these arguments by their names, each read as its annotation says."""
    names = {each.name: each for each in parameters if each.kind is not each.VAR_POSITIONAL}
    read = {each.name: _READ[each.annotation.removesuffix(" | None")] for each in parameters}
    further = next((each.name for each in parameters if each.kind is each.VAR_POSITIONAL), "")

    def write(at: Arrays, nodes: Sequence[ast.expr], keywords: Mapping[str, ast.expr]) -> Value | None:
        known = given_names(function)
        if further or not set(names) <= set(known):
            known = names
        order = [name for name, each in known.items() if each.kind is not each.KEYWORD_ONLY]
        if len(nodes) > len(order) and not further:
            at.lack(f"it takes at most {len(order)} arguments here, not {len(nodes)}")
        found = dict(zip(order, nodes, strict=False))
        for name, node in keywords.items():
            if name in found:
                at.mistake(f"argument {name} is given twice")
            found[name] = node
        for name, node in found.items():
            usual = isinstance(node, ast.Constant) and name in known and node.value is known[name].default
            if name not in names and not usual:
                at.lack(f"the language has no argument {name} here")
        values = []
        for name, parameter in names.items():
            given = found.get(name)
            if parameter.default is not parameter.empty and (given is None or _is_none(given)):
                if given is not None and parameter.default is not None:
                    at.lack(f"the language has no {name}=None here")
                values.append(parameter.default)
            else:
                values.append(read[name](at, given if given is not None else at.lack(f"argument {name} is missing")))
        return called(writer, at, values, [read[further](at, node) for node in nodes[len(order) :]])

    def called(writer: Callable, at: Arrays, values: list[Any], rest: list[Any]) -> Value | None:
        by_name = [each.name for each in names.values() if each.kind is each.KEYWORD_ONLY]
        named = dict(zip(by_name, values[len(values) - len(by_name) :], strict=True))
        return writer(at, *values[: len(values) - len(by_name)], *rest, **named)

    return write


@cache
def given_names(function: Any) -> dict[str, inspect.Parameter]:
    """The parameters of a function of NumPy's; nothing of one that is another's, or that doesn't say so."""
    if isinstance(function, np.ufunc | type | str) or not getattr(function, "__module__", "").startswith("numpy"):
        return {}
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return {}
    if any(each.kind is each.VAR_POSITIONAL for each in parameters):
        return {}
    return {each.name: each for each in parameters if each.kind is not each.VAR_KEYWORD}


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _floats(at: Arrays, value: Value) -> Value:
    return at.elementwise(lambda each: scalar(at.float_of(each), FLOAT), value)


def _square(at: Arrays, node: ast.expr) -> Value:
    value = at.as_array(at.value(node))
    shape = at.shape_of(value)
    if len(shape) != 2 or shape[0] != shape[1]:
        at.mistake(f"a square matrix is needed here, not shape {shown(shape)}")
    return value if value.kind.base == FLOAT else _floats(at, value)


def _parts(at: Arrays, node: ast.expr) -> list[Value]:
    value = at.value(node)
    if value.kind.items is None:
        at.lack("a tuple of arrays is needed here")
    return [at.as_array(item) for item in items_of(value)]


def _sizes(at: Arrays, *nodes: ast.expr) -> tuple[int, ...]:
    """The sizes of a shape, given one by one or as a tuple."""
    values = [at.value(node) for node in nodes]
    if len(values) == 1 and values[0].kind.items is not None:
        values = items_of(values[0])
    if any(value.constant is None or value.kind.base != INT for value in values):
        at.needs_constant("the shape of an array")
    return tuple(int(value.constant) for value in values)


def _shape(at: Arrays, node: ast.expr) -> tuple[int, ...]:
    shape = _sizes(at, node)
    if any(size < 0 for size in shape):
        at.mistake("the sizes of an array are not negative")
    return shape


_TYPES = {float: FLOAT, int: INT, bool: BOOL, np.float64: FLOAT, np.int64: INT, np.bool_: BOOL}


def _type(at: Arrays, node: ast.expr) -> np.dtype:
    """The type of an array's numbers."""
    known = node.value if isinstance(node, ast.Constant) else at.known(node)
    if known not in _TYPES:
        at.lack("an array has numbers of float, int or bool")
    return _TYPES[known]


def _whole_number(at: Arrays, node: ast.expr) -> int:
    value = at.value(node)
    if not value.kind.is_number or value.kind.base != INT:
        at.lack("a whole number is needed here")
    number: Any = value.constant
    if number is None:
        at.needs_constant("this number")
    return int(number)


def known_as(at: Arrays, node: ast.expr) -> Any:
    """An argument that is known when compiling, as Python has it; an array or a list as a list or a tuple."""
    if isinstance(node, ast.Constant):
        return node.value
    if isinstance(node, ast.Tuple | ast.List):
        return tuple(known_as(at, each) for each in node.elts)
    if isinstance(found := at.known(node), np.ndarray) and found.dtype in (FLOAT, INT, BOOL):
        return found.tolist()
    return _as_python(at, at.value(node))


def _as_python(at: Arrays, value: Value) -> Any:
    if value.kind.is_none:
        return None
    if value.kind.items is not None:
        return tuple(_as_python(at, item) for item in items_of(value))
    number: Any = value.constant
    if number is None:
        at.needs_constant("this argument")
    return {INT: int, BOOL: bool, FLOAT: float}[value.kind.base](number)


def _flag(at: Arrays, node: ast.expr) -> bool:
    known = known_as(at, node)
    return known if isinstance(known, bool) else at.lack("True or False is needed here")


_READ: dict[str, Callable[[Arrays, ast.expr], Any]] = {
    "Value": lambda at, node: at.value(node),
    "Node": lambda at, node: node,
    "Array": lambda at, node: at.as_array(at.value(node)),
    "Floats": lambda at, node: _floats(at, at.as_array(at.value(node))),
    "Square": _square,
    "Parts": _parts,
    "Whole": lambda at, node: _whole_number(at, node),
    "Known": known_as,
    "Flag": _flag,
    "Sizes": _shape,
    "Type": _type,
}


def stored(at: Arrays, out: ast.expr | None, result: Value) -> Value:
    """A result, in the array that the caller gives for it, if any."""
    return result if out is None else at.stored_in(at.value(out), result)
