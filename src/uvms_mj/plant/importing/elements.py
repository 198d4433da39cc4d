"""Elements that SDF and URDF have in common: plugins, inertia, shapes and meshes."""

import math
import re
from xml.etree.ElementTree import Element

import numpy as np

from .moving import Pose
from .reading import Source, place_of, positive
from .shapes import Solid, mesh, primitive

_UNLIMITED = 1e6
"""From this on a limit of a joint is none [rad, m, N, N m, rad/s]."""
_WHOLE = re.compile(
    r"inertial|inertia|fluid_added_mass|axis|limit|dynamics|geometry|box|sphere|cylinder|capsule|ellipsoid"
)
"""Elements of which all are read once."""
_ONCE = {
    "model": ("pose",),
    "link": ("inertial", "pose"),
    "joint": ("axis", "pose", "parent", "child", "origin", "limit", "dynamics"),
    "collision": ("geometry", "pose", "origin"),
    "visual": ("geometry", "pose", "origin"),
}


def refuse_twice(source: Source, root: Element) -> None:
    """Raise InputError for a second element where one is read, whose number would be left out in silence."""
    walk = [(root, "")]
    while walk:
        element, before = walk.pop()
        place = f"{before} {place_of(element)}".strip()
        whole = _WHOLE.fullmatch(element.tag) or (
            element.tag == "plugin"
            and re.search(r"gz.*hydrodynamics|hydrodynamics-system|thruster-system", kind_of(element))
        )
        seen = set[str]()
        for each in element:
            if each.tag in seen and (whole or each.tag in _ONCE.get(element.tag, ())):
                raise source.fault(f"{place} <{each.tag}>", "is given twice: keep one")
            seen.add(each.tag)
            walk.append((each, place if element.tag in ("link", "joint", "inertial") else ""))


def plugins_of(element: Element) -> list[Element]:
    return list(element.iter("plugin"))


def without_water(element: Element) -> str:
    """What a file without coefficients of the water has in their place, and where the user can give them."""
    names = sorted({each.get("filename") or each.get("name") or "one without a name" for each in plugins_of(element)})
    said = f"its plugins are {', '.join(names)}" if names else "it has no plugin"
    return (
        f"{said}; without coefficients of the water, as from CAD, it is no vehicle: give its numbers and theirs in a "
        "table, --from NAME.toml, or by hand in the file that uvms-mj new vehicle NAME writes"
    )


def kind_of(plugin: Element) -> str:
    """The words by which a plugin is known, in lower case."""
    return f"{plugin.get('filename', '')} {plugin.get('name', '')}".lower()


_READ = re.compile(
    r"hydrodynamics|underwater_object|thruster|motor_?model|lift[-_]?drag|fin_ros|uuv_fin|buoyancy|"
    r"joint[-_]?(position|velocity)?[-_]?controller"
)
"""Parts of the names of plugins that are read, or about which there is a sentence."""


def say_unread(source: Source, root: Element) -> None:
    """Say the sensors of a description, and the plugins that are not read."""
    for each in root.iter("sensor"):
        source.say("sensors are settings of a scenario, [navigation]: left out", each.get("name", "sensor"))
    for plugin in plugins_of(root):
        if not _READ.search(kind_of(plugin)):
            source.say("plugins that are not read", plugin.get("name") or plugin.get("filename") or "plugin")


def inertia_of(source: Source, element: Element | None, place: str) -> np.ndarray:
    """(3, 3) from the elements of SDF or the attributes of URDF; ones on the diagonal if there is none, as in SDF."""
    if element is None:
        return np.eye(3)

    def of(key: str, default: str) -> float:
        return source.number(element.get(key) or element.findtext(key) or default, f"{place} {key}")

    ixx, iyy, izz = (of(key, "1") for key in ("ixx", "iyy", "izz"))
    ixy, ixz, iyz = (of(key, "0") for key in ("ixy", "ixz", "iyz"))
    return np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])


def limit_of(source: Source, text: str | None, place: str) -> float | None:
    """A limit of a joint; None without one, and for a number so large or infinite that it is none."""
    words = (text or "").strip().lower()
    if text is None or re.fullmatch(r"[+-]?inf(inity)?", words):
        return None
    try:
        value = float(words)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        value = source.number(text, place)  # its message
    return value if abs(value) < _UNLIMITED else None


def shape_of(source: Source, kind: str, lengths: list[float], pose: Pose, name: str, place: str) -> Solid:
    for each in lengths:
        positive(source, each, place)
    return primitive(kind, lengths, pose, name)  # pyrefly: ignore


def mesh_of(source: Source, uri: str, scale: str, pose: Pose, name: str, place: str) -> Solid:
    """A mesh of a file in the folders named; where the file isn't there, a shape without a volume."""
    three = source.numbers(scale, f"{place} scale", 1, 3)
    three = three * 3 if len(three) == 1 else three
    suffix = f".{uri.rpartition('.')[2].lower()}"
    if suffix not in (".stl", ".obj"):
        return mesh_unread(uri, pose, name)
    path = source.referred(uri, place)
    if not path.is_file():
        raise source.fault(place, f"refers to the mesh {uri}, which is not there")
    source_size = path.stat().st_size
    if source_size > 10 * 2**20:
        raise source.fault(place, f"its mesh {path.name} is larger than 10 MiB")
    return mesh(path, three, pose, name)


def mesh_unread(uri: str, pose: Pose, name: str) -> Solid:
    called = uri.replace("\\", "/").rpartition("/")[2]
    return Solid(
        None, (0.0, 0.0, 0.0), pose, None, pose.p, f"its mesh {called} is not read: only STL and OBJ are", name
    )
