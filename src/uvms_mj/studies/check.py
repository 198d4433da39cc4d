"""The check of the free-body engine by a sample of a study's runs, which are repeated in MuJoCo.

The sample is one run in a hundred, at least five, and the worst run by each metric that is kept. Compared are

- the status;
- the final position, relative to 1 m;
- the rest force, relative to its value in MuJoCo, where it has settled in both engines;
- the peak force, relative to itself plus the largest thrust, where both engines have the same number of touches.
  A law that chatters at the touch amplifies rounding errors in proportion to its thrust.

A run that diverges is compared by its status alone. A law that chatters touches the wall a number of times that
rounding decides, and its force does not settle; its runs are compared by status and position.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from .plan.metrics import columns_of
from .rows import one_row

if TYPE_CHECKING:
    import pandas as pd

    from .plan import Plan
    from .pool.bundle import StudyBundle

FILE = "check.parquet"
"""Name of the table of differences in the folder of a study."""
SHARE, LEAST = 0.01, 5
"""Share of the free-body runs that are repeated, and their least number."""
METRICS = (
    *("contact.touches", "contact.settled", "contact.final_N", "contact.peak_N"),
    *("final.position_m", "thrust_peak_N"),
)
"""The metrics of the rows that are compared, besides their status."""


def load(folder: Path) -> "pd.DataFrame | None":
    """The differences in the folder of a study; None if it has none. Raises InputError if they are damaged."""
    import pandas as pd

    path = folder / FILE
    try:
        return pd.read_parquet(path) if path.exists() else None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: damaged ({error}); the command that began the study computes it again") from None


def sample(plan: "Plan", rows: "pd.DataFrame") -> list[int]:
    """The runs to repeat in MuJoCo; none for a study that did not ask for engine "auto"."""
    ran = rows[(rows["engine"] == "free_body") & rows["status"].isin(["completed", "unstable"])]
    if plan.engine != "auto" or ran.empty:
        return []
    number = min(len(ran), max(LEAST, math.ceil(SHARE * len(ran))))
    chosen = set(np.random.default_rng(plan.seed).choice(ran["index"].to_numpy(), number, replace=False).tolist())
    for column in rows.columns[list(rows.columns).index("engine") + 1 :]:
        values = ran[column].dropna()
        if len(values) and values.dtype.kind in "fi":
            chosen.add(int(ran.loc[values.idxmax(), "index"]))
    return sorted(chosen)


def compared(bundle: "StudyBundle", index: int, engine: str) -> dict[str, Any]:
    """Run one run of a study in a worker and return its row with the metrics that are compared."""
    return one_row(dataclasses.replace(bundle.plan(), metrics=METRICS, time_limit_s=None), index, engine)


def differences(
    plan: "Plan", indices: Sequence[int], found: Mapping[tuple[int, str], Mapping[str, Any]]
) -> "pd.DataFrame":
    """The differences between rows ``found`` by index and engine, one for each run and number: index, law, number,
    free_body, mujoco, difference [1], tolerance [1], within."""
    import pandas as pd

    rows = []
    for index in indices:
        free, full = found[index, "free_body"], found[index, "mujoco"]
        same = free["status"] == full["status"]
        compared = [("status", None, None, 0.0 if same else math.inf)]
        if same and full["status"] == "completed":
            compared += list(_numbers(free, full))
        for number, ours, theirs, difference in compared:
            rows.append((index, plan.run(index).law, number, ours, theirs, difference, plan.tolerance))
    columns = ["index", "law", "number", "free_body", "mujoco", "difference", "tolerance"]
    frame = pd.DataFrame(rows, columns=columns).astype({"free_body": float, "mujoco": float})
    return frame.assign(within=frame["difference"] <= frame["tolerance"])


def largest(found: "pd.DataFrame") -> "pd.DataFrame":
    """The largest difference of each number."""
    return found.loc[found.groupby("number", sort=False)["difference"].idxmax()]


def _numbers(free: Mapping[str, Any], full: Mapping[str, Any]) -> Any:
    """The compared numbers of two runs with one status: name, values, difference."""
    for name in columns_of("final.position_m"):
        yield name, free[name], full[name], abs(free[name] - full[name])
    for name, comparable, scale in (
        ("contact.final_N", free["contact.settled"] and full["contact.settled"], 0.0),
        ("contact.peak_N", free["contact.touches"] == full["contact.touches"], full["thrust_peak_N"]),
    ):
        ours, theirs = free[name], full[name]
        if comparable and ours is not None and theirs:
            yield name, ours, theirs, abs(ours - theirs) / (abs(theirs) + scale)
