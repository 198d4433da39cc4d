"""docs/evidence/contact10.md: the level that each shipped law holds on each task, and the push over time on one task.

The numbers are from the result that the package has. With the folder of `uvms-mj bench --draws seed:N --out FOLDER` its
result becomes the package's first, and the pictures are drawn.
"""

import gzip
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from page_look import written
from uvms_mj.reproduce.bench import RESULT
from uvms_mj.reproduce.bench.page import colours_of, courses, order
from uvms_mj.reproduce.bench.results import SHIPPED, parsed, shipped
from uvms_mj.reproduce.bench.task import Entry, tasks
from uvms_mj.studies.results import frame

DRAWN = "gusts_and_delay"


def of(found: dict[str, Any], law: str, task: str) -> dict[str, Any]:
    """The ladder of a law."""
    return next(each for each in found["laws"] if each["label"] == law)["tasks"][task]


def numbers(folder: str | None = None) -> Iterator[tuple]:
    found = shipped()
    names = list(found["tasks"])
    for law in found["laws"]:
        levels = [law["tasks"][name]["level"] for name in names]
        yield f"| {law['label']} |" + " {} |" * len(levels), *levels

    def level(law: str, task: str) -> int:
        return int(of(found, law, task)["level"])

    band, real = ([level(law, task) for law in ("gsta", "dob_impedance")] for task in ("gust_band", "everything_real"))
    yield "In gusts at 1 kHz GSTA holds level {} and the observer level {};", *band
    yield "with everything real at 50 Hz GSTA holds level {} and the observer level {}.", *real
    slow = [level(law, "stiff_and_slow") for law in ("parallel", "gsta")]
    yield "`parallel` holds level {} of task 3, GSTA level {}.", *slow
    yield "In gusts it holds level {} of task 2.", level("parallel", "gust_band")
    yield (
        "ends at levels {}, {} and {}.",
        *(level("ideal", task) for task in ("landing", "two_bumpers", "heaving_hull")),
    )


def main(folder: Path) -> None:
    found = parsed((folder / RESULT).read_bytes(), str(folder / RESULT))
    SHIPPED.write_bytes(gzip.compress((folder / RESULT).read_bytes(), mtime=0))
    shown = dict(zip([law["label"] for law in found["laws"]], colours_of(found), strict=True))
    written(order(found, shown), "contact10_order", 255)
    task, rows, hues = tasks()[DRAWN], {}, {}
    for law in found["laws"]:
        label, ladder = law["label"], law["tasks"][DRAWN]
        level = max(ladder["levels"])
        title = f"{label}, level {level}"
        rows[title] = frame(folder / label / DRAWN / f"level-{level}").iloc[: ladder["levels"][level]["draws"]]
        hues[title] = shown[label]
    base = Entry("gsta", "gsta").plan(task, 1, most=1).base
    written(courses(task, base, rows, hues).figure, "contact10", 255)
