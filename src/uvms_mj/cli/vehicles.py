"""``uvms-mj vehicles``: the vehicles that ship, or the numbers of a vehicle's file."""

import json
import math
from typing import TYPE_CHECKING, Any

import click

from .common import bad_input, printable
from .console import facts, print_table, table_of, warn
from .options import command, json_option

if TYPE_CHECKING:
    from ..plant.arm import Arm
    from ..plant.mjcf import Mjcf
    from ..plant.vehicle import Vehicle


MATRICES = ("M_RB", "M_A", "D_linear", "D_quadratic")
REMARKS = ("description", "source", "licence", "trust")
"""``<text>`` entries of a vehicle's file that say what it is and where its numbers come from."""


@command()
@click.argument("names", nargs=-1, metavar="[VEHICLE]...")
@json_option
def vehicles(names: tuple[str, ...], as_json: bool) -> None:
    """List the vehicles that ship with their source, licence and trust, or the numbers of each VEHICLE, which may be
    path/to/vehicle.xml.

    \b
    uvms-mj vehicles
    uvms-mj vehicles bluerov2_heavy
    uvms-mj run --set vehicle.model=bluerov2_heavy
    """
    with bad_input():
        from ..files import shipped
        from ..plant.mjcf import Mjcf
        from ..plant.vehicle import notes_on_damping

        found = {name: Mjcf.find(name) for name in names or shipped("models")}
        about = {name: described(mjcf) for name, mjcf in found.items()}
    if as_json:
        click.echo(json.dumps(about, allow_nan=False))
        return
    if not names:
        _print_list(about)
        return
    for name, mjcf in found.items():
        _print_one(name, about[name])
        for note in notes_on_damping(mjcf.vehicle):
            warn(note)


def described(mjcf: "Mjcf") -> dict[str, Any]:
    """What is known of a vehicle, as numbers, texts and lists: SI units, body frame B.

    Of each thruster ``wrench`` is its column of B, the wrench of 1 N of thrust, or of 1 N m if it is a pure moment. A
    limit is None if there is none. Coefficients are those of the base; links have their own. Raises InputError if the
    file is not one physical vehicle.
    """
    import numpy as np

    vehicle, remarks = mjcf.vehicle, mjcf.remarks
    prefix = vehicle.body[: vehicle.body.rfind("/") + 1]  # of a model that the file attaches
    names = [name or f"thruster {i + 1}" for i, name in enumerate(vehicle.thrusters)]
    columns = zip(names, vehicle.B.T, vehicle.u_min, vehicle.u_max, strict=True)
    return {
        **{word: remarks.get(word) or remarks.get(prefix + word, "") for word in REMARKS},
        "reach": float(mjcf.geometry.reach),
        **coefficients(vehicle),
        "axes": int(np.linalg.matrix_rank(vehicle.B)),
        "thrusters": {
            name: {"wrench": wrench.tolist(), "least": finite(least), "greatest": finite(greatest)}
            for name, wrench, least, greatest in columns
        },
        **described_arm(vehicle),
    }


def _print_list(about: dict[str, dict[str, Any]]) -> None:
    title = "Vehicles: --set vehicle.model=NAME; `uvms-mj vehicles NAME` lists the numbers of one"
    columns = ("name", "mass, displaced [kg]", "thrusters", "axes", "joints", "source, licence, trust")
    table = table_of(title, *columns, fixed=("name",), min_width=80)
    for name, each in about.items():
        parts = [each, *each["links"]]
        masses = ", ".join(f"{sum(part[word] for part in parts):.4g}" for word in ("mass", "displaced_mass"))
        remarks = "\n".join(_remark(each, word) for word in REMARKS[1:])
        numbers = str(len(each["thrusters"])), f"{each['axes']} of 6", str(len(each["links"]))
        table.add_row(name, masses, *numbers, remarks, end_section=True)
    print_table(table)


def _remark(each: dict[str, Any], word: str) -> str:
    return printable(each[word]) or f'{word} not given: <text name="{word}" data="..."/> in <custom>'


