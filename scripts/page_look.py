"""The look of the pictures of the guides: that of all figures, as wide as a page, so that text of 7 pt has 11 pixels
where the page is 800 pixels wide."""

import io
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

from uvms_mj.views.figures.style import PAGE_IN

DOCS = Path(__file__).parents[1] / "docs"
DPI = 180
"""Pixels in an inch: a picture is 1278 pixels wide, for screens with more pixels than a page has."""


def written(figure: Figure, name: str, colours: int = 128) -> None:
    """Write docs/NAME.png with a palette of this many colours. The figure is as wide as :data:`PAGE_IN`."""
    assert abs(figure.get_figwidth() - PAGE_IN) < 1e-9, "a picture is as wide as a page"
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=DPI)
    file = DOCS / f"{name}.png"
    Image.open(drawn).convert("RGB").quantize(colours, Image.Quantize.MAXCOVERAGE).save(file, optimize=True)
    print(f"{file}: {file.stat().st_size / 1000:.0f} kB")
