"""Settings of a coupling of two vehicles of a world (:mod:`..physics.coupling`)."""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic.dataclasses import dataclass

from ..errors import Fault
from ..physics.coupling import KINDS, TIE, TOUCH
from ..physics.frames import BODY, quat_from_euler_deg, rotation_matrix
from ..quantities import STRICT, Lowercase, Number, Position, doc, within
from .contacts import Contacts, Pair, carrier_at, ends_of, no_carrier, uncomputed
from .settings import ContactBody, EffectTable, Situation, Surface, lightest_at

_FINEST = 0.25
"""Largest h^2 k / m + h b / m of a coupling [1]: a step is then at most half a radian of its oscillation."""
_MOST_GAP = 0.05
"""Largest distance of the points of a joint at the start [m]."""
_OF_TIES = {"points": ((0.0,) * 3, (0.0,) * 3), "stiffness": 1e4, "damping": 0.0, "length": 0.0}
"""The defaults of the keys that a contact with a surface has not."""
_RIDING = ("body", "surface")
_OF_WALLS = ("shape", "position", "attitude_deg", "radius", "length", "edges", "stiffness", "damping", "layer_depth")
_OF_WALLS += ("layer_stiffness", "contact", "restitution", "restitution_speed", "modulus", "friction")
_OF_WALLS += ("breakaway_friction", "tangential_stiffness", "tangential_damping")
"""The keys of a wall that a surface of a vehicle has; the vehicle moves it."""


