r"""Ways along a wall of any shape: poses at a distance from it, with x along the inward normal.

**Geometry.** All points at the distance s from a wall are a surface of their own, d(p) = s with the signed distance d
(:mod:`..physics.surfaces`). Points are brought on to it, and the curve through them, or the straight line between two
of them, is brought on to it again: along the normal n = grad d, or, to keep the depth, along the horizontal part of it,

.. math::

    p \leftarrow p - (d(p) - s)\, n, \qquad p \leftarrow p - \frac{d(p) - s}{|n_h|^2}\, n_h.

The first is exact at once, the second is Newton's method. The frame's x is -n. Its y is level, or the frame turns from
place to place by the smallest turn. Both curves, of position and attitude, are the quintic splines through many
such places, and are followed by their arc length at a constant speed, as any path (:mod:`.path`).

**Edges.** Outside of a box the surface d = s is flat beside the faces, a cylinder of the radius s about each edge and a
sphere about each corner. Where one begins, the curvature jumps, and at a constant speed the angular velocity would jump
by V/s. So the way stops there: a leg ends where the place leaves a part of the surface (:func:`_part`).
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import Fault, InputError
from ..physics.frames import attitude, quat_from_euler_deg, rotation_matrix
from ..physics.kernels import record_of
from ..physics.surfaces import BOX, CAPSULE, SHAPES, SURFACE, nearest_on_segment, signed_distance
from .path import MOMENT, RAMP, SHORTEST, leg, through
from .spline import LARGEST_TURN_DEG, MOST_SEGMENTS, pack

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

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
_BESIDE = 1e-9
"""Distance from a joint of two parts of a surface at which a place is on the joint [m]."""


@dataclass(frozen=True, eq=False)
class Way:
    """A path at a wall at its place without motion.

    Attributes:
        surface: the wall's SURFACE record.
        away: distance of the frame's origin from the face [m].
        legs: (n, 7) poses along each leg; of a path of one point, one pose.
        normal: (3,) out of the wall at the first point.
        edged: whether it goes over an edge of a box.
    """

    surface: bytes
    away: float
    legs: tuple[np.ndarray, ...]
    normal: np.ndarray
    edged: bool


@functools.lru_cache(maxsize=16)
def way_along(
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
    brought = given.copy()
    for i, place in enumerate(brought):
        _bring(wall, place, n, away, keep_depth, f"reference.points[{i}]")
    normal: np.ndarray | None = None
    legs, R, quat = list[np.ndarray](), None, np.zeros(4)
    stops = range(len(points)) if stop else (0, len(points) - 1)
    for first, last in itertools.pairwise(stops) if len(points) > 1 else [(0, 0)]:
        chords = np.linalg.norm(np.diff(brought[first : last + 1], axis=0), axis=1)
        if (chords < SHORTEST).any():
            i = first + int(np.argmax(chords < SHORTEST)) + 1
            wrong = "is the point before it, or both are one place on the wall"
            raise InputError([Fault(f"reference.points[{i}]", wrong)], "scenario")
        line = _Line(wall, away, keep_depth, first, brought[first : last + 1], np.append(0.0, np.cumsum(chords)), n)
        length, count = float(line.knots[-1]), 0
        if len(chords):
            count = min(_MOST_SAMPLES, max(_SAMPLES * len(chords), math.ceil(_A_RADIUS * length / radius)))
        for begin, end in line.parts(count):
            here = max(_SAMPLES, math.ceil(count * (end - begin) / length)) if count else 0
            poses = np.zeros((here + 1, 7))
            for pose, u in zip(poses, np.linspace(begin, end, here + 1).tolist(), strict=True):
                pose[:3], where = line.at(u), line.key(u)
                if normal is not None and float(n @ normal) < math.cos(math.radians(_SIDES)):
                    wrong = (
                        "the line to it leads through the wall, to another side of it: give points between; at an edge "
                        "one next to it on each side, in front of which the frame's origin is, or stop before it"
                    )
                    raise InputError([Fault(where, wrong)], "scenario")
                normal = n.copy()
                R = _frame(-n, R, level, attitude_deg, where)
                attitude(R, quat)  # of q and -q the one nearer to the last
                pose[3:] = quat
            legs.append(poses)
    _bring(wall, brought[0].copy(), n, away, keep_depth, "reference.points[0]")
    edged = wall.kind == BOX and any(sum(map(bool, _part(wall, pose[:3]))) > 1 for leg in legs for pose in leg)
    return Way(surface, away, tuple(legs), n.copy(), edged)


@dataclass(frozen=True, eq=False)
class _Line:
    """The curve, or the straight line, through places at a wall, by the length of the chords between them (n,).

    Attributes:
        first: index of the first place among the reference's points.
        n: (3,) memory for the normal, which :meth:`at` sets.
    """

    wall: Any
    away: float
    keep_depth: bool
    first: int
    places: np.ndarray
    knots: np.ndarray
    n: np.ndarray

    @functools.cached_property
    def _curve(self) -> Any:
        return through(self.places, self.knots)

    def at(self, u: float) -> np.ndarray:
        """The place (3,) at the wall."""
        p = self.places[0].copy() if len(self.places) == 1 else np.array(self._curve(u))
        _bring(self.wall, p, self.n, self.away, self.keep_depth, self.key(u))
        return p

    def key(self, u: float) -> str:
        """The key of the point that the way leads to."""
        return f"reference.points[{self.first + int(np.searchsorted(self.knots, u * (1.0 - 1e-12)))}]"

    def parts(self, count: int) -> Iterator[tuple[float, float]]:
        """The stretches that lie on one part of the surface each, found between ``count`` + 1 places."""
        begin, end = 0.0, float(self.knots[-1])
        for low, high in itertools.pairwise(np.linspace(0.0, end, count + 1).tolist()):
            before = _part(self.wall, self.at(low))
            if before == _part(self.wall, self.at(high)):
                continue
            while low < (middle := 0.5 * (low + high)) < high:
                low, high = (middle, high) if _part(self.wall, self.at(middle)) == before else (low, middle)
            if min(high - begin, end - high) > SHORTEST:
                yield begin, low
                begin = high
        yield begin, end


def _part(wall: Any, p: np.ndarray) -> tuple[bool, ...]:
    """The part of a wall's surface that a place p (3,) is on, of which the curvature is continuous: of a box a face, an
    edge or a corner, by the axes along which p is outside of it; of a capsule its middle or an end."""
    q = wall.R_WS.T @ (p - wall.p_WS)
    if wall.kind == BOX:
        return tuple(((np.abs(q) > wall.extent + _BESIDE) * np.sign(q)).tolist())
    if wall.kind == CAPSULE:
        return (abs(q[2]) > wall.extent[1] + _BESIDE,)
    return ()


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
def reach_of(surface: bytes, shape: tuple[Any, ...], bodies: tuple[tuple[Any, Any, float], ...]) -> float:
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
def motion_on(way: Way, timing: tuple[Any, ...]) -> tuple[dict[str, np.ndarray], float]:
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
