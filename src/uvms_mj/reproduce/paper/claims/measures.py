"""Measures for the claims of the paper."""

import math
from collections.abc import Callable

import numpy as np

from ....analysis import metrics, residual
from ....control.base import SteadyState
from ....control.design import demanded_force
from ....records.trace import Trace
from ....studies.pages import number
from ..laws import LABELS
from .base import Measured, Runs

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


def force(run: str) -> Callable[[Runs], Measured]:
    """Mean pushing force over the last 0.5 s, from every step [N]."""

    def measure(runs: Runs) -> Measured:
        trace = runs.traces[run]
        force, settled = metrics.final_force(trace)
        demanded = demanded_force(trace.scenario)
        return Measured(force, f"{'settled' if settled else 'not settled'}; eq. (12) demands {demanded:.4f} N")

    return measure


def at_rest(trace: Trace) -> np.ndarray:
    """Impedance error at rest: rms (6,) of the residual of eq. (12) [N, N m]."""
    return residual.impedance_error(trace, trace.t[-1] - REST_S)


def norm(values: np.ndarray) -> float:
    return float(np.linalg.norm(values))


def impedance_error(run: str) -> Callable[[Runs], Measured]:
    """Norm of the force part of the residual of eq. (12) at rest [N]."""
    return lambda runs: Measured(norm(at_rest(runs.traces[run])[:3]))


def linear_sum(values: np.ndarray) -> float:
    """Sum over the three linear axes of (6,)."""
    return float(values[:3].sum())


def ratio(
    measure: Callable[[Trace], np.ndarray], reduce: Callable[[np.ndarray], float], of: str, to: str, unit: str
) -> Callable[[Runs], Measured]:
    """Ratio of the same quantity, a vector (6,) with forces first, in the runs ``of`` and ``to``. The value is that of
    the three forces, reduced to one number with a unit; the detail gives that of the moments."""

    def ratio(runs: Runs) -> Measured:
        vectors = [measure(runs.traces[name]) for name in (of, to)]
        a, b = (float(reduce(each[:3])) for each in vectors)
        moments = over(*(float(reduce(each[3:])) for each in vectors))
        return Measured(
            over(a, b), f"{LABELS[of]} {number(a)}, {LABELS[to]} {number(b)} {unit}; moments {number(moments)}"
        )

    return ratio


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


def reversals(run: str) -> Callable[[Runs], Measured]:
    def measure(runs: Runs) -> Measured:
        count = metrics.reversals(runs.fine[run], REVERSAL_N, 0.0, TRANSIENT_S)
        return Measured(float(count[:3].sum()), f"surge {count[0]}, sway {count[1]}, heave {count[2]}")

    return measure


def severe(variation: str) -> Callable[[Runs], Measured]:
    def measure(runs: Runs) -> Measured:
        as_printed, varied = (
            linear_sum(metrics.mean_change(trace, 0.5, 1.0)) for trace in (runs.traces["fosm"], runs.sweep[variation])
        )
        return Measured(varied, f"between 0.5 and 1 s; {number(as_printed)} N with the paper's gains")

    return measure


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
    measured = ratio(metrics.total_variation, np.sum, "gsta", "fosm", "N")(runs)
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
