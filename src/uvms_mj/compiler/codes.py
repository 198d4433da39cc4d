"""The numbers by which a checked function says why and where it ended early."""

from collections.abc import Sequence

INDEX, DIVISION, CONVERSION, RAISED, STOPPED = range(1, 6)
"""Why: an index out of bounds, a division of an integer by zero, a float that fits no integer, ``raise``, a signal. It
is the lowest byte of the number; then the file (a byte) and the line."""


def code_of(why: int, file: int, line: int) -> int:
    """The number."""
    return why | file << 8 | line << 16


def place(code: int, files: Sequence[str]) -> tuple[int, str, int]:
    """Why, and where: the file and the line."""
    return code & 255, files[code >> 8 & 255], code >> 16
