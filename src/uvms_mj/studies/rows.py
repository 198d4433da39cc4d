"""One run of a study, and its row: what varied, how the run ended, and its metrics.

A row depends on the plan and the run's number alone. It has no wall time, so that the rows of a study are the same for
any number of workers, in any order, after any interruption.

**The check of the engine free_body** repeats a sample of a study's runs in MuJoCo, the check of the engine gpu in
free_body. The sample is one run in a hundred, at least five and at most a thousand, and the worst run by each metric
that is kept. Compared are

- the status;
- the final position, relative to 1 m;
- the rest force, relative to its value in the slower engine, where it has settled in both engines;
- the peak force, relative to itself plus the largest thrust, where both engines have the same number of touches.
  A law that chatters at the touch amplifies rounding errors in proportion to its thrust.

A run that diverges is compared by its status alone. A law that chatters touches the wall a number of times that
rounding decides, and its force does not settle; its runs are compared by status and position.
"""

import contextlib
import dataclasses
import functools
import math
import os
import signal
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.metrics import AROUND_THE_END_S
from ..analysis.summary import ending, numbers
from ..engine.engines import refusals
from ..engine.run import simulate
from ..engine.simulation import Simulation
from ..engine.vehicle_run import LawError, SinkError
from ..errors import InputError, error_text
from ..plant.mjcf import Mjcf
from ..records.header import Sink, Status
from ..records.mcap import McapLog
from ..records.trace import Trace
from ..scenario import Scenario
from ..setup.base import set_up
from ..stages.confined import confined
from .plan.metrics import AFTER, BEFORE, METRICS, columns_of, succeeded, users_numbers

if TYPE_CHECKING:
    import pandas as pd

    from .bundle import StudyBundle
    from .plan import Plan


STATUSES = ("completed", "unstable", "failed", "refused", "timed_out", "lost")
"""How a run ended: to its end; a variable left its bound; a law or a metric raised; the scenario cannot run; longer
than the time limit; three workers ended while they ran it."""
_MEASURED = ("completed", "unstable")
_GRACE_S = 10.0
"""Time after the limit of a run at which its worker is ended, if the run does not stop."""


def lost_row(plan: "Plan", index: int) -> dict[str, Any]:
    """The row of a run that ended its workers."""
    why = "e.g. by a crash, for want of memory, or by the time limit"
    return _blank(plan, index) | {"status": "lost", "message": f"three worker processes ended during this run, {why}"}


def rows_of(bundle: "StudyBundle", indices: tuple[int, ...]) -> list[dict[str, Any]]:
    """Run some runs of a study in a worker and return their rows."""
    with confined(bool(bundle.tables["run"].get("confined"))):
        plan = bundle.plan()
        return [one_row(plan, index) for index in indices]


def log_of(bundle: "StudyBundle", index: int, engine: str) -> bytes:
    """Run one run again in a worker and return its log. Where the run fails, the log ends there."""
    with tempfile.TemporaryDirectory(prefix="uvms-mj-") as folder:
        path = Path(folder, "run.mcap")
        one_row(bundle.plan(), index, engine, (McapLog(path),))
        return path.read_bytes() if path.exists() else b""


def _blank(plan: "Plan", index: int) -> dict[str, Any]:
    run = plan.run(index)
    row = dict(zip(BEFORE, (index, run.draw, run.law, run.repeat, run.seed), strict=True))
    row |= {key: run.values.get(key) for key in plan.varied} | dict.fromkeys(AFTER)
    row |= {"status": "", "message": "", "success": False, "engine": plan.engine}
    return row | {column: None for place in plan.metrics if place in METRICS for column in columns_of(place)}


