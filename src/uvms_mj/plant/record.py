"""A vehicle as numbers, and its MJCF. Sources of other formats are read into a :class:`VehicleRecord`.

All numbers are SI, in the frame of the body to which they belong: of the base B, forward, left, up; of a link its own.
Matrices are about the origin of that frame and positive, the inertia about the centre of gravity.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from xml.sax.saxutils import quoteattr

import numpy as np

from .coefficients import DERIVATIVES
from .geometry import Shape
from .own_vehicle import Thruster, across


@dataclass(frozen=True, eq=False)
class PartRecord:
    """A rigid body in the water: the base, or a link.

    Attributes:
        name: of the body.
        mass: [kg].
        r_g: (3,) centre of gravity [m].
        I_g: (3, 3) inertia about the centre of gravity, entries of the matrix [kg m^2].
        M_A, D_linear, D_quadratic: (6, 6), as in :mod:`.coefficients`.
        displaced_mass: [kg].
        r_b: (3,) centre of buoyancy [m].
        shapes: for the eye.
    """

    name: str
    mass: float
    r_g: np.ndarray
    I_g: np.ndarray
    M_A: np.ndarray
    D_linear: np.ndarray
    D_quadratic: np.ndarray
    displaced_mass: float
    r_b: np.ndarray
    shapes: tuple[Shape, ...] = ()


@dataclass(frozen=True, eq=False)
class LinkRecord(PartRecord):
    """A link and its joint, a hinge or a slide.

    Attributes:
        parent: name of the body that carries it.
        joint: name of the joint.
        slide: whether the joint slides.
        position, quat: (3,), (4,) pose of its frame in the parent's at q = 0 [m], w x y z.
        axis, anchor: (3,) of the joint in its frame [1, m].
        limits: of q [rad or m]; None without limits.
        effort: greatest torque of the motor [N m or N], infinite without a limit; None without a motor.
        speed_limit: [rad/s or m/s]; None without one.
        damping, friction: of the gear [N m s, N m, or N s/m, N].
        sites: names and places (3,) [m] in its frame, where a tool may be.
    """

    parent: str = ""
    joint: str = ""
    slide: bool = False
    position: np.ndarray = field(default_factory=lambda: np.zeros(3))
    quat: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    axis: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    anchor: np.ndarray = field(default_factory=lambda: np.zeros(3))
    limits: tuple[float, float] | None = None
    effort: float | None = None
    speed_limit: float | None = None
    damping: float = 0.0
    friction: float = 0.0
    sites: tuple[tuple[str, np.ndarray], ...] = ()


@dataclass(frozen=True, eq=False)
class VehicleRecord:
    """A vehicle.

    Attributes:
        base: in B.
        thrusters: in B.
        links: each behind the link that carries it.
        products: coefficients of products of velocities by their names, as in :mod:`.products`.
        description, source, licence, trust: texts.
        left_out: losses against its source, and decisions: a sentence each.
    """

    base: PartRecord
    thrusters: tuple[Thruster, ...]
    links: tuple[LinkRecord, ...] = ()
    products: dict[str, float] = field(default_factory=dict)
    description: str = ""
    source: str = ""
    licence: str = ""
    trust: str = ""
    left_out: tuple[str, ...] = ()


_INDENT = "      "
_ROUNDING = 1e-15
"""Numbers below this, relative to the greatest of their array, are zeros that were computed."""


def word(name: str) -> str:
    """A name that MJCF and our keys take: ``rexrov/base_link`` becomes ``rexrov_base_link``."""
    found = re.sub(r"\W", "_", name, flags=re.ASCII).strip("_")
    return found if found[:1].isalpha() else f"n{found}"


def mjcf_text(record: VehicleRecord) -> str:
    """The MJCF of a vehicle, with the list of what was left out in its head."""
    name = record.base.name
    return "\n".join(
        [
            *_head(record),
            f"<mujoco model={quoteattr(name)}>",
            '  <compiler angle="radian" eulerseq="XYZ"/>',
            '  <option integrator="Euler" timestep="0.0001" cone="elliptic" gravity="0 0 -9.81"/>',
            "  <custom>",
            *_texts(record),
            *_water("", record.base),
            *(line for link in record.links for line in _link_numbers(link)),
            "  </custom>",
            "  <default>",
            '    <geom mass="0" contype="0" conaffinity="0"/>',
            "  </default>",
            "  <worldbody>",
            f'    <body name={quoteattr(name)} simple="false">',
            f"      <freejoint name={quoteattr(name)}/>",
            _inertial(record.base),
            *_shapes(record.base.shapes),
            *map(_site, record.thrusters),
            *_children(record, name, _INDENT),
            "    </body>",
            "  </worldbody>",
            "  <actuator>",
            *map(_motor, record.thrusters),
            *(_joint_motor(link) for link in record.links if link.effort is not None),
            "  </actuator>",
            "</mujoco>",
            "",
        ]
    )


def numbers(values: Sequence[float] | np.ndarray) -> str:
    """Numbers side by side, each with all its digits; computed zeros are zeros."""
    array = np.asarray(values, float).ravel()
    least = _ROUNDING * max(np.abs(array).max(initial=0.0), 1.0)
    return " ".join("0" if abs(x) < least else repr(float(x)).removesuffix(".0") for x in array)


def _head(record: VehicleRecord) -> Iterator[str]:
    name = record.base.name
    yield "<!--"
    yield f"  {name}: {_remark(record.description)}"
    yield ""
    yield f"  uvms-mj vehicles {name}.xml --check        its speeds, trim and decay: a wrong sign shows there"
    yield f"  uvms-mj run vehicle.model={name}.xml"
    yield ""
    yield "  Body frame B: x forward, y left, z up. SI units. Matrices are about B's origin, row by row."
    if record.left_out:
        yield ""
        yield "  What was left out of the source, and what was decided:"
        yield from (f"  * {_remark(each)}" for each in record.left_out)
    yield "-->"


def _remark(text: str) -> str:
    return re.sub(r"-(?=-)|-$", "- ", " ".join(text.split()))


def _texts(record: VehicleRecord) -> Iterator[str]:
    for key in ("description", "source", "licence", "trust"):
        text = " ".join(getattr(record, key).split()) or ("not known" if key != "description" else record.base.name)
        yield f'    <text name="{key}" data={quoteattr(text)}/>'
    if record.products:
        terms = " ".join(f"{name} {numbers([c])}" for name, c in record.products.items())
        yield f'    <text name="products" data={quoteattr(terms)}/>'


def _water(prefix: str, part: PartRecord) -> Iterator[str]:
    yield f'    <numeric name="{prefix}displaced_mass" data="{numbers([part.displaced_mass])}"/>'
    yield f'    <numeric name="{prefix}center_of_buoyancy" data="{numbers(part.r_b)}"/>'
    for matrix, names in DERIVATIVES.items():
        M = getattr(part, matrix)
        if np.array_equal(M, np.diag(np.diag(M))):
            row = (f'<numeric name="{prefix}{names[i, i]}" data="{numbers([-M[i, i]])}"/>' for i in range(6))
            yield f"    {' '.join(row)}"
        else:
            rows = f"\n{' ' * 10}".join(numbers(each) for each in M)
            yield f'    <numeric name="{prefix}{matrix}" data="\n{" " * 10}{rows}"/>'


def _link_numbers(link: LinkRecord) -> Iterator[str]:
    yield from _water(f"{link.name}.", link)
    if link.speed_limit is not None:
        yield f'    <numeric name="{link.joint}.speed_limit" data="{numbers([link.speed_limit])}"/>'


def _inertial(part: PartRecord) -> str:
    I_g = part.I_g
    six = numbers([I_g[0, 0], I_g[1, 1], I_g[2, 2], I_g[0, 1], I_g[0, 2], I_g[1, 2]])
    return f'{_INDENT}<inertial mass="{numbers([part.mass])}" pos="{numbers(part.r_g)}" fullinertia="{six}"/>'


_COUNTED = {"sphere": 1, "capsule": 2, "cylinder": 2}


def _shapes(shapes: Sequence[Shape]) -> Iterator[str]:
    for each in shapes:
        size = numbers(each.size[: _COUNTED.get(each.kind, 3)])
        pose = f'pos="{numbers(each.position)}" quat="{numbers(each.quat)}"'
        yield f'{_INDENT}<geom type="{each.kind}" size="{size}" {pose} rgba="{numbers(each.rgba)}"/>'


def _site(thruster: Thruster) -> str:
    axes = f"{numbers(thruster.direction)} {numbers(across(np.array(thruster.direction)))}"
    return f'{_INDENT}<site name="{thruster.name}" pos="{numbers(thruster.position)}" xyaxes="{axes}"/>'


def _motor(thruster: Thruster) -> str:
    limits = 'ctrllimited="false"' if thruster.limits is None else f'ctrlrange="{numbers(thruster.limits)}"'
    return f'    <motor name="{thruster.name}" site="{thruster.name}" gear="1 0 0 0 0 0" {limits}/>'


def _joint_motor(link: LinkRecord) -> str:
    assert link.effort is not None
    limits = (
        f'ctrlrange="{numbers([-link.effort, link.effort])}"' if np.isfinite(link.effort) else 'ctrllimited="false"'
    )
    return f'    <motor name="{link.joint}" joint="{link.joint}" gear="1" {limits}/>'


def _children(record: VehicleRecord, parent: str, indent: str) -> Iterator[str]:
    for link in record.links:
        if link.parent != parent:
            continue
        yield f'{indent}<body name="{link.name}" pos="{numbers(link.position)}" quat="{numbers(link.quat)}">'
        kind = "slide" if link.slide else "hinge"
        more = "" if link.limits is None else f' range="{numbers(link.limits)}"'
        more += f' damping="{numbers([link.damping])}"' if link.damping else ""
        more += f' frictionloss="{numbers([link.friction])}"' if link.friction else ""
        place = f'axis="{numbers(link.axis)}" pos="{numbers(link.anchor)}"'
        yield f'{indent}  <joint name="{link.joint}" type="{kind}" {place}{more}/>'
        yield f"{indent}  {_inertial(link).strip()}"
        yield from (f"{indent}  {each.strip()}" for each in _shapes(link.shapes))
        yield from (f'{indent}  <site name="{name}" pos="{numbers(place)}"/>' for name, place in link.sites)
        yield from _children(record, link.name, f"{indent}  ")
        yield f"{indent}</body>"
