"""``uvms-mj new``: a commented file of the user's own, which runs as it is."""

import keyword
import sys
from collections.abc import Mapping
from pathlib import Path

import click

from .common import bad_input, printable, refuse_existing, warn
from .options import command, force_option, path_option

KINDS = {
    "vehicle": ("vehicle.xml", "uvms-mj run --set vehicle.model={file}"),
    "scenario": ("scenario.toml", "uvms-mj run {file}"),
    "law": ("law.py", "uvms-mj run --controller {file}:{cls}"),
    "reference": ("reference.py", "uvms-mj run --set reference.name={file}:{cls}"),
    "sensor": ("sensor.py", "uvms-mj run --set navigation.name={file}:{cls}"),
    "observer": ("observer.py", "uvms-mj run --set observer.name={file}:{cls}"),
    "thrusters": ("thrusters.py", "uvms-mj run --set thrusters.name={file}:{cls}"),
    "effect": ("effect.py", "uvms-mj run --set 'effects=[{{name = \"{file}:{cls}\"}}]'"),
    "identify": ("identify.toml", "uvms-mj identify {file}"),
}
IN_C = {kind: use.replace(":{cls}", "") for kind, (_, use) in KINDS.items() if ":{cls}" in use}
"""The kinds that may be written in C, with their use: a C file, and its description."""
HEADER_OF = "header"
"""The kind of ``uvms_stage.h``, from a description."""
"""Template and use of each kind. A template, in ``templates`` with the suffix ``.txt``, is a valid file about
``template_name`` with the class ``TemplateName``."""
EXAMPLE = "example"
"""The kind of the examples, which are copied as they are."""


@command()
@click.argument("kind", metavar="KIND")
@click.argument("name")
@path_option("-o", "--out", metavar="FOLDER", help="Folder of the new file [default: here; of all examples: examples].")
@click.option(
    "--language", type=click.Choice(["python", "c"]), default="python", help="Of a law, sensor, ...: its own."
)
@path_option("--from", "origin", metavar="VEHICLE", help="Of a vehicle: a shipped one, by its name, or a file.")
@path_option("--thrusters", metavar="FILE.csv", help="Of a vehicle: thrusters in place of its own, from a table.")
@click.option("--package", multiple=True, metavar="NAME=FOLDER", help="A folder that the file of --from refers to.")
@path_option("--inertia", metavar="FILE.toml", help="With a file of --from: mass, its centre and inertia, of CAD.")
@path_option("--drag", metavar="FILE.csv", help="With a file of --from: damping, from speeds and forces.")
@force_option
def new(
    kind: str,
    name: str,
    out: str | None,
    language: str,
    origin: str | None,
    thrusters: str | None,
    package: tuple[str, ...],
    inertia: str | None,
    drag: str | None,
    force: bool,
) -> None:
    """Write a commented file NAME.xml, NAME.toml or NAME.py, which runs as it is.

    KIND is vehicle, scenario, law, reference, sensor, observer, thrusters, effect, identify, header or example. An
    example is a file of the guides by its name, or all.

    \b
    uvms-mj new vehicle my_rov
    uvms-mj new vehicle my_rov --from bluerov2_heavy --thrusters thrusters.csv
    uvms-mj new vehicle my_rov --from model.sdf
    uvms-mj new vehicle my_rov --from rov.urdf.xacro --package rov_description=src/rov_description
    uvms-mj new vehicle my_rov --from paper.toml --inertia cad.toml --drag towing.csv
    uvms-mj new law my_law
    uvms-mj new law my_law --language c
    uvms-mj new identify my_rov
    uvms-mj new example all

    In C, NAME.c has the function, NAME.toml its settings and states, and uvms_stage.h the records that it is given;
    uvms-mj new header NAME.toml writes that header anew. It has the number of thrusters of the BlueROV1, or of --from.

    --from reads SDF of Gazebo, URDF and xacro with the plugins of the UUV Simulator or of gz-sim, a table in TOML or
    CSV that says its axes, points and signs, and the numbers of a program of PythonVehicleSimulator (.py) or MSS (.m).
    All numbers are converted to B, forward, left, up, about its origin. A list of omissions and decisions is
    printed, and stands in the file. Nothing of a file is executed, and no other folder is read.

    A table of thrusters has a row for each, and these columns, with the unit in the head:

    \b
    name                   a word
    x_m y_m z_m            position in B: forward, left, up; or x_mm, x_cm
    dx dy dz               direction of positive thrust, of any length
    yaw_deg pitch_deg      or the angles of a frame whose x axis it is; a pitch of -90 points up
    min_N max_N            limits of the thrust, or min_kgf; may be left out or empty
    """
    with bad_input():
        for line in write_new(kind, name, out, origin, thrusters, force, language, package, inertia, drag):
            click.echo(printable(line))


