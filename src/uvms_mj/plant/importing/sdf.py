"""SDF of Gazebo: a model with the Hydrodynamics of gz-sim, or with the plugins of the UUV Simulator.

The model with its frames, links and joints is read here, and its plugins in :mod:`.gz_sim` and :mod:`.uuv`. Buoyancy
acts on the volume of the collision shapes.
"""

import dataclasses
import math
from xml.etree.ElementTree import Element

import numpy as np

from ..record import word
from .bodies import HINGES, SLIDES, Description, Joint, Link, Water
from .elements import (
    inertia_of,
    kind_of,
    limit_of,
    mesh_of,
    plugins_of,
    refuse_twice,
    say_unread,
    shape_of,
    without_water,
)
from .fins import lift_drag
from .gz_sim import buoyancies, fluid_added_mass, gz_density, gz_servos, gz_thruster, gz_water
from .moving import HERE, Pose
from .reading import Source, one_of, place_of
from .shapes import Solid
from .uuv import uuv_fin, uuv_thruster, uuv_water


def described(source: Source, root: Element) -> Description:
    """The vehicle of an SDF file. Raises InputError with the place of what is wrong."""
    model = _the_model(source, root)
    return _Model(source, root, model).description()


def _waters(model: Element) -> list[Element]:
    return [
        each for each in plugins_of(model) if "hydrodynamics" in kind_of(each) or "underwater_object" in kind_of(each)
    ]


def _mark(collision: Element) -> str | None:
    """The attribute gz:buoyancy of a collision shape, in whatever namespace."""
    return next((value for key, value in collision.attrib.items() if key.rpartition("}")[2] == "buoyancy"), None)


def _the_model(source: Source, root: Element) -> Element:
    """The model with hydrodynamics, which may be in a file that is included. Raises InputError unless there is one."""
    tops = [root, *root.findall("world")]
    models = [each for top in tops for each in top.findall("model")]
    includes = [each for top in tops for each in top.findall("include")]
    wet = [each for each in models if _waters(each)] + [_included(source, each) for each in includes if _waters(each)]
    if not wet:  # the plugin may be in the included file, as in a world with one vehicle and a sea floor
        models += [_included(source, each) for each in includes if not models or _is_named(source, each)]
        wet = [each for each in models if _waters(each) or _has_wet_include(source, each)]
        wet = wet or models[:1] * (len(models) == 1)
    names = ", ".join(repr(each.get("name")) for each in wet or models)
    if not wet:
        said = f"its models are {names}" if models else "it has no <model>"
        raise source.fault("<sdf>", f"has no model with a Hydrodynamics plugin: {said}")
    if len(wet) > 1:
        raise source.fault("<sdf>", f"has {len(wet)} models with hydrodynamics, {names}: keep one in the file")
    return wet[0]


def _has_wet_include(source: Source, model: Element) -> bool:
    return any(_waters(_included(source, each)) for each in model.findall("include"))


def _is_named(source: Source, include: Element) -> bool:
    """Whether the user named the folder of an <include>."""
    uri = (include.findtext("uri") or "").strip()
    return (uri.partition("://")[2] or uri).strip("/").split("/")[0] in source.packages


def _included(source: Source, include: Element) -> Element:
    """The model of an <include>, with the plugins that the include adds."""
    uri = (include.findtext("uri") or "").strip()
    place = f"<include> {uri}"
    name = uri.partition("://")[2] or uri
    folder = source.package(name.strip("/").split("/")[0], place) if "://" not in uri else source.referred(uri, place)
    folder = source.within(folder, place)
    path = folder / "model.sdf" if folder.is_dir() else folder
    root = source.xml(source.text(path, place), place)
    refuse_twice(source, root)
    model = root.find("model")
    if model is None:
        way = ": it is URDF, and `gz sdf -p FILE` writes the whole as SDF" if root.tag == "robot" else ""
        raise source.fault(place, f"{path.name} has no <model>{way}")
    model.extend([each for each in include if each.tag == "plugin"])
    if include.findtext("name"):
        model.set("name", (include.findtext("name") or "").strip())
    return model


