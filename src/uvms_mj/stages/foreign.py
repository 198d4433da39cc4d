"""Stages in C or in a library: a class of settings and states from a description, beside machine code of the user's.

A file ``my_law.c`` has the stage's function and ``my_law.toml`` its description; of a library, ``libmy_law.so:NAME``,
``NAME.toml`` beside it is the description. ``uvms_stage.h`` has the records of the stage as C structs: settings,
states, its inputs, and its output. The engine loads the machine code.
"""

import contextlib
import dataclasses
import hashlib
import os
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, StrictBool, TypeAdapter, ValidationError

from ..errors import Fault, InputError, faults_of, suggestion
from ..files import parsed_toml, text_of
from ..quantities import STRICT, Number, of_length, refusing, repeated, unit_of
from .base import ForeignCode, Stage, setting
from .contract import Size, Start, no_numbers
from .signals import OF_JOINTS, OF_THRUSTERS, OWN_UNIT, Signal, record_dtype

C_FILE, SHARED, UNIT = ".c", (".so", ".dylib"), ".fmu"
SUFFIXES = (C_FILE, *SHARED, UNIT)
HEADER = "uvms_stage.h"
"""Name of the file with the records as C structs."""
BASES: dict[str, type[Stage]] = {}
"""The base class of each table of a scenario that names a stage."""


def parted(source: Any) -> tuple[str, str]:
    """File and name of a user's stage, ``path/to/file.py:ClassName`` or ``path/to/file.c``, which has the name of the
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


_NAME = re.compile("[A-Za-z][A-Za-z0-9_]*")
_WORDS_OF_C = """
    auto break case char const continue default do double else enum extern float for goto if inline int long
    register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
    unused linux unix class new delete this template typename namespace alignas alignof and and_eq asm bitand bitor
    bool catch char16_t char32_t compl const_cast constexpr decltype dynamic_cast explicit export false friend mutable
    noexcept not not_eq nullptr operator or or_eq private protected public reinterpret_cast static_assert static_cast
    thread_local throw true try typeid using virtual wchar_t xor xor_eq
"""
"""Words of C and C++ and of the header."""


def is_c_name(word: str) -> bool:
    """Whether a word may name a field or a function in C and C++."""
    return bool(_NAME.fullmatch(word)) and word not in _WORDS_OF_C.split()


CName = Annotated[str, refusing(lambda word: not is_c_name(word), "is no name of a field in C")]


def _floats(value: Any) -> Any:
    """A number, or a tuple for a list of them, as floats; true and false as they are."""
    if isinstance(value, list):
        return tuple(map(float, value))
    return value if isinstance(value, bool) else float(value)


def _no_default(value: Any) -> bool:
    return not isinstance(value, bool) and no_numbers(value)


@dataclasses.dataclass(frozen=True)
class OneSetting:
    """A setting of a description: its default, which also gives its type and its length; unit, meaning and range."""

    default: Annotated[Any, refusing(_no_default, "must be a finite number, a list of them, true or false")]
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
        number = Annotated[Number, Field(ge=self.at_least, gt=self.above, le=self.at_most, lt=self.below)]
        if isinstance(self.default, list):
            n = len(self.default)
            return Annotated[tuple[number, ...], of_length(n), repeated(n)]
        return number


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
    name; of a law, whether it uses s, zeta and tau_nom; the names of further files that it reads; and why the library
    beside it has no such stage, if it has none."""

    stage: str
    summary: str = ""
    settings: dict[CName, OneSetting] = dataclasses.field(default_factory=dict)
    states: dict[CName, OneState] = dataclasses.field(default_factory=dict)
    uses_task: StrictBool = True
    files: list[str] = dataclasses.field(default_factory=list)
    refused: str = ""

    __pydantic_config__ = STRICT

    @classmethod
    def load(cls, path: Path, stages: Collection[str] = BASES) -> "Description":
        """Read a description for one of the ``stages``, tables of a scenario. Raises InputError if the file is missing
        or wrong."""
        try:
            tables = parsed_toml(text_of(path))
        except FileNotFoundError:
            wanted = f"it describes the stage; `uvms-mj new law {path.stem} --language c` writes one"
            raise InputError(f"no file {path.name} in {path.parent}: {wanted}") from None
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: not a description in TOML: {error}") from None
        choices = {"": _keys(cls)}
        for table, kind in (("settings", OneSetting), ("states", OneState)):
            if isinstance(given := tables.get(table), dict):
                choices |= dict.fromkeys((f"{table}.{word}" for word in given), _keys(kind))
        try:
            found = _VALIDATOR.validate_python(tables)
        except ValidationError as error:
            raise InputError(faults_of(error, choices=choices), path.name) from None
        if found.refused:
            raise InputError(f"{path.name}: {found.refused}")
        if found.stage not in stages:
            wrong = f"{found.stage!r} is not a table of a scenario with a stage; {suggestion(found.stage, stages)}"
            raise InputError([Fault("stage", wrong)], path.name)
        if own := sorted(found.settings.keys() & _keys(BASES[found.stage])):
            wrong = f"is a key of every {found.stage}; choose another name"
            raise InputError([Fault(f"settings.{word}", wrong) for word in own], path.name)
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
            "start_values": {key: each.start for key, each in self.states.items() if each.start != 0.0},
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