def _print_one(name: str, each: dict[str, Any]) -> None:
    from ..plant.vehicle import AXES

    table = facts(printable(f"{name}: {each['description'] or 'a vehicle without a description'}"))
    for word in REMARKS[1:]:
        table.add_row(word, _remark(each, word))
    if each["links"]:
        whole = [sum(part[word] for part in (each, *each["links"])) for word in ("mass", "displaced_mass")]
        table.add_row("with its links", f"{whole[0]:.6g} kg, {whole[1]:.6g} kg; all that follows is the base's alone")
    add_coefficients(table, each, ("front, on x", f"{each['reach']:.6g} m"))
    print_table(table)
    title = f"Thrusters: wrench of 1 N, body frame; they span {each['axes']} of 6 axes"
    table = table_of(title, "name", *AXES, "limits [N]", fixed=("name", *AXES), min_width=80)
    for thruster, given in each["thrusters"].items():
        least, greatest = ("none" if x is None else f"{x:.4g}" for x in (given["least"], given["greatest"]))
        limits = "none" if least == greatest == "none" else f"{least} .. {greatest}"
        table.add_row(printable(thruster), *(f"{round(x, 4) + 0.0:.4g}" for x in given["wrench"]), limits)
    print_table(table)
    if each["links"]:
        print_arm(each)


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
    import numpy as np

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


def add_coefficients(table: Any, about: dict[str, Any], *more: tuple[str, str]) -> None:
    """Add the rows of :func:`coefficients` to a table, with further ones before the matrices."""
    table.add_row("mass, displaced mass", f"{about['mass']:.6g} kg, {about['displaced_mass']:.6g} kg")
    for word in ("gravity", "buoyancy"):
        table.add_row(f"centre of {word}", f"{_numbers(about[f'center_of_{word}'])} m")
    for row in (*more, *((name, _matrix(about[name])) for name in MATRICES)):
        table.add_row(*row)


def _numbers(values: list[float]) -> str:
    return " ".join(f"{round(x, 9) + 0.0:.6g}" for x in values)


def _matrix(rows: list[list[float]]) -> str:
    """The diagonal, and the cross terms by row and column, counted from one as in the literature."""
    entries = ((i, j, x) for i, row in enumerate(rows) for j, x in enumerate(row) if i != j and abs(x) > 1e-12)
    cross = [f"({i + 1},{j + 1}) {x:.6g}" for i, j, x in entries]
    diagonal = f"diag {_numbers([row[i] for i, row in enumerate(rows)])}"
    return diagonal if not cross else f"{diagonal}\n{', '.join(cross)}"


def print_arm(about: dict[str, Any]) -> None:
    """Print joints, links and sites of a vehicle that :func:`described_arm` describes."""
    columns = ("joint", "moves", "type", "range", "motor", "speed limit", "gear friction", "armature")
    table = table_of("Joints, from the base outwards", *columns, fixed=("joint", "moves"), min_width=80)
    for link in about["links"]:
        table.add_row(printable(link["joint"]), printable(link["name"]), link["type"], *_joint(link))
    print_table(table)
    for link in about["links"]:
        table = facts(printable(f"Link {link['name']}, carried by {link['carried_by']}"))
        add_coefficients(table, link)
        if link["strip_theory"]:
            table.add_row("by strip theory", f"{', '.join(link['strip_theory'])}: from its capsules and cylinders")
        print_table(table)
    if about["sites"]:
        heads = ("site", "carried by", "position [m]", "radius [m]", "reach from the first joint [m]")
        table = table_of("Sites that can be the tool: --set task.frame=NAME", *heads, fixed=("site",), min_width=80)
        for name, site in about["sites"].items():
            far = "without limit" if site["reach"] is None else f"at most {site['reach']:.4g}"
            table.add_row(
                printable(name), printable(site["carried_by"]), _numbers(site["position"]), f"{site['radius']:.4g}", far
            )
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