def write_new(
    kind: str,
    name: str,
    out: str | None = None,
    origin: str | None = None,
    thrusters: str | None = None,
    force: bool = False,
    language: str = "python",
    packages: tuple[str, ...] = (),
    inertia: str | None = None,
    drag: str | None = None,
) -> list[str]:
    """Write the files of the command, whose arguments these are. Returns a line for each: its path and its use. Raises
    InputError."""
    from ..errors import InputError

    if kind == EXAMPLE and not (origin or thrusters):
        return _examples(name, out, force)
    if kind == HEADER_OF:
        return [_header(Path(name), out, origin, force)]
    kind = kind if kind in (*KINDS, EXAMPLE) else _kind_of(kind)
    if language == "c":
        if kind not in IN_C:
            raise InputError(f"--language c: a {kind} is not code; leave it out")
        return _in_c(kind, name, out, origin, force)
    cls = "".join(word[:1].upper() + word[1:] for word in name.split("_"))
    if not name.isascii() or any(not word.isidentifier() or keyword.iskeyword(word) for word in (name, cls)):
        hint = "must be a word of letters a to z, digits and _ that begins with a letter, and not one of Python's own"
        raise InputError(f"NAME {name!r}: {hint}, as my_{kind}; --out names a folder")
    if kind != "vehicle" and (origin or thrusters):
        raise InputError(f"{'--from' if origin else '--thrusters'}: is for a vehicle, not for a {kind}")
    template, use = KINDS[kind]
    path = Path(out or ".", f"{name}{Path(template).suffix}")
    if kind in IN_C and name in {*sys.stdlib_module_names, "uvms_mj", "numpy", "scipy", "mujoco", "matplotlib"}:
        raise InputError(f"NAME {name!r}: is a module, which this file would hide; choose another name, as my_{kind}")
    refuse_existing("NAME", path, force)
    source = Path(__file__).parent / "templates" / f"{template}.txt"
    text = source.read_text(encoding="utf-8").replace("template_name", name).replace("TemplateName", cls)
    copies, said = {path.name: text.encode()}, list[str]()
    if kind == "identify":
        copies[f"{name}.csv"] = source.with_name("identify.csv.txt").read_bytes()
        said = [f"{path.with_suffix('.csv')}: its data"]
    if origin and _is_imported(origin):
        copies, said = _imported(name, origin, thrusters, packages, inertia, drag)
    elif packages or inertia or drag:
        given = "--package" if packages else "--inertia" if inertia else "--drag"
        raise InputError(
            f"{given}: is for a vehicle from a file, --from FILE of SDF, URDF, xacro, TOML, CSV, Python or MATLAB"
        )
    elif origin or thrusters:
        copies = _vehicle(name, origin, thrusters, text)
    _write(path.parent, copies, force)
    return [f"{path}: {use.format(file=path, cls=cls)}", *said]


def _write(folder: Path, files: Mapping[str, bytes], force: bool) -> None:
    """Write files to a folder, which is made if it is not there. Raises InputError if one of them is there."""
    from ..files import atomic_write, locked

    for name in files:
        refuse_existing("NAME", folder / name, force)
    with locked(folder):
        for name, data in files.items():
            with atomic_write(folder / name) as part:
                part.write_bytes(data)


def _is_imported(origin: str) -> bool:
    from ..plant.importing import is_imported

    return is_imported(Path(origin))


def _imported(
    name: str, origin: str, table: str | None, packages: tuple[str, ...], inertia: str | None, drag: str | None
) -> tuple[dict[str, bytes], list[str]]:
    """The file of a vehicle of another format, and lines on what was left out. Warns of what its thrusters can't
    produce. Raises InputError."""
    import tempfile

    from ..plant.importing import imported, parsed_packages
    from ..plant.mjcf import Mjcf
    from ..plant.own_vehicle import read_thrusters, unreachable
    from ..plant.record import mjcf_text

    thrusters = read_thrusters(Path(table)) if table else []
    folders = parsed_packages(packages)
    mass, towing = (Path(each) if each else None for each in (inertia, drag))
    record = imported(Path(origin), name, folders, mass, towing, thrusters)
    text = mjcf_text(record)
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder, f"{name}.xml")
        written.write_text(text, encoding="utf-8")
        vehicle = Mjcf.find(str(written)).vehicle  # the file must be a vehicle
    if said := unreachable(vehicle):
        warn(said)
    return {f"{name}.xml": text.encode()}, ["left out and decided:", *(f"  * {each}" for each in record.left_out)]


def _in_c(kind: str, name: str, out: str | None, vehicle: str | None, force: bool) -> list[str]:
    """Write a stage in C: its code, its description and its header. Returns a line for each."""
    import tempfile

    from ..errors import InputError
    from ..stages.foreign import is_c_name

    if not is_c_name(name):
        raise InputError(f"NAME {name!r}: must be the name of a C function, as my_{kind}")
    folder = Path(out or ".")
    paths = {suffix: folder / f"{name}{suffix}" for suffix in (".c", ".toml")}
    for path in paths.values():
        refuse_existing("NAME", path, force)
    templates = Path(__file__).parent / "templates"
    texts = {suffix: (templates / f"{kind}{suffix}.txt").read_text(encoding="utf-8") for suffix in paths}
    files = {path.name: texts[suffix].replace("template_name", name).encode() for suffix, path in paths.items()}
    with tempfile.TemporaryDirectory() as new:
        Path(new, f"{name}.toml").write_bytes(files[f"{name}.toml"])
        header = _header(Path(new, f"{name}.toml"), str(folder), vehicle, force)
    _write(folder, files, force)
    use = IN_C[kind].format(file=paths[".c"])
    return [f"{paths['.c']}: {use}", f"{paths['.toml']}: its settings and states", header]


