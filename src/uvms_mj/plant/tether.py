"""Settings of the tether: a lumped drag, or a cable that moves (:mod:`..physics.cable`)."""

import functools
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar

import numpy as np
from pydantic.dataclasses import dataclass

from ..errors import Fault
from ..physics.cable import CABLE, NODE, cable_state, settle
from ..physics.effects import RHO
from ..physics.kernels import called_on
from ..physics.surfaces import SURFACE
from ..quantities import STRICT, Number, Position, Vector3, Whole, doc, within
from .sea import STEPS
from .settings import EffectTable, Situation

_OF_ELEMENTS = {
    **{"anchor": (0.0, 0.0, 0.0), "anchor_velocity": (0.0,) * 3, "anchor_amplitude": (0.0,) * 3},
    **{"anchor_frequency_hz": 0.0, "mass": 0.043, "stiffness": None, "drag_along": 0.02, "added_mass": 1.0},
    "floor": None,
}
"""The defaults of the keys that a tether with elements alone has."""
_SHARE, _LEAST, _MOST_STEPS = 1.0 / 30.0, 1e-4, 10_000
"""Time step over the time that the load takes for the cable's length, least acceleration by the load [m/s^2], and most
steps, in which a cable goes to its rest before a run."""
_PLACES, _SWINGS = 101, 9
"""Places along the anchor's way, and along its sine."""


