"""The rows of the page's studies: where each law stops working along an axis, and what it does there."""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ...control.theory.loop import ForceAge
from ...setup.base import set_up
from ...studies.plan import Plan
from ...studies.plan.metrics import COMPLETED, successes
from .plans import AXES, DEMANDED, LAWS, MAPS, PART, STEPS, STEPS_NAME, Axis, step_label

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
        """The rows of a law along an axis, from ideal to real, with the column ``works``."""
        frame = self.frames[axis.name].assign(works=self.works(axis.name))
        return frame[frame["law"] == law].set_index(axis.key).loc[list(axis.values)].reset_index()

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
        """The row of GSTA with the gains ``law`` after a number of steps to a pool, with the column ``works``."""
        frame = self.frames[STEPS_NAME].assign(works=self.works(STEPS_NAME))
        return frame[frame["law"] == step_label(law, bumper, number)].iloc[0]

    def steps_survived(self, law: str, bumper: bool) -> int:
        """Number of steps from ideal, the ideal one included, after which a law still works, without a gap."""
        works = [bool(self.step(law, bumper, number)["works"]) for number in range(len(STEPS))]
        return works.index(False) if False in works else len(works)


def why(row: pd.Series) -> str:
    """What a run that does not work does, in a few words."""
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
