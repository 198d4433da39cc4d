"""Summary of a run, as printed by ``uvms-mj run`` and ``uvms-mj info``.

The module imports little: its numbers are also listed for a run that was interrupted during the imports.

In the table of a run, which a notebook shows, too, peaks and instants depend on the time step and get at most four
digits. A force at rest does not depend on it and gets the digits that did not change in the final window, at most
seven.
"""

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..records.header import Header
    from ..records.trace import Trace
    from ..scenario import Scenario


def _last(name: str) -> "Callable[[Trace], Any]":
    """The last value of a signal; None if the run has no row, or no such signal."""
    return lambda trace: trace[name][-1].tolist() if len(trace) and name in trace.arrays else None


def _force(trace: "Trace") -> tuple[float | None, bool]:
    from .metrics import final_force

    return final_force(trace)


def _trend(trace: "Trace") -> float | None:
    """Rate of a lasting change of the force at the end of the run [N/s]; None if the force shows none."""
    from .metrics import trend

    found = trend(trace)
    return None if found is None else found.rate


def _analytic_N(trace: "Trace") -> float | None:
    """The closed form's force [N]; None without a closed form, or if the vehicle rests away from the wall."""
    return getattr(trace.analytic, "force", 0.0) or None


def _relative_error(trace: "Trace") -> float | None:
    """None unless the run completed and the force has settled, because the closed form describes the rest at the
    end."""
    (final_N, settled), analytic_N = _force(trace), _analytic_N(trace)
    settled = settled and trace.status.name == "completed"
    return (final_N - analytic_N) / analytic_N if settled and final_N and analytic_N else None


def ending(trace: "Trace") -> tuple[str, ...]:
    """Warnings about how a run ended, besides its status."""
    from .metrics import astray

    if trace.header.measured:
        return ()
    found = [f"the vehicle was out of the water for {dry:.4g} s"] if (dry := _dry(trace)) else []
    if trace.changed:
        found.append(f"{', '.join(trace.changed)} changed in the run; the scenario has the values at its start")
    distance = None if trace.scenario.controller.external else astray(trace)
    lost = "the vehicle is still moving at the end, up to {:.3g} m from its reference: the loop may be unstable"
    return (*found, *(() if distance is None else (lost.format(distance),)))


def _dry(trace: "Trace") -> float | None:
    """The time with nothing of the vehicle below the surface [s]; None where it is below the surface everywhere."""
    time = _last("dry_time")(trace)
    return None if time is None else _of_steps(trace, time)


def fluctuates(scenario: "Scenario") -> bool:
    """Whether a sensor has white noise, or there are waves."""
    return scenario.sea.moves or any(any(channel.noise) for channel in scenario.navigation.white_channels.values())


@functools.lru_cache(maxsize=1)
def _deviations(header: "Header") -> Any:
    """The closed form of the deviations, the reason why there is none, or None without noise and waves."""
    if not fluctuates(header.scenario):
        return None
    from ..setup.base import set_up
    from ..setup.linear_loop import deviations

    return deviations(set_up(header.scenario, header.mjcf))


def _push_deviation(trace: "Trace") -> float | None:
    """The push's standard deviation over the last half of the run [N]; None without noise and waves."""
    if not fluctuates(trace.scenario) or not len(trace):
        return None
    return float(trace.push[trace.t >= 0.5 * trace.t[-1]].std())


def _no_noise_because(trace: "Trace") -> str | None:
    found = _deviations(trace.header)
    return found if isinstance(found, str) else None


def saturated(trace: "Trace") -> float | None:
    """The time with a thruster at its limit [s]; None if the run has no row."""
    time = _last("saturation_time")(trace)
    return None if time is None else _of_steps(trace, time)


