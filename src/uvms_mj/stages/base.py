"""The contract of a stage: settings, states, one function.

A stage is a frozen dataclass of settings that derives from the base class of its room: ``Guidance``, ``Navigation``,
``Controller`` or ``Actuation``. Its static method sets ``out`` from its arguments::

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

import dataclasses
import sys
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, cast, get_type_hints

import numpy as np
from pydantic import (
    ConfigDict,
    TypeAdapter,
    ValidationError,
    with_config,
)
from typing_extensions import TypedDict

from ..errors import Fault, InputError, faults_of, shortened
from ..physics.random import key_of, owned
from ..quantities import Step, unit_of
from .contract import base_of, check_contract, has_own_constants, shape_of, wrong_start
from .namespace import namespace_of
from .setup import ScenarioLike, SetupLike
from .signals import Signal


class ForeignCode(Exception):
    """A stage's function is machine code of the user's: Python does not call it."""


def setting(default: Any, unit: str, meaning: str) -> Any:
    """A dataclass field for a setting, with its default value, unit and meaning. Raises TypeError for a default that
    can change."""
    if isinstance(default, list | dict | set | np.ndarray):
        wrong = "a setting is a tuple: write (80.0, ...) in place of [80.0, ...]"
        raise TypeError(f"{wrong}; {shortened(default)} can change")
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
    of_world: ClassVar[bool] = False
    """Whether all vehicles of a world share the table: each vehicle has stages of its own."""
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

    def __init_subclass__(cls, **arguments: Any) -> None:
        """A user's class with a function of its own has no theory of a shipped class that it derives from: rests, lags,
        curves and closed forms are of the shipped function. The function may come from another base class."""
        super().__init_subclass__(**arguments)
        package = __name__.partition(".")[0] + "."
        if cls.__module__.startswith(package):
            return
        if next(each for each in cls.__mro__ if cls.room.method in vars(each)).__module__.startswith(package):
            return
        for name, method in vars(base_of(cls)).items():
            theory = isinstance(method, types.FunctionType | property) and name[0] != "_" and name not in vars(Stage)
            if theory and next(each for each in cls.__mro__ if name in vars(each)).__module__.startswith(package):
                setattr(cls, name, method)

    def __post_init__(self) -> None:
        table, noun = self.room.table, self.room.setting
        place = f"the {noun}s of {self.label()}"
        kind = type(self)
        try:
            valid = validator(kind).validate_python(vars(self))
        except ValidationError as error:
            fields = {f"{table}.{field.name}": field for field in dataclasses.fields(self)}
            units = {key: unit_of(field) for key, field in fields.items()}
            defaults = {key: field.default for key, field in fields.items()}
            faults = faults_of(error, table, self._inner_keys, units, defaults)
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
        if not (self.of_log or self.is_shipped):
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
        """The fault, with a hint if the value is the default of the class."""
        name = fault.key.removeprefix(f"{self.room.table}.").partition("[")[0]
        field = next((f for f in dataclasses.fields(self) if f.name == name), None)
        if field is not None and getattr(self, name) is field.default:
            return Fault(fault.key, f"{fault.message}; it is the default in the class {type(self).__name__}")
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

    @property
    def is_shipped(self) -> bool:
        """Whether the stage has the function, states and signals of a shipped class. A derived class may differ in its
        settings only."""
        kind = type(self)
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

    @classmethod
    def file_suffix(cls) -> str:
        """The suffix of the file with the class's function, ".py" or ".c"; empty for a class of the package or of the
        session."""
        return Path(cls.source().rpartition(":")[0]).suffix

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
            if wrong := wrong_start(name, value, record[name].shape[1:]):
                raise InputError([Fault(f"{cls.room.table}.name", f"{cls.label()}: {wrong}")])
            record[name] = value
        return record

    @classmethod
    def state_record(cls, counted: int = 0) -> np.ndarray:
        """The states and then the memory, all zero, as a record array (1,) of float64 arrays."""
        shapes = {name: shape_of(size, counted) for name, size in {**cls.states, **cls.memory}.items()}
        fields = [(name, "f8", shape) for name, shape in shapes.items()]
        return np.zeros(1, np.dtype(fields or [("none", "f8", (0,))], align=True))


def is_of_the_package(cls: type[Stage]) -> bool:
    """Whether the class is a shipped stage itself, with a name and in this package."""
    return bool(cls.__dict__.get("name")) and cls.__module__.startswith(f"{__name__.partition('.')[0]}.")


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


def random_key(seed: int, stage: Stage, vehicle: str = "") -> int:
    """The key of a stage's random numbers, at least 0, from ``simulation.seed``, the stage's table and the name of the
    vehicle."""
    return key_of(seed, owned(stage.room.table, vehicle))


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
