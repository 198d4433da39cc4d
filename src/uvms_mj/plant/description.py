"""Facts about a vehicle, as numbers and as the rows of a table. ``uvms-mj vehicles`` and notebooks show them."""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..physics.spanned_axes import axes_spanned

if TYPE_CHECKING:
    from .arm import Arm
    from .mjcf import Mjcf
    from .vehicle import Vehicle

MATRICES = ("M_RB", "M_A", "D_linear", "D_quadratic")
REMARKS = ("description", "source", "licence", "trust")
"""``<text>`` entries of a vehicle's file with its description and the sources of its numbers."""


def described(mjcf: "Mjcf") -> dict[str, Any]:
    """Facts about a vehicle, as numbers, texts and lists: SI units, body frame B.

    Of each thruster ``wrench`` is its column of B, the wrench of 1 N of thrust, or of 1 N m if it is a pure moment. A
    limit is None if there is none. Coefficients describe the base; links have their own. Raises InputError if the
    file is not one physical vehicle.
    """
    vehicle, remarks = mjcf.vehicle, mjcf.remarks
    prefix = vehicle.body[: vehicle.body.rfind("/") + 1]  # of a model that the file attaches
    names = [name or f"thruster {i + 1}" for i, name in enumerate(vehicle.thrusters)]
    columns = zip(names, vehicle.B.T, vehicle.u_min, vehicle.u_max, strict=True)
    return {
        **{word: remarks.get(word) or remarks.get(prefix + word, "") for word in REMARKS},
        "reach": float(mjcf.geometry.reach),
        **coefficients(vehicle),
        "products": {each.name: each.coefficient for each in vehicle.products},
        "axes": axes_spanned(vehicle.B),
        "thrusters": {
            name: {"wrench": wrench.tolist(), "least": finite(least), "greatest": finite(greatest)}
            for name, wrench, least, greatest in columns
        },
        **described_arm(vehicle),
    }


def coefficients(body: Any) -> dict[str, Any]:
    """Mass, water and matrices of a base or a link."""
    return {
        "mass": body.mass,
        "displaced_mass": body.displaced_mass,
        "center_of_gravity": body.r_g.tolist(),
        "center_of_buoyancy": body.r_b.tolist(),
        **{matrix: getattr(body, matrix).tolist() for matrix in MATRICES},
    }


def described_arm(vehicle: "Vehicle") -> dict[str, Any]:
    """Links with their joints, and sites, as numbers, texts and lists: SI units, in the frame of each link. A limit is
    None if there is none. ``strip_theory`` has the coefficients that are not in the file."""
    arm = vehicle.arm
    names = [vehicle.body, *(link.name for link in arm.links)]
    links = [
        {
            "name": link.name,
            "joint": link.joint,
            "type": "slide" if link.slide else "hinge",
            "carried_by": names[link.parent + 1],
            "range": [finite(x) for x in link.range],
            "motor": link.actuator_id >= 0,
            "effort": finite(link.effort),
            "speed_limit": finite(link.speed_limit),
            **{word: getattr(link, word) for word in ("damping", "friction", "armature")},
            **coefficients(link),
            "strip_theory": list(link.filled_in),
        }
        for link in arm.links
    ]
    sites = {
        name: {"carried_by": names[site.link + 1], "position": site.p.tolist(), "radius": site.radius}
        for name, site in arm.sites.items()
        if name not in vehicle.thrusters
    }
    for name, each in sites.items():
        each["reach"] = reach(arm, name)
    return {"links": links, "sites": sites}


def reach(arm: "Arm", site: str) -> float | None:
    """Bound on the distance between a site and the anchor of the first joint that moves it [m], with all joints at the
    best place; None if a slide without limits is between them. It is reached if the arm can be stretched."""
    at, link = arm.sites[site].p, arm.sites[site].link
    total = 0.0
    while link >= 0:
        joint = arm.links[link]
        total += float(np.linalg.norm(at - joint.anchor))
        if joint.slide:
            total += max(map(abs, joint.range))
        at, link = joint.p_0 + joint.R_0 @ joint.anchor, joint.parent
    return finite(total)


def finite(limit: float) -> float | None:
    return float(limit) if math.isfinite(limit) else None


def rows(about: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names and values of the table of a vehicle, from :func:`described`: its remarks and its base's coefficients."""
    for word in REMARKS[1:]:
        yield word, remark(about, word)
    if about["links"]:
        whole = [sum(part[word] for part in (about, *about["links"])) for word in ("mass", "displaced_mass")]
        yield "with its links", f"{whole[0]:.6g} kg, {whole[1]:.6g} kg; all that follows is the base's alone"
    yield from coefficient_rows(about, ("front, on x", f"{about['reach']:.6g} m"))
    if about["products"]:
        yield "products", ", ".join(f"{name} {c:.6g}" for name, c in about["products"].items())


def coefficient_rows(about: Mapping[str, Any], *more: tuple[str, str]) -> Iterator[tuple[str, str]]:
    """Names and values of the numbers of :func:`coefficients`, with further ones before the matrices."""
    yield "mass, displaced mass", f"{about['mass']:.6g} kg, {about['displaced_mass']:.6g} kg"
    for word in ("gravity", "buoyancy"):
        yield f"centre of {word}", f"{numbers_text(about[f'center_of_{word}'])} m"
    yield from more
    for name in MATRICES:
        yield name, _matrix(about[name])


def remark(each: Mapping[str, Any], word: str) -> str:
    """One of :data:`REMARKS`, or how to give it."""
    return each[word] or f'{word} not given: <text name="{word}" data="..."/> in <custom>'


def numbers_text(values: list[float]) -> str:
    """Numbers with six digits, side by side."""
    return " ".join(f"{round(x, 9) + 0.0:.6g}" for x in values)


def _matrix(rows: list[list[float]]) -> str:
    """The diagonal, and the cross terms by row and column, counted from one as in the literature."""
    entries = ((i, j, x) for i, row in enumerate(rows) for j, x in enumerate(row) if i != j and abs(x) > 1e-12)
    cross = [f"({i + 1},{j + 1}) {x:.6g}" for i, j, x in entries]
    diagonal = f"diag {numbers_text([row[i] for i, row in enumerate(rows)])}"
    return diagonal if not cross else f"{diagonal}\n{', '.join(cross)}"
