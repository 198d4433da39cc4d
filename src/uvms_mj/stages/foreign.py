"""Stages in C or in a library: a class of settings and states from a description, beside machine code of the user's.

A file ``my_law.c`` has the stage's function and ``my_law.toml`` its description; of a library, ``libmy_law.so:NAME``,
``NAME.toml`` beside it is the description. :mod:`.c_header` writes the records as C structs, and the engine loads the
machine code.
"""

import dataclasses
import functools
import math
import operator
import os
import re
import sys
import types
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError

from ..errors import Fault, InputError, faults_of, suggestion
from ..files import parsed_toml, text_of
from ..quantities import STRICT, Number, of_length, refusing, repeated
from . import fmu
from .base import ForeignCode, Stage, setting
from .signals import OWN_UNIT

C_FILE, SHARED, UNIT = ".c", (".so", ".dylib"), ".fmu"
SUFFIXES = (C_FILE, *SHARED, UNIT)
HEADER = "uvms_stage.h"
"""Name of the file with the records as C structs."""
BASES: dict[str, type[Stage]] = {}
"""The base class of each table of a scenario that names a stage."""


def parted(source: Any) -> tuple[str, str]:
    """File and name of a user's stage, ``path/to/file.py:ClassName`` or ``path/to/file.c``, whose name is that of the
    file; two empty texts for a text of another kind."""
    if not isinstance(source, str):
        return "", ""
    file, colon, name = source.rpartition(":")
    if not colon or Path(name).suffix in (".py", *SUFFIXES):
        file, name = source, ""
    suffix = Path(file).suffix
    if suffix not in (".py", *SUFFIXES):
        return "", ""
    return file, name or (Path(file).stem if suffix in (C_FILE, UNIT) else "")


def suffix_of(kind: type[Stage]) -> str:
    """The suffix of the file with a stage's machine code; empty for a stage in Python."""
    suffix = Path(kind.source().rpartition(":")[0]).suffix
    return suffix if suffix in SUFFIXES else ""


_MOST = 10_000


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _no_default(value: Any) -> bool:
    return not (isinstance(value, bool) or _is_number(value) or (_is_list(value) and value))


def _is_list(value: Any) -> bool:
    return isinstance(value, list) and all(map(_is_number, value))


def _no_size(value: Any) -> bool:
    return value not in ("thrusters", "joints") and not (type(value) is int and 1 <= value <= _MOST)


def _floats(value: Any) -> Any:
    """A number, or a tuple for a list of them, as floats; true and false as they are."""
    if isinstance(value, list):
        return tuple(map(float, value))
    return value if isinstance(value, bool) else float(value)


Default = Annotated[Any, refusing(_no_default, "must be a finite number, a list of them, true or false")]
Size = Annotated[Any, refusing(_no_size, f'must be a whole number from 1 to {_MOST}, "thrusters" or "joints"')]
Start = Annotated[
    Any, refusing(lambda each: not (_is_number(each) or _is_list(each)), "must be a finite number or a list of them")
]


@dataclasses.dataclass(frozen=True)
class OneSetting:
    """A setting of a description: its default, which also gives its type and its length; unit, meaning and range."""

    default: Default
    unit: str = OWN_UNIT
    meaning: str = ""
    at_least: Number | None = None
    above: Number | None = None
    at_most: Number | None = None
    below: Number | None = None

    __pydantic_config__ = STRICT

    @property
    def annotation(self) -> Any:
        """The type of the field."""
        if isinstance(self.default, bool):
            return bool
        checks = [*self._checks()]
        if isinstance(self.default, list):
            n = len(self.default)
            return Annotated[tuple[Number, ...], of_length(n), *checks, repeated(n)]
        return Annotated[Number, *checks] if checks else Number

    def _checks(self) -> Iterator[AfterValidator | Any]:
        """The validators of the range."""
        limits: tuple[tuple[str, float | None, Callable[[float, float], bool]], ...] = (
            ("at least", self.at_least, operator.ge),
            ("greater than", self.above, operator.gt),
            ("at most", self.at_most, operator.le),
            ("less than", self.below, operator.lt),
        )
        for words, limit, holds in limits:
            if limit is not None:
                text = f"must be {words} {limit:g} {self.unit if self.unit != OWN_UNIT else ''}".rstrip()
                yield refusing(functools.partial(_breaks, holds, limit), text)


