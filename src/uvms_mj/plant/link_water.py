"""The water of a link: its coefficients from the file, and from strip theory those that the file leaves out.

A link gives ``displaced_mass`` and ``M_A``; its damping is zero unless it is given, and its centre of buoyancy is the
origin of its frame. With ``strip_theory``, two numbers C_A and C_D, all of them but D_linear come from the capsules and
cylinders of the link (:mod:`.strip`), unless the file gives them.
"""

from typing import TypedDict

import mujoco
import numpy as np

from ..errors import Fault
from .coefficients import DERIVATIVES, LINK_NUMERICS, added_mass, damping_matrix, has_numeric, numeric
from .strip import Strips, parts_of, strip_theory

_FROM_STRIPS = ("displaced_mass", "center_of_buoyancy", "M_A", "D_quadratic")
_NAMES = (*_FROM_STRIPS, "D_linear")


class Water(TypedDict):
    """Coefficients of a link about its frame's origin, and the names of those that strip theory filled in."""

    displaced_mass: float
    r_b: np.ndarray
    M_A: np.ndarray
    D_linear: np.ndarray
    D_quadratic: np.ndarray
    filled_in: tuple[str, ...]


_NONE, _ZERO = np.zeros(0, str), np.zeros((6, 6))
_DRY = Water(displaced_mass=0.0, r_b=np.zeros(3), M_A=_ZERO, D_linear=_ZERO, D_quadratic=_ZERO, filled_in=())
"""Returned with an error."""


def water_of(model: mujoco.MjModel, data: mujoco.MjData, body: int, faults: list[Fault]) -> Water:
    """The water of the link on a body, after ``mj_kinematics``. Errors are appended to ``faults``."""
    prefix = f"{model.body(body).name}."
    if not any(has_numeric(model, prefix + each) for each in LINK_NUMERICS):
        named = f"{prefix}displaced_mass, {prefix}M_A and damping, or {prefix}strip_theory"
        reason = f"moves on a joint and has no coefficient, so that it would be dry: give {named}"
        faults.append(Fault(f"body {prefix[:-1]!r}", reason))
        return _DRY
    strips = _strips(model, data, body, faults) if has_numeric(model, f"{prefix}strip_theory") else None
    if faults and faults[-1].key == f"{prefix}strip_theory":
        return _DRY
    given = {
        name
        for name in _NAMES
        if any(has_numeric(model, prefix + each) for each in (name, *DERIVATIVES.get(name, _NONE).flat))
    }
    filled_in = tuple(name for name in _FROM_STRIPS if strips and name not in given)
    instead = strips or Strips(0.0, np.zeros(3), np.zeros((6, 6)), np.zeros((6, 6)))
    if strips is None and "M_A" not in given:
        ways = f"{prefix}M_A, its derivatives {prefix}X_udot, ..., or {prefix}strip_theory"
        faults.append(Fault(f"{prefix}M_A", f"is missing: give {ways}"))
    displaced_mass = instead.displaced_mass
    if "displaced_mass" not in filled_in:
        displaced_mass = float(numeric(model, f"{prefix}displaced_mass", 1, faults)[0])
    if displaced_mass < 0.0:
        faults.append(Fault(f"{prefix}displaced_mass", f"{displaced_mass:g} kg: must not be negative"))
    damping = {"D_linear": np.zeros((6, 6)), "D_quadratic": instead.D_quadratic}
    damping |= {name: damping_matrix(model, prefix, name, faults) for name in damping if name in given}
    return {
        "displaced_mass": displaced_mass,
        "r_b": numeric(model, f"{prefix}center_of_buoyancy", 3, faults, default=instead.center_of_buoyancy),
        "M_A": instead.M_A if "M_A" not in given else added_mass(model, prefix, faults),
        "D_linear": damping["D_linear"],
        "D_quadratic": damping["D_quadratic"],
        "filled_in": filled_in,
    }


def _strips(model: mujoco.MjModel, data: mujoco.MjData, body: int, faults: list[Fault]) -> Strips | None:
    """What strip theory gives for a link that asks for it, or None with an error."""
    link = model.body(body).name
    name = f"{link}.strip_theory"
    C_A, C_D = numeric(model, name, 2, faults)
    parts = parts_of(model, data, body)
    if not parts:
        faults.append(Fault(name, f"body {link!r} has no capsule and no cylinder; give one, or the coefficients"))
    elif min(C_A, C_D) < 0.0:
        faults.append(Fault(name, f"{C_A:g} {C_D:g}: C_A and C_D must not be negative"))
    else:
        return strip_theory(parts, float(C_A), float(C_D))
    return None
