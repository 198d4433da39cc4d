"""docs/evidence/contact10.md: the level that each shipped law holds on each task, and the push over time on one task.

The numbers are from the result that the package has. With the folder of `uvms-mj bench --draws seed:N --out FOLDER` its
result becomes the package's first, and the pictures are drawn.
"""

import copy
import dataclasses
import gzip
import statistics
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from page_look import written
from uvms_mj.reproduce.bench import RESULT
from uvms_mj.reproduce.bench.figures import colours_of, courses, order
from uvms_mj.reproduce.bench.results import SHIPPED, ended, parsed, shipped
from uvms_mj.reproduce.bench.task import Entry, Task, tasks
from uvms_mj.studies.results import frame
from uvms_mj.studies.rows import one_row

DRAWN = "gusts_and_delay"
BESIDE = "vehicle.contact_bodies.0.position"
EFFECTS: tuple[tuple[str, str, Mapping[str, Any]], ...] = (
    ("the current goes around the wall", "stiff_and_slow", {"obstacle": {}}),
    ("the current goes around the wall", "landing", {"obstacle": {}}),
    ("the current goes around the wall", "everything_real", {"obstacle": {}}),
    ("thrusters lose thrust in inflow", "waves", {"thrusters.inflow_loss": 0.0}),
    ("thrusters lose thrust in inflow", "everything_real", {"thrusters.inflow_loss": 0.0}),
    ("a frame whose drag goes with the speed", "other_vehicle", {"drag": []}),
    ("a contact body beside the middle", "stiff_and_slow", {BESIDE: [0.25, 0.0, 0.0]}),
    ("a contact body beside the middle", "everything_real", {BESIDE: [0.25, 0.0, 0.0]}),
    ("a restitution of 0.8 in place of 0.1", "stiff_and_slow", {"walls.0.restitution": 0.1}),
    ("a pad before the wall", "landing", {"pads": []}),
)
"""What the plant has, the task that has it, and the keys of the task's base without it."""
LEVEL, DRAWS = 3, 6


def of(found: dict[str, Any], law: str, task: str) -> dict[str, Any]:
    """The ladder of a law."""
    return next(each for each in found["laws"] if each["label"] == law)["tasks"][task]


def rows(found: dict[str, Any]) -> Iterator[tuple]:
    """The row of each law: on each task the level that it holds, and the draws passed of the draws at the next."""
    for law in found["laws"]:
        words, values = [f"| {law['label']} |"], []
        for name in found["tasks"]:
            ladder = law["tasks"][name]
            last = ended(ladder)
            words.append("{} |" if last is None else "{}, {}/{} |")
            values += [ladder["level"]] if last is None else [ladder["level"], last[1]["passed"], last[1]["draws"]]
        yield " ".join(words), *values


def ends(found: dict[str, Any]) -> Iterator[tuple]:
    """Of each task the law that came furthest and is not told the truth: the level that ended its ladder, the median
    force error [N] and the largest [N], and the yardstick's on the same level."""
    for name, task in found["tasks"].items():
        laws = [law for law in found["laws"] if not law["knows_the_truth"] and law["tasks"][name]["runs"]]

        def reached(law: Mapping[str, Any], name: str = name) -> tuple[int, float]:
            level, last = law["tasks"][name]["level"], ended(law["tasks"][name])
            return level, last[1]["passed"] / last[1]["draws"] if last else 0.0

        best = max(laws, key=reached)
        last = ended(best["tasks"][name])
        assert last is not None, "no law but the yardstick holds level 5"
        level, own = last
        truth = of(found, "ideal", name)["levels"][level]
        both = (cell["metrics"]["hold.error_N"][which] for cell in (own, truth) for which in ("median", "worst"))
        yield f"| {task['number']} | `{best['label']}` | {level} | {{}} | {{}} | {{}} | {{}} |", *both


def numbers(folder: str | None = None) -> Iterator[tuple]:
    found = shipped()
    yield from rows(found)
    yield from ends(found)

    def level(law: str, task: str) -> int:
        return int(of(found, law, task)["level"])

    band, real = ([level(law, task) for law in ("gsta", "dob_impedance")] for task in ("gust_band", "everything_real"))
    yield "With default gains, in gusts at 1 kHz GSTA holds level {} and the observer level {};", *band
    yield "with everything real at 50 Hz GSTA holds level {} and the observer level {}.", *real
    slow = [level(law, "stiff_and_slow") for law in ("parallel", "gsta")]
    yield "`parallel` holds level {} of task 3, GSTA level {}.", *slow
    yield "In gusts it holds level {} of task 2.", level("parallel", "gust_band")
    yield (
        "observer ends at levels {}, {} and {};",
        *(level("dob_impedance", task) for task in ("landing", "two_bumpers", "heaving_hull")),
    )
    yield "On task 1 tuned `admittance` ends at level {}, and", level("admittance, tuned", "gusts_and_delay")
    yield "on task 10 `parallel` ends at level {}, and the same", level("parallel", "everything_real")
    yield "tuned gains the first holds level {} of task 2,", level("fosm, tuned", "gust_band")
    yield "the second holds level {} of task 10.", level("pid, tuned", "everything_real")
    tuned = level("gsta, tuned", "heaving_hull"), level("gsta, tuned", "arm"), level("gsta", "arm")
    yield "GSTA gains level {} of task 9 and holds level {} of task 7, where it has {} by default.", *tuned


def without(task: Task, keys: Mapping[str, Any]) -> Task:
    """A task with other values of its base."""
    tables = copy.deepcopy(dict(task.tables))
    for key, value in keys.items():
        *path, last = key.split(".")
        at: Any = tables["base"]
        for name in path:
            at = at[int(name) if isinstance(at, list) else name]
        at[last] = value
    return dataclasses.replace(task, tables=tables)


def long_numbers() -> Iterator[tuple]:
    """The effects in newtons: the same draws with and without, under impedance control, which rejects nothing."""
    for what, name, keys in EFFECTS:
        task = tasks()[name]
        plans = [Entry("impedance", "impedance").plan(each, LEVEL, most=DRAWS) for each in (task, without(task, keys))]
        pairs = [[one_row(plan, i) for plan in plans] for i in range(DRAWS)]
        push, peak = (
            statistics.median(abs(one[metric] - other[metric]) for one, other in pairs)
            for metric in ("hold.bias_N", "contact.peak_N")
        )
        yield f"| {what} | {task.number} | {{}} | {{}} |", push, peak


def main(folder: Path) -> None:
    found = parsed((folder / RESULT).read_bytes(), str(folder / RESULT))
    SHIPPED.write_bytes(gzip.compress((folder / RESULT).read_bytes(), mtime=0))
    shown = dict(zip([law["label"] for law in found["laws"]], colours_of(found), strict=True))
    written(order(found, shown), "contact10_order", 255)
    task, rows, hues = tasks()[DRAWN], {}, {}
    for law in found["laws"]:
        label, ladder = law["label"], law["tasks"][DRAWN]
        if label.endswith(", tuned"):
            continue
        level = max(ladder["levels"])
        title = f"{label}, level {level}"
        rows[title] = frame(folder / label / DRAWN / f"level-{level}").iloc[: ladder["levels"][level]["draws"]]
        hues[title] = shown[label]
    base = Entry("gsta", "gsta").plan(task, 1, most=1).base
    written(courses(task, base, rows, hues).figure, "contact10", 255)
