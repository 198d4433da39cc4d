"""A copy of a vehicle's file under another name, for its owner to edit, with other thrusters if a table gives them.

The table of thrusters is a CSV file: a row each, with name, position and direction in B, and limits of the thrust.
The unit of a column is in its head. ``name``; the position ``x``, ``y``, ``z`` with ``_m``, ``_cm`` or ``_mm``; the
direction of positive thrust as ``dx``, ``dy``, ``dz``, a vector of any length, or as ``yaw_deg`` and ``pitch_deg`` of a
frame whose x axis it is, where a pitch of -90 points up; and, if the thrust has limits, ``min`` and ``max`` with ``_N``
or ``_kgf``.
"""

import copy
import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import Fault, InputError, number_hint, suggestion
from ..files import text_of
from ..physics.frames import quat_from_euler_deg, rotation_matrix
from ..physics.spanned_axes import LEAST, axes_spanned, is_unreached, unreached
from .mjcf import Mjcf, ModelFiles, parsed
from .vehicle import AXES, Vehicle

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
FORCES = {"N": 1.0, "kgf": 9.80665}
ANGLES = {"deg": 1.0}
_UNITS: Mapping[str, Mapping[str, float]] = {
    **dict.fromkeys(("x", "y", "z"), LENGTHS),
    **dict.fromkeys(("min", "max"), FORCES),
    **dict.fromkeys(("yaw", "pitch"), ANGLES),
}
"""The units of each quantity, with their factors to SI or degrees."""
_DIRECTION = ("dx", "dy", "dz")
COLUMNS = "name, x_m, y_m, z_m, dx, dy, dz (or yaw_deg, pitch_deg), min_N, max_N"
_FARTHEST, _STRONGEST = 100.0, 1e6
_NAME = re.compile(r"[A-Za-z]\w{0,63}", re.ASCII)


@dataclass(frozen=True)
class Thruster:
    """One thruster: position (3,) [m], unit direction of positive thrust (3,), both in B, and limits [N] or None."""

    name: str
    position: tuple[float, float, float]
    direction: tuple[float, float, float]
    limits: tuple[float, float] | None


def read_thrusters(path: Path) -> list[Thruster]:
    """The thrusters of a CSV file. Raises InputError with the row and the column of each error; a row is counted by its
    line in the file."""
    try:
        lines = text_of(path).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: can't read it: {getattr(error, 'strerror', None) or error}") from None
    numbered = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not numbered:
        raise InputError(f"{path}: is empty; its columns are {COLUMNS}")
    separator = max(",;\t", key=numbered[0][1].count)
    rows = [(n, [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]) for n, line in numbered]
    heads, faults = rows[0][1], list[Fault]()
    scales = _scales(heads, faults)
    if faults:
        raise InputError(faults, str(path))
    found: list[Thruster] = []
    for n, cells in rows[1:]:
        if len(cells) != len(heads):
            faults.append(Fault(f"row {n}", f"has {len(cells)} values; the head has {len(heads)} columns"))
            continue
        values = dict(zip(heads, cells, strict=True))
        name = values["name"]
        if not _NAME.fullmatch(name):
            wrong = f"{name!r} must be a word of letters, digits and _ that begins with a letter"
            faults.append(Fault(f"row {n}, column name", wrong))
        elif name in (each.name for each in found):
            faults.append(Fault(f"row {n}, column name", f"{name!r} is given twice"))
        numbers = _numbers(n, {head: values[head] for head in heads if head != "name"}, scales, faults)
        thruster = None if numbers is None else _thruster(n, name, numbers, heads, faults)
        if thruster is not None:
            found.append(thruster)
    if not faults and not found:
        faults.append(Fault("", "has no thruster below its head"))
    if faults:
        raise InputError(faults, str(path))
    return found