def _saturated_thrusters(trace: "Trace") -> dict[str, float] | None:
    """The time that the command of each thruster was at its limit, by the thruster's name [s]; None of a log without
    it."""
    if not len(trace) or "thruster_saturation_time" not in trace.arrays:
        return None
    return _times_of(trace, "thruster_saturation_time", trace.header.mjcf.vehicle.thrusters)


def _saturated_joints(trace: "Trace") -> dict[str, float] | None:
    """The time that the motor of each joint was at its limit, by the joint's name [s]; None without joints."""
    if not len(trace) or "joint_saturation_time" not in trace.arrays:
        return None
    names = trace.header.components(trace.header.by_name["joint_saturation_time"])
    return _times_of(trace, "joint_saturation_time", names)


def _times_of(trace: "Trace", signal: str, names: Iterable[str]) -> dict[str, float]:
    """The times of a running signal at the end of a run by the names of its components [s]."""
    return {name: _of_steps(trace, time) for name, time in zip(names, trace[signal][-1], strict=True)}


def _joints(name: str) -> "Callable[[Trace], dict[str, float] | None]":
    """A function of joints in :mod:`.metrics`; None where it names no joint, and without joints."""

    def found(trace: "Trace") -> dict[str, float] | None:
        if not len(trace) or "q" not in trace.arrays:
            return None
        from . import metrics

        return getattr(metrics, name)(trace) or None

    return found


def _of_steps(trace: "Trace", time: float) -> float:
    """A sum of time steps [s] without the rounding errors of its additions: their number times the time step."""
    h = trace.scenario.simulation.timestep
    return float(f"{round(time / h) * h:.15g}")


def _position(trace: "Trace") -> list[float] | None:
    position = getattr(trace.analytic, "position", None)
    return None if position is None else position.tolist()


def _certified_rate(trace: "Trace") -> float | None:
    """The certified rate of change of the disturbance [m/s^3, rad/s^3]; None for a law without a certificate."""
    from ..setup.base import set_up

    found = set_up(trace.scenario, trace.header.mjcf).certificate
    return None if found is None else found.rate


def _chattering(trace: "Trace") -> float | None:
    """Sum of the chattering indices of X, Y and Z over the last second [N/s]."""
    from .metrics import CHATTERING_S, chattering

    return float(chattering(trace, max(0.0, trace.t[-1] - CHATTERING_S))[:3].sum()) if len(trace) else None


def _force_error(trace: "Trace") -> float | None:
    """Mean force over the last 0.5 s, settled or not, minus the demanded one [N]; None if nothing is demanded, or
    numbers changed in the run."""
    from ..control.design import demanded_force
    from .metrics import final_force

    force, demanded = final_force(trace)[0], demanded_force(trace.scenario)
    return None if force is None or trace.changed or not math.isfinite(demanded) else force - demanded


def _hold(name: str) -> "Callable[[Trace], Any]":
    """A function of :mod:`.hold`."""

    def found(trace: "Trace") -> Any:
        from . import hold

        return None if trace.changed else getattr(hold, name)(trace)

    return found


PARTS = 60
"""Equal parts of a run's duration in the course of its push."""


def _push(name: str) -> "Callable[[Trace], list[float] | None]":
    """Values of the course of the push; None if the run has no row."""

    def found(trace: "Trace") -> list[float] | None:
        from .hold import course

        return course(trace, PARTS)[name].tolist() if len(trace) else None

    return found


@dataclass(frozen=True)
class Number:
    """A number of a run; it may also be a flag, a text, or a vector.

    Attributes:
        of: its function of a trace; None for a missing number.
        meaning: its meaning, with its unit in brackets unless its name ends with the unit.
        kind: float, int, bool or str.
        size: number of its components.
        printed: whether ``uvms-mj run --json`` prints it.
        of_whole_run: whether it needs more than the last :data:`.metrics.AROUND_THE_END_S` of a trace.
        rows: the rows that are enough for it, in a run that completed: the length of the run's end, and the time from
            row to row [s]. None if it needs every row.
        not_kept: reason why a study can't keep it.
    """

    of: "Callable[[Trace], Any]"
    meaning: str = ""
    kind: type = float
    size: int = 1
    printed: bool = True
    of_whole_run: bool = False
    not_kept: str = ""
    rows: tuple[float, float] | None = None


