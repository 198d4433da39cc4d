"""Regenerate all pictures in docs.

    python scripts/draw_docs.py                   all pictures in docs
    python scripts/draw_docs.py --from results    paper.png from the logs of an earlier `uvms-mj paper --out results`
    python scripts/draw_docs.py --pool pool_2023  pool.png too, from the records in the folder pool_2023

replay.png needs a Vulkan driver, push_wall.png, vehicles.png and walls.png an EGL driver, and the pages of the studies
Chromium; see picture_viewer.py, render.py and picture_studies.py, which takes a quarter of an hour. The folder pages
has a script for each subject.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import click

SCRIPTS = Path(__file__).parent
DOCS = SCRIPTS.parent / "docs"
PAGES = SCRIPTS / "pages"
PRACTICALITY = PAGES / "practicality.py"
"""Draws from a folder of ``uvms-mj practicality``."""
POOL = PAGES / "pool.py"
"""Draws from records that are not in the repository."""
FAILED_CLAIM = 1
"""Exit status of ``uvms-mj paper`` if a claim fails. The figures exist nevertheless."""


def draw(*arguments: str, also: tuple[int, ...] = ()) -> None:
    """Run Python with arguments. Exit unless the status is 0 or one of ``also``."""
    click.echo(" ".join(arguments))
    status = subprocess.run([sys.executable, *arguments]).returncode
    if status not in (0, *also):
        sys.exit(status)


@click.command()
@click.option("--from", "source", type=click.Path(exists=True, path_type=Path), help="Folder of an earlier run.")
@click.option("--pool", type=click.Path(exists=True, path_type=Path), help="Folder of the records of the pool.")
def main(source: Path | None, pool: Path | None) -> None:
    """Regenerate all pictures in docs."""
    with tempfile.TemporaryDirectory() as folder:
        drawn = Path(folder) / "paper"
        logs = ("--from", str(source)) if source else ()
        draw("-m", "uvms_mj", "paper", *logs, "--out", str(drawn), also=(FAILED_CLAIM,))
        shutil.copyfile(drawn / "overview.png", DOCS / "paper.png")
        real = Path(folder) / "real"
        draw("-m", "uvms_mj", "practicality", "--out", str(real), also=(FAILED_CLAIM,))
        draw(str(PRACTICALITY), str(real))
    for script in ("draw_frames.py", "draw_rooms.py", "render.py", "picture_viewer.py", "picture_studies.py"):
        draw(str(SCRIPTS / script))
    for page in sorted(PAGES.glob("*.py")):
        if page not in (PRACTICALITY, POOL):
            draw(str(page))
    if pool:
        draw(str(POOL), str(pool))


if __name__ == "__main__":
    main()
