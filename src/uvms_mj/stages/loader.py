"""Loading of stages: a shipped class by its name, a user's class from a file, or its placeholder in a loaded log."""

import dataclasses
import difflib
import functools
import traceback
from collections.abc import Collection, Container, Mapping, Sequence
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, Generic, TypeVar

from ..errors import Fault, InputError, error_text, suggestion
from . import fmu, foreign
from .base import Stage, setting
from .contract import check_contract, take_checks
from .foreign import BASES, SHARED, SUFFIXES, UNIT, described_beside, parted
from .namespace import Namespace, is_same_code, namespace_of, without_names
from .signals import OWN_UNIT

_Stage = TypeVar("_Stage", bound=Stage)
USERS = "path/to/file.py:ClassName, path/to/file.c or path/to/library.so:NAME"
"""How a user's stage is named."""


@dataclasses.dataclass(frozen=True)
class Choice(Generic[_Stage]):
    """The stages to choose from in a table of a scenario; ``default`` is the stage of a table without a name."""

    base: type[_Stage]
    shipped: Mapping[str, type[_Stage]]
    default: type[_Stage]

    def __post_init__(self) -> None:
        BASES[self.base.room.table] = self.base

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
        elif trusted is not None and parted(source)[0] and source not in trusted:
            cls = self._placeholder(source, settings)
        else:
            cls = self.stage_class(source)
        return stage_of(cls, settings, self.shipped)

    def again(self, stage: _Stage, namespaces: dict[Path, Namespace]) -> _Stage:
        """A stage of a user's file with its class loaded anew, into the namespace of its folder. Raises InputError as
        :meth:`load` does."""
        cls: Any = type(stage)
        own = namespace_of(cls)
        if own is None:
            return stage
        namespace = namespaces.setdefault(own.folder, Namespace(own.folder, own.unpickled))
        return stage_of(self.stage_class(stage.source(), namespace, cls), settings_of(stage), self.shipped)

    def stage_class(
        self, source: Any, namespace: Namespace | None = None, before: type[_Stage] | None = None
    ) -> type[_Stage]:
        """The class of a shipped name or of ``path/to/file.py:ClassName``, loaded into a namespace, by default one of
        its own. ``before`` is the class that was loaded earlier. Raises InputError if there is no such class, or it
        violates the contract."""
        noun, key = self.base.room.noun, f"{self.base.room.table}.name"
        if not isinstance(source, str):
            known = f"choose from {', '.join(self.shipped)}" if self.shipped else f"give {USERS}"
            raise InputError([Fault(key, f"{source!r} is not the name of any {noun}; {known}")])
        if source in self.shipped:
            return self.shipped[source]
        file, class_name = parted(source)
        if not class_name:
            hint = f"{suggestion(source, self.shipped)}; " if self.shipped else ""
            own = f"{hint}for your own {noun} give {USERS}"
            if file.endswith(SHARED):
                names = described_beside(file, self.base.room.table) or ["NAME"]
                raise InputError([Fault(key, f"{source!r} names no function; give {source}:{' or :'.join(names)}")])
            if file:
                names = [name for name, cls in users_stages(source, key).items() if issubclass(cls, self.base)]
                raise InputError([Fault(key, f"{source!r} names no class; {give_one(source, names)}")])
            raise InputError([Fault(key, f"no {noun} {source!r}; {own}")])
        stages = stages_in(file, key, class_name, namespace)
        found = {n: cls for n, cls in stages.items() if issubclass(cls, self.base) and cls is not self.base}
        if class_name not in found:
            there = f"its {noun}s are {', '.join(sorted(found))}"
            if not found:
                there = f"it has no class derived from {self.base.__name__}"
            if class_name in stages:
                room = stages[class_name].room
                there = f"it is {'an' if room.noun[0] in 'aeiou' else 'a'} {room.noun}: use {room.name_key}"
            raise InputError([Fault(key, f"no {noun} {class_name!r} in {file}; {there}")])
        cls = found[class_name]
        if before is not None and is_same_code(cls, before):
            take_checks(cls, before)
        check_contract(cls, file)
        return cls

    def _placeholder(self, source: str, settings: Mapping[str, Any]) -> type[_Stage]:
        """A placeholder for the stage of a user's file, which is not imported."""
        file, label = parted(source)
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
        settings if it has no name. Otherwise it has the settings that every stage of the table has, which belong to the
        loop: the period, a law's delay. A sentence with the others that no override sets is then appended to
        ``left_out``. ``known`` is the class of the table, if it is loaded already; ``trusted`` is as for
        :meth:`load`."""
        if "name" in table:
            belongs = _resolved(table["name"]) == _resolved(source)
        else:
            hidden = trusted is not None and parted(source)[0] and source not in trusted
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
        if known is not None and known.source() == source and not known.of_log:
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
    file, class_name = parted(source)
    if not class_name:
        return source
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
    """The advice about a setting that a stage lacks."""
    owners = [name for name, each in others.items() if key in (field.name for field in each.setting_fields())]
    return f"for this one choose {table}.name = {' or '.join(owners)}" if owners else suggestion(key, choices)


def stages_in(file: str, key: str, name: str = "", namespace: Namespace | None = None) -> dict[str, type[Stage]]:
    """The classes of stages in a user's file, by name; of a library, the class of the function ``name``. Raises
    InputError with this key if it can't be loaded."""
    path = Path(file)
    try:
        is_there, reason = path.is_file(), "" if path.is_absolute() else f" (looked in {Path.cwd()})"
    except OSError as error:
        is_there, reason = False, f" ({error.strerror})"
    if not is_there:
        raise InputError([Fault(key, f"no file {file!r}{reason}")])
    return {
        name: value
        for name, value in vars(load_file(path.absolute(), key, name, namespace)).items()
        if isinstance(value, type) and issubclass(value, Stage) and hasattr(value, "room")
    }