LAST, FORCE, FAST, ENDING = (0.0, 1.0), (8.5, 0.5), (1.0, 0.01), (0.5, 0.05)
"""Rows that are enough: the last one; for the final force with its trend; for chattering; for :func:`ending`."""


def _not_kept(of: "Callable[[Trace], Any]", why: str) -> Number:
    return Number(of, not_kept=why)


_SAME, _COLUMN = "is the same for many runs; see the scenario", "is a column of every row; leave it out"
_FOLLOWS = "follows from steps and simulation.timestep; leave it out"
_OF_JOINTS = "has a number for each joint; take it from a function of the trace"
_OF_THRUSTERS = "has a number for each thruster; take it from a function of the trace"
_WALL_TIME = "differs from one execution to the next, and rows must not"
_of_study = functools.partial(Number, printed=False)
_course = functools.partial(Number, size=PARTS, printed=False, of_whole_run=True)

NUMBERS: Mapping[str, Number] = {
    "scenario": _not_kept(lambda trace: trace.scenario.name, _SAME),
    "controller": _not_kept(lambda trace: trace.scenario.controller.label(), _SAME),
    "status": _not_kept(lambda trace: trace.status.name, _COLUMN),
    "message": _not_kept(lambda trace: trace.message or None, _COLUMN),
    "warnings": _not_kept(lambda trace: [*trace.notes, *ending(trace)], _SAME),
    "steps": _not_kept(lambda trace: trace.steps, _COLUMN),
    "timestep_s": _not_kept(lambda trace: trace.scenario.simulation.timestep, _FOLLOWS),
    "duration_s": _not_kept(lambda trace: trace.duration_s, _FOLLOWS),
    "wall_time_s": _not_kept(lambda trace: trace.wall_time_s, _WALL_TIME),
    "real_time_factor": _not_kept(
        lambda trace: trace.duration_s / trace.wall_time_s if trace.wall_time_s > 0 else None, _WALL_TIME
    ),
    "contact.first_s": Number(
        lambda trace: _last("first_contact")(trace) if len(trace) and trace.touches[-1] > 0 else None,
        "time of the first touch; none without a touch",
        rows=LAST,
    ),
    "contact.touches": Number(
        lambda trace: int(trace.touches[-1]) if len(trace) else 0,
        "number of times that the push begins",
        kind=int,
        rows=LAST,
    ),
    "contact.peak_N": Number(_last("force_peak"), "largest push", rows=LAST),
    "contact.impulse_Ns": Number(_last("impulse"), "integral of the push over time", rows=LAST),
    "contact.final_N": Number(lambda trace: _force(trace)[0], "mean push over the last 0.5 s", rows=FORCE),
    "contact.settled": Number(
        lambda trace: _force(trace)[1], "true or false: whether the push has settled at the end", kind=bool, rows=FORCE
    ),
    "contact.trend_N_per_s": Number(
        _trend, "rate of change of the push at the end, by its trend; none without one", rows=FORCE
    ),
    "contact.analytic_N": Number(
        _analytic_N, "push at rest in closed form; none without a closed form or without contact at rest", rows=LAST
    ),
    "contact.relative_error": Number(
        _relative_error,
        "of contact.final_N against contact.analytic_N [1]; none unless the push has settled",
        rows=FORCE,
    ),
    "noise.push_N": Number(
        _push_deviation,
        "standard deviation of the push over the last half of the run, with white noise of a sensor or waves",
        of_whole_run=True,
    ),
    "noise.analytic_N": Number(
        lambda trace: getattr(_deviations(trace.header), "push", None), "the same in closed form"
    ),
    "noise.none_because": Number(_no_noise_because, "text: why the deviation has no closed form", kind=str),
    "effort_N2s": Number(
        lambda trace: float(trace.effort[-1][:3].sum()) if len(trace) else None,
        "integral of X^2 + Y^2 + Z^2 of the thrust over time",
        rows=LAST,
    ),
    "saturated_s": Number(saturated, "time with a thruster at its limit", rows=LAST),
    "dry_s": _of_study(
        _dry, "time with nothing of the vehicle below the surface; none without buoyancy.shapes", rows=LAST
    ),
    "saturated_thrusters_s": _not_kept(_saturated_thrusters, _OF_THRUSTERS),
    "saturated_joints_s": _not_kept(_saturated_joints, _OF_JOINTS),
    "joints_off_target": _not_kept(_joints("off_target"), _OF_JOINTS),
    "joints_at_stops": _not_kept(_joints("at_stops"), _OF_JOINTS),
    "final.position_m": Number(_last("p_WB"), "p_WB at the end", size=3, rows=LAST),
    "final.attitude_wxyz": Number(_last("quat_WB"), "quat_WB at the end [1]", size=4, rows=LAST),
    "final.s": Number(_last("s"), "sliding variable at the end [m/s, rad/s]", size=6, rows=LAST),
    "final.z": Number(
        _last("z"),
        "state z of a super-twisting law at the end, which takes up the disturbance [m/s^2, rad/s^2]",
        size=6,
        rows=LAST,
    ),
    "final.tau": Number(_last("tau"), "wrench of the thrusters at the end [N, N m]", size=6, rows=LAST),
    "analytic.position_m": Number(_position, "p_WB at rest in closed form", size=3, rows=LAST),
    "analytic.none_because": Number(
        lambda trace: getattr(trace.analytic, "reason", None),
        "text: why the rest has no closed form",
        kind=str,
        rows=LAST,
    ),
    "certified_rate_m_per_s3": _of_study(
        _certified_rate, "rate of disturbance for which the law is certified; none for other laws", rows=LAST
    ),
    "chattering_N_per_s": _of_study(
        _chattering, "sum of the chattering indices of X, Y and Z over the last second", rows=FAST
    ),
    "force_error_N": _of_study(
        _force_error, "contact.final_N, settled or not, minus the demanded force; none with several walls", rows=LAST
    ),
    "force_range_N": _of_study(
        lambda trace: float(trace.final_high[-1] - trace.final_low[-1]) if len(trace) else None,
        "greatest minus least push over the last 0.5 s",
        rows=LAST,
    ),
    "thrust_peak_N": _of_study(
        lambda trace: float(trace.tau_max[-1][:3].max()) if len(trace) else None,
        "largest of X, Y and Z that the thrusters gave at any step",
        rows=LAST,
    ),
    "hold.bias_N": _of_study(
        _hold("bias"),
        "mean push over the last 5 s minus the demanded push, reference.push or |F_d|; none if there is none",
    ),
    "hold.error_N": _of_study(
        _hold("error"),
        "root mean square over the last 5 s of the push's deviation from the demanded one, the largest of each row",
    ),
    "hold.worst_N": _of_study(
        _hold("worst"), "largest deviation of the push from the demanded one at any step of the last 5 s"
    ),
    "hold.lost_s": _of_study(_hold("lost"), "time without contact in the last 5 s"),
    "hold.contacts": _of_study(_hold("contacts"), "least number of contacts that press in the last 5 s [1]"),
    "hold.path_error_m": _of_study(
        _hold("path_error"), "largest distance from the reference across F_d in the last 5 s"
    ),
    "hold.turn_error_deg": _of_study(_hold("turn_error"), "largest angle from the desired attitude in the last 5 s"),
    "contact.settling_s": _of_study(
        _hold("settling"),
        "time from the first touch until the push stays within a fifth of the demanded one; none if never",
        of_whole_run=True,
    ),
    "course.mean_N": _course(_push("mean"), "mean push in each sixtieth of the run"),
    "course.least_N": _course(_push("least"), "least push in each sixtieth of the run, at every step"),
    "course.greatest_N": _course(_push("greatest"), "greatest push in each sixtieth of the run, at every step"),
}
"""The numbers of a run, by their place in its summary; the rows of a study have the same order."""
HELD = ("hold.error_N", "hold.worst_N")
"""How far the push is from the demanded one."""
COURSES = ("course.mean_N", "course.least_N", "course.greatest_N")
"""The push over time, for figures."""