def _breaks(holds: Callable[[float, float], bool], limit: float, value: float | tuple[float, ...]) -> bool:
    """Whether a number, or one of several, is not within a limit."""
    return not all(holds(each, limit) for each in (value if isinstance(value, tuple) else (value,)))


@dataclasses.dataclass(frozen=True)
class OneState:
    """A state of a description: its size, unit and start value. One that is not advanced is memory."""

    size: Size = 1
    unit: str = ""
    start: Start = 0.0
    advanced: bool = True

    __pydantic_config__ = STRICT


@dataclasses.dataclass(frozen=True)
class Description:
    """The description of a stage: the table of a scenario that it is for, a sentence, its settings and its states by
    name; of a law, whether it uses s, zeta and tau_nom; and the names of further files that it reads."""

    stage: str
    summary: str = ""
    settings: Mapping[str, OneSetting] = dataclasses.field(default_factory=dict)
    states: Mapping[str, OneState] = dataclasses.field(default_factory=dict)
    uses_task: Annotated[bool, Field(strict=True)] = True
    files: list[str] = dataclasses.field(default_factory=list)

    __pydantic_config__ = STRICT

    @classmethod
    def load(cls, path: Path, stages: Collection[str] = BASES) -> "Description":
        """Read a description for one of the ``stages``, tables of a scenario. Raises InputError if the file is missing
        or wrong."""
        try:
            tables = parsed_toml(text_of(path))
        except FileNotFoundError:
            wanted = (
                f"it describes the stage's settings and states; `uvms-mj new law {path.stem} --language c` writes one"
            )
            raise InputError(f"no file {path.name} in {path.parent}: {wanted}") from None
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: not a description in TOML: {error}") from None
        names = {kind: [f.name for f in dataclasses.fields(kind)] for kind in (cls, OneSetting, OneState)}
        choices = {"": names[cls]}
        for table, kind in (("settings", OneSetting), ("states", OneState)):
            given = tables.get(table, {})
            words = list(given) if isinstance(given, dict) else []
            choices |= {f"{table}.{word}": names[kind] for word in words}
            if wrong := [word for word in words if not is_c_name(word)]:
                raise InputError([Fault(f"{table}.{word}", "is no name of a field in C") for word in wrong], path.name)
        try:
            found = _VALIDATOR.validate_python(tables)
        except ValidationError as error:
            raise InputError(faults_of(error, choices=choices), path.name) from None
        if found.stage not in stages:
            hint = suggestion(found.stage, stages)
            raise InputError(
                [Fault("stage", f"{found.stage!r} is not a table of a scenario with a stage; {hint}")], path.name
            )
        own = {field.name for field in dataclasses.fields(BASES[found.stage])} & found.settings.keys()
        if own:
            faults = [
                Fault(f"settings.{word}", f"is a key of every {found.stage}; choose another name") for word in own
            ]
            raise InputError(sorted(faults, key=str), path.name)
        return found

    def stage_class(self, name: str, module: str, files: list[str]) -> type[Stage]:
        """The class of the stage."""
        base = BASES[self.stage]

        def function(*arguments: Any) -> None:
            raise ForeignCode(f"{name} is machine code, which Python does not call")

        states = {key: each for key, each in self.states.items() if each.advanced}
        members: dict[str, Any] = {
            "states": {key: each.size for key, each in states.items()},
            "memory": {key: each.size for key, each in self.states.items() if not each.advanced},
            "units": {key: each.unit for key, each in states.items() if each.unit},
            "start_values": {key: _floats(each.start) for key, each in self.states.items() if each.start != 0.0},
            "files": files,
            base.room.method: staticmethod(function),
            "__doc__": self.summary or f"{name}.",
        }
        if hasattr(base, "uses_task"):
            members["uses_task"] = self.uses_task
        fields = []
        for key, each in self.settings.items():
            fields.append((key, each.annotation, setting(_floats(each.default), each.unit, each.meaning)))
        try:
            kind = dataclasses.make_dataclass(name, fields, bases=(base,), namespace=members, frozen=True)
        except (TypeError, SyntaxError) as error:
            raise InputError(f"{name}.toml: {error}") from None
        kind.__module__ = module
        return kind


