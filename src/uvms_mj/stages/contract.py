"""The check of a user's class against the contract of a stage: its names, its declarations, its files, its function.

A class is checked when the first stage is made of it. The checks read the class alone, and find its room and the base
class of all stages among its bases.
"""

import ast
import dataclasses
import functools
import inspect
import keyword
import math
import sys
import types
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePath
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, StrictBool, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from ..compiler.refusals import field_suggestion
from ..errors import Fault, InputError, faults_of, shortened, suggestion
from ..files import function_tree
from ..quantities import refusing
from . import signals


def base_of(cls: type[Any]) -> type[Any]:
    """The base class of the stage's room."""
    return next(each for each in reversed(cls.__mro__) if "room" in vars(each))


def _root_of(cls: type[Any]) -> type[Any]:
    """The base class of all stages. A user's class may have further bases, a room's has this one alone."""
    return base_of(cls).__mro__[-2]


def has_own_constants(cls: type[Any]) -> bool:
    """Whether the class computes the constants of its function, so that its settings may be of any type."""
    base = base_of(cls)
    return cls.constants is not (_root_of(cls) if base is cls else base).constants


_MOST = 10_000
_SIGNALS = {signal.name for signal in signals.GIVEN} | signals.names_taken()
"""Signals of a Simulation or a trace, which a state would hide."""
_MOST_BYTES = 16_000_000
"""Largest size of all files that a file lists [bytes]. They travel with each call of a worker."""
_SOUND: weakref.WeakSet[type[Any]] = weakref.WeakSet()
"""Classes that satisfy their contract."""


def no_numbers(value: Any) -> bool:
    """Whether a value is neither a finite number nor a list of them."""
    return _no_finite(value) or np.ndim(value) > 1


def _no_finite(value: Any) -> bool:
    """Whether a value is neither a finite number nor a list of them, or of rows of equal length."""
    try:
        numbers = np.asarray(value if isinstance(value, int | float | list | tuple | np.ndarray) else ())
    except ValueError:  # rows of different lengths
        return True
    return numbers.dtype.kind not in "if" or not numbers.size or not np.isfinite(numbers).all()


def _axes(size: Any) -> tuple[Any, ...]:
    """The shape that a class declares by a size or a tuple of sizes, which may be numbers or "thrusters"."""
    return tuple(size) if isinstance(size, tuple | list) else (size,)


def shape_of(size: Any, counted: int) -> tuple[int, ...]:
    """The shape that a class declares, for a vehicle with so many thrusters or joints."""
    return tuple(counted if isinstance(each, str) else each for each in _axes(size))


def wrong_start(name: str, value: Any, shape: tuple[int, ...]) -> str:
    """The error of a start value for a state or memory of a shape; empty if it fits."""
    if np.size(value) == 1 or np.shape(value) == shape:
        return ""
    if len(shape) == 1 and np.ndim(value) == 1:
        return f"start_values[{name!r}] has {np.size(value)} numbers; the state has {shape[0]}"
    return f"start_values[{name!r}] has the shape {np.shape(value)}; the state has {shape}"


def _no_size(value: Any) -> bool:
    return value not in ("thrusters", "joints") and not (type(value) is int and 1 <= value <= _MOST)


def _no_shape(value: Any) -> bool:
    return not _axes(value) or any(map(_no_size, _axes(value)))


def _field_name(name: str) -> str:
    """The name of a state, which is a field of NumPy's records."""
    for wrong, what in (
        (not name.isidentifier(), "not a name"),
        (keyword.iskeyword(name), "a word of Python's grammar"),
        (hasattr(np.record, name), "an attribute of NumPy's records"),
        (name in _SIGNALS, "the name of a signal"),
    ):
        if wrong:
            raise ValueError(f"is {what}; give the state another name")
    return name


