"""``uvms-mj vehicles``: the vehicles that ship, or the numbers of a vehicle's file."""

import json
import math
from typing import Any

import click

from .common import bad_input, printable
from .console import facts, print_table, table_of, warn
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

    title = "Vehicles: --set vehicle.model=NAME; `uvms-mj vehicles NAME` lists the numbers of one"
    columns = ("name", "mass, displaced [kg]", "thrusters", "axes", "joints", "source, licence, trust")
    table = table_of(title, *columns, fixed=("name",), min_width=80)
    for name, each in about.items():
        parts = [each, *each["links"]]
        masses = ", ".join(f"{sum(part[word] for part in parts):.4g}" for word in ("mass", "displaced_mass"))
        remarks = "\n".join(printable(remark(each, word)) for word in REMARKS[1:])
        numbers = str(len(each["thrusters"])), f"{each['axes']} of 6", str(len(each["links"]))
        table.add_row(name, masses, *numbers, remarks, end_section=True)
    print_table(table)


def _print_one(name: str, each: dict[str, Any]) -> None:
    from ..plant.description import rows
    from ..plant.vehicle import AXES

    table = facts(printable(f"{name}: {each['description'] or 'a vehicle without a description'}"))
    for row, value in rows(each):
        table.add_row(row, printable(value))
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


def print_arm(about: dict[str, Any]) -> None:
    """Print joints, links and sites of a vehicle that :func:`..plant.description.described_arm` describes."""
    from ..plant.description import coefficient_rows, numbers_text

    columns = ("joint", "moves", "type", "range", "motor", "speed limit", "gear friction", "armature")
    table = table_of("Joints, from the base outwards", *columns, fixed=("joint", "moves"), min_width=80)
    for link in about["links"]:
        table.add_row(printable(link["joint"]), printable(link["name"]), link["type"], *_joint(link))
    print_table(table)
    for link in about["links"]:
        table = facts(printable(f"Link {link['name']}, carried by {link['carried_by']}"))
        for row in coefficient_rows(link):
            table.add_row(*row)
        if link["strip_theory"]:
            table.add_row("by strip theory", f"{', '.join(link['strip_theory'])}: from its capsules and cylinders")
        print_table(table)
    if about["sites"]:
        heads = ("site", "carried by", "position [m]", "radius [m]", "reach from the first joint [m]")
        table = table_of("Sites that can be the tool: --set task.frame=NAME", *heads, fixed=("site",), min_width=80)
        for name, site in about["sites"].items():
            far = "without limit" if site["reach"] is None else f"at most {site['reach']:.4g}"
            table.add_row(
                printable(name),
                printable(site["carried_by"]),
                numbers_text(site["position"]),
                f"{site['radius']:.4g}",
                far,
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
