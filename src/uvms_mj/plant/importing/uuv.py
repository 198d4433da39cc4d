"""Plugins of the UUV Simulator: hydrodynamics, thrusters and fins.

It has the coefficients of Fossen (2011) in axes x forward, y right, z down, at the link's frame; the centre of buoyancy
and all places are x forward, y left, z up. M_A is positive, linear and quadratic damping are negative. Quadratic
damping acts by its diagonal alone, and ``linear_damping_forward_speed`` is multiplied with u.
"""

import math
import re
from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from ..record import word
from .bodies import Description, Water, right_signs
from .fins import fin_table
from .moving import HERE, NED, mirrored, mirrored_products
from .reading import Source, one_of, place_of, positive

_SIGNS = "the UUV Simulator has positive added mass and negative damping"


def uuv_water(source: Source, plugin: Element, links: Mapping[str, Any]) -> dict[str, Water]:
    """The water of the links of a libuuv_underwater_object plugin, in the axes of each link."""
    place = place_of(plugin)
    density = 1028.0
    if plugin.find("fluid_density") is not None:
        density = positive(
            source,
            source.number(plugin.findtext("fluid_density"), f"{place} <fluid_density>"),
            f"{place} <fluid_density>",
        )
    found: dict[str, Water] = {}
    for element in plugin.findall("link"):
        at = place_of(plugin, element)
        name = one_of(source, element.get("name", ""), links, at, "link")
        if name in found:
            raise source.fault(at, "is given twice")
        found[name] = _uuv_link(source, element, at, density)
    if not found:
        raise source.fault(place, "has no <link> with hydrodynamics")
    return found


def _uuv_link(source: Source, element: Element, place: str, density: float) -> Water:
    model = element.find("hydrodynamic_model")
    if model is None:
        raise source.fault(place, "has no <hydrodynamic_model>")
    kind = (model.findtext("type") or "").strip()
    at = f"{place} <hydrodynamic_model>"

    def matrix(tag: str) -> np.ndarray:
        text = (model.findtext(tag) or "").strip()
        if not text:
            return np.zeros((6, 6))
        counts = (36,) if tag == "added_mass" else (6, 36)
        values = source.numbers(text, f"{at} <{tag}>", *counts)
        return np.diag(values) if len(values) == 6 else np.array(values).reshape(6, 6)

    M_A, D, forward, D_D = (
        matrix("added_mass"),
        -matrix("linear_damping"),
        matrix("linear_damping_forward_speed"),
        -matrix("quadratic_damping"),
    )
    if kind in _FORMS:
        added, drag = _FORMS[kind](source, model, at, density, _bounding_box(source, element, place))
        M_A, D_D = M_A * (added == 0.0) + added, D_D * (drag == 0.0) + drag
    elif kind != "fossen":
        raise source.fault(f"{at} <type>", f"{kind!r} is not read; the types are fossen, {', '.join(_FORMS)}")
    off = D_D - np.diag(np.diag(D_D))
    if off.any():
        source.say("quadratic damping beside the diagonal is left out: the UUV Simulator doesn't use it either")
        D_D = D_D - off
    M_A = right_signs(source, M_A, "added mass", at, _SIGNS)
    D = right_signs(source, D, "linear damping", at, _SIGNS)
    D_D = right_signs(source, D_D, "quadratic damping", at, _SIGNS)
    terms: dict[tuple[int, int, int, bool], float] = {}
    for i, j in zip(*np.nonzero(forward), strict=True):
        key = (int(i), 0, int(j), False)
        terms[key] = terms.get(key, 0.0) + float(forward[i, j])
    if terms:
        source.say(
            f"linear_damping_forward_speed is {len(terms)} products with u, as in the source; astern, where u is "
            "negative, they push. A coefficient on abs(u), such as Yv|u|, would not"
        )
    if M_A.any():
        source.say(
            "the UUV Simulator takes the added mass with a filtered acceleration of the last step, and its wrench acts "
            "at the centre of gravity; here M_A is in the inertia, about the link's frame"
        )
    neutral = source.truth(element.findtext("neutrally_buoyant"), f"{place} <neutrally_buoyant>")
    if all(element.find(tag) is not None for tag in ("metacentric_width", "metacentric_length", "submerged_height")):
        raise source.fault(place, "is a surface vessel (metacentric_width): here every vehicle is under water")
    volume = element.findtext("volume")
    if volume is None and not neutral:
        raise source.fault(place, "has no <volume>, and is not <neutrally_buoyant>: its buoyancy is not known")
    displaced = (
        None if neutral else density * positive(source, source.number(volume, f"{place} <volume>"), f"{place} <volume>")
    )
    r_b = np.array(
        source.numbers(element.findtext("center_of_buoyancy") or "0 0 0", f"{place} <center_of_buoyancy>", 3)
    )
    if neutral and volume is not None:
        source.say("the source is neutrally buoyant: its <volume> is not used, and the displaced mass is the mass")
    return Water(mirrored(M_A), mirrored(D), mirrored(D_D), mirrored_products(terms, NED), displaced, r_b, neutral)


