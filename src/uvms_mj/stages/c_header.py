"""The records of a stage as C structs: settings, states, what it is given, and its output."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..quantities import unit_of
from .base import Stage
from .signals import OF_JOINTS, OF_THRUSTERS, Signal, record_dtype

_FUNCTIONS = Path(__file__).with_name("uvms_functions.h")
"""Random numbers and attitudes, in C."""
_TYPES = {"f8": "double", "i8": "int64_t", "b1": "unsigned char"}
"""C's types; a flag is one byte, 0 or 1."""


@dataclass(frozen=True)
class Records:
    """The dtypes of a stage's records. ``out`` is a record, or an array of numbers. What a stage is given may be the
    beginning of a longer record."""

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
    states = {
        key: (kind.units.get(key, ""), "a state" if key in kind.states else "kept")
        for key in kind.state_record(1).dtype.names or ()
    }
    notes = {
        "settings": settings,
        "state": states,
        given: _notes(kind.given(1)),
        "out": _notes(room.out),
    }
    structs = {"settings": records.settings, "state": records.state, given: records.given}
    called = dict(zip(("settings", "state", given, "state_dot", "out"), room.arguments, strict=True))
    output = f"double *{called['out']}"
    if records.out.names:
        structs["out"] = records.out
        output = f"struct out *{called['out']}"
    text = "\n".join(_struct(key, dtype, notes[key]) for key, dtype in structs.items())
    constants = "".join(f"#define {key} {value}\n" for key, value in records.counted.items())
    has = [structs.get(key, np.dtype("f8")).itemsize for key in ("settings", "state")]
    sizes = [f"sizeof(struct {key})" if size else "0" for key, size in zip(("settings", "state"), has, strict=True)]
    sizes.append("sizeof(struct out)" if records.out.names else str(records.out.itemsize))
    number = _numbers_of_out(records.out)
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
    frame = {signal.name: f", in {signal.frame}" if signal.frame != "-" else "" for signal in signals}
    return {signal.name: (signal.unit, f"{signal.meaning}{frame[signal.name]}") for signal in signals}


def _numbers_of_out(out: np.dtype) -> str:
    return f"all of {', '.join(out.names)}" if out.names else f"all {out.itemsize // 8} numbers of its output"


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
