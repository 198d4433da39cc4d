"""URDF, also expanded from xacro: links, joints, and the numbers of the plugins of the UUV Simulator or of gz-sim."""

import math
from xml.etree.ElementTree import Element

import numpy as np

from ..record import word
from .bodies import Description, Joint, Link, Water
from .elements import inertia_of, kind_of, limit_of, mesh_of, plugins_of, say_unread, shape_of, without_water
from .gz_sim import gz_density, gz_servos, gz_thruster, gz_water
from .moving import HERE, Pose
from .reading import Source, one_of, place_of
from .shapes import Solid
from .uuv import uuv_fin, uuv_thruster, uuv_water

_AS_SDF = "`gz sdf -p FILE` writes the whole as SDF"


def described(source: Source, root: Element) -> Description:
    """The vehicle of a URDF file. Raises InputError with the place of what is wrong."""
    links = {each.get("name", ""): _link(source, each) for each in root.findall("link")}
    if len(links) < len(root.findall("link")):
        raise source.fault("<robot>", "has two links of one name, or one without a name")
    joints = [_joint(source, each) for each in root.findall("joint")]
    elements = {each.get("name", ""): each for each in root.findall("link")}
    models = [each for each in plugins_of(root) if "underwater_object" in kind_of(each)]
    hydro = [] if models else [each for each in plugins_of(root) if "hydrodynamics" in kind_of(each)]
    if not models and not hydro:
        known = "libuuv_underwater_object plugin and no Hydrodynamics of gz-sim"
        raise source.fault("<robot>", f"has no {known}: {without_water(root)}")
    water: dict[str, Water] = {}
    for plugin in models:
        water |= uuv_water(source, plugin, elements)
    for plugin in hydro:
        place = place_of(plugin)
        name = one_of(source, (plugin.findtext("link_name") or "").strip(), elements, f"{place} <link_name>", "link")
        if name in water:
            raise source.fault(place, f"is the second one of the link {name!r}")
        water[name] = gz_water(source, plugin, elements[name], place)
    base = next(iter(water))
    about = Description(source, word(root.get("name") or base), base, links, joints, water)
    if hydro:
        _refuse_sdf(source, root)
        about.from_volume, about.density = True, gz_density(source, root, hydro)
    for plugin in plugins_of(root):
        kind = kind_of(plugin)
        if "thruster" in kind and ("uuv" in kind or hydro):
            (uuv_thruster if "uuv" in kind else gz_thruster)(about, plugin)
        elif "fin_ros" in kind or "uuv_fin" in kind:
            uuv_fin(about, plugin)
        elif hydro and "lift" in kind and "drag" in kind:
            raise source.fault(place_of(plugin), f"is read from SDF: {_AS_SDF}")
    if hydro:
        gz_servos(about, root)
    say_unread(source, root)
    return about


def _refuse_sdf(source: Source, root: Element) -> None:
    """Raise InputError for elements of SDF in a <gazebo> block, which gz-sim would take over as they are."""
    for block in root.findall("gazebo"):
        for each in block:
            if each.tag in ("link", "joint", "model", "collision", "frame", "include"):
                raise source.fault(f"<gazebo> {place_of(each)}", f"is SDF in URDF: {_AS_SDF}")


def _pose(source: Source, element: Element | None, place: str) -> Pose:
    origin = element.find("origin") if element is not None else None
    if origin is None:
        return HERE
    place = f"{place} <origin>"
    rpy = source.numbers(origin.get("rpy", "0 0 0"), f"{place} rpy", 3)
    if max(map(abs, rpy)) > 2.0 * math.pi + 0.01:
        raise source.fault(f"{place} rpy", "has an angle of more than a turn: URDF has radians")
    return Pose.of_rpy(source.numbers(origin.get("xyz", "0 0 0"), f"{place} xyz", 3), rpy)


