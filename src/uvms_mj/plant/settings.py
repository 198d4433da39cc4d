"""Settings of a plant: the vehicle, its simulation, its initial state, walls, contact bodies and the bumper.
:mod:`.water` has the settings of the water."""

import dataclasses
import itertools
import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ..errors import Fault
from ..physics.frames import quat_from_euler_deg, rotation_matrix
from ..physics.surfaces import SHAPES, SURFACE, signed_distance
from ..quantities import (
    STRICT,
    Angle,
    Angles,
    Coordinate,
    Duration,
    Lowercase,
    Number,
    Position,
    PositiveFactor,
    Step,
    Switch,
    Time,
    Twist,
    Vector3,
    default_of,
    doc,
    idle,
    refusing,
    within,
)
from ..stages.setup import ScenarioLike
from .impact import UP_TO, deepest, dissipation_of, stiffness_of_hertz


class Situation(NamedTuple):
    """Where a vehicle is: the seed of random draws, gravity [m/s^2], the x of the face of [wall] [m], the
    time step [s], the names of the links of its arm, its position (3,) at the start [m], NaN where it is not known,
    its attitude (3, 3) there, and the walls by their keys, a :class:`Surface` each.

    An effect that a run alone has asks for the mean velocity (3,) of the water in W [m/s], the inertia (6, 6) with
    added mass, and the duration of the run [s], too. One of a vehicle at the surface asks for the displaced mass [kg]
    at the centre of buoyancy (3,) in B [m], the z of the surface in W [m], and whether gravity is not along -z;
    ``surfaces`` says whether the vehicle is one. ``vehicle`` is its name, empty without one. A coupling asks for the
    vehicle's :class:`uvms_mj.plant.arm.Arm`, and whether it has a wrist sensor."""

    seed: int = 0
    gravity: float = 9.81
    face: float | None = None
    timestep: float = 1e-3
    links: tuple[str, ...] = ()
    start_p: tuple[float, float, float] = (math.nan,) * 3
    start_R: np.ndarray = np.eye(3)
    mean_flow_W: np.ndarray = np.zeros(3)
    inertia: np.ndarray = np.eye(6)
    duration: float = 0.0
    walls: Mapping[str, Any] = MappingProxyType({})
    displaced_mass: float = 0.0
    r_b: np.ndarray = np.zeros(3)
    surface: float = 0.0
    tilted: bool = False
    surfaces: bool = False
    vehicle: str = ""
    arm: Any = None
    wrist: bool = False


Rows = tuple[tuple[float, ...], ...] | None
"""A table of numbers, whose first ones increase."""


class EffectTable:
    """A table of an effect of the water.

    Beside this, a table of an effect that moves the water has ``velocity_W`` (3,), its constant part in W where no
    depth changes it [m/s], ``constant``, whether it moves the same at all times and places, and ``unsteady``, the
    reason why it does not move the same at all times, empty if it does. One of a push by the time has ``rate`` (6,), a
    bound on the push's rate in B [N/s, N m/s].
    """

    of_world: ClassVar[bool]
    """Whether all vehicles of a world share the table, as every class of a table says."""
    free: ClassVar[tuple[str, ...]] = ()
    """Keys on which a formula along x for the force at rest does not depend, or whose values are in it."""
    parameters: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Keys that set a number of the record each in proportion, with their ranges."""
    sizes: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Keys of a size, each with the keys that have no effect while it is zero."""
    balanced: ClassVar[bool] = True
    """Whether the force of its records is all that it changes in the balance at rest."""

    @property
    def advances(self) -> bool | None:
        """Whether it has a state that advances from step to step; None: if its records have one."""
        return None

    @property
    def tables(self) -> Mapping[str, Rows]:
        """Its tables by the fields of the record that have their places (:data:`uvms_mj.physics.effects.TABLES`)."""
        return {}

    @property
    def at_rest(self) -> Self:
        """The table without what varies with time, as a vehicle at rest at the end of a run has it."""
        return self

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of its records (:data:`uvms_mj.physics.effects.EFFECTS`), of a table without faults; none if it
        has no effect."""
        raise NotImplementedError

    def kinds(self, name: str, situation: Situation) -> Mapping[str, list[tuple]]:
        """The numbers of all its records by the names of their effects; ``name`` is its own."""
        return {name: self.records(situation)}

    def faults(self, situation: Situation) -> Iterator[Fault]:
        """Its errors in a situation, each with its key in this table."""
        return iter(())

    def idle(self, key: str) -> Iterator[str]:
        """A sentence for each size that is zero and whose keys are given; ``key`` is the table's."""
        for size, others in self.sizes.items():
            if getattr(self, size) == default_of(self, size):
                yield from idle(self, key, others, f"{key}.{size} is 0")


