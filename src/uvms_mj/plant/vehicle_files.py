"""Contents of a vehicle's file: known elements, and of their objects the parts that a run takes over; all else has its
default.

MuJoCo reads the file into a spec (MjSpec), with default classes, includes and attached parts resolved.
:func:`check_specs` compares each object of it with a new one: attributes that are not in :data:`ACCEPTED` must be the
same. :func:`check_xml` checks before what a spec does not show, and :func:`check_model` the compiled model.
"""

import contextlib
import functools
import itertools
import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from ..errors import Fault, InputError, suggestion

LARGEST_NUMBER = 1e10
"""MuJoCo's mjMAXVAL: a larger number in a state means that the simulation has diverged."""
MOST_ELEMENTS = 10_000
"""Bound on a model's elements, counting each copy by <replicate>. MuJoCo's compile time grows with their square."""
_AT_MOST = {"count": MOST_ELEMENTS, "params": 200, "width": 4096, "height": 4096, "gridsize": 64, "nchannel": 4}
"""Bounds on what MuJoCo makes: copies of an element, vertices of a mesh, which grow with the square, and pixels."""

_ELEMENTS = (
    *("mujoco", "include", "compiler", "option", "statistic", "default", "custom", "numeric", "text"),
    *("visual", "global", "quality", "headlight", "map", "scale", "rgba", "light", "camera"),
    *("asset", "texture", "material", "layer", "mesh", "model", "attach", "frame", "replicate"),
    *("worldbody", "body", "inertial", "freejoint", "joint", "geom", "site", "actuator", "motor", "general"),
)
"""MuJoCo must not read any other. It makes all parts of some at once, and loads plugins."""
_JOINT = "group limited type pos axis range"
_SHAPE = "type group pos quat alt size fromto rgba material meshname"
ACCEPTED: Mapping[str, str] = {
    "option": "integrator cone timestep gravity",
    "compiler": "authored degree eulerseq autolimits meshdir texturedir inertiafromgeom inertiagrouprange fitaabb "
    "fusestatic usethread",
    "statistic": "center extent meansize meanmass",
    "body": "simple pos quat alt mass ipos iquat ialt inertia fullinertia explicitinertial",
    "frame": "pos quat alt",
    "freejoint": f"{_JOINT} align",
    "joint": f"{_JOINT} damping armature frictionloss",
    "geom": f"{_SHAPE} contype conaffinity mass density typeinertia fitscale",
    "site": _SHAPE,
    "motor": "type group target trntype gear gainprm ctrllimited ctrlrange forcelimited forcerange",
    "mesh": "file content_type material scale refpos refquat inertia smoothnormal",
    "numeric": "data size",
}
"""By kind of object: the attributes that a run takes over, as MjSpec names them. Others are for the eye only."""

_THRUSTER = "a thruster is a <motor> on a site, and a joint's motor a <motor> on a joint"
_ORDERED = (lambda x: x[0] < x[1] or not any(x)), "must be two numbers, the lower limit first"
_RULES: Mapping[str, tuple[Callable[[Any], bool], str]] = {
    "compiler inertiafromgeom": (lambda x: x != "true", "it would override <inertial>; leave it out"),
    "freejoint align": (lambda x: x != "true", "it would rotate the body frame of the coefficients; leave it out"),
    "joint damping": (lambda x: x[0] >= 0.0 and not any(x[1:]), "must be one number that is not negative"),
    **dict.fromkeys(("joint armature", "joint frictionloss"), (lambda x: x >= 0.0, "must not be negative")),
    **dict.fromkeys(("joint range", "freejoint range", "motor ctrlrange", "motor forcerange"), _ORDERED),
    "joint type": (lambda x: x != "ball", "must be 'hinge' or 'slide'; chain three hinges for a ball"),
    "geom type": (lambda x: x not in ("hfield", "sdf"), "must be a primitive shape or a mesh"),
}
"""By kind and attribute: the condition of an accepted attribute, and the message if it does not hold."""