def _scales(heads: list[str], faults: list[Fault]) -> dict[str, tuple[str, float]]:
    """The quantity of each column and the factor of its unit. Appends errors of the head."""
    found: dict[str, tuple[str, float]] = {}
    for head in heads:
        word, _, unit = head.partition("_")
        if head in ("name", *_DIRECTION):
            quantity, factor = head, 1.0
        elif word in _UNITS and unit in _UNITS[word]:
            quantity, factor = word, _UNITS[word][unit]
        elif word in _UNITS:
            choices = " or ".join(f"{word}_{unit}" for unit in _UNITS[word])
            faults.append(Fault(f"column {head!r}", f"its unit is missing or unknown: write {choices}"))
            continue
        else:
            known = [*_DIRECTION, "name", *(f"{word}_{unit}" for word, units in _UNITS.items() for unit in units)]
            faults.append(Fault(f"column {head!r}", f"is not known; {suggestion(head, known)}"))
            continue
        if quantity in (other for other, _ in found.values()):
            faults.append(Fault(f"column {head!r}", f"{quantity} is given twice"))
        found[head] = quantity, factor
    given = {quantity for quantity, _ in found.values()}
    missing = [word for word in ("name", "x", "y", "z") if word not in given]
    vector, angles = given & {*_DIRECTION}, given & {"yaw", "pitch"}
    if not faults and missing:
        faults.append(Fault("", f"lacks {', '.join(missing)}; its columns are {COLUMNS}"))
    elif not faults and (bool(vector) == bool(angles) or (vector and len(vector) < 3)):
        faults.append(Fault("", "needs a direction: dx, dy and dz, or yaw_deg and pitch_deg"))
    if not faults and len(given & {"min", "max"}) == 1:
        faults.append(Fault("", "needs both limits, min and max, or neither"))
    return found


def _numbers(
    n: int, cells: Mapping[str, str], scales: Mapping[str, tuple[str, float]], faults: list[Fault]
) -> dict[str, float] | None:
    """The numbers of a row by quantity in SI or degrees; limits that are left empty are left out."""
    found, before = dict[str, float](), len(faults)
    for head, text in cells.items():
        quantity, factor = scales[head]
        if not text and quantity in ("min", "max"):
            continue
        try:
            value = float(text) * factor
        except ValueError:
            value = math.nan
        most = {"min": _STRONGEST, "max": _STRONGEST, "x": _FARTHEST, "y": _FARTHEST, "z": _FARTHEST}.get(quantity, 1e6)
        if math.isnan(value):
            unit = head.partition("_")[2]
            faults.append(Fault(f"row {n}, column {head}", f"{text!r} is not a number{number_hint(text, unit)}"))
        elif abs(value) > most:
            faults.append(Fault(f"row {n}, column {head}", f"{text} is beyond {most / factor:g}"))
        found[quantity] = value
    return found if len(faults) == before else None


def _thruster(
    n: int, name: str, numbers: Mapping[str, float], heads: list[str], faults: list[Fault]
) -> Thruster | None:
    if "dx" in numbers:
        direction = np.array([numbers[word] for word in _DIRECTION])
    else:
        direction = rotation_matrix(quat_from_euler_deg(0.0, numbers.get("pitch", 0.0), numbers.get("yaw", 0.0)))[:, 0]
        direction = np.where(np.abs(direction) < 1e-15, 0.0, direction)
    length = float(np.linalg.norm(direction))
    if length < 1e-6:
        faults.append(Fault(f"row {n}, columns dx, dy, dz", "the direction has no length"))
        return None
    low, high = numbers.get("min"), numbers.get("max")
    if (low is None) != (high is None):
        missing = next(head for head in heads if head.startswith("min" if low is None else "max"))
        faults.append(Fault(f"row {n}, column {missing}", "is empty; give both limits or neither"))
        return None
    if low is not None and high is not None and not low < high:
        faults.append(Fault(f"row {n}", f"the least thrust, {low:g} N, must be below the greatest, {high:g} N"))
        return None
    x, y, z = (direction / length).tolist()
    limits = None if low is None or high is None else (low, high)
    return Thruster(name, (numbers["x"], numbers["y"], numbers["z"]), (x, y, z), limits)


_INDENT = "\n      "
_LOOKS = ("geom", "replicate")
_HEAD = """<!--
  {name}: a copy of {origin}, to be edited.
{thrusters}
  uvms-mj vehicles {name}.xml                 its numbers as the program reads them
  uvms-mj run vehicle.model={name}.xml

  For a vehicle of your own, change mass, centre of gravity and inertia in <inertial>; displaced_mass,
  center_of_buoyancy, added mass and damping in <custom>; the thrusters, each a <site>, whose x axis is positive
  thrust, and a <motor>; and the geoms, whose foremost point touches the wall. Then say in "source" and "trust" where
  the numbers come from.
-->
"""


