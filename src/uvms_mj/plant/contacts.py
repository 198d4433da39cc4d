"""The contacts of a scenario: which contact body of the vehicle can touch which wall.

``[wall]`` is the first of ``[[walls]]``. Without contact bodies and without a bumper the engine solves the contact of
the probe with it, MuJoCo's contact pair (:mod:`.build`). Every other pair is springs and dampers. A capsule is a pair
of spheres in front of a plane: its ends touch first.
"""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import Fault, suggestion
from ..physics.contacts import PAIR
from ..physics.frames import BODY
from ..physics.surfaces import SHAPES, SURFACE, is_computed, nearest_on_segment, signed_distance
from ..physics.vehicle import VehicleLike
from ..stages.setup import ScenarioLike
from .settings import ContactBody, Surface, contact_settings, in_series

OUT_OF_REACH = 1e9
"""A distance beyond the bounds of a run [m]."""


@dataclass(frozen=True, eq=False)
class Carrier:
    """A frame C on a link.

    Attributes:
        link: index in ``vehicle.arm.links``; -1 is the base.
        p: (3,) position in the link's frame [m].
        R: (3, 3) attitude in the link's frame.
    """

    link: int
    p: np.ndarray
    R: np.ndarray

    @classmethod
    def of_link(cls, link: int) -> "Carrier":
        """The frame of a link itself."""
        return cls(link, np.zeros(3), np.eye(3))

    @property
    def is_B(self) -> bool:
        """Whether it is the vehicle's frame B."""
        return self.same(Carrier.of_link(-1))

    def same(self, other: "Carrier") -> bool:
        """Whether both are one frame."""
        return self.link == other.link and np.array_equal(self.p, other.p) and np.array_equal(self.R, other.R)


def carrier_at(name: str, arm: Any) -> Carrier | None:
    """The frame of a name, B or a link or a site of a vehicle with an :class:`uvms_mj.plant.arm.Arm`; None if there is
    none."""
    links = [link.name for link in arm.links]
    if name == BODY:
        return Carrier.of_link(-1)
    if name in links:
        return Carrier.of_link(links.index(name))
    site = arm.sites.get(name)
    return None if site is None else Carrier(site.link, site.p, site.R)


def no_carrier(name: str, arm: Any) -> str:
    """The sentence for a name of which a vehicle has no frame."""
    choices = suggestion(name, [BODY, *(link.name for link in arm.links), *arm.sites])
    return f"{name!r} is neither a link nor a site of the vehicle; {choices}"


@dataclass(frozen=True, eq=False)
class Probe:
    """The sphere about the origin of the frame of the task: B, or a site. ``body`` is MuJoCo's body that carries it,
    and ``radius`` is the vehicle's reach, or the size of the site [m]."""

    body: str
    carrier: Carrier
    radius: float

    @classmethod
    def of(cls, frame: str, mjcf: Any) -> "Probe":
        """The probe at the frame of a task, "body" or the name of a site, from the vehicle's
        :class:`uvms_mj.plant.mjcf.Mjcf`."""
        vehicle = mjcf.vehicle
        if frame == BODY:
            return cls(vehicle.body, Carrier.of_link(-1), mjcf.geometry.reach)
        site = vehicle.arm.sites[frame]
        body = vehicle.arm.links[site.link].name if site.link >= 0 else vehicle.body
        return cls(body, Carrier(site.link, site.p, site.R), site.radius)


@dataclass(frozen=True, eq=False)
class Pair:
    """One contact body in front of one wall.

    Attributes:
        surface: index of the wall in :attr:`Contacts.walls`.
        wall_key, body_key: their tables in the scenario.
        carrier: index of the body's frame C in :attr:`Contacts.carriers`.
        ends_C: (2, 3) ends of the body's axis in C, equal for a sphere [m].
        radius: of the body [m].
        bumper: stiffness, 0 without a bumper [N/m], and damping [N s/m].
        solved: whether the normal force is the engine's, as of the probe that touches ``[wall]`` without a bumper.
    """

    surface: int
    wall: Surface
    wall_key: str
    body_key: str
    carrier: int
    ends_C: np.ndarray
    radius: float
    bumper: tuple[float, float]
    solved: bool = False


@dataclass(frozen=True, eq=False)
class ContactAtRest:
    """A contact as a law meets it at the desired pose: the key of its wall, the normal (6,) out of the wall as a wrench
    in the frame of the task, and stiffness [N/m] and damping [N s/m] of wall and bumper together. ``[wall]`` has the
    key "wall"."""

    key: str
    normal: np.ndarray
    stiffness: float
    damping: float


