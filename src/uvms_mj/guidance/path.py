r"""Motion along paths: through poses and on a circle at a constant speed, and along the wall with a given push.

**Through poses**, a path is a smooth curve by its arc length, with a limited acceleration at its ends. A leg is the
part of a path between two stops: the start, the poses with a dwell, and the end. Its curve is the natural quintic
spline over the lengths of the chords, a straight line if the leg has two poses. Its speed rises over the time :math:`T
= 3 V / (2 a)` as :math:`V (3 x^2 - 2 x^3)`, whose greatest acceleration along the path is a, and falls in the same way.
A leg that is shorter than V T is done at a lower speed.

**A circle** reaches its speed smoothly from rest. With the angle :math:`\varphi` and the unit vectors a, b of the
plane, :math:`p_d = c + R (a \cos\varphi + b \sin\varphi)`. The angular rate rises over the time T as :math:`\Omega (3
x^2 - 2 x^3)`, x = t/T, so that the acceleration is continuous, and falls in the same way before the last turn is
complete.

**Along the wall**, position is in the wall's plane and force along its normal. The reference approaches the wall along
x, stops at the depth at which the desired impedance demands the push F from eq. (7) and the wall's spring,

.. math:: x_d - x_c = F (n^\top K_d^{-1} K_f n + 1/k_c) + n^\top K_d^{-1} K_f F_d,

and then follows a constant-speed path in the plane at this depth. n is the wall's inward normal in the frame of the
task. K_f and F_d are those before the schedule of the impedance, which changes the push on the way. Without a spring
K_d along n, F_d alone demands the push, and the depth is zero.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import AfterValidator
from pydantic.dataclasses import dataclass as table

from ..errors import Fault, InputError
from ..physics.frames import multiply, quat_from_euler_deg, rotation_matrix
from ..physics.kernels import kernel
from ..quantities import STRICT, Angle, Angles, Coordinate, NonNegative, Number, Position, Positive, Time, within
from ..stages.base import setting
from ..stages.setup import ScenarioLike, SetupLike
from .base import Guidance, start_notes
from .spline import MOST_SEGMENTS, Followed, hermite, pack, pose_numbers

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, PPoly


MOST_POSES = 100
RAMP = 6
"""Segments while the speed rises or falls; on a straight line one would be exact."""
_SAMPLES = 2001
SHORTEST = 1e-6
"""Poses that are nearer to each other than this have no direction between them [m]."""


@table(frozen=True, config=STRICT)
class Pose:
    position: Position
    attitude_deg: Angles | None = None
    dwell: Time = 0.0


def _some(poses: tuple[Pose, ...]) -> tuple[Pose, ...]:
    if not 1 <= len(poses) <= MOST_POSES:
        raise ValueError(f"has {len(poses)} poses; 1 to {MOST_POSES} are allowed")
    return poses


@functools.lru_cache(maxsize=8)
def motion(
    positions: tuple[Any, ...],
    attitudes: tuple[Any, ...],
    dwells: tuple[float, ...],
    timing: tuple[float, ...],
    keys: Any,
) -> dict[str, np.ndarray]:
    """The constants of :func:`.spline.follow` for a path through positions with attitudes [deg], the first of which
    is the start; with the dwell at each [s]. ``timing`` has the time at which the start is left, the speed V and the
    acceleration a; ``keys`` name the poses after the start, in messages."""
    numbers = pose_numbers(positions, attitudes, keys)
    chords = np.linalg.norm(np.diff(numbers[:, :3], axis=0), axis=1)
    faults = [
        Fault(
            keys[i],
            f"the position {list(positions[i + 1])} is the position of the pose before it, or of the start: a path has "
            "no direction there; use reference.name = spline, or a dwell at the pose before it",
        )
        for i in np.flatnonzero(chords < SHORTEST)
    ]
    if faults:
        raise InputError(faults, "scenario")
    stops = [0, *(i for i, dwell in enumerate(dwells) if i and (dwell > 0.0 or i + 1 == len(dwells)))]
    cruise, ramp = _segments([last - first for first, last in itertools.pairwise(stops)], keys)
    parts, (t, V, a) = [], timing
    for first, last in itertools.pairwise(stops):
        knots = np.concatenate([[0.0], np.cumsum(chords[first:last])])
        ramps = ramp if last == first + 1 else RAMP
        parts.append(leg(through(numbers[first : last + 1], knots), knots[-1], t, V, a, cruise, ramps))
        t = float(parts[-1].x[-1]) + dwells[last]
    return pack(parts)


def _segments(pieces: list[int], keys: Any) -> tuple[int, int]:
    """Segments of a curved leg at its speed, and of each ramp of a straight one, for legs of so many pieces. A straight
    leg has one at its speed, and each leg one of rest. Raises InputError if there are too many legs."""
    if (cruise := MOST_SEGMENTS // len(pieces) - 2 * RAMP - 1) >= 1:
        return cruise, RAMP
    curved = sum(each > 1 for each in pieces)
    left = MOST_SEGMENTS - 4 * (len(pieces) - curved)  # one in a ramp is exact, too
    cruise = left // max(1, curved) - 2 * RAMP - 1
    if cruise < 1:
        wrong = f"the path has {len(pieces)} stops, with a curve through other poses before {curved} of them"
        room = f"at most {left // (2 * RAMP + 2)} curves fit beside the straight legs"
        where = keys[-1].rpartition("[")[0]
        raise InputError([Fault(where, f"{wrong}; {room}: take away stops, or poses between them")], "scenario")
    return cruise, 1


def through(poses: np.ndarray, knots: np.ndarray) -> BSpline:
    """The smooth curve through poses (n, 7), or positions (n, 3), at knots (n,); a straight line through two."""
    from scipy.interpolate import make_interp_spline

    if len(poses) == 2:
        return make_interp_spline(knots, poses, k=1)
    free = [(3, np.zeros(poses.shape[1])), (4, np.zeros(poses.shape[1]))]
    return make_interp_spline(knots, poses, k=5, bc_type=(free, free))


def leg(curve: BSpline, end: float, t: float, V: float, a: float, cruise: int, ramp: int = RAMP) -> PPoly:
    """One leg along a curve of poses (7,) over [0, end], from rest at the time t to rest: segments with the exact
    position, velocity and acceleration at their ends, so many at the speed V, and in each ramp."""
    from scipy.integrate import cumulative_simpson
    from scipy.interpolate import CubicHermiteSpline

    straight = curve.k == 1
    u = np.linspace(0.0, end, _SAMPLES)
    slope = np.linalg.norm(curve(u, 1)[:, :3], axis=1)  # ds/du
    s = cumulative_simpson(slope, x=u, initial=0.0)
    length, of_length = s[-1], CubicHermiteSpline(s, u, 1.0 / slope)
    V = min(V, float(np.sqrt(length * a / 1.5)))
    T = 1.5 * V / a
    T_cruise = length / V - T
    x = np.linspace(0.0, 1.0, ramp + 1)
    risen = V * T * (x**3 - 0.5 * x**4), V * (3.0 * x**2 - 2.0 * x**3), V / T * 6.0 * (x - x**2)
    between = np.linspace(0.0, 1.0, (1 if straight else cruise) + 1)[1:-1]
    if T_cruise < 1e-9 * T:
        between = between[:0]
    ones = np.ones_like(between)
    times = np.concatenate([x * T, T + between * T_cruise, T + T_cruise + x * T])
    s = np.concatenate([risen[0], 0.5 * V * T + V * T_cruise * between, length - risen[0][::-1]])
    s_dot = np.concatenate([risen[1], V * ones, risen[1][::-1]])
    s_ddot = np.concatenate([risen[2], 0.0 * ones, -risen[2][::-1]])
    later = (np.diff(times) > 1e-12 * T) & (
        np.diff(t + times) > 0.0
    )  # in a long leg, a ramp is below a double's digits
    kept = np.concatenate([later, [True]])
    times, s, s_dot, s_ddot = times[kept], s[kept, None], s_dot[kept, None], s_ddot[kept, None]
    u = np.clip(of_length(s[:, 0]), 0.0, end)
    c, c_1, c_2 = curve(u), curve(u, 1), curve(u, 2) if not straight else np.zeros((len(u), 7))
    speed = np.linalg.norm(c_1[:, :3], axis=1, keepdims=True)
    bend = np.sum(c_1[:, :3] * c_2[:, :3], axis=1, keepdims=True) / speed**2  # of ds/du along u, over ds/du
    u_dot = s_dot / speed
    u_ddot = s_ddot / speed - bend * u_dot**2
    return hermite(t + times, c, c_1 * u_dot, c_2 * u_dot**2 + c_1 * u_ddot)


@dataclass(frozen=True)
class Path(Followed):
    """Constant-speed path: a smooth curve through positions and attitudes by its arc length, from rest to rest."""

    poses: Annotated[tuple[Pose, ...], AfterValidator(_some)] = setting(
        (Pose(position=(1.01, 0.0, 0.0)),),
        "m, deg, s",
        "[{position = [1.01, 0.0, 0.0], attitude_deg = [0.0, 0.0, 30.0], dwell = 2.0}, ...]; attitude_deg may be left "
        "out; at a pose with a dwell the path stops; at most 100",
    )
    speed: Positive = setting(0.2, "m/s", "speed along the path")
    acceleration: Positive = setting(0.1, "m/s^2", "greatest acceleration along the path, at the ends of a leg")
    start: Position | None = setting(
        None, "m", "position before the path, with initial.attitude_deg; default: initial.position"
    )
    start_time: Time = setting(1.0, "s", "time at which the path begins")

    name = "path"
    _inner_keys: ClassVar = {"reference.poses": ("position", "attitude_deg", "dwell")}

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The constants of :func:`.spline.follow`."""
        initial = setup.initial
        positions = (self.start or initial.position, *(pose.position for pose in self.poses))
        attitudes = (initial.attitude_deg, *(pose.attitude_deg or self.attitude_deg for pose in self.poses))
        keys = tuple(f"reference.poses[{i}]" for i in range(len(self.poses)))
        dwells = (0.0, *(pose.dwell for pose in self.poses))
        return motion(positions, attitudes, dwells, (self.start_time, self.speed, self.acceleration), keys)

    def rests_at(self) -> tuple[float, ...]:
        return self.poses[-1].position

    def rest_pose(self, scenario: ScenarioLike) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return self.poses[-1].position, self.poses[-1].attitude_deg or self.attitude_deg


