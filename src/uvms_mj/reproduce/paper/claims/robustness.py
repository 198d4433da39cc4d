"""Measures for the paper's main claim, robustness: model errors, and convergence in finite time."""

import numpy as np

from ....analysis import metrics
from ....control.design import demanded_force
from ....records.trace import Trace
from ....studies.pages import number
from ..laws import LABELS
from .base import Measured, Runs
from .measures import REST_S, at_rest, gain, norm, over


def impedance_error_of_moments(runs: Runs) -> Measured:
    """Norm of the moment part of the residual of eq. (12), larger of two runs [N m]."""
    moments = {name: norm(at_rest(runs.traces[name])[3:]) for name in ("gsta", "gsta_alone")}
    detail = ", ".join(f"{LABELS[name]} {number(value)} N m" for name, value in moments.items())
    return Measured(max(moments.values()), detail)


MODEL_ERRORS = {
    "gsta_overestimated": "M, C, D, g 50 % too large",
    "gsta_underestimated": "C, D, g 50 % and M 20 % too small",
}
"""Errors of the estimates that the law uses in two of the runs, by name."""


def model_errors(runs: Runs) -> Measured:
    """Impedance error at rest, larger of two runs with wrong estimates [N]."""
    errors = {name: norm(at_rest(runs.sweep[name])[:3]) for name in MODEL_ERRORS}
    detail = "; ".join(f"{number(errors[name])} N with {what}" for name, what in MODEL_ERRORS.items())
    return Measured(float(np.max(list(errors.values()))), detail)


def force_with_model_errors(runs: Runs) -> Measured:
    """Force at rest of two runs with wrong estimates: the one further from the force that eq. (12) demands [N]."""
    forces = {name: metrics.final_force(runs.sweep[name])[0] or 0.0 for name in MODEL_ERRORS}
    demanded = demanded_force(runs.traces["gsta"].scenario)
    detail = "; ".join(f"{forces[name]:.4f} N with {what}" for name, what in MODEL_ERRORS.items())
    return Measured(max(forces.values(), key=lambda force: abs(force - demanded)), detail)


def half_inertia(runs: Runs) -> Measured:
    """Impedance error at rest with M_hat = M/2 [N].

    Explained if this vehicle still bounces at the end of its run and the vehicle without model errors does not.
    """

    def touches(trace: Trace) -> int:
        return int(trace.touches[-1] - trace.touches[trace.t >= trace.t[-1] - REST_S][0])

    trace = runs.sweep["gsta_half_inertia"]
    force, _ = metrics.final_force(trace)
    detail = f"{touches(trace)} touches in the last {REST_S:g} s; mean force {number(force)} N"
    bounces = touches(trace) > 0 and touches(runs.traces["gsta"]) == 0
    return Measured(norm(at_rest(trace)[:3]), detail, explained=bounces)


def finite_time(runs: Runs) -> Measured:
    """Time that s takes to reach a band that is 16 times narrower, over the time to the wider band.

    The band is (2 h k_1)^2. It contains the cycle of the sampled algorithm, |s| <= (h k_1/2)^2. The time is measured in
    the first transient, which starts from rest in the unknown current and ends when the reference moves.
    """
    coarse, fine = (arrival(trace) for trace in (runs.traces["gsta"], runs.sweep["gsta_quarter_step"]))
    if coarse is None or fine is None:
        return Measured(None, "s does not reach the band before the reference moves")
    return Measured(over(fine, coarse), f"{coarse:.3f} s, then {fine:.3f} s")


def arrival(trace: Trace) -> float | None:
    """Time after which every |s_i| stays below (2 h k_1)^2, until the reference moves [s]."""
    band = (2.0 * trace.scenario.simulation.timestep * gain(trace, "k_1")) ** 2
    still = (trace.p_d == trace.p_d[0]).all(axis=1)
    largest = metrics.magnitude(trace, "s").max(axis=1)
    return metrics.settling_time(trace.t[still], largest[still], 0.0, band) if still.any() else None
