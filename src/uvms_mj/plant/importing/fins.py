"""Fins of a source as entries of ``fins`` of a scenario.

Our fin (:class:`..water.Fin`) has its chord along x and its span along z. Below the stall, at small angles, its lift is
the first of the two lines of Gazebo's LiftDrag.
"""

import math
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ...physics.effects import RHO
from .moving import Pose
from .reading import Source


def fin_table(area: float, pose: Pose, lift_slope: float, stall: float, drag: float) -> str:
    """The inline table of a fin: area [m^2], pose in B, C_alpha [1/rad], angle of the stall [rad] and C_D0."""
    roll, pitch, yaw = reversed(Rotation.from_matrix(pose.R).as_euler("ZYX", degrees=True).tolist())
    place = ", ".join(f"{x + 0.0:.6g}" for x in pose.p)
    turned = ", ".join(f"{x + 0.0:.6g}" for x in (roll, pitch, yaw))
    stall_deg = min(max(math.degrees(stall), 1.0), 89.0)
    return (
        f"{{area = {area:.6g}, position = [{place}], attitude_deg = [{turned}], lift_slope = {lift_slope:.6g}, "
        f"stall_deg = {stall_deg:.6g}, drag_coefficient = {drag:.6g}}}"
    )


def lift_drag(source: Source, plugin: Element, place: str, pose: Pose, name: str) -> None:
    """Say the fin of a LiftDrag plugin on a link whose pose in B is given."""

    def of(tag: str, default: float) -> float:
        text = plugin.findtext(tag)
        return default if text is None else source.number(text, f"{place} <{tag}>")

    def vector(tag: str, default: str) -> np.ndarray:
        found = np.array(source.numbers(plugin.findtext(tag) or default, f"{place} <{tag}>", 3))
        length = np.linalg.norm(found)
        if tag != "cp" and length < 1e-9:
            raise source.fault(f"{place} <{tag}>", "has no length")
        return found if tag == "cp" else found / length

    chord, lift = vector("forward", "1 0 0"), vector("upward", "0 0 1")
    lift = lift - chord * (chord @ lift)
    if np.linalg.norm(lift) < 1e-6:
        raise source.fault(f"{place} <upward>", "is along <forward>")
    lift /= np.linalg.norm(lift)
    fin = Pose(np.column_stack([chord, lift, np.cross(chord, lift)]), vector("cp", "0 0 0"))
    density, slope = of("air_density", 1.2041), of("cla", 1.0)
    table = fin_table(of("area", 1.0), pose @ fin, slope * density / RHO, of("alpha_stall", math.pi / 2.0), 0.0)
    more = f"; its density is {density:g} kg/m^3, which is in lift_slope" if abs(density - RHO) > 1e-9 else ""
    more += f"; its zero of lift at {of('a0', 0.0):g} rad is left out" if of("a0", 0.0) else ""
    more += "; its drag, in proportion to the angle, is left out" if of("cda", 0.01) else ""
    source.say(f"fin {name!r} is no part of a vehicle's file; a scenario has fins = [{table}]{more}")
