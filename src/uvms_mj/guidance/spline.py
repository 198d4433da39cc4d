"""Timed poses: a smooth motion in six degrees of freedom that is at each pose at its time."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import AfterValidator
from pydantic.dataclasses import dataclass as table

from ..quantities import STRICT, Angles, Position, Time
from ..stages.base import setting
from .segments import Followed, pack, pose_numbers, quintic_spline

MOST_POSES = 250


@table(frozen=True, config=STRICT)
class TimedPose:
    time: Time
    position: Position
    attitude_deg: Angles | None = None
    dwell: Time = 0.0


def _in_time(poses: tuple[TimedPose, ...]) -> tuple[TimedPose, ...]:
    if not 1 <= len(poses) <= MOST_POSES:
        raise ValueError(f"has {len(poses)} poses; 1 to {MOST_POSES} are allowed")
    if poses[0].time <= 0.0:
        raise ValueError(f"begins at time {poses[0].time:g}: the first pose must be later than 0, where start is")
    for before, pose in itertools.pairwise(poses):
        leaves = before.time + before.dwell
        if pose.time <= leaves:
            raise ValueError(f"has a pose at {pose.time:g} s, but the one before it is left at {leaves:g} s")
    return poses


@functools.lru_cache(maxsize=8)
def _motion(poses: tuple[TimedPose, ...], start: Any, attitudes: tuple[Any, ...]) -> dict[str, np.ndarray]:
    numbers = pose_numbers(
        [start, *(pose.position for pose in poses)], attitudes, [f"reference.poses[{i}]" for i in range(len(poses))]
    )
    stops = [0, *(i for i, pose in enumerate(poses, 1) if pose.dwell > 0.0 or i == len(poses))]
    arrives = np.array([0.0, *(pose.time for pose in poses)])
    leaves = arrives + np.array([0.0, *(pose.dwell for pose in poses)])
    parts = []
    for first, last in itertools.pairwise(stops):
        times = np.array([leaves[first], *arrives[first + 1 : last + 1]])
        parts.append(quintic_spline(times, numbers[first : last + 1]))
    return pack(parts)


@dataclass(frozen=True)
class Spline(Followed):
    """Timed poses: quintic splines through positions and attitudes, with feed-forward to the acceleration."""

    poses: Annotated[tuple[TimedPose, ...], AfterValidator(_in_time)] = setting(
        (TimedPose(time=5.0, position=(1.01, 0.0, 0.0)),),
        "s, m, deg",
        "[{time = 5.0, position = [1.01, 0.0, 0.0], attitude_deg = [0.0, 0.0, 30.0], dwell = 2.0}, ...]; attitude_deg "
        "and dwell may be left out; at most 250",
    )
    start: Position | None = setting(
        None, "m", "position at t = 0, with initial.attitude_deg; default: initial.position"
    )

    name = "spline"
    _inner_keys: ClassVar = {"reference.poses": ("time", "position", "attitude_deg", "dwell")}

    def constants(self, setup: Any) -> Mapping[str, Any]:
        """The constants of :func:`.segments.follow`."""
        initial = setup.initial
        attitudes = (initial.attitude_deg, *(pose.attitude_deg or self.attitude_deg for pose in self.poses))
        return _motion(self.poses, self.start or initial.position, attitudes)

    def rests_at(self) -> tuple[float, ...]:
        return self.poses[-1].position

    def rest_pose(self, scenario: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return self.poses[-1].position, self.poses[-1].attitude_deg or self.attitude_deg
