"""``uvms-mj study report``: one HTML page of a study's results."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .common import bad_input, draw_to_files, refuse_existing
from .options import command, force_option, path_argument, path_option

if TYPE_CHECKING:
    from ..studies.pages import Table
    from ..studies.study import Study

PAGE = "report.html"


@command("report")
@path_argument("folder", metavar="DIR")
@path_option("-o", "--out", metavar="FILE.html", help=f"File for the page [default: DIR/{PAGE}, replaced].")
@force_option
def study_report(folder: str, out: str | None, force: bool) -> None:
    """Write one HTML page about the results of a study, also while it runs: success rates, distributions, maps over
    the varied keys, sensitivity, differences between laws, and the runs to look at.

    \b
    uvms-mj study report runs/monte_carlo
    uvms-mj study report results --out monday.html
    """
    draw_to_files()
    with bad_input():
        from ..errors import InputError

        if out is not None:
            if Path(out).suffix.lower() not in (".html", ".htm"):
                raise InputError(f"--out {out!r}: the name must end in .html")
            refuse_existing("--out", Path(out), force)
        from ..studies import pages
        from ..studies.report import page
        from ..studies.study import Study

        if not Path(folder).is_dir():
            raise InputError(f"{folder}: is not a folder with the results of a study")
        study = Study.load(folder)
        path = Path(folder, PAGE) if out is None else Path(out)
        pages.write(path, page(study.plan_of_results, study.frame, folder, _versions(Path(folder)), _checked(study)))
        click.echo(path)


def _versions(folder: Path) -> dict[str, str]:
    """Versions of the code of a study by name; empty if they can't be read."""
    from ..errors import InputError
    from ..studies.results import version_of

    try:
        return dict(version_of(folder)["code"])
    except InputError:
        return {}


def _checked(study: "Study") -> "list[Table]":
    """The largest difference of each number between the engines."""
    from ..studies.check import largest
    from ..studies.pages import Table

    found = study.check
    if found is None:
        return []
    heads = ["free_body", "mujoco", "difference", "tolerance", "row", "within"]
    rows = [
        (each["number"], [*(each[head] for head in heads[:4]), each["index"], "yes" if each["within"] else "no"])
        for each in largest(found).to_dict("records")
    ]
    runs = found["index"].nunique()
    return [Table(f"free_body against mujoco in {runs} runs, largest differences", heads, rows)]
