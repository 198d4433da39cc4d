"""Parsing of TOML in bounded time, from a file or from ``--set``."""

import re
import tomllib
from pathlib import Path
from typing import Any

from .faults import InputError

_MOST_BYTES = 1_000_000
"""Size limit of a scenario file. A scenario with every key has 2 kB."""
_WORD = r"""(?:"[^"\n]*"|'[^'\n]*'|(?<![\w-])[\w-]++)"""
_LONG_KEY = re.compile(rf"{_WORD}(?:[ \t]*+\.[ \t]*+{_WORD}){{50}}")
"""A dotted key of more than fifty words. The time that tomllib takes grows with the square of the key's length: minutes
for 100 kB."""


def parsed_toml(text: str) -> dict[str, Any]:
    """Parse TOML text into tables, in bounded time.

    Raises:
        ValueError: the text is not TOML, is too long, or is nested too deeply.
    """
    if len(text) > _MOST_BYTES:
        raise ValueError(f"it has more than {_MOST_BYTES} characters")
    if _LONG_KEY.search(text):
        raise ValueError("a dotted key has more than fifty words")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("its lists or tables are nested too deeply") from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # Python's limit for int()
        raise ValueError("an integer has thousands of digits") from None


def text_of(path: Path) -> str:
    """Text of a file, cut one byte above the size limit. Raises OSError or UnicodeDecodeError."""
    with path.open("rb") as file:
        return file.read(_MOST_BYTES + 1).decode("utf-8-sig")


def shortened(value: Any) -> str:
    """A value for a message, cut to 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..." + text[-1]


_BARE_POINT = re.compile(r"[+-]?(\d+\.|\.\d+)([eE][+-]?\d+)?")
"""Numbers that are not TOML but common elsewhere: 5. and .2"""


def parse_setting(text: str) -> tuple[str, Any]:
    """Parse ``key=value``. The value is TOML, or a string without quotes.

    Raises:
        InputError: there is no ``=``, or the value begins like a list, a table or a string and is not valid TOML.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise InputError(f"--set {shortened(text)}: must be key=value, for example --set wall.stiffness=2e4")
    key, value = key.strip(), value.strip()
    try:
        tables = parsed_toml(f"value = {value}")
        if set(tables) != {"value"}:
            raise InputError(f"--set {shortened(text)}: must be one key and one value")
        return key, tables["value"]
    except InputError:
        raise
    except ValueError as error:
        if _BARE_POINT.fullmatch(value):
            return key, float(value)
        if value[:1] in ("[", "{", '"', "'"):
            hint = "in TOML, write numbers with a leading digit (0.28) and strings in quotes"
            raise InputError(f"--set {shortened(text)}: {error}; {hint}") from None
        return key, value
