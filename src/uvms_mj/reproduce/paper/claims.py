"""The paper's claims, whose rows are in claims.toml: each has a measure here, a function of the :class:`.runs.Runs`."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...analysis import metrics, residual
from ...control.base import SteadyState
from ...control.design import demanded_force
from ...records.trace import Trace
from ...studies.pages import number
from ..claims import Measured, claims_in
from .runs import LABELS, Runs

TRANSIENT_S = 0.1
"""The "first fraction of a second": with the paper's gains the first-order law switches for its first 10 ms."""
REST_S = 1.0
"""Length of the final part of a run that counts as rest [s]."""
REVERSAL_N = 0.1
"""Changes of thrust larger than this are visible: the ordinates of figs. 7 and 11 span tens of newtons [N]."""


def over(a: float, b: float) -> float | None:
    """a / b; None if b is zero."""
    return float(a / b) if b else None


def gain(trace: Trace, name: str) -> float:
    """A gain of a run's controller."""
    return float(getattr(trace.scenario.controller, name))


def force(runs: Runs, run: str) -> Measured:
    """Mean pushing force over the last 0.5 s, from every step [N]."""
    trace = runs.traces[run]
    force, settled = metrics.final_force(trace)
    demanded = demanded_force(trace.scenario)
    return Measured(force, f"{'settled' if settled else 'not settled'}; eq. (12) demands {demanded:.4f} N")


def force_without_current(runs: Runs) -> Measured:
    """The same without a current, of impedance control alone [N]."""
    return Measured(metrics.final_force(runs.sweep["impedance_still"])[0])


def touches(runs: Runs, run: str) -> Measured:
    return Measured(float(runs.traces[run].touches[-1]), "counted at every step")


def sideways(runs: Runs, run: str) -> Measured:
    """y at rest [mm]."""
    return Measured(1e3 * float(runs.traces[run].p_WB[-1, 1]))


def at_rest(trace: Trace) -> np.ndarray:
    """Impedance error at rest: rms (6,) of the residual of eq. (12) [N, N m]."""
    return residual.impedance_error(trace, trace.t[-1] - REST_S)


def norm(values: np.ndarray) -> float:
    return float(np.linalg.norm(values))


def impedance_error(runs: Runs, run: str) -> Measured:
    """Norm of the force part of the residual of eq. (12) at rest [N]."""
    return Measured(norm(at_rest(runs.traces[run])[:3]))


def linear_sum(values: np.ndarray) -> float:
    """Sum over the three linear axes of (6,)."""
    return float(values[:3].sum())


_VECTORS: dict[str, tuple[Callable[[Trace], np.ndarray], Callable[[np.ndarray], float]]] = {
    "impedance_error_at_rest": (at_rest, norm),
    "largest_step": (metrics.largest_change, np.max),
    "variation": (metrics.total_variation, np.sum),
    "variation_at_start": (lambda trace: metrics.total_variation(trace, 0.0, TRANSIENT_S), np.sum),
}
"""Vectors (6,) of a run, the forces first, and how three components become one number."""


def ratio(runs: Runs, what: str) -> Measured:
    """Ratio of the same vector of :data:`_VECTORS`, GSTA's over the first-order law's. The value is for the three
    forces; the detail gives the ratio of the moments."""
    measure, reduce = _VECTORS[what]
    vectors = [measure(runs.traces[name]) for name in ("gsta", "fosm")]
    a, b = (float(reduce(each[:3])) for each in vectors)
    moments = number(over(*(float(reduce(each[3:])) for each in vectors)))
    return Measured(over(a, b), f"{LABELS['gsta']} {number(a)}, {LABELS['fosm']} {number(b)} N; moments {moments}")


def largest_s(runs: Runs) -> Measured:
    """Largest |s_i| of all six axes at rest, GSTA's over the first-order law's."""
    a, b = (
        float(metrics.magnitude(trace, "s")[trace.t > trace.t[-1] - REST_S].max())
        for trace in (runs.traces["gsta"], runs.traces["fosm"])
    )
    return Measured(over(a, b), f"{LABELS['gsta']} {number(a)}, {LABELS['fosm']} {number(b)} m/s, rad/s")


def demanded(runs: Runs) -> Measured:
    trace = runs.traces["gsta"]
    rigid = demanded_force(trace.scenario, math.inf)
    return Measured(demanded_force(trace.scenario), f"{number(rigid)} N for a rigid wall")


def reference_jump(runs: Runs) -> Measured:
    """Largest change of the desired acceleration from row to row, over its largest value [%]."""
    trace = runs.traces["gsta"]
    acceleration = np.diff(trace.p_d_dot[:, 0]) / np.diff(trace.t)
    jump = np.abs(np.diff(acceleration, prepend=0.0)).max() if len(acceleration) else 0.0
    return Measured(over(100.0 * jump, np.abs(acceleration).max() if len(acceleration) else 0.0), "between log rows")


