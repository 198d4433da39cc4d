"""Checks of a user's class against the contract of :mod:`uvms_mj.stages.base`, before its function runs."""

import ast
import dataclasses
import inspect
import keyword
import sys
import types
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from ..errors import Fault, InputError, shortened, suggestion
from ..files import function_tree
from . import signals
from .base import Stage, base_of, has_own_constants, is_shipped
from .signals import JOINT_SIGNALS

_MOST_STATES = 10_000
_LONGEST_NAME = 100
_RECORDED = (
    *(*signals.RECORDED, *signals.MEASURED_MOTION, *signals.DELAYED, *signals.TOOL, signals.MANIPULABILITY),
    *(*signals.contact_signals(1), *JOINT_SIGNALS, signals.thruster_signal(1), signals.pulse_signal(1)),
)
_SIGNALS = {signal.name for signal in (*signals.GIVEN, *_RECORDED)}
"""Signals of a Simulation or a trace, which a state would hide."""
_OVERRIDDEN = (
    "name",
    "states",
    "memory",
    "start_values",
    "units",
    "every_step",
    "uses_task",
    "uses_truth",
    "files",
)
_MOST_BYTES = 16_000_000
"""Largest size of all files that a file lists [bytes]. They travel with each call of a worker."""


def check_stage(stage: Stage) -> None:
    """Check that a stage may run. Raises InputError if it is of a log, or its class violates the contract."""
    if stage.of_log:
        key, file = f"{stage.room.table}.name", f"path/to/{stage.source()}"
        raise InputError(
            f"the {stage.room.noun} {stage.source()} is in the log as text, which is never run: name its file with "
            f'scenario.updated({{"{key}": "{file}"}})'
        )
    if not is_shipped(stage):
        check_contract(type(stage))
        if getattr(stage, "uses_truth", False):
            raise InputError([Fault("controller.uses_truth", "is reserved for ideal, the yardstick law")], "scenario")


