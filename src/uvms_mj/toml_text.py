"""TOML as a user writes it, in a file or behind ``--set``, read in bounded time."""

import re
import tomllib
from pathlib import Path
from typing import Any

from .faults import InputError

_MOST_BYTES = 1_000_000
"""A scenario with every key written out has 2 kB."""
_WORD = r"""(?:"[^"\n]*"|'[^'\n]*'|(?<![\w-])[\w-]++)"""
_LONG_KEY = re.compile(rf"{_WORD}(?:[ \t]*+\.[ \t]*+{_WORD}){{50}}")
"""No scenario has a key of fifty words. tomllib takes the square of a dotted key's length, minutes for 100 kB of it."""


def parsed_toml(text: str) -> dict[str, Any]:
    """Tables from TOML text, in bounded time.

    Raises:
        ValueError: it is not TOML, too long, or nested too deeply.
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
    """A file's text, up to one character more than is read. Raises OSError or UnicodeDecodeError."""
    with path.open("rb") as file:
        return file.read(_MOST_BYTES + 1).decode("utf-8-sig")


def shortened(value: Any) -> str:
    """A value in a message."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..." + text[-1]


_BARE_POINT = re.compile(r"[+-]?(\d+\.|\.\d+)([eE][+-]?\d+)?")
"""A number that every language but TOML takes: 5. and .2"""


def parse_setting(text: str) -> tuple[str, Any]:
    """Key and value of ``key=value``; the value is TOML, or a bare word.

    Raises:
        InputError: there is no ``=``, or the value begins like a list or a text and isn't.
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
            hint = "in TOML, numbers begin with a digit, 0.28, and words stand between quotes"
            raise InputError(f"--set {shortened(text)}: {error}; {hint}") from None
        return key, value
