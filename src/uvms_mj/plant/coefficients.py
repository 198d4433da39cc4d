"""Hydrodynamic coefficients in a vehicle's MJCF: names, their checks, and the 6x6 matrices built from them.

They are ``<custom><numeric>`` entries. Each matrix is given either as a whole or by its SNAME derivatives:

===============  ======================  ===========================================================================
matrix           derivatives             meaning
===============  ======================  ===========================================================================
``M_A``          ``X_udot``..``N_rdot``  added mass, symmetric, positive semi-definite [kg, kg m, kg m^2]
``D_linear``     ``X_u`` .. ``N_r``      linear damping [N s/m, N s, N m s]
``D_quadratic``  ``X_uu`` .. ``N_rr``    quadratic damping: the entry [i, j] multiplies abs(nu_j) nu_j; ``Y_rr`` is the
                                         coefficient of abs(r) r in Y [N s^2/m^2, N s^2/m, N s^2, N m s^2]
===============  ======================  ===========================================================================

A whole matrix has 36 numbers, row by row, with the sign of M_A or D: its diagonal is positive. Derivatives have the
signs of the literature: D_linear[0, 0] is -X_u. The six diagonal derivatives are required. A missing cross term such as
``N_v`` or ``Y_rr`` is zero. Added mass is symmetric, so ``Y_rdot`` alone also sets ``N_vdot``.

**Strip theory** gives the coefficients that the file of a link leaves out. A slender body is cut into strips across its
axis a. The strip at r has the cross section A, the width d and the length ds. Water resists the velocity of the strip
across the axis, v_p = P (v + omega x r) = P H nu with P = I - a a^T and H = [I, -S(r)], and does not resist that along
it (Fossen (2021), 6.4; Morison's equation for a moving body):

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

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import TypedDict

import mujoco
import numpy as np

from ..errors import Fault, suggestion


def _derivatives(suffix: str) -> np.ndarray:
    """(6, 6) names, such as Y_r at [1, 5]; ``suffix`` is a format for the velocity."""
    return np.array([[f"{wrench}_{suffix.format(v)}" for v in "uvwpqr"] for wrench in "XYZKMN"])


DERIVATIVES = {"M_A": _derivatives("{0}dot"), "D_linear": _derivatives("{0}"), "D_quadratic": _derivatives("{0}{0}")}
"""(6, 6) names of the derivatives of each matrix."""

KNOWN_NUMERICS = frozenset(
    ["displaced_mass", "center_of_buoyancy", *DERIVATIVES, *np.concatenate([*DERIVATIVES.values()]).ravel().tolist()]
)
"""Names of all ``<numeric>`` entries that are read from a vehicle's file."""

LINK_NUMERICS = KNOWN_NUMERICS | {"strip_theory"}
"""Names of the numerics behind the name of a link and a dot."""

JOINT_NUMERICS = frozenset(["speed_limit"])
"""Names of the numerics behind the name of a joint and a dot."""

_CLOSE = 0.8
"""Least similarity at which a name counts as misspelt."""
_IGNORED = "is not a coefficient and would be ignored; leave it out, or write a remark as <text>"
_STRIPS = (
    "fills in the water of a link that is a slender body, and not of the base; give the base's displaced_mass, "
    "center_of_buoyancy, added mass and damping"
)
LARGEST = 1e15
"""Bound on every number, in SI units; products of larger numbers could overflow."""
_ROUNDING = 1e-9
"""Relative tolerance, as numbers in a file may be rounded."""


def has_numeric(model: mujoco.MjModel, name: str) -> bool:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name) >= 0


def numeric(
    model: mujoco.MjModel, name: str, size: int, faults: list[Fault], default: np.ndarray | None = None
) -> np.ndarray:
    """The (size,) numbers of a ``<numeric>``, or the default.

    A missing numeric without a default, a wrong size and a number out of bounds are errors, appended to ``faults``. The
    numbers are then the default or zero.
    """
    instead = np.zeros(size) if default is None else default
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    if index < 0:
        if default is None:
            faults.append(Fault(name, "no such <numeric> in the model"))
        return instead
    start, n = model.numeric_adr[index], model.numeric_size[index]
    values = np.array(model.numeric_data[start : start + n])
    if n != size:
        faults.append(Fault(name, f"has {n} values; {size} are needed"))
        return instead
    wrong = values[~(np.abs(values) <= LARGEST)]
    if wrong.size:
        faults.append(Fault(name, f"{wrong[0]:g}: must be finite and at most {LARGEST:g}"))
        return instead
    return values


