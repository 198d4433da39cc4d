"""Regenerate the pictures in docs, and write the numbers of the pages that come from runs.

    python scripts/draw_docs.py                   all pages that can do without a folder, and the drawings
    python scripts/draw_docs.py sampling water    these pages alone
    python scripts/draw_docs.py practicality --folder real      from the folder of `uvms-mj practicality --out real`

The folder pages has a script for each page: ``main`` draws its picture, ``numbers`` has its numbers (page_numbers.py).
Those of long runs take a folder:

    paper            of `uvms-mj paper --out FOLDER`; without it, the certificate alone
    benchmarks       of `scripts/benchmark.py --json FOLDER/benchmark.json`
    practicality     of `uvms-mj practicality --out FOLDER`
    studies          of `uvms-mj study NAME --out FOLDER/SHORT`: monte_carlo as mc, gain_map as gm, waves as wv
    validation       of the records of the pool, which are not in the repository

replay.png needs a Vulkan driver, push_wall.png, push.gif, vehicles.png, arms.png and walls.png an EGL driver.
"""

import subprocess
import sys
import warnings
from pathlib import Path

import click
import matplotlib as mpl

from page_numbers import PAGES, corrected, faults, needs_folder, page, script

SCRIPTS = Path(__file__).parent
DRAWINGS = ("draw_frames.py", "draw_rooms.py", "render.py", "film.py", "picture_viewer.py")


def redraw(name: str, folder: Path | None) -> None:
    """Draw the picture of a page, and write its numbers."""
    click.echo(name)
    module = script(name)
    given = [folder] if folder else []
    if hasattr(module, "main"):
        module.main(*given)
    text, sentences = page(name).read_text(), list(module.numbers(*given))
    if hasattr(module, "long_numbers"):
        sentences += module.long_numbers()
    for fault in faults(text, sentences):
        click.echo(f"  mended: {fault}")
    page(name).write_text(corrected(text, sentences))


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
    if folder and len(names) != 1:
        raise click.UsageError("--folder is for one page")
    for name in names or sorted(path.stem for path in PAGES.glob("*.py")):
        if not folder and needs_folder(script(name).numbers):
            click.echo(f"{name}: left as it is, since it needs --folder")
        else:
            redraw(name, folder)


if __name__ == "__main__":
    main()