@dataclass(frozen=True, eq=False)
class Contacts:
    """The walls with their keys, ``[wall]`` first, the pairs, and the frames that contact bodies are fixed to, the
    frame of the probe first. A pair that the engine solves is the first."""

    walls: tuple[tuple[str, Surface], ...]
    pairs: tuple[Pair, ...]
    carriers: tuple[Carrier, ...]

    @property
    def paper(self) -> bool:
        """Whether the engine solves the contact of the probe and ``[wall]``."""
        return any(pair.solved for pair in self.pairs[:1])

    @property
    def springs(self) -> tuple[Pair, ...]:
        """The pairs that are springs and dampers."""
        return self.pairs[int(self.paper) :]

    @property
    def kinds(self) -> tuple[tuple[str, ...], int, bool]:
        """The shapes of the walls, how many pairs there are, and whether the engine solves one."""
        return tuple(wall.shape for _, wall in self.walls), len(self.pairs), self.paper

    def records(self, lightest: Callable[[Pair], float]) -> tuple[np.ndarray, np.ndarray]:
        """SURFACE records without their tables of motion, and PAIR records. ``lightest`` gives the least mass at a
        contact along the wall's face [kg], for the default damping of sticking friction."""
        surfaces, pairs = np.zeros(len(self.walls), SURFACE), np.zeros(len(self.pairs), PAIR)
        for row, (_, wall) in zip(surfaces, self.walls, strict=True):
            wall.place(row)
            if wall.moves:
                row["moves"], row["rows"] = True, len(wall.motion)
                row["amplitude_W"], row["frequency"] = wall.amplitude, wall.frequency_hz
                row["phase"], row["turns"] = math.radians(wall.phase_deg), wall.turning
                row["turn_W"], row["turn_frequency"] = np.radians(wall.turn_amplitude_deg), wall.turn_frequency_hz
                row["turn_phase"] = math.radians(wall.turn_phase_deg)
        for row, pair in zip(pairs, self.pairs, strict=True):
            wall, contact = pair.wall, row["contact"]
            for name, value in contact_settings(wall, functools.partial(lightest, pair)).items():
                contact[name] = value
            row["surface"], row["carrier"], row["radius"] = pair.surface, pair.carrier, pair.radius
            first, second = pair.ends_C.tolist()
            row["ends_C"], row["capsule"] = pair.ends_C, first != second
            row["layer_depth"] = math.inf if wall.layer_depth is None else wall.layer_depth
            row["layer_stiffness"] = wall.layer_stiffness or wall.stiffness
            row["solved"], row["power"], row["dissipation"] = pair.solved, wall.power, wall.dissipation
            if not wall.linear:
                contact["stiffness"] = wall.stiffness_on(pair.radius)
            if pair.bumper[0]:
                row["bumper_stiffness"], row["bumper_damping"] = pair.bumper
        return surfaces, pairs

    def at_rest(self, position: np.ndarray, R_WC: np.ndarray) -> Iterator[ContactAtRest]:
        """The contacts of bodies on the probe's frame C at a pose of it: all that are in one wall together, or the one
        that is nearest to it. Contacts that are not linear are left out."""
        surfaces, records = self.records(lambda _: 1.0)
        found: dict[str, list[tuple[float, ContactAtRest]]] = {}
        for record, pair in zip(records.view(np.recarray), self.pairs, strict=True):
            if pair.carrier != 0 or not pair.wall.linear:
                continue
            surface, n = surfaces.view(np.recarray)[pair.surface], np.zeros(3)
            c, end = position + pair.ends_C @ R_WC.T
            if record.capsule:
                c = c + nearest_on_segment(surface, c, end) * (end - c)
            distance = signed_distance(surface, c, n) - pair.radius
            moment = np.cross(c - position - pair.radius * n, n)
            stiffness, damping = in_series(pair.wall.stiffness, pair.wall.damping, *pair.bumper)
            contact = ContactAtRest(pair.wall_key, np.concatenate([R_WC.T @ n, R_WC.T @ moment]), stiffness, damping)
            found.setdefault(pair.wall_key, []).append((distance, contact))
        for key, each in found.items():
            inside = [contact for distance, contact in each if distance < 0.0] or [min(each, key=lambda at: at[0])[1]]
            total = sum(contact.stiffness for contact in inside)
            normal = sum(contact.stiffness / total * contact.normal for contact in inside)
            yield ContactAtRest(key, np.asarray(normal), total, sum(contact.damping for contact in inside))


def contacts_of(scenario: ScenarioLike, probe: Probe, vehicle: VehicleLike) -> Contacts:
    """The contacts of a scenario and a vehicle with its probe. A link that the vehicle does not have counts as its
    base; :func:`impossible` reports it."""
    bodies, bumper = scenario.vehicle.contact_bodies, scenario.bumper
    walls = tuple(walls_of(scenario, probe.radius).items())
    solved, carriers = is_papers(scenario), [probe.carrier]
    named = [(f"vehicle.contact_bodies[{i}]", body, _carrier(body, vehicle, carriers)) for i, body in enumerate(bodies)]
    if walls and not named:
        named = [("the probe", _sphere(probe.radius, bumper.stiffness, bumper.damping), 0)]
    pairs = [
        Pair(
            index, wall, key, name, carrier, ends, body.radius, (body.stiffness or 0.0, body.damping),
            solved and index == 0,
        )
        for index, (key, wall) in enumerate(walls)
        for name, body, carrier in named
        for ends in ends_of(body, wall)
    ]  # fmt: skip
    return Contacts(walls, tuple(pairs), tuple(carriers))


