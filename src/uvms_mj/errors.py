"""Errors in the input: all are reported at once, each with its place, its value and the valid choices."""

import contextlib
import difflib
import ipaddress
import math
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError
from pydantic_core import ArgsKwargs


@dataclass(frozen=True)
class Fault:
    """One error: its key, and a sentence with the value and the valid choices."""

    key: str
    message: str

    def __str__(self) -> str:
        key = self.key if len(self.key) <= 100 else self.key[:97] + "..."
        return f"{key}: {self.message}" if key else self.message


_MOST_LINES = 50
"""A message lists at most this many errors and counts the rest."""


class InputError(ValueError):
    """The input is invalid. ``faults`` has one entry for each error that was found, with its ``key`` and its
    ``message``."""

    def __init__(self, faults: Sequence[Fault] | str, place: str = "") -> None:
        self.faults = (Fault("", faults),) if isinstance(faults, str) else tuple(faults)
        lines = [str(fault) for fault in self.faults[:_MOST_LINES]]
        if len(self.faults) > _MOST_LINES:
            lines.append(f"... and {len(self.faults) - _MOST_LINES} more")
        if place and len(lines) == 1:
            text = f"{place}: {lines[0]}"
        elif place:
            text = f"{place}: {len(self.faults)} errors\n" + "\n".join(f"  {line}" for line in lines)
        else:
            text = "\n".join(lines)
        super().__init__(text)

    def _render_traceback_(self) -> list[str]:
        """A notebook shows the message, for the place of bad input is in it."""
        return [f"{type(self).__name__}: {self}"]


EXTRAS: Mapping[str, str] = {
    "cluster": "distributed",
    "c": "ziglang",
    "dm": "dm-control, for Python up to 3.12",
    "fmi": "fmpy",
    "gpu": "cuda-bindings",
    "gym": "gymnasium",
    "live": "foxglove-sdk",
    "tune": "optuna",
    "video": "imageio-ffmpeg",
    "xacro": "xacro",
}
"""Packages that only some users need, by the extra that installs them."""


@contextlib.contextmanager
def needs_extra(extra: str) -> Iterator[None]:
    """Context for the imports of an extra's package: ``with needs_extra("gym"): import gymnasium``.

    Raises:
        InputError: the package is not installed; the message names the extra.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        install = f"install {EXTRAS[extra]}, with pip install 'uvms-mj[{extra}]'"
        raise InputError(f"no module {error.name!r}: {install}") from None


class HostWarning(UserWarning):
    """A port is reached by other machines."""


def warn_of_host(key: str, host: str, what: str) -> None:
    """Warn of a host that is not this machine's loopback: ``what`` its machines can do. ``key`` is the place of the
    host in the user's input."""
    with contextlib.suppress(ValueError):
        if host == "localhost" or ipaddress.ip_address(host).is_loopback:
            return
    warnings.warn(f"{key} {host}: {what}; nothing asks who it is", HostWarning, stacklevel=2)


def suggestion(word: str, choices: Iterable[str]) -> str:
    """The closest of the choices to ``word``, or all choices if none is close."""
    choices = sorted(choices)
    if not choices:
        return "there are no valid choices"
    close = difflib.get_close_matches(word, choices, n=1, cutoff=0.6)
    return f"did you mean {close[0]!r}?" if close else f"choose from {', '.join(choices)}"


_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_WITH_COMMA = re.compile(r"[+-]?\d+(,\d+)+(\.\d*)?([eE][+-]?\d+)?")
_WITH_UNIT = re.compile(rf"({_NUMBER})\s*([a-zA-Zµ°%][^,\[\]]*)")
_PREFIXES = {"k": 1e3, "c": 1e-2, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "M": 1e6}
_SPELT = {"°": "deg", "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad", "hz": "Hz"}


def number_hint(text: object, unit: str = "") -> str:
    """The right spelling of a text that was meant as a number in a unit: one with a decimal comma, with its
    unit, or in quotes. Empty for any other value."""
    if not isinstance(text, str) or len(text) > 60:
        return ""
    text = text.strip()
    if found := _WITH_COMMA.fullmatch(text):
        clear = text.count(",") == 1 and not found[2] and len(found[1]) != 4  # 1,000 may be a thousand
        return f"; a number has a decimal point and no comma{': ' + text.replace(',', '.') if clear else ''}"
    if re.fullmatch(_NUMBER, text):
        return f"; write it without quotes, {text}"
    if not (found := _WITH_UNIT.fullmatch(text)):
        return ""
    if unit == "1":
        return f"; the key is a factor or a share, without a unit, and not a value in {found[2].strip()}"
    value, given = float(found[1]), _SPELT.get(found[2].lower(), " ".join(found[2].split()))
    factor = 1.0 if given == unit else _PREFIXES.get(given[:1]) if given[1:] == unit else None
    if {given, unit} == {"rad", "deg"}:
        factor = math.degrees(1.0) if unit == "deg" else math.radians(1.0)
    converted = f"{factor * value:.6g}, " if unit and factor is not None else ""
    return f"; write the number alone, {converted}in {unit or 'the unit of the key'}"