_VALIDATOR = TypeAdapter(Description)
_NAME = re.compile("[A-Za-z][A-Za-z0-9_]*")
_WORDS_OF_C = {
    *(
        "auto",
        "break",
        "case",
        "char",
        "const",
        "continue",
        "default",
        "do",
        "double",
        "else",
        "enum",
        "extern",
        "float",
        "for",
    ),
    *(
        "goto",
        "if",
        "inline",
        "int",
        "long",
        "register",
        "restrict",
        "return",
        "short",
        "signed",
        "sizeof",
        "static",
        "struct",
        "switch",
    ),
    *(
        "typedef",
        "union",
        "unsigned",
        "void",
        "volatile",
        "while",
        "unused",
        "linux",
        "unix",
        "class",
        "new",
        "delete",
        "this",
        "template",
    ),
    *("typename", "namespace"),
}
"""Words of C and C++ and of the header."""


def is_c_name(word: str) -> bool:
    """Whether a word may name a field or a function in C and C++."""
    return bool(_NAME.fullmatch(word)) and word not in _WORDS_OF_C


def load_foreign(path: Path, name: str, table: str, module: types.ModuleType) -> None:
    """Set the class of a stage in C, in a library or in an FMU in a new module with this file. Raises InputError."""
    if path.suffix == UNIT:
        setattr(module, name, fmu.stage_class(fmu.read(path, BASES[table]), BASES[table], module.__name__))
        return
    folder, own = path.parent, path if path.suffix == C_FILE else path.with_name(f"{name}.c")
    if not name.isidentifier() or not name.isascii():
        raise InputError(f"{name!r} is not the name of a C function; give {path.name}:NAME")
    found = Description.load(folder / f"{name}.toml")
    found_in = c_sources(own)[1:] if path.suffix == C_FILE else _beside(Path(os.path.abspath(path)))
    included = [each.relative_to(os.path.abspath(folder)).as_posix() for each in found_in]
    files = [f"{name}.toml", *included, *found.files]
    setattr(module, name, found.stage_class(name, module.__name__, list(dict.fromkeys(files))))


_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*"([^"\n]+)"', re.MULTILINE)


def c_sources(path: Path) -> list[Path]:
    """A C file and the files that it includes in quotes, those of its own folder and below."""
    found: dict[Path, None] = {}
    path = Path(os.path.abspath(path))
    todo, root = [path], path.parent
    while todo:
        here = todo.pop()
        if here in found or here.name == HEADER or not here.is_file() or not here.is_relative_to(root):
            continue
        found[here] = None
        todo += [
            Path(os.path.abspath(here.parent / name)) for name in _INCLUDE.findall(here.read_text(errors="replace"))
        ]
    return list(found)


def _beside(path: Path) -> list[Path]:
    """The libraries beside a library that it, or one of them, names."""
    found: dict[Path, None] = {}
    todo, others = [path], [each for each in path.parent.iterdir() if ".so" in each.suffixes or each.suffix in SHARED]
    while todo:
        data = todo.pop().read_bytes()
        new = [each for each in others if each not in found and each != path and os.fsencode(each.name) in data]
        found |= dict.fromkeys(new)
        todo += new
    return list(found)


def module_for(path: Path, name: str, table: str, module_name: str) -> types.ModuleType:
    """The module of a stage in C, in a library or in an FMU, which does not say for which table it is. Raises
    InputError."""
    module = types.ModuleType(module_name)
    module.__file__ = str(path)
    sys.modules[module_name] = module
    try:
        load_foreign(path, name, table, module)
    except BaseException:
        del sys.modules[module_name]
        raise
    return module
