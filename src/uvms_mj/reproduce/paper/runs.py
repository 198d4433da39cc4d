"""The paper's section 5 as a set of runs: plans the runs, executes them on all cores and reads their logs."""

import dataclasses
import tempfile
import warnings
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ...control import Gsta
from ...engine.run import simulate
from ...engine.vehicle_run import SinkError
from ...errors import InputError
from ...records.header import Status
from ...records.mcap import McapLog
from ...records.trace import Trace
from ...scenario import Scenario
from ...setup.checks import SamplingWarning
from ...studies.pool.executors import WorkerLost, Workers, each_call


@dataclass(frozen=True)
class PaperRun:
    """One run of the paper: the label in figures and tables, the name of the law, and its gains by dotted key."""

    label: str
    law: str
    gains: Mapping[str, Any] = field(default_factory=dict)


RUNS: Mapping[str, PaperRun] = {
    "impedance": PaperRun("impedance", "impedance"),
    "fosm": PaperRun("first-order", "fosm"),
    "gsta": PaperRun("GSTA", "gsta", {"controller.nominal": True}),
    "gsta_alone": PaperRun("GSTA alone", "gsta", {"controller.nominal": False}),
}
"""The paper's runs by the names of their logs, which are also the arguments of :func:`uvms_mj.views.figures.paper`."""
LABELS = {name: run.label for name, run in RUNS.items()}
TUNED = ("fosm", "gsta")
"""Laws with gains of their own, which can be set for the study."""
FINE_S = 0.2
"""Length of the beginning of each run that is recorded at every step [s]."""
SHORT_S = 1.0
"""Duration that shows whether a law chatters, before the reference moves [s]."""
FINE, SWEEP = "_fine", "sweep_"
"""Suffix and prefix of the names of the other logs."""


@dataclass(frozen=True, eq=False)
class Runs:
    """Traces of the study's runs by the names of :func:`plan`; ``fine`` has the beginning
    of the same runs as ``traces`` at every step, ``sweep`` the variations."""

    traces: Mapping[str, Trace]
    fine: Mapping[str, Trace]
    sweep: Mapping[str, Trace]


def plan(scenario: Scenario, gains: Mapping[str, Mapping[str, Any]] = MappingProxyType({})) -> dict[str, Scenario]:
    """Scenarios of all runs of the study, by the name of their log; the longest first.

    The scenario has the common settings; its gains apply to the runs of the same law. ``gains`` are dotted keys and
    values for the runs of a law, by its name: ``{"fosm": {"controller.K_s": 24.0}}``.
    """
    tables = scenario.to_dict()
    base = {
        name: Scenario.from_dict(tables, {**gains.get(each.law, {}), **each.gains}, each.law)
        for name, each in RUNS.items()
    }
    impedance, fosm, gsta = base["impedance"], base["fosm"], base["gsta"]
    h, wall = scenario.simulation.timestep, scenario.wall.position
    K_x, *K_rest = scenario.impedance.K_d
    short = {"simulation.duration": min(SHORT_S, scenario.simulation.duration)}
    fine = {"simulation.duration": min(FINE_S, scenario.simulation.duration)}
    sweep = {
        "impedance_still": impedance.updated({"current.speed": 0.0}),
        "impedance_nearer": impedance.updated({"wall.position": wall - 0.02}),
        "impedance_stiffer": impedance.updated({"impedance.K_d": [10.0 * K_x, *K_rest]}),
        "fosm_half_epsilon": fosm.updated(short | {"controller.epsilon": 0.5 * _gain(fosm, "epsilon")}),
        "fosm_double_K_s": fosm.updated(short | {"controller.K_s": 2.0 * _gain(fosm, "K_s")}),
        "gsta_quarter_step": gsta.updated({"simulation.timestep": 0.25 * h}),
        "gsta_overestimated": gsta.updated(_estimates(inertia=1.5, others=1.5)),
        "gsta_underestimated": gsta.updated(_estimates(inertia=0.8, others=0.5)),
        "gsta_half_inertia": gsta.updated(_estimates(inertia=0.5, others=1.0)),
    }
    return (
        base
        | {f"{SWEEP}{name}": varied for name, varied in sweep.items()}
        | {f"{name}{FINE}": each.updated(fine) for name, each in base.items()}
    )


def _estimates(inertia: float, others: float) -> dict[str, float]:
    """Settings for the law's estimates of M, and of C, D and g, relative to the true values."""
    return {"estimates.inertia": inertia} | {
        f"estimates.{name}": others for name in ("coriolis", "damping", "restoring")
    }


