"""The contract of a stage: settings, states, one function.

A stage is a frozen dataclass of settings that derives from the base class of its room: ``Guidance``, ``Navigation``,
``Controller`` or ``Actuation``. Its static method sets ``out`` from what it is given::

    @dataclass(frozen=True)
    class Circle(Guidance):
        "A horizontal circle about the origin."
        radius: float = setting(0.5, "m", "radius")
        omega: float = setting(0.2, "rad/s", "angular velocity")

        @staticmethod
        def step(settings, state, given, state_dot, out):
            station_keep(settings, given, out)
            out.p_d[0] = settings.radius * math.cos(settings.omega * given.t)
            ...

``given`` and ``out`` have the fields of the room's groups in :mod:`.signals`. At each instant of the stage, ``out`` is
computed from the current states; then the states advance by explicit Euler over the stage's period with ``state_dot``,
and ``out`` is held until the next instant. A stage may also set its states directly. The function is compiled; what the
language of :mod:`uvms_mj.compiler` lacks runs as plain Python. A user's class is checked against this contract when the
first stage is made of it.
"""

from __future__ import annotations  # so that help(Stage) shows short type names

import ast
import dataclasses
import functools
import inspect
import keyword
import math
import sys
import types
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Annotated, Any, ClassVar, cast, get_type_hints

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictBool,
    TypeAdapter,
    ValidationError,
    with_config,
)
from typing_extensions import TypedDict

from ..compiler.refusals import field_suggestion
from ..errors import Fault, InputError, faults_of, shortened, suggestion
from ..files import function_tree
from ..physics.random import key_of
from ..quantities import Step, refusing, unit_of
from . import signals
from .namespace import namespace_of
from .setup import ScenarioLike, SetupLike
from .signals import JOINT_SIGNALS, Signal


class ForeignCode(Exception):
    """A stage's function is machine code of the user's: Python does not call it."""


def setting(default: Any, unit: str, meaning: str) -> Any:
    """A dataclass field for a setting, with its default value, unit and meaning."""
    return dataclasses.field(default=default, metadata={"unit": unit, "meaning": meaning})


def shared(default: Any, unit: str, meaning: str) -> Any:
    """A setting that every stage of a room has: it is given by its name only."""
    return dataclasses.field(default=default, kw_only=True, metadata={"unit": unit, "meaning": meaning})


@dataclasses.dataclass(frozen=True)
class Room:
    """A room of stages: its package, its table in a scenario, its words in messages, and its stages' function.

    Attributes:
        given: the signals that a stage is given, from the number of thrusters or joints.
        out: the signals that it sets; one without a name's record is the array of the last argument.
        constants: names of constants that the function gets besides its settings.
        theory: methods beside the function that a stage may override.
        optional: names of the signals of ``out`` that stay zero if a user's stage does not set them.
        counts: whose number ``given`` and the sizes of states depend on: "thrusters" or "joints".
        words: further words for a stage of the room, which messages understand in place of the table's.
        several: whether a scenario has a list of its tables.
    """

    name: str
    table: str
    given: Callable[[int], tuple[Signal, ...]]
    out: tuple[Signal, ...]
    noun: str = "stage"
    setting: str = "setting"
    method: str = "step"
    arguments: tuple[str, ...] = ("settings", "state", "given", "state_dot", "out")
    constants: tuple[str, ...] = ()
    theory: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    counts: str = "thrusters"
    words: tuple[str, ...] = ()
    several: bool = False

    @property
    def name_key(self) -> str:
        """How a stage of the room is chosen: the key of its name."""
        return f'{self.table} = [{{name = "..."}}]' if self.several else f"{self.table}.name"


