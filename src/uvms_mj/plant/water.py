"""Settings of the water: the ocean current, the disturbance of eq. (10), fins, drag and pads.

:mod:`.sea` has the waves, :mod:`.obstacle` what the current meets, :mod:`.buoyancy` the volume of a vehicle at the
surface, and :mod:`.tether` the tether. The list of all effects is at the end.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import AfterValidator
from pydantic.dataclasses import dataclass

from ..errors import Fault
from ..physics.effects import RHO
from ..physics.frames import quat_from_euler_deg, quat_product, rotation_matrix
from ..physics.near_wall import HULL, STRIPS
from ..physics.near_wall import SHAPES as HULLS
from ..physics.random import key_of, owned
from ..physics.varying import FINEST, rate_deviation
from ..quantities import (
    STRICT,
    Angle,
    Angles,
    Frequencies,
    Lowercase,
    Number,
    Position,
    Time,
    Wrench,
    doc,
    of_length,
    repeated,
    within,
)
from .buoyancy import Buoyancy
from .coupling import Coupling
from .obstacle import Obstacle
from .sea import Sea
from .settings import EffectTable, Rows, Situation
from .spheroid import LONGEST, spheroid_series
from .tether import Tether

MOST_ROWS = 100_000
"""Largest number of rows of a table."""

Speed = Annotated[Number, within(-100.0, 100.0, "m/s")]
Depth = Annotated[Number, within(-1e6, 1e6, "m")]
_ShearFactor = Annotated[Number, within(-1e3, 1e3, "")]
_CorrelationTime = Annotated[Number, within(1e-3, 1e6, "s")]


def _increasing(rows: tuple[tuple[float, ...], ...] | None) -> tuple[tuple[float, ...], ...] | None:
    if rows is None:
        return None
    if not 0 < len(rows) <= MOST_ROWS:
        raise ValueError(f"has {len(rows)} rows; 1 to {MOST_ROWS} are possible")
    first = next((i for i, (a, b) in enumerate(itertools.pairwise(rows)) if b[0] <= a[0]), None)
    if first is not None:
        raise ValueError(
            f"row {first + 1} begins with {rows[first + 1][0]:g} after {rows[first][0]:g}: the first numbers of the "
            "rows must increase"
        )
    return rows


_ROWS = AfterValidator(_increasing)
_Hz = Annotated[Number, within(0.0, 1e7, "Hz")]
_Sigma = Annotated[Number, within(0.0, 100.0, "m/s")]
_Force = Annotated[Number, within(-1e6, 1e6, "N, N m")]
_ForceSigma = Annotated[Number, within(0.0, 1e6, "N, N m")]
Three = tuple[Speed, Speed, Speed]
CurrentTable = Annotated[tuple[tuple[Time, Speed, Speed, Speed], ...] | None, _ROWS]
ShearTable = Annotated[tuple[tuple[Depth, _ShearFactor], ...] | None, _ROWS]
DisturbanceTable = Annotated[tuple[tuple[Time, _Force, _Force, _Force, _Force, _Force, _Force], ...] | None, _ROWS]


@dataclass(frozen=True, config=STRICT)
class Current(EffectTable):
    """The ocean current: factor(depth) times the horizontal part, and the vertical part, of a sum in W. The sum is the
    constant vector of speed, direction and vertical, plus sines, plus the table, plus a Gauss-Markov process."""

    of_world: ClassVar[bool] = True
    speed: Annotated[Number, within(0.0, 100.0, "m/s")] = doc("speed of the ocean current [m/s]", 0.5)
    direction_deg: Angle = doc("heading of the current in W, 0 towards the wall, 90 to the left [deg]", 120.0)
    vertical: Speed = doc("vertical part of the current, upwards [m/s]", 0.0)
    amplitude: Three = doc("amplitude of the sinusoidal part in W [m/s]", (0.0,) * 3)
    frequency_hz: tuple[_Hz, _Hz, _Hz] = doc(
        "frequency of the sinusoidal part, below half the step rate [Hz]", (0.0,) * 3
    )
    phase_deg: Annotated[Angles, repeated(3)] = doc(
        "phase of the sinusoidal part at t = 0, 90 of a cosine: one for all, or three [deg]", (0.0,) * 3
    )
    table: CurrentTable = doc(
        "part given over time in W, [[t, v_x, v_y, v_z], ...], linear between rows [s, m/s]", None
    )
    deviation: tuple[_Sigma, _Sigma, _Sigma] = doc(
        "standard deviation of the Gauss-Markov part in W, from simulation.seed [m/s]", (0.0,) * 3
    )
    correlation_time: _CorrelationTime = doc("correlation time of the Gauss-Markov part [s]", 10.0)
    shortest_gust: _CorrelationTime | None = doc(
        "time between the random numbers of the Gauss-Markov part, from 1/64 of its correlation time, the default, to "
        "the whole [s]",
        None,
    )
    shear: ShearTable = doc(
        "factor of the horizontal part over the depth below z = 0, [[depth, factor], ...], linear between rows [m, 1]",
        None,
    )

    free = (
        *("speed", "direction_deg", "vertical", "frequency_hz", "phase_deg"),
        *("correlation_time", "shortest_gust", "shear"),
    )
    sizes: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "amplitude": ("frequency_hz",),
        "deviation": ("correlation_time", "shortest_gust"),
    }
    parameters: ClassVar[Mapping[str, tuple[float, float]]] = {"speed": (0.0, 100.0), "vertical": (-100.0, 100.0)}

    @classmethod
    def of(cls, velocity_W: Sequence[float]) -> Self:
        """The constant current with a velocity (3,) in W [m/s]. Raises ValueError unless it has three numbers."""
        x, y, z = (float(each) for each in velocity_W)
        return cls(speed=math.hypot(x, y), direction_deg=math.degrees(math.atan2(y, x)), vertical=z)

    @property
    def spacing(self) -> float:
        """Time between the nodes of the Gauss-Markov part [s]."""
        return self.correlation_time / FINEST if self.shortest_gust is None else self.shortest_gust

    @property
    def velocity_W(self) -> tuple[float, float, float]:
        """(3,) constant part of the current in W, where the factor of the depth is 1 [m/s]."""
        heading = math.radians(self.direction_deg)
        return self.speed * math.cos(heading), self.speed * math.sin(heading), self.vertical

    @property
    def flows(self) -> bool:
        """Whether there is a current at all."""
        return any(self.velocity_W) or _varies(self)

    @property
    def unsteady(self) -> str:
        """The reason why the current changes with time; empty if it does not."""
        return "the current is not constant" if _varies(self) else ""

    @property
    def constant(self) -> bool:
        """Whether the current changes neither with time nor with depth."""
        return not _varies(self) and self.shear is None

    @property
    def tables(self) -> Mapping[str, Rows]:
        return {"table": self.table, "shear": self.shear}

    @property
    def at_rest(self) -> Self:
        return _without_noise(self, table=None)

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.current.CURRENT`."""
        shear_rows = len(self.shear or ())
        return [(*_series("current", self, self.velocity_W, situation), shear_rows, 0, self.constant)]

    def faults(self, situation: Situation) -> Iterator[Fault]:
        h = situation.timestep
        yield from _series_faults(self, h)
        gust, whole = self.shortest_gust, self.correlation_time
        if gust is not None and not whole / FINEST * (1.0 - 1e-9) <= gust <= whole * (1.0 + 1e-9):
            wrong = f"{gust:g} s must be from {whole / FINEST:g} to {whole:g} s at current.correlation_time {whole:g} s"
            yield Fault("shortest_gust", wrong)
        for i, (amplitude, f) in enumerate(zip(self.amplitude, self.frequency_hz, strict=True)):
            if amplitude != 0.0 and f == 0.0:
                yield Fault(f"amplitude[{i}]", f"{amplitude:g} m/s has no effect at the frequency 0 Hz")
        times = [row[0] for row in self.table or ()]
        for i, (before, after) in enumerate(itertools.pairwise(times)):
            if after - before < h * (1.0 - 1e-9):
                wrong = (
                    f"{after:g} s is less than a time step, {h:g} s, after the row before it: the acceleration of the "
                    "water would act for a whole step or not at all"
                )
                yield Fault(f"table[{i + 1}]", wrong)