WallStiffness = Annotated[Number, within(1e-3, 1e12, "N/m")]
WallDamping = Annotated[Number, within(0.0, 1e9, "N s/m")]
Friction = Annotated[Number, within(0.0, 100.0, "")]
Length = Annotated[Number, within(1e-6, 1e6, "m")]
Displacement = tuple[Time, Coordinate, Coordinate, Coordinate]
Response = tuple[Annotated[Number, within(0.0, 1e3, "rad/s")], Annotated[Number, within(0.0, 1e3, "m/m, deg/m")], Angle]
_MOST_ROWS = 100_000
MOST_TURN_DEG = 90.0
"""Largest amplitude of a wall's turn [deg]."""
_Turn = Annotated[Number, within(-MOST_TURN_DEG, MOST_TURN_DEG, "deg")]
_OF_SWELL = {"swell_period": 6.0, "swell_spectrum": "jonswap", "swell_seed": None}


def wrong_size(table: Any) -> list[str]:
    """The errors of the keys of the size of a table with a shape."""
    needed = SHAPES[table.shape].keys
    wrong = [f"a {table.shape} needs {key}" for key in needed if getattr(table, key) is None]
    others = {key for shape in SHAPES.values() for key in shape.keys} - {*needed}
    return wrong + [f"a {table.shape} has no {key}" for key in sorted(others) if getattr(table, key) is not None]