@functools.lru_cache(maxsize=8)  # a reset asks for the same one
def _sphere(radius: float, stiffness: float | None, damping: float) -> ContactBody:
    return ContactBody((0.0, 0.0, 0.0), radius, None, stiffness, damping)


def _carrier(body: ContactBody, vehicle: VehicleLike, carriers: list[Carrier]) -> int:
    """Index of the frame of the link that carries a contact body, in ``carriers``, to which it is added."""
    links = [link.name for link in vehicle.arm.links]
    own = Carrier.of_link(links.index(body.body) if body.body in links else -1)
    found = [i for i, carrier in enumerate(carriers) if carrier.same(own)]
    if not found:
        carriers.append(own)
    return found[0] if found else len(carriers) - 1


def is_papers(scenario: ScenarioLike) -> bool:
    """Whether the probe touches ``[wall]`` without a bumper, which is MuJoCo's contact pair."""
    bare = scenario.bumper.stiffness is None and not scenario.vehicle.contact_bodies
    return bool(scenario.wall.present and bare)


def face_of(scenario: ScenarioLike, radius: float) -> float:
    """x of the face of ``[wall]`` in W for MuJoCo's pair and a probe of a radius [m]; out of reach if there is no such
    pair."""
    return scenario.wall.position + radius if is_papers(scenario) else OUT_OF_REACH


def surfaces_of(scenario: ScenarioLike, radius: float) -> tuple[Surface, ...]:
    """All walls, of which ``[wall]``, if it is there, is the first; the probe has a radius [m]."""
    return *((as_surface(scenario.wall, radius),) if scenario.wall.present else ()), *scenario.walls


def walls_of(scenario: ScenarioLike, radius: float) -> dict[str, Surface]:
    """The walls of :func:`surfaces_of` by their keys, "wall" and "walls[0]"."""
    keys = (*(("wall",) if scenario.wall.present else ()), *(f"walls[{i}]" for i in range(len(scenario.walls))))
    return dict(zip(keys, surfaces_of(scenario, radius), strict=True))


def as_surface(wall: Any, radius: float) -> Surface:
    """``[wall]`` as one of ``[[walls]]``: a probe of a radius [m] touches it at x_c."""
    names = ("stiffness", "damping", "friction", "tangential_stiffness", "tangential_damping")
    given = {name: getattr(wall, name) for name in names}
    surface = object.__new__(Surface)
    # without a check: the face of a valid wall and a valid vehicle may lie beyond the greatest coordinate of an input
    vars(surface).update(vars(_PLANE), position=(wall.position + radius, 0.0, 0.0), **given)
    return surface


_PLANE = Surface(shape="plane", position=(0.0, 0.0, 0.0))


def impossible(scenario: ScenarioLike, vehicle: VehicleLike) -> Iterator[Fault]:
    """Errors for contacts that are not computed, for links that the vehicle does not have, and for settings without
    effect."""
    bodies = scenario.vehicle.contact_bodies
    names = [vehicle.body, *(link.name for link in vehicle.arm.links)]
    for k, body in enumerate(bodies):
        if body.body is not None and body.body not in names:
            yield Fault(f"vehicle.contact_bodies[{k}].body", f"no link {body.body!r}; {suggestion(body.body, names)}")
    for i, wall in enumerate(scenario.walls):
        if not is_computed(wall.shape):
            yield Fault(f"walls[{i}].shape", f"the distance from a {wall.shape} is not computed")
            continue
        if not wall.linear and scenario.bumper.stiffness is not None:
            yield Fault("bumper.stiffness", _in_series(wall, f"walls[{i}]"))
        for k, body in enumerate(bodies):
            yield from (
                Fault(f"vehicle.contact_bodies[{k}].{key}", said) for key, said in uncomputed(body, wall, f"walls[{i}]")
            )
    if bodies and scenario.bumper.stiffness is not None:
        yield Fault(
            "bumper.stiffness",
            "belongs to the probe, which vehicle.contact_bodies replace; give vehicle.contact_bodies[0].stiffness",
        )


def uncomputed(body: ContactBody, wall: Surface, name: str) -> Iterator[tuple[str, str]]:
    """The reasons why the contact of a body with a wall of a name is not computed, each with its key of the body."""
    if not wall.linear and body.stiffness is not None:
        yield "stiffness", _in_series(wall, name)
    if body.end is not None and wall.contact == "hertz":
        yield "end", f"Hertz's contact of a capsule with {name} is not computed; give spheres along the capsule"
    if body.end is not None and not is_computed(wall.shape, capsule=True):
        wrong = f"contact of a capsule with a {wall.shape}, {name}, is not computed"
        yield "end", f"{wrong}; give spheres along the capsule"


def _in_series(wall: Surface, name: str) -> str:
    return f"a bumper in series with the {wall.contact} contact of {name} is not computed"


def ends_of(body: ContactBody, wall: Surface) -> Iterator[np.ndarray]:
    ends = (body.position, body.position if body.end is None else body.end)
    if body.end is not None and SHAPES[wall.shape].size is None:
        yield from (np.array([end, end]) for end in ends)
    else:
        yield np.array(ends)
