r"""Constant-speed paths: a smooth curve through poses by its arc length, with a limited acceleration at its ends.

A leg is the part of a path between two stops: the start, the poses with a dwell, and the end. Its curve is the natural
quintic spline over the lengths of the chords, a straight line if the leg has two poses. Its speed rises over the time
:math:`T = 3 V / (2 a)` as :math:`V (3 x^2 - 2 x^3)`, whose greatest acceleration along the path is a, and falls in the
same way. A leg that is shorter than V T is done at a lower speed.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import AfterValidator
from pydantic.dataclasses import dataclass as table

from ..errors import Fault, InputError
from ..quantities import STRICT, Angles, Position, Positive, Time
from ..stages.base import setting
from .spline import MOST_SEGMENTS, Followed, hermite, pack, pose_numbers

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

MOST_POSES = 100
_RAMP = 6
"""Segments while the speed rises or falls; on a straight line one would be exact."""
_SAMPLES = 2001
_SHORTEST = 1e-6
"""Poses that are nearer to each other than this have no direction between them [m]."""


@table(frozen=True, config=STRICT)
class Pose:
    position: Position
    attitude_deg: Angles | None = None
    dwell: Time = 0.0


def _some(poses: tuple[Pose, ...]) -> tuple[Pose, ...]:
    if not 1 <= len(poses) <= MOST_POSES:
        raise ValueError(f"has {len(poses)} poses; 1 to {MOST_POSES} are allowed")
    return poses


@functools.lru_cache(maxsize=8)
def motion(
    positions: tuple[Any, ...],
    attitudes: tuple[Any, ...],
    dwells: tuple[float, ...],
    timing: tuple[float, ...],
    keys: Any,
) -> dict[str, np.ndarray]:
    """The constants of :func:`.spline.follow` for a path through positions with attitudes [deg], the first of which
    is the start; with the dwell at each [s]. ``timing`` has the time at which the start is left, the speed V and the
    acceleration a; ``keys`` are those of the poses after the start, for messages."""
    numbers = pose_numbers(positions, attitudes, keys)
    chords = np.linalg.norm(np.diff(numbers[:, :3], axis=0), axis=1)
    faults = [
        Fault(
            keys[i],
            f"the position {list(positions[i + 1])} is that of the pose before it, or of the start: a path has "
            "no direction there; use reference.name = spline, or a dwell at the pose before it",
        )
        for i in np.flatnonzero(chords < _SHORTEST)
    ]
    if faults:
        raise InputError(faults, "scenario")
    stops = [0, *(i for i, dwell in enumerate(dwells) if i and (dwell > 0.0 or i + 1 == len(dwells)))]
    cruise = max(1, MOST_SEGMENTS // (len(stops) - 1) - 2 * _RAMP - 1)
    parts, (t, V, a) = [], timing
    for first, last in itertools.pairwise(stops):
        parts.append(_leg(numbers[first : last + 1], chords[first:last], t, V, a, cruise))
        t = float(parts[-1].x[-1]) + dwells[last]
    return pack(parts)


def _leg(poses: np.ndarray, chords: np.ndarray, t: float, V: float, a: float, cruise: int) -> PPoly:
    """One leg through poses (n, 7), from rest at the time t to rest: segments with the exact position, velocity and
    acceleration at their ends."""
    from scipy.integrate import cumulative_simpson
    from scipy.interpolate import CubicHermiteSpline, make_interp_spline

    knots = np.concatenate([[0.0], np.cumsum(chords)])
    free = [(3, np.zeros(7)), (4, np.zeros(7))]
    straight = len(poses) == 2
    curve = (
        make_interp_spline(knots, poses, k=1)
        if straight
        else make_interp_spline(knots, poses, k=5, bc_type=(free, free))
    )
    u = np.linspace(0.0, knots[-1], _SAMPLES)
    slope = np.linalg.norm(curve(u, 1)[:, :3], axis=1)  # ds/du
    s = cumulative_simpson(slope, x=u, initial=0.0)
    length, of_length = s[-1], CubicHermiteSpline(s, u, 1.0 / slope)
    V = min(V, float(np.sqrt(length * a / 1.5)))
    T = 1.5 * V / a
    T_cruise = length / V - T
    x = np.linspace(0.0, 1.0, _RAMP + 1)
    ramp = V * T * (x**3 - 0.5 * x**4), V * (3.0 * x**2 - 2.0 * x**3), V / T * 6.0 * (x - x**2)
    between = np.linspace(0.0, 1.0, (1 if straight else cruise) + 1)[1:-1]
    if T_cruise < 1e-9 * T:
        between = between[:0]
    ones = np.ones_like(between)
    times = np.concatenate([x * T, T + between * T_cruise, T + T_cruise + x * T])
    s = np.concatenate([ramp[0], 0.5 * V * T + V * T_cruise * between, length - ramp[0][::-1]])
    s_dot = np.concatenate([ramp[1], V * ones, ramp[1][::-1]])
    s_ddot = np.concatenate([ramp[2], 0.0 * ones, -ramp[2][::-1]])
    kept = np.concatenate([np.diff(times) > 1e-12 * T, [True]])
    times, s, s_dot, s_ddot = times[kept], s[kept, None], s_dot[kept, None], s_ddot[kept, None]
    u = np.clip(of_length(s[:, 0]), 0.0, knots[-1])
    c, c_1, c_2 = curve(u), curve(u, 1), curve(u, 2) if not straight else np.zeros((len(u), 7))
    speed = np.linalg.norm(c_1[:, :3], axis=1, keepdims=True)
    bend = np.sum(c_1[:, :3] * c_2[:, :3], axis=1, keepdims=True) / speed**2  # of ds/du along u, over ds/du
    u_dot = s_dot / speed
    u_ddot = s_ddot / speed - bend * u_dot**2
    return hermite(t + times, c, c_1 * u_dot, c_2 * u_dot**2 + c_1 * u_ddot)


@dataclass(frozen=True)
class Path(Followed):
    """Constant-speed path: a smooth curve through positions and attitudes by its arc length, from rest to rest."""

    poses: Annotated[tuple[Pose, ...], AfterValidator(_some)] = setting(
        (Pose(position=(1.01, 0.0, 0.0)),),
        "m, deg, s",
        "[{position = [1.01, 0.0, 0.0], attitude_deg = [0.0, 0.0, 30.0], dwell = 2.0}, ...]; attitude_deg may be left "
        "out; at a pose with a dwell the path stops; at most 100",
    )
    speed: Positive = setting(0.2, "m/s", "speed along the path")
    acceleration: Positive = setting(0.1, "m/s^2", "greatest acceleration along the path, at the ends of a leg")
    start: Position | None = setting(
        None, "m", "position before the path, with initial.attitude_deg; default: initial.position"
    )
    start_time: Time = setting(1.0, "s", "time at which the path begins")

    name = "path"
    _inner_keys: ClassVar = {"reference.poses": ("position", "attitude_deg", "dwell")}

    def constants(self, setup: Any) -> Mapping[str, Any]:
        """The constants of :func:`.spline.follow`."""
        initial = setup.initial
        positions = (self.start or initial.position, *(pose.position for pose in self.poses))
        attitudes = (initial.attitude_deg, *(pose.attitude_deg or self.attitude_deg for pose in self.poses))
        keys = tuple(f"reference.poses[{i}]" for i in range(len(self.poses)))
        dwells = (0.0, *(pose.dwell for pose in self.poses))
        return motion(positions, attitudes, dwells, (self.start_time, self.speed, self.acceleration), keys)

    def rests_at(self) -> tuple[float, ...]:
        return self.poses[-1].position

    def rest_pose(self, scenario: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return self.poses[-1].position, self.poses[-1].attitude_deg or self.attitude_deg
