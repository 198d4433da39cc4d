r"""Motion along a wall of any shape, at a distance from it, with the axis x of the frame of the task along the inward
normal; and on a wall that moves, with it.

**Geometry.** All points at the distance s from a wall are a surface of their own, d(p) = s with the signed distance d
(:mod:`..physics.surfaces`). A curve through the given points, or a straight line between two of them, is brought on to
it: along the normal n = grad d, or, to keep the depth, along the horizontal part of it,

.. math::

    p \leftarrow p - (d(p) - s)\, n, \qquad p \leftarrow p - \frac{d(p) - s}{|n_h|^2}\, n_h.

The first is exact at once, the second is Newton's method. The frame's x is -n. Its y is level, or the frame turns from
place to place by the smallest turn. Both curves, of position and attitude, are the quintic splines through many
such places, and are followed by their arc length at a constant speed, as any path (:mod:`.path`).

**Distance.** The vehicle touches where the frame's origin is at the distance ``reach`` from the wall. With its contact
bodies on the base it follows from them, at the first point.

**Push.** The desired impedance, eq. (7), demands the push F of one spring k_c at the depth

.. math:: F (K_f / K_d + 1 / k_c) + K_f / K_d \, F_d

along x. F_d is in the frame of the task, so the demanded push turns with it: it is along the normal everywhere.

**On a wall that moves** by u(t) and the rotation vector theta(t) about the pivot c, the reference p, R of the wall at
rest becomes :math:`c + Q (p - c) + u` and Q R, Q of theta, with both time derivatives:

.. math::

    \ddot p_d = \ddot u + \dot\omega \times r + \omega \times (\omega \times r) + 2 \omega \times Q \dot p + Q \ddot p,
    \qquad r = Q (p - c).

Until the reference is at the wall, u and theta are multiplied by a factor that rises from 0 to 1 on the way to it.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import AfterValidator

from ..errors import Fault, InputError
from ..physics.frames import BODY, attitude, multiply, quat_from_euler_deg, rotation, rotation_matrix, turning
from ..physics.kernels import record_of
from ..physics.surfaces import SHAPES, SURFACE, add_sine, add_waves, nearest_on_segment, quaternion_of, signed_distance
from ..quantities import NonNegative, Number, Position, Positive, Time, within
from ..stages.base import setting
from ..stages.setup import ScenarioLike, SetupLike
from .base import start_notes
from .path import MOMENT, RAMP, SHORTEST, leg, through
from .spline import LARGEST_TURN_DEG, MOST_SEGMENTS, Followed, follow, pack

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

MOST_POINTS = 100
_SAMPLES, _MOST_SAMPLES, _A_RADIUS = 60, 2000, 30
"""Places of a leg of the path: at least, at most, and on a length of the wall's radius."""
_EXACT, _CLOSE, _ALONG = 1e-13, 1e-6, 1e-3
"""Distance at which a place is on the surface, and errors of the path's distance [m] and normal that it may have."""
_SIDES = 30.0
"""Largest angle between the normals of neighbouring places [deg]."""
_LEVEL = 0.05
"""Least horizontal part of a normal along which a place keeps its depth, and least level y of a frame."""
_MOST_RAMP = 30
"""Segments while the speed rises or falls, at most."""
_ROWS = 200
"""Rows for the waves that a wall follows: the most components of a sea."""


