"""Settings of the reference: position steps through a filter."""

import itertools
from typing import Annotated

from pydantic import AfterValidator
from pydantic.dataclasses import dataclass

from ..quantities import STRICT, Angles, Number, Position, Time, doc, within


@dataclass(frozen=True, config=STRICT)
class Waypoint:
    time: Time
    position: Position


MOST_WAYPOINTS = 1000


def _increasing(waypoints: tuple[Waypoint, ...]) -> tuple[Waypoint, ...]:
    if len(waypoints) > MOST_WAYPOINTS:
        raise ValueError(f"has {len(waypoints)} steps; at most {MOST_WAYPOINTS} are allowed")
    times = [w.time for w in waypoints]
    if any(b <= a for a, b in itertools.pairwise(times)):
        raise ValueError(f"times {times} must increase")
    return waypoints


@dataclass(frozen=True, config=STRICT)
class Reference:
    target: Position = doc("position after the step, in W [m]", (1.01, 0.0, 0.0))
    step_time: Time = doc("time of the step [s]", 1.0)
    bandwidth: Annotated[Number, within(1e-6, 1e6, "rad/s")] = doc(
        "omega_n of the third-order filter (omega_n / (p + omega_n))^3 [rad/s]", 2.0
    )
    attitude_deg: Angles = doc("constant desired roll, pitch, yaw [deg]", (0.0, 0.0, 0.0))
    start: Position | None = doc("position before the first step; default: initial.position", None)
    waypoints: Annotated[tuple[Waypoint, ...], AfterValidator(_increasing)] = doc(
        "steps that replace target and step_time: [{time = 1.0, position = [1.01, 0.0, 0.0]}, ...]; at most 1000", ()
    )

    @property
    def steps(self) -> tuple[Waypoint, ...]:
        """Position steps at the input of the reference filter."""
        return self.waypoints or (Waypoint(time=self.step_time, position=self.target),)
