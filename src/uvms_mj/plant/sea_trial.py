r"""A vehicle's first sea trial, by formulas: the tests of an engineer's first day, so that a wrong sign or unit
is seen before the first run.

- Trim: the attitude at which :math:`d = m_d r_b - m r_g` points up. Small angles delta about it give the moment
  :math:`-g |d| (I - u u^T) \delta` with u the upward direction in B (Fossen (2021), 4.1).
- Terminal speed of an axis: D v + Q v^2 = t with its diagonal damping, and the greatest force t in this axis that the
  thrusters give without any in another one that they have, by linear programming.
- Decay from v_0 to v_1 of M dv/dt = -(D v + Q v^2): :math:`(M/D) \ln(v_0 (D + Q v_1) / (v_1 (D + Q v_0)))`.
- Stability in straight motion with the speed u: the eigenvalues of
  :math:`M \dot\nu = -C(\nu)\nu - D(\nu)\nu + f(\nu) - g` about it, with a force that holds u. The Munk moment
  :math:`(X_{\dot u} - Y_{\dot v}) u v` of a long body turns it across the flow.

Links are at q = 0. Their mass, added mass, linear damping and buoyancy count; their quadratic damping does not.
"""

import dataclasses
import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linprog

from ..files import shipped
from ..physics.fossen import turned_momentum
from ..physics.spanned_axes import is_unreached
from .coefficients import DENSITY
from .importing.moving import HERE, Pose, moved
from .mjcf import Mjcf
from .vehicle import AXES, Vehicle, notes_on_damping

GRAVITY = 9.81
SPEEDS = (0.5, 1.0, 2.0)
"""Forward speeds at which the stability is found [m/s]."""
UNUSUAL = 3.0
"""How far a number lies beyond the shipped vehicles' before it is worth a look [1]."""
_HALF_LOG = math.log(2.0)


@dataclass(frozen=True, eq=False)
class Axis:
    """One axis. Units are of the axis: N, kg, m/s, or N m, kg m^2, rad/s.

    Attributes:
        name: surge to yaw.
        inertia, added: of M_RB and of M_A.
        linear, quadratic: diagonal damping.
        thrust: least and greatest force in this axis alone; None if the thrusters can't produce it alone.
        speed: terminal speeds at them; infinite without a limit or without damping.
        halved: time from 1 to 0.5 m/s or rad/s [s]; infinite without damping.
        time_constant: inertia over linear damping [s]; infinite without it.
    """

    name: str
    inertia: float
    added: float
    linear: float
    quadratic: float
    thrust: tuple[float, float] | None
    speed: tuple[float, float] | None
    halved: float
    time_constant: float


@dataclass(frozen=True, eq=False)
class Compared:
    """A number in its unit, and the least and greatest of the shipped vehicles', scaled to the size of this one."""

    name: str
    unit: str
    value: float
    low: float
    high: float

    @property
    def unusual(self) -> bool:
        if self.low <= self.value <= self.high:
            return False
        return not self.low / UNUSUAL <= self.value <= self.high * UNUSUAL


@dataclass(frozen=True, eq=False)
class Trial:
    """The findings about a vehicle.

    Attributes:
        mass, displaced_mass: of the whole vehicle [kg].
        buoyancy: upward force at rest with thrusters off [N].
        righting: length of d over the mass, with the sign of its z component in B: the height of the centre of buoyancy
            over the centre of gravity of a neutral vehicle [m].
        roll, pitch: attitude at rest [deg].
        periods: periods [s] and damping ratios of the two oscillations about it; an infinite period for none.
        axes: the six axes.
        growth: by the forward speed [m/s], the greatest real part of an eigenvalue [1/s]; positive is unstable.
        energy: sentences on damping that feeds energy in.
        compared: numbers beside other vehicles' at this size.
        remarks: findings that are worth a look: a sentence each.
    """

    mass: float
    displaced_mass: float
    buoyancy: float
    righting: float
    roll: float
    pitch: float
    periods: tuple[tuple[float, float], ...]
    axes: tuple[Axis, ...]
    growth: dict[float, float]
    energy: tuple[str, ...]
    compared: tuple[Compared, ...]
    remarks: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Whole:
    """Base and links at q = 0, about B's origin."""

    M_RB: np.ndarray
    M_A: np.ndarray
    D_linear: np.ndarray
    D_quadratic: np.ndarray
    mass: float
    displaced_mass: float
    d: np.ndarray
    """(3,) m_d r_b - m r_g [kg m]."""
    products: tuple[tuple, ...]


