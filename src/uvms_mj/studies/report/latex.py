"""LaTeX of a table for a paper: its texts, its numbers with the digits that their interval supports, and its width.

Widths are of Computer Modern at 10 pt, which is as wide as Times or wider, so that a table that fits in it fits in a
paper of the class IEEEtran.
"""

import functools
import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.ft2font import FT2Font, LoadFlags

from ...views.figures.style import COLUMN_IN, PAGE_IN, PT_IN

COLUMN_PT, PAGE_PT = PT_IN * COLUMN_IN, PT_IN * PAGE_IN
"""Width of one column and of two columns of a paper [pt]."""
_ESCAPED = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "\N{NO-BREAK SPACE}": "~",
    "^": r"\textasciicircum{}",
    "µ": r"$\mu$",
    "·": r"$\cdot$",
    "²": "$^2$",
    "³": "$^3$",
    "−": "$-$",
    "|": "$|$",
    "<": "$<$",
    ">": "$>$",
    **{letter: f"\\{letter}" for letter in "&%$#_{}"},
}
"""LaTeX of the characters that it does not take as they are."""
_POWER = re.compile(r"\^(-?\d+)")
"""A power in a unit, m/s^2."""
_MINUS = re.compile(r"(?<![\w.)\]^])-(?=\.?\d)")
"""A hyphen that is the sign of a number."""
_PER_CENT = re.compile(r"(?<=\d) (?=%)")
"""The space in 95 %, where no line ends."""


def latex(text: str) -> str:
    """A text as LaTeX prints it; powers in units are raised, and numbers have a minus sign."""
    parts = _POWER.split(_PER_CENT.sub("\N{NO-BREAK SPACE}", _MINUS.sub("−", text)))  # text, power, text, ...
    escaped = ["".join(_ESCAPED.get(letter, letter) for letter in part) for part in parts[::2]]
    raised = [f"$^{{{power}}}$" for power in parts[1::2]]
    return "".join(a + b for a, b in zip(escaped, [*raised, ""], strict=True))


@functools.cache
def _roman() -> FT2Font:
    return FT2Font(str(Path(mpl.get_data_path(), "fonts", "ttf", "cmr10.ttf")))


_AS_WIDE = str.maketrans("_–−·", "00++")
"""Letters of the font that are as wide as others that it lacks; a dot between factors has the space of a sign."""
_SIDES_PT = 0.5
"""Space at the sides of the first and the last letter, which the font's box leaves out [pt]."""
_WIDER_SPACE = 0.11
"""How much wider the space between words is in IEEEtran than in the font, over the size of the letters [1]."""
_BELOW_PT = 8.0
"""Size of the roman that is as wide as the roman for 7 pt, whose letters are wider for their size [pt]."""


def width_pt(text: str, size: float = 10.0) -> float:
    """The width of a text, not of its LaTeX, in Computer Modern of a size [pt]."""
    font = _roman()
    font.set_size(size, PT_IN)
    font.set_text(text.translate(_AS_WIDE), 0.0, LoadFlags.NO_HINTING)
    return font.get_width_height()[0] / 64.0 + _SIDES_PT + _WIDER_SPACE * size * text.count(" ")


def label(text: str, room: float) -> str:
    """A text in LaTeX. One that is wider than a room [pt] has several lines; a word that is wider may be broken
    everywhere."""
    if width_pt(text) <= room:
        return latex(text)
    wide = (width_pt(word) > room for word in text.split(" "))
    words = zip(text.split(" "), wide, strict=True)
    broken = " ".join("\\allowbreak{}".join(map(latex, word)) if long else latex(word) for word, long in words)
    return f"\\parbox[t]{{{room:g}pt}}{{\\raggedright {broken}\\strut}}"


@dataclass(frozen=True)
class Stacked:
    """A value, and a smaller text below it."""

    value: str
    below: str = ""

    @property
    def text(self) -> str:
        """Both in one line."""
        return f"{self.value} ({self.below})" if self.below else self.value


@dataclass(frozen=True)
class Numbers:
    """Values with a range as texts, whose unit has the factor 10^exponent."""

    cells: tuple[Stacked, ...]
    exponent: int = 0


_DIGITS, _MOST_DIGITS = 2, 5
"""Digits of the narrowest range that are shown; most digits of a number."""
_LARGE, _SMALL = 1e5, 1e-2
"""From where on and up to where all numbers of a column have a power of ten in its head."""
_SPAN = 1e3
"""Most of the largest number over the smallest value of a column that has such a power."""


