"""A copy of a vehicle's file under another name, for its owner to edit, with other thrusters if a table gives them."""

import copy
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import InputError
from .mjcf import Mjcf
from .mjcf_files import ModelFiles, parsed
from .thruster_table import Thruster
from .vehicle import AXES, Vehicle

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
        origin: what it is a copy of, for its texts.
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
    said = f"  Its thrusters are those of {table}.\n" if thrusters else ""
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
    U, sizes, _ = np.linalg.svd(vehicle.B)
    rank = int((sizes > 1e-9 * max(sizes[0], 1e-300)).sum())
    if rank == 6:
        return ""
    left = U[:, rank:]  # of wrenches without any part that they produce
    alone = [axis for i, axis in enumerate(AXES) if np.linalg.norm(left[i]) > 1.0 - 1e-9]
    n = len(vehicle.thrusters)
    spans = f"its {n} thruster{'s span' if n > 1 else ' spans'} {rank} of 6 axes"
    rest = 6 - rank - len(alone)
    said = [f"they can't produce {' or '.join(alone)}"] if alone else []
    mixed = [axis for i, axis in enumerate(AXES) if axis not in alone and np.linalg.norm(left[i]) > 1e-9]
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


def _frame(thruster: Thruster, looks: Sequence[Element]) -> Element:
    """A frame whose x axis is the direction of thrust, with the site and the geoms of a thruster."""
    x = np.array(thruster.direction)
    across = np.eye(3)[int(np.argmin(np.abs(x)))]
    y = np.cross(np.cross(x, across), x)
    y = y / np.linalg.norm(y) + 0.0  # without a negative zero
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
    """Say in the texts of a vehicle that it is a changed copy, whose source and licence are those of the original."""
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
