"""Style, colours and sizes of all figures, and reproducible files."""

import contextlib
import io
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from ...files import whole
from ...stages.signals import AXES

STYLE = Path(__file__).with_name("uvms_mj.mplstyle")
"""Style file with fonts, widths and colours."""
COLUMN_IN, PAGE_IN = 3.4, 7.1
"""Width of a column and of a page [in]."""
SMALL = 6.0
"""Size of the text in an inset [pt]."""
BLACK, GREY = "#000000", "#777777"
"""Colours of references and expected values, and of the wall."""

_CYCLE = mpl.rc_params_from_file(STYLE, use_default_template=False)["axes.prop_cycle"].by_key()["color"]
COLOURS = dict(zip((*AXES[:3], "force", *AXES[3:]), _CYCLE, strict=True))
"""Colours of the components and of the contact force, the same in every figure."""
LINE = 1.0
"""Width of every line of samples [pt], so that no line dominates."""
_PERIOD, _STRIPE, _MOST_STRIPES = 7.0, 2.5, 6
"""Length of a dash pattern and least length of one line's stripe in it, in line widths; number of distinct patterns."""

FORMATS = ("png", "svg", "pdf")
_METADATA: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}


def stripe(i: int, n: int) -> dict[str, Any]:
    """Line style of line i of n. Where lines coincide, each remains visible as a stripe of its colour.

    The first line is solid and drawn first. Each later line is drawn above it with shorter dashes than the line before,
    down to half of the pattern.
    """
    shown = min(n, _MOST_STRIPES)
    period = max(_PERIOD, _STRIPE * shown)
    gap = 0.5 * period * (i % shown) / max(1, shown - 1)
    dashes = (0.0, (period - gap, gap)) if gap else "solid"
    return {"linewidth": LINE, "linestyle": dashes, "zorder": 2.0 + 0.01 * i}


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """A context with the settings of the style file and matplotlib's defaults, independent of the user's settings."""
    with mpl.rc_context(fname=STYLE):
        yield


def save(figure: Figure, path: str | os.PathLike, formats: Sequence[str] = ("png", "svg")) -> list[Path]:
    """Write a figure to files, and return them in the order of ``formats``, some of :data:`FORMATS`. The path has no
    suffix. The same figure gives the same bytes. Existing files are replaced atomically. Raises InputError if a file
    can't be written."""
    stem = Path(path)
    return [_write(figure, stem.with_name(f"{stem.name}.{kind}"), kind) for kind in formats]


def _write(figure: Figure, path: Path, kind: str) -> Path:
    drawn = io.BytesIO()  # on a full disk matplotlib's PDF writer fails a second time in closing the file
    with styled():
        figure.savefig(drawn, format=kind, metadata=_METADATA[kind])
    with whole(path) as part:
        part.write_bytes(drawn.getvalue())
    return path