_WATER = "hydrodynamic forces come from the coefficients in <custom>"
_INSTEAD: Mapping[str, str] = {
    "keyframe": "a run starts from the scenario's [initial]",
    "tuple": "write coefficients as <numeric> and remarks as <text>",
    **dict.fromkeys(("position", "velocity", "intvelocity", "orientation", "pid", "damper"), _THRUSTER),
    **dict.fromkeys(("cylinder", "muscle", "adhesion", "dcmotor"), _THRUSTER),
    **dict.fromkeys(("option density", "option viscosity", "option wind"), _WATER),
    **dict.fromkeys(
        ("freejoint damping", "freejoint armature", "freejoint frictionloss"), f"on a free joint, {_WATER}"
    ),
    "body gravcomp": "buoyancy is displaced_mass times gravity",
    "joint stiffness": "springs are not computed",
}
"""The substitute of a run for an element, or for an attribute of a kind."""

_OF_A_RUN: Mapping[str, tuple[str, str]] = {
    "timestep": ("0.0001", "simulation.timestep"),
    "integrator": ("Euler", "simulation.integrator"),
    "cone": ("elliptic pyramidal", "no friction cone: the scenario's walls have the friction"),
}
"""Attributes of <option> that a run takes from the scenario: what a file may say for other programs that read it, the
default of a scenario, and what a run has in their place."""

_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)
_TEXTS = (
    "name class childclass model file prefix body frame joint site mesh material "
    "assetdir meshdir texturedir content_type eulerseq"
)
"""Attributes without numbers."""
_XML_NAMES: Mapping[str, str] = {
    **{"userdata": "user", "disableactuator": "actuatorgroupdisable", "ctrlspec": "input", "hfieldname": "hfield"},
    **{f"act{each}": f"actuator{each}" for each in ("frcrange", "frclimited", "gravcomp")},
    **{"ipos": "pos", "iquat": "quat", "inertia": "diaginertia"},
    **{"fluid_ellipsoid": "fluidshape", "fluid_coefs": "fluidcoef"},
    **{f"sol{a}_{b}": f"sol{a}{b}" for a in ("ref", "imp") for b in ("limit", "friction")},
}
"""Attributes that have another name in XML."""

_Found = dict[tuple[str, str, str], list[str]]
"""Places of an error, by element, attribute and message."""


def _refuse(found: _Found, main: str) -> None:
    """Raise an InputError with one line for each error: its first place, and the number of its places."""
    if found:
        numbers = [f" ({len(places)} times)" if len(places) > 1 else "" for places in found.values()]
        faults = [Fault(found[key][0], f"{key[2]}{n}") for key, n in zip(found, numbers, strict=True)]
        raise InputError(faults, f"vehicle.model {main}")


def _place(element: Element, attribute: str, file: str) -> str:
    """An element as written in its file, with its name and one attribute. ``file`` is empty for the main one."""
    keys = [key for key in dict.fromkeys(("name", attribute)) if key in element.attrib]
    words = [element.tag, *(f'{key}="{_short(element.attrib[key])}"' for key in keys)]
    return f"<{' '.join(words)}>{f' in {file}' if file else ''}"


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= 40 else f"{text[:37]}..."


@functools.cache
def known_attributes() -> Mapping[str, set[str]]:
    """The attributes of each element, from MuJoCo's own table and for the elements that it lacks."""
    known = {"include": {"file"}, "replicate": {"count", "sep", "offset", "euler"}, "worldbody": set[str]()}
    known["frame"] = {"name", "childclass", "pos", "quat", "axisangle", "euler", "xyaxes", "zaxis"}
    tag = ""
    for line in mujoco.mj_printSchema(0, 0).splitlines():
        head = re.match(r" *(?:\(world\))?(\w+) \(.\)(.*)", line)
        tag, words = (head[1], head[2]) if head else (tag, line)
        known.setdefault(tag, set()).update(words.split())
    return known