def users_stages(file: str, key: str, name: str = "") -> dict[str, type[Stage]]:
    """The classes of :func:`stages_in` from outside this package."""
    return {name: cls for name, cls in stages_in(file, key, name).items() if not cls.__module__.startswith("uvms_mj.")}


def give_one(file: str, names: Collection[str]) -> str:
    """The advice about a file without a class, by the names of its classes."""
    return f"give {' or '.join(f'{file}:{name}' for name in names or ('ClassName',))}"


_HINTS = {
    "non-frozen dataclass": "decorate with @dataclass(frozen=True)",
    "mutable default <class 'list'>": "a setting is a tuple: write (80.0, ...) in place of [80.0, ...]",
}
"""The advice by a part of the text of Python's exception."""


def load_file(path: Path, key: str, function: str = "", namespace: Namespace | None = None) -> ModuleType:
    """Load a user's file anew, with the modules beside it, into a namespace, by default one of its own; of C and of a
    library, make a module with the class of a function. Raises InputError with this key."""
    namespace = namespace or Namespace(path.parent, loaded)
    if path.suffix != ".py":
        function = function or path.stem
        name = f"{namespace.name}.{path.stem.replace('.', '_')}_{function}"
        try:
            if path.suffix == UNIT:  # it does not say for which table it is
                kind = fmu.stage_class(path, BASES.get(key.partition(".")[0], BASES["controller"]), name)
            else:
                kind = foreign.stage_class(path, function, name)
        except InputError as error:
            raise InputError([Fault(key, str(error))]) from None
        module = ModuleType(name)
        module.__file__ = str(path)
        setattr(module, function, kind)
        kind._namespace = namespace  # a class in Python has it by its functions' names
        namespace.add(module)
        return module
    try:
        return namespace.load(path)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # the file may raise anything, also SystemExit
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        line = frames[-1].lineno if frames else getattr(error, "lineno", None)
        where = f"{path.name}, line {line}" if line else path.name
        text = without_names(error_text(error))
        hint = next((f"; {what}" for sign, what in _HINTS.items() if sign in text), "")
        raise InputError([Fault(key, f"{where}: {text}{hint}")]) from error


def functions_again(kinds: Sequence[type[Stage]]) -> list[FunctionType]:
    """The functions of classes of stages, each with its module's code executed again where it is of a user's file: what
    the modules have kept is not in them. Raises InputError if a file raises now."""
    namespaces: dict[str, Namespace] = {}
    found = []
    for kind in kinds:
        if (own := namespace_of(kind)) is not None:
            namespace = namespaces.setdefault(own.name, own.again())
            file, name = parted(kind.source())
            kind = vars(load_file(Path(file), f"{kind.room.table}.name", name, namespace))[name]
        found.append(kind.function())
    return found


def stage_keeps(stage: Stage) -> str:
    """A note on a stage in plain Python with something that lives on from run to run, whatever is loaded anew; empty
    for one without it, and for one in C or in a library, of which each run has a copy."""
    kind = type(stage)
    if kind.file_suffix() in SUFFIXES:
        return ""
    label, namespace = stage.label(), namespace_of(kind)
    if namespace is None:
        own = f"give it as {give_one('file.py', [kind.__name__]).removeprefix('give ')}"
        return f"{label} is a class of this session: what it keeps outside of state lives on from run to run; {own}"
    if outside := namespace.outside():
        names, those = ", ".join(outside), "they keep" if len(outside) > 1 else "it keeps"
        return f"{label} uses {names}, which a process loads once: what {those} lives on from run to run"
    return ""


def loaded(table: str, source: str, settings: Mapping[str, Any]) -> Stage:
    """The stage of a user's file for a table of a scenario, as it is unpickled. Raises InputError as
    :meth:`Choice.load` does."""
    file, name = parted(source)
    return stage_of(stages_in(file, f"{table}.name", name)[name], settings)


def settings_of(stage: Stage) -> dict[str, Any]:
    """The settings of a stage by name."""
    return {f.name: getattr(stage, f.name) for f in dataclasses.fields(stage)}


def table_of(stage: Stage) -> dict[str, Any]:
    """The table from which :meth:`Choice.load` makes an equal stage."""
    return {"name": stage.source(), **settings_of(stage)}


