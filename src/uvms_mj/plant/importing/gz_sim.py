"""Plugins of gz-sim: hydrodynamics, thrusters and the servos of joints.

Hydrodynamics gives forces by derivatives as SNAME (1950), in the axes of the link, x forward, y left, z up, about its
origin: ``xDotU`` is X_udot, ``nV`` is N_v, ``yVabsV`` is Y_vv on abs(v) v, ``yVabsR`` is Yv|r| and ``yUV`` is Yuv.
``<fluid_added_mass>`` is M_A of the link about its origin.
"""

import itertools
import math
import re
from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np

from ..coefficients import DENSITY
from .bodies import Description, Water, right_signs
from .elements import kind_of, plugins_of
from .reading import Source, one_of, place_of, positive

_ENTRIES = "xyzpqr"
_TERM = re.compile(r"([xyzkmn])(Dot)?([UVWPQR])(?:(abs)?([UVWPQR]))?")
_OF_GZ_SIM = re.compile(r"hydrodynamics-system|systems::hydrodynamics")
_LRAUV = re.compile(r"tethys::hydrodynamicsplugin")
_NO_TERMS = ("link_name", "namespace", "water_density", "waterDensity", "disable_added_mass", "default_current")
"""Elements of the Hydrodynamics plugin that are read, or mean nothing here, beside its coefficients."""
_SIGNS = "derivatives of gz-sim are negative for added mass and damping"


def buoyancies(root: Element) -> list[Element]:
    """The Buoyancy plugins of a file."""
    return [each for each in plugins_of(root) if "buoyancy" in kind_of(each) and "engine" not in kind_of(each)]


def gz_density(source: Source, root: Element, waters: Sequence[Element]) -> float:
    """Density of the water [kg/m^3], from a Buoyancy plugin, or from the Hydrodynamics plugins ``waters``."""
    known = (
        (buoyancies(root), ("uniform_fluid_density", "graded_buoyancy/default_density")),
        (waters, ("water_density", "waterDensity")),
    )
    for plugins, tags in known:
        for plugin in plugins:
            for tag in tags:
                if plugin.find(tag) is not None:
                    place = f"{place_of(plugin)} <{tag}>"
                    return positive(source, source.number(plugin.findtext(tag), place), place)
    source.say(f"the file gives no density of the water: {DENSITY:g} kg/m^3, as gz-sim's Buoyancy")
    return DENSITY


def gz_water(source: Source, plugin: Element, link: Element, place: str) -> Water:
    """The water of a link by a Hydrodynamics plugin and its <fluid_added_mass>."""
    M_A, D, D_D = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    terms: dict[tuple[int, int, int, bool], float] = {}
    given: set[str] = set()
    lrauv = bool(_LRAUV.search(kind_of(plugin)))
    if lrauv:
        source.say("the plugin of the LRAUV has xUU on abs(u) u: it is damping in both directions")
    elif not _OF_GZ_SIM.search(kind_of(plugin)):
        known = "gz::sim::systems::Hydrodynamics and tethys::HydrodynamicsPlugin"
        raise source.fault(place, f"is a plugin whose conventions are not known; known are {known}")
    for each in plugin:
        match = _TERM.fullmatch(each.tag)
        if match is None:
            if each.tag not in _NO_TERMS:
                source.say("elements of the Hydrodynamics plugin that are not read", f"<{each.tag}>")
            continue
        if each.tag in given:
            raise source.fault(f"{place} <{each.tag}>", "is given twice")
        given.add(each.tag)
        value = source.number(each.text, f"{place} <{each.tag}>")
        i, j = "xyzkmn".index(match[1]), "UVWPQR".index(match[3])
        if match[2]:
            M_A[i, j] -= value
        elif match[5] is None:
            D[i, j] -= value
        elif (match[4] or lrauv) and match[5] == match[3]:
            D_D[i, j] -= value
        elif value:
            k = "UVWPQR".index(match[5])
            key = (i, j, k, True) if match[4] else (i, min(j, k), max(j, k), False)
            terms[key] = terms.get(key, 0.0) + value
    if source.truth(plugin.findtext("disable_added_mass"), f"{place} <disable_added_mass>") and M_A.any():
        source.say("the added mass of the plugin is disabled in the source: it is left out")
        M_A = np.zeros((6, 6))
    M_A = right_signs(source, M_A, "added mass", place, _SIGNS)
    D = right_signs(source, D, "linear damping", place, _SIGNS)
    D_D = right_signs(source, D_D, "quadratic damping", place, _SIGNS)
    if M_A.any():
        source.say(
            "gz-sim's plugin takes the added mass with the acceleration of the last step, and C_A from the "
            "diagonal of M_A, with the other sign; here M_A is in the inertia, and C_A(nu_r) is Kirchhoff's"
        )
    fluid = fluid_added_mass(source, link)
    if fluid.any() and M_A.any():
        raise source.fault(place, "has an added mass, and the link has a <fluid_added_mass>: keep one")
    M_A = M_A + fluid
    current = plugin.findtext("default_current")
    if current and any(source.numbers(current, f"{place} <default_current>", 3)):
        source.say(f"the current {current.strip()} m/s is a setting of a scenario: current.speed and its direction")
    squares = [key for key in terms if not key[3] and key[1] == key[2]]
    if squares:
        source.say(
            "damping without abs, such as xUU, is taken as it is in gz-sim, on u u: backwards it pushes. Names "
            "with abs, xUabsU, are damping in both directions"
        )
    return Water(M_A, D, D_D, terms)