@dataclass(frozen=True, config=STRICT)
class Tether(EffectTable):
    """A cable whose drag acts on the vehicle or, with elements, which moves and pulls at it. It has the diameter and
    the mass of Blue Robotics' Fathom tether and the drag coefficient of a smooth cylinder across the flow (Hoerner,
    1965): assumptions for any other cable."""

    of_world: ClassVar[bool] = False
    length: Annotated[Number, within(0.0, 1e5, "m")] = doc(
        "length whose drag the vehicle bears, or with elements of the whole cable; 0: no tether [m]", 0.0
    )
    diameter: Annotated[Number, within(1e-4, 1.0, "m")] = doc("diameter of the tether [m]", 7.6e-3)
    drag_coefficient: Annotated[Number, within(0.0, 10.0, "")] = doc("C_d of the tether across the flow [1]", 1.2)
    position: Position = doc("point of attachment in B [m]", (0.0, 0.0, 0.0))
    elements: Annotated[Whole, within(0, 100, "")] = doc(
        "elements between the nodes of a cable that moves, at least 2; 0: its lumped drag alone [1]", 0
    )
    anchor: Position = doc("its other end in W [m]", _OF_ELEMENTS["anchor"])
    anchor_velocity: Vector3 = doc("velocity of the anchor in W [m/s]", _OF_ELEMENTS["anchor_velocity"])
    anchor_amplitude: Vector3 = doc("of a sine of the anchor's place in W [m]", _OF_ELEMENTS["anchor_amplitude"])
    anchor_frequency_hz: Annotated[Number, within(0.0, 1e3, "Hz")] = doc(
        "of this sine [Hz]", _OF_ELEMENTS["anchor_frequency_hz"]
    )
    mass: Annotated[Number, within(1e-4, 1e4, "kg/m")] = doc("mass per length [kg/m]", _OF_ELEMENTS["mass"])
    stiffness: Annotated[Number, within(1e-3, 1e15, "N")] | None = doc(
        "EA, axial stiffness; null: its length does not change [N]", _OF_ELEMENTS["stiffness"]
    )
    drag_along: Annotated[Number, within(0.0, 10.0, "")] = doc(
        "C_t, drag coefficient along it, of its whole skin [1]", _OF_ELEMENTS["drag_along"]
    )
    added_mass: Annotated[Number, within(0.0, 10.0, "")] = doc(
        "C_a, added mass across it over the displaced mass [1]", _OF_ELEMENTS["added_mass"]
    )
    floor: Annotated[Number, within(-1e5, 1e5, "m")] | None = doc(
        "z of a smooth floor in W that the cable lies on; null: none [m]", _OF_ELEMENTS["floor"]
    )

    sizes: ClassVar[Mapping[str, tuple[str, ...]]] = {"length": ("diameter", "drag_coefficient", "position")}

    def __post_init__(self) -> None:
        given = [key for key, default in _OF_ELEMENTS.items() if getattr(self, key) != default]
        if self.elements == 0 and given:
            raise ValueError(f"{', '.join(given)} of a cable that moves, which a tether is with elements")
        if self.elements == 1:
            raise ValueError("elements must be 0 or at least 2")

    @property
    def advances(self) -> bool:
        """Whether it has states that advance."""
        return self.elements > 0 and self.length > 0.0

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.effects.TETHER`."""
        factor = 0.5 * RHO * self.drag_coefficient * self.diameter * self.length
        return [(factor, self.position)] if self.length > 0.0 and not self.elements else []

    def kinds(self, name: str, situation: Situation) -> Mapping[str, list[tuple]]:
        """Of its drag, or of :data:`uvms_mj.physics.cable.CABLE` and its nodes."""
        if not self.advances:
            return {name: self.records(situation)}
        p, R = np.array(situation.start_p), situation.start_R
        inertia = apparent_mass(situation.inertia, self.position)
        walls = np.zeros(len(situation.walls), SURFACE)
        for record, wall in zip(walls, situation.walls.values(), strict=True):
            wall.place(record)
        end_W = p + R @ self.position
        starts = _rest(self, end_W.tobytes(), situation.mean_flow_W.tobytes(), situation.gravity, walls.tobytes())
        return {
            name: [],
            "cable": [self.cable_numbers(situation.timestep, inertia)],
            "nodes": [(each,) for each in starts],
        }

    def cable_numbers(self, timestep: float, inertia: np.ndarray) -> tuple:
        """The numbers of :data:`uvms_mj.physics.cable.CABLE`: a time step [s], an inertia (3, 3) at its end [kg]."""
        length = self.length / self.elements
        displaced = RHO * 0.25 * math.pi * self.diameter**2 * length
        drag = 0.5 * RHO * self.diameter * length
        anchor = self.anchor, self.anchor_velocity, self.anchor_amplitude, 2.0 * math.pi * self.anchor_frequency_hz
        return (
            *(timestep, self.position, inertia, *anchor),
            *(length, 0.0 if self.stiffness is None else length / self.stiffness),
            *(self.mass * length, displaced, self.added_mass * displaced),
            *(drag * self.drag_coefficient, drag * math.pi * self.drag_along),
            -math.inf if self.floor is None else self.floor,
        )

    def faults(self, situation: Situation) -> Iterator[Fault]:
        if not self.elements:
            return
        if self.length == 0.0:
            yield Fault("length", "a tether with elements needs a length")
            return
        if situation.links:
            wrong = "the pull of a tether with elements is not computed for a vehicle with joints; set it to 0"
            yield Fault("elements", wrong)
            return
        p, R = np.array(situation.start_p), situation.start_R
        distance = float(np.linalg.norm(p + R @ self.position - self.anchor))
        if self.length < distance:
            wrong = f"{self.length:g} m is shorter than the distance of {distance:g} m from its anchor to the vehicle"
            yield Fault("length", f"{wrong} at the start")
        if any(self.anchor_amplitude) != (self.anchor_frequency_hz > 0.0):
            wrong = "a sine of the anchor needs anchor_amplitude and anchor_frequency_hz"
            yield Fault("anchor_amplitude", wrong)
        elif (fastest := 1.0 / (STEPS * situation.timestep)) < self.anchor_frequency_hz * (1.0 - 1e-9):
            wrong = f"{self.anchor_frequency_hz:g} Hz must be at most {fastest:g} Hz at a time step of"
            yield Fault("anchor_frequency_hz", f"{wrong} {situation.timestep:g} s")
        end_z = float((p + R @ self.position)[2])
        if self.floor is not None and end_z < self.floor:
            yield Fault("floor", f"{self.floor:g} m is above the cable's end at the vehicle, at z = {end_z:g} m")
        yield from self._anchor_faults(situation)

    def _anchor_faults(self, situation: Situation) -> Iterator[Fault]:
        """Errors for an anchor below the floor or inside a wall, at the start or on its way."""
        way = [np.array(self.anchor)]
        if any(self.anchor_velocity) or any(self.anchor_amplitude):
            way += list(self.way(situation.duration))
        depths = {key: [-wall.nearest(place)[0] for place in way] for key, wall in situation.walls.items()}
        depths = {f"inside {key}": each for key, each in depths.items()}
        if self.floor is not None:
            depths["below the floor"] = [self.floor - float(place[2]) for place in way]
        for where, each in depths.items():
            if each[0] > 0.0:
                yield Fault("anchor", f"is {each[0]:g} m {where}")
            elif max(each) > 0.0:
                x, y, z = way[int(np.argmax(each))]
                yield Fault("anchor", f"comes {max(each):.3g} m {where} on its way, at [{x:.3g}, {y:.3g}, {z:.3g}]")

    def way(self, duration: float) -> np.ndarray:
        """Places (n, 3) in W that the anchor comes to in a time [s], of a sine all of its places [m]."""
        travelled = duration * np.array(self.anchor_velocity)
        along = np.linspace(0.0, 1.0, _PLACES)[:, None] * travelled if travelled.any() else np.zeros((1, 3))
        swing = np.array(self.anchor_amplitude)
        across = np.linspace(-1.0, 1.0, _SWINGS)[:, None] * swing if swing.any() else np.zeros((1, 3))
        return (self.anchor + along[:, None] + across[None]).reshape(-1, 3)


def apparent_mass(M: np.ndarray, r: tuple[float, ...]) -> np.ndarray:
    """The inertia (3, 3) that a force at a point r (3,) meets in the directions of B [kg], of an inertia M (6, 6)."""
    x, y, z = r
    J = np.hstack([np.eye(3), [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]])  # v + omega x r
    return np.linalg.inv(J @ np.linalg.solve(M, J.T))


@functools.lru_cache(maxsize=64)
def _rest(tether: Tether, end: bytes, flow: bytes, gravity: float, walls: bytes) -> np.ndarray:
    """The nodes (n, 3) of a cable at rest between its anchor and an end, in water that flows, among walls; near it,
    where there is no rest [m, W]."""
    end_W, flow_W, anchor, n = np.frombuffer(end), np.frombuffer(flow), np.array(tether.anchor), tether.elements + 1
    cable, state = np.zeros(1, CABLE), np.zeros(1, cable_state(n))
    nodes = np.zeros(1, np.dtype([("nodes", NODE, (n,))]))
    cable[0] = tether.cable_numbers(1.0, 1e9 * np.eye(3))  # held
    cable["r"], cable["velocity"], cable["amplitude"] = 0.0, 0.0, 0.0
    weight = np.array([0.0, 0.0, -gravity])
    load = (cable["mass"][0] - cable["displaced"][0]) * weight
    load = load + cable["drag_across"][0] * np.linalg.norm(flow_W) * flow_W
    # of the time in which the load moves an element by the cable's length
    acceleration = float(np.linalg.norm(load)) / (cable["mass"][0] + cable["added"][0])
    cable["timestep"] = _SHARE * math.sqrt(tether.length / max(acceleration, _LEAST))
    nodes["nodes"]["start"][0] = _bent(anchor, end_W, tether.length, load, n)
    flows = np.zeros((n, 6))
    flows[:, :3] = flow_W
    count = len(walls) // SURFACE.itemsize
    surfaces = np.zeros(max(2, count), SURFACE)  # one alone would be a record, and no array
    surfaces[:count] = np.frombuffer(walls, SURFACE)
    arrays = cable, nodes, state, weight, flows, end_W.copy(), surfaces
    called_on(settle, *arrays)(_MOST_STEPS, count)
    return state["p"][0].copy()


def _bent(first: np.ndarray, last: np.ndarray, length: float, load: np.ndarray, n: int) -> np.ndarray:
    """Nodes (n, 3) on two straight lines of a whole length between two points, bent to where a load (3,) points."""
    chord = last - first
    distance = float(np.linalg.norm(chord))
    along = chord / distance if distance else np.array([1.0, 0.0, 0.0])
    for way in (load, np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])):
        across = way - (way @ along) * along
        if np.linalg.norm(across) > 1e-6 * max(1e-9, np.linalg.norm(way)):
            break
    across = across / np.linalg.norm(across)
    corner = 0.5 * (first + last) + 0.5 * math.sqrt(max(0.0, length**2 - distance**2)) * across
    s = np.linspace(0.0, 2.0, n)[:, None]
    return np.where(s <= 1.0, first + s * (corner - first), corner + (s - 1.0) * (last - corner))
