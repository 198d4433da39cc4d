r"""Reference model: position steps smoothed by a third-order filter, at a constant attitude.

Each step of height Delta at time t_i passes through (omega_n / (p + omega_n))^3 (paper sec. 5). Its step response has
the closed form

.. math::

    g(x) = 1 - e^{-x}(1 + x + x^2/2), \quad x = \omega_n (t - t_i),

so the reference has no state and no discretisation error.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import AfterValidator
from pydantic.dataclasses import dataclass as table

from ..physics.frames import quat_from_euler_deg
from ..quantities import STRICT, Number, Position, Time, idle, within
from ..stages.base import setting
from ..stages.setup import SetupLike
from .base import Guidance, start_notes

MOST_WAYPOINTS = 1000
_FASTEST = 0.5
"""Largest bandwidth times control period [rad] at which the law sees the reference as a motion, not as a jump."""

_NEVER = np.full(MOST_WAYPOINTS, np.inf)
_SETTLED = 60.0  # for larger x, 1 - g(x) is below the rounding error of 1


@table(frozen=True, config=STRICT)
class Waypoint:
    time: Time
    position: Position


def _increasing(waypoints: tuple[Waypoint, ...]) -> tuple[Waypoint, ...]:
    if len(waypoints) > MOST_WAYPOINTS:
        raise ValueError(f"has {len(waypoints)} steps; at most {MOST_WAYPOINTS} are allowed")
    times = [w.time for w in waypoints]
    if any(b <= a for a, b in itertools.pairwise(times)):
        raise ValueError(f"times {times} must increase")
    return waypoints


@functools.lru_cache(maxsize=8)
def _padded(step_time: float, target: tuple[float, ...], waypoints: tuple[Waypoint, ...]) -> tuple[np.ndarray, ...]:
    times, positions = _NEVER.copy(), np.zeros((MOST_WAYPOINTS, 3))
    times[0], positions[0] = step_time, target
    for n, step in enumerate(waypoints):
        times[n], positions[n] = step.time, step.position
    times.setflags(write=False)
    positions.setflags(write=False)
    return times, positions


@dataclass(frozen=True)
class FilteredSteps(Guidance):
    """Position steps through a third-order filter, at a constant attitude."""

    target: Position = setting((1.01, 0.0, 0.0), "m", "position after the step, in W")
    step_time: Time = setting(1.0, "s", "time of the step")
    bandwidth: Annotated[Number, within(1e-6, 1e6, "rad/s")] = setting(
        2.0, "rad/s", "omega_n of the third-order filter (omega_n / (p + omega_n))^3"
    )
    start: Position | None = setting(None, "m", "position before the first step; default: initial.position")
    waypoints: Annotated[tuple[Waypoint, ...], AfterValidator(_increasing)] = setting(
        (),
        "s, m",
        "steps that replace target and step_time: [{time = 1.0, position = [1.01, 0.0, 0.0]}, ...]; at most 1000",
    )

    name = "filtered_steps"
    ending: ClassVar = ("times", "positions")
    _inner_keys: ClassVar = {"reference.waypoints": ("time", "position")}

    @property
    def steps(self) -> tuple[Waypoint, ...]:
        """Position steps at the input of the filter."""
        return self.waypoints or (Waypoint(time=self.step_time, position=self.target),)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """quat_d (4,), the quaternion of attitude_deg; start (3,), the position before the first step [m]; times (n,),
        increasing [s]; positions (n, 3), after the steps [m]; and bandwidth. The arrays have room for
        :data:`MOST_WAYPOINTS`, so that the machine code is the same for any number of steps. A step at infinity never
        comes."""
        times, positions = _padded(self.step_time, self.target, self.waypoints)
        start, quat_d = self.start or setup.initial.position, quat_from_euler_deg(*self.attitude_deg)
        return {"quat_d": quat_d, "start": start, "times": times, "positions": positions, "bandwidth": self.bandwidth}

    def rests_at(self) -> tuple[float, ...]:
        return self.waypoints[-1].position if self.waypoints else self.target

    def notes(self, setup: SetupLike) -> Iterable[str]:
        if setup.scenario.task.frame != "body":  # whose attitude follows from a posture, and is no choice
            yield from start_notes(self, setup)
        if self.waypoints:
            yield from idle(self, "reference", ("target", "step_time"), "reference.waypoints are given")
        period = setup.scenario.control_period
        if self.bandwidth * period > _FASTEST:
            yield (
                f"the law sees the reference as a jump: with reference.bandwidth = {self.bandwidth:g} rad/s "
                f"it ends within a few control periods of {period:g} s; choose less than {_FASTEST / period:g} rad/s"
            )

    @staticmethod
    def step(settings, state, given, state_dot, out):
        start, times, positions, bandwidth = settings.start, settings.times, settings.positions, settings.bandwidth
        out.p_d[:], out.p_d_dot[:], out.p_d_ddot[:], out.quat_d[:] = start, 0.0, 0.0, settings.quat_d
        before = start.copy()
        for n in range(times.shape[0]):
            x = bandwidth * (given.t - times[n])
            if x <= 0.0:
                break
            g, g_dot, g_ddot = 1.0, 0.0, 0.0
            if x < _SETTLED:
                decay = math.exp(-x)
                g = 1.0 - decay * (1.0 + x + 0.5 * x * x)
                g_dot = bandwidth * decay * 0.5 * x * x
                g_ddot = bandwidth * bandwidth * decay * (x - 0.5 * x * x)
            height = positions[n] - before
            out.p_d += height * g
            out.p_d_dot += height * g_dot
            out.p_d_ddot += height * g_ddot
            before = positions[n].copy()
