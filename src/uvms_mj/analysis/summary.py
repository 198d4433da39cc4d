"""Summary of a run, as printed by ``uvms-mj run`` and ``uvms-mj info``."""

import math
from typing import Any

import numpy as np

from ..control.rest import NoClosedForm, SteadyState
from ..records.trace import Trace
from ..stages.signals import FINAL_WINDOW_S
from .metrics import final_force

AROUND_THE_END_S = 2.0 * FINAL_WINDOW_S
"""Length of the end of a run that :func:`summary` needs [s]. The running signals cover the rest."""


def summary(trace: Trace, files: dict[str, str]) -> dict[str, Any]:
    """The numbers that ``uvms-mj run --json`` prints. Missing numbers and numbers that are not finite are None.

    The relative error is None unless the force has settled, because the closed form describes the state at rest.

    Args:
        trace: the run.
        files: paths of the written files, by kind.
    """
    final_N, settled = final_force(trace)
    analytic = trace.analytic
    rests_on_wall = isinstance(analytic, SteadyState) and analytic.force > 0.0
    analytic_N = analytic.force if rests_on_wall and isinstance(analytic, SteadyState) else None
    error = (final_N - analytic_N) / analytic_N if settled and final_N and analytic_N else None
    some = len(trace) > 0

    def last(name: str) -> Any:
        return _plain(trace[name][-1]) if some and name in trace.arrays else None

    report = {
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
            "first_s": last("first_contact") if some and trace.touches[-1] > 0 else None,
            "touches": int(trace.touches[-1]) if some else 0,
            "peak_N": last("force_peak"),
            "impulse_Ns": last("impulse"),
            "final_N": final_N,
            "settled": settled,
            "analytic_N": analytic_N,
            "relative_error": error,
        },
        "effort_N2s": float(trace.effort[-1][:3].sum()) if some else None,
        "saturated_s": last("saturation_time"),
        "final": {
            "position_m": last("p_WB"),
            "attitude_wxyz": last("quat_WB"),
            "s": last("s"),
            "z": last("z"),
            "tau": last("tau"),
        },
        "analytic": {
            "position_m": None if (position := getattr(analytic, "position", None)) is None else _plain(position),
            "none_because": analytic.reason if isinstance(analytic, NoClosedForm) else None,
        },
        "files": files,
    }
    return _finite(report)


def _finite(value: Any) -> Any:
    """The same value with None in place of numbers that are not finite, which JSON lacks."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.ndim:
        return [_plain(v) for v in value]
    return float(value)
