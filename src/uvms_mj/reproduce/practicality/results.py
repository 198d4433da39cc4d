"""The studies of the page: one along each axis of axes.toml, two maps, and the steps from ideal to a pool; their
rows: where each law stops working along an axis; and the measure of each claim of claims.toml."""

import dataclasses
import functools
import itertools
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ...control.theory.loop import ForceAge
from ...quantities import leaves
from ...setup.base import set_up
from ...studies.pages import number
from ...studies.plan import Plan
from ...studies.plan.metrics import COMPLETED, successes
from ..claims import Measured, claims_in

PART = 0.1
"""Largest error of the mean push, as part of the demanded one."""
DEMANDED = 1.5
"""Push that the ideal scenario demands of a rigid wall [N]."""
KEPT = (
    *("force_error_N", "force_range_N", "contact.final_N", "contact.peak_N", "contact.touches"),
    *("chattering_N_per_s", "saturated_s", "contact.settled"),
)
SUCCESS = {"force_error_N": [-PART * DEMANDED, PART * DEMANDED], "force_range_N": [0.0, DEMANDED]}
"""A law works if it presses with the demanded force within a tenth, and the force varies by no more than itself."""
STEPS_NAME = "steps"


@dataclass(frozen=True)
class Axis:
    """One way from ideal to real.

    Attributes:
        name: of its study.
        title: for figures and tables.
        key: the scenario's key that varies; a rate is named by its period.
        unit: unit of the key.
        values: from ideal to worse than real.
        real: a value as in a pool.
        source: of the real value, and how far to trust it.
        base: further keys of the axis.
        repeats: runs of each value with other random numbers, where there is noise.
    """

    name: str
    title: str
    key: str
    unit: str
    values: tuple[float, ...]
    real: float
    source: str
    base: Mapping[str, Any]
    repeats: int = 1

    @property
    def logarithmic(self) -> bool:
        """Whether the values are drawn on a logarithmic scale."""
        positive = [value for value in self.values if value > 0.0]
        return max(positive) / min(positive) > 30.0

    def text(self, value: float) -> str:
        """A value with its unit."""
        return f"{value:g}" if self.unit == "1" else f"{value:g} {self.unit}"

    @property
    def table(self) -> dict[str, Any]:
        """The axis as an entry of ``[[vary]]``."""
        return {"key": self.key, "values": list(self.values)}