@dataclasses.dataclass(frozen=True)
class Stage:
    """Base class of all stages.

    Raises:
        InputError: a setting has the wrong type or is out of range; all errors are reported together.
    """

    period: Step | None = shared(None, "s", "period, a multiple of the time step; default: the control period")

    name: ClassVar[str] = ""
    states: ClassVar[Mapping[str, Any]] = {}
    """Sizes of the states by name; ``"thrusters"`` is the number of the vehicle's thrusters, and in a stage of the
    joints ``"joints"`` is their number."""
    memory: ClassVar[Mapping[str, Any]] = {}
    """Sizes or shapes of further arrays that the stage keeps from instant to instant, by name, in the same record
    ``state``: ``{"P": (15, 15), "queue": 100}``. They do not advance, and they are not recorded."""
    start_values: ClassVar[Mapping[str, Any]] = {}
    """Values of states and memory at the start of a run, by name, where they are not zero: one number for all entries,
    or a list of the state's size, of a matrix a list of its rows. A reset returns to them."""
    units: ClassVar[Mapping[str, str]] = {}
    """Units of the states, for logs and plots. A state with two units has the linear one first."""
    files: ClassVar[Sequence[str]] = ()
    """Files that the stage's file reads, relative to its folder, without "..". They go with it to the workers of a
    study and into the log. It opens them by ``Path(__file__).parent / name``."""
    room: ClassVar[Room]
    _inner_keys: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Keys of the tables within a setting, by the setting's key."""
    of_log: ClassVar[bool] = False
    """Whether the class is a placeholder of a log, which has the text of its function alone: it can't run."""
    every_step: ClassVar[bool] = False
    """Whether the default of the period is the time step instead of the control period."""
    external: ClassVar[bool] = False
    """Whether the caller of a Simulation sets the outputs."""
    by_caller: ClassVar[str] = ""
    """The signals that the caller of a Simulation sets between steps, in words; empty for none."""
    runs: ClassVar[bool] = True
    """Whether the loop calls the stage. One that does not run is the absence of a stage."""

    def __post_init__(self) -> None:
        table, noun = self.room.table, self.room.setting
        place = f"the {noun}s of {self.label()}"
        kind = type(self)
        try:
            valid = validator(kind).validate_python(vars(self))
        except ValidationError as error:
            units = {f"{table}.{field.name}": unit_of(field) for field in dataclasses.fields(self)}
            faults = faults_of(error, table, self._inner_keys, units)
            raise InputError([self._of_default(fault) for fault in faults], place) from None
        except Exception as error:  # pydantic and evaluating an annotation raise exceptions of many types
            reason = " ".join(str(error).split("\n\n")[0].split()) or type(error).__name__
            raise InputError(f"an annotation is not a valid type of a {noun}: {reason}", place) from None
        faults = [
            Fault(f"{table}.{name}", f"{valid[name]!r}: a {noun} is a number, true or false, or a tuple of numbers")
            for name in _numbers_of(kind)
            if not _is_number(valid[name])
        ]
        if faults:
            raise InputError(faults, place)
        vars(self).update(valid)
        self.check_settings()
        if not (self.of_log or is_shipped(self)):
            check_contract(kind)

    def __reduce_ex__(self, protocol: Any) -> Any:
        """A stage of a user's file is loaded from it where it is unpickled, so that it is never older than the file."""
        if (own := namespace_of(type(self))) is None:
            return super().__reduce_ex__(protocol)
        settings = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return own.unpickled, (self.room.table, type(self).source(), settings)

    def __copy__(self) -> Stage:
        return self

    def __deepcopy__(self, memo: Any) -> Stage:
        return self

    def check_settings(self) -> None:
        """Check the settings, each of which is valid, against each other. Raises InputError if they do not agree."""

    def _of_default(self, fault: Fault) -> Fault:
        """The fault, with a hint if the value is the default of the class, or if the default shows a list."""
        name = fault.key.removeprefix(f"{self.room.table}.").partition("[")[0]
        field = next((f for f in dataclasses.fields(self) if f.name == name), None)
        if field is not None and getattr(self, name) is field.default:
            return Fault(fault.key, f"{fault.message}; it is the default in the class {type(self).__name__}")
        if isinstance(default := getattr(field, "default", None), tuple) and fault.message.endswith("list of numbers"):
            return Fault(fault.key, f"{fault.message}; its default is {shortened(list(default))}")
        return fault

    @classmethod
    def label(cls) -> str:
        """The name in logs and tables: ``name`` if the class sets it, otherwise the class's own name."""
        return cls.__dict__.get("name") or cls.__name__

    @classmethod
    def source(cls) -> str:
        """Where to load this class from: the name of a shipped stage, or ``path/to/file.py:ClassName``."""
        if is_of_the_package(cls):
            return cls.name
        return f"{getattr(sys.modules.get(cls.__module__), '__file__', None) or '<session>'}:{cls.__name__}"

    @classmethod
    def function(cls) -> types.FunctionType:
        """The stage's function as a plain Python function, even if the user has marked it with ``numba.njit``."""
        function: Any = getattr(cls, cls.room.method)
        return getattr(function, "py_func", function)

    @classmethod
    def setting_fields(cls) -> tuple[dataclasses.Field, ...]:
        """The fields of the settings: the class's own first, then the fields of the room's base class."""
        base = {f.name for f in dataclasses.fields(base_of(cls))}
        own = [f for f in dataclasses.fields(cls) if f.name not in base]
        return (*own, *(f for f in dataclasses.fields(cls) if f.name in base))

    @classmethod
    def given(cls, thrusters: int = 0) -> tuple[Signal, ...]:
        """The signals that the function is given, for a vehicle with so many thrusters."""
        return cls.room.given(thrusters)

    def period_in(self, scenario: ScenarioLike) -> float:
        """Time between two instants of the stage in a run of a :class:`uvms_mj.scenario.Scenario` [s]."""
        return self.period or (scenario.simulation.timestep if self.every_step else scenario.control_period)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The constants of a run that the function gets as its settings, by name, from the run's
        :class:`uvms_mj.setup.base.Setup`. A user's settings do not depend on it."""
        fields = type(self).__dataclass_fields__  # dataclasses.fields takes longer than the rest
        return {name: value for name, value in vars(self).items() if name in fields}

    def faults(self, setup: SetupLike) -> Iterable[Fault]:
        """Errors of a run with these settings, which need its :class:`uvms_mj.setup.base.Setup`."""
        return ()

    def record(self, setup: SetupLike | None = None) -> np.ndarray:
        """The constants as a record array (1,): numbers as float64, flags as booleans, tuples as float64 vectors. The
        period and settings that are None are left out. Without a set-up: of a stage whose constants are its settings
        alone."""
        values = self.constants(cast(SetupLike, setup)).items()
        kept = {name: np.asarray(value) for name, value in values if value is not None and name != "period"}
        kinds = [(name, "?" if a.dtype == bool else "f8", a.shape) for name, a in kept.items()]
        record = np.zeros(1, np.dtype([*kinds, ("_", "f8")], align=True))  # at least 8 bytes, and a multiple of 8
        for name, array in kept.items():
            record[name] = array
        return record

    @classmethod
    def state_size(cls, counted: int = 0) -> int:
        """Number of states that advance, with so many thrusters or joints."""
        return sum(counted if size == cls.room.counts else size for size in cls.states.values())

    @classmethod
    def start_record(cls, counted: int = 0) -> np.ndarray:
        """The record of :meth:`state_record` with the start values. Raises InputError if one has another length than
        its state, whose size may be the number of thrusters or joints."""
        record = cls.state_record(counted)
        for name, value in cls.start_values.items():
            if wrong := _wrong_start(name, value, record[name].shape[1:]):
                raise InputError([Fault(f"{cls.room.table}.name", f"{cls.label()}: {wrong}")])
            record[name] = value
        return record

    @classmethod
    def state_record(cls, counted: int = 0) -> np.ndarray:
        """The states and then the memory, all zero, as a record array (1,) of float64 arrays."""
        shapes = {name: _shape(size, counted) for name, size in {**cls.states, **cls.memory}.items()}
        fields = [(name, "f8", shape) for name, shape in shapes.items()]
        return np.zeros(1, np.dtype(fields or [("none", "f8", (0,))], align=True))