def one_row(plan: "Plan", index: int, engine: str = "", sinks: tuple[Sink, ...] = ()) -> dict[str, Any]:
    """Run one run of a plan and return its row by column. ``engine`` replaces the plan's."""
    engine = engine or plan.engine
    row = _blank(plan, index) | {"engine": engine}
    try:
        scenario = plan.scenario(index)
        mjcf = vehicle_of(scenario.vehicle.model)
        row["engine"] = engine = chosen_engine(scenario, mjcf) if engine in ("auto", "gpu") else engine
        if plan.time_limit_s is not None:
            _compile(scenario, mjcf, engine)
        short = all(place in METRICS and not METRICS[place].of_whole_run for place in plan.metrics)
        keep_s = AROUND_THE_END_S if short else None
        with warnings.catch_warnings(), _limited(plan.time_limit_s) as progress:
            warnings.simplefilter("ignore")  # the row counts them
            trace = simulate(scenario, keep_s=keep_s, mjcf=mjcf, engine=engine, sinks=sinks, progress=progress)
            row |= {"status": trace.status.name, "message": trace.message, "steps": trace.steps}
            if trace.status is Status.interrupted:
                raise KeyboardInterrupt
            row |= _of_trace(plan, row, trace)
    except InputError as error:
        row |= {"status": "refused", "message": str(error)}
    except KeyboardInterrupt:
        if plan.time_limit_s is None:
            raise
        late = f"longer than run.time_limit_s, {plan.time_limit_s:g} s of wall time"
        row |= {"status": "timed_out", "message": late, "steps": None, "warnings": None}
    except LawError as error:
        row |= {"status": "failed", "message": str(error), "steps": error.trace.steps}
    except BaseException as error:  # of a user's metric, or of this package: the other runs go on
        if sinks and isinstance(error, SinkError | OSError):
            raise
        row |= {"status": "failed", "message": error_text(error), "success": False}
    return row


def _of_trace(plan: "Plan", row: dict[str, Any], trace: Trace) -> dict[str, Any]:
    """The columns of a row that a trace gives."""
    found: dict[str, Any] = {"status": trace.status.name, "message": trace.message, "steps": trace.steps}
    found["warnings"] = len(trace.notes) + len(ending(trace))
    if found["status"] in _MEASURED:
        found |= _metrics(plan, trace)
        found |= _judged(plan, row | found)
    return found


def row_of_trace(plan: "Plan", index: int, engine: str, trace: Trace) -> dict[str, Any] | str:
    """The row of a run whose trace is there already; or what a metric misses in the trace."""
    row = _blank(plan, index) | {"engine": engine}
    try:
        return row | _of_trace(plan, row, trace)
    except (AttributeError, KeyError) as error:
        return str(error.args[0] if error.args else error)
    except Exception as error:  # of a metric: the other runs go on
        return row | {"status": "failed", "message": error_text(error), "success": False}


def _compile(scenario: Scenario, mjcf: Mjcf, engine: str) -> None:
    """Compile the stages of a scenario once a process: the time limit is for a run alone."""
    kinds = tuple(type(stage) for stage in scenario.stages)
    if kinds not in _compiled:
        Simulation(scenario, engine=engine, mjcf=mjcf).close()
        _compiled.add(kinds)


_compiled: set[tuple[type, ...]] = set()


vehicle_of = functools.lru_cache(maxsize=8)(Mjcf.find)
"""The model of a vehicle."""


def chosen_engine(scenario: Scenario, mjcf: Mjcf | None = None) -> str:
    """The engine of a run with engine "auto": free_body where it can."""
    return "mujoco" if refusals(set_up(scenario, mjcf)) else "free_body"


@contextlib.contextmanager
def _limited(limit_s: float | None) -> Iterator[Callable[[int, int], None] | None]:
    """Bound the wall time of a run. Yields the run's progress function, which interrupts a run that takes longer.

    A signal interrupts a loop of a user's stage. If the run still goes on, the process is ended.
    """
    if limit_s is None:
        yield None
        return
    end = time.monotonic() + limit_s

    def interrupt(*_: Any) -> None:
        if time.monotonic() >= end:
            raise KeyboardInterrupt

    last_resort = threading.Timer(limit_s + _GRACE_S, os._exit, (1,))
    last_resort.daemon = True
    last_resort.start()
    alarm = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGALRM, interrupt) if alarm else None
    if alarm:
        signal.setitimer(signal.ITIMER_REAL, limit_s + 1e-3, 1.0)
    try:
        yield interrupt
    finally:
        if alarm:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)
        last_resort.cancel()