@dataclass(frozen=True, config=STRICT)
class Disturbance(EffectTable):
    """The wrench tau_dist of equation (10): constant, plus sines, plus the table, plus a Gauss-Markov process, in B."""

    of_world: ClassVar[bool] = False
    bias: Wrench = doc("constant part of tau_dist in B [N, N m]", (0.0,) * 6)
    amplitude: Wrench = doc("amplitude of the sinusoidal part [N, N m]", (0.0,) * 6)
    frequency_hz: Frequencies = doc("frequency of the sinusoidal part, below half the step rate [Hz]", (0.0,) * 6)
    phase_deg: Annotated[tuple[Angle, ...], of_length(6), repeated(6)] = doc(
        "phase of the sinusoidal part at t = 0, 90 of a cosine: one for all, or six [deg]", (0.0,) * 6
    )
    table: DisturbanceTable = doc(
        "part given over time in B, [[t, X, Y, Z, K, M, N], ...], linear between rows [s, N, N m]", None
    )
    deviation: tuple[_ForceSigma, _ForceSigma, _ForceSigma, _ForceSigma, _ForceSigma, _ForceSigma] = doc(
        "standard deviation of the Gauss-Markov part, from simulation.seed [N, N m]", (0.0,) * 6
    )
    correlation_time: _CorrelationTime = doc("correlation time of the Gauss-Markov part [s]", 10.0)

    free = ("bias", "frequency_hz", "phase_deg", "correlation_time")
    sizes: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "amplitude": ("frequency_hz",),
        "deviation": ("correlation_time",),
    }
    parameters: ClassVar[Mapping[str, tuple[float, float]]] = {"bias": (-1e6, 1e6)}

    @property
    def spacing(self) -> float:
        """Time between the nodes of the Gauss-Markov part [s]."""
        return self.correlation_time / FINEST

    @property
    def rate(self) -> np.ndarray:
        """Bound (6,) on its rate in B [N/s, N m/s]. Of the Gauss-Markov part it is the rate that one in 5e8 of its
        nodes exceeds."""
        rate = 2.0 * np.pi * np.abs(np.array(self.amplitude) * np.array(self.frequency_hz))
        if self.table is not None:
            table = np.array(self.table)
            rate += np.abs(np.diff(table[:, 1:], axis=0) / np.diff(table[:, :1], axis=0)).max(axis=0, initial=0.0)
        if any(self.deviation):
            rate += 6.0 * rate_deviation(np.array(self.deviation), self.correlation_time, self.spacing)
        return rate

    @property
    def tables(self) -> Mapping[str, Rows]:
        return {"table": self.table}

    @property
    def at_rest(self) -> Self:
        """The last row of a table is held."""
        return _without_noise(self, table=None if self.table is None else self.table[-1:])

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.effects.DISTURBANCE`."""
        return [_series(owned("disturbance", situation.vehicle), self, self.bias, situation)]

    def faults(self, situation: Situation) -> Iterator[Fault]:
        return _series_faults(self, situation.timestep)


def _varies(series: Current | Disturbance) -> bool:
    return series.table is not None or any(series.amplitude) or any(series.deviation)


def _without_noise(series: Any, table: Rows) -> Any:
    """A table without sines and Gauss-Markov part, and with another one of rows."""
    if not _varies(series):
        return series
    zeros = (0.0,) * len(series.amplitude)
    return dataclasses.replace(series, amplitude=zeros, deviation=zeros, table=table)


def _series(name: str, series: Current | Disturbance, mean: tuple[float, ...], situation: Situation) -> tuple:
    """The numbers of :func:`uvms_mj.physics.varying.varying`."""
    sum_of_sines = mean, series.amplitude, series.frequency_hz, np.radians(series.phase_deg)
    rows = len(series.table or ())
    if not any(series.deviation):
        return *sum_of_sines, rows, 0, series.deviation, False, 0.0, 0.0, 0.0, 0, -1, 0
    kept = np.exp(-series.spacing / series.correlation_time)
    noise = True, series.spacing, kept, np.sqrt(1.0 - kept**2), key_of(situation.seed, name)
    return *sum_of_sines, rows, 0, series.deviation, *noise, -1, 0


def _series_faults(series: Current | Disturbance, h: float) -> Iterator[Fault]:
    """Errors of what a time step h [s] does not resolve."""
    for i, f in enumerate(series.frequency_hz):
        if f * h >= 0.5 * (1.0 - 1e-9):
            wrong = (
                f"{f:.12g} Hz must be below half the step rate, {0.5 / h:.6g} Hz: sampled every {h:g} s it would act "
                f"as {abs(f - round(f * h) / h):.6g} Hz"
            )
            yield Fault(f"frequency_hz[{i}]", wrong)
    sines = list(zip(series.amplitude, series.frequency_hz, series.phase_deg, strict=True))
    if any(series.phase_deg) and not any(amplitude and phase for amplitude, _, phase in sines):
        yield Fault("phase_deg", "belongs to a sine, and its amplitude is 0")
    for i, (amplitude, f, phase) in enumerate(sines):
        if amplitude and phase and f == 0.0:
            yield Fault(f"phase_deg[{i}]", f"{phase:g} deg belongs to a sine, and frequency_hz[{i}] is 0")
    if any(series.deviation) and series.spacing < h * (1.0 - 1e-9):
        wrong = f"{series.correlation_time:g} s must be at least {FINEST * h:g} s, {FINEST:g} time steps"
        yield Fault("correlation_time", wrong)


_Area = Annotated[Number, within(1e-6, 1e4, "m^2")]
_Coefficient = Annotated[Number, within(0.0, 100.0, "")]
_Mixing = Annotated[tuple[Annotated[Number, within(-1e4, 1e4, "deg/N, deg/(N m)")], ...], of_length(6)]
_OF_ACTUATOR = {"lag": 0.1, "limit_deg": 15.0, "rate_deg": None}


@dataclass(frozen=True, config=STRICT)
class Fin(EffectTable):
    """One table of ``[[fins]]``: a thin plate with lift and drag. At zero attitude its chord is along x, and its span
    along z: it stands."""

    of_world: ClassVar[bool] = False
    area: _Area = doc("of the plate, chord times span [m^2]")
    position: Position = doc("centre of pressure in B [m]")
    attitude_deg: Angles = doc("roll, pitch, yaw of the fin in B; rolled by 90 it lies [deg]", (0.0,) * 3)
    deflection_deg: Angle = doc("turn about its span, by the right hand [deg]", 0.0)
    lift_slope: _Coefficient = doc("C_alpha, lift coefficient over the angle of attack below the stall [1/rad]", 3.0)
    stall_deg: Annotated[Number, within(1.0, 89.0, "deg")] = doc("angle of attack at the stall [deg]", 17.0)
    drag_coefficient: _Coefficient = doc("C_D0, of the drag along the chord [1]", 0.01)
    induced_drag: _Coefficient = doc("k, induced drag over the square of the lift coefficient [1]", 0.1)
    drag_across: _Coefficient = doc("C_90, drag coefficient across the flow, beyond the stall [1]", 1.2)
    mixing_deg: _Mixing | None = doc(
        "of an actuator: deflection beyond deflection_deg over each entry of tau_cmd; default: none, the fin is fixed "
        "[deg/N, deg/(N m)]",
        None,
    )
    lag: Annotated[Number, within(0.0, 100.0, "s")] = doc("T, time constant of the actuator [s]", _OF_ACTUATOR["lag"])
    limit_deg: Annotated[Number, within(0.1, 90.0, "deg")] = doc(
        "largest deflection by the actuator, either way [deg]", _OF_ACTUATOR["limit_deg"]
    )
    rate_deg: Annotated[Number, within(1e-3, 1e5, "deg/s")] | None = doc(
        "largest rate of the actuator; default: no limit [deg/s]", _OF_ACTUATOR["rate_deg"]
    )

    def __post_init__(self) -> None:
        given = [key for key, default in _OF_ACTUATOR.items() if getattr(self, key) != default]
        if self.mixing_deg is None and given:
            raise ValueError(f"{', '.join(given)} of an actuator, which a fin has with mixing_deg")

    @property
    def advances(self) -> bool:
        """Whether it has a state that advances."""
        return self.mixing_deg is not None

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.effects.FIN`."""
        turned = quat_product(
            quat_from_euler_deg(*self.attitude_deg), quat_from_euler_deg(0.0, 0.0, self.deflection_deg)
        )
        slope, stall = self.lift_slope, math.radians(self.stall_deg)
        drag = self.drag_coefficient, self.induced_drag, self.drag_across
        plate = 0.5 * RHO * self.area, self.position, rotation_matrix(turned), slope, stall, *drag
        if self.mixing_deg is None:
            return [(*plate, np.zeros(6), 0.0, 0.0, 0.0)]
        rate = math.inf if self.rate_deg is None else math.radians(self.rate_deg)
        return [(*plate, np.radians(self.mixing_deg), self.lag, math.radians(self.limit_deg), rate)]


_OneDrag = Annotated[Number, within(0.0, 1e6, "N s^2/m^2")]
_Drags = Annotated[tuple[_OneDrag, ...], of_length(3)]


@dataclass(frozen=True, config=STRICT)
class Drag(EffectTable):
    """One table of ``[[drag]]``: quadratic drag at a place of the base, which may differ by direction."""

    of_world: ClassVar[bool] = False
    forward: _Drags = doc("coefficients of motion along x, y, z of B [N s^2/m^2]")
    backward: _Drags | None = doc("of motion against x, y, z; default: forward [N s^2/m^2]", None)
    position: Position = doc("place in B at which it acts [m]", (0.0, 0.0, 0.0))
    by: Literal["axes", "speed"] = doc("'axes': f_i = -c_i |v_i| v_i; 'speed': f_i = -c_i |v| v_i", "axes")

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.effects.DRAG`."""
        backward = self.forward if self.backward is None else self.backward
        return [(self.position, self.forward, backward, self.by == "speed")]