@dataclass(frozen=True, config=STRICT)
class Surface:
    """One table of ``[[walls]]``."""

    of_world: ClassVar[bool] = True
    shape: Annotated[Literal[tuple(SHAPES)], Lowercase]  # type: ignore[valid-type]  # a table has the names
    position: Position
    """Of a plane, a point of its face; otherwise the centre [m]."""
    attitude_deg: Angles = doc("roll, pitch, yaw; at zero a plane faces -x, others stand [deg]", (0.0,) * 3)
    radius: Length | None = doc("of a sphere, a cylinder or a capsule [m]", None)
    length: Length | None = doc("of a capsule, between the centres of its ends [m]", None)
    edges: tuple[Length, Length, Length] | None = doc("lengths of a box [m]", None)
    stiffness: WallStiffness = doc("k_c [N/m]", 1e5)
    damping: WallDamping = doc("b_c [N s/m]", 0.0)
    layer_depth: Length | None = doc("depth beyond which the wall has layer_stiffness; default: one layer [m]", None)
    layer_stiffness: WallStiffness | None = doc("stiffness beyond layer_depth [N/m]", None)
    contact: Annotated[Literal["linear", "hunt_crossley", "hertz"], Lowercase] = doc(
        "normal force over the depth: a spring and a damper, or with restitution", "linear"
    )
    restitution: Annotated[Number, within(0.01, 1.0, "")] | None = doc(
        "of a hunt_crossley or hertz contact at restitution_speed; default: 1 [1]", None
    )
    restitution_speed: Annotated[Number, within(1e-4, 1e3, "m/s")] = doc("of the impact with it [m/s]", 0.1)
    modulus: Annotated[Number, within(1.0, 1e13, "Pa")] | None = doc(
        "E* of wall and body together, of a hertz contact in the place of stiffness [Pa]", None
    )
    friction: Friction = doc("Coulomb coefficient mu [1]", 0.0)
    breakaway_friction: Friction | None = doc("coefficient up to which a contact sticks; default: friction [1]", None)
    tangential_stiffness: WallStiffness | None = doc("k_t of sticking friction [N/m]; default: stiffness", None)
    tangential_damping: WallDamping | None = doc("b_t of sticking friction [N s/m]; default: critical", None)
    motion: tuple[Displacement, ...] = doc("[[time, x, y, z], ...]: displacement in W, linear between [s, m]", ())
    amplitude: Vector3 = doc("of a sine of the displacement, in W [m]", (0.0,) * 3)
    frequency_hz: Annotated[Number, within(0.0, 1e3, "Hz")] = doc("of the sine [Hz]", 0.0)
    phase_deg: Angle = doc("of the sine at t = 0 [deg]", 0.0)
    turn_amplitude_deg: tuple[_Turn, _Turn, _Turn] = doc(
        "of a sine of the rotation vector about pivot, in W; at most 90 in all [deg]", (0.0,) * 3
    )
    turn_frequency_hz: Annotated[Number, within(0.0, 1e3, "Hz")] = doc("of this sine [Hz]", 0.0)
    turn_phase_deg: Angle = doc("of this sine at t = 0 [deg]", 0.0)
    heave: tuple[Response, ...] = doc(
        "[[omega, amplitude, phase_deg], ...]: response to the waves of [sea], linear between [rad/s, m/m, deg]", ()
    )
    roll: tuple[Response, ...] = doc("as heave, about the hull's axis forward [rad/s, deg/m, deg]", ())
    pitch: tuple[Response, ...] = doc("as heave, about the hull's axis to the left [rad/s, deg/m, deg]", ())
    turns: Switch = doc("true: roll and pitch turn the wall as well, and not only move its position", False)
    pivot: Position | None = doc("place in W that the wall, or its hull, turns about; default: position [m]", None)
    heading_deg: Angle = doc("heading of the hull's axis forward in W [deg]", 0.0)
    swell_height: Annotated[Number, within(0.0, 40.0, "m")] = doc(
        "height of waves that move this wall alone, in the place of [sea]; 0: none [m]", 0.0
    )
    swell_period: Annotated[Number, within(0.1, 100.0, "s")] = doc("their period, or the peak's [s]", 6.0)
    swell_spectrum: Annotated[Literal["regular", "jonswap", "pierson_moskowitz"], Lowercase] = doc(
        "one wave, or many", "jonswap"
    )
    swell_seed: Annotated[int, within(0, 2**62, "")] | None = doc(
        "seed of their frequencies and phases; null: simulation.seed [1]", None
    )

    def __post_init__(self) -> None:
        wrong = wrong_size(self)
        if (self.layer_depth is None) != (self.layer_stiffness is None):
            wrong.append("layer_depth and layer_stiffness belong together")
        wrong += self._wrong_contact()
        times = [row[0] for row in self.motion]
        wrong += [
            f"motion[{i + 1}]: time {late:g} s must be later than {early:g} s"
            for i, (early, late) in enumerate(itertools.pairwise(times))
            if late <= early
        ]
        if len(times) > _MOST_ROWS:
            wrong.append(f"motion has {len(times)} rows; at most {_MOST_ROWS} are allowed")
        wrong += self._wrong_sines()
        for mode in ("heave", "roll", "pitch"):
            omegas = [row[0] for row in getattr(self, mode)]
            if any(late <= early for early, late in itertools.pairwise(omegas)):
                wrong.append(f"{mode}: the frequencies of the rows must increase")
        if (self.roll or self.pitch) and self.pivot is None:
            wrong.append("roll and pitch need pivot, which the hull turns about")
        if self.pivot is not None and not (self.follows_sea or any(self.turn_amplitude_deg)):
            wrong.append("pivot needs heave, roll, pitch or turn_amplitude_deg")
        if self.turns and not (self.roll or self.pitch):
            wrong.append("turns needs roll or pitch")
        idle = [key for key in _OF_SWELL if not self.swell_height and getattr(self, key) != _OF_SWELL[key]]
        if idle:
            wrong.append(f"{', '.join(idle)}: of waves of the wall's own, which it has with swell_height")
        if self.heading_deg and not (self.roll or self.pitch):
            wrong.append("heading_deg needs roll or pitch")
        if wrong:
            raise ValueError("; ".join(wrong))

    def _wrong_sines(self) -> Iterator[str]:
        """The errors of the sines of its displacement and its turn."""
        for name, amplitude in (("", self.amplitude), ("turn_", self.turn_amplitude_deg)):
            word = f"{name}amplitude{'_deg' if name else ''}"
            frequency, phase = getattr(self, f"{name}frequency_hz"), getattr(self, f"{name}phase_deg")
            if any(amplitude) and frequency == 0.0:
                yield f"{word} needs {name}frequency_hz"
            if phase and not any(amplitude):
                yield f"{name}phase_deg needs {word}"
        if any(self.turn_amplitude_deg) and not self.turn_frequency_hz:
            return
        if self.turn_frequency_hz and not any(self.turn_amplitude_deg):
            yield "turn_frequency_hz needs turn_amplitude_deg"
        if (size := math.hypot(*self.turn_amplitude_deg)) > MOST_TURN_DEG * (1.0 + 1e-9):
            yield f"turn_amplitude_deg is {size:.4g} deg in all; at most {MOST_TURN_DEG:g} deg are allowed"

    def _wrong_contact(self) -> Iterator[str]:
        """The errors of its contact and its friction."""
        kind, hertz = self.contact, self.contact == "hertz"
        if kind == "linear" and self.restitution is not None:
            yield (
                "restitution belongs to contact = 'hunt_crossley' or 'hertz': with a spring and a damper it depends on "
                "the mass that hits"
            )
        if kind != "linear" and self.damping:
            yield f"a {kind} contact has restitution in the place of damping"
        if kind != "linear" and self.layer_depth is not None:
            yield f"a {kind} contact has one layer"
        if hertz and self.shape not in ("plane", "sphere"):
            yield f"Hertz's contact with a {self.shape} is not computed; take a plane or a sphere"
        if hertz != (self.modulus is not None):
            yield "a hertz contact needs modulus" if hertz else f"a {kind} contact has no modulus"
        if hertz and self.friction > 0.0 and self.tangential_stiffness is None:
            yield "friction of a hertz contact needs tangential_stiffness"
        if self.breakaway_friction is not None and not self.breakaway_friction >= self.friction > 0.0:
            yield "breakaway_friction must be at least friction, which must be above zero"

    @property
    def linear(self) -> bool:
        """Whether its normal force is a spring and a damper."""
        return self.contact == "linear"

    @property
    def power(self) -> float:
        """n of a contact that is not linear, for :mod:`.impact`, or 0."""
        return {"linear": 0.0, "hunt_crossley": 1.0, "hertz": 1.5}[self.contact]

    @property
    def dissipation(self) -> float:
        """a of a contact that is not linear [s/m]."""
        return 0.0 if self.restitution is None else dissipation_of(self.restitution, self.restitution_speed)

    def stiffness_on(self, radius: float) -> float:
        """k of the contact of a sphere of a radius [m], N/m, or of Hertz's N/m^1.5."""
        return self.stiffness if self.modulus is None else stiffness_of_hertz(self.modulus, radius, self.radius)

    def stiffest(self, radius: float, mass: float) -> tuple[float, float]:
        """Greatest stiffness [N/m] and damping [N s/m] of its contact with a sphere of a radius [m], in an impact of a
        mass [kg] at :data:`.impact.UP_TO`."""
        k, n, a = self.stiffness_on(radius), self.power, self.dissipation
        depth = deepest(k, n, a, mass)
        return n * k * depth ** (n - 1.0) * (1.0 + a * UP_TO), a * k * depth**n

    @property
    def moves(self) -> bool:
        return bool(self.motion) or any(self.amplitude) or self.turning or self.follows_sea

    @property
    def turning(self) -> bool:
        """Whether it turns."""
        return any(self.turn_amplitude_deg) or self.turns

    @property
    def follows_sea(self) -> bool:
        """Whether it answers waves, of the sea or of its own."""
        return bool(self.heave or self.roll or self.pitch or self.swell_height)

    @property
    def size(self) -> tuple[float, float, float]:
        """The extent of its shape, for example the half edges [m]."""
        shape = SHAPES[self.shape]
        return shape.extent(*(getattr(self, key) for key in shape.keys))

    @property
    def R_WS(self) -> np.ndarray:
        """(3, 3) attitude."""
        return rotation_matrix(quat_from_euler_deg(*self.attitude_deg))

    def nearest(self, point: Sequence[float] | np.ndarray) -> tuple[float, np.ndarray]:
        """The distance of a point (3,) from the wall at its place without motion, negative inside, and the point (3,)
        of its face that is nearest to it [m, W]."""
        surface, normal, at = np.zeros(1, SURFACE), np.zeros(3), np.array(point, float)
        self.place(surface[0])
        distance = signed_distance(surface.view(np.recarray)[0], at, normal)
        return distance, at - distance * normal

    def place(self, record: np.void) -> None:
        """Set shape and place without motion of a SURFACE record."""
        record["kind"], record["extent"], record["R_WS"] = list(SHAPES).index(self.shape), self.size, self.R_WS
        record["p_WS"] = record["start_W"] = self.position
        record["R_start"], record["pivot"] = self.R_WS, self.position if self.pivot is None else self.pivot
        record["quat_start"] = record["quat_WS"] = quat_from_euler_deg(*self.attitude_deg)