def spring(runs: Runs) -> Measured:
    """Largest deviation of the wall's force from eq. (34), over its peak [%]."""
    trace = runs.traces["gsta"]
    wall = trace.scenario.wall
    spring = np.zeros_like(trace.f_contact_W)
    spring[:, 0] = -wall.stiffness * np.maximum(0.0, trace.p_WB[:, 0] - wall.position)
    return Measured(over(100.0 * np.abs(trace.f_contact_W - spring).max(), float(trace.force_peak[-1])), "at every row")


def gap(runs: Runs) -> Measured:
    trace = runs.traces["impedance"]
    x = trace.p_WB[:, 0]
    return Measured(
        1e3 * (trace.scenario.wall.position - float(x.max())), f"x ends at {x[-1]:.4f} m, yaw at {yaw(trace):.2f} deg"
    )


def yaw(trace: Trace) -> float:
    w, x, y, z = trace.quat_WB[-1]
    return float(np.degrees(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))))


_RETUNED = {"impedance_nearer": "with the wall 20 mm nearer", "impedance_stiffer": "with 10 K_x"}


def retuned(runs: Runs) -> Measured:
    """Smaller force at rest of the two retuned runs [N]. Moving the wall nearer puts the reference further inside."""
    forces = {name: metrics.final_force(runs.sweep[name])[0] or 0.0 for name in _RETUNED}
    return Measured(min(forces.values()), ", ".join(f"{forces[name]:.3f} N {what}" for name, what in _RETUNED.items()))


def still_missing(runs: Runs) -> Measured:
    asked = {name: demanded_force(runs.sweep[name].scenario) for name in _RETUNED}
    forces = {name: metrics.final_force(runs.sweep[name])[0] or 0.0 for name in _RETUNED}
    detail = ", ".join(f"{forces[name]:.3f} of {asked[name]:.3f} N {what}" for name, what in _RETUNED.items())
    if not all(asked.values()):
        return Measured(None, detail)
    return Measured(min(100.0 * (1.0 - forces[name] / asked[name]) for name in _RETUNED), detail)


def inside(runs: Runs) -> Measured:
    return Measured(float(metrics.boundary_layer_share(runs.traces["fosm"]).min()), "smallest of the six axes")


def well_inside(runs: Runs) -> Measured:
    """Largest |s_i| / epsilon in all rows, and at every step of the beginning of the run."""
    share = np.max([np.abs(each["fosm"].s).max(axis=0) for each in (runs.traces, runs.fine)], axis=0)
    share = share / gain(runs.traces["fosm"], "epsilon")
    return Measured(float(share.max()), f"in surge {share[0]:.2g}, in sway {share[1]:.2g}, in yaw {share[5]:.2g}")


def unexplained(runs: Runs) -> Measured:
    """Part of the shortfall of the force that the closed form does not explain [%].

    In the closed form s is inside the boundary layer, where K_s s/epsilon balances the disturbance.
    """
    trace = runs.traces["fosm"]
    force, _ = metrics.final_force(trace)
    if force is None or not isinstance(trace.analytic, SteadyState):
        return Measured(None, "no closed form")
    missing, balance = demanded_force(trace.scenario) - force, trace.analytic.force
    detail = f"{number(1e3 * missing)} mN missing; the balance gives {balance:.6f} N, the run {force:.6f} N"
    return Measured(over(100.0 * abs(balance - force), abs(missing)), detail)


def quiet(runs: Runs) -> Measured:
    trace = runs.traces["fosm"]
    before, after = (
        linear_sum(metrics.chattering(trace, *part)) for part in ((0.0, TRANSIENT_S), (TRANSIENT_S, np.inf))
    )
    return Measured(over(after, before), f"{number(before)} N/s until {TRANSIENT_S:g} s, {number(after)} N/s later")


def reversals(runs: Runs, run: str) -> Measured:
    count = metrics.reversals(runs.fine[run], REVERSAL_N, 0.0, TRANSIENT_S)
    return Measured(float(count[:3].sum()), f"surge {count[0]}, sway {count[1]}, heave {count[2]}")


def severe(runs: Runs, variation: str) -> Measured:
    as_printed, varied = (
        linear_sum(metrics.mean_change(trace, 0.5, 1.0)) for trace in (runs.traces["fosm"], runs.sweep[variation])
    )
    return Measured(varied, f"between 0.5 and 1 s; {number(as_printed)} N with the paper's gains")


def ripple(runs: Runs) -> Measured:
    """Mean step-to-step change of thrust at rest on the axis where it is largest, over the rms of the thrust [%]."""
    trace = runs.traces["gsta"]
    change = metrics.mean_change(trace, trace.t[-1] - REST_S)[:3]
    rms = np.sqrt(linear_sum(metrics.control_effort(trace)) / trace.t[-1])
    return Measured(over(100.0 * change.max(), rms), f"{change.max():.3g} N of {rms:.3g} N")


