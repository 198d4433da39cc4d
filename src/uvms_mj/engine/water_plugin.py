"""The water as a MuJoCo plugin: a library for the installed MuJoCo, and the vehicle's MJCF that asks for it."""

import hashlib
import os
import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from ..compiler.targets import X86_64
from ..errors import InputError
from ..files import atomic_write
from ..physics.current import CURRENT
from ..plant.effects import effect_records
from ..plant.mjcf import Mjcf
from ..plant.vehicle import Vehicle
from .native.attachment import SITUATION, STILL, immerse
from .native.other_targets import water_for
from .native.record import Field, alone_dtype, integers_of
from .native.tools import compiler, tool

CODE = "uvms_mj_water"
_MEAN = Field.of(CURRENT, "mean").offset
_BORDER = ("time_at", "R_at", "qpos_at", "qvel_at", "qacc_at", "M_at", "passive_at", "ctrl_at")


def kind_of(vehicle: Vehicle) -> np.dtype:
    """The record of a vehicle: its numbers of joints and of products of velocities decide its kernels."""
    return alone_dtype(len(vehicle.arm.links), effect_records(STILL, SITUATION, vehicle.products).dtype)


def name_of(vehicle: Vehicle) -> str:
    """Name of the plugin for a vehicle: each kind has kernels of its own. Libraries with other records, of other
    versions of this package, have other names."""
    records = hashlib.sha256(repr(kind_of(vehicle)).encode()).hexdigest()[:6]
    return f"uvms_mj.{_numbered(vehicle)}_{records}"


def _numbered(vehicle: Vehicle) -> str:
    products = f"_{len(vehicle.products)}_products" if vehicle.products else ""
    return f"water_{len(vehicle.arm.links)}{products}"


def write_plugin(model: str, folder: Path) -> list[Path]:
    """Write the library and the MJCF of a vehicle, a shipped one's name or a file's path, into a folder. Returns the
    files: the library, then the files of the MJCF, its main file first.

    Raises:
        InputError: the vehicle's file is wrong, or there is no C compiler.
    """
    mjcf = Mjcf.find(model)
    library = folder / f"libuvms_mj_{_numbered(mjcf.vehicle)}.so"
    texts = {**mjcf.files, **immersed(mjcf)}
    with atomic_write(library) as part:
        part.write_bytes(_linked(mjcf.vehicle))
    written = [library]
    for name in sorted(texts, key=lambda name: (name != mjcf.name, name)):
        with atomic_write(folder / name) as part:
            part.write_bytes(texts[name])
        written.append(folder / name)
    return written


def _record(mjcf: Mjcf) -> str:
    """The numbers of a vehicle's record that are not zero, each behind its place; before them the sum of this text, so
    that the library refuses one that was changed."""
    model = mjcf.compiled(mjcf.spec())
    data = mujoco.MjData(model)
    attachment = immerse(model, data, mjcf.vehicle)
    try:
        record = attachment.image.record("run").copy()
    finally:
        attachment.release()
    record["plant"]["mujoco"] = 0
    words = record.view("<i8")
    integers = {at // 8 for at in integers_of(record.dtype)}
    parts = []
    for place in np.flatnonzero(words).tolist():
        number = float(words[place]) if place in integers else float(words[place : place + 1].view("f8")[0])
        parts.append(f"{place} {number!r}")
    text = " ".join(parts)
    return f"{_sum(text.encode()):016x} {text}"


def _sum(data: bytes) -> int:
    """FNV-1a, 64 bits."""
    found = 0xCBF29CE484222325
    for byte in data:
        found = (found ^ byte) * 0x100000001B3 % 2**64
    return found


def immersed(mjcf: Mjcf) -> dict[str, bytes]:
    """The files of a vehicle in XML by their names, with the plugin in its body. The coefficients are left out, since
    the plugin reads its record alone."""
    plugin, instance = name_of(mjcf.vehicle), f"water_{mjcf.name.removesuffix('.xml')}"
    trees = {name: ElementTree.fromstring(data) for name, data in mjcf.files.items() if name.endswith(".xml")}
    bodies = [(tree, body) for tree in trees.values() for body in tree.iter("body")]
    bodies = [(tree, body) for tree, body in bodies if body.get("name") == mjcf.vehicle.body]
    if not bodies:
        raise InputError(f"{mjcf.name}: no file has the body {mjcf.vehicle.body!r} by its name")
    for tree in trees.values():
        for custom in tree.iter("custom"):
            for each in custom.findall("numeric"):
                custom.remove(each)
    tree, body = bodies[0]
    body.set("simple", "false")
    # MuJoCo's attach carries an instance with a name, and no other
    ElementTree.SubElement(body, "plugin", instance=instance)
    extension = ElementTree.Element("extension")
    tree.insert(0, extension)
    known = ElementTree.SubElement(extension, "plugin", plugin=plugin)
    named = ElementTree.SubElement(known, "instance", name=instance)
    ElementTree.SubElement(named, "config", key="record", value=_record(mjcf))
    ElementTree.SubElement(named, "config", key="current", value="0 0 0")
    return {name: ElementTree.tostring(each, encoding="utf-8", xml_declaration=True) for name, each in trees.items()}


def _header(vehicle: Vehicle) -> str:
    """The constants of the shell."""
    kind = kind_of(vehicle)
    fields: Any = kind.fields
    plant, at = fields["plant"][:2]

    def offset(*names: str) -> int:
        part, place = plant, at
        for name in names:
            inner: Any = part.fields
            part, step = inner[name][:2]
            place += step
        return place

    border: Any = plant.fields["mujoco"][0]
    whole = ", ".join(map(str, integers_of(kind)))
    return "\n".join(
        [
            f'#define NAME "{name_of(vehicle)}"',
            f"#define JOINTS {len(vehicle.arm.links)}",
            f"#define RECORD_BYTES {kind.itemsize}",
            f"#define BORDER {offset('mujoco')}",
            f"#define BORDER_BYTES {border.itemsize}",
            *(f"#define {name.upper()} {offset('mujoco', name)}" for name in _BORDER),
            f"#define CURRENT_MEAN {offset('effects', 'current') + _MEAN}",
            f"#define CURRENT_NOW {offset('water', 'v_c_W')}",
            f"#define GRAVITY {offset('gravity_W')}",
            f"#define M_ROWS {offset('M_rows')}",
            f"static const size_t whole[] = {{{whole}}};",
            "",
        ]
    )


def _linked(vehicle: Vehicle) -> bytes:
    """The library for the installed MuJoCo."""
    code = water_for(X86_64, kind_of(vehicle), len(vehicle.arm.links) > 0, CODE)
    home = Path(mujoco.__file__).parent
    (binary,) = home.glob("libmujoco.so.*")
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "water.o").write_bytes(code)
        Path(folder, "water.h").write_text(_header(vehicle), encoding="utf-8")
        names = ["water.o", os.fspath(Path(__file__).with_suffix(".c"))]
        options = ["-O2", "-fPIC", "-shared", "-w", "-I", folder, "-I", os.fspath(home / "include")]
        command = [*compiler(), *options, *names, os.fspath(binary), "-o", "water.so", "-lm"]
        try:
            done = tool(command, folder)
        except OSError as error:
            raise InputError(f"the C compiler {command[0]}: {error.strerror}") from None
        if done.returncode or not Path(folder, "water.so").is_file():
            said = (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]
            raise InputError(f"the plugin does not compile with {command[0]}: {said}")
        return Path(folder, "water.so").read_bytes()
