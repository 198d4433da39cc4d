"""Self-contained HTML pages: one style, figures as inline SVG, tables, and numbers in text.

A :class:`Page` is data: a title and sections, which consist of texts, lists, tables and pictures. :func:`rendered`
turns it to HTML, with links to its sections. A page has no script and no external resource, and is made for screens of
any width and for printing.
"""

import base64
import dataclasses
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from markupsafe import Markup

from ...files import atomic_write

if TYPE_CHECKING:
    from ...views.figures.style import Figure

PAGE = "report.html"
"""Name of the page in the folder of results."""


@dataclass(frozen=True)
class Picture:
    """A figure to embed, as SVG with text as outlines, so that no font is needed. Its name is its anchor."""

    kind: ClassVar[str] = "picture"
    name: str
    caption: str
    figure: "Figure"

    @property
    def number(self) -> str:
        """The number before the caption; empty without one."""
        return ""

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
class Text:
    """A paragraph. ``look`` is a class of the style: soft, lead, warning."""

    kind: ClassVar[str] = "text"
    text: str
    look: str = ""


@dataclass(frozen=True)
class Items:
    """A list of texts."""

    kind: ClassVar[str] = "items"
    items: Sequence[Any]
    look: str = ""


@dataclass(frozen=True)
class Cell:
    """A text or a number of a table, or of a list, with a class of the style."""

    text: Any
    look: str = ""


@dataclass(frozen=True)
class Table:
    """A table: heading of the column of row names, names of the other columns, name and cells of rows. Without names of
    columns it has no head. ``label`` says it to readers who can't see it; ``style`` is CSS of this table."""

    kind: ClassVar[str] = "table"
    corner: str
    heads: Sequence[Any]
    rows: Sequence[tuple[str, Sequence[Any]]]
    look: str = "numbers"
    label: str = ""
    caption: str = ""
    style: str = ""

    def shown(self, label: str, look: str = "numbers") -> "Table":
        """The table with a label and a look."""
        return dataclasses.replace(self, label=label, look=look)


@dataclass(frozen=True)
class Group:
    """Parts that stand together, with a class of the style."""

    kind: ClassVar[str] = "group"
    parts: Sequence["Part"]
    look: str = ""


@dataclass(frozen=True)
class Fragment:
    """A part that is HTML already."""

    kind: ClassVar[str] = "fragment"
    html: str


Part = Picture | Text | Items | Table | Group | Fragment


@dataclass(frozen=True)
class Section:
    """A section: its anchor, its heading, its parts, and its name in the list of contents; default: the heading."""

    id: str
    title: str
    parts: Sequence[Part]
    look: str = ""
    link: str = ""


@dataclass(frozen=True)
class Page:
    """A page: the parts below the title, the sections, and files of CSS for its own classes."""

    title: str
    lead: Sequence[Part]
    sections: Sequence[Section]
    styles: Sequence[Path] = ()


def rendered(page: Page) -> str:
    """A page as HTML."""
    styles = [path.read_text(encoding="utf-8") for path in page.styles]
    return filled(Path(__file__).with_name("page.html"), page=page, styles=styles)


def filled(template: Path, **values: Any) -> str:
    """A template with its values, which are escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(template.parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["number"] = number
    return environment.get_template(template.name).render(**values)


def given(*parts: Part | None) -> list[Part]:
    """The parts that there are."""
    return [part for part in parts if part is not None]


def marked(html: str, *values: Any, **named: Any) -> Markup:
    """A text with tags, ``marked("<b>{}</b>", value)``. Values are escaped, numbers as in :func:`number`."""
    texts, by_name = [_plain(value) for value in values], {name: _plain(value) for name, value in named.items()}
    return Markup(html).format(*texts, **by_name)


def _plain(value: Any) -> Any:
    return number(value) if isinstance(value, float) else value


def facts(rows: Iterable[tuple[str, Any]]) -> Table:
    """A table of names and values."""
    return Table("", (), [(name, [value]) for name, value in rows], "settings")


def versions_of(versions: Mapping[str, str]) -> Items:
    """The versions of the code and of packages, by name."""
    return Items([f"{name} {version}" for name, version in sorted(versions.items())], "versions soft")


def keyed(colour: str, name: str) -> Markup:
    """A name behind a square in its colour."""
    return marked('<span class="key" style="background: {}"></span>{}', colour, name)


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