def whole_variation(runs: Runs) -> Measured:
    """Total variation of thrust over the run, GSTA's over the first-order law's.

    Explained if the variation at rest agrees within 5 % with the cycle of the sampled algorithm: s alternates between
    +-sigma, with 2 sigma = h k_1 sqrt(sigma) - h^2 k_2/4 from eqs. (24) and (27), and tau changes by M_hat 4 sigma/h
    from step to step.
    """
    measured = ratio(runs, "variation")
    trace = runs.traces["gsta"]
    k_1, k_2 = gain(trace, "k_1"), gain(trace, "k_2")
    if k_1**2 < 2.0 * k_2:
        return measured
    cycle = 0.25 * (k_1 + np.sqrt(k_1**2 - 2.0 * k_2)) ** 2 * linear_sum(np.diag(residual.design_of(trace).M_hat))
    start = max(0.0, trace.t[-1] - REST_S)
    still = linear_sum(metrics.total_variation(trace, start)) / (trace.t[-1] - start) if len(trace) > 1 else 0.0
    detail = f"{measured.detail}; at rest {still:.1f} N/s, from the cycle of sgn(s) {cycle:.1f} N/s"
    return Measured(measured.value, detail, explained=abs(still - cycle) < 0.05 * cycle)


def continuity(runs: Runs) -> Measured:
    """Largest step-to-step change of thrust with a quarter of the time step, over that with the full step.

    Both are taken over the whole run, impacts included, from every step.
    """
    coarse, fine = (
        metrics.largest_change(trace)[:3] for trace in (runs.traces["gsta"], runs.sweep["gsta_quarter_step"])
    )
    worst = int(np.argmax(coarse))
    return Measured(over(fine[worst], coarse[worst]), f"{coarse[worst]:.3g} N, then {fine[worst]:.3g} N")


def actuation(runs: Runs) -> Measured:
    """Rms of the thrust difference between two runs at their common rows, over the rms of the thrust [%]."""
    a, b = runs.traces["gsta"].tau[:, :3], runs.traces["gsta_alone"].tau[:, :3]
    n = min(len(a), len(b))
    difference, rms = (float(np.sqrt((x**2).sum(axis=1).mean())) for x in (a[:n] - b[:n], a[:n]))
    return Measured(over(100.0 * difference, rms), f"rms {difference:.3g} N of {rms:.3g} N")


def integral(runs: Runs) -> Measured:
    a, b = (float(np.abs(runs.traces[name].z[:, :3]).max()) for name in ("gsta", "gsta_alone"))
    return Measured(over(b, a), f"largest |z| {b:.3g} m/s² alone, {a:.3g} m/s² with the nominal control")


def compliance(runs: Runs) -> Measured:
    trace = runs.traces["gsta"]
    if not trace.touches[-1]:
        return Measured(None, "no contact")
    start = float(trace.first_contact[-1])
    force = float(np.sqrt((trace.push[trace.t >= start] ** 2).mean()))
    error = float(residual.impedance_error(trace, start)[0])
    return Measured(over(100.0 * error, force), f"{number(error)} N of {number(force)} N")


def unrest(runs: Runs) -> Measured:
    """Range of the pushing force in the final window, from every step, over its mean [%]."""
    trace = runs.traces["gsta"]
    force, _ = metrics.final_force(trace)
    return Measured(over(100.0 * float(trace.final_high[-1] - trace.final_low[-1]), force or 0.0))


def effort(runs: Runs, other: str) -> Measured:
    """Integral of the squared thrust, GSTA's over another run's. The detail gives surge, sway and yaw."""
    a, b = (metrics.control_effort(runs.traces[name]) for name in ("gsta", other))
    units = {"surge": (0, "N² s"), "sway": (1, "N² s"), "yaw": (5, "N² m² s")}
    axes = ", ".join(f"{axis} {number(a[i])} and {number(b[i])} {unit}" for axis, (i, unit) in units.items())
    return Measured(over(linear_sum(a), linear_sum(b)), axes)


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

    def late(trace: Trace) -> int:
        return int(trace.touches[-1] - trace.touches[trace.t >= trace.t[-1] - REST_S][0])

    trace = runs.sweep["gsta_half_inertia"]
    force, _ = metrics.final_force(trace)
    detail = f"{late(trace)} touches in the last {REST_S:g} s; mean force {number(force)} N"
    bounces = late(trace) > 0 and late(runs.traces["gsta"]) == 0
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


CLAIMS = claims_in(Path(__file__).with_name("claims.toml"), globals())
"""All claims in the order of the page."""