def _keys(kind: Any) -> list[str]:
    return [field.name for field in dataclasses.fields(kind)]


def stage_class(path: Path, name: str, module: str) -> type[Stage]:
    """The class of a stage in C or in a library, for a module of this name. Raises InputError."""
    if not name.isidentifier() or not name.isascii():
        raise InputError(f"{name!r} is not the name of a C function; give {path.name}:NAME")
    found = Description.load(path.with_name(f"{name}.toml"))
    path = Path(os.path.abspath(path))
    beside = c_sources(path)[1:] if path.suffix == C_FILE else _beside(path)
    files = [f"{name}.toml", *(each.relative_to(path.parent).as_posix() for each in beside), *found.files]
    return found.stage_class(name, module, list(dict.fromkeys(files)))


def described_beside(file: str, stage: str) -> list[str]:
    """The names of the stages for a table of a scenario that descriptions beside a library have."""
    names = []
    for path in sorted(Path(file).parent.glob("*.toml")):
        with contextlib.suppress(OSError, ValueError):
            names += [path.stem] if parsed_toml(text_of(path)).get("stage") == stage else []
    return names


_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*"([^"\n]+)"', re.MULTILINE)


def c_sources(path: Path) -> list[Path]:
    """A C file and the files of its own folder and below that it includes in quotes."""
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


# the records as C structs

_FUNCTIONS = Path(__file__).with_name("uvms_functions.h")
"""Random numbers and attitudes, in C."""
_TYPES = {"f8": "double", "i8": "int64_t", "b1": "unsigned char"}
"""C's types; a flag is one byte, 0 or 1."""


@dataclasses.dataclass(frozen=True)
class Records:
    """The dtypes of a stage's records. ``out`` is a record, or an array of numbers. The record that a stage is given
    may be the beginning of a longer one."""

    settings: np.dtype
    state: np.dtype
    given: np.dtype
    out: np.dtype

    @classmethod
    def of(cls, stage: Stage, counted: int) -> "Records":
        """The records of a stage with so many thrusters or joints."""
        kind, room = type(stage), stage.room
        out = np.dtype(("f8", (counted if room.out[0].shape == (0,) else room.out[0].size,)))
        if room.arguments[-1] == "out":
            shapes = [(s.name, s.kind, (counted,) if s.shape == (0,) else s.shape) for s in room.out]
            out = np.dtype(shapes, align=True)
        given = record_dtype(kind.given(counted))
        return cls(stage.record().dtype, kind.state_record(counted).dtype, given, out)

    def _each(self) -> Iterator[tuple[str, np.dtype]]:
        yield from (("settings", self.settings), ("state", self.state), ("given", self.given), ("out", self.out))

    @property
    def sizes(self) -> tuple[int, ...]:
        """Sizes of settings, state and output [bytes]."""
        return self.settings.itemsize, self.state.itemsize, self.out.itemsize

    @property
    def layout(self) -> int:
        """A number that decides names, types and places of all fields. A header has it, and so has a library that was
        compiled with it."""
        text = [
            f"{record}.{name} {kind.base.kind}{kind.base.itemsize} {kind.shape} {place}"
            for record, dtype in self._each()
            for name, kind, place in _fields(dtype)
        ]
        return int.from_bytes(hashlib.sha256("\n".join([*text, str(self.sizes)]).encode()).digest()[:8], "little") >> 1

    @property
    def counted(self) -> dict[str, int]:
        """Number of thrusters or of joints, if the records depend on it, by the name of its constant."""
        found = {}
        for _, dtype in self._each():
            for name, kind, _ in _fields(dtype):
                for constant, names in (("UVMS_THRUSTERS", OF_THRUSTERS), ("UVMS_JOINTS", OF_JOINTS)):
                    if name in names and kind.shape:
                        found[constant] = kind.shape[0]
        return found


