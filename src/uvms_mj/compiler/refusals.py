"""What the compiler refuses, with file, line and the words of the source."""

import types


class Untranslatable(TypeError):
    """A function can't be compiled.

    Attributes:
        file, line: where, in the source.
        words: the line of the source.
        reason: why, and what to write instead.
    """

    def __init__(self, function: types.FunctionType, line: int, words: str, reason: str) -> None:
        code = function.__code__
        self.file, self.line = code.co_filename, code.co_firstlineno + line - 1
        self.words, self.reason = words, reason
        super().__init__(f"{self.file}:{self.line}, {function.__qualname__}: {words!r}: {reason}")


class Mistake(Untranslatable):
    """The function is wrong: shapes that do not fit, an unknown name, a store into what is only read."""


class Lacking(Untranslatable):
    """The function may be right, but the language lacks what it uses."""