def placeholder_stage(
    base: type[_Stage], source: str, table: Mapping[str, Any], states: Mapping[str, Any], called: str = ""
) -> type[_Stage]:
    """Make a class that can be shown and compared, not run: with the settings of a table of a scenario, which is
    ``called`` so there, and the sizes of its states by name. Raises InputError if a setting has another type, or its
    name is not a Python identifier."""
    room = base.room
    file, _, label = source.rpartition(":")
    if not file or Path(file).name != file or not label.isidentifier() or not isinstance(table, Mapping):
        raise InputError(f"the {room.noun} is {source!r}: must be file.py:ClassName")
    shared = {f.name for f in dataclasses.fields(base)} | {"name"}
    fields = []
    for name, value in table.items():
        if name in shared:
            continue
        if isinstance(value, Mapping) and all(isinstance(each, str) for each in value.values()):  # names of an FMU
            factory: Any = functools.partial(dict, value)
            metadata = {"unit": OWN_UNIT, "meaning": f"{room.setting} of {label}"}
            fields.append((name, Mapping[str, str], dataclasses.field(default_factory=factory, metadata=metadata)))
            continue
        kind: Any = tuple[float, ...] if isinstance(value, list | tuple) else type(value)
        if not name.isidentifier() or hasattr(base, name) or kind not in (bool, int, float, tuple[float, ...]):
            wanted = "is not a number, a flag or a list of numbers"
            raise InputError(f"the {room.setting} {room.table}.{name} = {value!r} of {source} {wanted}")
        default = tuple(value) if isinstance(value, list | tuple) else value
        fields.append((name, kind, setting(default, OWN_UNIT, f"{room.setting} of {label}")))
    key, path = f"{called or room.table}.name", f"path/to/{source}"
    wrong = (
        f"the {room.noun} {source} is in the log as text, which is never run: name its file with "
        f'scenario.updated({{"{key}": "{path}"}})'
    )
    namespace = {
        "of_log": True,
        "faults": lambda self, setup: [Fault("", wrong)],
        "constants": lambda self, setup: {},
        "states": dict(states),
        "source": classmethod(lambda cls: source),
        "__doc__": f"{source}, recorded.",
    }
    try:
        return dataclasses.make_dataclass(label, fields, bases=(base,), namespace=namespace, frozen=True)
    except (TypeError, SyntaxError) as error:
        raise InputError(f"the {room.setting}s of {source}: {error}") from None


# keys that a scenario does not have: the key that was meant


def tables_by_word(choices: Mapping[str, Choice]) -> dict[str, str]:
    """The table of each word for a stage: the name of its room, its noun, and the room's further words."""
    found: dict[str, str] = {}
    for table, choice in choices.items():
        room = choice.base.room
        for word in (room.name, room.noun, *room.words):
            found |= {each: found.get(each, table) for each in (word, f"{word}s")}
    return found


def no_table(table: str, word: str, known: Collection[str], choices: Mapping[str, Choice]) -> str:
    """The error of the key ``table.word``, whose table a scenario does not have; ``known`` are its tables."""
    meant = tables_by_word(choices).get(table)
    if meant and choices[meant].base.room.several:
        return f"no table {table!r}; the list is called {meant}: {choices[meant].base.room.name_key}"
    return f"no table {table!r}; {_called(meant, word) if meant else suggestion(table, known)}"


def is_a_table(table: str, value: Any, keys: Collection[str], choice: Choice | None) -> str:
    """The error of a table that is given a value, by its keys and its choice of stages."""
    if choice is not None and isinstance(value, str):
        return f"is a table; {table}.name={value} chooses the {choice.base.room.noun}"
    known = keys if choice is None else ("name", *keys)
    return f"is a table; its keys are {', '.join(f'{table}.{key}' for key in known)}"


def not_dotted(
    word: str, value: Any, keys: Mapping[str, Collection[str]], choices: Mapping[str, Choice], tables: Mapping[str, Any]
) -> str:
    """The error of a key without a dot that is no key of the scenario. ``keys`` are the keys of each table without
    its stage's name, and ``tables`` are the tables of the scenario, by their names."""
    if (table := tables_by_word(choices).get(word)) is not None:
        return f"is not a dotted key; {_called(table, 'name')}{f'={value}' if isinstance(value, str) else ''}"
    in_use = {}
    for t, choice in choices.items():
        table = tables[t]
        source = table.source() if isinstance(table, Stage) else table.get("name", choice.default.name)
        in_use[t] = choice.settings(source) or ()
    meant = [f"{t}.{word}" for t, known in {**keys, **in_use}.items() if t and word in known]
    of_the_law = [f"controller.{word}"] if not meant and word not in keys else []
    close = difflib.get_close_matches(word, [f"{t}.{key}" for t, known in keys.items() if t for key in known], 1)
    hint = " or ".join(repr(m) for m in meant or close or of_the_law)
    return f"is not a dotted key{f'; did you mean {hint}?' if hint else ''}"


def _called(table: str, word: str) -> str:
    return f"the table is called {table}: {table}.{word}"
