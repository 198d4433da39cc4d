"""Vehicles of other formats: SDF of Gazebo, URDF and xacro with the plugins of the UUV Simulator or of gz-sim, plain
tables, and the numbers of programs of PythonVehicleSimulator and MSS, as our MJCF.

Losses and decisions are a list of sentences. It is printed, and stands in the file.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from ...errors import InputError
from ..own_vehicle import Thruster
from ..record import PartRecord, VehicleRecord
from ..vehicle import AXES
from .reading import Source

TABLES = (".toml", ".csv")
DESCRIPTIONS = (".sdf", ".world", ".urdf", ".xacro")
PROGRAMS = (".py", ".m")
_NOT_READ = {
    ".mat": "MATLAB",
    ".yaml": "YAML",
    ".yml": "YAML",
    ".dae": "a mesh",
    ".stl": "a mesh",
}


def is_imported(path: Path) -> bool:
    """Whether a file is of another format than MJCF, by its suffix or by the root of its XML."""
    suffix = path.suffix.lower()
    if suffix in (*TABLES, *DESCRIPTIONS, *PROGRAMS, *_NOT_READ):
        return True
    try:
        with path.open("rb") as file:
            head = file.read(64_000)
    except OSError:
        return False
    return any(mark in head for mark in (b"<sdf", b"<robot")) and b"<mujoco" not in head


def imported(
    path: Path,
    name: str,
    packages: Mapping[str, Path] | None = None,
    inertia: Path | None = None,
    drag: Path | None = None,
    thrusters: Sequence[Thruster] = (),
) -> VehicleRecord:
    """The vehicle of a file.

    Args:
        path: of the file; SDF, URDF, xacro, TOML, CSV, or a program in Python or MATLAB, which is not executed.
        name: of the vehicle.
        packages: folders by the names of packages, which the file may refer to.
        inertia: a mass report, whose mass, centre of gravity and inertia are the base's.
        drag: a table of speeds and forces, whose damping is the base's in the axes that it has.
        thrusters: in place of the file's.

    Raises:
        InputError: with the place of what can't be read, is missing, or is not physical.
    """
    source = Source(path, packages or {})
    record = _read(source)
    base = dataclasses.replace(record.base, name=name)
    links = tuple(
        dataclasses.replace(each, parent=name) if each.parent == record.base.name else each for each in record.links
    )
    if inertia is not None:
        base = _with_inertia(source, base, inertia)
    if drag is not None:
        base = _with_drag(source, base, drag)
    if thrusters:
        source.say("the thrusters come from the table" + (", in place of the file's" if record.thrusters else ""))
    record = dataclasses.replace(record, base=base, links=links, thrusters=tuple(thrusters) or record.thrusters)
    if not record.thrusters:
        raise source.fault("thrusters", "there is none in the file: give a table of them with --thrusters FILE.csv")
    _refuse_twins(source, record)
    whole = [base, *links]
    mass, displaced = (sum(getattr(each, key) for each in whole) for key in ("mass", "displaced_mass"))
    more = "up" if displaced > mass else "down"
    source.say(f"mass {mass:.6g} kg, displaced {displaced:.6g} kg: {9.81 * abs(displaced - mass):.4g} N {more} at rest")
    if not base.M_A.any():
        source.say("the source has no added mass of the base: water around a body has some")
    if not base.shapes:
        source.say("no shape is drawn, and the front that touches a wall is 0.1 m before B's origin: add a geom")
    if not base.D_linear.any() and not base.D_quadratic.any() and not record.products:
        source.say("the source has no damping of the base: nothing stops it")
    return dataclasses.replace(
        record,
        description=record.description or f"{name}, read from {path.name}",
        source=record.source or f"read from {path.name}",
        licence=record.licence or "not known: see the source",
        trust=record.trust or f"as the source's; read from {path.name}, see the list in the file",
        left_out=source.sentences(),
    )


def _read(source: Source) -> VehicleRecord:
    from . import programs, sdf, table, urdf, xacro_files
    from .bodies import assembled
    from .elements import refuse_twice

    suffix = source.path.suffix.lower()
    if suffix in _NOT_READ:
        what = _NOT_READ[suffix]
        raise source.fault(
            "", f"is {what}, of which nothing is executed or guessed: copy its numbers into a table, NAME.toml"
        )
    text = source.text(source.path)
    if suffix in TABLES:
        return table.described(source, text)
    if suffix in PROGRAMS:
        return programs.described(source, text)
    if suffix == ".xacro" or "www.ros.org/wiki/xacro" in text or "<xacro:" in text:
        root = xacro_files.expanded(source, text)
    else:
        root = source.xml(text)
    refuse_twice(source, root)
    if root.tag == "robot":
        return assembled(urdf.described(source, root))
    if root.tag == "sdf":
        return assembled(sdf.described(source, root))
    raise source.fault(f"<{root.tag}>", "is not the root of an SDF or URDF file: <sdf> or <robot>")


def _with_inertia(source: Source, base: PartRecord, path: Path) -> PartRecord:
    from .bodies import possible
    from .table import mass_report

    mass, r_g, I_g = mass_report(path).in_B()
    source.say(f"mass, centre of gravity and inertia come from {path.name}: {mass:.6g} kg, not {base.mass:.6g} kg")
    return dataclasses.replace(base, mass=mass, r_g=r_g, I_g=possible(source, I_g, "the mass report"))


def _with_drag(source: Source, base: PartRecord, path: Path) -> PartRecord:
    from .table import drag_table

    D_linear, D_quadratic = base.D_linear.copy(), base.D_quadratic.copy()
    for axis, (D, Q, rms) in drag_table(path).items():
        D_linear[axis, axis], D_quadratic[axis, axis] = D, Q
        unit = "N" if axis < 3 else "N m"
        source.say(f"{AXES[axis]}: damping {D:.6g} and {Q:.6g} by least squares from {path.name}, rms {rms:.3g} {unit}")
    return dataclasses.replace(base, D_linear=D_linear, D_quadratic=D_quadratic)


def _refuse_twins(source: Source, record: VehicleRecord) -> None:
    """Raise InputError for two bodies, joints or thrusters that have one name here."""
    for noun, names in (
        ("site", [*(each.name for each in record.thrusters), *(s for each in record.links for s, _ in each.sites)]),
        ("link", [record.base.name, *(each.name for each in record.links)]),
        ("joint", [each.joint for each in record.links]),
    ):
        twins = sorted({each for each in names if names.count(each) > 1})
        if twins:
            raise source.fault(
                f"{noun} {twins[0]}", "two have this name here, where only letters, digits and _ are kept"
            )


def parsed_packages(given: Sequence[str]) -> dict[str, Path]:
    """Folders by their names, from words NAME=FOLDER. Raises InputError."""
    found = {}
    for each in given:
        name, equals, folder = each.partition("=")
        if not equals or not name or not Path(folder).is_dir():
            raise InputError(f"--package {each}: must be NAME=FOLDER, and the folder must be there")
        found[name] = Path(folder).resolve()
    return found