def in_series(k_c: float, b_c: float, k_b: float, b_b: float) -> tuple[float, float]:
    """Stiffness [N/m] and damping [N s/m] of a wall and a bumper in series for slow motion; k_b is 0 without a bumper.

    To first order in the frequency, of (k_c + i w b_c)(k_b + i w b_b)/(k_c + k_b + i w (b_c + b_b)).
    """
    if k_b == 0.0:
        return k_c, b_c
    total = k_c + k_b
    return k_c * k_b / total, (b_c * k_b * k_b + b_b * k_c * k_c) / (total * total)


def in_series_fast(k_c: float, b_c: float, k_b: float, b_b: float) -> tuple[float, float]:
    """As :func:`in_series`, for fast motion: the dampers hold wall and bumper against each other."""
    if k_b == 0.0 or b_c + b_b == 0.0:
        return in_series(k_c, b_c, k_b, b_b)
    total = b_c + b_b
    return (k_b * b_c * b_c + k_c * b_b * b_b) / (total * total), b_c * b_b / total


@dataclass(frozen=True, config=STRICT)
class ContactBody:
    """One table of ``[[vehicle.contact_bodies]]``: a sphere, or a capsule if ``end`` is given."""

    position: Position
    """Centre of the sphere, or first end of the capsule's axis, in the frame of the link that carries it [m]."""
    radius: Length
    end: Position | None = doc("second end of the capsule's axis [m]; default: a sphere", None)
    stiffness: WallStiffness | None = doc("of the body's bumper, in series with the wall's; default: rigid [N/m]", None)
    damping: WallDamping = doc("of the body's bumper [N s/m]", 0.0)
    body: str | None = doc("link that carries it; default: the vehicle's base", None)

    def __post_init__(self) -> None:
        if self.end is not None and math.dist(self.position, self.end) < 1e-6:
            raise ValueError("end must differ from position")
        if self.stiffness is None and self.damping:
            raise ValueError("damping needs stiffness: a rigid body does not yield")


