r"""A hybrid of force and motion over time: K_f and F_d of the generalised impedance, eq. (7), by a schedule.

From the time of an entry on, K_f and F_d go to its values within its ramp, along :math:`10 x^3 - 15 x^4 + 6 x^5`, so
that their first two derivatives are continuous. Without a schedule they are constants, and this stage does not exist.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pydantic.dataclasses import dataclass as table

from ..quantities import STRICT, Factors, Time, Wrench
from ..stages.base import Room, Stage
from ..stages.signals import CLOCK, SCHEDULED

MOST_ENTRIES = 100


@table(frozen=True, config=STRICT)
class Change:
    """An entry of the schedule. A value that is not given stays as it is before."""

    time: Time
    K_f: Factors | None = None
    F_d: Wrench | None = None
    ramp: Time = 0.0


def in_order(changes: tuple[Change, ...]) -> tuple[Change, ...]:
    """Check that each entry begins after the one before it has ended. Raises ValueError."""
    if len(changes) > MOST_ENTRIES:
        raise ValueError(f"has {len(changes)} entries; at most {MOST_ENTRIES} are allowed")
    for before, change in itertools.pairwise(changes):
        ends = before.time + before.ramp
        early = change.time < ends and not math.isclose(change.time, ends)  # 0.1 + 0.2 is above 0.3
        if early or change.time <= before.time:
            raise ValueError(
                f"has an entry at {change.time:g} s, but the one before it begins at {before.time:g} s and "
                f"ends at {ends:g} s"
            )
    return changes


@dataclass(frozen=True)
class Schedule(Stage):
    """K_f and F_d over time."""

    name = "schedule"
    room: ClassVar[Room] = Room("control", "impedance", lambda thrusters: CLOCK, SCHEDULED)

    def constants(self, setup: Any) -> Mapping[str, Any]:
        """Times (n,), infinite for entries that are not given, and ramps (n,) [s]; values (n + 1, 12) of K_f and F_d
        before the first entry and after each."""
        impedance = setup.scenario.impedance
        times, ramps = np.full(MOST_ENTRIES, np.inf), np.zeros(MOST_ENTRIES)
        values = np.zeros((MOST_ENTRIES + 1, 12))
        values[0] = *impedance.K_f, *impedance.F_d
        for n, change in enumerate(impedance.schedule):
            times[n], ramps[n], values[n + 1] = change.time, change.ramp, values[n]
            if change.K_f is not None:
                values[n + 1, :6] = change.K_f
            if change.F_d is not None:
                values[n + 1, 6:] = change.F_d
        return {"times": times, "ramps": ramps, "values": values}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        times, ramps, values = settings.times, settings.ramps, settings.values
        n = 0
        for k in range(times.shape[0]):
            if given.t < times[k]:
                break
            n = k + 1
        x = 1.0
        if n > 0 and given.t < times[n - 1] + ramps[n - 1]:
            x = (given.t - times[n - 1]) / ramps[n - 1]
        blend = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
        out.K_f[:], out.F_d[:] = values[n, :6], values[n, 6:]
        if x < 1.0:
            out.K_f[:] = values[n - 1, :6] + blend * (values[n, :6] - values[n - 1, :6])
            out.F_d[:] = values[n - 1, 6:] + blend * (values[n, 6:] - values[n - 1, 6:])
