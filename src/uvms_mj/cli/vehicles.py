"""``uvms-mj vehicles``: the vehicles that ship, or the numbers of a vehicle's file."""

import json
import math
from typing import Any

import click

from .common import bad_input, printable
from .console import Table, facts, warn
from .options import command, json_option


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
        from ..plant.description import described
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


def _print_list(about: dict[str, dict[str, Any]]) -> None:
    from ..plant.description import REMARKS, remark

    rows = []
    for name, each in about.items():
        parts = [each, *each["links"]]
        masses = ", ".join(f"{sum(part[word] for part in parts):.4g}" for word in ("mass", "displaced_mass"))
        remarks = "\n".join(printable(remark(each, word)) for word in REMARKS[1:])
        numbers = str(len(each["thrusters"])), f"{each['axes']} of 6", str(len(each["links"]))
        rows.append((name, masses, *numbers, remarks))
    title = "Vehicles: --set vehicle.model=NAME; `uvms-mj vehicles NAME` lists the numbers of one"
    columns = ("name", "mass, displaced [kg]", "thrusters", "axes", "joints", "source, licence, trust")
    Table(title, columns, rows, fixed=("name",), width=80, ruled=True).show()


def _print_one(name: str, each: dict[str, Any]) -> None:
    from ..plant.description import rows
    from ..plant.vehicle import AXES

    about = [(row, printable(value)) for row, value in rows(each)]
    facts(printable(f"{name}: {each['description'] or 'a vehicle without a description'}"), about).show()
    thrusters = []
    for thruster, given in each["thrusters"].items():
        least, greatest = ("none" if x is None else f"{x:.4g}" for x in (given["least"], given["greatest"]))
        limits = "none" if least == greatest == "none" else f"{least} .. {greatest}"
        thrusters.append((printable(thruster), *(f"{round(x, 4) + 0.0:.4g}" for x in given["wrench"]), limits))
    title = f"Thrusters: wrench of 1 N, body frame; they span {each['axes']} of 6 axes"
    Table(title, ("name", *AXES, "limits [N]"), thrusters, fixed=("name", *AXES), width=80).show()
    if each["links"]:
        print_arm(each)


def print_arm(about: dict[str, Any]) -> None:
    """Print joints, links and sites of a vehicle that :func:`..plant.description.described_arm` describes."""
    from ..plant.description import coefficient_rows, numbers_text

    columns = ("joint", "moves", "type", "range", "motor", "speed limit", "gear friction", "armature")
    joints = [
        (printable(link["joint"]), printable(link["name"]), link["type"], *_joint(link)) for link in about["links"]
    ]
    Table("Joints, from the base outwards", columns, joints, fixed=("joint", "moves"), width=80).show()
    for link in about["links"]:
        rows = [*coefficient_rows(link)]
        if link["strip_theory"]:
            rows.append(("by strip theory", f"{', '.join(link['strip_theory'])}: from its capsules and cylinders"))
        facts(printable(f"Link {link['name']}, carried by {link['carried_by']}"), rows).show()
    sites = []
    for name, site in about["sites"].items():
        far = "without limit" if site["reach"] is None else f"at most {site['reach']:.4g}"
        place = printable(site["carried_by"]), numbers_text(site["position"])
        sites.append((printable(name), *place, f"{site['radius']:.4g}", far))
    if sites:
        heads = ("site", "carried by", "position [m]", "radius [m]", "reach from the first joint [m]")
        Table("Sites that can be the tool: --set task.frame=NAME", heads, sites, fixed=("site",), width=80).show()


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
