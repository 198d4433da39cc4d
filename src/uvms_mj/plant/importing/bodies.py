"""Links and joints of a description, put together: bodies welded to the base, and the links of an arm.

The link with the hydrodynamics is the base, and its frame is B. Links on fixed joints, propellers and fins are welded
to the link that carries them, with their masses. Each other hinge or slide carries a link of our vehicle, with what is
welded to it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..coefficients import DENSITY
from ..own_vehicle import Thruster
from ..record import LinkRecord, PartRecord, VehicleRecord, word
from .moving import HERE, Pose, about_cg, moved, product_name, quarter_turn
from .reading import Source
from .shapes import Solid

ASYMMETRY = 0.01
"""Greatest difference of an added mass from its transpose that is rounded to the mean, relative to its two axes."""
HINGES, SLIDES = ("revolute", "continuous"), ("prismatic",)


@dataclass(eq=False)
class Water:
    """The water of one link, about the origin of its frame, in its axes.

    Attributes:
        M_A, D_linear, D_quadratic: (6, 6), positive.
        products: coefficients by axis, first and second velocity, and bars.
        displaced_mass: [kg]; None: from the volumes of the shapes.
        r_b: (3,) centre of buoyancy [m].
        neutral: whether the displaced mass is the mass of the link with what is fixed to it.
    """

    M_A: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))
    D_linear: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))
    D_quadratic: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))
    products: dict[tuple[int, int, int, bool], float] = field(default_factory=dict)
    displaced_mass: float | None = None
    r_b: np.ndarray = field(default_factory=lambda: np.zeros(3))
    neutral: bool = False


@dataclass(eq=False)
class Link:
    """A link of a description, in its own frame: mass [kg], centre of gravity (3,) [m], inertia (3, 3) about it."""

    name: str
    place: str
    mass: float = 0.0
    r_g: np.ndarray = field(default_factory=lambda: np.zeros(3))
    I_g: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    solids: list[Solid] = field(default_factory=list)
    drawn: list[Solid] = field(default_factory=list)


@dataclass(eq=False)
class Joint:
    """A joint: the pose of the child link's frame in the parent link's at q = 0, and in the child's frame the axis
    (3,) and a point on it (3,) [m]."""

    name: str
    place: str
    kind: str
    parent: str
    child: str
    pose: Pose
    axis: np.ndarray
    anchor: np.ndarray
    limits: tuple[float, float] | None = None
    effort: float | None = None
    speed_limit: float | None = None
    damping: float = 0.0
    friction: float = 0.0
    welded: str = ""
    """The part that turns on it, if it is welded: a propeller, or a fin."""

    @property
    def held(self) -> bool:
        """Whether its limits leave it no motion, as joints of sensors in the UUV Simulator."""
        return self.limits is not None and self.limits[1] - self.limits[0] < 1e-9


@dataclass(eq=False)
class Description:
    """The contents of a file. ``density`` is the water's [kg/m^3]."""

    source: Source
    name: str
    base: str
    links: dict[str, Link]
    joints: list[Joint]
    water: dict[str, Water]
    density: float = DENSITY
    thrusters: list[tuple[str, str, np.ndarray, np.ndarray, tuple[float, float] | None]] = field(default_factory=list)
    """Name, link, place (3,) and direction (3,) in the link's frame, and limits of each thruster."""
    from_volume: bool = False
    """Whether the links displace the volume of their shapes, as under gz-sim's Buoyancy."""


