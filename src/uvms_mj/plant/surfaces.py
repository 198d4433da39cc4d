"""Settings of further walls, of the vehicle's contact bodies and of its bumper."""

import itertools
import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic.dataclasses import dataclass

from ..errors import Fault
from ..physics.frames import quat_from_euler_deg, rotation_matrix
from ..quantities import STRICT, Angle, Angles, Coordinate, Lowercase, Number, Position, Time, Vector3, doc, within

WallStiffness = Annotated[Number, within(1e-3, 1e12, "N/m")]
WallDamping = Annotated[Number, within(0.0, 1e9, "N s/m")]
Friction = Annotated[Number, within(0.0, 100.0, "")]
Length = Annotated[Number, within(1e-6, 1e6, "m")]
Displacement = tuple[Time, Coordinate, Coordinate, Coordinate]
_SIZES = {"plane": (), "sphere": ("radius",), "cylinder": ("radius",), "box": ("edges",)}
"""The keys of a shape's size."""
_MOST_ROWS = 100_000


@dataclass(frozen=True, config=STRICT)
class Surface:
    """One table of ``[[walls]]``."""

    shape: Annotated[Literal["plane", "sphere", "cylinder", "box"], Lowercase]
    position: Position
    """Of a plane, a point of its face; otherwise the centre [m]."""
    attitude_deg: Angles = doc("roll, pitch, yaw; at zero a plane faces -x, and a cylinder stands [deg]", (0.0,) * 3)
    radius: Length | None = doc("of a sphere or a cylinder [m]", None)
    edges: tuple[Length, Length, Length] | None = doc("lengths of a box [m]", None)
    stiffness: WallStiffness = doc("k_c [N/m]", 1e5)
    damping: WallDamping = doc("b_c [N s/m]", 0.0)
    layer_depth: Length | None = doc("depth beyond which the wall has layer_stiffness; default: one layer [m]", None)
    layer_stiffness: WallStiffness | None = doc("stiffness beyond layer_depth [N/m]", None)
    friction: Friction = doc("Coulomb coefficient mu [1]", 0.0)
    tangential_stiffness: WallStiffness | None = doc("k_t of sticking friction [N/m]; default: stiffness", None)
    tangential_damping: WallDamping | None = doc("b_t of sticking friction [N s/m]; default: critical", None)
    motion: tuple[Displacement, ...] = doc("[[time, x, y, z], ...]: displacement in W, linear between [s, m]", ())
    amplitude: Vector3 = doc("of a sine of the displacement, in W [m]", (0.0,) * 3)
    frequency_hz: Annotated[Number, within(0.0, 1e3, "Hz")] = doc("of the sine [Hz]", 0.0)
    phase_deg: Angle = doc("of the sine at t = 0 [deg]", 0.0)

    def __post_init__(self) -> None:
        needed = _SIZES[self.shape]
        wrong = [f"a {self.shape} needs {key}" for key in needed if getattr(self, key) is None]
        others = {key for keys in _SIZES.values() for key in keys} - {*needed}
        wrong += [f"a {self.shape} has no {key}" for key in sorted(others) if getattr(self, key) is not None]
        if (self.layer_depth is None) != (self.layer_stiffness is None):
            wrong.append("layer_depth and layer_stiffness belong together")
        times = [row[0] for row in self.motion]
        wrong += [
            f"motion[{i + 1}]: time {late:g} s must be later than {early:g} s"
            for i, (early, late) in enumerate(itertools.pairwise(times))
            if late <= early
        ]
        if len(times) > _MOST_ROWS:
            wrong.append(f"motion has {len(times)} rows; at most {_MOST_ROWS} are allowed")
        if any(self.amplitude) and self.frequency_hz == 0.0:
            wrong.append("amplitude needs frequency_hz")
        if wrong:
            raise ValueError("; ".join(wrong))

    @property
    def moves(self) -> bool:
        return bool(self.motion) or any(self.amplitude)

    @property
    def size(self) -> tuple[float, float, float]:
        """The radius, or the half edges [m]."""
        a, b, c = self.edges or (0.0, 0.0, 0.0)
        return (self.radius, 0.0, 0.0) if self.radius is not None else (a / 2.0, b / 2.0, c / 2.0)

    @property
    def R_WS(self) -> np.ndarray:
        """(3, 3) attitude."""
        return rotation_matrix(quat_from_euler_deg(*self.attitude_deg))


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

    stiffness: WallStiffness | None = doc("k_b, in series with the wall's; default: no bumper [N/m]", None)
    damping: WallDamping = doc("b_b [N s/m]", 0.0)

    def __post_init__(self) -> None:
        if self.stiffness is None and self.damping:
            raise ValueError("damping needs stiffness: without it there is no bumper")

    def in_front_of(self, stiffness: float, damping: float) -> tuple[float, float]:
        """:func:`in_series` of a wall and this bumper."""
        return in_series(stiffness, damping, self.stiffness or 0.0, self.damping)


OF_WALLS = re.compile(r"walls(?:\[(\d{1,9})\]\.(\w+))?")
"""The keys ``walls`` and ``walls[0].stiffness`` of an override."""


def override_walls(tables: dict[str, Any], key: str, found: re.Match, value: Any) -> list[Fault]:
    """Replace the list of walls in the tables of a scenario, or a key of one of them; ``found`` is the match of
    :data:`OF_WALLS` with the key."""
    index, word = found.groups()
    if index is None:
        tables["walls"] = value
        return []
    walls = tables.get("walls", [])
    if not isinstance(walls, list | tuple) or int(index) >= len(walls):
        return [Fault(key, f"the scenario has {len(walls) if isinstance(walls, list | tuple) else 0} [[walls]]")]
    tables["walls"] = [dict(wall) if isinstance(wall, Mapping) else wall for wall in walls]
    if isinstance(tables["walls"][int(index)], dict):  # otherwise the validator reports it
        tables["walls"][int(index)][word] = value
    return []