def added_mass(model: mujoco.MjModel, prefix: str, faults: list[Fault]) -> np.ndarray:
    """M_A (6, 6) [kg, kg m, kg m^2], symmetric and positive semi-definite unless an error is appended to ``faults``."""
    before = len(faults)
    M_A, names, sign = _matrix(model, prefix, "M_A", faults)
    faults += [
        Fault(names[i, i], f"{sign * M_A[i, i]:g}: must not be {_wrong_sign(sign)}, as added mass is positive")
        for i in np.flatnonzero(np.diag(M_A) < 0.0)
    ]
    if sign < 0.0:
        given = np.vectorize(lambda name: has_numeric(model, name))(names)
        M_A = np.where(given, M_A, M_A.T)
    largest = np.abs(M_A).max()
    faults += [
        Fault(names[i, j], _asymmetry(sign * M_A[i, j], sign * M_A[j, i], names[j, i]))
        for i, j in zip(*np.triu_indices(6, 1), strict=True)
        if abs(M_A[i, j] - M_A[j, i]) > max(_ROUNDING * largest, _printed(M_A[i, j], M_A[j, i], M_A[i, i] * M_A[j, j]))
    ]
    M_A = (M_A + M_A.T) / 2.0
    if len(faults) == before and (least := np.linalg.eigvalsh(M_A)[0]) < -_ROUNDING * largest:
        faults.append(Fault(f"{prefix}M_A", f"is not positive semi-definite: its least eigenvalue is {least:g}"))
    return M_A


_OF_ITS_AXES = 1e-3
"""Most that two numbers of one entry may differ by rounding, relative to the added masses of their two axes."""


def _printed(here: float, there: float, axes: float) -> float:
    """How far apart the two numbers of an entry may be if both are one number, rounded when it was printed: a unit of
    the last printed digit, but little beside the added masses of its two axes, whose product is ``axes``."""
    decimals = max(_decimals(here), _decimals(there))
    return min(1.000001 * 10.0**-decimals, _OF_ITS_AXES * np.sqrt(max(axes, 0.0)))


def _decimals(x: float) -> int:
    """The place of the last digit behind the decimal point of a number, as a file has it."""
    exponent = Decimal(repr(float(x))).normalize().as_tuple().exponent
    return -exponent if isinstance(exponent, int) else 0


def _asymmetry(here: float, there: float, name: str) -> str:
    said = f"{here:.9g}, but {name} has {there:.9g}: added mass is symmetric"
    if abs(here - there) > 0.1 * max(abs(here), abs(there)):
        return f"{said}; correct one of them"
    return f"{said}; write {(here + there) / 2.0:.9g}, the mean, for both, or correct one of them"


def damping_matrix(model: mujoco.MjModel, prefix: str, name: str, faults: list[Fault]) -> np.ndarray:
    """D_linear or D_quadratic (6, 6), by its name. No diagonal entry is negative unless an error is appended to
    ``faults``."""
    D, names, sign = _matrix(model, prefix, name, faults)
    faults += [
        Fault(names[i, i], f"{sign * D[i, i]:g} is not dissipative: must not be {_wrong_sign(sign)}")
        for i in np.flatnonzero(np.diag(D) < 0.0)
    ]
    return D


def _wrong_sign(sign: float) -> str:
    return "negative" if sign > 0.0 else "positive"


def _matrix(
    model: mujoco.MjModel, prefix: str, whole: str, faults: list[Fault]
) -> tuple[np.ndarray, np.ndarray, float]:
    """A matrix (6, 6) from its 36 numbers or its derivatives, the names (6, 6) of its entries in the file, and the sign
    with which the file gives them."""
    names = np.char.add(prefix, DERIVATIVES[whole])
    if has_numeric(model, prefix + whole):
        beside = [name for name in names.flat if has_numeric(model, name)]
        if beside:
            reason = f"is given together with {', '.join(beside)}: give the matrix or its derivatives, not both"
            faults.append(Fault(prefix + whole, reason))
        values = numeric(model, prefix + whole, 36, faults, np.zeros(36))
        places = [[f"{prefix}{whole}, row {i}, column {j}" for j in range(1, 7)] for i in range(1, 7)]
        return values.reshape(6, 6), np.array(places), 1.0
    zero = np.zeros(1)
    matrix = np.array(
        [[numeric(model, names[i, j], 1, faults, None if i == j else zero)[0] for j in range(6)] for i in range(6)]
    )
    return 0.0 - matrix, names, -1.0


