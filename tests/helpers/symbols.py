"""The symbols that code uses without defining them: of an ELF or WebAssembly object, or of PTX."""

import re
import struct
from collections.abc import Iterator


def undefined(code: bytes) -> set[str]:
    """The undefined symbols of an object of 64-bit ELF, of a WebAssembly object, or of PTX."""
    if code.startswith(b"\x7fELF"):
        return set(_of_elf(code))
    if code.startswith(b"\0asm"):
        return set(_of_wasm(code))
    return set(
        re.findall(r"^\.extern [^;]*?(\w+)\s*(?:\(|;)", code.decode().replace("(.param .b64 func_retval0)", ""), re.M)
    )


def _of_elf(code: bytes) -> Iterator[str]:
    start, size, count = struct.unpack_from("<Q", code, 40)[0], *struct.unpack_from("<HH", code, 58)
    sections = [struct.unpack_from("<IIQQQQIIQQ", code, start + size * k) for k in range(count)]
    for _, kind, _, _, offset, length, link, *_ in sections:
        if kind != 2:  # the table of symbols
            continue
        names = sections[link][4]
        for place in range(offset + 24, offset + length, 24):  # the first one is empty
            name, _, _, section = struct.unpack_from("<IBBH", code, place)
            if section == 0:
                yield code[names + name : code.index(b"\0", names + name)].decode()


def _of_wasm(code: bytes) -> Iterator[str]:
    at = 8
    while at < len(code):
        kind, (size, at) = code[at], _number(code, at + 1)
        if kind == 2:  # imports
            count, place = _number(code, at)
            for _ in range(count):
                _, place = _text(code, place)
                name, place = _text(code, place)
                what, place = code[place], place + 1
                yield name
                place = _after_import(code, place, what)
        at += size


def _after_import(code: bytes, at: int, what: int) -> int:
    if what == 0:  # a function, with its type
        return _number(code, at)[1]
    if what == 3:  # a global, with its type and whether it changes
        return at + 2
    at += what == 1  # a table, with its type
    limits, at = code[at], at + 1
    _, at = _number(code, at)
    return _number(code, at)[1] if limits & 1 else at


def _text(code: bytes, at: int) -> tuple[str, int]:
    size, at = _number(code, at)
    return code[at : at + size].decode(), at + size


def _number(code: bytes, at: int) -> tuple[int, int]:
    """A LEB128 number and the place after it."""
    value = shift = 0
    while True:
        value |= (code[at] & 127) << shift
        shift, at = shift + 7, at + 1
        if code[at - 1] < 128:
            return value, at