def assembled(about: Description) -> VehicleRecord:
    """The vehicle of a description. Raises InputError, with the place of what is wrong."""
    source = about.source
    groups, carriers = _groups(about)
    base = _part(about, about.base, groups[about.base], base=True)
    links = []
    for root, joint in carriers.items():
        frame, parent = groups[joint.parent_root][joint.joint.parent] @ joint.joint.pose, joint.parent_root
        part = _part(about, root, groups[root], base=False)
        given = joint.joint
        links.append(
            LinkRecord(
                **{each: getattr(part, each) for each in PartRecord.__dataclass_fields__},
                parent=word(parent) if parent != about.base else base.name,
                joint=word(given.name),
                slide=given.kind in SLIDES,
                position=frame.p,
                quat=frame.quat,
                axis=given.axis,
                anchor=given.anchor,
                limits=given.limits if given.kind != "continuous" else None,
                effort=given.effort,
                speed_limit=given.speed_limit,
                damping=given.damping,
                friction=given.friction,
                sites=tuple((word(name), pose.p) for name, pose in groups[root].items() if name != root),
            )
        )
    thrusters = []
    for name, link, place, direction, limits in about.thrusters:
        root = next((each for each, members in groups.items() if link in members), None)
        if root != about.base:
            raise source.fault(
                f"thruster {name}", f"is on the link {link!r}, which moves on a joint; thrusters are on the base"
            )
        pose = groups[about.base][link]
        a, b, c = (pose.R @ direction / np.linalg.norm(direction)).tolist()
        x, y, z = pose.point(place).tolist()
        thrusters.append(Thruster(word(name), (x, y, z), (a, b, c), limits))
    products = _products(about, groups)
    return VehicleRecord(base, tuple(thrusters), tuple(links), products)


@dataclass(eq=False)
class _Carrier:
    joint: Joint
    parent_root: str


def _groups(about: Description) -> tuple[dict[str, dict[str, Pose]], dict[str, _Carrier]]:
    """The links that are welded together, by the first link of each group, with their poses in its frame; and the joint
    that carries each group but the base's, from the base outwards."""
    source = about.source
    below: dict[str, list[Joint]] = {}
    carried: dict[str, Joint] = {}
    for joint in about.joints:
        for end in (joint.parent, joint.child):
            if end not in about.links and end != "world":
                raise source.fault(joint.place, f"joins the link {end!r}, which is not in the file")
        if joint.child in carried:
            other = carried[joint.child].name
            raise source.fault(
                joint.place, f"carries {joint.child!r}, as {other!r} does: loops of joints are not computed"
            )
        if joint.kind not in (*HINGES, *SLIDES, "fixed"):
            raise source.fault(
                joint.place, f"is {joint.kind!r}: a joint is fixed, a hinge or a slide; chain hinges for a ball"
            )
        if joint.parent == joint.child:
            raise source.fault(joint.place, f"joins {joint.parent!r} with itself")
        carried[joint.child] = joint
        below.setdefault(joint.parent, []).append(joint)
    groups: dict[str, dict[str, Pose]] = {about.base: {about.base: HERE}}
    carriers: dict[str, _Carrier] = {}
    seen = {about.base, "world"}

    def weld(root: str, name: str) -> None:
        for joint in below.get(name, ()):
            if joint.child in seen:
                raise source.fault(joint.place, f"leads back to {joint.child!r}: loops of joints are not computed")
            seen.add(joint.child)
            if joint.kind == "fixed" or joint.welded or joint.held:
                if joint.welded and joint.kind != "fixed" and about.links[joint.child].mass > 0.0:
                    mass = about.links[joint.child].mass
                    source.say(f"{joint.welded}, {mass:.4g} kg, doesn't turn here: it is part of the body", joint.child)
                groups[root][joint.child] = groups[root][name] @ joint.pose
                weld(root, joint.child)
            else:
                groups[joint.child] = {joint.child: HERE}
                carriers[joint.child] = _Carrier(joint, root)
                weld(joint.child, joint.child)

    top, above = about.base, [about.base]
    while (joint := carried.get(top)) and joint.parent != "world":  # a footprint that carries the base
        if joint.kind != "fixed":
            raise source.fault(
                joint.place, f"moves {top!r}, the link with the hydrodynamics; it must be fixed or left out"
            )
        if joint.parent in above:
            raise source.fault(joint.place, f"leads back to {joint.parent!r}: loops of joints are not computed")
        groups[about.base][joint.parent] = groups[about.base][top] @ joint.pose.inverse()
        top = joint.parent
        above.append(top)
        seen.add(top)
    for name in above:
        below[name] = [joint for joint in below.get(name, ()) if joint.child not in above]
    for name in above:
        weld(about.base, name)
    for name in about.links:
        if name not in seen:
            link = about.links[name]
            if link.mass > 0.0 or name in about.water:
                source.say(f"{link.mass:.4g} kg that hang on no joint of the base: left out", name)
    return groups, carriers


