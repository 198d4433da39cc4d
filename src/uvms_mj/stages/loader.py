"""Stages by their name: a shipped class, a user's class from a file, which is checked against the contract of
:mod:`uvms_mj.stages.base` before its function runs, or its placeholder in a loaded log.
"""

import ast
import dataclasses
import hashlib
import importlib.util
import inspect
import keyword
import sys
import traceback
import types
from collections.abc import Collection, Container, Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from types import ModuleType
from typing import Any, Generic, TypeVar

import numpy as np

from ..errors import Fault, InputError, error_text, shortened, suggestion
from ..files import function_tree
from . import signals
from .base import Stage, base_of, has_own_constants, is_shipped, setting
from .signals import JOINT_SIGNALS, OWN_UNIT

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


_Stage = TypeVar("_Stage", bound=Stage)


@dataclasses.dataclass(frozen=True)
class Choice(Generic[_Stage]):
    """The stages to choose from in a table of a scenario; ``default`` is that of a table without a name."""

    base: type[_Stage]
    shipped: Mapping[str, type[_Stage]]
    default: type[_Stage]

    def load(
        self, table: Mapping[str, Any], known: type[_Stage] | None = None, trusted: Container[str] | None = None
    ) -> _Stage:
        """Make the stage of a table: ``name`` is a shipped stage or ``path/to/file.py:ClassName``, and every other key
        is a setting. ``known`` is a class to use without loading it, if ``name`` is its source. Of the files only those
        in ``trusted`` are imported, all by default; another one's stage is a placeholder.

        Raises:
            InputError: the stage is not found, or a setting is unknown, missing or out of range; names every such
                setting.
        """
        settings = dict(table)
        source = settings.pop("name", self.default.name)
        if known is not None and source == known.source():
            cls = known
        elif trusted is not None and isinstance(source, str) and ".py" in source and source not in trusted:
            cls = self._placeholder(source, settings)
        else:
            cls = self.stage_class(source)
        return stage_of(cls, settings, self.shipped)

    def stage_class(self, source: Any) -> type[_Stage]:
        """The class of a shipped name or of ``path/to/file.py:ClassName``. Raises InputError if there is no such class,
        or it violates the contract."""
        noun, key = self.base.room.noun, f"{self.base.room.table}.name"
        if not isinstance(source, str):
            known = f"choose from {', '.join(self.shipped)}"
            raise InputError([Fault(key, f"{source!r} is not the name of any {noun}; {known}")])
        if source in self.shipped:
            return self.shipped[source]
        file, colon, class_name = source.rpartition(":")
        if not colon or not file.endswith(".py"):
            hint = suggestion(source, self.shipped)
            own = f"for your own {noun} give path/to/file.py:ClassName"
            if source.endswith(".py"):
                names = [name for name, cls in users_stages(source, key).items() if issubclass(cls, self.base)]
                raise InputError([Fault(key, f"{source!r} names no class; {give_one(source, names)}")])
            raise InputError([Fault(key, f"no {noun} {source!r}; {hint}; {own}")])
        stages = stages_in(file, key)
        found = {n: cls for n, cls in stages.items() if issubclass(cls, self.base) and cls is not self.base}
        if class_name not in found:
            there = f"its {noun}s are {', '.join(sorted(found))}"
            if not found:
                there = f"it has no class derived from {self.base.__name__}"
            if class_name in stages:
                room = stages[class_name].room
                there = f"it is {'an' if room.noun[0] == 'a' else 'a'} {room.noun}: use {room.table}.name"
            raise InputError([Fault(key, f"no {noun} {class_name!r} in {file}; {there}")])
        cls = found[class_name]
        check_contract(cls, file)
        return cls

    def _placeholder(self, source: str, settings: Mapping[str, Any]) -> type[_Stage]:
        """A placeholder for the stage of a user's file, which is not imported."""
        file, _, label = source.rpartition(":")
        cls: Any = placeholder_stage(self.base, f"{Path(file).name}:{label}", settings, {})
        cls.source = classmethod(lambda _: source)
        return cls

    def settings(self, source: Any) -> list[str] | None:
        """Names of the settings of a stage; None if it can't be found, which is reported when it is loaded."""
        try:
            return [field.name for field in self.stage_class(source).setting_fields()]
        except InputError:
            return None

    def replaced(
        self,
        table: Mapping[str, Any],
        source: Any,
        overrides: Collection[str],
        left_out: list[str],
        known: type[_Stage] | None = None,
        trusted: Container[str] | None = None,
    ) -> dict[str, Any]:
        """The table for the stage ``source``. It has the settings of a table that belongs to it: by its name, or by its
        settings if it has no name. Otherwise it has those that every stage of
        the table has, which belong to the loop: the period, a law's delay. A sentence with the others that no override
        sets is then appended to ``left_out``. ``known`` is the class of the table, if it is loaded already; ``trusted``
        is that of :meth:`load`."""
        if "name" in table:
            belongs = _resolved(table["name"]) == _resolved(source)
        else:
            hidden = trusted is not None and isinstance(source, str) and ".py" in source and source not in trusted
            settings = None if hidden else self.settings(source)
            belongs = settings is None or set(table) <= {*settings}
        if belongs:
            return {**table, "name": source}
        name, old = self.base.room.table, table.get("name", self.default.name)
        new = self.shipped.get(str(source))
        absent = new is not None and not (
            new.runs or "resolved" in vars(new)
        )  # none and ideal have no period, auto has
        of_all = {field.name for field in dataclasses.fields(self.base) if field.kw_only and not absent}
        given = self._beyond_defaults(table, known)
        keys = [key for word in given if word not in of_all and (key := f"{name}.{word}") not in overrides]
        if keys:
            are = f"{', '.join(keys)} {'is' if len(keys) == 1 else 'are'} left out"
            left_out.append(f"{name}.name: {source} takes the place of {old}, so {are}")
        return {"name": source, **{word: table[word] for word in given if word in of_all}}

    def _beyond_defaults(self, table: Mapping[str, Any], known: type[_Stage] | None) -> list[str]:
        """The settings of a table that are not defaults of its stage; all settings of a user's stage whose class is not
        ``known``, or is a placeholder, whose defaults are the recorded settings."""
        settings = [key for key in table if key != "name"]
        source = str(table.get("name", self.default.name))
        cls = self.shipped.get(source)
        if known is not None and known.source() == source and not issubclass(known, Placeholder):
            cls = known
        if cls is None:
            return settings
        given = {f.name: table[f.name] for f in cls.setting_fields() if f.name in table}

        def made(without: str = "") -> _Stage | None:
            try:
                return stage_of(cls, {key: value for key, value in given.items() if key != without})
            except InputError:
                return None

        stage = made()
        return [key for key in settings if key not in given or stage is None or stage != made(key)]