@dataclass(frozen=True, config=STRICT)
class Pad(EffectTable):
    """One table of ``[[pads]]``: a disc of the vehicle that faces a plane wall, with the water between them."""

    of_world: ClassVar[bool] = False
    radius: Annotated[Number, within(1e-3, 10.0, "m")] = doc("of the disc [m]")
    position: Position = doc("its centre in B [m]")
    point: Position | None = doc("a point of the wall's face in W; null: the face of [wall] [m]", None)
    normal: Position = doc("vector out of that wall in W [1]", (-1.0, 0.0, 0.0))
    density: Annotated[Number, within(1.0, 1e5, "kg/m^3")] = doc("of the water [kg/m^3]", RHO)
    viscosity: Annotated[Number, within(0.0, 1e3, "Pa s")] = doc("of the water [Pa s]", 1.0e-3)
    least_gap: Annotated[Number, within(1e-6, 1.0, "m")] = doc("gap by roughness, below which nothing grows [m]", 1e-3)

    def __post_init__(self) -> None:
        if not any(self.normal):
            raise ValueError("normal must not be zero")

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.near_wall.PAD`."""
        numbers = self.density, self.least_gap, self.viscosity
        return [(self.radius, self.position, *_face(self, situation), *numbers)]

    def faults(self, situation: Situation) -> Iterator[Fault]:
        yield from _behind(self, situation, self.radius)


@dataclass(frozen=True, config=STRICT)
class NearWall(EffectTable):
    """One table of ``[[near_wall]]``: a sphere, a cylinder or a spheroid in the place of the vehicle's hull or of a
    link, before a plane wall."""

    of_world: ClassVar[bool] = False
    radius: Annotated[Number, within(1e-3, 100.0, "m")] = doc("of the sphere or the cylinder, or across a spheroid [m]")
    shape: Annotated[Literal[HULLS], Lowercase] = doc("of the hull or the link", "sphere")  # type: ignore[valid-type]
    length: Annotated[Number, within(1e-3, 200.0, "m")] | None = doc("of a cylinder or a spheroid [m]", None)
    axis: Position = doc("vector along a cylinder or a spheroid, in the frame of its link [1]", (1.0, 0.0, 0.0))
    link: str | None = doc("name of the link of the arm that carries it; null: the base", None)
    position: Position = doc("centre in the frame of the link, in B for the base [m]", (0.0, 0.0, 0.0))
    point: Position | None = doc("a point of the wall's face in W; null: the face of [wall] [m]", None)
    normal: Position = doc("vector out of that wall in W [1]", (-1.0, 0.0, 0.0))
    density: Annotated[Number, within(1.0, 1e5, "kg/m^3")] = doc("of the water [kg/m^3]", RHO)
    least_gap: Annotated[Number, within(1e-6, 1.0, "m")] = doc("gap by roughness, below which nothing grows [m]", 1e-3)

    def __post_init__(self) -> None:
        sphere = self.shape == "sphere"
        wrong = [f"{key} must not be zero" for key in ("normal", "axis") if not any(getattr(self, key))]
        if not sphere and self.length is None:
            wrong.append(f"a {self.shape} needs length")
        if sphere and (self.length is not None or self.axis != (1.0, 0.0, 0.0)):
            wrong.append("length and axis belong to a cylinder or a spheroid")
        if self.shape == "spheroid" and self.length is not None:
            slenderness = 0.5 * self.length / self.radius
            if not 1.0 - 1e-9 <= slenderness <= LONGEST + 1e-9:
                wrong.append(f"length {self.length:g} m must be 2 to {2.0 * LONGEST:g} times the radius")
        if wrong:
            raise ValueError("; ".join(wrong))

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.near_wall.HULL`."""
        link = 0 if self.link is None else 1 + situation.links.index(self.link)
        wall = *_face(self, situation), self.density, self.least_gap
        shape, strips = HULLS.index(self.shape), STRIPS if self.shape == "cylinder" else 1
        series = spheroid_series(0.5 * (self.length or 0.0) / self.radius) if self.shape == "spheroid" else 0.0
        about = shape, strips, link, _unit(self.axis), self.length or 0.0, np.broadcast_to(series, HULL["series"].shape)
        return [(self.radius, self.position, *wall, *about)]

    def faults(self, situation: Situation) -> Iterator[Fault]:
        if self.link is None:
            yield from _behind(self, situation, self.radius)
            return
        yield from _without_face(self, situation)
        if self.link not in situation.links:
            there = ", ".join(situation.links) or "there is none"
            yield Fault("link", f"{self.link!r} is no link of the vehicle: {there}")


def _face(table: Pad | NearWall, situation: Situation) -> tuple[Any, tuple[float, ...]]:
    """A point of the face that a table is in front of, in W [m], and the unit vector out of it."""
    if table.point is None:
        return (situation.face, 0.0, 0.0), (-1.0, 0.0, 0.0)
    return table.point, _unit(table.normal)


def _unit(vector: tuple[float, ...]) -> tuple[float, ...]:
    length = math.hypot(*vector)
    return tuple(x / length for x in vector)


def _without_face(table: Pad | NearWall, situation: Situation) -> Iterator[Fault]:
    """Faults of a table without a face."""
    if table.point is None and situation.face is None:
        yield Fault("point", "there is no [wall] that it faces; give a point of a wall's face")
    elif table.point is None and tuple(table.normal) != _face(table, situation)[1]:
        yield Fault("normal", "belongs to point; the face of [wall] has the normal -x")


def _behind(table: Pad | NearWall, situation: Situation, most: float) -> Iterator[Fault]:
    """Faults of a table without a face, and of one that begins more than a length [m] behind it."""
    yield from _without_face(table, situation)
    if table.point is None and situation.face is None:
        return
    point, normal = _face(table, situation)
    gap = float(np.dot(normal, np.add(situation.start_p, situation.start_R @ table.position) - np.array(point)))
    if gap < -most:
        yield Fault("position", f"is at the start {-gap:.3g} m behind the face of the wall that it faces")


EFFECT_TABLES: dict[str, type[EffectTable]] = {
    "current": Current,
    "disturbance": Disturbance,
    "obstacle": Obstacle,
    "sea": Sea,
    "pads": Pad,
    "near_wall": NearWall,
    "buoyancy": Buoyancy,
    "tether": Tether,
    "fins": Fin,
    "drag": Drag,
    "couplings": Coupling,
}
"""The table of each effect, or of each one of a list."""
