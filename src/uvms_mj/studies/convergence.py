r"""Error bars of a run: the same run at the time steps h, h/2 and h/4, and the limits of its numbers.

With the values :math:`f_1, f_2, f_3` of a number at h, h/2, h/4 and :math:`f(h) = f_0 + c h^p` (Richardson's
extrapolation),

.. math::

    p = \log_2 \frac{f_1 - f_2}{f_2 - f_3}, \qquad f_0 = f_3 + \frac{f_3 - f_2}{2^p - 1}, \qquad
    U = 1.25 \left| \frac{f_3 - f_2}{2^p - 1} \right|

U is the grid convergence index of three grids (Roache, J. Fluids Eng. 116, 1994). It is valid for 0.5 <= p <= 2.1. For
other orders, and for sequences that are not monotone, no order is given: the result is f_3 with three times the spread
of the three values (Eça and Hoekstra, J. Comput. Phys. 262, 2014). The same holds for instants, which are resolved to
one step only. Their band is wider by the finest step.

The error bars cover the time step. They exclude errors that do not depend on it: MuJoCo's contact also acts as an
inerter, which reduces a peak by some 6e-5.

A law without ``controller.period`` is sampled at every step, and its numbers tend to the continuous law's. A
given period is kept, and the numbers tend to the sampled law's.
"""

import dataclasses
import math
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ..analysis.metrics import AROUND_THE_END_S
from ..analysis.summary import NUMBERS, summary
from ..control import Controller
from ..engine.run import simulate
from ..engine.vehicle_run import PlainPythonWarning
from ..errors import Fault, InputError, suggestion
from ..plant.mjcf import Mjcf
from ..quantities import leaves
from ..records.header import Status
from ..scenario import Scenario
from ..setup.checks import SamplingWarning
from ..views.notebook import block
from ..views.progress import following