def base_of(cls: type[Stage]) -> type[Stage]:
    """The base class of the stage's room."""
    return next(each for each in reversed(cls.__mro__) if "room" in vars(each))


def is_of_the_package(cls: type[Stage]) -> bool:
    """Whether the class is a shipped stage itself, with a name and in this package."""
    return bool(cls.__dict__.get("name")) and cls.__module__.startswith(f"{__name__.partition('.')[0]}.")


def is_shipped(stage: Stage) -> bool:
    """Whether a stage has the function, states and signals of a shipped class. A derived class may differ in its
    settings only."""
    kind = type(stage)
    return any(
        is_of_the_package(cls)
        and kind.function() is cls.function()
        and kind.states == cls.states
        and kind.memory == cls.memory
        and kind.start_values == cls.start_values
        and kind.given() == cls.given()
        for cls in kind.__mro__
        if issubclass(cls, Stage)
    )


def has_own_constants(cls: type[Stage]) -> bool:
    """Whether the class computes the constants of its function, so that its settings may be of any type."""
    base = base_of(cls)
    return cls.constants is not (Stage if base is cls else base).constants


def _kept(cls: Any, name: str, made: Callable[[], Any]) -> Any:
    """A value that is made once of a class, and goes with it."""
    if name not in vars(cls):
        setattr(cls, name, made())
    return vars(cls)[name]


def _numbers_of(cls: type[Stage]) -> tuple[str, ...]:
    """The names of the settings that the class's function gets as they are, besides the settings of its room's base
    class."""
    return _kept(cls, "_numbers", lambda: _find_numbers(cls))


def _find_numbers(cls: type[Stage]) -> tuple[str, ...]:
    ours = {field.name for field in dataclasses.fields(base_of(cls))}
    names = (field.name for field in dataclasses.fields(cls) if field.name not in ours)
    return () if has_own_constants(cls) else tuple(names)