def summary(trace: "Trace", files: dict[str, str]) -> dict[str, Any]:
    """The numbers that ``uvms-mj run --json`` prints, with the paths of the written files by kind. Missing numbers and
    numbers that are not finite are None. The last :data:`.metrics.AROUND_THE_END_S` of a trace are enough, of a
    :func:`fluctuates` one also its last half."""
    printed = [place for place, each in NUMBERS.items() if each.printed]
    return _finite(_tree(numbers(trace, printed))) | {"files": files}


def numbers(trace: "Trace", places: Iterable[str]) -> dict[str, Any]:
    """The numbers of :data:`NUMBERS` at these places, by place. Only these are computed."""
    return {place: _measured(NUMBERS[place], trace) for place in places}


def _measured(number: Number, trace: "Trace") -> Any:
    """A number of a run; None if it needs a signal that the log of a real vehicle lacks."""
    if not trace.header.measured:
        return number.of(trace)
    from ..records.trace import MissingSignal, UnknownSignal

    try:
        return number.of(trace)
    except (MissingSignal, UnknownSignal):
        return None


def summary_of_none(values: Mapping[str, Any], files: dict[str, str]) -> dict[str, Any]:
    """The summary of a run without a step. All other numbers than the given ones, by their places, are zero or None."""
    nothing = dict.fromkeys(("steps", "contact.touches"), 0) | dict.fromkeys(("duration_s", "wall_time_s"), 0.0)
    blank = (
        dict.fromkeys(place for place, each in NUMBERS.items() if each.printed)
        | nothing
        | {"warnings": [], "contact.settled": False}
    )
    return _tree(blank | dict(values)) | {"files": files}