LEVELS = 3
ORDERS = (0.5, 2.1)
"""Range of accepted observed orders; the order of semi-implicit Euler is 1."""
ROUNDING = 1e-9
"""Relative difference below which numbers count as equal [1]."""
RESOLUTION = 1e-11
"""Absolute difference below which numbers count as equal, in SI units."""
_INSTANT = "contact.first_s"
_VECTORS = {name: each.size for name, each in NUMBERS.items() if name.startswith("final.")}
CONVERGING = (
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
"""All metrics that can be requested, by their place in the JSON of ``uvms-mj run``."""
DEFAULT = (*CONVERGING[:5], "effort_N2s", "final.position_m")


@dataclass(frozen=True)
class Estimate:
    """Limit of a metric for vanishing time step.

    Attributes:
        name: name of the metric, as in :data:`CONVERGING`.
        values: at h, h/2 and h/4; None if a run has no such number.
        order: observed order p; None if no order can be observed.
        value: the extrapolated number, or the best estimate; None if counts differ or numbers are missing.
        uncertainty: half the width of the band about ``value``.
        remark: how ``value`` was found if it was not extrapolated.
    """

    name: str
    values: tuple[float | None, ...]
    order: float | None = None
    value: float | None = None
    uncertainty: float | None = None
    remark: str = ""


@dataclass(frozen=True)
class Convergence:
    """Result of three runs: the scenario of the coarsest one, the time steps h, h/2, h/4 [s], an estimate for each
    metric, and the warnings of the runs, each with the coarsest time step at which it occurred."""

    scenario: Scenario
    timesteps: tuple[float, ...]
    estimates: tuple[Estimate, ...]
    notes: tuple[str, ...]

    @property
    def title(self) -> str:
        """Scenario, law, duration and sampling."""
        scenario, period = self.scenario, self.scenario.controller.period
        sampled = "the law at every step" if period is None else f"the law every {period:g} s"
        return f"{scenario.name} · {scenario.controller.label()} · {scenario.simulation.duration:g} s, {sampled}"

    def table(self) -> list[tuple[str, ...]]:
        """The table of the estimates, its heads first."""
        found: list[tuple[str, ...]] = [
            ("metric", *(f"h = {h:g} s" for h in self.timesteps), "order", "tends to", "remark")
        ]
        for each in self.estimates:
            values = ("-" if value is None else f"{value:.7g}" for value in each.values)
            order = "-" if each.order is None else f"{each.order:.2f}"
            found.append((each.name, *values, order, with_error(each), each.remark))
        return found

    def _repr_html_(self) -> str:
        """The picture in a notebook."""
        return block(self.title, [*self.table(), *(("warning", note) for note in self.notes)])


class NotCompletedError(RuntimeError):
    """One of the runs did not complete, e.g. because it diverged."""


def converge(
    scenario: Scenario | None = None,
    metrics: Sequence[str] = DEFAULT,
    *,
    controller: Controller | None = None,
    mjcf: Mjcf | None = None,
    progress: Callable[[int, int], None] | bool | None = None,
) -> Convergence:
    """Run a scenario at its time step, half and a quarter of it, and extrapolate its numbers.

    Args:
        scenario: scenario to run; default: the paper's scenario. Its time step is the coarsest.
        metrics: names of :data:`CONVERGING`; the name of a vector, e.g. ``final.position_m``, selects all components.
        controller: controller to use in place of the scenario's.
        mjcf: the vehicle's model, as for :func:`uvms_mj.simulate`.
        progress: True for a progress bar, or a function of the steps done in all runs and their total.

    Raises:
        InputError: a metric is unknown, or the scenario can't run at one of the steps.
        NotCompletedError: a run did not complete.
        LawError: the law raised.
        KeyboardInterrupt: a run was interrupted.
    """
    names = _names(metrics)
    scenario = scenario or Scenario()
    if controller is not None:
        scenario = dataclasses.replace(scenario, controller=controller)
    scenarios = _refined(scenario)
    steps = [each.steps for each in scenarios]
    columns: list[dict[str, Any]] = []
    notes: dict[str, str] = {}
    with following(progress, "running", "{share:.0%}", lambda done, total: {"done": done, "total": total}) as told:
        for i, each in enumerate(scenarios):
            h = each.simulation.timestep

            def advance(done: int, _: int, before: int = sum(steps[:i])) -> None:
                told(before + done, sum(steps))

            with warnings.catch_warnings():  # the trace's notes contain them
                warnings.simplefilter("ignore", SamplingWarning)
                warnings.simplefilter("ignore", PlainPythonWarning)
                trace = simulate(each, mjcf=mjcf, keep_s=AROUND_THE_END_S, progress=advance)
            if trace.status is Status.interrupted:
                raise KeyboardInterrupt
            if trace.status is not Status.completed:
                raise NotCompletedError(f"the run with a time step of {h:g} s is {trace.status.name}: {trace.message}")
            columns.append(dict(leaves(summary(trace, {}))))
            for note in trace.notes:
                words = re.sub(r"[\d.e+-]*\d", "", note)  # without its numbers, which depend on the time step
                notes.setdefault(words, f"at {h:g} s: {note}")
    estimates = tuple(
        extrapolated(name, tuple(column.get(name) for column in columns), h if name == _INSTANT else 0.0)
        for name in names
    )
    return Convergence(scenarios[0], tuple(s.simulation.timestep for s in scenarios), estimates, tuple(notes.values()))


def extrapolated(name: str, values: tuple[float | None, ...], grain: float = 0.0) -> Estimate:
    """Limit of a metric, by the formulas at the top of this module, from its values at h, h/2 and h/4.

    ``grain`` is the resolution of the values, e.g. one step for an instant; 0 if they are exact.
    """
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return Estimate(name, values, remark=f"missing in {'some runs' if known else 'every run'}")
    f_1, f_2, f_3 = known
    if all(isinstance(value, int) for value in known):
        if f_1 == f_2 == f_3:
            return Estimate(name, values, value=f_3, uncertainty=0.0, remark="counts agree")
        return Estimate(name, values, remark="counts differ")
    spread = max(known) - min(known)
    if grain > 0.0:
        return Estimate(name, values, value=f_3, uncertainty=3.0 * spread + grain, remark="known to a step: 3 x spread")
    if spread <= max(RESOLUTION, ROUNDING * max(abs(value) for value in known)):
        return Estimate(name, values, value=f_3, uncertainty=spread, remark="equal up to rounding")
    before, last = f_2 - f_1, f_3 - f_2
    if before * last <= 0.0:
        return Estimate(name, values, value=f_3, uncertainty=3.0 * spread, remark="not monotone: 3 x spread")
    p = math.log2(before / last)
    if not ORDERS[0] <= p <= ORDERS[1]:
        remark = f"order {p:.2f} is out of range: 3 x spread" if p > 0.01 else "differences don't shrink: 3 x spread"
        return Estimate(name, values, value=f_3, uncertainty=3.0 * spread, remark=remark)
    rest = last / (2.0**p - 1.0)
    return Estimate(name, values, p, f_3 + rest, 1.25 * abs(rest))


def _refined(scenario: Scenario) -> list[Scenario]:
    """The scenario at h, h/2, h/4, each with the same duration: a whole number of the coarsest steps."""
    h = scenario.simulation.timestep
    duration = scenario.steps * h
    try:
        return [
            scenario.updated({"simulation.timestep": h / 2**i, "simulation.duration": duration}) for i in range(LEVELS)
        ]
    except InputError as error:
        raise InputError(error.faults, f"a quarter of the time step {h:g} s") from None


def _names(metrics: Sequence[str]) -> list[str]:
    """Names of the requested metrics without duplicates, vectors as components. Raises InputError."""
    names: list[str] = []
    faults = []
    for metric in metrics:
        if metric in CONVERGING:
            names.append(metric)
        elif metric in _VECTORS:
            names += [f"{metric}[{i}]" for i in range(_VECTORS[metric])]
        else:
            known = [name for name in CONVERGING if "[" not in name] + list(_VECTORS)
            faults.append(Fault(metric, f"is not a metric; {suggestion(metric, known)}"))
    if faults:
        raise InputError(faults, "metrics")
    return list(dict.fromkeys(names))


def with_error(estimate: Estimate) -> str:
    """A number to the second digit of its uncertainty, ``17.872 ± 0.013``; the number alone if that is rounding."""
    value, uncertainty = estimate.value, estimate.uncertainty
    if value is None or uncertainty is None:
        return "-"
    if uncertainty <= max(RESOLUTION, ROUNDING * abs(value)):
        return f"{value:.9g}" if abs(value) > RESOLUTION else "0"
    last = math.floor(math.log10(uncertainty)) - 1
    if abs(value) < 10.0**last:
        return f"0 ± {uncertainty:#.2g}"
    digits = math.floor(math.log10(abs(value))) - last + 1
    both = f"{value:#.{max(1, digits)}g} ± {uncertainty:#.2g} "
    return both.replace(". ", " ").replace(".e", "e").strip()