def _resolved(source: Any) -> Any:
    """The source with its file's path resolved: two ways to one file, as through ``..`` or a link, compare equal."""
    if not isinstance(source, str) or ".py:" not in source:
        return source
    file, _, class_name = source.rpartition(":")
    try:
        return Path(file).resolve(), class_name
    except (OSError, ValueError, RuntimeError):  # a loop of links, or no path: the file is refused when it is loaded
        return source


def stage_of(
    cls: type[_Stage], settings: Mapping[str, Any], others: Mapping[str, type[_Stage]] | None = None
) -> _Stage:
    """Make a stage of a class. ``others`` are further stages, by name, which may have a setting that it lacks.

    Raises:
        InputError: a setting is unknown, missing or out of range; names every such setting.
    """
    table, noun = cls.room.table, cls.room.setting
    fields = cls.setting_fields()
    choices = [f.name for f in fields]
    faults = [
        Fault(f"{table}.{key}", f"{cls.label()} has no such {noun}; {_instead(key, choices, table, others or {})}")
        for key in settings
        if key not in choices
    ]
    missing = [
        f.name
        for f in fields
        if f.name not in settings and f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise InputError([*faults, *(Fault(f"{table}.{key}", f"{cls.label()} needs this {noun}") for key in missing)])
    try:
        stage = cls(**{key: value for key, value in settings.items() if key in choices})
    except InputError as error:
        raise InputError([*faults, *error.faults]) from None
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a user's __post_init__ may raise anything, also SystemExit
        raise InputError([*faults, Fault(table, f"{cls.label()}: {error_text(error)}")]) from error
    if faults:
        raise InputError(faults)
    return stage


def _instead(key: str, choices: Collection[str], table: str, others: Mapping[str, type[Stage]]) -> str:
    """What to write in place of a setting that a stage lacks."""
    owners = [name for name, each in others.items() if key in (field.name for field in each.setting_fields())]
    return f"for this one choose {table}.name = {' or '.join(owners)}" if owners else suggestion(key, choices)


def stages_in(file: str, key: str) -> dict[str, type[Stage]]:
    """The classes of stages in a user's file, by name. Raises InputError with this key if it can't be loaded."""
    path = Path(file)
    try:
        is_there, reason = path.is_file(), "" if path.is_absolute() else f" (looked in {Path.cwd()})"
    except OSError as error:
        is_there, reason = False, f" ({error.strerror})"
    if not is_there:
        raise InputError([Fault(key, f"no file {file!r}{reason}")])
    return {
        name: value
        for name, value in vars(load_file(path.absolute(), key)).items()
        if isinstance(value, type) and issubclass(value, Stage) and hasattr(value, "room")
    }


def users_stages(file: str, key: str) -> dict[str, type[Stage]]:
    """Those of :func:`stages_in` that are not of this package."""
    return {name: cls for name, cls in stages_in(file, key).items() if not cls.__module__.startswith("uvms_mj.")}


def give_one(file: str, names: Collection[str]) -> str:
    """What to write in place of a file without a class, by the names of its classes."""
    return f"give {' or '.join(f'{file}:{name}' for name in names or ('ClassName',))}"


_HINTS = {
    "non-frozen dataclass": "decorate with @dataclass(frozen=True)",
    "mutable default <class 'list'>": "a setting is a tuple: write (80.0, ...) in place of [80.0, ...]",
}
"""What to write instead, by a part of the text of Python's exception."""


def load_file(path: Path, key: str) -> ModuleType:
    """Import a user's file anew, with its folder on sys.path for the file's imports."""
    name = f"uvms_mj_stage_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None  # the suffix is .py
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look up their module there
    if str(path.parent) not in sys.path:
        sys.path.insert(0, str(path.parent))
    # Python's byte-code cache misses the second of two edits within a second
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        spec.loader.exec_module(module)
    except BaseException as error:  # the file may raise anything, also SystemExit
        del sys.modules[name]
        if isinstance(error, KeyboardInterrupt):
            raise
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        line = frames[-1].lineno if frames else getattr(error, "lineno", None)
        where = f"{path.name}, line {line}" if line else path.name
        text = error_text(error)
        hint = next((f"; {what}" for sign, what in _HINTS.items() if sign in text), "")
        raise InputError([Fault(key, f"{where}: {text}{hint}")]) from error
    finally:
        sys.dont_write_bytecode = before
    return module


def table_of(stage: Stage) -> dict[str, Any]:
    """The table from which :meth:`Choice.load` makes an equal stage."""
    return {"name": stage.source(), **{f.name: getattr(stage, f.name) for f in dataclasses.fields(stage)}}


class Placeholder:
    """Base of the placeholders for a user's stage in a loaded log. They can be shown and compared, not run."""


def placeholder_stage(
    base: type[_Stage], source: str, table: Mapping[str, Any], states: Mapping[str, Any]
) -> type[_Stage]:
    """Make a placeholder class with the settings of a table of a scenario, and the sizes of its states by name. Raises
    InputError if a setting has another type, or its name is not a Python identifier."""
    room = base.room
    file, _, label = source.rpartition(":")
    if not file or Path(file).name != file or not label.isidentifier() or not isinstance(table, Mapping):
        raise InputError(f"the {room.noun} is {source!r}: must be file.py:ClassName")
    shared = {f.name for f in dataclasses.fields(base)} | {"name"}
    fields = []
    for name, value in table.items():
        if name in shared:
            continue
        kind: Any = tuple[float, ...] if isinstance(value, list | tuple) else type(value)
        if not name.isidentifier() or hasattr(base, name) or kind not in (bool, int, float, tuple[float, ...]):
            wanted = "is not a number, a flag or a list of numbers"
            raise InputError(f"the {room.setting} {room.table}.{name} = {value!r} of {source} {wanted}")
        default = tuple(value) if isinstance(value, list | tuple) else value
        fields.append((name, kind, setting(default, OWN_UNIT, f"{room.setting} of {label}")))
    namespace = {"states": dict(states), "source": classmethod(lambda cls: source), "__doc__": f"{source}, recorded."}
    try:
        return dataclasses.make_dataclass(label, fields, bases=(Placeholder, base), namespace=namespace, frozen=True)
    except (TypeError, SyntaxError) as error:
        raise InputError(f"the {room.setting}s of {source}: {error}") from None


def check_stage(stage: Stage) -> None:
    """Check that a stage may run. Raises InputError if it is of a log, or its class violates the contract."""
    if isinstance(stage, Placeholder):
        key, file = f"{stage.room.table}.name", f"path/to/{stage.source()}"
        raise InputError(
            f"the {stage.room.noun} {stage.source()} is in the log as text, which is never run: name its file with "
            f'scenario.updated({{"{key}": "{file}"}})'
        )
    if not is_shipped(stage):
        check_contract(type(stage))
        if getattr(stage, "uses_truth", False):
            raise InputError([Fault("controller.uses_truth", "is reserved for ideal, the yardstick law")], "scenario")