def _fields(dtype: np.dtype) -> list[tuple[str, np.dtype, int]]:
    """Name, type and place of the fields in the order of their places; none of an array."""
    fields: Any = dtype.fields or {}
    return sorted(((name, each[0], each[1]) for name, each in fields.items()), key=lambda each: each[2])


def header(kind: type[Stage], records: Records) -> str:
    """The text of ``uvms_stage.h`` for a stage: its structs, the function and the number that both sides compare."""
    name, room = kind.__name__, kind.room
    given = "signals" if "signals" in room.arguments else "given"
    settings = {field.name: (unit_of(field), field.metadata.get("meaning", "")) for field in kind.setting_fields()}
    states = {name: (kind.units.get(name, ""), "a state") for name in kind.states}
    structs = {
        "settings": (records.settings, settings),
        "state": (records.state, states | dict.fromkeys(kind.memory, ("", "kept"))),
        given: (records.given, _notes(kind.given(1))),
    }
    called = dict(zip(("settings", "state", given, "state_dot", "out"), room.arguments, strict=True))
    sizes = [f"sizeof(struct {key})" if structs[key][0].itemsize else "0" for key in ("settings", "state")]
    if records.out.names:
        structs["out"] = records.out, _notes(room.out)
        output, number = f"struct out *{called['out']}", f"all of {', '.join(records.out.names)}"
        sizes.append("sizeof(struct out)")
    else:
        output, number = f"double *{called['out']}", f"all {records.out.itemsize // 8} numbers of its output"
        sizes.append(str(records.out.itemsize))
    text = "\n".join(_struct(key, *each) for key, each in structs.items())
    constants = "".join(f"#define {key} {value}\n" for key, value in records.counted.items())
    return f"""/* The records of the {room.noun} {name}, in SI units, for a stage of uvms-mj.

   uvms-mj writes this file from {name}.toml: `uvms-mj new header {name}.toml` writes it anew. A run compiles {name}.c
   with records of its own; a library that was compiled with other records is refused by its number. */
#ifndef UVMS_STAGE_H
#define UVMS_STAGE_H

#include <math.h>
#include <stdint.h>

{constants}{text}
{_FUNCTIONS.read_text(encoding="utf-8")}
#ifdef __cplusplus
extern "C" {{
#endif

/* The function of the stage. It sets {number} and the derivatives of its states; it may set its states too.
   It returns 0, or a number of its own that ends the run. */
__attribute__((visibility("default")))
int {name}(const struct settings *{called["settings"]}, struct state *{called["state"]},
    const struct {given} *{called[given]}, struct state *{called["state_dot"]}, {output});

/* The number of these records, and their sizes in bytes. */
extern __attribute__((visibility("default"), weak)) const uint64_t {name}_records[4];
const uint64_t {name}_records[4] = {{
    UINT64_C({records.layout}), {", ".join(sizes)}
}};

#ifdef __cplusplus
}}
#endif

#endif
"""


def _notes(signals: tuple[Signal, ...]) -> dict[str, tuple[str, str]]:
    return {s.name: (s.unit, s.meaning if s.frame == "-" else f"{s.meaning}, in {s.frame}") for s in signals}


def _struct(name: str, dtype: np.dtype, notes: Mapping[str, tuple[str, str]]) -> str:
    """A struct with the fields at their places: gaps are filled."""
    if not dtype.itemsize:
        return f"struct {name}; /* empty */\n"
    lines, end = [], 0

    def fill(until: int) -> None:
        if until > end:
            lines.append(f"    unsigned char gap_{end}[{until - end}];")

    for field, kind, place in _fields(dtype):
        fill(place)
        called = field if field != "_" else "unused"
        shape = "".join(f"[{n}]" for n in kind.shape)
        unit, meaning = notes.get(field, ("", ""))
        note = f"{f'[{unit}]' if unit else ''} {meaning}".strip().replace("*/", "* /")
        declared = f"    {_TYPES[kind.base.str[1:]]} {called}{shape};"
        lines.append(f"{declared:<36}{f' /* {note} */' if note else ''}".rstrip())
        end = place + kind.itemsize
    if name in ("settings", "state", "out"):
        fill(dtype.itemsize)
    body = "\n".join(lines)
    return f"struct {name} {{\n{body}\n}};\n"