def ranged(values: np.ndarray, signed: bool = False) -> Numbers:
    """Texts of numbers (n, 3): a value, and the lower and upper end of its range; ``signed`` with a sign of each.

    All have the same decimals: the narrowest range has two digits, and no number more than five. Where the values span
    more than three decades, the large ones have a power of ten of their own, 7.1·10^6. Nan is a dash.
    """
    sizes = np.abs(values[np.isfinite(values)])
    largest = float(sizes.max(initial=0.0))
    if not largest:
        return Numbers(tuple(_cell(row, 0, signed) for row in values))
    middle = np.abs(values[np.isfinite(values[:, 0]) & (values[:, 0] != 0.0), 0])
    together = largest < _LARGE or middle.min(initial=largest) * _SPAN >= largest
    exponent = 3 * math.floor(math.log10(largest) / 3) if together and not _SMALL <= largest < _LARGE else 0
    scaled = values / 10.0**exponent
    largest = float((sizes[together | (sizes < _LARGE)] / 10.0**exponent).max(initial=0.0)) or 1.0
    top = math.floor(math.log10(largest))
    wide = scaled[:, 2] - scaled[:, 1]
    wide = wide[np.isfinite(wide) & (wide > 1e-9 * largest)]
    places = _DIGITS - 1 - math.floor(math.log10(wide.min())) if len(wide) else 2 - top
    return Numbers(tuple(_cell(row, min(places, _MOST_DIGITS - 1 - top), signed) for row in scaled), exponent)


def _cell(row: np.ndarray, places: int, signed: bool) -> Stacked:
    if not np.isfinite(row).all():
        return Stacked("–")
    value, low, high = (_text(float(each), places, "+" if signed else "") for each in row)
    return Stacked(value, f"{low} to {high}")


def _text(number: float, places: int, sign: str) -> str:
    if abs(number) >= _LARGE:
        mantissa, _, exponent = f"{number:{sign}.1e}".partition("e")
        return f"{mantissa}·10^{int(exponent)}".replace("-", "−")
    return f"{round(number, places) + 0.0:{sign}.{max(0, places)}f}".replace("-", "−")


@dataclass(frozen=True)
class Column:
    """A column of a table: its head, what stands below it, such as the unit, and its cells."""

    head: str
    below: str
    cells: Sequence[Stacked]

    @property
    def width(self) -> float:
        """Its width [pt]; a text below a value is \\scriptsize, 7 pt."""
        large = [self.below, *(cell.value for cell in self.cells)]
        widths = [min(LABEL_PT, width_pt(self.head)), *map(width_pt, large)]
        return max([*widths, *(width_pt(cell.below, _BELOW_PT) for cell in self.cells)])


SPACE_PT = 8
"""Space between two columns [pt]."""
LABEL_PT = 100
"""Width in which the name of a row or of a column is set [pt]."""


@dataclass(frozen=True)
class LatexTable:
    """A table of rows with names, for the package booktabs, with a note below it.

    Attributes:
        corner: head of the names.
        names: of the rows.
        comments: lines of the file that LaTeX does not print.
        ruled: rows with a line above them.
    """

    corner: str
    names: Sequence[str]
    columns: Sequence[Column]
    note: str = ""
    comments: Sequence[str] = ()
    ruled: Collection[int] = ()

    @property
    def width(self) -> float:
        """Its width [pt]."""
        first = max(min(LABEL_PT, width_pt(name)) for name in (self.corner, *self.names))
        return first + sum(SPACE_PT + column.width for column in self.columns)

    @property
    def fits(self) -> str:
        """Where it fits, in a sentence."""
        said = f"The table is {self.width:.0f} pt wide at 10 pt"
        if self.width <= COLUMN_PT:
            return f"{said}, and fits a column of {COLUMN_PT:.0f} pt."
        if self.width <= PAGE_PT:
            return f"{said}, wider than a column of {COLUMN_PT:.0f} pt: put it in table*, which has {PAGE_PT:.0f} pt."
        return f"{said}, wider than a page of {PAGE_PT:.0f} pt: choose fewer columns."

    @property
    def text(self) -> str:
        """The LaTeX."""
        form = f"@{{}}l*{{{len(self.columns)}}}{{@{{\\hspace{{{SPACE_PT}pt}}}}r}}@{{}}"
        rows = [[self.corner, *(label(each.head, LABEL_PT) for each in self.columns)]]
        if any(each.below for each in self.columns):
            rows.append(["", *(latex(each.below) for each in self.columns)])
        for i, name in enumerate(self.names):
            if i in (0, *self.ruled):
                rows.append(["\\midrule"])
            cells = [column.cells[i] for column in self.columns]
            rows.append([label(name, LABEL_PT), *(_value(cell.value) for cell in cells)])
            if any(cell.below for cell in cells):
                rows.append(["", *(f"{{\\scriptsize {_value(cell.below)}}}" if cell.below else "" for cell in cells)])
        body = [row[0] if len(row) == 1 else " & ".join(row) + r" \\" for row in rows]
        lines = [*(f"% {line}" for line in (*self.comments, self.fits)), "% \\usepackage{booktabs}"]
        lines += [f"\\begin{{tabular}}{{{form}}}", "\\toprule", *body, "\\bottomrule"]
        if self.note:  # its width follows the size of the letters, and is below the table's in a narrower font
            wide = f"@{{}}p{{{0.085 * self.width:.1f}em}}@{{}}"
            form = f"\\multicolumn{{{1 + len(self.columns)}}}{{{wide}}}"
            lines.append(f"\\noalign{{\\vskip 2pt}}{form}{{\\footnotesize\\raggedright {latex(self.note)}}}")
        return "\n".join([*lines, "\\end{tabular}%"]) + "\n"  # without a space behind it


def _value(text: str) -> str:
    return "--" if text == "–" else latex(text)
