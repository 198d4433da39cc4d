"""Regenerate the pictures in docs, and write the numbers of the pages that come from runs.

    python scripts/draw_docs.py                   all pages that need no folder, and the drawings
    python scripts/draw_docs.py sampling water    these pages alone
    python scripts/draw_docs.py practicality --folder real      from the folder of `uvms-mj practicality --out real`

The folder pages has a script for each page: ``main`` draws its picture, ``numbers`` has its numbers (page_numbers.py).
Those of long runs take a folder:

    paper            of `uvms-mj paper --out FOLDER`
    practicality     of `uvms-mj practicality --out FOLDER`
    studies          with mc and gm of `uvms-mj study monte_carlo --out FOLDER/mc`, `uvms-mj study gain_map --out FOLDER/gm`
    validation       of the records of the pool, which are not in the repository

replay.png needs a Vulkan driver, push_wall.png, vehicles.png, arms.png and walls.png an EGL driver, and the pages of the
studies Chromium.
"""

import inspect
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import click
import matplotlib as mpl

from page_numbers import PAGES, corrected, faults, page, script

SCRIPTS = Path(__file__).parent
DRAWINGS = ("draw_frames.py", "draw_rooms.py", "render.py", "picture_viewer.py")


def redraw(name: str, folder: Path | None) -> None:
    """Draw the picture of a page, and write its numbers."""
    click.echo(name)
    module = script(name)
    for each in ("main", "numbers"):
        found = getattr(module, each, None)
        if found is None:
            continue
        given: list[Any] = [folder] if inspect.signature(found).parameters else []
        if each == "main":
            found(*given)
            continue
        text = page(name).read_text()
        sentences = list(found(*given))
        for fault in faults(text, sentences):
            click.echo(f"  mended: {fault}")
        page(name).write_text(corrected(text, sentences))


def needs_folder(name: str) -> bool:
    """Whether a page has the numbers or the picture of runs that are kept in a folder."""
    module = script(name)
    return any(inspect.signature(f).parameters for f in (getattr(module, "main", None), module.numbers) if f)


@click.command()
@click.argument("names", nargs=-1, type=click.Choice(sorted(path.stem for path in PAGES.glob("*.py"))))
@click.option("--folder", type=click.Path(exists=True, path_type=Path), help="Folder of the page's long runs.")
def main(names: tuple[str, ...], folder: Path | None) -> None:
    """Regenerate the pictures in docs, and write the numbers of the pages."""
    mpl.use("Agg")
    warnings.simplefilter("ignore")  # the pages show what runs warn of
    if not names:
        for drawing in DRAWINGS:
            subprocess.run([sys.executable, str(SCRIPTS / drawing)], check=True)
    for name in names or sorted(path.stem for path in PAGES.glob("*.py")):
        if not needs_folder(name) or folder and names:
            redraw(name, folder)
        elif names:
            raise click.UsageError(f"{name} needs --folder")


if __name__ == "__main__":
    main()
