"""Draw the pages of the shipped studies for the docs: docs/monte_carlo.png and docs/gain_map.png.

    python scripts/picture_studies.py                                  runs both studies first
    python scripts/picture_studies.py --from FOLDER                    with FOLDER/monte_carlo and FOLDER/gain_map

It needs Chromium.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import click
from PIL import Image

DOCS = Path(__file__).parents[1] / "docs"
STUDIES = ("monte_carlo", "gain_map")
WIDTH, HEIGHT = 1100, 1330
"""Size of the picture, the beginning of the page [px]."""
COLOURS = 48
"""Colours of the picture's palette."""


def picture(page: Path, to: Path) -> None:
    """Write the beginning of a page as a PNG."""
    browser = next(
        (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), ""
    )
    if not browser:
        raise click.ClickException("needs Chromium")
    with tempfile.TemporaryDirectory() as folder:
        shot = Path(folder, "page.png")
        options = ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars")
        size = (f"--window-size={WIDTH},{HEIGHT}", f"--screenshot={shot}")
        subprocess.run([browser, *options, *size, page.absolute().as_uri()], check=True, capture_output=True)
        Image.open(shot).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(to, optimize=True)


@click.command()
@click.option("--from", "source", type=click.Path(exists=True, path_type=Path), help="Folder of earlier runs.")
def main(source: Path | None) -> None:
    """Draw the pages of the shipped studies."""
    with tempfile.TemporaryDirectory() as temporary:
        for name in STUDIES:
            folder = (source or Path(temporary)) / name
            if source is None:
                subprocess.run([sys.executable, "-m", "uvms_mj", "study", name, "--out", folder], check=True)
            page = Path(temporary, f"{name}.html")
            subprocess.run([sys.executable, "-m", "uvms_mj", "study", "report", folder, "--out", page], check=True)
            picture(page, DOCS / f"{name}.png")


if __name__ == "__main__":
    main()