def fluid_added_mass(source: Source, link: Element) -> np.ndarray:
    """M_A (6, 6) of a link about its origin, from <fluid_added_mass>; zero without one."""
    element, M = link.find("inertial/fluid_added_mass"), np.zeros((6, 6))
    if element is None:
        return M
    place = place_of(link, element)
    for a, b in itertools.combinations_with_replacement(range(6), 2):
        tag = _ENTRIES[a] + _ENTRIES[b]
        if element.find(tag) is not None:
            M[a, b] = M[b, a] = source.number(element.findtext(tag), f"{place} <{tag}>")
    return M


def gz_thruster(about: Description, plugin: Element) -> None:
    """The thruster of a Thruster plugin, or of a motor model."""
    source, place = about.source, place_of(plugin)
    given = plugin.findtext("joint_name") or plugin.findtext("jointName") or ""
    name = one_of(source, given.strip(), [each.name for each in about.joints], f"{place} <joint_name>", "joint")
    joint = next(each for each in about.joints if each.name == name)
    joint.welded = "the propeller"
    called, place = re.sub(r"_?joint$", "", name) or name, f"{place} of {name}"
    generic = "motor" in kind_of(plugin)

    def of(tag: str, default: float) -> float:
        text = plugin.findtext(tag)
        return default if text is None else source.number(text, f"{place} <{tag}>")

    limits = None
    if generic:
        source.say("its curve, lag and torque are settings of a scenario, [thrusters]; here it obeys newtons", called)
    else:
        low, high = of("min_thrust_cmd", -1000.0), of("max_thrust_cmd", 1000.0)
        if source.truth(plugin.findtext("use_angvel_cmd"), f"{place} <use_angvel_cmd>"):
            k = of("fluid_density", 1000.0) * of("thrust_coefficient", 1.0) * of("propeller_diameter", 0.02) ** 4
            low, high = sorted((k * low * abs(low), k * high * abs(high)))
            source.say(
                f"thrusters obey angular velocities in the source, thrust = {k:.4g} |w| w; here they obey newtons"
            )
        elif of("thrust_coefficient", 1.0) < 0.0:
            source.say(
                "a negative thrust_coefficient: it turns the other way, and a command in newtons is the same",
                called,
            )
        if low >= high:
            raise source.fault(place, f"its least thrust {low:g} N must be below the greatest, {high:g} N")
        limits = low, high
        if plugin.find("max_thrust_cmd") is None:
            source.say(f"no limit in the file: {low:g} to {high:g} N, by the defaults of gz-sim", called)
        if of("deadband", 0.0):
            source.say("the dead band of the thrusters is a setting of a scenario: thrusters.name, with its curve")
    about.thrusters.append((called, joint.child, np.zeros(3), joint.axis, limits))


def gz_servos(about: Description, model: Element) -> None:
    """Limits of the motors of joints, from JointPositionController and its relatives."""
    for plugin in plugins_of(model):
        if not re.search(r"joint[-_]?(position|velocity)?[-_]?controller", kind_of(plugin).replace("::", " ")):
            continue
        place = place_of(plugin)
        for given in plugin.findall("joint_name"):
            joint = next((each for each in about.joints if each.name == (given.text or "").strip()), None)
            if joint is None or joint.welded:
                continue
            if joint.effort is None:
                joint.effort = math.inf
            low, high = (plugin.findtext(tag) for tag in ("cmd_min", "cmd_max"))
            speeds = about.source.truth(plugin.findtext("use_velocity_commands"), f"{place} <use_velocity_commands>")
            if low is not None and high is not None:
                both = about.source.number(low, f"{place} <cmd_min>"), about.source.number(high, f"{place} <cmd_max>")
                most = max(map(abs, both))
                if both[0] != -both[1]:
                    about.source.say(
                        f"limits {low.strip()} and {high.strip()} differ; the motor has {most:g} both ways",
                        joint.name,
                    )
                if speeds:
                    joint.speed_limit = most
                else:
                    joint.effort = min(joint.effort, most)
            gains = [tag for tag in ("p_gain", "i_gain", "d_gain") if plugin.find(tag) is not None]
            if gains:
                about.source.say("gains of the servos of joints are settings of a scenario, [joints]")