def _bounding_box(source: Source, element: Element, place: str) -> list[float]:
    box = element.find("box")
    if box is None:
        return []
    tags = ("length", "width", "height")
    return [
        positive(source, source.number(box.findtext(tag), f"{place} <box> <{tag}>"), f"{place} <box>") for tag in tags
    ]


def _length(source: Source, model: Element, place: str, tag: str, box: list[float], choose: Any) -> float:
    text = model.findtext(tag)
    if text is not None:
        return positive(source, source.number(text, f"{place} <{tag}>"), f"{place} <{tag}>")
    if not box:
        raise source.fault(place, f"has no <{tag}>, and the link no <box> to take it from")
    source.say(f"{tag} is not given: {choose(box):g} m, a length of <box>, stands for it, as in the source", place)
    return choose(box)


def _sphere(source: Source, model: Element, place: str, rho: float, box: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """A sphere: M_A = 2/3 rho pi r^3, and C_D = 0.5 on its cross section (Newman (1977))."""
    r = _length(source, model, place, "radius", box, min)
    three = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    return 2.0 / 3.0 * rho * math.pi * r**3 * three, 0.5 * rho * 0.5 * math.pi * r**2 * three


_END = ((1.0, 0.91), (2.0, 0.85), (4.0, 0.87), (7.0, 0.99))
_SIDE = ((1.0, 0.63), (2.0, 0.68), (5.0, 0.74), (10.0, 0.82), (math.inf, 0.98))
"""Drag coefficients of a cylinder along and across its axis, up to a ratio of length to diameter."""


def _cylinder(
    source: Source, model: Element, place: str, rho: float, box: list[float]
) -> tuple[np.ndarray, np.ndarray]:
    """A cylinder by strip theory, with the drag coefficients of the source."""
    r, length = _length(source, model, place, "radius", box, min), _length(source, model, place, "length", box, max)
    letter = (model.findtext("axis") or "").strip()
    if not letter:
        if not box:
            raise source.fault(place, "has no <axis>, i, j or k")
        letter = "ijk"[int(np.argmax(box))]
    if letter not in ("i", "j", "k"):
        raise source.fault(f"{place} <axis>", f"{letter!r} must be i, j or k")
    ratio = length / (2.0 * r)
    end = next((c for most, c in _END if ratio <= most), None)
    if end is None:
        end = _END[-1][1]
        source.say(
            f"drag along a cylinder of {ratio:.3g} diameters: the source has no coefficient beyond 7; {end:g} is taken"
        )
    side = next(c for most, c in _SIDE if ratio <= most)
    a = "ijk".index(letter)
    across = [each for each in range(3) if each != a]
    M_A, D = np.zeros(6), np.zeros(6)
    M_A[a], M_A[across] = rho * math.pi * r**2, rho * math.pi * r**2 * length
    M_A[[3 + each for each in across]] = rho * math.pi * r**2 * length**3 / 12.0
    D[a], D[across] = 0.5 * rho * end * math.pi * r**2, 0.5 * rho * side * r * length
    source.say(
        "added mass along the cylinder's axis is rho pi r^2 in the UUV Simulator, which lacks a length, and its drag "
        "across has the area r L, half of the projected one: the numbers of the source are taken",
        place,
    )
    return np.diag(M_A), np.diag(D)


def _box(source: Source, model: Element, place: str, rho: float, box: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """A box: drag on its faces, 1/2 rho C_D A."""
    c = 1.0 if model.find("cd") is None else source.number(model.findtext("cd"), f"{place} <cd>")
    length, w, h = (_length(source, model, place, tag, [], min) for tag in ("length", "width", "height"))
    source.say(
        "the type box is unfinished in the UUV Simulator: it computes this drag and does not apply it; here it acts"
    )
    return np.zeros((6, 6)), np.diag([0.5 * rho * c * area for area in (w * h, length * h, length * w)] + [0.0] * 3)


_FORMS = {"sphere": _sphere, "cylinder": _cylinder, "box": _box}


def uuv_thruster(about: Description, plugin: Element) -> None:
    """A libuuv_thruster: a force along the joint's axis at the centre of gravity of its link."""
    source, place = about.source, place_of(plugin)
    link = one_of(source, (plugin.findtext("linkName") or "").strip(), about.links, f"{place} <linkName>", "link")
    number = (plugin.findtext("thrusterID") or "").strip()
    if number and not re.fullmatch(r"\d{1,4}", number):
        raise source.fault(f"{place} <thrusterID>", f"{number!r} must be a whole number")
    joint = next((each for each in about.joints if each.child == link), None)
    axis = np.array([1.0, 0.0, 0.0])
    given = (plugin.findtext("jointName") or "").strip()
    if given:
        one_of(source, given, [each.name for each in about.joints], f"{place} <jointName>", "joint")
        joint = next(each for each in about.joints if each.name == given)
    if joint is not None:
        joint.welded = joint.welded or "the propeller"
        axis = joint.axis if joint.child == link and joint.kind != "fixed" else axis

    def of(tag: str, default: float) -> float:
        text = plugin.findtext(tag)
        return default if text is None else source.number(text, f"{place} <{tag}>")

    conversion = plugin.find("conversion")
    kind = (conversion.findtext("type") or "").strip() if conversion is not None else ""
    low, high = of("thrustMin", -math.inf), of("thrustMax", math.inf)
    clamp = of("clampMin", -math.inf), of("clampMax", math.inf)
    factor = of("gain", 1.0) * of("propeller_efficiency", 1.0)
    if kind == "Basic" and conversion is not None and all(map(math.isfinite, clamp)):
        k = source.number(conversion.findtext("rotorConstant"), f"{place} <conversion> <rotorConstant>") * of(
            "thrust_efficiency", 1.0
        )
        ends = sorted(k * (factor * x) * abs(factor * x) for x in clamp)
        low, high = max(low, ends[0]), min(high, ends[1])
    limits = (low, high) if math.isfinite(low) and math.isfinite(high) else None
    if limits and low >= high:
        raise source.fault(place, f"its least thrust {low:g} N must be below the greatest, {high:g} N")
    dynamics = plugin.find("dynamics")
    lag = f", lag {dynamics.findtext('timeConstant') or 'none'} s" if dynamics is not None else ""
    curve = (
        f"{kind or 'none'} {conversion.findtext('rotorConstant') or ''}".strip() if conversion is not None else "none"
    )
    source.say(f"thrusters: curve {curve}{lag}: settings of a scenario, [thrusters]; here a thruster obeys newtons")
    about.thrusters.append((f"thruster_{number}" if number else word(link), link, about.links[link].r_g, axis, limits))


def uuv_fin(about: Description, plugin: Element) -> None:
    """A libuuv_fin: its chord is along x of its link, its span along z. It is said as an entry of ``fins``."""
    source, place = about.source, place_of(plugin)
    link = one_of(
        source,
        (plugin.findtext("link_name") or plugin.findtext("linkName") or "").strip(),
        about.links,
        f"{place} <link_name>",
        "link",
    )
    joint = next((each for each in about.joints if each.child == link), None)
    pose = HERE
    if joint is not None:
        joint.welded = joint.welded or "the fin"
        pose = joint.pose
        if joint.parent != about.base:
            source.say(f"fin {link!r} is carried by {joint.parent!r}: its place is in the frame of that link")
    lift = plugin.find("liftdrag")
    kind = (lift.findtext("type") or "").strip() if lift is not None else ""

    def of(tag: str) -> float:
        text = lift.findtext(tag) if lift is not None else None
        return source.number(text, f"{place} <liftdrag> <{tag}>")

    if kind == "TwoLines":
        table = fin_table(of("area"), pose, of("cla") * of("fluid_density") / 1000.0, of("alpha_stall"), 0.0)
        more = f"; its zero of lift at {of('a0'):g} rad is left out" if of("a0") else ""
        more += "; its drag, in proportion to the angle, is left out" if of("cda") else ""
    elif kind == "Quadratic":
        # lift = c alpha V^2 with 1/2 rho A C_alpha = c: the area is not given, and 1 m^2 stands for it
        table = fin_table(1.0, pose, 2.0 * of("lift_constant") / 1000.0, math.radians(89.0), 0.0)
        more = "; its area is in lift_slope, and its drag, in proportion to the angle squared, is left out"
    else:
        raise source.fault(f"{place} <liftdrag> <type>", f"{kind!r} is not read; the types are TwoLines and Quadratic")
    source.say(f"fin {link!r} is no part of a vehicle's file; a scenario has fins = [{table}]{more}")