@dataclass(frozen=True, config=STRICT)
class Bumper:
    """A bumper in front of the probe, in series with every wall."""

    of_world: ClassVar[bool] = False
    stiffness: WallStiffness | None = doc("k_b, in series with the wall's; default: no bumper [N/m]", None)
    damping: WallDamping = doc("b_b [N s/m]", 0.0)

    def __post_init__(self) -> None:
        if self.stiffness is None and self.damping:
            raise ValueError("damping needs stiffness: without it there is no bumper")

    def in_front_of(self, stiffness: float, damping: float) -> tuple[float, float]:
        """:func:`in_series` of a wall and this bumper."""
        return in_series(stiffness, damping, self.stiffness or 0.0, self.damping)


_TrueFactor = Annotated[Number, within(0.0, 1e3, "")]


_Mass = Annotated[Number, within(0.0, 1e6, "kg")]
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,39}")
"""The name of a vehicle, which is also a part of topics and of the name of its log."""
_Name = Annotated[
    str,
    refusing(
        lambda name: bool(name) and not NAME.fullmatch(name),
        "must be up to 40 letters, digits and underscores, and begin with a letter",
    ),
]


@dataclass(frozen=True, config=STRICT)
class Payload:
    """One table of ``[[vehicle.payloads]]``."""

    link: str
    """Name of the link, or of the vehicle's body."""
    mass: _Mass
    position: Position = doc("in the frame of the link [m]", (0.0, 0.0, 0.0))
    displaced_mass: _Mass = doc("mass of the water that it displaces [kg]", 0.0)