def _part(about: Description, root: str, members: Mapping[str, Pose], base: bool) -> PartRecord:
    """The numbers of a group of links about the origin of its first link."""
    source, place = about.source, about.links[root].place
    mass, moment, I_o = 0.0, np.zeros(3), np.zeros((3, 3))
    water, displaced, lift = Water(), 0.0, np.zeros(3)
    shapes = []
    for name, pose in members.items():
        link = about.links[name]
        r_g, I_g = pose.point(link.r_g), pose.R @ link.I_g @ pose.R.T
        mass, moment = mass + link.mass, moment + link.mass * r_g
        I_o = I_o + I_g + link.mass * (r_g @ r_g * np.eye(3) - np.outer(r_g, r_g))
        given = about.water.get(name)
        if given is not None:
            water.M_A = water.M_A + moved(given.M_A, pose)
            water.D_linear = water.D_linear + moved(given.D_linear, pose)
            water.D_quadratic = water.D_quadratic + _turned(about, name, given.D_quadratic, pose)
        here, centre = _displaced(about, link, given, [about.links[each] for each in members if _rigid(about, each)])
        displaced, lift = displaced + here, lift + here * pose.point(centre)
        drawn = link.drawn or link.solids
        shapes += [shape for each in drawn if (shape := each.shape(pose)) is not None]
        unread = [each for each in drawn if each.kind is None]
        if len(unread) == len(drawn):  # the collision shapes would stand for them
            unread += [each for each in link.solids if each.kind is None]
        for reason in dict.fromkeys(each.reason for each in unread):
            source.say(f"{reason}: it is not drawn", name)
    if mass <= 0.0:
        what = "the base" if base else "a link that moves on a joint"
        raise source.fault(place, f"is {what} and has no mass")
    M_A = symmetric(source, water.M_A, place, "added mass")
    r_g = moment / mass
    I_g = possible(source, about_cg(I_o, mass, r_g), f"the body of {root!r}")
    if base and displaced <= 0.0:
        reasons = {each.reason for name in members for each in about.links[name].solids if each.reason}
        why = f": {'; '.join(sorted(reasons))}" if reasons else ": no collision shape has a volume"
        raise source.fault(
            place, f"displaces no water{why}. Give it a shape with its volume, or its mesh as a closed STL or OBJ"
        )
    if not base and root not in about.water:
        ways = "NAME.strip_theory in place of its M_A takes it from its cylinders"
        source.say(f"a link without added mass and drag in the source: weight and buoyancy act alone; {ways}", root)
    name = word(about.name) if base else word(root)
    r_b = lift / displaced if displaced else np.zeros(3)
    return PartRecord(name, mass, r_g, I_g, M_A, water.D_linear, water.D_quadratic, displaced, r_b, tuple(shapes))


def _rigid(about: Description, name: str) -> bool:
    """Whether a link is fixed to its carrier, and not a propeller or a fin."""
    return not any(joint.child == name and joint.welded and joint.kind != "fixed" for joint in about.joints)


def _displaced(about: Description, link: Link, water: Water | None, fixed: list[Link]) -> tuple[float, np.ndarray]:
    """Displaced mass [kg] and its centre (3,) in the link's frame."""
    if water is not None and water.neutral:
        return sum(each.mass for each in fixed), water.r_b
    if water is not None and water.displaced_mass is not None:
        return water.displaced_mass, water.r_b
    if not about.from_volume:
        return 0.0, np.zeros(3)
    for each in link.solids:
        if each.volume is None:
            about.source.say(f"{each.reason}: it displaces no water here", link.name)
    known = [(each.volume, each.centroid) for each in link.solids if each.volume]
    volume = sum(each for each, _ in known)
    centre = sum((each * r for each, r in known), np.zeros(3))
    return about.density * volume, centre / volume if volume else centre


