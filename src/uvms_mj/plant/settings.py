"""Settings of a plant: the vehicle, its initial state, the ocean current and the disturbance."""

import math
from typing import Annotated

from pydantic.dataclasses import dataclass

from ..quantities import (
    STRICT,
    Angle,
    Angles,
    Frequencies,
    Number,
    Position,
    PositiveFactor,
    Twist,
    Wrench,
    doc,
    within,
)

_TrueFactor = Annotated[Number, within(0.0, 1e3, "")]


@dataclass(frozen=True, config=STRICT)
class VehicleChoice:
    """The vehicle's file, and factors that make the true vehicle differ from it. The laws do not know the factors: the
    estimates are those of the file times ``[estimates]``, and so are the default M_d and the allocation."""

    model: str = doc("MJCF file of the vehicle, or the name of a built-in model", "bluerov1")
    mass: PositiveFactor = doc("true mass and rigid-body inertia over the file's, unknown to the laws [1]", 1.0)
    added_mass: _TrueFactor = doc("true added mass over the file's, unknown to the laws [1]", 1.0)
    linear_damping: _TrueFactor = doc("true linear damping over the file's, unknown to the laws [1]", 1.0)
    quadratic_damping: _TrueFactor = doc("true quadratic damping over the file's, unknown to the laws [1]", 1.0)
    displaced_mass: _TrueFactor = doc("true displaced mass over the file's, unknown to the laws [1]", 1.0)
    thruster_offset: tuple[Position, ...] | None = doc(
        "offset of each true thruster in B, unknown to the allocation: [[0.02, 0, 0], ...]; default: none [m]", None
    )


@dataclass(frozen=True, config=STRICT)
class Initial:
    position: Position = doc("position of the body frame in W [m]", (0.0, 0.0, 0.0))
    attitude_deg: Angles = doc("roll, pitch, yaw [deg]", (0.0, 0.0, 0.0))
    velocity: Twist = doc("[v; omega] in B [m/s, rad/s]", (0.0,) * 6)


@dataclass(frozen=True, config=STRICT)
class Current:
    speed: Annotated[Number, within(0.0, 100.0, "m/s")] = doc("speed of the ocean current [m/s]", 0.5)
    direction_deg: Angle = doc("heading of the current in W, 0 towards the wall, 90 to the left [deg]", 120.0)

    @property
    def velocity_W(self) -> tuple[float, float, float]:
        """(3,) velocity of the current in W [m/s]."""
        heading = math.radians(self.direction_deg)
        return self.speed * math.cos(heading), self.speed * math.sin(heading), 0.0


@dataclass(frozen=True, config=STRICT)
class Disturbance:
    bias: Wrench = doc("constant part of tau_dist in B [N, N m]", (0.0,) * 6)
    amplitude: Wrench = doc("amplitude of the sinusoidal part [N, N m]", (0.0,) * 6)
    frequency_hz: Frequencies = doc("frequency of the sinusoidal part, below half the step rate [Hz]", (0.0,) * 6)
