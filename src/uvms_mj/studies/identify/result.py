"""The result of an identification: coefficients with intervals, unknowns that can't be told apart, errors on held-out
data beside naive models."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .fit import UNRESOLVED, Z_95, Fit, fit
from .problem import Problem

_CORRELATED = 0.9
_PART = 0.15
"""Least share of a name in a direction that is said to be not told apart."""
_CORRELATED_RESIDUALS = (
    "residuals are correlated in time, so the model lacks something; samples of a signal that count as one"
)
_NOT_SHOWN = "the data do not show it"
_GAVE_UP = "the fit did not converge: its numbers are from the last iteration"


@dataclass(frozen=True)
class Coefficient:
    """A coefficient: its value, half the width of its 95 % interval, and the reason why it has none. A coefficient that
    is not given has the value at which the fit left it, which the data do not support."""

    name: str
    unit: str
    start: float
    value: float
    half_width: float
    why_not: str = ""

    @property
    def given(self) -> bool:
        return not self.why_not

    def text(self) -> str:
        """The value with its interval, or the reason why it has none."""
        if not self.given:
            return f"{self.name}: not given, {self.why_not};"
        return f"{self.name} = {self.value:.6g} +- {self.half_width:.2g} {self.unit};"


@dataclass(frozen=True)
class HeldOut:
    """The rms error of a channel on held-out samples [its unit]: of the fit, of the vehicle that it began with, and of
    the mean of the fitted samples, or for a turn of no turn; NaN where there are none."""

    experiment: str
    channel: str
    unit: str
    samples: int
    fitted: float
    before: float
    mean: float


@dataclass(frozen=True)
class Result:
    """The result of an identification.

    Attributes:
        fit: the fit with its information.
        coefficients: in the order of the file.
        unknowns: experiment, name, unit, value and half width of each unknown of an experiment; NaN without one.
        apart: groups of names that the data can't tell apart, each with the standard deviation of its direction in
            units of the scales.
        correlated: pairs of given coefficients with their correlation, beyond 0.9.
        x: coefficients and unknowns, also of the held-out experiments.
        held_out: errors on held-out samples.
        notes: warnings.
    """

    fit: Fit
    coefficients: tuple[Coefficient, ...]
    unknowns: tuple[tuple[str, str, str, float, float], ...]
    apart: tuple[tuple[tuple[str, ...], float], ...]
    correlated: tuple[tuple[str, str, float], ...]
    x: np.ndarray
    held_out: tuple[HeldOut, ...]
    notes: tuple[str, ...]

    def sentence(self) -> str:
        """The coefficients that are given and that are not, for the vehicle's file."""
        given = [each.name for each in self.coefficients if each.given]
        lost = [each.name for each in self.coefficients if not each.given]
        said = f"Given with 95 % intervals in the text identified: {', '.join(given) or 'none'}."
        return said + (f" Not given: {', '.join(lost)}." if lost else "")

    def tables(self) -> dict[str, Any]:
        """As tables of TOML."""
        return {
            "coefficients": {
                each.name: {"value": each.value, "half_width_95": each.half_width, "unit": each.unit}
                if each.given
                else {"why_not": each.why_not}
                for each in self.coefficients
            },
            "unknowns": [
                {"experiment": of, "name": name, "unit": unit, "value": value}
                | ({"half_width_95": half} if np.isfinite(half) else {})
                for of, name, unit, value, half in self.unknowns
            ],
            "not_told_apart": [
                {"names": list(names), "deviation_over_scale": min(deviation, 1e12)} for names, deviation in self.apart
            ],
            "correlated": [{"names": [a, b], "correlation": r} for a, b, r in self.correlated],
            "held_out": [
                {"experiment": each.experiment, "channel": each.channel, "unit": each.unit, "samples": each.samples}
                | {key: v for key in ("fitted", "before", "mean") if np.isfinite(v := getattr(each, key))}
                for each in self.held_out
            ],
            "notes": list(self.notes),
        }