def _tree(values: Mapping[str, Any]) -> dict[str, Any]:
    """Nested dictionaries from values by dotted places."""
    tree: dict[str, Any] = {}
    for place, value in values.items():
        table, _, name = place.rpartition(".")
        (tree.setdefault(table, {}) if table else tree)[name] = value
    return tree


def _finite(value: Any) -> Any:
    """The same value with None in place of numbers that are not finite, which JSON lacks."""
    if isinstance(value, list):
        return [_finite(each) for each in value]
    if isinstance(value, dict):
        return {name: _finite(each) for name, each in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


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
    from ..control.laws.impedance import TOLD_THE_TRUTH

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
    asked = None if "F_d" in trace.arrays else trace.scenario.reference.force_at_rest()  # a schedule changes it
    if asked is not None and contact["first_s"] is not None and (found := numbers(trace, HELD))[HELD[0]] is not None:
        error, worst = (f"{found[place]:.3g} N" for place in HELD)
        yield "off reference.push", f"{error} rms, {worst} at most, of {math.hypot(*asked):.4g} N, over the last 5 s"
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
        if final["position_m"]:
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
        if "tau_max" in trace.arrays:
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
        times = report["saturated_thrusters_s"] or {}
        shares = sorted(((time / report["duration_s"], name) for name, time in times.items() if time), reverse=True)
        if shares:
            yield "the most limited thrusters", ", ".join(f"{name} {share:.2%}" for share, name in shares[:2])
    if dry := _dry(trace):
        yield "out of the water", f"{dry:.4g} s, {dry / max(report['duration_s'], 1e-300):.2%} of the time"
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
