"""The water of a link: its coefficients from the file, and from strip theory those that the file leaves out.

A slender body is cut into strips across its axis a. The strip at r has the cross section A, the width d and the length
ds. Water resists the velocity of the strip across the axis, v_p = P (v + omega x r) = P H nu with P = I - a a^T and
H = [I, -S(r)], and does not resist that along it (Fossen (2021), 6.4; Morison's equation for a moving body):

=================  ====================================================================
displaced mass     rho int A ds
M_A                C_A rho int A H^T P H ds
D_quadratic        column j: 1/2 rho C_D int d H^T abs(v_p) v_p ds with nu = e_j
=================  ====================================================================

For a long round cylinder C_A is about 1 and C_D about 1.1. The drag is exact for motion along one axis of the frame.
Between two axes the form of D_quadratic, abs(nu_j) nu_j, gives less: at 45 degrees across the link 0.71 of the drag.
Both matrices are about the origin of the body frame. The ends of a cylinder have neither added mass nor drag. Parts
that overlap count twice.

A link gives ``displaced_mass`` and ``M_A``; its damping is zero unless it is given, and its centre of buoyancy is the
origin of its frame. With ``strip_theory``, two numbers C_A and C_D, all of them but D_linear come from the capsules and
cylinders of the link, unless the file gives them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypedDict

import mujoco
import numpy as np

from ..errors import Fault
from .coefficients import DERIVATIVES, LINK_NUMERICS, added_mass, damping_matrix, has_numeric, numeric

DENSITY = 1000.0
"""Density of the water [kg/m^3]."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)


@dataclass(frozen=True)
class Part:
    """A cylinder, or a capsule with ``round_ends``, in the body frame: radius and half length of the cylinder [m],
    centre (3,) [m] and unit axis (3,)."""

    radius: float
    half_length: float
    centre: np.ndarray
    axis: np.ndarray
    round_ends: bool


@dataclass(frozen=True)
class Strips:
    """Coefficients about the origin of the body frame: displaced mass [kg], centre of buoyancy (3,) [m], M_A (6, 6)
    [kg, kg m, kg m^2] and D_quadratic (6, 6) [N s^2/m^2, N s^2/m, N s^2, N m s^2]."""

    displaced_mass: float
    center_of_buoyancy: np.ndarray
    M_A: np.ndarray
    D_quadratic: np.ndarray


def parts_of(model: mujoco.MjModel, data: mujoco.MjData, body_id: int) -> list[Part]:
    """The capsules and cylinders of a body and of the bodies welded to it, drawn or hidden, after ``mj_kinematics``."""
    R, origin = data.xmat[body_id].reshape(3, 3), data.xpos[body_id]
    round_ends = {int(mujoco.mjtGeom.mjGEOM_CAPSULE): True, int(mujoco.mjtGeom.mjGEOM_CYLINDER): False}
    return [
        Part(
            float(model.geom_size[i, 0]),
            float(model.geom_size[i, 1]),
            R.T @ (data.geom_xpos[i] - origin),
            R.T @ data.geom_xmat[i].reshape(3, 3)[:, 2],
            round_ends[int(model.geom_type[i])],
        )
        for i in range(model.ngeom)
        if model.body_weldid[model.geom_bodyid[i]] == body_id and int(model.geom_type[i]) in round_ends
    ]


def strip_theory(parts: Sequence[Part], C_A: float, C_D: float) -> Strips:
    """The coefficients of a body from one part or more."""
    mass, moment, M_A, D = 0.0, np.zeros(3), np.zeros((6, 6)), np.zeros((6, 6))
    for part in parts:
        P = np.eye(3) - np.outer(part.axis, part.axis)
        s, ds, radius = _cut(part)
        r = part.centre + s[:, None] * part.axis
        H = np.concatenate([np.broadcast_to(np.eye(3), (len(s), 3, 3)), np.cross(r[:, None], np.eye(3))], axis=2)
        H = P @ H  # (n, 3, 6), of which column j is v_p for nu = e_j; -S(r) has the rows r x e_i
        displaced = DENSITY * np.pi * radius**2 * ds
        mass += displaced.sum()
        moment += displaced @ r
        M_A += C_A * np.einsum("n,nki,nkj->ij", displaced, H, H)
        width = DENSITY * C_D * radius * ds  # 1/2 rho C_D d ds
        D += np.einsum("n,nki,nj,nkj->ij", width, H, np.linalg.norm(H, axis=1), H)
    return Strips(float(mass), moment / mass, M_A, D)


def _cut(part: Part) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place on the axis, length and radius of the strips [m], nodes of Gauss and Legendre on smooth pieces."""
    b = part.half_length
    caps = part.radius * np.sin(np.pi / 4 * (1.0 + _NODES))  # depth in the round end: r sin(angle)
    cap = np.pi / 4 * _WEIGHTS * part.radius * np.cos(np.pi / 4 * (1.0 + _NODES)), np.sqrt(part.radius**2 - caps**2)
    edges = np.unique(np.clip([-b, *_slowest(part), b], -b, b))
    low, high = edges[:-1, None], edges[1:, None]
    s = ((low + high + (high - low) * _NODES) / 2.0).ravel()
    ds = ((high - low) / 2.0 * _WEIGHTS).ravel()
    radius = np.full_like(s, part.radius)
    if not part.round_ends:
        return s, ds, radius
    return (
        np.concatenate([s, b + caps, -b - caps]),
        np.concatenate([ds, cap[0], cap[0]]),
        np.concatenate([radius, cap[1], cap[1]]),
    )


def _slowest(part: Part) -> list[float]:
    """Places on the axis that a rotation about an axis of the frame moves least: the drag has a kink there."""
    found = []
    for e in np.eye(3):
        across, at_centre = np.cross(e, part.axis), np.cross(e, part.centre)
        if across @ across > 1e-12:
            found.append(float(-(at_centre @ across) / (across @ across)))
    return found


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
    strips = _strips_of(model, data, body, faults) if has_numeric(model, f"{prefix}strip_theory") else None
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


def _strips_of(model: mujoco.MjModel, data: mujoco.MjData, body: int, faults: list[Fault]) -> Strips | None:
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