@dataclass(frozen=True, config=STRICT)
class Coupling(EffectTable):
    """A spring and a damper between a point of one vehicle and a point of another: a joint, which keeps the points
    together, a spring of a length, a cable, which never pushes, or the contact of two spheres about the points; or a
    contact body of the first vehicle in front of a surface that rides on the second one."""

    of_world: ClassVar[bool] = True
    vehicles: tuple[str, str] = doc("names of the two vehicles")
    points: tuple[Position, Position] = doc("its point in the frame at of each vehicle [m]", _OF_TIES["points"])
    at: tuple[str, str] = doc(
        "B, a link or a site of each vehicle, in whose frame its point, body or surface is; default: B", (BODY, BODY)
    )
    kind: Annotated[Literal[tuple(KINDS)], Lowercase] = doc(  # type: ignore[valid-type]  # a table has the names
        "joint, spring, cable, which never pushes, or contact, which never pulls", "joint"
    )
    stiffness: Annotated[Number, within(1e-3, 1e9, "N/m")] = doc("k [N/m]", _OF_TIES["stiffness"])
    damping: Annotated[Number, within(0.0, 1e9, "N s/m")] = doc("b [N s/m]", _OF_TIES["damping"])
    length: Annotated[Number, within(0.0, 1e4, "m")] = doc(
        "natural length of a spring or a cable, or both radii of two spheres in contact together [m]",
        _OF_TIES["length"],
    )
    body: ContactBody | None = doc(
        "of a contact with a surface: the first vehicle's, as one of vehicle.contact_bodies, in its frame at", None
    )
    surface: Surface | None = doc(
        "of a contact: what the body touches, as one of walls, in the frame at of the second vehicle", None
    )

    def __post_init__(self) -> None:
        rides = self.body is not None or self.surface is not None
        wrong = [*(self._wrong_surface() if rides else self._wrong_tie())]
        if wrong:
            raise ValueError("; ".join(wrong))

    def _wrong_tie(self) -> Iterator[str]:
        if (self.kind == "joint") == (self.length > 0.0):
            yield f"a {self.kind} {'has no' if self.kind == 'joint' else 'needs a'} length"

    def _wrong_surface(self) -> Iterator[str]:
        yield from (
            f"body and surface belong together; {key} is missing" for key in _RIDING if getattr(self, key) is None
        )
        if self.kind != "contact":
            yield f"body and surface are of a contact, and this is a {self.kind}"
        of_ties = [key for key, default in _OF_TIES.items() if getattr(self, key) != default]
        if of_ties:
            yield f"a contact with a surface has no {', '.join(of_ties)}; body and surface have its numbers"
        if self.body is not None and self.body.body is not None:
            yield "body.body has no effect: at names the frame of each vehicle"
        if self.surface is not None:
            table, fields = self.surface, dataclasses.fields(self.surface)
            moved = [f.name for f in fields if f.name not in _OF_WALLS and getattr(table, f.name) != f.default]
            if moved:
                yield f"surface.{', surface.'.join(moved)}: the vehicle moves its surface"
        if self.body is not None and self.surface is not None:
            yield from (f"{key}: {said}" for key, said in uncomputed(self.body, self.surface, "surface"))
            if len([*ends_of(self.body, self.surface)]) > 1:
                yield "body: a capsule before a plane is two spheres; give each its own coupling"

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.coupling.COUPLING`."""
        if situation.vehicle not in self.vehicles:
            return []
        end = self.vehicles.index(situation.vehicle)
        C = carrier_at(self.at[end], situation.arm)
        assert C is not None  # a table without faults
        return [(C.link + 1, C.p + C.R @ self.points[end], C.R)]

    def kinds(self, name: str, situation: Situation) -> Mapping[str, list[tuple]]:
        """Its record, the number of its pull, and at the first vehicle of a surface its touch."""
        found = self.records(situation)
        touches = [(0,)] if found and self.surface is not None and situation.vehicle == self.vehicles[0] else []
        return {name: found, "pulls": [(0,)] * len(found), "touches": touches}

    def faults(self, situation: Situation) -> Iterator[Fault]:
        if not situation.vehicle:
            yield Fault("vehicles", "a coupling acts between two vehicles of a world, which have names")
        elif situation.vehicle in self.vehicles:
            name = self.at[self.vehicles.index(situation.vehicle)]
            C = carrier_at(name, situation.arm)
            if C is None:
                yield Fault("at", f"{situation.vehicle}: {no_carrier(name, situation.arm)}")
            elif C.link >= 0 and situation.wrist:
                yield Fault(
                    "at", f"{situation.vehicle}: {name!r} is on a link, and the wrist sensor knows no coupling there"
                )

    @property
    def tie(self) -> np.ndarray:
        """() its record :data:`uvms_mj.physics.coupling.TIE`."""
        return np.array((self.stiffness, self.damping, self.length, KINDS[self.kind]), TIE)

    def touch(self, setups: Sequence[Any], timestep: float) -> np.ndarray:
        """() the record :data:`uvms_mj.physics.coupling.TOUCH` of a surface, between two vehicles with their setups
        and with a time step [s]. The default damping of sticking friction is critical for the lightest motion of both
        together."""
        assert self.body is not None
        assert self.surface is not None
        bumper, (ends,) = (self.body.stiffness or 0.0, self.body.damping), ends_of(self.body, self.surface)
        pair = Pair(0, self.surface, "surface", "body", 0, ends, self.body.radius, bumper)
        surfaces, pairs = Contacts((("surface", self.surface),), (pair,), ()).records(
            lambda _: 1.0 / self.yielding(setups)
        )
        found = np.zeros((), TOUCH)
        found["timestep"], found["pair"], found["surface"] = timestep, pairs[0], surfaces[0]
        return found

    def yielding(self, setups: Sequence[Any]) -> float:
        """The inverse of the least inertia of both vehicles together at the coupling, in any direction and with added
        mass, in their initial postures [1/kg]."""
        total = 0.0
        for end, setup in enumerate(setups):
            C = carrier_at(self.at[end], setup.vehicle.arm)
            M = np.linalg.inv(setup.start.mobility(C))
            places, reach = np.array([self.points[end]]), 0.0
            if self.body is not None and end == 0:
                places = np.array([self.body.position, self.body.end or self.body.position])
                reach = self.body.radius
            elif self.surface is not None and end == 1:
                places, reach = np.array([self.surface.position]), max(self.surface.size)
            total += 1.0 / lightest_at(M, places, reach)
        return total

    @property
    def stiffest(self) -> tuple[float, float]:
        """Its greatest stiffness [N/m] and damping [N s/m], normal or tangential, without a surface that is not
        linear."""
        if self.surface is None:
            return self.stiffness, self.damping
        wall = self.surface
        tangential = (wall.tangential_stiffness or wall.stiffness) if wall.friction > 0.0 else 0.0
        return max(wall.stiffness, wall.layer_stiffness or 0.0, tangential), max(
            wall.damping, wall.tangential_damping or 0.0
        )


OF_COUPLINGS = {"couplings.body": ContactBody, "couplings.surface": Surface}
"""The tables within the table, by their key."""


def coupling_faults(coupling: Coupling, setups: Sequence[Any], timestep: float) -> Iterator[Fault]:
    """The errors of a coupling of two vehicles, each with its setup: a time step [s] that does not resolve it, and a
    start in which it is far from its length."""
    yielding, poses = coupling.yielding(setups), []
    for name, setup in zip(coupling.at, setups, strict=True):
        initial = setup.scenario.initial
        R = rotation_matrix(quat_from_euler_deg(*initial.attitude_deg))
        p_BC, R_BC = setup.start.pose(carrier_at(name, setup.vehicle.arm))
        poses.append((np.array(initial.position) + R @ p_BC, R @ R_BC))
    wall, (k, b), table = coupling.surface, coupling.stiffest, ""
    if wall is not None:
        assert coupling.body is not None
        table = "surface."
        if not wall.linear:
            k, b = wall.stiffest(coupling.body.radius, 1.0 / yielding)
    if timestep * (timestep * k + b) * yielding > _FINEST:
        k, b = k * yielding, b * yielding
        most = 2.0 * _FINEST / (b + math.sqrt(b * b + 4.0 * k * _FINEST))
        faster = f"with damping, it moves {1.0 / yielding:.3g} kg faster than a time step of {timestep:g} s resolves"
        yield Fault(f"{table}stiffness", f"{faster}; take at most {most:.2g} s, or a softer coupling")
    if wall is not None:
        assert coupling.body is not None
        (p_1, R_1), (p_2, R_2) = poses
        ends = (coupling.body.position, coupling.body.end or coupling.body.position)
        distance = min(wall.nearest(R_2.T @ (p_1 + R_1 @ end - p_2))[0] for end in ends)
        if (inside := coupling.body.radius - distance) > _MOST_GAP:
            yield Fault("body", f"is {inside:.4g} m inside the surface at the start")
        return
    ends = [p + R @ r for (p, R), r in zip(poses, coupling.points, strict=True)]
    gap = float(np.linalg.norm(ends[1] - ends[0]))
    if coupling.kind == "joint" and gap > _MOST_GAP:
        yield Fault("points", f"are {gap:.4g} m apart at the start; a joint begins with at most {_MOST_GAP:g} m")
    if coupling.kind == "cable" and gap > coupling.length + _MOST_GAP:
        yield Fault("length", f"{coupling.length:g} m is shorter than the distance of {gap:.4g} m at the start")
    if coupling.kind == "contact" and gap < coupling.length - _MOST_GAP:
        yield Fault("length", f"the spheres overlap by {coupling.length - gap:.4g} m at the start")
