"""Self-contained HTML pages: one style, figures as inline SVG, tables, and numbers in text.

A page is a template that extends ``page.html``. It has no script and no external resource, and is
made for screens of any width and for printing.
"""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...files import atomic_write

if TYPE_CHECKING:
    from ...views.figures.style import Figure

PAGE = "report.html"
"""Name of the page in the folder of results."""


@dataclass(frozen=True)
class Picture:
    """A figure to embed, as SVG with text as outlines, so that no font is needed. Its name is its anchor."""

    name: str
    caption: str
    figure: "Figure"

    @property
    def wide(self) -> bool:
        """Whether the figure takes the full width of a page."""
        return bool(self.figure.get_figwidth() > 5.0)

    @property
    def src(self) -> str:
        """The figure as a data URI."""
        file = io.BytesIO()
        self.figure.savefig(file, format="svg", rc={"svg.fonttype": "path", "svg.hashsalt": self.name})
        return f"data:image/svg+xml;base64,{base64.b64encode(file.getvalue()).decode()}"


@dataclass(frozen=True)
class Table:
    """A table of a page: heading of the column of row names, names of the other columns, name and cells of rows."""

    corner: str
    heads: Sequence[str]
    rows: Sequence[tuple[str, Sequence[Any]]]


def rendered(template: Path, **values: Any) -> str:
    """The page of a template that extends ``page.html``, with its values. It may import from the folder above."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader([template.parent, template.parents[1], Path(__file__).parent]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["number"] = number
    return environment.get_template(template.name).render(**values)


def write(path: Path, text: str) -> None:
    """Write a file atomically: readers see either the old or the new file. Raises InputError if it can't be written."""
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")


ROUNDING = 1e-9
"""Values below this, in SI units, come from rounding in sums over 1e5 steps."""


def number(value: float | None, digits: int = 4) -> str:
    """Format a number with a minus sign and powers of ten; a dash for None, nan and infinity.

    Values below :data:`ROUNDING` are shown as 0.
    """
    if value is None or not np.isfinite(value):
        return "–"
    if abs(value) < ROUNDING:
        return "0"
    if value == round(value) and abs(value) < 1e4:
        return f"{value:.0f}".replace("-", "−")
    mantissa, e, exponent = f"{value:.{digits}g}".partition("e")
    raised = str(int(exponent)).translate(_RAISED) if e else ""
    return (f"{mantissa}·10{raised}" if e else mantissa).replace("-", "−")


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
