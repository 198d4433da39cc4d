"""Checks of a vehicle's file. Supported elements and attributes are used in a run; all others are refused by name."""

import difflib
import itertools
from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from ..errors import Fault, InputError, suggestion
from .coefficients import wrong_numerics
from .mjcf_elements import ELEMENTS, MOST_ELEMENTS, REASONS, finite, values_of

_CLOSE = 0.8
"""Least similarity at which an attribute counts as misspelt."""


def check_elements(trees: Mapping[str, Element], main: str) -> None:
    """Check a model's parsed XML files, by name, before MuJoCo reads them.

    Raises:
        InputError: elements, attributes or values that are not allowed in a vehicle's file, all at once. An error that
            occurs several times is reported once, with their number.
    """
    found: dict[tuple[str, str], list[str]] = {}
    for name, root in trees.items():
        place = "" if name == main else f" in {name}"
        # MuJoCo drops the root of an included file, which may have any name
        tops = [root] if root.tag == "mujoco" else [*root]
        for what, where, message in itertools.chain.from_iterable(map(_faults, tops)):
            found.setdefault((f"{what}{place}", message), []).append(f"{where}{place}")
    faults = [
        Fault(places[0], message if len(places) == 1 else f"{message} ({len(places)} times)")
        for (_, message), places in found.items()
    ]
    faults += _too_many(trees)
    if faults:
        raise InputError(faults, f"vehicle.model {main}")


def _faults(element: Element) -> Iterator[tuple[str, str, str]]:
    """Errors of an element and its descendants: element and attribute, place, and message of each.

    The attributes and children of a refused element are not checked.
    """
    tag = element.tag
    if tag not in ELEMENTS:
        reason = REASONS.get(tag) or suggestion(tag, ELEMENTS)
        yield tag, _place(element), f"is not supported in a vehicle's file; {reason}"
        return
    rules = ELEMENTS[tag]
    for attribute, value in element.attrib.items():
        rule = finite if rules is None else rules.get(attribute)
        if rule is None:
            reason = f"{attribute} is not supported; {_why(tag, attribute)}"
            yield f"{tag} {attribute}", _place(element, attribute), reason
        elif message := rule(value):
            yield f"{tag} {attribute}", _place(element, attribute), message
    for text in (element.text, *(child.tail for child in element)):
        if text and text.strip():
            yield f"{tag} text", _place(element), f"has the text {_short(text)!r}, which would be ignored; leave it out"
    if tag == "numeric":
        size, given = values_of(element.get("size", "")), len(element.get("data", "").split())
        if size and size != [given]:
            yield "numeric size", _place(element, "size"), f"has {given} numbers in data; MuJoCo would append zeros"
    for child in element:
        yield from _faults(child)


def _place(element: Element, attribute: str = "name") -> str:
    """An element as written in its file, with its name and one attribute."""
    keys = [key for key in dict.fromkeys(("name", attribute)) if key in element.attrib]
    return "<" + " ".join([element.tag, *(f'{key}="{_short(element.attrib[key])}"' for key in keys)]) + ">"


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= 40 else f"{text[:37]}..."


def _why(tag: str, attribute: str) -> str:
    known = ELEMENTS[tag] or ()
    misspelt = difflib.get_close_matches(attribute, known, n=1, cutoff=_CLOSE)
    return suggestion(attribute, known) if misspelt or tag not in REASONS else REASONS[tag]


def _too_many(trees: Mapping[str, Element]) -> Iterator[Fault]:
    """Errors for more elements, including copies, than MuJoCo compiles in seconds, and for uncountable copies."""
    attached = 1.0

    def number(element: Element) -> float:
        times = max(values_of(element.get("count", "")), default=1.0) if element.tag == "replicate" else 1.0
        return (attached if element.tag == "attach" else 1.0) + times * sum(map(number, element))

    attached = sum(map(number, trees.values()))  # an upper bound for each sub-model
    n = sum(map(number, trees.values()))
    if n > MOST_ELEMENTS:
        copies = "counting each copy by <replicate> and <attach>"
        yield Fault("<mujoco>", f"has up to {n:.3g} elements, {copies}; at most {MOST_ELEMENTS} are allowed")
    if any(next(each.iter("include"), None) is not None for tree in trees.values() for each in tree.iter("replicate")):
        yield Fault("<replicate>", "contains an <include>; include the file outside of it")
    if any("model" not in each.attrib for tree in trees.values() for each in tree.iter("attach")):
        yield Fault("<attach>", "has no model; name a <model> of <asset>")