def check_xml(trees: Mapping[str, Element], main: str) -> None:
    """Check a model's parsed XML files before MuJoCo reads them.

    Raises:
        InputError: a file has unknown elements or attributes, too many copies, or what MuJoCo would ignore; all errors
            at once.
    """
    found: _Found = {}
    classes = {each.get("class", "main") for tree in trees.values() for each in tree.iter("default")} | {"main"}
    for name, tree in trees.items():
        tops = [tree] if tree.tag == "mujoco" else [*tree]  # MuJoCo drops the root of an included file
        radians = any(each.get("angle") == "radian" for each in tree.iter("compiler"))
        for element in itertools.chain.from_iterable(each.iter() for each in tops):
            for attribute, message in (*_of_xml(element), *_of_texts(element, classes), *_of_meaning(element, radians)):
                place = _place(element, attribute, name if name != main else "")
                found.setdefault((element.tag, attribute, message), []).append(place)
    _refuse(found, main)
    if (copies := _with_copies(trees)) > MOST_ELEMENTS:
        said = f"has up to {copies:.3g} elements, counting each copy by <replicate> and <attach>"
        raise InputError([Fault("<mujoco>", f"{said}; at most {MOST_ELEMENTS} are allowed")], f"vehicle.model {main}")


def _of_xml(element: Element) -> Iterator[tuple[str, str]]:
    """Errors of an element by its XML: attribute and message."""
    tag, attributes, n = element.tag, set(element.attrib), str(len(element.get("data", "").split()))
    if tag not in _ELEMENTS:
        instead = "leave it out" if tag in known_attributes() else suggestion(tag, _ELEMENTS)
        yield "", f"is not supported in a vehicle's file; {_INSTEAD.get(tag, instead)}"
        return
    for attribute in sorted(attributes - known_attributes()[tag]):  # MuJoCo ignores them in a <frame> or <replicate>
        yield attribute, f"{attribute} is not supported; {suggestion(attribute, known_attributes()[tag])}"
    if tag in ("motor", "general"):  # MuJoCo ignores all but one
        for attribute in sorted(attributes & {"jointinparent", "tendon", "cranksite", "body"}):
            yield attribute, f"{attribute} is not supported; {_THRUSTER}"
    for text in (element.text, *(child.tail for child in element)):
        if text and text.strip():
            yield "", f"has the text {_short(text)!r}, which would be ignored; leave it out"
    if tag == "numeric" and element.get("size", n).strip() != n:
        yield "size", f"has {n} numbers in data; MuJoCo would append zeros"
    if tag == "numeric" and not _are_numbers(
        element.get("data", "")
    ):  # MuJoCo would name the line, not the coefficient
        yield "data", "must be finite numbers"
    for attribute, largest in _AT_MOST.items():
        if not _within(element.get(attribute, ""), largest):
            yield attribute, f"must be within 0 and {largest}"
    if tag == "replicate" and next(element.iter("include"), None) is not None:
        yield "", "contains an <include>; include the file outside of it"
    if tag == "attach" and "model" not in element.attrib:
        yield "", "has no model; name a <model> of <asset>"
    if tag == "model" and not element.get("file"):  # MuJoCo would hang at its next warning
        yield "", "has no file"
    for attribute in sorted(attributes - set(_TEXTS.split())) if tag != "text" else ():
        if any(_NOT_FINITE.fullmatch(word) for word in element.attrib[attribute].split()):
            yield attribute, "must be finite numbers"


def _of_texts(element: Element, classes: Collection[str]) -> Iterator[tuple[str, str]]:
    """Errors of names and words: what MuJoCo would take as a format of printf, a class that the model does not have,
    and an option that is the scenario's."""
    tag, attributes = element.tag, element.attrib
    for attribute in sorted(attributes):
        if "%" in attributes[attribute] and (tag, attribute) != ("text", "data"):
            yield attribute, "has a %, which MuJoCo's messages would take as a format; choose another name"
    for attribute in ("class", "childclass"):
        named = attributes.get(attribute)
        if named is not None and tag != "default" and named not in classes:
            yield attribute, f"is no <default> class of the model; {suggestion(named, classes)}"
    for attribute, (accepted, instead) in _OF_A_RUN.items() if tag == "option" else ():
        if attribute in attributes and not {*_words(attributes[attribute])} <= {*_words(accepted)}:
            yield attribute, f"would be ignored: a run has {instead}; leave it out"


