r"""A circle at a constant speed, which it reaches smoothly from rest.

With the angle :math:`\varphi` and the unit vectors a, b of the plane, :math:`p_d = c + R (a \cos\varphi + b
\sin\varphi)`. The angular rate rises over the time T as :math:`\Omega (3 x^2 - 2 x^3)`, x = t/T, so that
the acceleration is continuous, and falls in the same way before the last turn is complete.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ..physics.frames import multiply, quat_from_euler_deg, rotation_matrix
from ..physics.kernels import kernel
from ..quantities import Angle, Angles, Number, Position, Positive, Time, within
from ..stages.base import setting
from .base import Guidance, start_notes


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

    def constants(self, setup: Any) -> Mapping[str, Any]:
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

    def rest_pose(self, scenario: Any) -> tuple[tuple[float, ...] | None, tuple[float, ...]]:
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

    def notes(self, setup: Any) -> Iterable[str]:
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
    multiply(w, s * axis[0], s * axis[1], s * axis[2], quat[0], quat[1], quat[2], quat[3], 0, out)
