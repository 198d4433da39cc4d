"""The look of the pictures of the guides, as of all figures: as wide as a page, so that text of 7 pt has 11 pixels
where the page is 800 pixels wide."""

import io
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

from uvms_mj.views.figures.style import PAGE_IN, styled

DOCS = Path(__file__).parents[1] / "docs"
DPI = 180
"""Pixels in an inch: a picture is 1278 pixels wide, for screens with more pixels than a page has."""


def written(figure: Figure, name: str, colours: int = 128) -> None:
    """Write NAME.png in place, with a palette of this many colours. The figure is as wide as :data:`PAGE_IN`."""
    stacked([figure], name, colours)


def stacked(figures: Sequence[Figure], name: str, colours: int = 128) -> None:
    """Write NAME.png of figures below one another, where it is in docs.

    With all 256 colours it is dithered, as a rendered scene needs it.
    """
    drawn = [_drawn(figure) for figure in figures]
    whole = Image.new("RGB", (drawn[0].width, sum(each.height for each in drawn)), "white")
    top = 0
    for each in drawn:
        whole.paste(each, (0, top))
        top += each.height
    places = (file for file in DOCS.rglob(f"{name}.png") if "_build" not in file.parts)  # a built site has copies
    file = next(places, DOCS / f"{name}.png")
    if colours == 256:
        palette = whole.quantize(colours, Image.Quantize.FASTOCTREE)
        few = whole.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)
    else:
        few = whole.quantize(colours, Image.Quantize.MAXCOVERAGE)
    few.save(file, optimize=True)
    print(f"{file}: {file.stat().st_size / 1000:.0f} kB")


def _drawn(figure: Figure) -> Image.Image:
    assert abs(figure.get_figwidth() - PAGE_IN) < 1e-9, "a picture is as wide as a page"
    file = io.BytesIO()
    with styled():
        figure.savefig(file, format="png", dpi=DPI)
    return Image.open(file).convert("RGB")
