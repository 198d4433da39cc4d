r"""Error bars of a run: the same run at the time steps h, h/2 and h/4, and what its numbers tend to.

With :math:`f_1, f_2, f_3` of a number at h, h/2, h/4 and :math:`f(h) = f_0 + c h^p` (Richardson's extrapolation),

.. math::

    p = \log_2 \frac{f_1 - f_2}{f_2 - f_3}, \qquad f_0 = f_3 + \frac{f_3 - f_2}{2^p - 1}, \qquad
    U = 1.25 \left| \frac{f_3 - f_2}{2^p - 1} \right|

U is the grid convergence index of three grids (Roache, J. Fluids Eng. 116, 1994). It is meant for 0.5 <= p <= 2.1.
Elsewhere, and where the three don't tend to one side, no order is given: the result is f_3 with three times the spread
of the three (Eça and Hoekstra, J. Comput. Phys. 262, 2014). So it is for an instant, which is known to a step
only: its band is wider by the finest step.

The bars are those of the time step. What does not depend on it is not in them: MuJoCo's contact is an inerter as well,
which takes some 6e-5 off a peak.

A law without ``controller.period`` is sampled at every step, so that its numbers tend to those of the continuous law. A
given period stays as it is, and the numbers tend to those of the sampled law.
"""

import dataclasses
import math
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from .checks import SamplingWarning
from .control import Controller
from .faults import Fault, InputError, suggestion
from .mjcf import Mjcf
from .recording import Status
from .scenario import Scenario
from .simulation import PlainPythonWarning, simulate
from .summary import AROUND_THE_END_S, summary

LEVELS = 3
ORDERS = (0.5, 2.1)
"""Observed orders that are taken for one; semi-implicit Euler has 1."""
ROUNDING = 1e-9
"""Numbers that differ by less than this part of themselves don't depend on the step."""
RESOLUTION = 1e-11
"""... nor do numbers that differ by less than this, in SI units."""
_INSTANT = "contact.first_s"
_VECTORS = {"final.position_m": 3, "final.attitude_wxyz": 4, "final.s": 6, "final.z": 6, "final.tau": 6}
METRICS = (
    _INSTANT,
    "contact.touches",
    "contact.peak_N",
    "contact.impulse_Ns",
    "contact.final_N",
    "contact.relative_error",
    "effort_N2s",
    "saturated_s",
    *(f"{name}[{i}]" for name, size in _VECTORS.items() for i in range(size)),
)
"""Every number that can be asked for, by its place in the JSON of ``uvms-mj run``."""
DEFAULT = (*METRICS[:5], "effort_N2s", "final.position_m")


@dataclass(frozen=True)
class Estimate:
    """What a number of a run tends to.

    Attributes:
        name: the number's, as in :data:`METRICS`.
        values: at h, h/2 and h/4; None where a run has no such number.
        order: observed order p, or None where the numbers show none.
        value: the extrapolated number, or the best that there is; None for counts that differ and for missing numbers.
        uncertainty: half the width of the band about ``value``.
        remark: how ``value`` was found, where it was not extrapolated.
    """

    name: str
    values: tuple[float | None, ...]
    order: float | None = None
    value: float | None = None
    uncertainty: float | None = None
    remark: str = ""


@dataclass(frozen=True)
class Convergence:
    """Three runs of a scenario.

    Attributes:
        scenario: the coarsest, with every default written out.
        timesteps: h, h/2, h/4 [s].
        estimates: one for each number that was asked for.
        notes: warnings of the three runs, each with the coarsest time step that it was given at.
    """

    scenario: Scenario
    timesteps: tuple[float, ...]
    estimates: tuple[Estimate, ...]
    notes: tuple[str, ...]


class NotCompletedError(RuntimeError):
    """One of the runs became unstable, so that there is nothing to compare."""


