"""What is common to all figures: the style file, colours, sizes, and files that are the same for the same data."""

import contextlib
import io
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from ..outputs import whole

STYLE = Path(__file__).with_name("uvms_mj.mplstyle")
"""The one place for fonts, widths and colours."""
COLUMN_IN, PAGE_IN = 3.4, 7.1
"""Width of a column and of a page [in]."""
SMALL = 6.0
"""Size of the text in an inset [pt]."""
BLACK, GREY = "#000000", "#777777"
"""Of what is expected or asked for, and of the wall."""

_CYCLE = mpl.rc_params_from_file(STYLE, use_default_template=False)["axes.prop_cycle"].by_key()["color"]
COLOURS = dict(zip(("x", "y", "z", "force", "roll", "pitch", "yaw"), _CYCLE, strict=True))
"""By component, the same in every figure, and that of the contact force."""
LINE = 1.0
"""Width of every line of samples [pt]: none is louder than another."""
_PERIOD, _STRIPE, _MOST_STRIPES = 7.0, 2.5, 6
"""Length of a pattern of dashes, and the least of a line's part in it, in widths of a line; as many lines differ."""

FORMATS = ("png", "svg", "pdf")
_METADATA: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}


def stripe(i: int, n: int) -> dict[str, Any]:
    """The look of line i of n that may lie on each other: where they do, each shows as a stripe of its colour.

    The first is solid and lies lowest. Each later one is drawn over it in dashes that are a little shorter than those
    before, down to half of the pattern.
    """
    shown = min(n, _MOST_STRIPES)
    period = max(_PERIOD, _STRIPE * shown)
    gap = 0.5 * period * (i % shown) / max(1, shown - 1)
    dashes = (0.0, (period - gap, gap)) if gap else "solid"
    return {"linewidth": LINE, "linestyle": dashes, "zorder": 2.0 + 0.01 * i}


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """The style file's settings and matplotlib's defaults, whatever the user's own settings are."""
    with mpl.rc_context(fname=STYLE):
        yield


def save(figure: Figure, path: str | os.PathLike, formats: Sequence[str] = ("png", "svg")) -> list[Path]:
    """Write a figure; the same figure gives the same bytes. What stands there is replaced, each file at once.

    Args:
        figure: what to write.
        path: without suffix.
        formats: of :data:`FORMATS`.

    Returns:
        The files, in the order of ``formats``.

    Raises:
        InputError: a file can't be written.
    """
    stem = Path(path)
    return [_write(figure, stem.with_name(f"{stem.name}.{kind}"), kind) for kind in formats]


def _write(figure: Figure, path: Path, kind: str) -> Path:
    drawn = io.BytesIO()  # on a full disk matplotlib's PDF writer fails twice, the second time in closing
    with styled():
        figure.savefig(drawn, format=kind, metadata=_METADATA[kind])
    with whole(path) as part:
        part.write_bytes(drawn.getvalue())
    return path