def _places(points: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    if not 1 <= len(points) <= MOST_POINTS:
        raise ValueError(f"has {len(points)} points; 1 to {MOST_POINTS} are allowed")
    return points


@dataclass(frozen=True)
class AlongSurface(Followed):
    """Along a wall of [[walls]], of any shape: approach along the normal, dwell, then a constant-speed path at a
    distance or with a push, with x along the inward normal; with ``ride`` it moves with the wall."""

    wall: str = setting("walls[0]", "-", "the wall that it follows")
    points: Annotated[tuple[Position, ...], AfterValidator(_places)] = setting(
        ((1.0, 0.0, 0.0),),
        "m",
        "[[x, y, z], ...] in W near the wall at its place without motion, brought on to it; at most 100",
    )
    distance: Annotated[Number, within(-100.0, 100.0, "m")] | None = setting(
        None, "m", "of the point that touches from the wall's face; negative: behind it; default: 0, or by push"
    )
    push: NonNegative | None = setting(
        None, "N", "in place of distance: push that the desired impedance demands at rest, before its schedule"
    )
    reach: Annotated[Number, within(0.0, 100.0, "m")] | None = setting(
        None, "m", "distance of the frame's origin from a wall that it touches; default: by the contact bodies"
    )
    keep_depth: bool = setting(
        False, "-", "true: points are brought on to the wall at their z; false: to the nearest place on it"
    )
    level: bool = setting(
        True, "-", "true: y of the frame stays level; false: it turns least on the way, from attitude_deg"
    )
    stop: bool = setting(False, "-", "true: stop at each point, with straight lines between them, brought on to it")
    ride: bool = setting(False, "-", "true: the reference moves and turns with the wall")
    approach: Annotated[Number, within(0.0, 100.0, "m")] = setting(
        0.2, "m", "distance before the first point from which it is approached along the normal"
    )
    speed: Positive = setting(0.1, "m/s", "speed along the wall, at its place without motion")
    acceleration: Positive = setting(0.05, "m/s^2", "greatest acceleration along the path, at its ends")
    dwell: Positive = setting(5.0, "s", "time at the first point before the path along the wall begins")
    start_time: Time = setting(1.0, "s", "time at which the approach begins")

    name = "along_surface"

    def surface(self, scenario: ScenarioLike) -> Any:
        """The table of the wall. Raises InputError if there is none."""
        walls = {f"walls[{i}]": wall for i, wall in enumerate(scenario.walls)}
        if self.wall in walls:
            return walls[self.wall]
        if self.wall == "wall":
            wrong = "along_surface follows a wall of [[walls]]; along_wall follows [wall]"
        else:
            wrong = f"{self.wall!r} is none of the scenario's [[walls]]: {', '.join(walls) or 'there is none'}"
        raise InputError([Fault("reference.wall", wrong)], "scenario")

    def way_of(self, scenario: ScenarioLike) -> Way:
        """The path at the wall at its place without motion."""
        record, wall = np.zeros(1, SURFACE), self.surface(scenario)
        wall.place(record[0])
        reach = self._reach(scenario)
        away = reach + (self.distance or 0.0) if self.push is None else reach - self._depth(scenario, wall)
        size = SHAPES[wall.shape].size
        if size is not None and away < -0.5 * size(wall.size):
            raise InputError(
                [Fault("reference.distance", f"{away:.4g} m from the face is in the middle of the wall")], "scenario"
            )
        return _way(record.tobytes(), away, *self._shape)

    @property
    def _shape(self) -> tuple[Any, ...]:
        """What the way along a wall follows from, beside the wall and the distance."""
        return self.points, self.keep_depth, self.level, self.stop, self.attitude_deg

    def _reach(self, scenario: ScenarioLike) -> float:
        """The distance of the frame's origin from a wall that it touches [m]; 0 where it is not known."""
        if self.reach is not None:
            return self.reach
        record = np.zeros(1, SURFACE)
        self.surface(scenario).place(record[0])
        bodies = self._bodies(scenario)
        reach = _reach(record.tobytes(), self._shape, bodies)
        if bodies and reach <= 0.0:
            where = f"the first one touches {self.wall} where B's origin is {-reach:.4g} m behind the face"
            wrong = f"{where}: x of the vehicle looks at it; give a body in front"
            raise InputError([Fault("vehicle.contact_bodies", wrong)], "scenario")
        return reach

    def _bodies(self, scenario: ScenarioLike) -> tuple[tuple[Any, Any, float], ...]:
        """The ends in B and the radius of each contact body; none if the frame of the task does not carry them all."""
        bodies = scenario.vehicle.contact_bodies
        if scenario.task.frame != BODY or any(body.body is not None for body in bodies):
            return ()
        return tuple((body.position, body.end or body.position, body.radius) for body in bodies)

    def _depth(self, scenario: ScenarioLike, wall: Any) -> float:
        """The depth of the push [m]."""
        impedance, bodies = scenario.impedance, scenario.vehicle.contact_bodies
        K_d, K_f, F_d = (np.array(a)[0] for a in (impedance.K_d, impedance.K_f, impedance.F_d))
        if K_d == 0.0:
            return 0.0
        bumper = bodies[0] if bodies else scenario.bumper
        per_k = 1.0 / wall.stiffness + (1.0 / bumper.stiffness if bumper.stiffness else 0.0)
        assert self.push is not None
        return self.push * (K_f / K_d + per_k) + K_f / K_d * F_d

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The constants of :func:`.spline.follow`, and of the motion of the wall."""
        wall, way, initial = self.surface(setup.scenario), self.way_of(setup.scenario), setup.initial
        before = way.legs[0][0].copy()
        before[:3] += self.approach * way.normal
        start = np.concatenate([initial.position, quat_from_euler_deg(*initial.attitude_deg)])
        numbers = [start, before, way.legs[0][0]]
        timing = (tuple(map(tuple, numbers)), self.start_time, self.speed, self.acceleration, self.dwell)
        found, arrival = _motion(way, timing)
        found = dict(found) | {"ride": self.ride, "leave": self.start_time, "arrive": arrival}
        moved, turned = np.zeros((_ROWS, 7)), np.zeros((_ROWS, 7))
        counts = (0, 0)
        if self.ride:
            rows = dict(zip((key for key, _ in setup.contacts.walls), setup.swells, strict=True))[self.wall]
            counts = tuple(map(len, rows))
            moved[: counts[0]], turned[: counts[1]] = rows
        return found | {
            "pivot": wall.position if wall.pivot is None else wall.pivot,
            "amplitude_W": wall.amplitude,
            "frequency": wall.frequency_hz,
            "phase": math.radians(wall.phase_deg),
            "turn_W": tuple(np.radians(wall.turn_amplitude_deg).tolist()),
            "turn_frequency": wall.turn_frequency_hz,
            "turn_phase": math.radians(wall.turn_phase_deg),
            "swell": moved.reshape(-1),
            "swell_rows": counts[0],
            "tilt": turned.reshape(-1),
            "tilt_rows": counts[1],
        }

    def rest_pose(self, scenario: ScenarioLike) -> tuple[tuple[float, ...] | None, tuple[float, ...]]:
        from scipy.spatial.transform import Rotation  # most runs start without SciPy

        last = self.way_of(scenario).legs[-1][-1]
        w, x, y, z = last[3:]
        attitude_deg = tuple(Rotation.from_quat([x, y, z, w]).as_euler("ZYX", degrees=True)[::-1].tolist())
        rides = self.ride and self.surface(scenario).moves
        return None if rides else tuple(last[:3].tolist()), attitude_deg

    def faults(self, setup: SetupLike) -> Iterable[Fault]:
        scenario, key = setup.scenario, "reference"
        wall, bodies = self.surface(scenario), scenario.vehicle.contact_bodies
        if self.reach is None and not self._bodies(scenario):
            which = f"the sphere about the origin of {scenario.task.frame} has {setup.plant.probe.radius:.6g} m"
            if bodies:
                which = "it follows from contact bodies on the base for task.frame = 'body' alone"
            yield Fault(f"{key}.reach", f"give the distance of the frame's origin from a wall that it touches: {which}")
        if self.push is not None and self.distance is not None:
            yield Fault(f"{key}.push", "and reference.distance are given; choose one")
        elif self.push is not None and (len(bodies) > 1 or not wall.linear or wall.layer_depth is not None):
            wrong = "is known for one contact body and a wall of one spring; give reference.distance and impedance.F_d"
            yield Fault(f"{key}.push", wrong)
        if self.ride and not wall.moves:
            yield Fault(f"{key}.ride", f"has no effect: {self.wall} does not move")
        elif self.ride and wall.motion:
            wrong = f"{self.wall}.motion is linear between its rows, and its velocity jumps; take a sine, or waves"
            yield Fault(f"{key}.ride", wrong)
        if self.level and any(self.attitude_deg):
            yield Fault(f"{key}.attitude_deg", "has no effect: x is along the wall's normal, and y is level")

    def notes(self, setup: SetupLike) -> Iterable[str]:
        yield from start_notes(self, setup)
        begins, duration = self.constants(setup)["begins"], setup.scenario.simulation.duration
        if (ends := float(begins[np.isfinite(begins)].max())) > duration:
            yield f"the way of the reference ends at {ends:.4g} s, after the run, which ends at {duration:g} s"
        surface, normal, way = self._record(setup.scenario), np.zeros(3), self.way_of(setup.scenario)
        first, start = way.legs[0][0][:3], np.array(setup.initial.position)
        least = min(
            signed_distance(surface, start + x * (first + self.approach * way.normal - start), normal)
            for x in np.linspace(0.0, 1.0, 101)
        )
        if least < min(way.away, way.away + self.approach) - 1e-6 and least < signed_distance(surface, start, normal):
            yield (
                f"the way to reference.points[0] leads to {least:.4g} m from the face of {self.wall}, nearer than the "
                "path: begin before the first point, or give points around the wall"
            )

    def _record(self, scenario: ScenarioLike) -> Any:
        """The SURFACE record of the wall at its place without motion."""
        record = np.zeros(1, SURFACE)
        self.surface(scenario).place(record[0])
        return record_of(record)

    @staticmethod
    def step(settings, state, given, state_dot, out):
        follow(settings.begins, settings.coefficients, given.t, out)
        if settings.ride:
            x = 1.0
            share = np.array([1.0, 0.0, 0.0])
            if given.t < settings.arrive:
                length = settings.arrive - settings.leave
                x = max(0.0, given.t - settings.leave) / length
                share[0] = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
                share[1] = 30.0 * x * x * (1.0 - x) * (1.0 - x) / length
                share[2] = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (length * length)
            u, v, a = np.zeros(3), np.zeros(3), np.zeros(3)
            add_sine(settings.amplitude_W, settings.frequency, settings.phase, given.t, u, v, a)
            add_waves(settings.swell, 0, int(settings.swell_rows), given.t, u, v, a)
            theta, rate, growth = np.zeros(3), np.zeros(3), np.zeros(3)
            add_sine(settings.turn_W, settings.turn_frequency, settings.turn_phase, given.t, theta, rate, growth)
            add_waves(settings.tilt, 0, int(settings.tilt_rows), given.t, theta, rate, growth)
            a[:] = share[0] * a + 2.0 * share[1] * v + share[2] * u
            v[:] = share[0] * v + share[1] * u
            growth[:] = share[0] * growth + 2.0 * share[1] * rate + share[2] * theta
            rate[:] = share[0] * rate + share[1] * theta
            u *= share[0]
            theta *= share[0]
            Q, Q_dot, Q_ddot, R = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros((3, 3))
            quaternion_of(theta, rate, growth, Q, Q_dot, Q_ddot)
            rotation(Q, R)
            omega, alpha = 2.0 * turning(Q_dot, Q), 2.0 * turning(Q_ddot, Q)
            r, along, turned = R @ (out.p_d - settings.pivot), R @ out.p_d_dot, R @ out.omega_d
            swept = np.cross(omega, r)
            out.p_d[:] = settings.pivot + r + u
            out.p_d_dot[:] = v + swept + along
            out.p_d_ddot[:] = (
                a + np.cross(alpha, r) + np.cross(omega, swept) + 2.0 * np.cross(omega, along) + R @ out.p_d_ddot
            )
            multiply(Q, out.quat_d, out.quat_d)
            out.omega_d[:] = omega + turned
            out.omega_d_dot[:] = alpha + R @ out.omega_d_dot + np.cross(omega, turned)


@dataclass(frozen=True, eq=False)
class Way:
    """A path at a wall at its place without motion.

    Attributes:
        surface: the wall's SURFACE record.
        away: distance of the frame's origin from the face [m].
        legs: (n, 7) poses along each leg; of a path of one point, one pose.
        normal: (3,) out of the wall at the first point.
    """

    surface: bytes
    away: float
    legs: tuple[np.ndarray, ...]
    normal: np.ndarray


@functools.lru_cache(maxsize=16)
def _way(
    surface: bytes,
    away: float,
    points: tuple[tuple[float, ...], ...],
    keep_depth: bool,
    level: bool,
    stop: bool,
    attitude_deg: tuple[float, ...],
) -> Way:
    """The poses of the frame along a path. Raises InputError where the wall does not allow it."""
    wall = record_of(np.frombuffer(bytearray(surface), SURFACE))
    given, n, radius = np.array(points, float), np.zeros(3), max(abs(away), 0.02)
    if (size := tuple(SHAPES.values())[wall.kind].size) is not None:
        radius = max(abs(size(wall.extent) + away), 0.02)
        inside = [signed_distance(wall, point.copy(), n) < -0.5 * size(wall.extent) for point in given]
        if any(inside):
            where = f"reference.points[{inside.index(True)}]"
            raise InputError([Fault(where, "is in the middle of the wall: give a point next to its face")], "scenario")
    normals, frames = list[np.ndarray](), list[np.ndarray]()
    legs, R = list[np.ndarray](), None
    stops = range(len(points)) if stop else (0, len(points) - 1)
    for first, last in itertools.pairwise(stops) if len(points) > 1 else [(0, 0)]:
        carried = given[first : last + 1]
        if len(carried) > 1:
            chords = np.linalg.norm(np.diff(carried, axis=0), axis=1)
            if (chords < SHORTEST).any():
                i = first + int(np.argmax(chords < SHORTEST)) + 1
                raise InputError([Fault(f"reference.points[{i}]", "is the point before it")], "scenario")
            knots = np.concatenate([[0.0], np.cumsum(chords)])
            count = min(_MOST_SAMPLES, max(_SAMPLES * len(chords), math.ceil(_A_RADIUS * knots[-1] / radius)))
            carried = through(carried, knots)(np.linspace(0.0, knots[-1], count + 1))
        normals, poses = [], np.zeros((len(carried), 7))
        for k, start in enumerate(carried):
            p = start.copy()
            where = f"reference.points[{min(last, first + round(k * (last - first) / max(1, len(carried) - 1)))}]"
            _bring(wall, p, n, away, keep_depth, where)
            if normals and float(n @ normals[-1]) < math.cos(math.radians(_SIDES)):
                wrong = "the wall has an edge, or another side, on the way to it: stop before, or give points between"
                raise InputError([Fault(f"reference.points[{last}]", wrong)], "scenario")
            normals.append(n.copy())
            R = _frame(-n, R, level, attitude_deg, where)
            poses[k, :3] = p
            poses[k, 3:] = poses[k - 1, 3:] if k else (frames[-1] if frames else 0.0)
            attitude(R, poses[k, 3:])
        frames.append(poses[-1, 3:].copy())
        legs.append(poses)
    _bring(wall, p := given[0].copy(), n, away, keep_depth, "reference.points[0]")
    return Way(surface, away, tuple(legs), n.copy())


def _bring(wall: Any, p: np.ndarray, n: np.ndarray, away: float, keep_depth: bool, where: str) -> None:
    """Bring p (3,) to a distance from a wall, and set the normal n (3,) there."""
    for _ in range(60):
        off = signed_distance(wall, p, n) - away
        if abs(off) <= _EXACT * max(1.0, float(np.abs(p).max())):
            return
        step = n.copy()
        if keep_depth:
            step[2] = 0.0
            if (size := float(step @ step)) < _LEVEL**2:
                wrong = "the wall is level there, so that its depth can't be kept; take keep_depth = false"
                raise InputError([Fault(where, wrong)], "scenario")
            step /= size
        p -= off * step
    raise InputError([Fault(where, "is not brought on to the wall: give a point next to its face")], "scenario")


def _frame(x: np.ndarray, before: np.ndarray | None, level: bool, attitude_deg: Any, where: str) -> np.ndarray:
    """The attitude (3, 3) with an axis x (3,): with a level y, or by the smallest turn of the attitude before."""
    if level:
        y = np.array([-x[1], x[0], 0.0])
        if (size := float(np.linalg.norm(y))) < _LEVEL:
            wrong = (
                "the wall's normal is vertical there, so that no y of the frame is the level one; take level = false"
            )
            raise InputError([Fault(where, wrong)], "scenario")
        y /= size
        return np.stack([x, y, np.cross(x, y)], axis=1)
    R = rotation_matrix(quat_from_euler_deg(*attitude_deg)) if before is None else before
    axis, cosine = np.cross(R[:, 0], x), float(R[:, 0] @ x)
    if cosine < -0.999:
        wrong = "x of reference.attitude_deg looks out of the wall: give one that looks at it"
        raise InputError([Fault("reference.attitude_deg", wrong)], "scenario")
    S = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    turned = (np.eye(3) + S + S @ S / (1.0 + cosine)) @ R
    turned[:, 0] = x  # so that rounding does not add up
    turned[:, 1] -= (x @ turned[:, 1]) * x
    turned[:, 1] /= np.linalg.norm(turned[:, 1])
    turned[:, 2] = np.cross(x, turned[:, 1])
    return turned


@functools.lru_cache(maxsize=16)
def _reach(surface: bytes, shape: tuple[Any, ...], bodies: tuple[tuple[Any, Any, float], ...]) -> float:
    """The distance of B's origin from the face at the first point at which the first contact body touches [m]. It
    falls to it: no body comes nearer to a wall by more than the origin moves."""
    if not bodies:
        return 0.0
    points, keep_depth, level, _, attitude_deg = shape
    wall, n, reach = record_of(np.frombuffer(bytearray(surface), SURFACE)), np.zeros(3), 0.0
    for first, last, radius in bodies:
        reach = max(reach, radius + max(float(np.linalg.norm(first)), float(np.linalg.norm(last))))
    distances = np.zeros(len(bodies))
    for _ in range(200):
        p = np.array(points[0], float)
        _bring(wall, p, n, reach, keep_depth, "reference.points[0]")
        R = _frame(-n, None, level, attitude_deg, "reference.points[0]")
        for k, (first, last, radius) in enumerate(bodies):
            a, b = p + R @ np.array(first), p + R @ np.array(last)
            ends = [a, b]
            if first != last and math.isfinite(part := nearest_on_segment(wall, a, b)):
                ends.append(a + part * (b - a))
            distances[k] = min(signed_distance(wall, end, np.zeros(3)) for end in ends) - radius
        nearest = float(distances.min())
        reach -= nearest
        if abs(nearest) < 1e-14:
            break
    return reach


@functools.lru_cache(maxsize=8)
def _motion(way: Way, timing: tuple[Any, ...]) -> tuple[dict[str, np.ndarray], float]:
    """The constants of :func:`.spline.follow`, and the time at which the reference is at the wall [s]. ``timing`` has
    the poses of the start, of the place before the first point and of the first point, the time at which the start is
    left, the speed, the acceleration and the dwell."""
    given, t, V, a, dwell = timing
    Q, parts, stops = np.array(given), list[Any](), [list(given[0])]
    for k in range(1, 3):  # without a leg of no length
        if np.linalg.norm(Q[k, :3] - stops[-1][:3]) >= SHORTEST:
            stops.append(list(Q[k]))
    arrival = t
    for first, last in itertools.pairwise(stops):
        pair = np.array([first, last])
        pair[1, 3:] *= math.copysign(1.0, pair[0, 3:] @ pair[1, 3:])
        turn = math.degrees(2.0 * math.acos(min(1.0, float(pair[0, 3:] @ pair[1, 3:]))))
        if turn > LARGEST_TURN_DEG:
            wrong = f"the frame is turned by {turn:.4g} deg at the start; at most {LARGEST_TURN_DEG:g} deg are allowed"
            raise InputError([Fault("initial.attitude_deg", f"{wrong}: begin with x towards the wall")], "scenario")
        ends = np.array([0.0, float(np.linalg.norm(pair[1, :3] - pair[0, :3]))])
        parts.append(leg(through(pair, ends), ends[1], t, V, a, 1))
        t = float(parts[-1].x[-1])
        arrival = t if len(parts) == 1 else arrival
    t += dwell
    legs = [each for each in way.legs if len(each) > 1]
    room = (MOST_SEGMENTS - 2 * (2 * RAMP + 2)) // max(1, len(legs)) - 1
    ramp = min(_MOST_RAMP, room // 3)
    if legs and ramp < RAMP:
        most = (MOST_SEGMENTS - 2 * (2 * RAMP + 2)) // (3 * RAMP + 1)
        wrong = f"has {len(legs)} legs with stops; at most {most} are allowed: take stop = false, or fewer points"
        raise InputError([Fault("reference.points", wrong)], "scenario")
    for poses in legs:
        if parts:  # the sign of the attitude goes on
            sign = 1.0 if float(poses[0, 3:] @ parts[-1](parts[-1].x[-1])[3:]) >= 0.0 else -1.0
            poses = np.hstack([poses[:, :3], sign * poses[:, 3:]])
        part = _on_surface(way, poses, (t, V, a, room - 2 * ramp, ramp))
        t = float(part.x[-1]) + MOMENT
        parts.append(part)
    if not parts:
        raise InputError([Fault("reference.points[0]", "is where the reference begins: there is no way")], "scenario")
    return pack(parts), arrival


def _on_surface(way: Way, poses: np.ndarray, timing: tuple[float, float, float, int, int]) -> PPoly:
    """A leg through poses (n, 7) on a wall, which stays on it between them. Raises InputError if it does not."""
    from scipy.interpolate import make_interp_spline

    steps = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    if steps.min() < 1e-9:
        raise InputError([Fault("reference.points", "two of them are one place on the wall")], "scenario")
    knots = np.concatenate([[0.0], np.cumsum(steps)])
    part = leg(make_interp_spline(knots, poses, k=5), float(knots[-1]), *timing)
    wall, n = record_of(np.frombuffer(bytearray(way.surface), SURFACE)), np.zeros(3)
    for pose in part(0.5 * (part.x[1:] + part.x[:-1])):
        off = abs(signed_distance(wall, pose[:3], n) - way.away)
        x = rotation_matrix(pose[3:] / np.linalg.norm(pose[3:]))[:, 0]
        if off > _CLOSE or float(np.linalg.norm(x + n)) > _ALONG:
            wrong = f"the path would leave the wall's shape by {off:.2g} m at {np.round(pose[:3], 3).tolist()}"
            raise InputError(
                [Fault("reference.points", f"{wrong}, at an edge or a bend: stop before it, or take more points")],
                "scenario",
            )
    return part