def _of_meaning(element: Element, radians: bool) -> Iterator[tuple[str, str]]:
    """Errors of numbers that MuJoCo takes for something that their author can't mean."""
    for attribute, limited in _LIMITS.get(element.tag, {}).items():
        numbers = _numbers(element.get(attribute, ""))
        if numbers and not any(numbers) and element.get(limited) != "false":
            yield attribute, f'would be no limit for MuJoCo; write {limited}="false" if you mean none, or its limits'
    if radians and any(abs(number) > 2.0 * math.pi + 1e-2 for number in _numbers(element.get("euler", ""))):
        yield "euler", 'is more than a turn in radians; write <compiler angle="degree"/> if these are degrees'


_LIMITS = {
    **{tag: {"ctrlrange": "ctrllimited", "forcerange": "forcelimited"} for tag in ("motor", "general")},
    "joint": {"range": "limited"},
}
"""By element: attributes with two limits, and the attribute that says whether they hold."""


def _numbers(text: str) -> list[float]:
    """The numbers of an attribute; none if one of its words is no number, which MuJoCo reports."""
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return []


def _are_numbers(text: str) -> bool:
    """Whether MuJoCo can read the words of a text as numbers, hexadecimal ones too."""

    def is_number(word: str) -> bool:
        read: Any = float.fromhex if "0x" in word.lower() else float
        with contextlib.suppress(ValueError):
            read(word)
            return True
        return False

    return all(map(is_number, text.split()))


def _within(text: str, largest: int) -> bool:
    """Whether the words of a text are decimal numbers from 0 to the largest. MuJoCo also reads hexadecimal ones."""
    try:
        return all(0.0 <= float(word) <= largest for word in text.split())
    except ValueError:
        return False


def _with_copies(trees: Mapping[str, Element]) -> float:
    """An upper bound for the number of a model's elements."""
    attached = 1.0

    def number(element: Element) -> float:
        times = max(map(float, element.get("count", "").split()), default=1.0)
        return (attached if element.tag == "attach" else 1.0) + times * sum(map(number, element))

    attached = sum(map(number, trees.values()))  # of each sub-model
    return sum(map(number, trees.values()))


def check_specs(specs: Sequence[mujoco.MjSpec], trees: Mapping[str, Element], main: str) -> None:
    """Check a parsed model, and the sub-models whose parts it has. ``trees`` are their XML files.

    Raises:
        InputError: attributes that a run would not take over, all at once.
    """
    found: _Found = {}
    classes = {each.get("class", "") for tree in trees.values() for each in tree.iter("default")} - {""}
    for kind, each in itertools.chain.from_iterable(_objects(spec, classes) for spec in specs):
        for attribute, value, message in _refused_attributes(kind, each):
            place = _written(trees, main, kind, getattr(each, "name", ""), attribute, value)
            found.setdefault((kind, attribute, message), [place])
    _refuse(found, main)


_TAGS: Mapping[str, tuple[str, ...]] = {
    "body": ("inertial", "body"),
    "freejoint": ("freejoint", "joint"),
    "motor": ("motor", "general"),
}
"""Elements of a kind, where they are not called as the kind."""


def _written(trees: Mapping[str, Element], main: str, kind: str, name: str, attribute: str, value: Any) -> str:
    """The place of an object's attribute: the element with its name and this value, or else the first that has the
    attribute, for example one of a default class."""
    tags, words = _TAGS.get(kind, (kind,)), _words(value)
    found = [(each, file) for file, tree in trees.items() for each in tree.iter() if each.tag in tags]
    found = [(each, file) for each, file in found if attribute in each.attrib]
    if not found:
        return f"<{kind}{f' name={name!r}' if name else ''}>"

    def fits(each: Element) -> tuple[bool, bool]:
        given = _words(each.attrib[attribute])
        return each.get("name", "") == name, given == words[: len(given)]

    element, file = max(found, key=lambda item: fits(item[0]))
    return _place(element, attribute, file if file != main else "")


def _words(value: Any) -> list[str]:
    """A value of a spec, or the text of an attribute, with its numbers written in the same way."""
    words = value.split() if isinstance(value, str) else value if isinstance(value, tuple) else (value,)
    try:
        return [f"{float(word):g}" for word in words]
    except (TypeError, ValueError):
        return [str(word) for word in words]


