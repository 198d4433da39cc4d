"""Estimated time and size of a study before it starts, from a short run of each law."""

import dataclasses
import time
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...engine.run import LawError, simulate
from ...errors import InputError
from ...scenario import Scenario
from ..check import LEAST, SHARE
from ..results import blocks, schema_of
from ..rows import chosen_engine

if TYPE_CHECKING:
    from ..plan import Plan

_PROBE_S = 0.2
"""Simulated time of a probe [s]."""
_PART_BYTES, _ROW_BYTES = 600, 9
"""Size of each column of a part, and of each number in it [bytes]."""


@dataclass(frozen=True)
class Estimate:
    """Expected wall time [s] of a study, the size of its rows [bytes], and that of the log of one run [bytes]."""

    seconds: float
    rows_bytes: int
    log_bytes: int


def estimate(plan: "Plan", workers: int) -> Estimate:
    """Estimate a study on so many workers. A run that fails counts as one without steps."""
    steps, runs = plan.steps / len(plan.laws), plan.runs / len(plan.laws)
    seconds, log_bytes = 0.0, 0
    for law in range(len(plan.laws)):
        try:
            scenario = plan.scenario(law * plan.repeats)
            engine = chosen_engine(scenario) if plan.engine == "auto" else plan.engine
            fixed_s, step_s, row_bytes = _probe(scenario, engine)
            seconds += runs * fixed_s + steps * step_s
            log_bytes = max(log_bytes, round(row_bytes * scenario.simulation.duration * 1000.0))
            if plan.engine == "auto" and engine == "free_body":
                repeated = min(runs, max(LEAST / len(plan.laws), SHARE * runs) + len(plan.metrics) / len(plan.laws))
                fixed_s, step_s, _ = _probe(scenario, "mujoco")
                seconds += repeated * (fixed_s + steps / runs * step_s)
        except (InputError, LawError):
            continue
    columns, parts = len(schema_of(plan)), len(blocks(plan.runs))
    return Estimate(seconds / workers, columns * (parts * _PART_BYTES + plan.runs * _ROW_BYTES), log_bytes)


def _probe(scenario: Scenario, engine: str) -> tuple[float, float, int]:
    """Wall time of a run besides its steps, that of a step [s], and the size of a row of its log [bytes]. The first of
    two short runs loads what both need."""
    stepping = scenario.simulation
    short = dataclasses.replace(stepping, duration=min(_PROBE_S, stepping.duration))
    for _ in range(2):
        start = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            trace = simulate(dataclasses.replace(scenario, simulation=short), keep_s=0.0, engine=engine)
        whole_s = time.perf_counter() - start
    return whole_s - trace.wall_time_s, trace.wall_time_s / max(1, trace.steps), 8 * trace.header.width