def wrong_numerics(model: mujoco.MjModel, base: int, prefix: str, alone: bool = False) -> list[Fault]:
    """Errors for numerics with this prefix that are named almost like a coefficient of the vehicle on the body
    ``base``. Other numerics are allowed in a model, unless it consists of one vehicle ``alone``."""
    links, joints = _owners(model, base, prefix)
    faults = []
    for name in (model.numeric(i).name for i in range(model.nnumeric)):
        word = name.removeprefix(prefix)
        owner, dot, entry = word.rpartition(".")
        if not name.startswith(prefix) or ("/" in word and owner not in links | joints):  # of another attached model
            message: str | None = _IGNORED
        elif dot:
            message = _of_a_link(owner, entry, links, joints, model, prefix)
        else:
            message = None if word in KNOWN_NUMERICS else misspelt(word, KNOWN_NUMERICS) or _IGNORED
            message = _STRIPS if word == "strip_theory" else message
        if message and (alone or message != _IGNORED):
            faults.append(Fault(name, message))
    return faults


def _owners(model: mujoco.MjModel, base: int, prefix: str) -> tuple[set[str], set[str]]:
    """Names of the links and of their joints, without the prefix. A joint without a name has the name of its link."""
    links, joints = set[str](), set[str]()
    for body in np.flatnonzero((model.body_rootid == base) & (model.body_dofnum > 0)):
        if body != base:
            name = model.body(body).name
            links.add(name.removeprefix(prefix))
            first = model.body_jntadr[body]
            names = [model.joint(i).name or name for i in range(first, first + model.body_jntnum[body])]
            joints |= {each.removeprefix(prefix) for each in names}
    return links, joints


def _of_a_link(
    owner: str, word: str, links: set[str], joints: set[str], model: mujoco.MjModel, prefix: str
) -> str | None:
    """The error in a numeric ``owner.word``, or None."""
    owners = joints if word in JOINT_NUMERICS else links
    kind = "joint" if word in JOINT_NUMERICS else "link"
    if word in JOINT_NUMERICS or word in LINK_NUMERICS:
        if owner in owners:
            return None
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, prefix + owner)
        if kind == "link" and body > 0:
            carrier = model.body(model.body_weldid[body]).name.removeprefix(prefix)
            if carrier == owner and word == "strip_theory":
                return _STRIPS
            if carrier == owner:
                return f"body {owner!r} is the base: its coefficients have no name in front"
            return f"body {owner!r} has no joint: its water is part of the water of {carrier!r}, which carries it"
        choices = suggestion(owner, owners) if owners else "the vehicle has none"
        return f"{owner!r} is not a {kind} of the vehicle; {choices}"
    if owner in links | joints:
        return misspelt(word, LINK_NUMERICS | JOINT_NUMERICS) or _IGNORED
    return _IGNORED


_PRODUCT = re.compile(r"[XYZKMN]_?\|?[uvwpqr]\|?[uvwpqr]\|?")


def misspelt(word: str, known: frozenset[str]) -> str | None:
    """The sentence for a word that is a product of velocities, or almost a known one."""
    if _PRODUCT.fullmatch(word):
        return f'is a product of velocities: write <text name="products" data="{word.replace("_", "")} ..."/>'
    lower = {each.lower(): each for each in sorted(known)}
    close = difflib.get_close_matches(word.lower(), lower, n=1, cutoff=_CLOSE)
    return f"is not a coefficient; did you mean {lower[close[0]]!r}?" if close else None


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
    """Coefficients of a link about its frame's origin, and the names of the coefficients that strip theory filled
    in."""

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
    """Coefficients by strip theory of a link that asks for them, or None with an error."""
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
