"""Refusals of the compiler, with file, line and the words of the source; and the numbers by which a checked function
says why and where it ended early."""

import types
from collections.abc import Sequence

from ..errors import suggestion


class Untranslatable(TypeError):
    """A function can't be compiled.

    Attributes:
        file, line: where, in the source.
        words: the line of the source.
        reason: why, and what to write instead.
        outermost: file and line of the statement in the outermost function.
    """

    outermost: tuple[str, int] = "", 0

    def __init__(self, function: types.FunctionType, line: int, words: str, reason: str) -> None:
        code = function.__code__
        self.file, self.line = code.co_filename, code.co_firstlineno + line - 1
        self.words, self.reason = words, reason
        super().__init__(f"{self.file}:{self.line}, {function.__qualname__}: {words!r}: {reason}")


class Mistake(Untranslatable):
    """The function looks wrong: shapes that do not fit, an unknown name, a store into what is only read. Python has the
    last word, unless it is ``forbidden``: then it might end the process."""

    forbidden = False


class Lacking(Untranslatable):
    """The function may be right, but the language lacks what it uses."""


def field_suggestion(word: str, known: Sequence[str]) -> str:
    """A hint for an unknown name: the first known name that adds a suffix to it, as p_WB to p, else the closest."""
    longer = [name for name in known if name.startswith(f"{word}_")]
    return f"did you mean {longer[0]!r}?" if longer else suggestion(word, known)


INDEX, DIVISION, CONVERSION, RAISED, STOPPED, OVERFLOW, SMEARED = range(1, 8)
"""Why: an index out of bounds, a division of an integer by zero, a float that fits no integer, ``raise``, a signal, an
integer of more than 64 bits, an array that is filled from a part of itself. It is the lowest byte of the number; then
the file (a byte) and the line."""


def code_of(why: int, file: int, line: int) -> int:
    """The number."""
    return why | file << 8 | line << 16


def place(code: int, files: Sequence[str]) -> tuple[int, str, int]:
    """Why, and where: the file and the line."""
    return code & 255, files[code >> 8 & 255], code >> 16
