"""Choice of the vehicle and its initial state."""

from pydantic.dataclasses import dataclass

from ..quantities import STRICT, Angles, Position, Twist, doc


@dataclass(frozen=True, config=STRICT)
class VehicleChoice:
    model: str = doc("MJCF file of the vehicle, or the name of a built-in model", "bluerov1")


@dataclass(frozen=True, config=STRICT)
class Initial:
    position: Position = doc("position of the body frame in W [m]", (0.0, 0.0, 0.0))
    attitude_deg: Angles = doc("roll, pitch, yaw [deg]", (0.0, 0.0, 0.0))
    velocity: Twist = doc("[v; omega] in B [m/s, rad/s]", (0.0,) * 6)
