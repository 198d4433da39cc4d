"""docs/evidence/contact10.md: the draws that each shipped law passes, and the force over time on one task.

The numbers are those of the result that the package has. With the folder of `uvms-mj bench --out FOLDER` its result
becomes that of the package first, and the picture is drawn.
"""

import gzip
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from page_look import written
from uvms_mj.reproduce.bench import RESULT
from uvms_mj.reproduce.bench.execution import Job, colours_of, courses
from uvms_mj.reproduce.bench.results import SHIPPED, parsed, shipped
from uvms_mj.reproduce.bench.task import Entry, tasks
from uvms_mj.studies.results import frame

DRAWN = "gusts_and_tether"


def rows(found: dict[str, Any], law: str, task: str) -> list[dict[str, Any]]:
    return next(each for each in found["laws"] if each["label"] == law)["tasks"][task]["rows"]


def varied(task: str, key: str) -> np.ndarray:
    """The values of a key in the draws of a task."""
    plan = Entry("gsta", "gsta").plan(tasks()[task])
    place = plan.varied.index(key)
    return np.array([point[place] for point in plan.points])


def passed(found: dict[str, Any], law: str, task: str) -> np.ndarray:
    return np.array([row["passed"] for row in rows(found, law, task)])


def median(found: dict[str, Any], law: str, task: str, metric: str) -> float:
    values = [row[metric] for row in rows(found, law, task)]
    return float(pd.Series(values).median())


def numbers(folder: str | None = None) -> Iterator[tuple]:
    found = shipped()
    names = list(found["tasks"])
    for law in found["laws"]:
        counts = [law["tasks"][name]["passed"] for name in names]
        yield f"| {law['label']} |" + " {} |" * len(counts), *counts
    stiffness, inertia = varied("any_stiffness", "wall.stiffness"), varied("wrong_model", "estimates.inertia")
    stiff, wrong = passed(found, "gsta", "any_stiffness"), passed(found, "gsta", "wrong_model")
    yield "GSTA passes all walls up to {} N/m and none from {} N/m on", stiffness[stiff].max(), stiffness[~stiff].min()
    yield (
        "less than {} of the true one, and never where it is more than {}",
        inertia[~wrong].max(),
        inertia[wrong].min(),
    )
    yield (
        "the median effort is {} times GSTA's",
        (median(found, "fosm", "force_sensor", "effort_N2s") / median(found, "gsta", "force_sensor", "effort_N2s")),
    )
    yield (
        "hits the wall with {} N (median of its draws), GSTA with {} N",
        *(median(found, law, "unknown_current", "contact.peak_N") for law in ("parallel", "gsta")),
    )
    yield (
        "the median error of GSTA is {} N, of admittance control {} N, of the observer {} N",
        *(median(found, law, DRAWN, "hold.error_N") for law in ("gsta", "admittance", "dob_impedance")),
    )
    yield (
        "chatters with {} N/s in the thrusters (median), and admittance control with {} N/s",
        *(median(found, law, "slide", "chattering_N_per_s") for law in ("gsta", "admittance")),
    )


def main(folder: Path) -> None:
    found = parsed((folder / RESULT).read_bytes(), str(folder / RESULT))
    SHIPPED.write_bytes(gzip.compress((folder / RESULT).read_bytes(), mtime=0))
    task, shown = tasks()[DRAWN], {}
    frames = {}
    for law, colour in zip(found["laws"], colours_of(found), strict=True):
        label = law["label"]
        own = folder / label / DRAWN
        shown[label] = (Job(Entry(label, label), task, False, own, Entry(label, label).plan(task)), colour)
        frames[label] = frame(own)
    picture = courses(
        task, {label: job for label, (job, _) in shown.items()}, frames, {label: c for label, (_, c) in shown.items()}
    )
    assert picture is not None
    written(picture.figure, "contact10", 255)