def _header(description: Path, out: str | None, vehicle: str | None, force: bool) -> str:
    """Write the header of a description, for the thrusters and joints of a vehicle. Returns its line. Raises InputError
    if another stage's is there."""
    from ..errors import InputError
    from ..files import atomic_write, locked
    from ..plant.mjcf import Mjcf
    from ..scenario import CHOICES
    from ..stages.foreign import HEADER, Description, Records, header

    if description.suffix != ".toml":
        raise InputError(f"NAME {description}: give the description of a stage, NAME.toml")
    kind = Description.load(description, CHOICES).stage_class(description.stem, __name__, [])
    plant = Mjcf.find(vehicle or "bluerov1").vehicle
    counted = len(plant.arm.links) if kind.room.counts == "joints" else len(plant.thrusters)
    path = Path(out) / HEADER if out else description.with_name(HEADER)
    records = Records.of(kind(), counted)
    text = header(kind, records)
    banner = text.partition(", in SI units")[0]
    if not force and path.exists() and not path.read_text(encoding="utf-8").startswith(banner):
        wrong = "is the header of another stage; give each stage in C a folder of its own, --out FOLDER, or --force"
        raise InputError(f"{path}: {wrong}")
    with locked(path.parent), atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")
    number = "".join(f", {name} = {value}" for name, value in records.counted.items())
    return f"{path}: the records of the {kind.room.noun} {description.stem}{number}"


def _vehicle(name: str, origin: str | None, table: str | None, text: str) -> dict[str, bytes]:
    """The files of a copy of a vehicle, or of the template with this text, with the thrusters of a table. Warns of what
    they can't produce. Raises InputError as the modules of the plant do."""
    import tempfile

    import numpy as np

    from ..errors import InputError
    from ..files import shipped
    from ..plant.mjcf import Mjcf
    from ..plant.own_vehicle import copied, read_thrusters, unreachable

    thrusters = read_thrusters(Path(table)) if table else []
    with tempfile.TemporaryDirectory() as folder:
        template = Path(folder, f"{name}.xml")
        template.write_text(text, encoding="utf-8")
        if origin is not None:
            Mjcf.find(origin)  # says what is wrong with it
        given = template if origin is None else Path(origin) if Path(origin).is_file() else shipped("models")[origin]
        label = "the template" if origin is None else Path(origin).name
        copies = copied(label, given.absolute(), name, thrusters, Path(table or "").name)
        written = Path(folder, "copy")
        written.mkdir()
        for each, data in copies.items():
            (written / each).write_bytes(data)
        vehicle = Mjcf.find(str(written / f"{name}.xml")).vehicle
    for i, thruster in enumerate(thrusters):
        wanted = np.concatenate([thruster.direction, np.cross(thruster.position, thruster.direction)])
        low, high = thruster.limits or (-np.inf, np.inf)
        if not np.allclose(vehicle.B[:, i], wanted, atol=1e-9) or (vehicle.u_min[i], vehicle.u_max[i]) != (low, high):
            raise InputError(
                f"{given}: its defaults change the thruster {thruster.name}; give the table another vehicle"
            )
    if said := unreachable(vehicle):
        warn(said)
    return copies


def _examples(name: str, out: str | None, force: bool) -> list[str]:
    """Write an example, or all of them, and return the paths. Raises InputError if there is none of this name."""
    from ..errors import InputError, suggestion
    from ..files import shipped

    known = shipped("examples")
    if name not in (*known, "all"):
        raise InputError(f"NAME {name!r}: is not an example; {suggestion(name, [*known, 'all'])}")
    folder = Path(out or ("examples" if name == "all" else "."))
    chosen = known.values() if name == "all" else [known[name]]
    _write(folder, {source.name: source.read_bytes() for source in chosen}, force)
    return [str(folder / source.name) for source in chosen]


def _kind_of(word: str) -> str:
    """The kind of file that a word for stages means: ``law`` of ``controller``. Raises InputError if there is none."""
    from ..errors import InputError, suggestion
    from ..scenario import CHOICES
    from ..stages.loader import tables_by_word

    tables = {table: table for table in CHOICES} | tables_by_word(CHOICES)
    for kind in KINDS:
        if word in tables and tables[word] == tables.get(kind):
            return kind
    raise InputError(f"{word!r}: is not a kind of file; {suggestion(word, (*KINDS, HEADER_OF, EXAMPLE))}")