def _gain(scenario: Scenario, name: str) -> float:
    return float(getattr(scenario.controller, name))


def run(
    jobs: Mapping[str, Scenario], folder: Path, progress: Callable[[int, int], None], workers: int | None = None
) -> None:
    """Run every job and write ``folder/<name>.mcap``.

    ``progress`` is called on this thread five times per second with the steps done in all runs and their total. An
    exception that it raises stops all runs, which end their logs. ``workers`` is the number of simultaneous runs;
    default: one per core.

    Raises:
        InputError: a job can't run. The other jobs are stopped.
    """
    total = sum(scenario.steps for scenario in jobs.values())
    with tempfile.NamedTemporaryFile() as file, Workers(workers) as pool:  # which waits until all logs have their end
        steps = np.memmap(file.name, np.int64, "w+", shape=len(jobs) + 1)  # of each job; not zero at the end: stop
        calls = ((name, each.to_dict(), folder, file.name, i) for i, (name, each) in enumerate(jobs.items()))
        try:
            each_call(pool, _log_run, calls, _ended, lambda: progress(int(steps[:-1].sum()), total))
        except BaseException:
            steps[-1] = 1
            raise


def _ended(call: tuple[Any, ...], answer: Any) -> None:
    if isinstance(answer, WorkerLost):
        raise InputError(f"{call[0]}: its worker processes ended: {answer}")


def _log_run(name: str, tables: Mapping[str, Any], folder: Path, file: str, i: int) -> None:
    """Run a job in a worker and write its log. ``file`` has the steps of the jobs, of which this is number i. Raises
    InputError, with the job's name, if it can't run."""
    steps = np.memmap(file, np.int64, "r+")

    def advance(done: int, _: int) -> None:
        steps[i] = done
        if steps[-1]:
            raise KeyboardInterrupt  # lets the run complete its log

    if steps[-1]:
        return
    log_rate, sinks = "full" if name.endswith(FINE) else None, [McapLog(folder / f"{name}.mcap")]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SamplingWarning)  # some runs chatter by intention; the logs have the notes
            simulate(Scenario.from_dict(tables), sinks=sinks, log_rate=log_rate, progress=advance, keep_s=0.0)
    except InputError as error:
        raise InputError(error.faults, name) from None
    except (OSError, SinkError) as error:
        raise InputError(f"{name}: {error}") from None


def load(folder: Path, names: Iterable[str]) -> Runs:
    """Load the runs from a folder of logs. Raises InputError if a log is missing, damaged or incomplete, or its
    scenario does not match its name."""
    names = list(names)
    missing = [name for name in names if not (folder / f"{name}.mcap").is_file()]
    if missing:
        raise InputError(f"{folder}: missing logs: {', '.join(f'{name}.mcap' for name in missing)}")
    with ThreadPoolExecutor() as pool:
        loaded = dict(zip(names, pool.map(lambda name: Trace.load(folder / f"{name}.mcap"), names), strict=True))
    cut = [
        name
        for name, each in loaded.items()
        if each.status in (Status.interrupted, Status.failed, Status.truncated) or not len(each)
    ]
    if cut:
        raise InputError(f"{folder}: incomplete logs: {', '.join(f'{name}.mcap' for name in cut)}")
    _check_names(folder, {name: each.scenario for name, each in loaded.items()})
    return Runs(
        traces={name: loaded[name] for name in RUNS},
        fine={name: loaded[f"{name}{FINE}"] for name in RUNS},
        sweep={name.removeprefix(SWEEP): loaded[name] for name in names if name.startswith(SWEEP)},
    )


def _check_names(folder: Path, found: Mapping[str, Scenario]) -> None:
    """Raise InputError if the scenario of a log does not match its name.

    The runs of the laws differ only in the law. Every other run is a variation of one of them.
    """
    plans = [plan(found[name]) for name in RUNS]
    worlds = {name: dataclasses.replace(found[name], controller=Gsta()) for name in RUNS}
    most = max(worlds.values(), key=list(worlds.values()).count)
    for name, scenario in found.items():
        alike = worlds.get(name, most) == most
        if not alike or all(each[name] != scenario for each in plans):
            what = f"{scenario.controller.label()} for {scenario.simulation.duration:g} s"
            raise InputError(f"{folder / name}.mcap: contains a run of {what}, which does not match the name")
