"""``uvms-mj vehicles``: the vehicles that ship, or the numbers of a vehicle's file."""

import json
from typing import TYPE_CHECKING, Any

import click

from .common import bad_input, printable
from .console import facts, print_table, table_of, warn
from .options import command, json_option
from .vehicle_arm import add_coefficients, coefficients, described_arm, finite, print_arm

if TYPE_CHECKING:
    from ..plant.mjcf import Mjcf

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