class _Model:
    """The elements of a model by name, with the frames in which their poses are given."""

    def __init__(self, source: Source, root: Element, model: Element) -> None:
        self.source, self.root, self.model = source, root, model
        self.name = model.get("name", "")
        self.links: dict[str, Element] = {}
        self.joints: dict[str, Element] = {}
        self.poses: dict[str, tuple[Pose, str, str]] = {}
        """Of each frame: pose, the frame in which it stands, and its place."""
        self._scopes: dict[str, tuple[str, str]] = {}
        """Of each frame: the prefix of the names of its model, and the frame of that model."""
        self._resolved: dict[str, Pose] = {"__model__": HERE, "": HERE, "world": HERE}
        self._collect(model, "")
        enabled = [each for plugin in buoyancies(root) for each in plugin.findall("enable")]
        self._enabled = {(each.text or "").strip() for each in enabled}
        self._marked = any(
            _mark(each) is not None for link in self.links.values() for each in link.findall("collision")
        )

    def _collect(self, model: Element, prefix: str, top: str = "__model__") -> None:
        """Collect the elements of a model whose names get a prefix; ``top`` is the frame of the model."""
        for each in list(model):
            name, default, inner = prefix + each.get("name", ""), top, each
            if each.tag not in ("link", "joint", "frame", "model", "include"):
                continue
            if each.tag == "include":
                inner = _included(self.source, each)
                merged = each.get("merge") == "true"
                name = (
                    f"{prefix}{inner.get('name')}" if not merged else f"{prefix}_merged__{inner.get('name')}__model__"
                )
                known = [*self.model.iter("plugin")]
                self.model.extend([plugin for plugin in inner.iter("plugin") if plugin not in known])
            elif not each.get("name"):
                raise self.source.fault(place_of(model, f"<{each.tag}>"), "has no name")
            if name in self.poses:
                raise self.source.fault(place_of(each), f"the name {name!r} is given twice")
            placed_by = (each.get("placement_frame"), each.findtext("placement_frame"), inner.get("placement_frame"))
            if each.tag in ("model", "include") and any(placed_by):
                raise self.source.fault(
                    place_of(each), "has a placement_frame, which is not read: give the pose of the model itself"
                )
            self._scopes[name] = prefix, top
            if each.tag == "link":
                self.links[name] = each
            elif each.tag == "joint":
                self.joints[name] = each
                default = prefix + (each.findtext("child") or "").strip()
            elif each.tag == "frame" and each.get("attached_to"):
                default = self._named(each.get("attached_to", ""), name)
            placed = each if each.find("pose") is not None else inner
            pose, relative = self._pose(placed, place_of(each))
            self.poses[name] = pose, self._named(relative, name) if relative else default, place_of(each)
            if each.tag in ("model", "include"):
                self._collect(inner, prefix if each.get("merge") == "true" else f"{name}::", name)

    def _named(self, frame: str, within: str) -> str:
        """The frame that an element means, which is in the model of the frame ``within``."""
        prefix, top = self._scopes[within]
        return top if frame == "__model__" else prefix + frame

    def _pose(self, element: Element, place: str) -> tuple[Pose, str]:
        """The pose that an element gives, and the frame that it names; here and none if it gives none."""
        given = element.find("pose")
        if given is None or not (given.text or "").strip():
            return HERE, "" if given is None else given.get("relative_to", "")
        place = f"{place} <pose>"
        degrees = self.source.truth(given.get("degrees"), place)
        if given.get("rotation_format", "euler_rpy") == "quat_xyzw":
            x, y, z, *quat = self.source.numbers(given.text, place, 7)
            from scipy.spatial.transform import Rotation

            if not any(quat):
                raise self.source.fault(place, "its quaternion is zero")
            return Pose(Rotation.from_quat(quat).as_matrix(), np.array([x, y, z])), given.get("relative_to", "")
        six = self.source.numbers(given.text, place, 6)
        if not degrees and max(map(abs, six[3:])) > 2.0 * math.pi + 0.01:
            raise self.source.fault(
                place, 'has an angle of more than a turn: SDF has radians; write degrees="true" if they are degrees'
            )
        return Pose.of_rpy(six[:3], six[3:], degrees), given.get("relative_to", "")

    def in_model(self, name: str, place: str, behind: tuple[str, ...] = ()) -> Pose:
        """The pose of a frame in the model."""
        if name in self._resolved:
            return self._resolved[name]
        if name in behind:
            raise self.source.fault(place, f"its pose leads back to {name!r}")
        one_of(self.source, name, self.poses, place, "frame")
        pose, relative, at = self.poses[name]
        self._resolved[name] = self.in_model(relative, at, (*behind, name)) @ pose
        return self._resolved[name]

    def description(self) -> Description:
        source = self.source
        water, base = self._water()
        links = {name: self._link(name, each) for name, each in self.links.items()}
        joints = [self._joint(name, each) for name, each in self.joints.items()]
        about = Description(source, word(self.name or base), base, links, joints, water)
        about.from_volume = not any("underwater_object" in kind_of(each) for each in _waters(self.model))
        if about.from_volume:
            about.density = gz_density(source, self.root, _waters(self.model))
        for plugin in plugins_of(self.model):
            self._plugin(about, plugin)
        gz_servos(about, self.model)
        say_unread(source, self.model)
        return about

    def _water(self) -> tuple[dict[str, Water], str]:
        """The water of each link, and the name of the first one, the base."""
        found: dict[str, Water] = {}
        plugins = _waters(self.model)
        if not plugins:
            raise self.source.fault(place_of(self.model), f"has no Hydrodynamics plugin: {without_water(self.model)}")
        for plugin in plugins:
            place = place_of(plugin)
            if "underwater_object" in kind_of(plugin):
                found |= uuv_water(self.source, plugin, self.links)
                continue
            name = one_of(
                self.source, (plugin.findtext("link_name") or "").strip(), self.links, f"{place} <link_name>", "link"
            )
            if name in found:
                raise self.source.fault(place, f"is the second one of the link {name!r}")
            found[name] = gz_water(self.source, plugin, self.links[name], place)
        base = next(iter(found))
        for name, link in self.links.items():
            if name not in found and link.find("inertial/fluid_added_mass") is not None:
                found[name] = Water(M_A=fluid_added_mass(self.source, link))
        return found, base

    def _link(self, name: str, element: Element) -> Link:
        place, source = place_of(element), self.source
        link = Link(name, place)
        inertial = element.find("inertial")
        if inertial is not None:
            at = f"{place} <inertial>"
            if source.truth(inertial.get("auto"), at):
                raise source.fault(at, 'is auto="true": the mass of the shapes is not computed; write mass and inertia')
            pose, relative = self._pose(inertial, at)
            if relative:
                raise source.fault(f"{at} <pose>", "has relative_to: SDF has the inertia in the frame of its link only")
            link.mass = source.number(inertial.findtext("mass", "1"), f"{at} <mass>")
            if link.mass < 0.0:
                raise source.fault(f"{at} <mass>", f"{link.mass:g}: must not be negative")
            link.r_g = pose.p
            inertia = inertial.find("inertia")
            if inertia is not None and inertia.attrib:
                source.say("its inertia is in attributes, as in URDF: they are read here, and Gazebo reads none", name)
            link.I_g = pose.R @ inertia_of(source, inertia, f"{at} <inertia>") @ pose.R.T
        for tag, solids in (("collision", link.solids), ("visual", link.drawn)):
            for each in element.findall(tag):
                solid = self._solid(each, name, place_of(element, each))
                if solid is not None:
                    solids.append(solid if tag == "visual" else self._afloat(each, name, solid))
        if any(each.kind is None for each in link.drawn) and any(each.kind for each in link.solids):
            link.drawn = []  # the collision shapes stand for meshes that are not read
        return link

    def _afloat(self, collision: Element, link: str, solid: Solid) -> Solid:
        """A collision shape, without a volume if the source has buoyancy for others alone: shapes that a Buoyancy
        plugin enables by their scoped names, or shapes with the attribute gz:buoyancy if any has it."""
        why = ""
        scopes = f"{self.name}::{link}::{collision.get('name')}".split("::")
        if self._enabled and not {"::".join(scopes[: i + 1]) for i in range(len(scopes))} & self._enabled:
            why = "is not among what the Buoyancy plugin enables"
        if self._marked and not self.source.truth(_mark(collision), f"{place_of(collision)} buoyancy"):
            why = "is not marked with gz:buoyancy, as others are"
        if not why:
            return solid
        return dataclasses.replace(solid, volume=None, reason=f"its shape {collision.get('name')} {why}")

    def _solid(self, element: Element, link: str, place: str) -> Solid | None:
        pose, relative = self._pose(element, place)
        if relative:
            pose = self.in_model(link, place).inverse() @ self.in_model(self._named(relative, link), place) @ pose
        geometry = element.find("geometry")
        if geometry is None or not len(geometry):
            return None
        return _geometry(self.source, geometry[0], pose, element.get("name", ""), f"{place} <{geometry[0].tag}>")

    def _joint(self, name: str, element: Element) -> Joint:
        place, source = place_of(element), self.source
        prefix, top = self._scopes[name]
        parent, child = (prefix + (element.findtext(tag) or "").strip() for tag in ("parent", "child"))
        parent = "world" if parent == f"{prefix}world" else parent
        for end in (parent, child):
            if end != "world":
                one_of(source, end, [*self.links, *self.poses], place, "link")
        parent, child = self._link_of(parent), self._link_of(child)
        kind = element.get("type", "")
        in_parent = self.in_model(parent, place).inverse() if parent != "world" else HERE
        below = self.in_model(child, place)
        here = below.inverse() @ self.in_model(name, place)
        joint = Joint(name, place, kind, parent, child, in_parent @ below, np.array([0.0, 0.0, 1.0]), here.p)
        axis = element.find("axis")
        if kind not in (*HINGES, *SLIDES):
            return joint
        xyz = axis.find("xyz") if axis is not None else None
        given = np.array(source.numbers(xyz.text if xyz is not None else "0 0 1", f"{place} <axis> <xyz>", 3))
        if not np.linalg.norm(given) > 1e-9:
            raise source.fault(f"{place} <axis> <xyz>", "has no length")
        frame = here.R
        if xyz is not None and xyz.get("expressed_in"):
            frame = below.R.T @ self.in_model(self._named(xyz.get("expressed_in", ""), name), place).R
        elif axis is not None and source.truth(
            axis.findtext("use_parent_model_frame"), f"{place} <use_parent_model_frame>"
        ):
            frame = below.R.T @ self.in_model(top, place).R
        joint.axis = frame @ given / np.linalg.norm(given)
        if axis is None:
            return joint

        lower, upper, effort, speed = (
            limit_of(source, axis.findtext(f"limit/{tag}"), f"{place} <axis> <limit> <{tag}>")
            for tag in ("lower", "upper", "effort", "velocity")
        )
        if lower is not None and upper is not None:
            if lower > upper:
                raise source.fault(
                    f"{place} <axis> <limit>", f"its lower limit {lower:g} is above the upper one {upper:g}"
                )
            joint.limits = lower, upper
        joint.effort = None if effort is None or effort < 0.0 else effort
        joint.speed_limit = None if speed is None or speed <= 0.0 else speed
        joint.damping = self._not_negative(
            axis.findtext("dynamics/damping", "0"), f"{place} <axis> <dynamics> <damping>"
        )
        joint.friction = self._not_negative(
            axis.findtext("dynamics/friction", "0"), f"{place} <axis> <dynamics> <friction>"
        )
        stiffness = source.number(axis.findtext("dynamics/spring_stiffness", "0"), f"{place} <spring_stiffness>")
        if stiffness:
            source.say(f"a spring of {stiffness:g} is left out: springs of joints are not computed", name)
        return joint

    def _not_negative(self, text: str, place: str) -> float:
        value = self.source.number(text, place)
        if value < 0.0:
            raise self.source.fault(place, f"{value:g}: must not be negative")
        return value

    def _link_of(self, name: str) -> str:
        """The link to which a frame is attached."""
        for _ in range(len(self.poses) + 1):
            if name in self.links or name == "world":
                return name
            pose = self.poses.get(name)
            if pose is None:
                break
            name = pose[1]
        return name

    def _plugin(self, about: Description, plugin: Element) -> None:
        """The part that a plugin adds to a vehicle: a thruster, or a sentence about a fin or an engine."""
        source, kind, place = self.source, kind_of(plugin), place_of(plugin)
        if "uuv_thruster" in kind or "thruster_ros" in kind:
            uuv_thruster(about, plugin)
        elif "thruster" in kind or "motormodel" in kind or "motor_model" in kind:
            gz_thruster(about, plugin)
        elif "liftdrag" in kind.replace("-", "") or "lift_drag" in kind:
            self._fin(about, plugin, place)
        elif "fin_ros" in kind:
            uuv_fin(about, plugin)
        elif "buoyancy" in kind and "engine" in kind:
            name = plugin.findtext("link_name") or ""
            source.say(f"the buoyancy engine of {name!r} is left out: a volume that changes in a run is not computed")

    def _fin(self, about: Description, plugin: Element, place: str) -> None:
        name = one_of(
            self.source, (plugin.findtext("link_name") or "").strip(), self.links, f"{place} <link_name>", "link"
        )
        controlled = (plugin.findtext("control_joint_name") or "").strip()
        for joint in about.joints:
            if joint.child == name or joint.name == controlled:
                joint.welded = joint.welded or "the fin"
        lift_drag(self.source, plugin, place, self._to_base(about, name), name)

    def _to_base(self, about: Description, name: str) -> Pose:
        return self.in_model(about.base, about.base).inverse() @ self.in_model(name, name)


_LENGTHS = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "ellipsoid": ("radii",),
}


def _geometry(source: Source, element: Element, pose: Pose, name: str, place: str) -> Solid | None:
    kind = element.tag
    if kind in ("plane", "empty", "heightmap", "image", "polyline"):
        return None
    if kind == "mesh":
        return mesh_of(source, element.findtext("uri") or "", element.findtext("scale") or "1 1 1", pose, name, place)
    if kind not in _LENGTHS:
        return Solid(None, (0.0, 0.0, 0.0), pose, None, pose.p, f"its shape {kind} is not known", name)
    counts = {"size": 3, "radii": 3}
    lengths: list[float] = []
    for tag in _LENGTHS[kind]:
        lengths += source.numbers(element.findtext(tag), f"{place} <{tag}>", counts.get(tag, 1))
    return shape_of(source, kind, lengths, pose, name, place)
