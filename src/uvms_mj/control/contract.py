"""Checks of a user's class against the contract of :mod:`uvms_mj.control.base`, before its law runs."""

import ast
import dataclasses
import inspect
import textwrap
import types
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import Fault, InputError, suggestion
from ..stages.signals import GIVEN, TRUTH
from .base import Controller

_MOST_STATES = 10_000
_LONGEST_NAME = 100
_ARGUMENTS = ("gains", "state", "signals", "state_dot", "tau_cmd")
_OVERRIDDEN = ("law", "name", "states", "units", "uses_truth", "at_rest", "notes", "certificate")


def check_contract(cls: type[Controller], file: str = "") -> None:
    """Check that a class satisfies the contract of a controller.

    Args:
        cls: the class.
        file: its file, for the message.

    Raises:
        InputError: the class violates the contract; lists every error.
    """
    place = f"{cls.__name__} in {file}" if file else cls.__name__
    try:
        wrong = list(_wrong(cls))
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a user's attributes may raise anything
        wrong = [f"{type(error).__name__}: {error}"]
    if wrong:
        raise InputError([Fault("controller.name", f"{place}: {each}") for each in wrong])


def _wrong(cls: type[Controller]) -> Iterator[str]:
    shared = {f.name for f in dataclasses.fields(Controller)}
    if "__dataclass_fields__" not in cls.__dict__:
        yield "the class must be decorated with @dataclass(frozen=True)"
    taken = [f.name for f in dataclasses.fields(cls) if hasattr(Controller, f.name) and f.name not in shared]
    yield from (f"{name!r} is an attribute of every law; give the gain another name" for name in taken)
    own = [base for base in cls.__mro__ if not base.__module__.startswith("uvms_mj.") and base is not object]
    ours = [name for name in vars(Controller) if name[0] != "_" and name not in (*_OVERRIDDEN, *shared)]
    yield from (
        f"{name!r} is a method of every law; give yours another name"
        for name in ours
        if name not in taken and any(name in vars(base) for base in own)
    )
    name = cls.name
    if not (isinstance(name, str) and name.isprintable() and len(name) <= _LONGEST_NAME):
        yield f"name = {_shown(name)} must be a text of at most {_LONGEST_NAME} printable characters"
    if not isinstance(cls.uses_truth, bool):
        yield f"uses_truth = {_shown(cls.uses_truth)} must be true or false"
    states = list(_wrong_states(cls.states))
    yield from states
    if not states:
        yield from _wrong_units(cls)
    function = list(_wrong_function(cls))
    yield from function
    if not function and not states:
        yield from _unknown_fields(cls)


def _wrong_states(states: Any) -> Iterator[str]:
    wanted = f"states must be names with sizes from 1 to {_MOST_STATES}, as in {{'xi': 6}}"
    if not isinstance(states, Mapping):
        yield f"{wanted}; {_shown(states)} is not"
        return
    good = [
        isinstance(name, str) and name.isidentifier() and type(size) is int and 0 < size <= _MOST_STATES
        for name, size in states.items()
    ]
    for (name, size), fits in zip(states.items(), good, strict=True):
        if not fits:
            yield f"{wanted}; {_shown(name)}: {_shown(size)} is not"
    if all(good) and sum(states.values()) > _MOST_STATES:
        yield f"states has {sum(states.values())} numbers in all; at most {_MOST_STATES} are allowed"


def _wrong_units(cls: type[Controller]) -> Iterator[str]:
    units = cls.units
    if not isinstance(units, Mapping):
        yield f"units must give each state's unit as a text, as in {{'xi': 'm s'}}; {_shown(units)} does not"
        return
    for name, unit in units.items():
        if name not in cls.states:
            yield f"units has {_shown(name)}, which is not a state; {suggestion(str(name), cls.states)}"
        if not (isinstance(unit, str) and unit.isprintable()):
            yield f"units must give each state's unit as a text, as in {{'xi': 'm s'}}; {_shown(unit)} is not a text"


def _wrong_function(cls: type[Controller]) -> Iterator[str]:
    if all("law" not in vars(base) for base in cls.__mro__ if base not in (Controller, object)):
        yield "it has no method 'law'"
        return
    found = inspect.getattr_static(cls, "law")
    if not isinstance(found, staticmethod):
        yield "law must be a @staticmethod"
        return
    function = law_function(cls)
    if not isinstance(function, types.FunctionType):
        yield f"law must be a Python function, written with def; {_shown(cls.law)} is not"
        return
    if inspect.iscoroutinefunction(function) or inspect.isgeneratorfunction(function):
        yield "law must be a plain function: no async, no yield"
    try:
        inspect.signature(function).bind(*_ARGUMENTS)
    except TypeError:
        yield f"law must take ({', '.join(_ARGUMENTS)})"


def law_function(cls: type[Controller]) -> types.FunctionType:
    """The law as a plain Python function, even if the user has marked it with ``numba.njit``."""
    law: Any = cls.law
    return getattr(law, "py_func", law)


def _unknown_fields(cls: type[Controller]) -> Iterator[str]:
    """Errors for fields of its arguments that the law uses but that do not exist."""
    function = law_function(cls)
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    except (OSError, TypeError, SyntaxError, IndexError):  # typed at a prompt, or a lambda
        return
    if not isinstance(tree, ast.FunctionDef):
        return
    gains = [f.name for f in dataclasses.fields(cls) if f.name != "period"]
    given = [signal.name for signal in (GIVEN + TRUTH if cls.uses_truth else GIVEN)]
    fields = (gains, list(cls.states), given, list(cls.states))
    arguments = dict(
        zip(
            (a.arg for a in (*tree.args.posonlyargs, *tree.args.args)),
            zip(_ARGUMENTS, fields, strict=False),
            strict=False,
        )
    )
    nodes = list(ast.walk(tree))
    for node in nodes:
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            arguments.pop(node.id, None)
    file = Path(function.__code__.co_filename).name
    said = set()
    for node in sorted((n for n in nodes if isinstance(n, ast.Attribute | ast.Subscript)), key=lambda n: n.lineno):
        word = _asked_for(node)
        if word is None or not isinstance(node.value, ast.Name) or node.value.id not in arguments:
            continue
        role, known = arguments[node.value.id]
        if word in known or hasattr(np.record, word) or (role, word) in said:
            continue
        said.add((role, word))
        line = function.__code__.co_firstlineno + node.lineno - 1
        yield f"{file}, line {line}: {role} has no {word!r}; {_hint(role, word, known)}"


def _hint(role: str, word: str, known: list[str]) -> str:
    if role == "signals" and word in {signal.name for signal in TRUTH}:
        return "only the yardstick 'ideal' may use the truth"
    if role == "gains" and word == "period":
        return "signals.period is the control period"
    return field_suggestion(word, known) if known else "the class declares no states"


def field_suggestion(word: str, known: Sequence[str]) -> str:
    """A hint for an unknown name: the first known name that adds a suffix to it, as p_WB to p, else the closest."""
    longer = [name for name in known if name.startswith(f"{word}_")]
    return f"did you mean {longer[0]!r}?" if longer else suggestion(word, known)


def _asked_for(node: ast.Attribute | ast.Subscript) -> str | None:
    if isinstance(node, ast.Attribute):
        return node.attr
    key = node.slice
    return key.value if isinstance(key, ast.Constant) and isinstance(key.value, str) else None


def _shown(value: Any) -> str:
    try:
        text = repr(value)
    except Exception:  # a user's class may fail in __repr__
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."