def judge(problem: Problem, found: Fit) -> Result:
    """The result of a fit."""
    deviation = found.deviation(problem)
    apart = _apart(problem, found)
    coefficients, unknowns = list[Coefficient](), list[tuple[str, str, str, float, float]]()
    for column, k in enumerate(found.free.tolist()):
        own, value, half = problem.all[k], float(found.x[k]), Z_95 * float(deviation[column])
        if own.of is not None:
            unknowns.append((problem.data[own.of].name, own.name, own.unit, value, half))
            continue
        why = ""
        if not found.given[column]:
            others = [n for names, _ in apart if own.name in names for n in names if n != own.name]
            why = f"the data can't tell it from {' and '.join(dict.fromkeys(others))}" if others else _NOT_SHOWN
        elif found.from_prior[column]:
            why = "only its prior says it, and the data do not show it"
        elif found.at_bound[column]:
            why = f"it is at its bound {value:.6g}, so that it has no interval"
        coefficients.append(Coefficient(own.name, own.unit, own.start, value, half, why))
    notes = [note for each in problem.data for note in each.notes]
    if not found.success:
        notes.append(_GAVE_UP)
    for data, times in zip(problem.data, found.tau, strict=True):
        slow = [f"{c.name} {tau:.0f}" for c, tau in zip(data.channels, times, strict=True) if tau > 3.0]
        if slow:
            notes.append(f"{data.name}: {_CORRELATED_RESIDUALS}: {', '.join(slow)}")
    x, held = _held_out(problem, found)
    return Result(
        found, tuple(coefficients), tuple(unknowns), apart, _correlated(problem, found), x, tuple(held), tuple(notes)
    )


def _label(problem: Problem, k: int) -> str:
    own = problem.all[k]
    return own.name if own.of is None else f"{own.name} of {problem.data[own.of].name}"


def _apart(problem: Problem, found: Fit) -> tuple[tuple[tuple[str, ...], float], ...]:
    groups = []
    for value, direction in zip(found.eigenvalues, found.directions.T, strict=True):
        if value < 1.0 / UNRESOLVED**2:
            order = np.argsort(-np.abs(direction))
            names = tuple(_label(problem, int(found.free[i])) for i in order if abs(direction[i]) > _PART)
            groups.append((names, float(1.0 / np.sqrt(value)) if value > 0.0 else np.inf))
    return tuple(groups)


def _correlated(problem: Problem, found: Fit) -> tuple[tuple[str, str, float], ...]:
    spread = np.sqrt(np.maximum(np.diag(found.covariance), 1e-300))
    C = found.covariance / np.outer(spread, spread)
    pairs = []
    for i in range(len(C)):
        for j in range(i):
            told = found.given[i] and found.given[j] and abs(C[i, j]) > _CORRELATED
            if told and problem.all[found.free[i]].of is None and problem.all[found.free[j]].of is None:
                pairs.append((_label(problem, int(found.free[j])), _label(problem, int(found.free[i])), float(C[i, j])))
    return tuple(sorted(pairs, key=lambda pair: -abs(pair[2])))


def _held_out(problem: Problem, found: Fit) -> tuple[np.ndarray, list[HeldOut]]:
    """Coefficients and unknowns, also of the held-out experiments, and the errors on held-out samples. The
    unknowns of an experiment are fitted to its first part, for each vehicle."""
    x, errors = found.x.copy(), list[HeldOut]()
    n = len(problem.coefficients)
    for i, data in enumerate(problem.data):
        fitted = problem.fitted(i)
        if all(each.all() for each in fitted):
            continue
        own = np.array([k for k, each in enumerate(problem.all) if each.of == i], int)
        before = problem.start.copy()
        before[n:] = found.x[n:]
        if len(own):
            if data.experiment.held_out:
                x = fit(problem, own, x, found.sigmas, [i]).x
            before = fit(problem, own, before, found.sigmas, [i]).x
        ours, theirs = problem.errors(i, x), problem.errors(i, before)
        for channel, there, a, b in zip(data.channels, fitted, ours, theirs, strict=True):
            if there.all():
                continue
            mean = float(channel.y[there].mean()) if there.any() else np.nan
            turned = channel.name.startswith("attitude")
            naive = np.nan if turned else _rms(channel.y[~there] - mean)
            where = data.name, channel.name, channel.unit, int((~there).sum())
            errors.append(HeldOut(*where, _rms(a[~there]), _rms(b[~there]), naive))
    return x, errors


def _rms(values: Sequence[float] | np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
