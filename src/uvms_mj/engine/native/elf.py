"""Copies of libraries, each with static data of its own.

The loader of Linux shares more between two copies of a library than their users expect: the symbols that g++ marks as
unique in the process, among them static data of templates and of inline functions, and the libraries that it finds by
their names. In a copy these symbols are weak ones, as ``-fno-gnu-unique`` makes them, and the libraries beside it are
copies as well, under names of their own. Where a library calls ``_exit``, its copy calls ``exit``, which can be named.
"""

import secrets
import string
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

_UNIQUE, _WEAK = 10, 2
_NEEDED, _SONAME, _RPATH, _RUNPATH = 1, 14, 15, 29
_HASH, _STRTAB, _SYMTAB, _GNU_HASH = 4, 5, 6, 0x6FFFFEF5
_OTHER = 3
"""Letters at the beginning of a name that another one replaces."""
_LETTERS = string.ascii_letters + string.digits


@dataclass
class Elf:
    """A library of ELF with 64 bits, whose bytes may be changed. Raises OSError for a damaged one.

    Attributes:
        names: the places of the names by which it finds other libraries, and of its own, each with its kind.
        paths: where it looks for other libraries.
    """

    data: bytearray
    names: list[tuple[int, int]] = field(default_factory=list)
    paths: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        try:
            self._read()
        except (struct.error, IndexError, ValueError) as error:
            raise OSError(f"it is damaged: {error}") from None

    def _read(self) -> None:
        (first,), (size, count) = struct.unpack_from("<Q", self.data, 32), struct.unpack_from("<HH", self.data, 54)
        self._loaded, dynamic = [], (0, 0)
        for k in range(count):
            kind, _, offset, address, _, length = struct.unpack_from("<IIQQQQ", self.data, first + k * size)
            if offset + length > len(self.data):
                raise OSError("the end of its file is missing")
            if kind == 1:
                self._loaded.append((address, offset, length))
            elif kind == 2:
                dynamic = offset, length
        start, length = dynamic
        entries = list(struct.iter_unpack("<QQ", self.data[start : start + length // 16 * 16]))
        entries = entries[: next((k for k, (tag, _) in enumerate(entries) if tag == 0), len(entries))]
        tables = dict(entries)
        self._strings = self._offset(tables[_STRTAB]) if _STRTAB in tables else 0
        self.names = [(tag, self._strings + value) for tag, value in entries if tag in (_NEEDED, _SONAME)]
        self.paths = [
            each
            for tag, value in entries
            if tag in (_RPATH, _RUNPATH)
            for each in self.name(self._strings + value).split(":")
        ]
        if _SYMTAB in tables:
            self._symbols = self._offset(tables[_SYMTAB]), self._count(tables)
        else:
            self._symbols = 0, 0

    def _offset(self, address: int) -> int:
        for start, offset, length in self._loaded:
            if start <= address < start + length:
                return offset + address - start
        raise ValueError(f"no part of the file is at {address:#x}")

    def _count(self, tables: dict[int, int]) -> int:
        """Number of symbols."""
        if _HASH in tables:
            return struct.unpack_from("<I", self.data, self._offset(tables[_HASH]) + 4)[0]
        if _GNU_HASH not in tables:
            return 0
        at = self._offset(tables[_GNU_HASH])
        buckets, first, bloom, _ = struct.unpack_from("<IIII", self.data, at)
        at += 16 + 8 * bloom
        last = max(struct.unpack_from(f"<{buckets}I", self.data, at), default=0)
        if last < first:
            return first
        at += 4 * buckets
        while not struct.unpack_from("<I", self.data, at + 4 * (last - first))[0] & 1:
            last += 1
        return last + 1

    def name(self, at: int) -> str:
        """The name at a place."""
        return self.data[at : self.data.index(0, at)].decode(errors="surrogateescape")

    def needed(self) -> Iterator[str]:
        """The names of the libraries that it needs."""
        return (self.name(at) for tag, at in self.names if tag == _NEEDED)

    def make_own(self) -> None:
        """Make the symbols weak that are unique in a process, and let it end the process by ``exit`` alone."""
        at, count = self._symbols
        for place in range(at, at + 24 * count, 24):
            name, kind, _, section = struct.unpack_from("<IBBH", self.data, place)
            if kind >> 4 == _UNIQUE:
                self.data[place + 4] = _WEAK << 4 | kind & 15
            if not section and self.name(self._strings + name) == "_exit":
                struct.pack_into("<I", self.data, place, name + 1)  # what follows the first letter

    def rename(self, names: dict[str, str]) -> None:
        """Replace the beginnings of names, of the library itself and of the libraries that it needs. Raises OSError
        for a name that is the end of another one's text."""
        for _, at in self.names:
            new = names.get(self.name(at))
            if new is not None:
                if at != self._strings and self.data[at - 1]:
                    raise OSError(f"{self.name(at)} can't be a copy: link it statically")
                self.data[at : at + _OTHER] = new[:_OTHER].encode()


def parsed(data: bytes) -> Elf | None:
    """A library of ELF with 64 bits, or None for another kind of file, of which the loader says so itself."""
    return Elf(bytearray(data)) if data[:6] == b"\x7fELF\x02\x01" and len(data) >= 64 else None


def own_copies(library: Path, data: bytes, name: str) -> dict[str, bytes]:
    """The files of a copy of a library, by their names: its own, called ``name``, first, and the files of the libraries
    beside it that it, or one of them, finds there. Raises OSError for a damaged one, or one that can't be copied."""
    whole = parsed(data)
    if whole is None:
        return {name: data}
    found, todo, here = {name: whole}, [(whole, False)], {"$ORIGIN", "${ORIGIN}", str(library.parent)}
    names: dict[str, str] = {}
    while todo:
        each, inherited = todo.pop()
        looks = inherited or bool(here & {path.rstrip("/") or "/" for path in each.paths})
        for needed in each.needed() if looks else ():
            path = library.parent / needed
            if needed in names or "/" in needed or not path.is_file():
                continue
            if len(needed) <= _OTHER or (inner := parsed(path.read_bytes())) is None:
                raise OSError(f"{needed} beside it can't be a copy: link it statically")
            names[needed] = "".join(secrets.choice(_LETTERS) for _ in range(_OTHER)) + needed[_OTHER:]
            found[names[needed]] = inner
            todo.append((inner, looks))
    for each in found.values():
        each.make_own()
        each.rename(names)
    return {called: bytes(each.data) for called, each in found.items()}