def trial(vehicle: Vehicle) -> Trial:
    """The first sea trial of a vehicle."""
    whole = _whole(vehicle)
    d = whole.d
    level = float(np.linalg.norm(d))
    up = d / level if level > 0.0 else np.array([0.0, 0.0, 1.0])
    axes = tuple(_axis(vehicle, whole, i) for i in range(6))
    growth = {u: _growth(whole, up, u) for u in SPEEDS}
    others = _shipped_numbers()
    compared = tuple(
        Compared(name, unit, scale * value, *(scale * end([each[name][0] for each in others]) for end in (min, max)))
        for name, (value, scale, unit) in _numbers(whole).items()
    )
    found = Trial(
        mass=whole.mass,
        displaced_mass=whole.displaced_mass,
        buoyancy=GRAVITY * (whole.displaced_mass - whole.mass),
        righting=math.copysign(level / whole.mass, d[2]),
        roll=math.degrees(math.atan2(up[1], up[2])) + 0.0,
        pitch=math.degrees(-math.asin(np.clip(up[0], -1.0, 1.0))) + 0.0,
        periods=_periods(whole, up),
        axes=axes,
        growth=growth,
        energy=notes_on_damping(vehicle),
        compared=compared,
        remarks=(),
    )
    return dataclasses.replace(found, remarks=tuple(_remarks(found, whole)))


def _whole(vehicle: Vehicle) -> _Whole:
    poses: list[Pose] = []
    M_RB, M_A, D = (getattr(vehicle, each).copy() for each in ("M_RB", "M_A", "D_linear"))
    mass, displaced = vehicle.mass, vehicle.displaced_mass
    d = displaced * vehicle.r_b - mass * vehicle.r_g
    for link in vehicle.arm.links:
        pose = (poses[link.parent] if link.parent >= 0 else HERE) @ Pose(link.R_0, link.p_0)
        poses.append(pose)
        M_RB, M_A, D = M_RB + moved(link.M_RB, pose), M_A + moved(link.M_A, pose), D + moved(link.D_linear, pose)
        mass, displaced = mass + link.mass, displaced + link.displaced_mass
        d = d + link.displaced_mass * pose.point(link.r_b) - link.mass * pose.point(link.r_g)
    products = tuple(each.record for each in vehicle.products)
    return _Whole(M_RB, M_A, D, vehicle.D_quadratic, mass, displaced, d, products)


def _axis(vehicle: Vehicle, whole: _Whole, i: int) -> Axis:
    D, Q = float(whole.D_linear[i, i]), float(whole.D_quadratic[i, i])
    M = float(whole.M_RB[i, i] + whole.M_A[i, i])
    reach = _reach(vehicle, i)
    speed = None if reach is None else (-terminal(D, Q, -reach[0]), terminal(D, Q, reach[1]))
    constant = M / D if D > 0.0 else math.inf
    added = float(whole.M_A[i, i])
    return Axis(AXES[i], M - added, added, D, Q, reach, speed, decay(M, D, Q, 1.0, 0.5), constant)


def terminal(D: float, Q: float, force: float) -> float:
    """The speed at which D v + Q v^2 is a force that is not negative; infinite without damping."""
    if not math.isfinite(force):
        return math.inf
    if D <= 0.0 and Q <= 0.0:
        return math.inf if force > 0.0 else 0.0
    return 2.0 * force / (D + math.sqrt(D**2 + 4.0 * Q * force)) if force > 0.0 else 0.0


def decay(M: float, D: float, Q: float, v_0: float, v_1: float) -> float:
    """The time in which M dv/dt = -(D v + Q v^2) brings v_0 to v_1 [s]; infinite without damping."""
    if D <= 0.0 and Q <= 0.0:
        return math.inf
    if D <= 0.0:
        return M / Q * (1.0 / v_1 - 1.0 / v_0)
    return M / D * math.log(v_0 * (D + Q * v_1) / (v_1 * (D + Q * v_0)))