def _objects(spec: mujoco.MjSpec, classes: Iterable[str] = ()) -> Iterator[tuple[str, Any]]:
    """All objects of a spec with their kinds, after the objects of its default classes."""
    yield from (("option", spec.option), ("compiler", spec.compiler), ("statistic", spec.stat))
    for each in (spec.default, *filter(None, map(spec.find_default, sorted(classes)))):
        yield from (("geom", each.geom), ("joint", each.joint), ("site", each.site), ("mesh", each.mesh))
        yield "motor", each.actuator
    objects = {"body": spec.bodies, "frame": spec.frames, "geom": spec.geoms, "site": spec.sites, "mesh": spec.meshes}
    for kind, several in (objects | {"motor": spec.actuators, "numeric": spec.numerics}).items():
        yield from ((kind, each) for each in several)
    for joint in spec.joints:
        yield "freejoint" if joint.type == mujoco.mjtJoint.mjJNT_FREE else "joint", joint


_NO_ATTRIBUTES = "id info signature name parent frame compiler classname childclass plugin"
"""Names that are no attributes in XML. An object of a default class does not have them, and MuJoCo would crash."""
_OF_A_MESH = "uservert usernormal usertexcoord userface userfacenormal userfacetexcoord"
"""Long lists, whose numbers MuJoCo checks."""


def _plain(value: Any) -> Any:
    """A number, a text, a truth value, or a tuple of them, with None for nan, a number that is not given."""
    if isinstance(value, bool | int | float | str):
        return value if value == value else None
    if isinstance(value, np.ndarray):
        return tuple([x if x == x else None for x in value.tolist()])
    kind = type(value).__name__
    if kind == "MjsOrientation":
        return sum(map(_plain, (value.axisangle, value.euler, value.xyaxes, value.zaxis)), ())
    if kind.endswith("Vec"):
        numbers = (value[i] for i in range(len(value)))  # to iterate over it takes a hundred times as long
        return tuple(x if x == x else None for x in numbers)
    return value.name.rpartition("_")[2].lower() if kind.startswith("mjt") else None


@functools.cache
def _defaults(kind: str) -> Mapping[str, Any]:
    """The attributes of a new object."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body()
    new = {kind: each for kind, each in _objects(spec) if each is not spec.worldbody}
    new |= {"body": body, "frame": body.add_frame(), "numeric": spec.add_numeric(), "freejoint": new["joint"]}
    others = {*_NO_ATTRIBUTES.split(), *_OF_A_MESH.split()}
    names = [name for name in dir(new[kind]) if name[0] != "_" and name not in others]
    return {name: _plain(getattr(new[kind], name)) for name in names}


def _refused_attributes(kind: str, each: Any) -> Iterator[tuple[str, Any, str]]:
    """The attributes of an object that are refused: name in XML, value and message."""
    for name, default in _defaults(kind).items():
        if (value := _plain(getattr(each, name))) == default:
            continue
        holds, otherwise = _RULES.get(f"{kind} {name}", (None, ""))
        numbers = [x for x in (value if isinstance(value, tuple) else (value,)) if not isinstance(x, str)]
        if name not in ACCEPTED[kind].split():
            instead = _INSTEAD.get(f"{kind} {name}", "leave it out")
            message = f"{_XML_NAMES.get(name, name)} is not supported; {instead}"
        elif holds and not holds(value):
            message = otherwise
        elif not name.endswith("range") and any(abs(x) > LARGEST_NUMBER for x in numbers):
            message = f"must be numbers within +-{LARGEST_NUMBER:g}"
        else:
            continue
        if name in ("alt", "ialt"):
            name = _plain(getattr(each, name).type)
        yield _XML_NAMES.get(name, name), value, message


def check_model(model: mujoco.MjModel, main: str) -> None:
    """Check the compiled model of a vehicle's file for errors that a spec does not show.

    Raises:
        InputError: the model is not one body on a free joint, places it, or has no thrusters, or something other than
            the scenario's wall could collide with the vehicle; all errors at once.
    """
    free = model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
    bodies = [_body(model, i) for i in model.jnt_bodyid[free]]
    if len(bodies) != 1:
        found = " and ".join(bodies) or "none"
        faults = [Fault("<freejoint>", f"a vehicle must have one body on a free joint; this file has {found}")]
    else:
        base = int(model.jnt_bodyid[free][0])
        faults = _thrusters(model) + _collisions(model) + _placed(model, base)
        faults += [
            Fault(_body(model, i), f"moves on a joint and is not carried by {_body(model, base)}; leave the joint out")
            for i in model.jnt_bodyid[~free]
            if model.body_rootid[i] != base
        ]
    if faults:
        raise InputError(faults, f"vehicle.model {main}")


_HERE = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def _placed(model: mujoco.MjModel, base: int) -> list[Fault]:
    """The error for a vehicle's body that is not at the origin with the axes of the world."""
    pose = np.concatenate([model.body_pos[base], model.body_quat[base]])
    if np.allclose(pose, _HERE, rtol=0.0, atol=1e-12):
        return []
    place, turned = " ".join(f"{x:g}" for x in pose[:3]), " ".join(f"{x:.4g}" for x in pose[3:])
    instead = "a run starts at initial.position and initial.attitude_deg of the scenario"
    reason = f"is placed at {place} with the attitude {turned} (w x y z), which would be ignored: {instead}"
    return [Fault(_body(model, base), f"{reason}; leave out its pos and euler, and the frames around it")]


