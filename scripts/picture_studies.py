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
from PIL import Image, ImageChops

DOCS = Path(__file__).parents[1] / "docs"
STUDIES = {"monte_carlo": ("laws", "distributions"), "gain_map": ("maps",)}
"""The studies, each with the sections of its page that are drawn."""
WIDTH, MOST = 1000, 2500
"""Width and greatest height of a picture [px]."""
COLOURS = 48
"""Colours of the picture's palette."""


def picture(page: Path, sections: tuple[str, ...], to: Path) -> None:
    """Write some sections of a page as a PNG."""
    browser = next(
        (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), ""
    )
    if not browser:
        raise click.ClickException("needs Chromium")
    with tempfile.TemporaryDirectory() as folder:
        shot, part = Path(folder, "page.png"), Path(folder, "part.html")
        shown = "".join(f":not(:has(#{section}))" for section in sections)
        rule = f"nav, section{shown} {{ display: none }} h2.first, section:first-of-type h2 {{ margin-top: 1rem }}"
        part.write_text(page.read_text().replace("</style>", f"{rule} body {{ padding-bottom: 1rem }}</style>", 1))
        options = ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars")
        size = (f"--window-size={WIDTH},{MOST}", f"--screenshot={shot}")
        subprocess.run([browser, *options, *size, part.as_uri()], check=True, capture_output=True)
        image = Image.open(shot).convert("RGB")
        inked = ImageChops.difference(image, Image.new("RGB", image.size, "white")).getbbox()
        assert inked is not None
        image = image.crop((0, 0, WIDTH, min(MOST, inked[3] + 20)))
        image.quantize(COLOURS, dither=Image.Dither.NONE).save(to, optimize=True)


@click.command()
@click.option("--from", "source", type=click.Path(exists=True, path_type=Path), help="Folder of earlier runs.")
def main(source: Path | None) -> None:
    """Draw the pages of the shipped studies."""
    with tempfile.TemporaryDirectory() as temporary:
        for name, sections in STUDIES.items():
            folder = (source or Path(temporary)) / name
            if source is None:
                subprocess.run([sys.executable, "-m", "uvms_mj", "study", name, "--out", folder], check=True)
            page = Path(temporary, f"{name}.html")
            subprocess.run([sys.executable, "-m", "uvms_mj", "study", "report", folder, "--out", page], check=True)
            picture(page, sections, DOCS / f"{name}.png")


if __name__ == "__main__":
    main()
