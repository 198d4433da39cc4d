"""Numbers of the guides that come from runs: checked by a test, and written by ``draw_docs.py``.

The script of a page, ``pages/NAME.py``, has a function ``numbers``. It yields sentences of the page with a hole {} for
each measured number, and the values of the runs:

    yield "vibrates by {} N, by {} N", first, (second, 0.05)

Numbers of runs that take minutes are in ``long_numbers``, which ``draw_docs.py`` writes and the test leaves out.

A value that comes alone must be the printed number to its last digit. A pair is a value and its tolerance, for results
that depend on rounding, and for numbers that the page calls approximate. After "below", "within" and "at most"
the printed number is a bound of the value.
"""

import importlib.util
import inspect
import math
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[1]
PAGES = Path(__file__).with_name("pages")
_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
_BOUND = re.compile(r"(?:below|within|at most) $")


def script(name: str) -> ModuleType:
    """The script of a page."""
    spec = importlib.util.spec_from_file_location(f"page_{name}", PAGES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def page(name: str) -> Path:
    """A page of the guides by its name."""
    return ROOT / "README.md" if name == "readme" else next((ROOT / "docs").rglob(f"{name}.md"))


def needs_folder(function: Callable) -> bool:
    """Whether a function of a page's script can't do without the folder of long runs."""
    return any(each.default is inspect.Parameter.empty for each in inspect.signature(function).parameters.values())


def faults(text: str, sentences: Iterable[tuple]) -> list[str]:
    """What is wrong with the numbers of a page's text: a sentence for each."""
    return [
        f"{words!r}: the page has {printed}, the run {value:.6g}"
        for words, holes in _found(text, sentences)
        for printed, _, value, holds, _ in holes
        if not holds
    ]


def corrected(text: str, sentences: Iterable[tuple]) -> str:
    """A page's text with the values of the runs in place of the numbers that are wrong, to as many digits."""
    wrong = [
        (span, _like(printed, abs(value) if bound else value, bound))
        for _, holes in _found(text, sentences)
        for printed, span, value, holds, bound in holes
        if not holds
    ]
    for (start, end), number in sorted(wrong, reverse=True):
        text = text[:start] + number + text[end:]
    return text


def _found(text: str, sentences: Iterable[tuple]) -> Iterator[tuple[str, list[tuple]]]:
    """Each sentence with its holes: printed number, its place in the text, value, whether it holds, whether it is a
    bound."""
    for words, *values in sentences:
        parts = words.split("{}")
        if len(parts) != len(values) + 1:
            raise ValueError(f"{words!r} has {len(parts) - 1} holes and {len(values)} values")
        pattern = f"({_NUMBER})".join(r"\s+".join(map(re.escape, re.split(r"\s+", part))) for part in parts)
        places = list(re.finditer(rf"(?<![\d.]){pattern}(?!\d|\.\d)", text))
        if len(places) != 1:
            raise ValueError(f"{words!r} is {len(places)} times in the page")
        holes = []
        for k, (before, each) in enumerate(zip(parts, values, strict=False), 1):
            printed, bound = places[0][k], bool(_BOUND.search(before))
            value = float(each[0] if isinstance(each, tuple) else each)
            tolerance = float(each[1]) if isinstance(each, tuple) else 0.0
            holes.append((printed, places[0].span(k), value, _holds(printed, value, tolerance, bound), bound))
        yield words, holes


def _holds(printed: str, value: float, tolerance: float, bound: bool) -> bool:
    if bound:
        return abs(value) <= float(printed)
    return abs(float(printed) - value) <= max(0.5 * _last_digit(printed), tolerance) * (1.0 + 1e-9) + 1e-300


def _last_digit(printed: str) -> float:
    mantissa, _, exponent = printed.partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def _like(printed: str, value: float, up: bool) -> str:
    """A value as a number is printed: with as many decimals, with an exponent and a sign if it has them; rounded, or
    rounded up."""
    mantissa, e, _ = printed.partition("e")
    sign, decimals = "+" if printed.startswith("+") else "", len(mantissa.partition(".")[2])
    power = math.floor(math.log10(abs(value))) if e and value else 0
    value = value / 10.0**power + (0.5 * 10.0**-decimals if up else 0.0)
    return f"{value:{sign}.{decimals}f}" + (f"e{power}" if e else "")