@dataclass(frozen=True)
class Circle(Guidance):
    """Circle in any plane, from rest, with a constant attitude or a heading along the path."""

    radius: Positive = setting(0.5, "m", "radius")
    speed: Annotated[Number, within(-100.0, 100.0, "m/s")] = setting(
        0.2, "m/s", "speed, positive to the left of the plane's x"
    )
    plane_deg: Angles = setting((0.0, 0.0, 0.0), "deg", "roll, pitch, yaw of the plane; zero: x and y of W")
    start_deg: Angle = setting(-90.0, "deg", "angle on the circle at the start, from the plane's x")
    turns: Annotated[Number, within(0.0, 1e6, "")] = setting(0.0, "1", "number of turns; 0: without end")
    rise: Positive = setting(2.0, "s", "time in which the speed rises")
    start: Position | None = setting(None, "m", "position at the start; default: initial.position")
    start_time: Time = setting(1.0, "s", "time at which the motion begins")
    heading: bool = setting(
        False, "-", "true: the attitude turns with the path, about the plane's normal, from attitude_deg at the start"
    )

    name = "circle"

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """quat_d (4,) at the start; u and v (3,), radii of the plane along x and y [m]; centre and normal (3,); angle
        at the start [rad], Omega [rad/s], rise [s]; whole [rad], the angle of all turns; end [s] of the motion."""
        plane = rotation_matrix(quat_from_euler_deg(*self.plane_deg))
        u, v = self.radius * plane[:, 0], self.radius * plane[:, 1]
        angle, rate = math.radians(self.start_deg), self.speed / self.radius
        whole = 2.0 * math.pi * self.turns
        if self.turns > 0.0 and abs(rate) * self.rise > whole:  # too short for the speed
            rate = math.copysign(whole / self.rise, rate)
        end = whole / abs(rate) + self.rise if self.turns > 0.0 and rate else math.inf
        start = np.array(self.start or setup.initial.position)
        return {
            "quat_d": quat_from_euler_deg(*self.attitude_deg),
            "u": tuple(u),
            "v": tuple(v),
            "centre": tuple(start - math.cos(angle) * u - math.sin(angle) * v),
            "normal": tuple(plane[:, 2]),
            "angle": angle,
            "Omega": rate,
            "rise": self.rise,
            "whole": math.copysign(whole, rate),
            "end": end,
            "start_time": self.start_time,
            "heading": self.heading,
        }

    def rests_at(self) -> tuple[float, ...] | None:
        return None if self.start is None else self._end(self.start)

    def rest_pose(self, scenario: ScenarioLike) -> tuple[tuple[float, ...] | None, tuple[float, ...]]:
        position, attitude = self._end(self.start or scenario.initial.position), self.attitude_deg
        if position is not None and self.heading and self.turns % 1.0:
            from scipy.spatial.transform import Rotation  # most runs start without SciPy

            plane = rotation_matrix(quat_from_euler_deg(*self.plane_deg))
            turned = Rotation.from_rotvec(math.copysign(2.0 * math.pi * self.turns, self.speed) * plane[:, 2])
            whole = turned * Rotation.from_euler("ZYX", attitude[::-1], degrees=True)
            attitude = tuple(whole.as_euler("ZYX", degrees=True)[::-1].tolist())
        return position, attitude

    def _end(self, start: tuple[float, ...]) -> tuple[float, ...] | None:
        """The position at the end of all turns; None if there is none."""
        if self.speed == 0.0:
            return start
        if self.turns == 0.0:
            return None
        plane, first = rotation_matrix(quat_from_euler_deg(*self.plane_deg)), math.radians(self.start_deg)
        last = first + math.copysign(2.0 * math.pi * self.turns, self.speed)
        moved = (math.cos(last) - math.cos(first)) * plane[:, 0] + (math.sin(last) - math.sin(first)) * plane[:, 1]
        return tuple((np.array(start) + self.radius * moved).tolist())

    def notes(self, setup: SetupLike) -> Iterable[str]:
        return start_notes(self, setup)

    @staticmethod
    def step(settings, state, given, state_dot, out):
        tau, T, Omega = given.t - settings.start_time, settings.rise, settings.Omega
        angle, rate, growth = 0.0, 0.0, 0.0
        if tau >= settings.end:
            angle = settings.whole
        elif tau > 0.0:
            back = settings.end - tau
            x = min(1.0, min(tau, back) / T)
            angle = Omega * T * (x * x * x - 0.5 * x * x * x * x)
            rate = Omega * (3.0 * x * x - 2.0 * x * x * x)
            growth = Omega / T * 6.0 * (x - x * x)
            if back < T:
                angle, growth = settings.whole - angle, -growth
            else:
                angle += Omega * max(0.0, tau - T)
        cosine, sine = math.cos(settings.angle + angle), math.sin(settings.angle + angle)
        turned = angle if settings.heading else 0.0
        for i in range(3):
            u, v, n = settings.u[i], settings.v[i], settings.normal[i]
            out.p_d[i] = settings.centre[i] + u * cosine + v * sine
            out.p_d_dot[i] = rate * (v * cosine - u * sine)
            out.p_d_ddot[i] = growth * (v * cosine - u * sine) - rate * rate * (u * cosine + v * sine)
            out.omega_d[i] = n * rate if settings.heading else 0.0
            out.omega_d_dot[i] = n * growth if settings.heading else 0.0
        turn_about(settings.normal, turned, settings.quat_d, out.quat_d)


