"""Colours of runs in figures and viewers.

A run has the colour of its law in every picture. Several runs of one law have shades of this colour, from dark to
light.
"""

from collections import Counter
from collections.abc import Sequence

from ..records.scene import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION, Colour

LAWS: dict[str, Colour] = {
    "impedance": PURPLE,
    "fosm": ORANGE,
    "gsta": BLUE,
    "sta": SKY,
    "ideal": GREEN,
    "pid": (136, 34, 85),
    "admittance": (51, 34, 136),
    "parallel": (140, 190, 50),
    "dob_impedance": (0, 80, 95),
    "aismc": (210, 30, 45),
}
"""Colours of the built-in laws, by name."""
_OTHERS: tuple[Colour, ...] = (VERMILLION, (120, 94, 60), (110, 110, 110), (150, 160, 30))
"""Colours of other laws, in order of appearance."""
_DARKEST, _LIGHTEST = -0.6, 0.55
"""Range of the shades of a law's colour: shares of black (negative) and of white."""
_FEW = 3
"""Up to this many runs of a law have its colour and lighter shades only."""


def mixed(colour: Colour, share: float) -> Colour:
    """A colour mixed with a share of white, or of black if the share is negative."""
    target, part = (255, share) if share > 0.0 else (0, -share)
    r, g, b = (round(c + part * (target - c)) for c in colour)
    return r, g, b


def luminance(colour: Colour) -> float:
    """Relative luminance of a colour, from 0 to 1 (WCAG 2.1)."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (each / 255 for each in colour)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def legible(colour: Colour) -> Colour:
    """A colour for text that is read on a light and on a dark ground alike: mixed with black or white to the middle of
    their luminances, for the same contrast of about 4 with both."""
    shares = [k / 100 for k in range(-100, 101)]
    middle = (1.05 * 0.05) ** 0.5 - 0.05
    return mixed(colour, min(shares, key=lambda share: abs(luminance(mixed(colour, share)) - middle)))


def of_runs(laws: Sequence[str]) -> list[Colour]:
    """One colour for each run, from the law of each: ``gsta``, or ``file.py:Class`` for a law that is not built in."""
    others = [law for law in dict.fromkeys(laws) if law not in LAWS]
    base = LAWS | {law: _OTHERS[i % len(_OTHERS)] for i, law in enumerate(others)}
    number, seen, colours = Counter(laws), Counter[str](), []
    for law in laws:
        n = number[law]
        darkest = _DARKEST if n > _FEW else 0.0
        share = darkest + (_LIGHTEST - darkest) * seen[law] / max(1, n - 1)
        colours.append(mixed(base[law], share))
        seen[law] += 1
    return colours


def hex_of_runs(laws: Sequence[str]) -> list[str]:
    """The colours of :func:`of_runs` as #rrggbb."""
    return ["#{:02x}{:02x}{:02x}".format(*colour) for colour in of_runs(laws)]