def _reach(vehicle: Vehicle, i: int) -> tuple[float, float] | None:
    """Least and greatest force in one axis, with none in the others that the thrusters have, within the limits of the
    thrusts; None if there is no such force."""
    B, n = vehicle.B, len(vehicle.thrusters)
    if not n:
        return None
    lost = is_unreached(B)
    if lost[i]:
        return None
    limits = list(zip(vehicle.u_min, vehicle.u_max, strict=True))
    bounds = [(None if low == -np.inf else low, None if high == np.inf else high) for low, high in limits]
    others = B[~lost & (np.arange(6) != i)]  # what the thrusters can't give needs no equation
    scale = np.abs(others).max(axis=1, keepdims=True)
    ends = []
    for sign in (-1.0, 1.0):
        found = linprog(-sign * B[i], A_eq=others / scale, b_eq=np.zeros(len(others)), bounds=bounds)
        if found.status == 3:  # unbounded
            ends.append(sign * math.inf)
        elif found.success:
            ends.append(float(B[i] @ found.x))
        else:
            return None
    low, high = ends
    return (low, high) if high - low > 1e-9 * np.abs(B).max() else None


def _periods(whole: _Whole, up: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Periods [s] and damping ratios of the two slowest oscillations about the attitude at rest, slowest first."""
    G = np.zeros((6, 6))
    G[3:, 3:] = GRAVITY * np.linalg.norm(whole.d) * (np.eye(3) - np.outer(up, up))
    M = whole.M_RB + whole.M_A
    A = np.block([[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(M, G), -np.linalg.solve(M, whole.D_linear)]])
    values = [each for each in np.linalg.eigvals(A) if each.imag > 1e-6]
    values.sort(key=lambda each: each.imag)
    return tuple((2.0 * math.pi / each.imag, abs(float(each.real / abs(each)))) for each in values[:2])


def _growth(whole: _Whole, up: np.ndarray, speed: float) -> float:
    """The greatest real part of an eigenvalue [1/s] of the motion about straight ahead, of v w p q r and the angles."""
    M = whole.M_RB + whole.M_A
    stiffness = GRAVITY * np.linalg.norm(whole.d) * (np.eye(3) - np.outer(up, up))

    def nu_dot(nu: np.ndarray) -> np.ndarray:
        turned = np.zeros(6)
        turned_momentum(M @ nu, nu, turned)
        force = -turned - whole.D_linear @ nu - whole.D_quadratic @ (np.abs(nu) * nu)
        for axis, first, second, bars, c in whole.products:
            force[axis] += c * nu[first] * (abs(nu[second]) if bars else nu[second])
        return np.linalg.solve(M, force)

    at, h = np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]), 1e-6
    J = np.array([(nu_dot(at + h * e) - nu_dot(at - h * e)) / (2.0 * h) for e in np.eye(6)]).T
    J[0] = 0.0  # a force holds the speed
    A = np.zeros((9, 9))
    A[:6, :6] = J
    A[:6, 6:] = -np.linalg.solve(M, np.vstack([np.zeros((3, 3)), stiffness]))
    A[0] = 0.0
    A[6:, 3:6] = np.eye(3)
    keep = [1, 2, 3, 4, 5, 6, 7, 8]
    return float(np.linalg.eigvals(A[np.ix_(keep, keep)]).real.max())


def _numbers(whole: _Whole) -> dict[str, tuple[float, float, str]]:
    """Numbers without unit, with their scales and the units of these, by the displaced mass m_d and the length L of a
    cube of this water. Rotations are at 1 m/s in the distance L, 1/L rad/s."""
    m_d, m = whole.displaced_mass, whole.mass
    L = (m_d / DENSITY) ** (1.0 / 3.0)
    found: dict[str, tuple[float, float, str]] = {}
    for i, name in enumerate(AXES):
        scale, unit = (m_d, "kg") if i < 3 else (m_d * L**2, "kg m^2")
        found[f"added mass in {name}"] = float(whole.M_A[i, i]) / scale, scale, unit
    for i, name in enumerate(AXES):
        lever, unit = (1.0, "N") if i < 3 else (L, "N m")
        v, scale = 1.0 / lever, 0.5 * DENSITY * L**2 * lever
        drag = float(whole.D_linear[i, i] * v + whole.D_quadratic[i, i] * v**2)
        found[f"drag in {name} at 1 m/s{'' if i < 3 else ' in L'}"] = drag / scale, scale, unit
    for i, name in enumerate(AXES[3:], 3):
        radius = math.sqrt(max(whole.M_RB[i, i], 0.0) / m)
        found[f"radius of gyration in {name}"] = radius / L, L, "m"
    found["righting arm"] = float(np.linalg.norm(whole.d)) / m / L, L, "m"
    found["displaced mass over mass"] = m_d / m, 1.0, "1"
    return found


@functools.cache
def _shipped_numbers() -> tuple[dict[str, tuple[float, float, str]], ...]:
    return tuple(_numbers(_whole(Mjcf.find(name).vehicle)) for name in shipped("models"))


def _remarks(found: Trial, whole: _Whole) -> list[str]:
    """The remarks: findings that are worth a look."""
    said = []
    share = found.buoyancy / (GRAVITY * found.mass)
    if abs(share) > 0.05:
        way = "rises" if share > 0.0 else "sinks"
        said.append(f"it {way} with {100.0 * abs(share):.3g} % of its weight: compare mass and displaced mass")
    if whole.d[2] < 0.0:
        said.append("it floats upside down: the centre of buoyancy is the lower one; is z down in the source?")
    elif max(abs(found.roll), abs(found.pitch)) > 5.0:
        said.append(f"it rests at roll {found.roll:.3g} and pitch {found.pitch:.3g} deg: compare the two centres")
    if not np.linalg.norm(whole.d) > 1e-6 * whole.mass:
        said.append("no moment rights it: the centres of gravity and buoyancy are one point")
    still = [each.name for each in found.axes if each.linear <= 0.0 and each.quadratic <= 0.0]
    if still:
        said.append(f"nothing damps {', '.join(still)}")
    dry = [each.name for each in found.axes if each.added <= 0.0]
    if dry:
        said.append(f"there is no added mass in {', '.join(dry)}")
    limitless = any(each.thrust is not None and not np.isfinite(each.thrust).all() for each in found.axes)
    if limitless:
        said.append("its thrusters have no limit: give them one, ctrlrange")
    fast = [each.name for each in found.axes[:3] if each.speed is not None and 10.0 < each.speed[1] < math.inf]
    if fast:
        said.append(f"its thrusters reach more than 10 m/s in {', '.join(fast)}: compare thrust and damping")
    unstable = [u for u, growth in found.growth.items() if growth > 1e-6]
    if unstable:
        u = unstable[0]
        time = _HALF_LOG / found.growth[u]
        said.append(
            f"straight motion at {u:g} m/s is unstable without control: it doubles what deviates in {time:.3g} s (Munk)"
        )
    heavy = [each.name for each in found.axes if each.added > each.inertia]
    if heavy:
        said.append(
            f"added mass exceeds the body's own in {', '.join(heavy)}: a simulator that takes it with an old "
            "acceleration diverges there; this one does not"
        )
    said += found.energy
    said += [
        f"{each.name} is {each.value:.3g} {each.unit}; the shipped vehicles, scaled to its displaced mass, have "
        f"{each.low:.3g} to {each.high:.3g}"
        for each in found.compared
        if each.unusual
    ]
    return said


def as_numbers(found: Trial) -> dict[str, Any]:
    """The trial as numbers and texts, with None for what is infinite or not there."""

    def plain(value: Any) -> Any:
        if isinstance(value, tuple | list):
            return [plain(each) for each in value]
        if isinstance(value, Axis | Compared):
            return {key: plain(each) for key, each in vars(value).items()}
        if isinstance(value, dict):
            return {str(key): plain(each) for key, each in value.items()}
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return {key: plain(value) for key, value in vars(found).items()}
