"""Settings of the volume that a vehicle displaces, for one that reaches the surface (:mod:`..physics.buoyancy`)."""

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic.dataclasses import dataclass

from ..errors import Fault
from ..physics.effects import RHO
from ..physics.frames import quat_from_euler_deg, rotation_matrix
from ..physics.surfaces import BOX, CAPSULE, SHAPES, SPHERE
from ..quantities import STRICT, Angles, Lowercase, Number, Position, doc, within
from .settings import EffectTable, Length, Situation, wrong_size

KINDS = {"sphere": SPHERE, "box": BOX, "capsule": CAPSULE}
"""The shapes whose volume below a plane is known."""
OFF_CENTRE = 1e-3
"""Distance between the shapes' centroid and the centre of buoyancy up to which the shapes are moved to meet [m]."""
_FULL = 1e-6  # of a volume, by which it may be less than the displaced one


@dataclass(frozen=True, config=STRICT)
class Volume:
    """One table of ``buoyancy.shapes``."""

    shape: Annotated[Literal[tuple(KINDS)], Lowercase] = doc(  # type: ignore[valid-type]  # a table has the names
        ", ".join(KINDS)
    )
    radius: Length | None = doc("of a sphere or a capsule [m]", None)
    length: Length | None = doc("of a capsule, between the centres of its ends [m]", None)
    edges: tuple[Length, Length, Length] | None = doc("lengths of a box [m]", None)
    position: Position | None = doc("centre in B; null: the vehicle's centre of buoyancy [m]", None)
    attitude_deg: Angles = doc("roll, pitch, yaw in B; at zero a capsule stands [deg]", (0.0,) * 3)

    def __post_init__(self) -> None:
        if wrong := wrong_size(self):
            raise ValueError("; ".join(wrong))

    @property
    def size(self) -> tuple[float, float, float]:
        """Radius and half length, or half edges [m]."""
        shape = SHAPES[self.shape]
        return shape.extent(*(getattr(self, key) for key in shape.keys))

    @property
    def volume(self) -> float:
        """Volume of the shape [m^3]."""
        a, b, c = self.size
        if self.shape == "box":
            return 8.0 * a * b * c
        return 4.0 / 3.0 * math.pi * a**3 + 2.0 * math.pi * a * a * b

    def place(self, situation: Situation) -> np.ndarray:
        """Centre (3,) in B [m]."""
        return np.array(situation.r_b if self.position is None else self.position, float)


@dataclass(frozen=True, config=STRICT)
class Buoyancy(EffectTable):
    """The displaced volume of the vehicle, of which the part below the surface counts."""

    of_world: ClassVar[bool] = False
    balanced: ClassVar[bool] = False  # what is above the surface loses its added mass, drag and thrust, too

    shapes: tuple[Volume, ...] = doc(
        "shapes whose volumes the vehicle displaces: [{shape = 'box', edges = [0.5, 0.3, 0.2]}, ...]; empty: all of it "
        "is below the surface everywhere",
        (),
    )
    density: Annotated[Number, within(1.0, 1e5, "kg/m^3")] = doc("of the water [kg/m^3]", RHO)
    propeller_radius: Annotated[Number, within(1e-4, 10.0, "m")] = doc(
        "of the propellers, whose thrust ends as a sphere of it at their place leaves the water [m]", 0.038
    )

    @property
    def volume(self) -> float:
        """Volume of all shapes [m^3]."""
        return math.fsum(each.volume for each in self.shapes)

    def filled(self, displaced_mass: float) -> float:
        """The share of the shapes' volume with which they displace a mass of water [kg]; 0 without shapes."""
        return displaced_mass / (self.density * self.volume) if self.shapes else 0.0

    def centroid(self, situation: Situation) -> np.ndarray:
        """The centroid (3,) of the shapes that there are, in B [m]."""
        return np.array([each.volume * each.place(situation) for each in self.shapes]).sum(axis=0) / self.volume

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.buoyancy.VOLUME`."""
        if not self.shapes:
            return []
        density, off = situation.displaced_mass / self.volume, self.centroid(situation) - situation.r_b
        return [
            (
                *(KINDS[each.shape], each.size, each.place(situation) - off),
                rotation_matrix(quat_from_euler_deg(*each.attitude_deg)),
                *(each.volume, density, situation.surface, self.propeller_radius),
            )
            for each in self.shapes
        ]

    def faults(self, situation: Situation) -> Iterator[Fault]:
        if not self.shapes:
            given = (key for key in ("density", "propeller_radius") if getattr(self, key) != getattr(Buoyancy, key))
            yield from (Fault(key, "belongs to buoyancy.shapes, and there are none") for key in given)
            return
        if situation.links:
            yield Fault("shapes", "the volume of an arm at the surface is not computed; take a vehicle without joints")
        if situation.tilted:
            yield Fault("shapes", "the surface is level, and gravity is not along -z")
        if situation.displaced_mass == 0.0:
            yield Fault("shapes", "the vehicle displaces no water")
        elif (filled := self.filled(situation.displaced_mass)) > 1.0 + _FULL:
            litres = 1e3 * self.volume
            wrong = f"hold {litres:.4g} l, and the vehicle displaces {litres * filled:.4g} l of {self.density:g} kg/m^3"
            yield Fault("shapes", f"{wrong}; they must hold as much or more")
        centroid = self.centroid(situation)
        if np.linalg.norm(centroid - situation.r_b) > OFF_CENTRE:
            there, here = (" ".join(f"{x:.4g}" for x in each) for each in (centroid, situation.r_b))
            yield Fault("shapes", f"their centroid is ({there}) m in B, and the centre of buoyancy is ({here}) m")
