"""Tables of a scenario: frozen dataclasses with units and ranges. The defaults are the paper's values (sec. 5)."""

import dataclasses
import itertools
import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, ConfigDict
from pydantic.dataclasses import dataclass

from .quantities import (
    Angle,
    Angles,
    Coordinate,
    Damping,
    Duration,
    Factor,
    Factors,
    Frequencies,
    Inertia,
    Number,
    Position,
    PositiveFactor,
    Step,
    Stiffnesses,
    Time,
    Twist,
    Wrench,
    within,
)

STRICT = ConfigDict(extra="forbid", arbitrary_types_allowed=True)
Lowercase = BeforeValidator(lambda value: value.lower() if isinstance(value, str) else value)


def doc(meaning: str, default: Any) -> Any:
    """A field with its default and a one-line meaning, which ``uvms-mj keys`` prints."""
    return dataclasses.field(default=default, metadata={"meaning": meaning})


@dataclass(frozen=True, config=STRICT)
class VehicleChoice:
    model: str = doc("MJCF file of the vehicle, or the name of a built-in model", "bluerov1")


@dataclass(frozen=True, config=STRICT)
class Simulation:
    timestep: Step = doc("time step [s]", 1e-4)
    duration: Duration = doc("simulated time [s]", 20.0)
    integrator: Annotated[Literal["euler", "implicitfast"], Lowercase] = doc("MuJoCo's integrator", "euler")


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


WallStiffness = Annotated[Number, within(1e-3, 1e12, "N/m")]
WallDamping = Annotated[Number, within(0.0, 1e9, "N s/m")]


@dataclass(frozen=True, config=STRICT)
class Wall:
    position: Coordinate = doc("x of the body frame in W at which contact begins, x_c [m]", 1.0)
    stiffness: WallStiffness = doc("k_c [N/m]", 1e5)
    damping: WallDamping = doc("b_c [N s/m]", 0.0)
    friction: Annotated[Number, within(0.0, 100.0, "")] = doc("Coulomb coefficient mu [1]", 0.0)
    tangential_stiffness: WallStiffness | None = doc("k_t of sticking friction [N/m]; default: wall.stiffness", None)
    tangential_damping: WallDamping | None = doc(
        "b_t of sticking friction [N s/m]; default: critical for the lightest motion along the face", None
    )


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


@dataclass(frozen=True, config=STRICT)
class Impedance:
    K_d: Stiffnesses = doc("desired stiffness, diagonal [N/m, N m]", (150.0, 1500.0, 1500.0, 50.0, 50.0, 50.0))
    M_d: Inertia = doc("desired inertia, diagonal or 6x6; default: the vehicle's M", None)
    D_d: Damping = doc("desired damping, diagonal or 6x6; default: Ott's design", None)
    K_f: Factors = doc("force gain, diagonal, eq. (7) [1]", (1.0,) * 6)
    F_d: Wrench = doc("wrench that the wall should exert on the vehicle, in B, eq. (7) [N, N m]", (0.0,) * 6)
    damping_ratio: Annotated[Number, within(0.0, 1e3, "")] = doc(
        "damping ratio of Ott's design, used if D_d is not given [1]", 1.0
    )


@dataclass(frozen=True, config=STRICT)
class Estimates:
    inertia: PositiveFactor = doc("M_hat = f M; f is this key [1]", 1.0)
    coriolis: Factor = doc("C_hat(nu) nu = f C(nu) nu; f is this key [1]", 1.0)
    damping: Factor = doc("D_hat(nu) nu = f D(nu) nu; f is this key [1]", 1.0)
    restoring: Factor = doc("g_hat(eta) = f g(eta); f is this key [1]", 1.0)