def _link(source: Source, element: Element) -> Link:
    place = place_of(element)
    link = Link(element.get("name", ""), place)
    inertial = element.find("inertial")
    if inertial is not None:
        at = f"{place} <inertial>"
        pose = _pose(source, inertial, at)
        mass = inertial.find("mass")
        link.mass = source.number(mass.get("value") if mass is not None else None, f"{at} <mass>")
        if link.mass < 0.0:
            raise source.fault(f"{at} <mass>", f"{link.mass:g}: must not be negative")
        link.r_g = pose.p
        if inertial.find("inertia") is None:
            raise source.fault(at, "has no <inertia>")
        link.I_g = pose.R @ inertia_of(source, inertial.find("inertia"), f"{at} <inertia>") @ pose.R.T
    for tag, solids in (("collision", link.solids), ("visual", link.drawn)):
        for each in element.findall(tag):
            solid = _solid(source, each, place_of(element, each))
            if solid is not None:
                solids.append(solid)
    if any(each.kind is None for each in link.drawn) and any(each.kind for each in link.solids):
        link.drawn = []
    return link


def _solid(source: Source, element: Element, place: str) -> Solid | None:
    pose = _pose(source, element, place)
    geometry = element.find("geometry")
    if geometry is None or not len(geometry):
        return None
    shape, name = geometry[0], element.get("name", "")
    place = f"{place} <{shape.tag}>"
    if shape.tag == "mesh":
        return mesh_of(source, shape.get("filename", ""), shape.get("scale", "1 1 1"), pose, name, place)
    keys = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}
    if shape.tag not in keys:
        return Solid(None, (0.0, 0.0, 0.0), pose, None, pose.p, f"its shape {shape.tag} is not known", name)
    lengths: list[float] = []
    for key in keys[shape.tag]:
        lengths += source.numbers(shape.get(key), f"{place} {key}", 3 if key == "size" else 1)
    if max(lengths) < 1e-4:
        return None  # a placeholder, which Gazebo needs for the pose of a joint
    return shape_of(source, shape.tag, lengths, pose, name, place)


def _joint(source: Source, element: Element) -> Joint:
    place = place_of(element)

    def end(tag: str) -> str:
        found = element.find(tag)
        name = found.get("link", "") if found is not None else ""
        if not name:
            raise source.fault(place, f"has no <{tag} link=...>")
        return name

    axis = element.find("axis")
    xyz = np.array(source.numbers(axis.get("xyz") if axis is not None else "1 0 0", f"{place} <axis>", 3))
    kind = element.get("type", "")
    if kind not in ("fixed", "floating") and np.linalg.norm(xyz) < 1e-9:
        raise source.fault(f"{place} <axis>", "has no length")
    xyz = xyz / (np.linalg.norm(xyz) or 1.0)
    pose = _pose(source, element, place)
    joint = Joint(element.get("name", ""), place, kind, end("parent"), end("child"), pose, xyz, np.zeros(3))
    limit = element.find("limit")

    def of(key: str, default: float) -> float:
        text = None if limit is None else limit.get(key)
        return default if text is None else source.number(text, f"{place} <limit> {key}")

    if limit is not None and kind in ("revolute", "prismatic"):
        lower, upper = (limit_of(source, limit.get(key, "0"), f"{place} <limit> {key}") for key in ("lower", "upper"))
        if lower is not None and upper is not None:
            if lower > upper:
                raise source.fault(f"{place} <limit>", f"its lower limit {lower:g} is above the upper one {upper:g}")
            if kind == "revolute" and max(abs(lower), abs(upper)) > 4.0 * math.pi:
                way = "URDF has radians, and a continuous joint no limit"
                raise source.fault(f"{place} <limit>", f"{lower:g} to {upper:g} is more than two turns: {way}")
            joint.limits = lower, upper
    if limit is not None:
        joint.effort = of("effort", 0.0) or None
        joint.speed_limit = of("velocity", 0.0) or None
    dynamics = element.find("dynamics")
    if dynamics is not None:
        joint.damping = source.number(dynamics.get("damping", "0"), f"{place} <dynamics> damping")
        joint.friction = source.number(dynamics.get("friction", "0"), f"{place} <dynamics> friction")
        if min(joint.damping, joint.friction) < 0.0:
            raise source.fault(f"{place} <dynamics>", "damping and friction must not be negative")
    mimic = element.find("mimic")
    if mimic is not None:
        source.say(f"mimics {mimic.get('joint')!r} in the source; here it moves freely", joint.name)
    return joint