@dataclass(frozen=True, config=STRICT)
class VehicleChoice:
    """The vehicle's file, and factors that make the true vehicle differ from it. The laws do not know the factors: the
    estimates are the file's times ``[estimates]``, and so are the default M_d and the allocation."""

    of_world: ClassVar[bool] = False
    model: str = doc("MJCF file of the vehicle, or the name of a built-in model", "bluerov1")
    mass: PositiveFactor = doc("true mass and rigid-body inertia over the file's, unknown to the laws [1]", 1.0)
    added_mass: _TrueFactor = doc("true added mass over the file's, unknown to the laws [1]", 1.0)
    linear_damping: _TrueFactor = doc("true linear damping over the file's, unknown to the laws [1]", 1.0)
    quadratic_damping: _TrueFactor = doc("true quadratic damping over the file's, unknown to the laws [1]", 1.0)
    displaced_mass: _TrueFactor = doc("true displaced mass over the file's, unknown to the laws [1]", 1.0)
    coulomb_friction: _TrueFactor = doc(
        "true Coulomb friction of the joints' gears over the file's, unknown to the laws [1]", 1.0
    )
    thruster_offset: tuple[Position, ...] | None = doc(
        "offset of each true thruster in B, unknown to the allocation: [[0.02, 0, 0], ...]; default: none [m]", None
    )
    payloads: tuple[Payload, ...] = doc(
        "point masses on a link, or on the base by the name of the vehicle's body, unknown to the laws: [{link = ..., "
        "mass = ..., position = [0, 0, 0], displaced_mass = 0}, ...] [kg, m]",
        (),
    )
    contact_bodies: tuple[ContactBody, ...] = doc("spheres and capsules that touch walls, in place of the probe", ())
    name: _Name = doc("name of the vehicle among others in one world; empty: none", "")


_Seed = Annotated[int, Field(strict=True, ge=0, lt=2**63)]


@dataclass(frozen=True, config=STRICT)
class Stepping:
    of_world: ClassVar[bool] = True
    timestep: Step = doc("time step [s]", 1e-4)
    duration: Duration = doc("simulated time [s]", 20.0)
    integrator: Annotated[Literal["euler", "implicitfast"], Lowercase] = doc("MuJoCo's integrator", "euler")
    seed: _Seed = doc("seed of the random numbers of the stages, of gusts and of waves", 0)
    law_seed: _Seed | None = doc(
        "seed of the random numbers of controller, task, observer and actuation; null: seed. With one, no number that "
        "a law is given follows from seed",
        None,
    )

    def seed_of(self, table: str) -> int:
        """The seed of the random numbers of a stage, by its table."""
        if self.law_seed is not None and table in ("controller", "task", "observer", "actuation"):
            return self.law_seed
        return self.seed


OF_VEHICLE = {"vehicle.contact_bodies": ContactBody, "vehicle.payloads": Payload}
"""The tables within the table, by their key."""


@dataclass(frozen=True, config=STRICT)
class Initial:
    of_world: ClassVar[bool] = False
    position: Position = doc("position of the body frame in W [m]", (0.0, 0.0, 0.0))
    attitude_deg: Angles = doc("roll, pitch, yaw [deg]", (0.0, 0.0, 0.0))
    velocity: Twist = doc("[v; omega] in B [m/s, rad/s]", (0.0,) * 6)
    joints: tuple[Number, ...] | None = doc(
        "position of each joint; default: zero, or the end of its range next to zero [rad or m]", None
    )


@dataclass(frozen=True, config=STRICT)
class Wall:
    of_world: ClassVar[bool] = True
    position: Coordinate = doc("x of the body frame in W at which contact begins, x_c [m]", 1.0)
    stiffness: WallStiffness = doc("k_c [N/m]", 1e5)
    damping: WallDamping = doc("b_c [N s/m]", 0.0)
    friction: Friction = doc("Coulomb coefficient mu [1]", 0.0)
    tangential_stiffness: WallStiffness | None = doc("k_t of sticking friction [N/m]; default: wall.stiffness", None)
    tangential_damping: WallDamping | None = doc(
        "b_t of sticking friction [N s/m]; default: critical for the lightest motion along the face", None
    )
    present: Switch = doc("false: this wall is not there", True)