def copied(origin: str, mjcf_path: Path, name: str, thrusters: Sequence[Thruster], table: str) -> dict[str, bytes]:
    """The files of a copy of a vehicle, the main one ``NAME.xml`` first.

    Args:
        origin: the original, for its texts.
        mjcf_path: the vehicle's file.
        name: of the copy, of its body and of its file.
        thrusters: in place of its own; empty: its own.
        table: name of their table, for the texts.

    Raises:
        InputError: the vehicle can't be read, or its thrusters are not sites and motors of its files.
    """
    old = Mjcf.find(str(mjcf_path)).vehicle
    files = ModelFiles(mjcf_path).flat()
    main = mjcf_path.name
    trees = {each: parsed(each, data, comments=True) for each, data in files.items() if _is_xml(each, data)}
    _rename(trees, old.body, name)
    trees[main].set("model", name)
    if thrusters:
        _replace_thrusters(trees, main, name, old, thrusters)
    _mark(trees, main, name, origin, table if thrusters else "")
    said = f"  Its thrusters come from {table}.\n" if thrusters else ""
    prolog = re.split(rb"<mujoco\b", files[main], maxsplit=1)[0].decode("utf-8-sig", errors="replace")
    prolog = re.sub(r"<\?xml.*?\?>", "", prolog).strip()
    head = _HEAD.format(name=name, origin=origin, thrusters=said)
    texts = {each: ElementTree.tostring(tree, encoding="unicode") for each, tree in trees.items()}
    copies = {f"{name}.xml": f"{head}{prolog}\n{texts[main]}\n".encode()}
    for each, data in files.items():
        if each != main:
            copies[each] = texts[each].encode() if each in texts else data
    return copies


def unreachable(vehicle: Vehicle) -> str:
    """A sentence on what the thrusters can't produce, from the rank of B (6, n); empty if they span all six axes."""
    rank = axes_spanned(vehicle.B)
    if rank == 6:
        return ""
    left = unreached(vehicle.B)
    alone = [axis for axis, lost in zip(AXES, is_unreached(vehicle.B), strict=True) if lost]
    n = len(vehicle.thrusters)
    spans = f"its {n} thruster{'s span' if n > 1 else ' spans'} {rank} of 6 axes"
    rest = 6 - rank - len(alone)
    said = [f"they can't produce {' or '.join(alone)}"] if alone else []
    mixed = [axis for i, axis in enumerate(AXES) if axis not in alone and np.linalg.norm(left[i]) > LEAST]
    if rest:
        said.append(f"of {', '.join(mixed)} only {len(mixed) - rest} can be chosen")
    return f"{spans}: {'; '.join(said)}"


def _is_xml(name: str, data: bytes) -> bool:
    return Path(name).suffix.lower() in (".xml", ".mjcf") or data.lstrip()[:1] == b"<"


def _rename(trees: Mapping[str, Element], body: str, name: str) -> None:
    """Give the vehicle's body, and its free joint if it has the body's name, another name."""
    for element in _every(trees):
        if element.tag in ("body", "freejoint", "joint") and element.get("name") == body:
            element.set("name", name)


def _every(trees: Mapping[str, Element]) -> Iterator[Element]:
    for tree in trees.values():
        yield from (element for element in tree.iter() if isinstance(element.tag, str))


def _parents(trees: Mapping[str, Element]) -> dict[Element, Element]:
    return {child: parent for tree in trees.values() for parent in tree.iter() for child in parent}