def _judged(plan: "Plan", row: dict[str, Any]) -> dict[str, Any]:
    """The columns that say whether a run is a success, or that a metric of the user's gave no number for it."""
    missing = [column for column in plan.success if column not in row]
    if not missing or row["status"] != "completed":
        return {"success": succeeded(row, plan.success)}
    name = missing[0].partition(".")[0]
    there = ", ".join(column for column in row if column.partition(".")[0] == name)
    return {"status": "failed", "message": f"success.{missing[0]}: no such number; the metric {name} gives {there}"}


def _metrics(plan: "Plan", trace: Trace) -> dict[str, Any]:
    """The metrics of a run by column."""
    found: dict[str, Any] = {}
    for place, value in numbers(trace, [place for place in plan.metrics if place in METRICS]).items():
        columns = columns_of(place)
        each = value or [None] * len(columns) if METRICS[place].size > 1 else [value]
        found |= {column: None if x != x else x for column, x in zip(columns, each, strict=True)}  # nan is no number
    for place in plan.metrics:
        found |= {} if place in METRICS else users_numbers(place, trace)
    return found


CHECK = "check.parquet"
"""Name of the table of differences in the folder of a study."""
SHARE, LEAST, MOST_REPEATED = 0.01, 5, 1000
"""Share of the runs that are repeated in another engine, and their least and greatest number."""
COMPARED = (
    *("contact.touches", "contact.settled", "contact.final_N", "contact.peak_N"),
    *("final.position_m", "thrust_peak_N"),
)
"""The metrics of the rows that are compared, besides their status."""


def checked(folder: Path) -> "pd.DataFrame | None":
    """The differences in the folder of a study; None if it has none. Raises InputError if they are damaged."""
    import pandas as pd

    path = folder / CHECK
    try:
        return pd.read_parquet(path) if path.exists() else None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: damaged ({error}); the command that began the study computes it again") from None


def pair_of(plan: "Plan") -> tuple[str, ...]:
    """The engine of a study and the slower one that repeats a sample of its runs; empty if there is none."""
    return {"auto": ("free_body", "mujoco"), "gpu": ("gpu", "free_body")}.get(plan.engine, ())


def sample(plan: "Plan", rows: "pd.DataFrame") -> list[int]:
    """The runs to repeat in the slower engine of :func:`pair_of`; none for a study without one."""
    engines = pair_of(plan)
    ran = rows[(rows["engine"] == engines[0]) & rows["status"].isin(["completed", "unstable"])] if engines else rows
    if not engines or ran.empty:
        return []
    number = min(len(ran), max(LEAST, math.ceil(SHARE * len(ran))), MOST_REPEATED)
    chosen = set(np.random.default_rng(plan.seed).choice(ran["index"].to_numpy(), number, replace=False).tolist())
    for column in rows.columns[list(rows.columns).index("engine") + 1 :]:
        values = ran[column].dropna()
        if len(values) and values.dtype.kind in "fi":
            chosen.add(int(ran.loc[values.idxmax(), "index"]))
    return sorted(chosen)


def comparing(plan: "Plan") -> "Plan":
    """A plan with the metrics that are compared. Success may need others, and is not compared."""
    return dataclasses.replace(plan, metrics=COMPARED, success={}, time_limit_s=None)


def compared(bundle: "StudyBundle", index: int, engine: str) -> dict[str, Any]:
    """Run one run of a study in a worker and return its row with the metrics that are compared."""
    return one_row(comparing(bundle.plan()), index, engine)


def differences(
    plan: "Plan", indices: Sequence[int], found: Mapping[tuple[int, str], Mapping[str, Any]]
) -> "pd.DataFrame":
    """The differences between rows ``found`` by index and engine, one for each run and number: index, law, number,
    the values of the two engines of :func:`pair_of`, difference [1], tolerance [1], within."""
    import pandas as pd

    rows, engines = [], pair_of(plan)
    for index in indices:
        free, full = (found[index, engine] for engine in engines)
        same = free["status"] == full["status"]
        compared = [("status", None, None, 0.0 if same else math.inf)]
        if same and full["status"] == "completed":
            compared += list(_numbers(free, full))
        for number, ours, theirs, difference in compared:
            rows.append((index, plan.run(index).law, number, ours, theirs, difference, plan.tolerance))
    columns = ["index", "law", "number", *engines, "difference", "tolerance"]
    frame = pd.DataFrame(rows, columns=columns).astype(dict.fromkeys(engines, float))
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
