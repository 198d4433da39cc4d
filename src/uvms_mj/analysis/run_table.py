"""The table of a run, as ``uvms-mj run``, ``uvms-mj info`` and a notebook show it.

Peaks and instants depend on the time step and get at most four digits. A force at rest does not depend on it and gets
the digits that did not change in the final window, at most seven.
"""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..records.trace import Trace

ROUNDING = 1e-9
"""Numbers smaller than this, relative or in SI units, come from rounding and are shown as zero."""


def heading(report: Mapping[str, Any]) -> str:
    """Scenario, law and status of a run, from its :func:`.summary.summary`."""
    return f"{report['scenario']} · {report['controller']} · {report['status']}"


def rows(trace: "Trace", report: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names and values of the table of a run, from its trace and its :func:`.summary.summary`."""
    yield from _contact_rows(trace, report)
    yield from _motion_rows(trace, report)
    yield from _run_rows(trace, report)


def _contact_rows(trace: "Trace", report: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    from ..control.laws.ideal import TOLD_THE_TRUTH

    contact, status = report["contact"], report["status"]
    if trace.scenario.controller.uses_truth:
        yield "the law is given", TOLD_THE_TRUTH
    if contact["first_s"] is None:
        yield "contact", "none"
    else:
        touches = f"{contact['touches']} touch{'es' if contact['touches'] > 1 else ''}"
        yield "first contact", f"{contact['first_s']:.4g} s ({touches})"
        yield "peak force", f"{contact['peak_N']:.4g} N"
        if contact["settled"]:
            still = (trace.final_high[-1] - trace.final_low[-1]) / (contact["final_N"] or 1.0)
            digits = 1 + math.floor(-math.log10(max(still, 1e-6))) if status == "completed" else 4
            yield "final force", f"{contact['final_N']:.{max(4, digits)}g} N (settled)"
        elif contact["final_N"] is not None:
            rate = contact["trend_N_per_s"]
            settled = "not settled" if status in ("completed", "unstable") else f"{status} before it settled"
            if status == "completed" and rate is not None:
                settled = f"still changes by {rate:.2g} N/s"
            yield "final force", f"{contact['final_N']:.4g} N ({settled})"
    if status == "unstable":
        yield "analytic force", "not compared: the run diverged"
    elif contact["analytic_N"] is not None:
        yield "analytic force", f"{contact['analytic_N']:.7g} N"
    elif report["analytic"]["none_because"]:
        yield "analytic force", f"none: {report['analytic']['none_because']}"
    error = contact["relative_error"]
    if error is not None:
        yield "relative error", f"{error:.1e}" if abs(error) >= ROUNDING else "below 1e-9"
    noise = report["noise"]
    if noise["push_N"] is not None:
        yield "deviation of the push", f"{noise['push_N']:.3g} N"
        analytic_N, reason = noise["analytic_N"], noise["none_because"]
        yield "analytic deviation", f"{analytic_N:.4g} N" if reason is None else f"none: {reason}"


def _motion_rows(trace: "Trace", report: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    final, analytic_m = report["final"], report["analytic"]["position_m"]
    if len(trace):
        yield "final position", f"{_vector(final['position_m'], 5)} m"
        recorded = {signal.name for signal in trace.signals}
        if "p_WT" in recorded:
            yield "final position, tool", f"{_vector(trace.p_WT[-1], 5)} m"
        if "q" in recorded:
            yield "final joints", f"{_vector(trace.q[-1], 4)} rad or m"
    yield from _joint_rows(trace, report)
    if analytic_m and report["status"] != "unstable":
        yield "analytic position", f"{_vector(analytic_m, 5)} m"
    if len(trace):
        if final["s"]:
            yield "final sliding variable", " ".join(f"{value: .1e}" for value in final["s"])
        yield "largest tau", f"{'  '.join(f'{value:#.3g}' for value in trace.tau_max[-1])} N, N m"


def _joint_rows(trace: "Trace", report: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    header = trace.header
    for name, found, by, signal in (
        ("joints off their target", report["joints_off_target"], "by ", trace.scenario.joints.tracked_signal),
        ("joints at their stops", report["joints_at_stops"], "", "q"),
    ):
        if found:
            of = header.by_name[signal]
            units = dict(zip(header.components(of), header.units(of), strict=True))
            each = (f"{joint} {by}{round(value, 4) + 0.0:.4g} {units[joint]}" for joint, value in found.items())
            yield name, ", ".join(each)


def _run_rows(trace: "Trace", report: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if report["saturated_s"]:
        share = report["saturated_s"] / max(report["duration_s"], 1e-300)
        yield "thrusters at their limits", f"{report['saturated_s']:.4g} s, {share:.2%} of the time"
    joints = report["saturated_joints_s"] or {}
    if any(joints.values()):
        shares = (f"{name} {time / report['duration_s']:.2%}" for name, time in joints.items() if time)
        yield "motors at their limits", f"{', '.join(shares)} of the time"
    factor = report["real_time_factor"]
    if factor:
        step_us = trace.wall_time_s / max(1, trace.steps) * 1e6
        wall_time = f"{report['duration_s']:g} s in {trace.wall_time_s:.2f} s, {step_us:.2f} us a step"
        yield "real-time factor", f"{factor:.1f} ({wall_time})"
    if report["files"]:
        yield "files", "\n".join(report["files"].values())


def _vector(values: Any, decimals: int) -> str:
    """Numbers of equal width, so that the columns of two lines are aligned; zero has no sign."""
    return " ".join(f"{round(float(value), decimals) + 0.0: .{decimals}f}" for value in values)