def random_key(seed: int, stage: Stage) -> int:
    """The key of a stage's random numbers, at least 0, from ``simulation.seed`` and the stage's table."""
    return key_of(seed, stage.room.table)


def _is_number(value: Any) -> bool:
    if isinstance(value, tuple):
        return bool(value) and all(isinstance(each, _NUMBERS) for each in value)
    return value is None or isinstance(value, _NUMBERS)


_NUMBERS = (bool, int, float)  # a union is made anew at each use


def validator(cls: Any) -> TypeAdapter:
    """The validator of the fields of a dataclass, made once. Settings are checked at construction and never in the
    loop."""
    return _kept(cls, "_validator", lambda: _make_validator(cls))


def _make_validator(cls: Any) -> TypeAdapter:
    hints = get_type_hints(cls, include_extras=True)
    if issubclass(cls, Stage):  # a class may give what all stages of its room have another default, not another range
        hints |= get_type_hints(base_of(cls), include_extras=True)
    # Any: the fields of this type are known only at run time
    shape = cast(Any, TypedDict)("shape", {field.name: hints[field.name] for field in dataclasses.fields(cls)})
    return TypeAdapter(with_config(ConfigDict(allow_inf_nan=False))(shape))


_MOST = 10_000
_RECORDED = (
    *(*signals.RECORDED, *signals.MEASURED_MOTION, *signals.DELAYED, *signals.TOOL, signals.MANIPULABILITY),
    *(*signals.contact_signals(1), *JOINT_SIGNALS, signals.thruster_signal(1), signals.pulse_signal(1)),
    signals.deflection_signal(1),
)
_SIGNALS = {signal.name for signal in (*signals.GIVEN, *_RECORDED)}
"""Signals of a Simulation or a trace, which a state would hide."""
_MOST_BYTES = 16_000_000
"""Largest size of all files that a file lists [bytes]. They travel with each call of a worker."""
_SOUND: weakref.WeakSet[type[Stage]] = weakref.WeakSet()
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


def _shape(size: Any, counted: int) -> tuple[int, ...]:
    """The shape that a class declares, for a vehicle with so many thrusters or joints."""
    return tuple(counted if isinstance(each, str) else each for each in _axes(size))


def _wrong_start(name: str, value: Any, shape: tuple[int, ...]) -> str:
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


def take_checks(cls: type[Stage], other: type[Stage]) -> None:
    """Take over what was checked of another class, which the same code has made."""
    if other in _SOUND:
        _SOUND.add(cls)
        for name in ("_validator", "_numbers"):
            if name in vars(other):
                setattr(cls, name, vars(other)[name])


def check_contract(cls: type[Stage], file: str = "") -> None:
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


def _broken_rules(cls: type[Stage]) -> Iterator[str]:
    if "__dataclass_fields__" not in cls.__dict__:
        yield "the class must be decorated with @dataclass(frozen=True)"
        return  # without its fields, the rest can't be judged
    yield from _wrong_names(cls)
    states = list(_wrong_declarations(cls))
    yield from states
    yield from wrong_files(*_listed(cls))
    function = list(_wrong_function(cls))
    yield from function
    if not function and not states:
        yield from _unknown_fields(cls)


def _wrong_names(cls: type[Stage]) -> Iterator[str]:
    """Errors of settings and methods that take the place of others."""
    base, room = base_of(cls), cls.room
    names, shared = ([field.name for field in dataclasses.fields(each)] for each in (cls, base))
    own = [each for each in cls.__mro__ if not each.__module__.startswith("uvms_mj.") and each is not object]
    of_all = {name for each in (Stage, base) for name in vars(each) if name[0] != "_"} - {*names, *shared}
    of_all -= {*Declared.__annotations__, "every_step", "files", room.method, *room.theory}
    for name in names:
        if name not in shared and hasattr(base, name):
            yield f"{name!r} is an attribute of every {room.noun}; give the {room.setting} another name"
    for name in sorted(of_all):
        if any(name in vars(each) for each in own):
            yield f"{name!r} is a method of every {room.noun}; give yours another name"
    for each in own:
        for name in names:
            if name in vars(each) and name not in inspect.get_annotations(each):
                value = shortened(vars(each)[name])
                yield f"{name} = {value} has no effect without its type; write {name}: float = ..."


def _wrong_declarations(cls: type[Stage]) -> Iterator[str]:
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
        elif (total := sum(math.prod(_shape(axes, 1)) for axes in shapes.values())) > _MOST:
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
        if cls.room.counts not in axes and (fault := _wrong_start(name, value, axes)):
            yield fault


def _listed(cls: type[Stage]) -> tuple[Any, Path | None]:
    """The files that a class lists, and the folder of the file that does so; None for a class without a file."""
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
