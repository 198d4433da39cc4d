"""The symbols and the sizes of an object in ELF, which a linker takes, for a processor with 32 or 64 bits, in little
endian."""

import re
import struct
from collections.abc import Iterator
from typing import NamedTuple


def undefined(code: bytes) -> tuple[str, ...]:
    """The symbols that an object uses and does not define."""
    return tuple(sorted({each.name for each in _symbols(code) if each.section == 0 and each.name}))


def defined(code: bytes) -> tuple[str, ...]:
    """The symbols that an object defines."""
    return tuple(sorted({each.name for each in _symbols(code) if each.section and each.name}))


def kept_apart(code: bytes) -> list[str]:
    """The variables of an object that a program could change. Constants with addresses can't be: they are written when
    a program is loaded."""
    sections = _sections(code)
    named = {k for k, each in enumerate(sections) if each.flags & 1 and not each.name.startswith(".data.rel.ro")}
    found = {each.name for each in _symbols(code) if each.variable and (each.section in named or each.common)}
    return sorted({re.sub(r"\.\d+$", "", each).rpartition(".")[2] for each in found})  # function.variable.number


def shown(code: bytes) -> list[str]:
    """The symbols of an object that other objects see."""
    return sorted({each.name for each in _symbols(code) if each.section and each.shown})


def sizes(code: bytes) -> tuple[int, int, int]:
    """The bytes of an object's code, of its constants and of its variables."""
    held = [(each.flags, each.size) for each in _sections(code) if each.flags & 2]
    runs, changes = sum(n for flags, n in held if flags & 4), sum(n for flags, n in held if flags & 1)
    return runs, sum(n for _, n in held) - runs - changes, changes


class _Section(NamedTuple):
    kind: int
    flags: int
    size: int
    offset: int
    link: int
    name: str


class _Symbol(NamedTuple):
    """A symbol of an ELF object. Section 0 is none; ``common``: a variable that the linker places; ``shown``: other
    objects see it."""

    section: int
    name: str
    variable: bool
    common: bool
    shown: bool


def _text_at(code: bytes, at: int) -> str:
    return code[at : code.index(b"\0", at)].decode()


def _sections(code: bytes) -> list[_Section]:
    """The sections of an ELF object in little endian."""
    wide = code[4] == 2
    at, step, count, names = (
        (*struct.unpack_from("<Q", code, 40), *struct.unpack_from("<HHH", code, 58))
        if wide
        else (*struct.unpack_from("<I", code, 32), *struct.unpack_from("<HHH", code, 46))
    )
    found = [struct.unpack_from("<IIQQQQI" if wide else "<IIIIIII", code, at + k * step) for k in range(count)]
    texts = found[names][4] if found else 0
    return [
        _Section(kind, flags, size, offset, link, _text_at(code, texts + name))
        for name, kind, flags, _, offset, size, link in found
    ]


def _symbols(code: bytes) -> Iterator[_Symbol]:
    wide, sections = code[4] == 2, _sections(code)
    for table in sections:
        if table.kind != 2:
            continue
        names = sections[table.link].offset
        for at in range(table.offset, table.offset + table.size, 24 if wide else 16):
            name = struct.unpack_from("<I", code, at)[0]
            (info,) = struct.unpack_from("<B", code, at + (4 if wide else 12))
            (section,) = struct.unpack_from("<H", code, at + (6 if wide else 14))
            variable = info & 15 in (1, 6)  # of each thread, too
            yield _Symbol(section, _text_at(code, names + name), variable, section == 0xFFF2, info >> 4 != 0)