@kernel
def turn_about(axis, angle, quat, out):
    """Set out (4,) to the attitude ``quat`` turned about a unit vector in W by an angle [rad]."""
    w, s = math.cos(0.5 * angle), math.sin(0.5 * angle)
    x, y, z = s * axis
    multiply(np.array([w, x, y, z]), quat, out)


MOMENT = 1e-6
"""Dwell at a point at which the path only stops [s]."""


def _in_plane(points: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    if not 1 <= len(points) < MOST_POSES:
        raise ValueError(f"has {len(points)} points; 1 to {MOST_POSES - 1} are allowed")
    for i, point in enumerate(points):
        if len(point) != 2:
            raise ValueError(f"has {len(point)} values at [{i}]; 2 are needed, y and z of W")
    return points


def depth_of(push: float, impedance: Any, normal: np.ndarray, per_k: float) -> float:
    """The depth x_d - x_c [m] at which the desired impedance, eq. (7), demands a push [N] along a wall's inward normal
    (3,) in the frame of the task, of a wall and a bumper with the compliance ``per_k`` [m/N]. Zero without a stiffness
    K_d along it: F_d alone demands the push."""
    pushed = np.abs(normal) > 1e-12
    n, K_d, K_f, F_d = (np.array(a)[:3][pushed] for a in (normal, impedance.K_d, impedance.K_f, impedance.F_d))
    if (K_d == 0.0).any():
        return 0.0
    give = K_f / K_d
    return push * (float(n @ (give * n)) + per_k) + float(n @ (give * F_d))


@dataclass(frozen=True)
class AlongWall(Followed):
    """Along the wall with a given push: approach, dwell, then a constant-speed path in the wall's plane."""

    push: NonNegative = setting(1.5, "N", "push that the desired impedance demands at rest, before its schedule")
    points: Annotated[tuple[tuple[Coordinate, ...], ...], AfterValidator(_in_plane)] = setting(
        ((1.0, 0.0),), "m", "[[y, z], ...] of W after the point of the approach, through which the path goes"
    )
    speed: Positive = setting(0.1, "m/s", "speed along the wall")
    acceleration: Positive = setting(0.05, "m/s^2", "greatest acceleration along the path, at its ends")
    dwell: Positive = setting(5.0, "s", "time at the wall before the path along it begins")
    stop: bool = setting(False, "-", "true: stop at each point, with straight lines between them")
    start_time: Time = setting(1.0, "s", "time at which the approach begins")

    name = "along_wall"

    def depth(self, scenario: ScenarioLike) -> float:
        """x_d - x_c [m] that demands the push."""
        wall, normal = scenario.wall, rotation_matrix(quat_from_euler_deg(*self.attitude_deg))[0]
        k_c, _ = scenario.bumper.in_front_of(wall.stiffness, wall.damping)
        return depth_of(self.push, scenario.impedance, normal, 1.0 / k_c)

    def force_at_rest(self) -> tuple[float, ...]:
        return tuple((-self.push * rotation_matrix(quat_from_euler_deg(*self.attitude_deg))[0]).tolist())

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The constants of :func:`.spline.follow`."""
        scenario = setup.scenario
        initial, x_d = setup.initial, scenario.wall.position + self.depth(scenario)
        positions = [initial.position, (x_d, *initial.position[1:]), *((x_d, *point) for point in self.points)]
        attitudes = (initial.attitude_deg, *(self.attitude_deg for _ in positions[1:]))
        dwells = (0.0, self.dwell, *(MOMENT if self.stop else 0.0 for _ in self.points))
        keys = ("wall.position", *(f"reference.points[{i}]" for i in range(len(self.points))))
        timing = (self.start_time, self.speed, self.acceleration)
        return motion(tuple(positions), attitudes, dwells, timing, keys)

    def rest_pose(self, scenario: ScenarioLike) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return (scenario.wall.position + self.depth(scenario), *self.points[-1]), self.attitude_deg

    def faults(self, setup: SetupLike) -> Iterable[Fault]:
        scenario = setup.scenario
        if not scenario.wall.present:
            yield Fault("reference.name", "along_wall follows [wall], and wall.present is false; use path")
        elif scenario.vehicle.contact_bodies:
            touches = "along_wall pushes with the sphere about the origin, and the scenario has vehicle.contact_bodies"
            yield Fault("reference.name", f"{touches}; use path")
