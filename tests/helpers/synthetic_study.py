"""Studies whose rows are formulas: a plan of :class:`Plan` and a frame with the columns of a study's results."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from uvms_mj.studies.plan import Plan

LAWS = ("gsta", "fosm", "impedance")
VARY: list[dict[str, Any]] = [
    {"key": "wall.stiffness", "distribution": "loguniform", "low": 2e4, "high": 2e5},
    {"key": "current.speed", "distribution": "uniform", "low": 0.0, "high": 0.5},
    {"key": "estimates.inertia", "distribution": "uniform", "low": 0.5, "high": 1.5},
]


def plan_of(
    vary: list[dict[str, Any]] | None = None,
    laws: tuple[Any, ...] = LAWS,
    keep: Mapping[str, Any] | None = None,
    success: Mapping[str, Any] | None = None,
    **design: Any,
) -> Plan:
    """A plan of the paper's scenario. ``design`` is the table of the study file."""
    tables = {
        "name": "a study",
        "base": {"scenario": "push_wall"},
        "laws": list(laws),
        "vary": VARY if vary is None else vary,
        "design": {"seed": 7, **design},
        "keep": dict(keep or {}),
        "success": dict(success or {}),
    }
    return Plan.from_dict(tables)


def frame_of(plan: Plan, row: Callable[[dict[str, np.ndarray]], Mapping[str, Any]]) -> pd.DataFrame:
    """The rows of a plan. ``row`` gives status, message and metrics from the columns before them, as arrays."""
    index = np.arange(plan.runs)
    first, repeat = np.divmod(index, plan.repeats)
    draw, law = np.divmod(first, len(plan.laws))
    columns: dict[str, Any] = {
        "index": index,
        "draw": draw,
        "law": np.array([each.label for each in plan.laws])[law],
        "repeat": repeat,
        "seed": index * 7,
    }
    for i, key in enumerate(plan.varied):
        columns[key] = np.array([point[i] for point in plan.points])[draw]
    made = dict(row(columns))
    status = np.asarray(made.pop("status", np.full(len(index), "completed")))
    message = made.pop("message", np.where(status == "completed", None, "it ended"))
    columns |= {"status": status, "message": message, "steps": np.full(len(index), 200_000), "engine": "free_body"}
    return pd.DataFrame(columns | made)


def pushes(seed: int = 0) -> Callable[[dict[str, np.ndarray]], Mapping[str, Any]]:
    """Rows as a push on the wall has them: peaks grow with the stiffness, the first-order law fails in strong currents
    at stiff walls, impedance control alone rests away from the wall."""

    def row(given: dict[str, np.ndarray]) -> Mapping[str, Any]:
        rng = np.random.default_rng(seed)
        n, law, k_c, speed = len(given["index"]), given["law"], given["wall.stiffness"], given["current.speed"]
        gsta, alone = law == "gsta", law == "impedance"
        noise = rng.standard_normal((4, n))
        peak = np.where(gsta, 0.06, 0.08) * np.sqrt(k_c) * np.exp(0.15 * noise[0]) * (1.0 + speed)
        final = np.where(gsta, 1.5, 1.42 - 0.5 * speed) + np.where(gsta, 1e-4, 0.02) * noise[1]
        unstable = (law == "fosm") & (speed * np.log10(k_c / 2e4) > 0.33 + 0.02 * noise[2])
        status = np.where(unstable, "unstable", "completed")
        settled = ~unstable & (rng.random(n) > np.where(alone, 0.12, 0.004))
        time = [f"diverged at t = {5.0 + abs(x):.4f} s: |nu| = {10 + abs(y):.3g} m/s" for x, y in noise[2:].T]
        return {
            "status": status,
            "message": np.where(unstable, time, None),
            "contact.first_s": np.where(alone & (speed > 0.4), np.nan, 5.2 + 0.3 * speed + 0.01 * noise[3]),
            "contact.touches": rng.poisson(np.where(gsta, 3.0, 6.0)),
            "contact.peak_N": peak,
            "contact.final_N": final,
            "contact.settled": settled,
            "contact.analytic_N": np.full(n, 1.5),
            "contact.relative_error": final / 1.5 - 1.0,
            "effort_N2s": 300.0 * (1.0 + 8.0 * speed**2) * np.exp(0.05 * noise[3]) * np.where(gsta, 1.1, 1.0),
            "saturated_s": np.zeros(n),
            "final.position_m.x": 2.0 + final / k_c,
        }

    return row