def faults_of(
    error: ValidationError,
    prefix: str = "",
    choices: Mapping[str, Iterable[str]] | None = None,
    units: Mapping[str, str] | None = None,
    defaults: Mapping[str, Any] | None = None,
) -> list[Fault]:
    """Errors of a pydantic validator, as entries of an :class:`InputError`. Locations are relative to the key of the
    table that was validated, ``prefix``; the known keys of each table, ``choices``, and ``units`` and ``defaults`` of
    keys are for suggestions."""
    faults: dict[str, Fault] = {}
    for item in error.errors(include_url=False):
        key, loc = prefix, item["loc"]
        if item["type"] == "missing" and isinstance(loc[-1], int):  # a number of a list is missing, not a key
            loc = loc[:-1]
        for part in loc:
            if isinstance(part, int):
                key += f"[{part}]"
            elif not (
                "[" in part or part in ("float", "bool", "int", "str")
            ):  # the branch of a union is not a key of the scenario
                key += f".{part}" if key else part
        if item["type"] in ("unexpected_keyword_argument", "extra_forbidden"):
            word = str(item["loc"][-1])  # may have a dot: wall.stiffness.x
            table = key.removesuffix(word).removesuffix(".")
            known = list((choices or {}).get(re.sub(r"\[\d+\]", "", table), ()))
            idle = "has no effect with the other keys of its table; leave it out"
            message = idle if word in known else f"no such key; {suggestion(word, known)}"
        elif item["type"] == "missing" and isinstance(item["loc"][-1], str):
            message = _SENTENCES["missing"]  # the value is the table around it
        elif isinstance(item["input"], Mapping | ArgsKwargs) and item["type"] == "value_error":
            message = _sentence(item)  # of several keys of the table
        elif item["type"] in ("tuple_type", "list_type") and key in (choices or {}):
            message = f"{shortened(item['input'])} is not a list of tables with {', '.join((choices or {})[key])}"
        else:
            given = item["input"]
            message = f"{shortened(list(given) if isinstance(given, tuple) else given)} {_sentence(item)}"
            if _sentence(item) == _SENTENCES["float_type"]:
                message += number_hint(given, (units or {}).get(re.sub(r"\[\d+\]", "", key), ""))
            elif (
                message.endswith(_SENTENCES["list_type"]) and isinstance(of := (defaults or {}).get(key), tuple) and of
            ):
                message += f"; its default is {shortened(list(of))}"
        if item["type"] == "missing" or key not in faults:  # the last missing number gives a list's length
            faults[key] = Fault(key, message)
    return list(faults.values())


def error_text(error: BaseException) -> str:
    """The type and the message of a user's exception in one line, which may fail in ``__str__``."""
    try:
        text = " ".join(str(error).split())
    except Exception:
        text = ""
    return f"{type(error).__name__}: {text[:300]}" if text else type(error).__name__


def shortened(value: Any) -> str:
    """A value for a message, cut to 60 characters."""
    try:
        text = repr(value)
    except Exception:  # nested too deeply, an integer of 5000 digits, or a user's __repr__ that fails
        text = f"the given {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..." + text[-1]


def _of_length(values: Sequence[Any], n: int) -> str:
    return f"has {len(values)} values; {n} are needed"


def _sentence(item: Any) -> str:
    """The requirement that was violated."""
    kind, context = item["type"], item.get("ctx", {})
    if kind == "missing" and isinstance(item["loc"][-1], int):
        return _of_length(item["input"], item["loc"][-1] + 1)
    if kind == "too_long" and isinstance(item["input"], list | tuple):
        return _of_length(item["input"], context["max_length"])
    if kind in ("tuple_type", "list_type") and isinstance(item["input"], str):
        return f"{_SENTENCES[kind]}; write it in brackets, [1.0, 2.0]"
    if kind == "greater_than_equal" and 0.0 < context["ge"] <= 1e-9:
        return "must be positive"
    sentence = _SENTENCES.get(kind)
    return f"is not valid: {item['msg']}" if sentence is None else sentence.format(**context)


_SENTENCES = {
    **dict.fromkeys(("float_type", "float_parsing", "finite_number"), "is not a finite number"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "is not a whole number"),
    **dict.fromkeys(("tuple_type", "list_type"), "is not a list of numbers"),
    **dict.fromkeys(("bool_type", "bool_parsing"), "is not true or false"),
    **dict.fromkeys(("dataclass_type", "dict_type"), "is not a table"),
    "missing": "lacks this key",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "literal_error": "must be {expected}",
    "string_type": "is not a string",
    "value_error": "{error}",
}
"""Requirements by pydantic's error type."""