def _turned(about: Description, name: str, D: np.ndarray, pose: Pose) -> np.ndarray:
    """D_quadratic of a welded link in the axes of the body that carries it. Losses are said."""
    if not D.any():
        return D
    R = quarter_turn(pose.R)
    if R is None or np.abs(pose.p).max() > 1e-9:
        about.source.say(
            "its quadratic damping is left out: it acts at another point or in other axes than its carrier's; [[drag]] "
            "of a scenario acts at a place",
            name,
        )
        return np.zeros((6, 6))
    P = np.kron(np.eye(2), R)
    return P @ D @ P.T


def _products(about: Description, groups: Mapping[str, Mapping[str, Pose]]) -> dict[str, float]:
    """The products of the base by their names. Products of other links are left out, and said."""
    for name, water in about.water.items():
        if name != about.base and water.products:
            about.source.say(
                f"link {name!r}: its {len(water.products)} products of velocities are left out: the base has them alone"
            )
    water = about.water.get(about.base, Water())
    found = {key: c for key, c in water.products.items() if c}
    return {product_name(*key): c for key, c in found.items()}


def symmetric(source: Source, M: np.ndarray, place: str, noun: str) -> np.ndarray:
    """The mean of M_A (6, 6) and its transpose, which is said. Raises InputError for differences beyond rounding."""
    apart = np.abs(M - M.T)
    if not apart.any():
        return M
    axes = np.sqrt(np.abs(np.outer(np.diag(M), np.diag(M))))
    i, j = np.unravel_index(np.argmax(apart), apart.shape)
    pair = f"row {i + 1}, column {j + 1} has {M[i, j]:.9g}, row {j + 1}, column {i + 1} {M[j, i]:.9g}"
    if (apart > ASYMMETRY * axes).any():
        raise source.fault(place, f"its {noun} must be symmetric: {pair}; correct one of them")
    if apart.max() > 1e-9 * np.abs(M).max():
        source.say(f"the {noun} of the source is not symmetric, {pair}: the mean is taken")
    return (M + M.T) / 2.0


def possible(source: Source, I_g: np.ndarray, what: str) -> np.ndarray:
    """An inertia (3, 3) that a body can have: the greatest principal moment is at most the sum of the others. If it is
    greater, it becomes the sum, and this is said."""
    I_g = (I_g + I_g.T) / 2.0
    values, vectors = np.linalg.eigh(I_g)
    if values[0] <= 0.0:
        raise source.fault(what, f"its principal moments of inertia are {_three(values)}: they must be positive")
    if values[2] <= values[0] + values[1]:
        return I_g
    source.say(
        f"inertia of {what}: no body has the principal moments {_three(values)} kg m^2, since the greatest exceeds the "
        f"sum of the others; it is written as {values[0] + values[1]:.6g}. Correct the source if you can"
    )
    values[2] = (values[0] + values[1]) * (1.0 - 1e-12)
    return vectors @ np.diag(values) @ vectors.T


def _three(values: np.ndarray) -> str:
    return ", ".join(f"{x:.6g}" for x in values)


def right_signs(source: Source, M: np.ndarray, noun: str, place: str, convention: str) -> np.ndarray:
    """A matrix (6, 6) whose diagonal must not be negative. If all its entries have the other sign, the whole matrix is
    turned, and this is said. Raises InputError if some have."""
    diagonal = np.diag(M)
    wrong = diagonal < 0.0
    if not wrong.any():
        return M
    axes = [axis for axis, each in zip("XYZKMN", wrong, strict=True) if each]
    if (diagonal > 0.0).any():
        said = f"its {noun} has the wrong sign in {', '.join(axes)} and the right one in other axes"
        raise source.fault(place, f"{said}; {convention}: correct these entries")
    source.say(f"the {noun} has the other sign in the source ({convention}): the whole matrix is turned")
    return -M