def check_contract(cls: type[Stage], file: str = "") -> None:
    """Check that a class satisfies the contract of a stage of its room. The message names the file.

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
        raise InputError([Fault(f"{cls.room.table}.name", f"{place}: {each}") for each in wrong])


def _wrong(cls: type[Stage]) -> Iterator[str]:
    base, room = base_of(cls), cls.room
    shared = {f.name for f in dataclasses.fields(base)}
    if "__dataclass_fields__" not in cls.__dict__:
        yield "the class must be decorated with @dataclass(frozen=True)"
        return  # without its fields, the rest can't be judged
    names = [f.name for f in dataclasses.fields(cls)]
    taken = [name for name in names if hasattr(base, name) and name not in shared]
    reasons = [(name, f"is an attribute of every {room.noun}") for name in taken]
    yield from (f"{name!r} {reason}; give the {room.setting} another name" for name, reason in reasons)
    own = [base for base in cls.__mro__ if not base.__module__.startswith("uvms_mj.") and base is not object]
    ours = {name for each in {Stage, base} for name in vars(each) if name[0] != "_"}
    ours -= {*_OVERRIDDEN, room.method, *room.theory, *shared}
    yield from (
        f"{name!r} is a method of every {room.noun}; give yours another name"
        for name in sorted(ours)
        if name not in taken and any(name in vars(base) for base in own)
    )
    yield from (
        f"{name} = {shortened(vars(each)[name])} has no effect without its type; write {name}: float = ..."
        for each in own
        for name in names
        if name in vars(each) and name not in inspect.get_annotations(each)
    )
    name = cls.name
    if not (isinstance(name, str) and name.isprintable() and len(name) <= _LONGEST_NAME):
        yield f"name = {shortened(name)} must be a text of at most {_LONGEST_NAME} printable characters"
    for name in ("uses_task", "uses_truth"):
        flag = getattr(cls, name, False)
        if not isinstance(flag, bool):
            yield f"{name} = {shortened(flag)} must be true or false"
    yield from wrong_files(*_listed(cls))
    states = [*_wrong_states(cls.states, "states", room.counts), *_wrong_states(cls.memory, "memory", room.counts)]
    if not states:
        states += [f"{name!r} is both a state and memory" for name in cls.memory if name in cls.states]
    yield from states
    if not states:
        yield from _wrong_units(cls)
        yield from _wrong_starts(cls)
    function = list(_wrong_function(cls))
    yield from function
    if not function and not states:
        yield from _unknown_fields(cls)


def _listed(cls: type[Stage]) -> tuple[Any, Path | None]:
    """What a class lists as its files, and the folder of the file that does so; None for a class without a file."""
    owner = next(each for each in cls.__mro__ if "files" in vars(each))
    file = getattr(sys.modules.get(owner.__module__), "__file__", None)
    return owner.__dict__["files"], None if file is None else Path(file).parent


def listed_files(cls: type[Stage]) -> dict[str, Path]:
    """The files that a class, which satisfies its contract, lists: their paths by their names."""
    names, folder = _listed(cls)
    return {PurePath(name).as_posix(): (folder or Path()) / name for name in names}


def wrong_files(names: Any, folder: Path | None) -> Iterator[str]:
    """Errors of a list of files of a folder."""
    if isinstance(names, str) or not isinstance(names, Sequence) or not all(isinstance(each, str) for each in names):
        yield f"files must be a list of names, as in files = ['policy.npz']; {shortened(names)} is not"
        return
    if names and folder is None:
        yield "files are relative to the folder of the file with the class, and the class has no file"
        return
    size, there = 0, folder or Path()
    for name in names:
        path = PurePath(name)
        if path.is_absolute() or ".." in path.parts or not name.isprintable():
            yield f"files: {shortened(name)} must be a path below the folder of the file that lists it, without '..'"
        elif not (there / path).is_file():
            yield f"files: no file {shortened(name)} in {there}"
        else:
            size += (there / path).stat().st_size
    if size > _MOST_BYTES:
        yield f"files have {size / 1e6:.4g} MB in all; at most {_MOST_BYTES / 1e6:g} MB are allowed"


def _wrong_states(states: Any, called: str, counted: str) -> Iterator[str]:
    wanted = f"{called} must be names with sizes from 1 to {_MOST_STATES}, as in {{'xi': 6}}"
    if not isinstance(states, Mapping):
        yield f"{wanted}; {shortened(states)} is not"
        return
    good = [
        isinstance(name, str)
        and name.isidentifier()
        and (size == counted or (type(size) is int and 0 < size <= _MOST_STATES))
        for name, size in states.items()
    ]
    for (name, size), fits in zip(states.items(), good, strict=True):
        if not fits:
            yield f"{wanted}; {shortened(name)}: {shortened(size)} is not"
        elif keyword.iskeyword(name):
            yield f"{name!r} is a word of Python's grammar; give the state another name"
        elif hasattr(np.record, name):
            yield f"{name!r} is an attribute of NumPy's records; give the state another name"
        elif name in _SIGNALS:
            yield f"{name!r} is the name of a signal; give the state another name"
    total = sum(size for size in states.values() if size != counted) if all(good) else 0
    if total > _MOST_STATES:
        yield f"{called} has {total} numbers in all; at most {_MOST_STATES} are allowed"


def _wrong_units(cls: type[Stage]) -> Iterator[str]:
    units = cls.units
    if not isinstance(units, Mapping):
        yield f"units must give each state's unit as a text, as in {{'xi': 'm s'}}; {shortened(units)} does not"
        return
    for name, unit in units.items():
        if name not in cls.states:
            hint = suggestion(str(name), cls.states) if cls.states else "the class declares no states"
            yield f"units has {shortened(name)}, which is not a state; {hint}"
        if not (isinstance(unit, str) and unit.isprintable()):
            yield f"units must give each state's unit as a text, as in {{'xi': 'm s'}}; {shortened(unit)} is not a text"


def _wrong_starts(cls: type[Stage]) -> Iterator[str]:
    starts, sizes = cls.start_values, {**cls.states, **cls.memory}
    if not isinstance(starts, Mapping):
        yield f"start_values must give states numbers, as in {{'xi': 0.5}}; {shortened(starts)} does not"
        return
    for name, value in starts.items():
        if name not in sizes:
            hint = suggestion(str(name), sizes) if sizes else "the class declares no states"
            yield f"start_values has {shortened(name)}, which is not a state; {hint}"
            continue
        numbers = [value] if isinstance(value, int | float) else value
        array = np.asarray(numbers) if isinstance(numbers, list | tuple | np.ndarray) else np.zeros(0)
        size = sizes[name]
        if array.dtype.kind not in "if" or array.ndim != 1 or not array.size:
            yield f"start_values[{name!r}] = {shortened(value)} must be a number or a list of numbers"
        elif not np.isfinite(array).all():
            yield f"start_values[{name!r}] = {shortened(value)} must be finite"
        elif isinstance(size, int) and array.size not in (1, size):
            yield f"start_values[{name!r}] has {array.size} numbers; the state has {size}"


def _wrong_function(cls: type[Stage]) -> Iterator[str]:
    method, arguments = cls.room.method, cls.room.arguments
    if all(method not in vars(each) for each in cls.__mro__ if each not in (base_of(cls), Stage, object)):
        yield f"it has no method {method!r}"
        return
    if not isinstance(inspect.getattr_static(cls, method), staticmethod):
        yield f"{method} must be a @staticmethod"
        return
    function = cls.function()
    if not isinstance(function, types.FunctionType):
        yield f"{method} must be a Python function, written with def; {shortened(getattr(cls, method))} is not"
        return
    if inspect.iscoroutinefunction(function) or inspect.isgeneratorfunction(function):
        yield f"{method} must be a plain function: no async, no yield"
    try:
        inspect.signature(function).bind(*arguments)
    except TypeError:
        yield f"{method} must take ({', '.join(arguments)})"


def _unknown_fields(cls: type[Stage]) -> Iterator[str]:
    """Errors for fields of its arguments that the function uses but that do not exist."""
    function = cls.function()
    try:
        tree, _ = function_tree(function)
    except (OSError, TypeError, SyntaxError, IndexError):  # typed at a prompt, or a lambda
        return
    if not isinstance(tree, ast.FunctionDef):
        return
    settings = [*cls.room.constants, *(f.name for f in dataclasses.fields(cls) if f.name != "period")]
    given, out = ([signal.name for signal in each] for each in (cls.given(), cls.room.out))
    kept = [*cls.states, *cls.memory]
    roles = zip(cls.room.arguments, (settings, kept, given, list(cls.states), out), strict=True)
    free = {
        "tau_cmd",
        "u",
        *(cls.room.arguments[:1] if has_own_constants(cls) else ()),
    }  # arrays, and settings of any type
    names = (a.arg for a in (*tree.args.posonlyargs, *tree.args.args))
    arguments = {name: each for name, each in zip(names, roles, strict=False) if each[0] not in free}
    nodes = list(ast.walk(tree))
    for node in nodes:
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            arguments.pop(node.id, None)
    file = Path(function.__code__.co_filename).name
    said = set()
    for node in sorted((n for n in nodes if isinstance(n, ast.Attribute | ast.Subscript)), key=lambda n: n.lineno):
        match node:
            case ast.Attribute(ast.Name(name), word) | ast.Subscript(ast.Name(name), ast.Constant(str(word))):
                role, known = arguments.get(name, ("", [word]))
            case _:
                continue
        if word in known or hasattr(np.record, word) or (role, word) in said:
            continue
        said.add((role, word))
        line = function.__code__.co_firstlineno + node.lineno - 1
        yield f"{file}, line {line}: {role} has no {word!r}; {_hint(cls, role, word, known)}"


def _hint(cls: type[Stage], role: str, word: str, known: list[str]) -> str:
    settings, _, given, *_ = cls.room.arguments
    if role == "signals" and word in {signal.name for signal in signals.TRUTH}:
        return "only the yardstick 'ideal' may use the truth"
    if role == "signals" and word in {signal.name for signal in signals.TASK}:
        return "the class has uses_task = False"
    if role == settings and word == "period":
        return f"{given}.period is the {'control ' if given == 'signals' else ''}period"
    if role == settings and word in {signal.name for signal in cls.given()}:
        return f"{given}.{word} is a signal"
    if known:
        return field_suggestion(word, known)
    return f"the class declares no {cls.room.setting if role == settings else 'state'}s"


def field_suggestion(word: str, known: Sequence[str]) -> str:
    """A hint for an unknown name: the first known name that adds a suffix to it, as p_WB to p, else the closest."""
    longer = [name for name in known if name.startswith(f"{word}_")]
    return f"did you mean {longer[0]!r}?" if longer else suggestion(word, known)