StateName = Annotated[str, AfterValidator(_field_name)]
_SIZE = f'must be a whole number from 1 to {_MOST}, "thrusters" or "joints"'
_SHAPED = "is a shape, which memory may have; a state is a vector, since it is recorded: give its size"
Size = Annotated[
    Any,
    refusing(_no_size, _SIZE),
    refusing(lambda size: isinstance(size, tuple | list), _SHAPED, BeforeValidator),
]
Shape = Annotated[Any, refusing(_no_shape, f"{_SIZE}, or a tuple of them, as in (15, 15)")]
Start = Annotated[Any, refusing(no_numbers, "must be a finite number or a list of them")]
Rows = Annotated[Any, refusing(_no_finite, "must be a finite number or a list of them")]
Text = Annotated[str, refusing(lambda text: not text.isprintable(), "must be printable")]


class Declared(TypedDict, total=False):
    """The declarations of a class about itself and its states."""

    name: Annotated[Text, Field(max_length=100)]
    states: dict[StateName, Size]
    memory: dict[StateName, Shape]
    start_values: dict[str, Rows]
    units: dict[str, Text]
    uses_task: StrictBool
    uses_truth: StrictBool


@functools.cache
def _declared() -> TypeAdapter:
    return TypeAdapter(Declared)


def take_checks(cls: type[Any], other: type[Any]) -> None:
    """Take over what was checked of another class, which the same code has made."""
    if other in _SOUND:
        _SOUND.add(cls)
        for name in ("_validator", "_numbers"):
            if name in vars(other):
                setattr(cls, name, vars(other)[name])


def check_contract(cls: type[Any], file: str = "") -> None:
    """Check, once, that a class satisfies the contract of a stage of its room. The message names the file.

    Raises:
        InputError: the class violates the contract; lists every error.
    """
    if cls in _SOUND:
        return
    place = f"{cls.__name__} in {file}" if file else cls.__name__
    try:
        wrong = list(_broken_rules(cls))
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a user's attributes may raise anything
        wrong = [f"{type(error).__name__}: {error}"]
    if wrong:
        raise InputError([Fault(f"{cls.room.table}.name", f"{place}: {each}") for each in wrong])
    _SOUND.add(cls)


def _broken_rules(cls: type[Any]) -> Iterator[str]:
    if "__dataclass_fields__" not in cls.__dict__:
        yield "the class must be decorated with @dataclass(frozen=True)"
        return  # without its fields, the rest can't be judged
    yield from _wrong_names(cls)
    states = list(_wrong_declarations(cls))
    yield from states
    yield from wrong_files(*_listed(cls))
    function = list(_wrong_function(cls)) or list(_never_called(cls))
    yield from function
    if not function and not states:
        yield from _unknown_fields(cls)


def _never_called(cls: type[Any]) -> Iterator[str]:
    """The error of a function whose class derives from a stage that no run calls, as perfect encoders."""
    for each in cls.__mro__:
        idle = vars(each).get("runs") is False or vars(each).get("external") is True
        if idle and cls.function() is not each.function():
            yield f"it derives from {each.__name__}, which no run calls; derive it from {base_of(cls).__name__}"
            return


def _wrong_names(cls: type[Any]) -> Iterator[str]:
    """Errors of settings and methods that take the place of others."""
    base, room = base_of(cls), cls.room
    names, shared = ([field.name for field in dataclasses.fields(each)] for each in (cls, base))
    own = [each for each in cls.__mro__ if not each.__module__.startswith("uvms_mj.") and each is not object]
    of_all = {name for each in (_root_of(cls), base) for name in vars(each) if name[0] != "_"} - {*names, *shared}
    of_all -= {*Declared.__annotations__, "every_step", "files", room.method, *room.theory}
    for name in names:
        if name not in shared and hasattr(base, name):
            yield f"{name!r} is an attribute of every {room.noun}; give the {room.setting} another name"
    for name in sorted(of_all):  # a class may have the base's method itself, in place of a shipped class's
        if any(vars(each).get(name, vars(base).get(name)) is not vars(base).get(name) for each in own):
            yield f"{name!r} is a method of every {room.noun}; give yours another name"
    for each in own:
        for name in names:
            if name in vars(each) and name not in inspect.get_annotations(each):
                value = shortened(vars(each)[name])
                yield f"{name} = {value} has no effect without its type; write {name}: float = ..."


