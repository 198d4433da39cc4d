"""Settings of the water: the ocean current, the disturbance of eq. (10), and its further effects."""

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator
from pydantic.dataclasses import dataclass

from ..errors import Fault
from ..physics.effects import RHO, effects_dtype
from ..physics.flow import FINEST
from ..physics.frames import quat_from_euler_deg, quat_product, rotation_matrix
from ..quantities import STRICT, Angle, Angles, Frequencies, Number, Position, Time, Wrench, doc, of_length, within
from ..stages.setup import ScenarioLike
from .sea import Sea
from .settings import World

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
class Current:
    """The ocean current: factor(depth) times the horizontal part, and the vertical part, of a sum in W. The sum is the
    constant vector of speed, direction and vertical, plus sines, plus the table, plus a Gauss-Markov process."""

    speed: Annotated[Number, within(0.0, 100.0, "m/s")] = doc("speed of the ocean current [m/s]", 0.5)
    direction_deg: Angle = doc("heading of the current in W, 0 towards the wall, 90 to the left [deg]", 120.0)
    vertical: Speed = doc("vertical part of the current, upwards [m/s]", 0.0)
    amplitude: Three = doc("amplitude of the sinusoidal part in W [m/s]", (0.0,) * 3)
    frequency_hz: tuple[_Hz, _Hz, _Hz] = doc(
        "frequency of the sinusoidal part, below half the step rate [Hz]", (0.0,) * 3
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
    def steady(self) -> bool:
        """Whether the current does not change with time."""
        return self.table is None and not any(self.amplitude) and not any(self.deviation)

    @property
    def flows(self) -> bool:
        """Whether there is a current at all."""
        return any(self.velocity_W) or not self.steady

    @property
    def constant(self) -> bool:
        """Whether the current changes neither with time nor with depth."""
        return self.steady and self.shear is None

    def steady_at(self, depth: float) -> np.ndarray:
        """(3,) constant part of the current in W at a depth [m/s]."""
        v_c_W = np.array(self.velocity_W)
        if self.shear is not None:
            v_c_W[:2] *= np.interp(depth, *np.array(self.shear).T)
        return v_c_W


@dataclass(frozen=True, config=STRICT)
class Disturbance:
    """The wrench tau_dist of eq. (10): constant, plus sines, plus the table, plus a Gauss-Markov process, in B."""

    bias: Wrench = doc("constant part of tau_dist in B [N, N m]", (0.0,) * 6)
    amplitude: Wrench = doc("amplitude of the sinusoidal part [N, N m]", (0.0,) * 6)
    frequency_hz: Frequencies = doc("frequency of the sinusoidal part, below half the step rate [Hz]", (0.0,) * 6)
    table: DisturbanceTable = doc(
        "part given over time in B, [[t, X, Y, Z, K, M, N], ...], linear between rows [s, N, N m]", None
    )
    deviation: tuple[_ForceSigma, _ForceSigma, _ForceSigma, _ForceSigma, _ForceSigma, _ForceSigma] = doc(
        "standard deviation of the Gauss-Markov part, from simulation.seed [N, N m]", (0.0,) * 6
    )
    correlation_time: _CorrelationTime = doc("correlation time of the Gauss-Markov part [s]", 10.0)

    @property
    def spacing(self) -> float:
        """Time between the nodes of the Gauss-Markov part [s]."""
        return self.correlation_time / FINEST

    @property
    def steady(self) -> bool:
        """Whether the disturbance does not change with time."""
        return self.table is None and not any(self.amplitude) and not any(self.deviation)

    @property
    def at_last(self) -> np.ndarray:
        """(6,) the bias with the last row of the table, which is held, in B [N, N m]."""
        return np.array(self.bias) + (0.0 if self.table is None else np.array(self.table[-1][1:]))


@dataclass(frozen=True, config=STRICT)
class Tether:
    """A cable whose drag acts on the vehicle. It has the diameter of Blue Robotics' Fathom tether and the drag
    coefficient of a smooth cylinder across the flow (Hoerner, 1965): assumptions for any other cable."""

    length: Annotated[Number, within(0.0, 1e5, "m")] = doc("length whose drag the vehicle bears; 0: no tether [m]", 0.0)
    diameter: Annotated[Number, within(1e-4, 1.0, "m")] = doc("diameter of the tether [m]", 7.6e-3)
    drag_coefficient: Annotated[Number, within(0.0, 10.0, "")] = doc("C_d of the tether across the flow [1]", 1.2)
    position: Position = doc("point of attachment in B [m]", (0.0, 0.0, 0.0))

    @property
    def record(self) -> tuple:
        """The numbers of :data:`uvms_mj.physics.effects.TETHER`."""
        return 0.5 * RHO * self.drag_coefficient * self.diameter * self.length, self.position


_Area = Annotated[Number, within(1e-6, 1e4, "m^2")]
_Coefficient = Annotated[Number, within(0.0, 100.0, "")]
_Mixing = Annotated[tuple[Annotated[Number, within(-1e4, 1e4, "deg/N, deg/(N m)")], ...], of_length(6)]
_OF_ACTUATOR = {"lag": 0.1, "limit_deg": 15.0, "rate_deg": None}


@dataclass(frozen=True, config=STRICT)
class Fin:
    """One table of ``[[fins]]``: a thin plate with lift and drag. At zero attitude its chord is along x, and its span
    along z: it stands."""

    area: _Area
    position: Position
    """Centre of pressure in B [m]."""
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

    @property
    def record(self) -> tuple:
        """The numbers of :data:`uvms_mj.physics.effects.FIN`."""
        turned = quat_product(
            quat_from_euler_deg(*self.attitude_deg), quat_from_euler_deg(0.0, 0.0, self.deflection_deg)
        )
        slope, stall = self.lift_slope, math.radians(self.stall_deg)
        drag = self.drag_coefficient, self.induced_drag, self.drag_across
        plate = 0.5 * RHO * self.area, self.position, rotation_matrix(turned), slope, stall, *drag
        if self.mixing_deg is None:
            return *plate, np.zeros(6), 0.0, 0.0, 0.0
        rate = math.inf if self.rate_deg is None else math.radians(self.rate_deg)
        return *plate, np.radians(self.mixing_deg), self.lag, math.radians(self.limit_deg), rate


_OneDrag = Annotated[Number, within(0.0, 1e6, "N s^2/m^2")]
_Drags = Annotated[tuple[_OneDrag, ...], of_length(3)]


@dataclass(frozen=True, config=STRICT)
class Drag:
    """One table of ``[[drag]]``: quadratic drag at a place of the base, which may differ by direction."""

    forward: _Drags
    """Coefficients of motion along x, y, z of B [N s^2/m^2]."""
    backward: _Drags | None = doc("of motion against x, y, z; default: forward [N s^2/m^2]", None)
    position: Position = doc("place in B at which it acts [m]", (0.0, 0.0, 0.0))
    by: Literal["axes", "speed"] = doc("'axes': f_i = -c_i |v_i| v_i; 'speed': f_i = -c_i |v| v_i", "axes")

    @property
    def record(self) -> tuple:
        """The numbers of :data:`uvms_mj.physics.effects.DRAG`."""
        backward = self.forward if self.backward is None else self.backward
        return self.position, self.forward, backward, self.by == "speed"


@dataclass(frozen=True, config=STRICT)
class Pad:
    """One table of ``[[pads]]``: a disc of the vehicle that faces a plane wall, with the water between them."""

    radius: Annotated[Number, within(1e-3, 10.0, "m")]
    position: Position
    """Centre in B [m]."""
    point: Position | None = doc("a point of the wall's face in W; null: the face of [wall] [m]", None)
    normal: Position = doc("vector out of that wall in W [1]", (-1.0, 0.0, 0.0))
    density: Annotated[Number, within(1.0, 1e5, "kg/m^3")] = doc("of the water [kg/m^3]", RHO)
    viscosity: Annotated[Number, within(0.0, 1e3, "Pa s")] = doc("of the water [Pa s]", 1.0e-3)
    least_gap: Annotated[Number, within(1e-6, 1.0, "m")] = doc("gap by roughness, below which nothing grows [m]", 1e-3)

    def __post_init__(self) -> None:
        if not any(self.normal):
            raise ValueError("normal must not be zero")

    def records(self, world: World) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.near_wall.PAD`, for a pad without :func:`pad_faults`."""
        length = math.hypot(*self.normal)
        point, normal = self.point, tuple(x / length for x in self.normal)
        if point is None:
            point, normal = (world.face, 0.0, 0.0), (-1.0, 0.0, 0.0)
        numbers = self.density, self.viscosity, self.least_gap
        return [(self.radius, self.position, point, normal, *numbers)]


def pad_faults(pads: Iterable[Pad], wall: bool) -> Iterator[Fault]:
    """Errors of pads that face no wall; ``wall``: whether there is one that they face without a point."""
    for k, pad in enumerate(pads):
        if pad.point is None and not wall:
            yield Fault(f"pads[{k}].point", "there is no [wall] that it faces; give a point of a wall's face")


EFFECT_TABLES: dict[str, Any] = {"sea": Sea, "pads": Pad, "tether": Tether, "fins": Fin, "drag": Drag}
"""The table of each effect, or of each one of a list."""


def effects_of(scenario: ScenarioLike, plant: Any) -> np.ndarray:
    """The records (1,) of the effects of a scenario with a plant, and of the products of its vehicle."""
    tables = {name: getattr(scenario, name) for name in EFFECT_TABLES} | {"products": plant.vehicle.products}

    def world() -> World:
        face = scenario.wall.position + plant.probe.radius if scenario.wall.present else None
        return World(scenario.simulation.seed, float(np.linalg.norm(plant.mjcf.gravity_W)), face)

    return effect_records(tables, world)


@functools.cache
def _default(kind: Any) -> Any:
    return kind()


def effect_records(tables: Mapping[str, Any], world: Callable[[], World]) -> np.ndarray:
    """The records (1,) of the effects that are not the defaults of their tables, by their names: tables, or lists of
    them. ``world`` is called for those that depend on it."""
    found = dict[str, list[tuple]]()
    for name, table in tables.items():
        each = table if isinstance(table, tuple) else () if table == _default(type(table)) else (table,)
        rows = [row for one in each for row in (one.records(world()) if hasattr(one, "records") else [one.record])]
        if rows:
            found[name] = rows
    records = np.zeros(1, effects_dtype({name: len(rows) for name, rows in found.items()}))
    for name, rows in found.items():
        records[name] = rows
    return records


def advancing(tables: Mapping[str, Any]) -> list[str]:
    """The keys of the effects whose states advance from step to step, of tables, or lists of them, by their names."""
    found = list[str]()
    for name, table in tables.items():
        if isinstance(table, tuple):
            found += [f"{name}[{i}]" for i, each in enumerate(table) if getattr(each, "advances", False)]
        elif getattr(table, "advances", False):
            found.append(name)
    return found


def advancing_of(scenario: ScenarioLike) -> list[str]:
    """As :func:`advancing`, of a scenario."""
    return advancing({name: getattr(scenario, name) for name in EFFECT_TABLES})