def _keys(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Nested tables by dotted keys."""
    return dict(leaves(tables, lists=False))


_FILE = tomllib.loads(Path(__file__).with_name("axes.toml").read_text(encoding="utf-8"))
BASE, BUMPER, SMOOTHER = (_keys(_FILE[name]) for name in ("base", "bumper", "retuned"))
RETUNED = "gsta retuned"
LAWS: Sequence[Mapping[str, Any]] = (
    {"name": "impedance"},
    {"name": "fosm"},
    {"name": "gsta"},
    {"name": "gsta", "label": RETUNED, **SMOOTHER},
)
"""The paper's laws with the paper's gains, and GSTA with the retuned ones."""
AXES: Mapping[str, Axis] = {
    each["name"]: Axis(**each | {"values": tuple(each["values"]), "base": _keys(each.get("base", {}))})
    for each in _FILE["axis"]
}
"""The axes by name."""
MAPS: Mapping[str, tuple[Axis, Axis]] = {
    f"{name}_and_stiffness": (
        dataclasses.replace(AXES[name], values=tuple(_FILE["maps"]["periods"])),
        dataclasses.replace(AXES["wall_stiffness"], values=tuple(_FILE["maps"]["stiffnesses"])),
    )
    for name in _FILE["maps"]["axes"]
}
"""Maps over two axes, by the name of their study."""
STEPS: Sequence[tuple[str, Mapping[str, Any]]] = tuple(
    (each["title"], _keys(each.get("keys", {}))) for each in _FILE["step"]
)
"""The steps from ideal to a pool: title and keys."""


def step_label(law: str, bumper: bool, number: int) -> str:
    """Label of GSTA with the gains ``law`` after a number of steps."""
    return f"{law}{' with bumper' if bumper else ''} {number}"


def laws_of_steps() -> list[dict[str, Any]]:
    """GSTA with both sets of gains after each step, with and without the bumper, as ``[[laws]]`` of a study."""
    laws, keys = [], dict[str, Any]()
    for index, (_, more) in enumerate(STEPS):
        if more.get("navigation.name"):
            keys = {key: value for key, value in keys.items() if not key.startswith("navigation.")}
        keys |= more
        if keys.get("thrusters.name"):
            keys["thrusters.assumed_voltage"] = 16.0
        for (law, gains), bumper in itertools.product((("gsta", {}), (RETUNED, SMOOTHER)), (False, True)):
            own = {**keys, **gains, **(BUMPER if bumper else {})}
            laws.append({"name": "gsta", "label": step_label(law, bumper, index), **own})
    return laws


def plans(overrides: Mapping[str, Any]) -> dict[str, Plan]:
    """The studies by name. ``overrides`` are dotted keys of the ideal scenario. Raises InputError if one is invalid."""
    found = {axis.name: _plan(axis.name, axis.base, LAWS, (axis,), axis.repeats, overrides) for axis in AXES.values()}
    found |= {name: _plan(name, {}, LAWS, pair, 1, overrides) for name, pair in MAPS.items()}
    return found | {STEPS_NAME: _plan(STEPS_NAME, {}, laws_of_steps(), (), _FILE["steps"]["repeats"], overrides)}


def _plan(
    name: str,
    base: Mapping[str, Any],
    laws: Sequence[Mapping[str, Any]],
    axes: Sequence[Axis],
    repeats: int,
    overrides: Mapping[str, Any],
) -> Plan:
    tables = {
        "name": name,
        "base": {**BASE, **base, **overrides},
        "laws": [dict(law) for law in laws],
        "vary": [axis.table for axis in axes],
        "design": {"repeats": repeats},
        "keep": {"metrics": list(KEPT)},
        "success": dict(SUCCESS),
        "run": {"engine": "free_body"},
    }
    return Plan.from_dict(tables, place="practicality")


LABELS: Sequence[str] = tuple(str(law.get("label", law["name"])) for law in LAWS)
"""The laws in order."""


@dataclass(frozen=True)
class Boundary:
    """Where a law stops working along an axis.

    Attributes:
        last: the value up to which it works, None if not even the ideal one.
        first: the first value at which it does not work, None if it works up to the end.
        why: what the run does at ``first``; empty if there is none.
    """

    axis: Axis
    law: str
    last: float | None
    first: float | None
    why: str

    @property
    def between(self) -> float | None:
        """The geometric mean of the last value at which the law works and the first one at which it does not; None
        without one of them."""
        return None if not self.last or not self.first else math.sqrt(self.last * self.first)

    @property
    def text(self) -> str:
        """The boundary in words."""
        if self.first is None:
            assert self.last is not None
            return f"works at all values, to {self.axis.text(self.last)}"
        return (
            f"to {self.axis.text(self.last)}" if self.last is not None else f"not even at {self.axis.text(self.first)}"
        )


class Results:
    """The rows of all studies by name, with their plans."""

    def __init__(self, plans: Mapping[str, Plan], frames: Mapping[str, pd.DataFrame]) -> None:
        self.plans, self.frames = plans, frames
        self.boundaries = {(name, law): self._boundary(axis, law) for name, axis in AXES.items() for law in LABELS}

    def works(self, study: str) -> np.ndarray:
        """Whether each run (n,) of a study works."""
        return successes(self.frames[study], self.plans[study].success)

    def along(self, axis: Axis, law: str) -> pd.DataFrame:
        """The rows of a law along an axis, from ideal to real, with the column ``works``; of repeats, the worst."""
        frame = self.frames[axis.name].assign(works=self.works(axis.name))
        mine = _worst_first(frame[frame["law"] == law]).drop_duplicates(axis.key)
        return mine.set_index(axis.key).loc[list(axis.values)].reset_index()

    def _boundary(self, axis: Axis, law: str) -> Boundary:
        rows = self.along(axis, law)
        broken = np.flatnonzero(~rows["works"].to_numpy())
        if not len(broken):
            return Boundary(axis, law, axis.values[-1], None, "")
        first = int(broken[0])
        return Boundary(axis, law, axis.values[first - 1] if first else None, axis.values[first], why(rows.iloc[first]))

    def predicted(self, axis: Axis, law: str) -> float | None:
        """The value of an axis at which the contact force is as old as its limit, by interpolation; None if it never
        is."""
        ages = np.array(self._ages(axis.name, law))
        if not ages[0] < 1.0 < ages[-1]:
            return None
        after = int(np.argmax(ages >= 1.0))
        return float(np.interp(1.0, ages[after - 1 : after + 1], axis.values[after - 1 : after + 1]))

    def limits(self, name: str, law: str) -> np.ndarray:
        """The line (n, 2) of a map on which the contact force is as old as its limit, by interpolation."""
        plan, (x, y) = self.plans[name], MAPS[name]
        ratios = dict(zip(plan.points, self._ages(name, law), strict=True))
        line = []
        for stiffness in y.values:
            ages = np.array([ratios[value, stiffness] for value in x.values])
            if ages[0] < 1.0 < ages[-1]:
                at = np.interp(0.0, np.log(np.maximum(ages, 1e-12)), np.log(x.values))
                line.append((float(np.exp(at)), stiffness))
        return np.array(line).reshape(-1, 2)

    @functools.cache  # noqa: B019  # the results live as long as the command
    def _ages(self, name: str, law: str) -> list[float]:
        """Age of the contact force over its limit, for each draw of a study."""
        plan = self.plans[name]
        place = [each.label for each in plan.laws].index(law)
        setups = (set_up(plan.scenario(draw * len(plan.laws) + place)) for draw in range(plan.draws))
        return [ForceAge.of(setup).share for setup in setups]

    def step(self, law: str, bumper: bool, number: int) -> pd.Series:
        """The row of GSTA with the gains ``law`` after a number of steps to a pool, with the column ``works``; of
        repeats, the worst."""
        frame = self.frames[STEPS_NAME].assign(works=self.works(STEPS_NAME))
        return _worst_first(frame[frame["law"] == step_label(law, bumper, number)]).iloc[0]

    def steps_survived(self, law: str, bumper: bool) -> int:
        """Number of steps from ideal, the ideal one included, after which a law still works, without a gap."""
        works = [bool(self.step(law, bumper, number)["works"]) for number in range(len(STEPS))]
        return works.index(False) if False in works else len(works)


def _worst_first(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows that do not work before rows that work; of equals, the one first whose push varies most. A run that did not
    complete has no such number, and is first."""
    return rows.sort_values(["works", "force_range_N"], ascending=[True, False], na_position="first", kind="stable")


def why(row: pd.Series) -> str:
    """The reason why a run does not work, in a few words."""
    if row["status"] != COMPLETED:
        return f"{row['status']}: {row['message']}"
    if row["contact.touches"] == 0:
        return "never touches the wall"
    if row["force_range_N"] > DEMANDED:
        saturated = ", thrusters at their limits" if row["saturated_s"] > 0.5 else ""
        return f"vibrates: the push varies by {row['force_range_N']:.3g} N{saturated}"
    if abs(row["force_error_N"]) > PART * DEMANDED:
        return f"presses with {row['contact.final_N']:.3g} N, {row['force_error_N']:+.3g} N wrong"
    return "works"


def _ideal(results: Results, law: str) -> tuple[float, float]:
    """Mean push and range of the push with everything ideal [N]."""
    row = results.along(AXES["force_delay"], law).iloc[0]
    return float(row["contact.final_N"]), float(row["force_error_N"])


def push(results: Results, law: str) -> Measured:
    """Mean push with everything ideal [N]."""
    return Measured(_ideal(results, law)[0], f"{number(DEMANDED)} N demanded")


def error(results: Results, law: str) -> Measured:
    """Relative force error of a law with everything ideal [%]."""
    force, off = _ideal(results, law)
    return Measured(100.0 * abs(off) / (force - off), f"presses with {number(force)} N")


def over_prediction(results: Results, name: str) -> Measured:
    """Value of an axis up to which GSTA works, over the value at which the contact force becomes too old."""
    axis, found = AXES[name], results.boundaries[name, "gsta"]
    expected = results.predicted(axis, "gsta")
    if found.between is None or expected is None:
        return Measured(None, "no boundary")
    detail = f"works to {found.last:g} s, not at {found.first:g} s; too old from {expected:.3g} s on"
    return Measured(found.between / expected, detail)


def ages_over_stiffness(results: Results) -> Measured:
    """Median over the stiffnesses of the delay up to which GSTA works, over the limit of the force's age."""
    name = "force_delay_and_stiffness"
    x, y = MAPS[name]
    frame = results.frames[name].assign(works=results.works(name))
    limits = {stiffness: delay for delay, stiffness in results.limits(name, "gsta")}
    ratios = []
    for stiffness, limit in limits.items():
        rows = frame[(frame["law"] == "gsta") & (frame[y.key] == stiffness)].sort_values(x.key)
        works = rows["works"].to_numpy()
        if works[0] and not works.all():
            first = int(np.argmin(works))
            ratios.append(float(np.sqrt(np.prod(rows[x.key].to_numpy(float)[first - 1 : first + 1]))) / limit)
    detail = f"{len(ratios)} stiffnesses, from {number(min(ratios))} to {number(max(ratios))}" if ratios else ""
    return Measured(float(np.median(ratios)) if ratios else None, detail)


def one_over_other(results: Results, one: str, law: str, other: str, other_law: str, detail: str) -> Measured:
    """Value of the axis ``one`` up to which a law works, over the value of another axis or law. The detail has a place
    for each of the two values."""
    ours, theirs = results.boundaries[one, law].last, results.boundaries[other, other_law].last
    if ours is None or not theirs:
        return Measured(None, "no boundary")
    return Measured(ours / theirs, detail.format(ours, theirs))


def error_at_real(results: Results, name: str, law: str) -> Measured:
    """Force error of a law at the real value of an axis [% of the demanded push]."""
    axis = AXES[name]
    rows = results.along(axis, law)
    row = rows.iloc[int(np.argmin(np.abs(rows[axis.key].to_numpy(float) - axis.real)))]
    off, spread = float(row["force_error_N"]), float(row["force_range_N"])
    detail = f"at {axis.text(row[axis.key])}: {off:+.2g} N, varies by {spread:.2g} N"
    return Measured(100.0 * abs(off) / DEMANDED, detail)


def last_value(results: Results, name: str, law: str) -> Measured:
    """The value of an axis up to which a law works."""
    found = results.boundaries[name, law]
    return Measured(found.last, found.why)


def steps_with(results: Results, law: str, bumper: bool) -> Measured:
    """Number of steps from ideal to a pool after which a law works."""
    survived = results.steps_survived(law, bumper)
    stop = f"stops at: {STEPS[survived][0]}" if survived < len(STEPS) else "works after all steps"
    return Measured(float(survived - 1), stop)


def error_after_step(results: Results, law: str, bumper: bool, step: int) -> Measured:
    """Force error of a law after a step [N]."""
    row = results.step(law, bumper, step)
    return Measured(abs(float(row["force_error_N"])), f"varies by {float(row['force_range_N']):.2g} N")


CLAIMS = claims_in(Path(__file__).with_name("claims.toml"), globals())
"""All claims in the order of the page."""