def check_model(model: mujoco.MjModel, main: str) -> None:
    """Check the compiled model of a vehicle's file for errors that the XML does not show.

    Raises:
        InputError: the model is not one body on a free joint, has no thrusters or unknown numerics, or something other
            than the scenario's wall could collide with the vehicle; all errors at once.
    """
    free = model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
    bodies = [_body(model, i) for i in model.jnt_bodyid[free]]
    faults = [fault for i in np.flatnonzero(free).tolist() for fault in _held(model, i)]
    if len(bodies) != 1:
        found = " and ".join(bodies) or "none"
        faults.append(Fault("<freejoint>", f"a vehicle must have one body on a free joint; this file has {found}"))
    else:
        base = int(model.jnt_bodyid[free][0])
        name = model.body(base).name
        prefix = name[: name.rfind("/") + 1]
        faults += wrong_numerics(model, base, prefix, alone=True) + _thrusters(model) + _collisions(model)
        faults += [
            Fault(_body(model, i), f"moves on a joint and is not carried by {_body(model, base)}; leave the joint out")
            for i in model.jnt_bodyid[~free]
            if model.body_rootid[i] != base
        ]
    if faults:
        raise InputError(faults, f"vehicle.model {main}")


def _held(model: mujoco.MjModel, joint: int) -> Iterator[Fault]:
    dofs = slice(model.jnt_dofadr[joint], model.jnt_dofadr[joint] + 6)
    reason = "has damping, armature or frictionloss: hydrodynamic forces come from the coefficients in <custom>"
    if any(each[dofs].any() for each in (model.dof_damping, model.dof_armature, model.dof_frictionloss)):
        yield Fault(f"the free joint of {_body(model, model.jnt_bodyid[joint])}", f"{reason}; leave them out")


def _body(model: mujoco.MjModel, i: int) -> str:
    return f"body {model.body(i).name or int(i)!r}"


def _thrusters(model: mujoco.MjModel) -> list[Fault]:
    """Errors for a model without thrusters, and for thrusters without effect on the vehicle."""
    thrusters = np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_SITE)
    faults = []
    if not len(thrusters):
        faults.append(Fault("<actuator>", 'has no thruster; a thruster is <motor site="..." gear="1 0 0 0 0 0"/>'))
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
    """Errors for geoms that would collide with the vehicle, or with another of its links: such a contact has nothing of
    the scenario's walls."""
    carrier = model.body_weldid[model.geom_bodyid]
    types, affinities = model.geom_contype, model.geom_conaffinity
    meets = (types[:, None] & affinities[None, :]) | (affinities[:, None] & types[None, :])
    meets = (meets != 0) & (carrier[:, None] != carrier[None, :])
    faults = []
    for i in np.flatnonzero(meets.any(axis=1)).tolist():
        called = f"geom {model.geom(i).name or str(i)!r}"
        if carrier[i] == 0:
            reason = (
                "is fixed to the world and would collide with the vehicle, which may touch only the scenario's wall"
            )
            faults.append(Fault(called, f'{reason}; write contype="0" conaffinity="0"'))
        elif (other := np.flatnonzero(meets[i] & (carrier != 0)).tolist()) and i < other[-1]:
            reason = f"of {_body(model, carrier[i])} would collide with those of {_body(model, carrier[other[-1]])}"
            faults.append(Fault(called, f'{reason}; write contype="0" conaffinity="0"'))
    return faults
