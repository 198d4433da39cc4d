"""Settings of a coupling of two vehicles of a world (:mod:`..physics.coupling`)."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic.dataclasses import dataclass

from ..errors import Fault
from ..physics.coupling import KINDS, TIE
from ..physics.frames import quat_from_euler_deg, rotation_matrix
from ..quantities import STRICT, Lowercase, Number, Position, doc, within
from .settings import EffectTable, Situation
from .tether import apparent_mass

_FINEST = 0.25
"""Largest h^2 k / m + h b / m of a coupling [1]: a step is then at most half a radian of its oscillation."""
_MOST_GAP = 0.05
"""Largest distance of the points of a joint at the start [m]."""


@dataclass(frozen=True, config=STRICT)
class Coupling(EffectTable):
    """A spring and a damper between a point of one vehicle and a point of another: a joint, which keeps the points
    together, a spring of a length, a cable, which never pushes, or the contact of two spheres about the points."""

    of_world: ClassVar[bool] = True
    vehicles: tuple[str, str]
    """Names of the two vehicles."""
    points: tuple[Position, Position] = doc("its point in B of each vehicle [m]", ((0.0,) * 3, (0.0,) * 3))
    kind: Annotated[Literal[tuple(KINDS)], Lowercase] = doc(  # type: ignore[valid-type]  # a table has the names
        "joint, spring, cable, which never pushes, or contact of two spheres, which never pulls", "joint"
    )
    stiffness: Annotated[Number, within(1e-3, 1e9, "N/m")] = doc("k [N/m]", 1e4)
    damping: Annotated[Number, within(0.0, 1e9, "N s/m")] = doc("b [N s/m]", 0.0)
    length: Annotated[Number, within(0.0, 1e4, "m")] = doc(
        "natural length of a spring or a cable, or both radii of a contact together [m]", 0.0
    )

    def __post_init__(self) -> None:
        if (self.kind == "joint") == (self.length > 0.0):
            raise ValueError(f"a {self.kind} {'has no' if self.kind == 'joint' else 'needs a'} length")

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.coupling.COUPLING`."""
        return [(self.points[self.vehicles.index(situation.vehicle)],)] if situation.vehicle in self.vehicles else []

    def kinds(self, name: str, situation: Situation) -> Mapping[str, list[tuple]]:
        """Its record, and the number of its pull."""
        found = self.records(situation)
        return {name: found, "pulls": [(0,)] * len(found)}

    def faults(self, situation: Situation) -> Iterator[Fault]:
        if not situation.vehicle:
            yield Fault("vehicles", "a coupling acts between two vehicles of a world, which have names")
        elif situation.vehicle in self.vehicles and situation.links:
            yield Fault("vehicles", f"{situation.vehicle} has joints; a coupling is computed for a rigid vehicle")

    @property
    def joins(self) -> bool:
        """Whether it is a joint, which keeps two points together."""
        return self.kind == "joint"

    @property
    def tie(self) -> np.ndarray:
        """(1,) its record :data:`uvms_mj.physics.coupling.TIE`."""
        return np.array([(self.points, self.stiffness, self.damping, self.length, KINDS[self.kind])], TIE)


def coupling_faults(coupling: Coupling, setups: Sequence[Any], timestep: float) -> Iterator[Fault]:
    """The errors of a coupling of two vehicles, each with its setup: a time step [s] that does not resolve it, and a
    start in which it is far from its length."""
    yielding, ends = 0.0, []
    for setup, r in zip(setups, coupling.points, strict=True):
        M = setup.vehicle.M_RB + setup.vehicle.M_A
        yielding += 1.0 / float(np.linalg.eigvalsh(apparent_mass(M, r))[0])
        initial = setup.scenario.initial
        R = rotation_matrix(quat_from_euler_deg(*initial.attitude_deg))
        ends.append(np.array(initial.position) + R @ np.array(r))
    share = timestep * (timestep * coupling.stiffness + coupling.damping) * yielding
    if share > _FINEST:
        k, b = coupling.stiffness * yielding, coupling.damping * yielding
        most = 2.0 * _FINEST / (b + math.sqrt(b * b + 4.0 * k * _FINEST))
        faster = f"with damping, it moves {1.0 / yielding:.3g} kg faster than a time step of {timestep:g} s resolves"
        yield Fault("stiffness", f"{faster}; take at most {most:.2g} s, or a softer coupling")
    gap = float(np.linalg.norm(ends[1] - ends[0]))
    if coupling.joins and gap > _MOST_GAP:
        yield Fault("points", f"are {gap:.4g} m apart at the start; a joint begins with at most {_MOST_GAP:g} m")
    if coupling.kind == "cable" and gap > coupling.length + _MOST_GAP:
        yield Fault("length", f"{coupling.length:g} m is shorter than the distance of {gap:.4g} m at the start")
    if coupling.kind == "contact" and gap < coupling.length - _MOST_GAP:
        yield Fault("length", f"the spheres overlap by {coupling.length - gap:.4g} m at the start")