def _idle(scenario: ScenarioLike) -> dict[str, str]:
    """The tables of a contact that is not there, and why: ``wall`` and ``bumper``."""
    if scenario.wall.present:
        return {}
    return {"wall": "wall.present is false"} | ({} if scenario.walls else {"bumper": "there is no wall"})


def without_effect(scenario: ScenarioLike) -> Iterator[str]:
    """A sentence for each table of a contact that is not there: the keys that differ from their defaults."""
    for name, reason in _idle(scenario).items():
        table = getattr(scenario, name)
        yield from idle(table, name, [f.name for f in dataclasses.fields(table) if f.name != "present"], reason)


def overridden_in_vain(scenario: ScenarioLike, overrides: Collection[str]) -> list[Fault]:
    """Errors for overrides of a wall that is not there, and of a bumper without any wall. They may stand beside the
    override that takes the wall away."""
    instead = {
        "wall": "set it to true, or set a key of the further walls, walls[0].stiffness",
        "bumper": "set wall.present to true, or give walls",
    }
    idle = {} if "wall.present" in overrides else _idle(scenario)
    if "walls" in overrides:
        idle.pop("bumper", None)
    return [
        Fault(key, f"has no effect: {idle[table]}; {instead[table]}")
        for key in overrides
        if (table := key.partition(".")[0]) in idle
    ]


def lightest_along_face(M: np.ndarray, R_WB: np.ndarray, reach: float) -> float:
    """Least effective mass at the contact point along the wall's face, with all other directions free [kg].

    M is the inertia (6, 6), added mass included; R_WB (3, 3) the attitude; ``reach`` the distance of the contact point
    from B's origin along the wall's normal, x of W [m].
    """
    J = np.zeros((2, 6))  # of the contact point along y and z of W
    J[:, :3], J[0, 3:], J[1, 3:] = R_WB[1:], reach * R_WB[2], -reach * R_WB[1]
    (a, b), (_, c) = (J @ np.linalg.solve(M, J.T)).tolist()
    return 1.0 / (0.5 * (a + c) + math.hypot(0.5 * (a - c), b))  # the larger eigenvalue


def lightest_at(M: np.ndarray, centres_B: np.ndarray, radius: float) -> float:
    """Least effective mass in any direction at spheres of a radius [m] about centres (n, 3) in B [kg].

    M is the inertia (6, 6), added mass included. The points are the ends of the spheres along the axes of B.
    """
    x, y, z = (centres_B[:, None] + radius * np.vstack([np.eye(3), -np.eye(3)])).reshape(-1, 3).T
    J = np.zeros((len(x), 3, 6))
    J[:, range(3), range(3)] = 1.0
    J[:, 0, 4], J[:, 0, 5], J[:, 1, 3], J[:, 1, 5], J[:, 2, 3], J[:, 2, 4] = z, -y, -z, x, y, -x  # -S(arm)
    return 1.0 / float(np.linalg.eigvalsh(J @ np.linalg.inv(M) @ J.transpose(0, 2, 1))[:, -1].max())


def contact_settings(wall: Surface, mass_along_face: Callable[[], float]) -> dict[str, float]:
    """Settings of the wall for a :data:`uvms_mj.physics.contacts.CONTACT` record, with the defaults of sticking
    friction.

    The default damping is critical for the lightest motion along the face, so that a contact that sticks comes to rest.
    ``mass_along_face`` gives that mass [kg]; it is not asked for if it has no effect.
    """
    k_t = wall.stiffness if wall.tangential_stiffness is None else wall.tangential_stiffness
    b_t = wall.tangential_damping
    if b_t is None:
        b_t = 2.0 * math.sqrt(k_t * mass_along_face()) if wall.friction > 0.0 else 0.0
    given = {name: getattr(wall, name) for name in ("stiffness", "damping", "friction")}
    breakaway = 0.0 if wall.breakaway_friction is None else wall.breakaway_friction - wall.friction
    return given | {"tangential_stiffness": k_t, "tangential_damping": b_t, "breakaway": breakaway}
