"""``uvms-mj vehicles``: the vehicles that ship, or the numbers of a vehicle's file."""

import json
from typing import TYPE_CHECKING, Any

import click

from .common import bad_input, command, json_option, printable
from .console import facts, print_table, table_of, warn

if TYPE_CHECKING:
    from ..plant.mjcf import Mjcf

REMARKS = ("description", "source", "licence", "trust")
"""``<text>`` entries of a vehicle's file that say what it is and where its numbers come from."""
_AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")


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
        from ..physics.dissipation import damping_notes
        from ..plant.mjcf import Mjcf

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
        vehicle = mjcf.vehicle
        for note in damping_notes(vehicle.body, vehicle.D_linear, vehicle.D_quadratic):
            warn(note)


def described(mjcf: "Mjcf") -> dict[str, Any]:
    """What is known of a vehicle, as numbers, texts and lists: SI units, body frame B.

    Of each thruster ``wrench`` is its column of B, the wrench of 1 N of thrust, or of 1 N m if it is a pure moment. A
    limit is None if there is none. Raises InputError if the file is not one physical vehicle.
    """
    import numpy as np

    vehicle, remarks = mjcf.vehicle, mjcf.remarks
    prefix = vehicle.body[: vehicle.body.rfind("/") + 1]  # of a model that the file attaches
    matrices = ("M_RB", "M_A", "D_linear", "D_quadratic")
    columns = zip(vehicle.thrusters, vehicle.B.T, vehicle.u_min, vehicle.u_max, strict=True)
    return {
        **{word: remarks.get(word) or remarks.get(prefix + word, "") for word in REMARKS},
        "mass": vehicle.mass,
        "displaced_mass": vehicle.displaced_mass,
        "center_of_gravity": vehicle.r_g.tolist(),
        "center_of_buoyancy": vehicle.r_b.tolist(),
        "reach": float(mjcf.geometry.reach),
        **{name: getattr(vehicle, name).tolist() for name in matrices},
        "axes": int(np.linalg.matrix_rank(vehicle.B)),
        "thrusters": {
            name: {"wrench": wrench.tolist(), "least": _finite(least), "greatest": _finite(greatest)}
            for name, wrench, least, greatest in columns
        },
    }


def _finite(limit: float) -> float | None:
    return float(limit) if abs(limit) != float("inf") else None


def _print_list(about: dict[str, dict[str, Any]]) -> None:
    title = "Vehicles: --set vehicle.model=NAME; `uvms-mj vehicles NAME` lists the numbers of one"
    columns = ("name", "mass, displaced [kg]", "thrusters", "axes", "source, licence, trust")
    table = table_of(title, *columns, fixed=("name",), min_width=80)
    for name, each in about.items():
        masses = f"{each['mass']:.4g}, {each['displaced_mass']:.4g}"
        remarks = "\n".join(_remark(each, word) for word in REMARKS[1:])
        table.add_row(name, masses, str(len(each["thrusters"])), f"{each['axes']} of 6", remarks, end_section=True)
    print_table(table)


def _remark(each: dict[str, Any], word: str) -> str:
    return printable(each[word]) or f'{word} not given: <text name="{word}" data="..."/> in <custom>'


def _print_one(name: str, each: dict[str, Any]) -> None:
    table = facts(printable(f"{name}: {each['description'] or 'a vehicle without a description'}"))
    for word in REMARKS[1:]:
        table.add_row(word, _remark(each, word))
    table.add_row("mass, displaced mass", f"{each['mass']:.6g} kg, {each['displaced_mass']:.6g} kg")
    for word in ("gravity", "buoyancy"):
        table.add_row(f"centre of {word}", f"{_numbers(each[f'center_of_{word}'])} m")
    table.add_row("front, on x", f"{each['reach']:.6g} m")
    for matrix in ("M_RB", "M_A", "D_linear", "D_quadratic"):
        table.add_row(matrix, _matrix(each[matrix]))
    print_table(table)
    title = f"Thrusters: wrench of 1 N, body frame; they span {each['axes']} of 6 axes"
    table = table_of(title, "name", *_AXES, "limits [N]", fixed=("name", *_AXES), min_width=80)
    for thruster, given in each["thrusters"].items():
        least, greatest = ("none" if x is None else f"{x:.4g}" for x in (given["least"], given["greatest"]))
        limits = "none" if least == greatest == "none" else f"{least} .. {greatest}"
        table.add_row(printable(thruster), *(f"{round(x, 4) + 0.0:.4g}" for x in given["wrench"]), limits)
    print_table(table)


def _numbers(values: list[float]) -> str:
    return " ".join(f"{round(x, 9) + 0.0:.6g}" for x in values)


def _matrix(rows: list[list[float]]) -> str:
    """The diagonal, and the cross terms by row and column, counted from one as in the literature."""
    entries = ((i, j, x) for i, row in enumerate(rows) for j, x in enumerate(row) if i != j and abs(x) > 1e-12)
    cross = [f"({i + 1},{j + 1}) {x:.6g}" for i, j, x in entries]
    diagonal = f"diag {_numbers([row[i] for i, row in enumerate(rows)])}"
    return diagonal if not cross else f"{diagonal}\n{', '.join(cross)}"
