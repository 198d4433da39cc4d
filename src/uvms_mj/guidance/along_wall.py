r"""Along the wall with a given push: position in the wall's plane, force along its normal.

The reference approaches the wall along x, stops at the depth at which the desired impedance demands the push F from
eq. (7) and the wall's spring,

.. math:: x_d - x_c = F (n^\top K_d^{-1} K_f n + 1/k_c) + n^\top K_d^{-1} K_f F_d,

and then follows a constant-speed path in the plane (:mod:`.path`) at this depth. n is the wall's normal in B. K_f and
F_d are those before the schedule of the impedance, which changes the push on the way. Without a spring K_d along n, F_d
alone demands the push, and the depth is zero.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator

from ..errors import Fault
from ..physics.frames import quat_from_euler_deg, rotation_matrix
from ..quantities import Coordinate, NonNegative, Positive, Time
from ..stages.base import setting
from .path import MOST_POSES, motion
from .spline import Followed

_MOMENT = 1e-6
"""Dwell at a point at which the path only stops [s]."""


def _in_plane(points: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    if not 1 <= len(points) < MOST_POSES:
        raise ValueError(f"has {len(points)} points; 1 to {MOST_POSES - 1} are allowed")
    for i, point in enumerate(points):
        if len(point) != 2:
            raise ValueError(f"has {len(point)} values at [{i}]; 2 are needed, y and z of W")
    return points


@dataclass(frozen=True)
class AlongWall(Followed):
    """Along the wall with a given push: approach, dwell, then a constant-speed path in the wall's plane."""

    push: NonNegative = setting(1.5, "N", "push that the desired impedance demands at rest, before its schedule")
    points: Annotated[tuple[tuple[Coordinate, ...], ...], AfterValidator(_in_plane)] = setting(
        ((1.0, 0.0),), "m", "[[y, z], ...] of W after the point of the approach, through which the path goes"
    )
    speed: Positive = setting(0.1, "m/s", "speed along the wall")
    acceleration: Positive = setting(0.05, "m/s^2", "greatest acceleration along the path, at its ends")
    dwell: Positive = setting(5.0, "s", "time at the wall before the path along it begins")
    stop: bool = setting(False, "-", "true: stop at each point, with straight lines between them")
    start_time: Time = setting(1.0, "s", "time at which the approach begins")

    name = "along_wall"

    def depth(self, scenario: Any) -> float:
        """x_d - x_c [m] that demands the push."""
        impedance, wall = scenario.impedance, scenario.wall
        normal = rotation_matrix(quat_from_euler_deg(*self.attitude_deg))[0]
        pushed = np.abs(normal) > 1e-12
        n, K_d, K_f, F_d = (np.array(a)[:3][pushed] for a in (normal, impedance.K_d, impedance.K_f, impedance.F_d))
        if (K_d == 0.0).any():
            return 0.0
        give = K_f / K_d
        k_c, _ = scenario.bumper.in_front_of(wall.stiffness, wall.damping)
        return self.push * (float(n @ (give * n)) + 1.0 / k_c) + float(n @ (give * F_d))

    def constants(self, setup: Any) -> Mapping[str, Any]:
        """The constants of :func:`.spline.follow`."""
        scenario = setup.scenario
        initial, x_d = setup.initial, scenario.wall.position + self.depth(scenario)
        positions = [initial.position, (x_d, *initial.position[1:]), *((x_d, *point) for point in self.points)]
        attitudes = (initial.attitude_deg, *(self.attitude_deg for _ in positions[1:]))
        dwells = (0.0, self.dwell, *(_MOMENT if self.stop else 0.0 for _ in self.points))
        keys = ("wall.position", *(f"reference.points[{i}]" for i in range(len(self.points))))
        timing = (self.start_time, self.speed, self.acceleration)
        return motion(tuple(positions), attitudes, dwells, timing, keys)

    def rest_pose(self, scenario: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return (scenario.wall.position + self.depth(scenario), *self.points[-1]), self.attitude_deg

    def faults(self, setup: Any) -> Iterable[Fault]:
        scenario = setup.scenario
        if not scenario.wall.present:
            yield Fault("reference.name", "along_wall follows [wall], and wall.present is false; use path")
        elif scenario.vehicle.contact_bodies:
            touches = "along_wall pushes with the sphere about the origin, and the scenario has vehicle.contact_bodies"
            yield Fault("reference.name", f"{touches}; use path")