def _body(model: mujoco.MjModel, i: int) -> str:
    return f"body {model.body(i).name or int(i)!r}"


def _thrusters(model: mujoco.MjModel) -> list[Fault]:
    """Errors for a model without thrusters, and for thrusters without effect on the vehicle."""
    thrusters = np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_SITE)
    faults = []
    if not len(thrusters) and mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, "thrusters") < 0:
        a_load = 'a load has none, which <text name="thrusters" data="none"/> in <custom> says'
        thruster = 'a thruster is <motor site="..." gear="1 0 0 0 0 0"/>'
        faults.append(Fault("<actuator>", f"has no thruster; {thruster}; {a_load}"))
    for i in thrusters.tolist():
        name = model.actuator(i).name or f"actuator {i}"
        site = model.actuator_trnid[i, 0]
        if model.body_weldid[model.site_bodyid[site]] == 0:
            faults.append(Fault(name, f"its site {model.site(site).name!r} is not on the vehicle"))
        if not model.actuator_gear[i].any():
            faults.append(Fault(name, "its gear is zero, so that it gives no force; leave it out"))
    faults += [
        Fault(model.actuator(i).name or f"actuator {i}", "drives the free joint; a thruster is a <motor> on a site")
        for i in np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT).tolist()
        if model.jnt_type[model.actuator_trnid[i, 0]] == mujoco.mjtJoint.mjJNT_FREE
    ]
    return faults


def _collisions(model: mujoco.MjModel) -> list[Fault]:
    """Errors for geoms of the world that would touch, and for geoms of one link that would touch another: such a
    contact has nothing of the scenario's walls."""
    carrier = model.body_weldid[model.geom_bodyid]
    types, affinities = model.geom_contype, model.geom_conaffinity
    meets = (types[:, None] & affinities[None, :]) | (affinities[:, None] & types[None, :])
    meets = (meets != 0) & (carrier[:, None] != carrier[None, :])
    faults = []
    for i in range(model.ngeom):
        called = f"geom {model.geom(i).name or str(i)!r}"
        if carrier[i] == 0 and (types[i] or affinities[i]):
            collides = "would collide with the vehicle" if meets[i].any() else "would not be touched"
            reason = f"is fixed to the world and {collides}: a vehicle touches only the scenario's walls ([[walls]])"
            faults.append(Fault(called, f'{reason}; write contype="0" conaffinity="0" if it is for the eye'))
        elif (other := np.flatnonzero(meets[i] & (carrier != 0)).tolist()) and i < other[-1]:
            reason = f"of {_body(model, carrier[i])} would collide with geoms of {_body(model, carrier[other[-1]])}"
            faults.append(Fault(called, f'{reason}; write contype="0" conaffinity="0"'))
    return faults
