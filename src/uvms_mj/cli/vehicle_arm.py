"""The arm of a vehicle in the output of ``uvms-mj vehicles``: joints, links, and the sites that can be the tool."""

import math
from typing import TYPE_CHECKING, Any

from .common import printable
from .console import facts, print_table, table_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..plant.arm import Arm
    from ..plant.vehicle import Vehicle

MATRICES = ("M_RB", "M_A", "D_linear", "D_quadratic")


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
            "range": [_finite(x) for x in link.range],
            "motor": link.actuator_id >= 0,
            "effort": _finite(link.effort),
            "speed_limit": _finite(link.speed_limit),
            **{word: getattr(link, word) for word in ("damping", "friction", "armature", "mass", "displaced_mass")},
            "center_of_gravity": link.r_g.tolist(),
            "center_of_buoyancy": link.r_b.tolist(),
            **{matrix: getattr(link, matrix).tolist() for matrix in MATRICES},
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
    import numpy as np

    at, link = arm.sites[site].p, arm.sites[site].link
    total = 0.0
    while link >= 0:
        joint = arm.links[link]
        total += float(np.linalg.norm(at - joint.anchor))
        if joint.slide:
            total += max(map(abs, joint.range))
        at, link = joint.p_0 + joint.R_0 @ joint.anchor, joint.parent
    return _finite(total)


def _finite(limit: float) -> float | None:
    return float(limit) if math.isfinite(limit) else None


def print_arm(about: dict[str, Any], matrix: "Callable[[list[list[float]]], str]") -> None:
    """Print joints, links and sites of a vehicle that :func:`described_arm` describes."""
    columns = ("joint", "moves", "type", "range", "motor", "speed limit", "gear friction", "armature")
    table = table_of("Joints, from the base outwards", *columns, fixed=("joint", "moves"), min_width=80)
    for link in about["links"]:
        table.add_row(printable(link["joint"]), printable(link["name"]), link["type"], *_joint(link))
    print_table(table)
    for link in about["links"]:
        table = facts(printable(f"Link {link['name']}, carried by {link['carried_by']}"))
        table.add_row("mass, displaced mass", f"{link['mass']:.6g} kg, {link['displaced_mass']:.6g} kg")
        for word in ("gravity", "buoyancy"):
            numbers = " ".join(f"{round(x, 9) + 0.0:.6g}" for x in link[f"center_of_{word}"])
            table.add_row(f"centre of {word}", f"{numbers} m")
        for name in MATRICES:
            table.add_row(name, matrix(link[name]))
        if link["strip_theory"]:
            table.add_row("by strip theory", f"{', '.join(link['strip_theory'])}: from its capsules and cylinders")
        print_table(table)
    if about["sites"]:
        heads = ("site", "carried by", "position [m]", "radius [m]", "reach from the first joint [m]")
        table = table_of("Sites that can be the tool: --set task.frame=NAME", *heads, fixed=("site",), min_width=80)
        for name, site in about["sites"].items():
            position = " ".join(f"{round(x, 9) + 0.0:.6g}" for x in site["position"])
            far = "without limit" if site["reach"] is None else f"at most {site['reach']:.4g}"
            table.add_row(printable(name), printable(site["carried_by"]), position, f"{site['radius']:.4g}", far)
        print_table(table)


def _joint(link: dict[str, Any]) -> tuple[str, ...]:
    """Range, motor, speed limit, friction and armature of a joint, with their units."""
    turns = link["type"] == "hinge"
    place, torque, scale = ("deg", "N m", 180.0 / math.pi) if turns else ("m", "N", 1.0)
    least, greatest = link["range"]
    limits = "none" if least is None or greatest is None else f"{scale * least:.4g} .. {scale * greatest:.4g} {place}"
    motor = "none" if not link["motor"] else "no limit" if link["effort"] is None else f"{link['effort']:.4g} {torque}"
    speed = "none" if link["speed_limit"] is None else f"{scale * link['speed_limit']:.4g} {place}/s"
    friction = f"{link['damping']:.4g} {torque} s{'' if turns else '/m'}, {link['friction']:.4g} {torque}"
    return limits, motor, speed, friction, f"{link['armature']:.4g} {'kg m^2' if turns else 'kg'}"
