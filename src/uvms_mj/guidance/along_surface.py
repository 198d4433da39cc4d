r"""Motion along a wall of any shape, at a distance from it, with the axis x of the frame of the task along the inward
normal; and on a wall that moves, with it. :mod:`.surface_way` has the geometry of the way.

**Distance.** The vehicle touches where the frame's origin is at the distance ``reach`` from the wall. With its contact
bodies on the base it follows from them, at the first point.

**Push.** The desired impedance, eq. (7), demands the push F of one spring k_c at the depth of :func:`.path.depth_of`
along x. F_d is in the frame of the task, so the demanded push turns with it: it is along the normal everywhere.

**On a wall that moves** by u(t) and the rotation vector theta(t) about the pivot c, the reference p, R of the wall at
rest becomes :math:`c + Q (p - c) + u` and Q R, Q of theta, with both time derivatives:

.. math::

    \ddot p_d = \ddot u + \dot\omega \times r + \omega \times (\omega \times r) + 2 \omega \times Q \dot p
    + Q \ddot p, \qquad r = Q (p - c).

Until the reference is at the wall, u and theta are multiplied by a factor that rises from 0 to 1 on the way to it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator

from ..errors import Fault, InputError
from ..physics.frames import BODY, multiply, quat_from_euler_deg, rotation, turning
from ..physics.kernels import record_of
from ..physics.surfaces import SHAPES, SURFACE, add_sine, add_waves, quaternion_of, signed_distance
from ..quantities import NonNegative, Number, Position, Positive, Time, within
from ..stages.base import setting
from ..stages.setup import ScenarioLike, SetupLike
from .base import start_notes
from .path import depth_of
from .spline import Followed, follow
from .surface_way import Way, motion_on, reach_of, way_along

MOST_POINTS = 100
_ROWS = 200
"""Rows for the waves that a wall follows: the most components of a sea."""


def _places(points: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    if not 1 <= len(points) <= MOST_POINTS:
        raise ValueError(f"has {len(points)} points; 1 to {MOST_POINTS} are allowed")
    return points


@dataclass(frozen=True)
class AlongSurface(Followed):
    """Along a wall of [[walls]], of any shape: approach, dwell, then a constant-speed path with x along its normal.

    The path is at a distance from the wall, or with a push; with ``ride`` it moves with the wall.
    """

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
        return way_along(record.tobytes(), away, *self._shape)

    @property
    def _shape(self) -> tuple[Any, ...]:
        """The settings of the way along a wall, beside the wall and the distance."""
        return self.points, self.keep_depth, self.level, self.stop, self.attitude_deg

    def _reach(self, scenario: ScenarioLike) -> float:
        """The distance of the frame's origin from a wall that it touches [m]; 0 where it is not known."""
        if self.reach is not None:
            return self.reach
        record = np.zeros(1, SURFACE)
        self.surface(scenario).place(record[0])
        bodies = self._bodies(scenario)
        reach = reach_of(record.tobytes(), self._shape, bodies)
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
        bodies = scenario.vehicle.contact_bodies
        bumper = bodies[0] if bodies else scenario.bumper
        per_k = 1.0 / wall.stiffness + (1.0 / bumper.stiffness if bumper.stiffness else 0.0)
        assert self.push is not None
        return depth_of(self.push, scenario.impedance, np.array([1.0, 0.0, 0.0]), per_k)

    def force_at_rest(self) -> tuple[float, ...] | None:
        return None if self.push is None else (-self.push, 0.0, 0.0)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The constants of :func:`.spline.follow`, and of the motion of the wall."""
        wall, way, initial = self.surface(setup.scenario), self.way_of(setup.scenario), setup.initial
        before = way.legs[0][0].copy()
        before[:3] += self.approach * way.normal
        start = np.concatenate([initial.position, quat_from_euler_deg(*initial.attitude_deg)])
        numbers = [start, before, way.legs[0][0]]
        timing = (tuple(map(tuple, numbers)), self.start_time, self.speed, self.acceleration, self.dwell)
        found, arrival = motion_on(way, timing)
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
        if self.push and way.edged and (bodies := setup.scenario.vehicle.contact_bodies):
            needed, given = self.push / bodies[0].radius, min(setup.scenario.impedance.K_d[1:3])
            if given < needed:
                yield (
                    f"the contact body slips off the edge of {self.wall}: across it a push of {self.push:.4g} N on a "
                    f"radius of {bodies[0].radius:.4g} m has the stiffness {-needed:.4g} N/m, and impedance.K_d has "
                    f"{given:.4g} N/m there: take more of it, less push, or a larger radius"
                )
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
