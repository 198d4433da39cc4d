"""Numbers from a trace: pure functions, and the summary that a run ends in."""

import math
from typing import Any

import numpy as np

from .closed_forms import NoClosedForm, SteadyState
from .trace import Trace

FINAL_WINDOW_S = 0.5
"""How much of the end of a run its final values are taken from [s]."""
SETTLED = 1e-3
"""A force that changes by less than this part of itself over the window has settled."""


def final_force(trace: Trace) -> tuple[float | None, bool]:
    """Mean pushing force over the last 0.5 s [N], and whether it has settled there.

    The mean is the impulse's increase over the window, so that it counts every step, whatever the log rate.
    """
    if len(trace) == 0:
        return None, False
    t, push = trace.t, trace.push
    start = max(0, int(np.searchsorted(t, t[-1] - FINAL_WINDOW_S + 1e-9, side="right")) - 1)
    window = t[-1] - t[start]
    if window <= 0.0:
        return float(push[-1]), False
    mean = float(trace.impulse[-1] - trace.impulse[start]) / float(window)
    spread = float(np.ptp(push[start:]))
    return max(0.0, mean), bool(window > 0.99 * FINAL_WINDOW_S and spread <= SETTLED * mean)


def summary(trace: Trace, files: dict[str, str]) -> dict[str, Any]:
    """What ``uvms-mj run --json`` prints; what does not exist is None.

    Args:
        trace: the run.
        files: paths of what was written, by kind.
    """
    final_N, settled = final_force(trace)
    analytic = trace.analytic
    rests_on_wall = isinstance(analytic, SteadyState) and analytic.force > 0.0
    analytic_N = analytic.force if rests_on_wall and isinstance(analytic, SteadyState) else None
    error = None if analytic_N is None or final_N is None else (final_N - analytic_N) / analytic_N
    some = len(trace) > 0

    def last(name: str) -> Any:
        return _plain(trace[name][-1]) if some and name in trace.arrays else None

    return {
        "scenario": trace.scenario.name,
        "controller": trace.scenario.controller.label(),
        "status": trace.status.name,
        "message": trace.message or None,
        "warnings": list(trace.notes),
        "steps": trace.steps,
        "timestep_s": trace.scenario.simulation.timestep,
        "duration_s": trace.duration_s,
        "wall_time_s": trace.wall_time_s,
        "real_time_factor": trace.duration_s / trace.wall_time_s if trace.wall_time_s > 0 else None,
        "contact": {
            "first_s": last("first_contact"),
            "touches": int(trace.touches[-1]) if some else 0,
            "peak_N": last("force_peak"),
            "final_N": final_N,
            "settled": settled,
            "analytic_N": analytic_N,
            "relative_error": error,
        },
        "final": {
            "position_m": last("p_WB"),
            "attitude_wxyz": last("quat_WB"),
            "s": last("s"),
            "z": last("z"),
            "tau": last("tau"),
        },
        "analytic": {
            "position_m": _plain(analytic.position) if isinstance(analytic, SteadyState) else None,
            "none_because": analytic.reason if isinstance(analytic, NoClosedForm) else None,
        },
        "files": files,
    }


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.ndim:
        return [_plain(v) for v in value]
    number = float(value)
    return number if math.isfinite(number) else None