def _wrong_declarations(cls: type[Any]) -> Iterator[str]:
    """Errors in the declarations of a class about itself and its states."""
    try:
        declared = {name: getattr(cls, name) for name in Declared.__annotations__ if hasattr(cls, name)}
        _declared().validate_python(declared)
    except ValidationError as error:
        yield from map(str, faults_of(error))
        return
    if declared.get("uses_truth"):
        yield "uses_truth is reserved for ideal, the yardstick law"
    for called in ("states", "memory"):
        shapes, counted = {name: _axes(size) for name, size in declared[called].items()}, cls.room.counts
        if wrong := [(name, n) for name, axes in shapes.items() for n in axes if isinstance(n, str) and n != counted]:
            yield f"{called}.{wrong[0][0]}: {wrong[0][1]!r} is not the number of {counted}"
        elif (total := sum(math.prod(shape_of(axes, 1)) for axes in shapes.values())) > _MOST:
            yield f"{called} has {total} numbers in all; at most {_MOST} are allowed"
    sizes = {**cls.states, **cls.memory}
    yield from (f"{name!r} is both a state and memory" for name in cls.memory if name in cls.states)
    for called, of in (("units", cls.states), ("start_values", sizes)):
        for name in declared[called]:
            if name not in of:
                hint = suggestion(name, of) if of else "the class declares no states"
                yield f"{called} has {shortened(name)}, which is not a state; {hint}"
    for name, value in cls.start_values.items():
        axes = _axes(sizes.get(name, cls.room.counts))  # the number of thrusters is not known here
        if cls.room.counts not in axes and (fault := wrong_start(name, value, axes)):
            yield fault


def _listed(cls: type[Any]) -> tuple[Any, Path | None]:
    """The files that a class lists, and the folder of the file that does so; None for a class without a file."""
    owner = next(each for each in cls.__mro__ if "files" in vars(each))
    file = getattr(sys.modules.get(owner.__module__), "__file__", None)
    return owner.__dict__["files"], None if file is None else Path(file).parent


def listed_files(cls: type[Any]) -> dict[str, Path]:
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


def _wrong_function(cls: type[Any]) -> Iterator[str]:
    method, arguments = cls.room.method, cls.room.arguments
    if all(method not in vars(each) for each in cls.__mro__ if each not in (base_of(cls), _root_of(cls), object)):
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
    taken = [*inspect.signature(function).parameters]
    try:
        inspect.signature(function).bind(*arguments)
        swapped = sorted(taken) == sorted(arguments) and taken != [*arguments]
    except TypeError:
        swapped = True
    if swapped:
        yield f"{method} must take ({', '.join(arguments)})"


def _unknown_fields(cls: type[Any]) -> Iterator[str]:
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


@functools.lru_cache(maxsize=256)
def signals_read(cls: type[Any]) -> frozenset[str]:
    """The names of the signals that a stage's function may read of what it is given: all, unless its text uses this
    record by the names of signals alone, and hands it to nothing else."""
    every = frozenset(signal.name for signal in cls.given())
    try:
        tree: Any = function_tree(cls.function())[0]
        given = [*tree.args.posonlyargs, *tree.args.args][2].arg
    except (OSError, TypeError, SyntaxError, IndexError):  # typed at a prompt, or machine code of the user's
        return every
    nodes = list(ast.walk(tree))
    uses = [node for node in nodes if isinstance(node, ast.Name) and node.id == given]
    read = [node.attr for node in nodes if isinstance(node, ast.Attribute) and node.value in uses]
    return frozenset(read) if len(read) == len(uses) and every.issuperset(read) else every


def _hint(cls: type[Any], role: str, word: str, known: list[str]) -> str:
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