def _replace_thrusters(
    trees: Mapping[str, Element], main: str, body: str, old: Vehicle, thrusters: Sequence[Thruster]
) -> None:
    """Take out the sites and the motors of the old thrusters, with the geoms in a frame of a site's own, and put in the
    new ones, which look like the first old one."""
    taken = {element.get("name") for element in _every(trees) if element.get("name")} - {*old.thrusters}
    parents, motors, looks = _parents(trees), list[Element](), list[Element]()
    sites = {element.get("name"): element for element in _every(trees) if element.tag == "site" and element.get("name")}
    driven = [e for e in _every(trees) if e.tag in ("motor", "general") and e.get("site") and e in parents]
    names = dict.fromkeys(e.get("site") for e in driven if parents[e].tag == "actuator")
    if len(names) != len(old.thrusters) or any(each not in sites for each in names):
        raise InputError(f"{main}: its thrusters can't be replaced: each must be a <site> of the file and its <motor>")
    taken -= {*names}
    for thruster in thrusters:
        if thruster.name in taken:
            raise InputError(f"{main}: {thruster.name!r} is the name of another element; give the thruster another one")
    for element in driven:
        if parents[element].tag == "actuator":
            motors.append(element)
    for each in names:
        site = sites[each]
        frame = parents[site]
        own = frame.tag == "frame" and all(e is site or not isinstance(e.tag, str) or e.tag in _LOOKS for e in frame)
        if own and not looks:
            looks = [e for e in frame if isinstance(e.tag, str) and e.tag in _LOOKS]
        _remove(parents, frame if own else site)
    actuator = parents[motors[0]]
    before = list(actuator)[: list(actuator).index(motors[0])]
    for motor in motors:
        _remove(parents, motor)
    at = sum(1 for element in actuator if element in before)
    base = next(e for e in _every(trees) if e.tag == "body" and e.get("name") == body)
    joints = [i for i, e in enumerate(base) if e.tag in ("freejoint", "joint", "inertial")]
    for i, thruster in enumerate(thrusters):
        base.insert(max(joints) + 1 + i, _frame(thruster, looks))
        actuator.insert(at + i, _motor(thruster))


def _remove(parents: Mapping[Element, Element], element: Element) -> None:
    """Take an element out, with the white space behind it and the comment before it."""
    parent = parents[element]
    at = list(parent).index(element)
    if at and not isinstance(parent[at - 1].tag, str):
        parent.remove(parent[at - 1])
    parent.remove(element)


def _text(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(x)).removesuffix(".0") for x in numbers)


def across(x: np.ndarray) -> np.ndarray:
    """A unit vector (3,) that is perpendicular to the unit vector x (3,)."""
    e = np.eye(3)[int(np.argmin(np.abs(x)))]
    y = np.cross(np.cross(x, e), x)
    return y / np.linalg.norm(y) + 0.0  # without a negative zero


def _frame(thruster: Thruster, looks: Sequence[Element]) -> Element:
    """A frame whose x axis is the direction of thrust, with the site and the geoms of a thruster."""
    y = across(np.array(thruster.direction))
    place = {"pos": _text(thruster.position), "xyaxes": f"{_text(thruster.direction)} {_text(y.tolist())}"}
    frame = Element("frame", place)
    site = ElementTree.SubElement(frame, "site", {"name": thruster.name})
    frame.text, site.tail, frame.tail = " ", f"{_INDENT}  ", _INDENT
    for look in looks:
        twin = copy.deepcopy(look)
        twin.attrib.pop("name", None)
        twin.tail = " "
        frame.append(twin)
    return frame


def _motor(thruster: Thruster) -> Element:
    given = {"name": thruster.name, "site": thruster.name, "gear": "1 0 0 0 0 0"}
    if thruster.limits is None:
        given["ctrllimited"] = "false"
    else:
        given["ctrlrange"] = _text(thruster.limits)
    motor = Element("motor", given)
    motor.tail = "\n    "
    return motor


def _mark(trees: Mapping[str, Element], main: str, name: str, origin: str, table: str) -> None:
    """Say in the texts of a vehicle that it is a changed copy, whose source and licence are the original's."""
    texts = {e.get("name"): e for e in _every(trees) if e.tag == "text"}
    changed = f"changed copy of {origin}" + (f", thrusters of {table}" if table else "")
    marks = {"description": f"{name}, {changed}", "trust": f"{changed}; the original"}
    for key, mark in marks.items():
        if key in texts:
            joint = ": " if key == "trust" else "; "
            texts[key].set("data", f"{mark}{joint}{texts[key].get('data', '')}")
        else:
            custom = trees[main].find("custom")
            if custom is None:
                custom = ElementTree.SubElement(trees[main], "custom")
            ElementTree.SubElement(custom, "text", {"name": key, "data": mark.removesuffix("; the original")})