def converge(
    scenario: Scenario | None = None,
    metrics: Sequence[str] = DEFAULT,
    *,
    controller: Controller | None = None,
    mjcf: Mjcf | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Convergence:
    """Run a scenario at its time step, half and a quarter of it, and extrapolate its numbers.

    Args:
        scenario: what to run; default: the paper's scenario. Its time step is the coarsest.
        metrics: names of :data:`METRICS`; a vector's name, ``final.position_m``, stands for all its components.
        controller: a law with its gains, in place of the scenario's.
        mjcf: the vehicle's model, as for :func:`uvms_mj.simulate`.
        progress: called now and then with the steps done in all runs, and their number.

    Raises:
        InputError: a metric is unknown, or the scenario can't run at one of the steps.
        NotCompletedError: a run became unstable.
        LawError: the law raised.
        KeyboardInterrupt: a run was interrupted.
    """
    names = _names(metrics)
    scenario = scenario if scenario is not None else Scenario()
    if controller is not None:
        scenario = dataclasses.replace(scenario, controller=controller)
    scenarios = _refined(scenario)
    steps = [each.steps for each in scenarios]
    columns: list[dict[str, Any]] = []
    notes: dict[str, str] = {}
    for i, each in enumerate(scenarios):
        h = each.simulation.timestep

        def advance(done: int, _: int, before: int = sum(steps[:i])) -> None:
            if progress is not None:
                progress(before + done, sum(steps))

        with warnings.catch_warnings():  # they are in the trace's notes
            warnings.simplefilter("ignore", SamplingWarning)
            warnings.simplefilter("ignore", PlainPythonWarning)
            trace = simulate(each, mjcf=mjcf, keep_s=AROUND_THE_END_S, progress=advance)
        if trace.status is Status.interrupted:
            raise KeyboardInterrupt
        if trace.status is not Status.completed:
            raise NotCompletedError(f"the run with a time step of {h:g} s is {trace.status.name}: {trace.message}")
        columns.append(_flat(summary(trace, {})))
        for note in trace.notes:
            notes.setdefault(_words(note), f"at {h:g} s: {note}")
    estimates = tuple(
        extrapolated(name, tuple(column.get(name) for column in columns), h if name == _INSTANT else 0.0)
        for name in names
    )
    return Convergence(scenarios[0], tuple(s.simulation.timestep for s in scenarios), estimates, tuple(notes.values()))


def extrapolated(name: str, values: tuple[float | None, ...], grain: float = 0.0) -> Estimate:
    """What a number tends to, by the formulas at the top of this module.

    Args:
        name: the number's.
        values: at h, h/2 and h/4.
        grain: the number is known to this only, as an instant is to a step.
    """
    known = [value for value in values if value is not None]
    if not known:
        return Estimate(name, values, remark="in no run")
    if len(known) < len(values):
        return Estimate(name, values, remark="not in every run")
    f_1, f_2, f_3 = known
    if all(isinstance(value, int) for value in known):
        if f_1 == f_2 == f_3:
            return Estimate(name, values, value=f_3, uncertainty=0.0, remark="counts agree")
        return Estimate(name, values, remark="counts differ")
    spread = max(known) - min(known)
    if grain > 0.0:
        return Estimate(name, values, value=f_3, uncertainty=3.0 * spread + grain, remark="to a step: 3 x spread")
    if spread <= max(RESOLUTION, ROUNDING * max(abs(value) for value in known)):
        return Estimate(name, values, value=f_3, uncertainty=spread, remark="equal but for rounding")
    before, last = f_2 - f_1, f_3 - f_2
    if before * last <= 0.0:
        return Estimate(name, values, value=f_3, uncertainty=3.0 * spread, remark="not monotone: 3 x spread")
    p = math.log2(before / last)
    if not ORDERS[0] <= p <= ORDERS[1]:
        remark = f"order {p:.2f} makes no sense: 3 x spread" if p > 0.01 else "differences don't shrink: 3 x spread"
        return Estimate(name, values, value=f_3, uncertainty=3.0 * spread, remark=remark)
    rest = last / (2.0**p - 1.0)
    return Estimate(name, values, p, f_3 + rest, 1.25 * abs(rest))


def _refined(scenario: Scenario) -> list[Scenario]:
    """The scenario at h, h/2, h/4, all of one duration: a whole number of the coarsest steps."""
    h = scenario.simulation.timestep
    duration = scenario.steps * h
    try:
        return [
            scenario.updated({"simulation.timestep": h / 2**i, "simulation.duration": duration}) for i in range(LEVELS)
        ]
    except InputError as error:
        raise InputError(error.faults, f"a quarter of the time step {h:g} s") from None


def _names(metrics: Sequence[str]) -> list[str]:
    """The numbers that are asked for, each once, vectors by their components."""
    names: list[str] = []
    faults = []
    for metric in metrics:
        if metric in METRICS:
            names.append(metric)
        elif metric in _VECTORS:
            names += [f"{metric}[{i}]" for i in range(_VECTORS[metric])]
        else:
            known = [name for name in METRICS if "[" not in name] + list(_VECTORS)
            faults.append(Fault(metric, f"no such metric; {suggestion(metric, known)}"))
    if faults:
        raise InputError(faults, "metrics")
    return list(dict.fromkeys(names))


def _words(note: str) -> str:
    """A warning without its numbers, which differ from step to step."""
    return re.sub(r"[\d.e+-]*\d", "", note)


def _flat(report: Any, name: str = "") -> dict[str, Any]:
    """Every leaf of a report by its place, ``contact.peak_N`` or ``final.s[0]``."""
    if isinstance(report, dict):
        return {k: v for key, each in report.items() for k, v in _flat(each, f"{name}.{key}" if name else key).items()}
    if isinstance(report, list):
        return {k: v for i, each in enumerate(report) for k, v in _flat(each, f"{name}[{i}]").items()}
    return {name: report}
