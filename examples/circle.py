"""A reference: a horizontal circle through the start.

uvms-mj run --set reference.name=examples/circle.py:Circle --set wall.position=5
"""

import math
from dataclasses import dataclass

from uvms_mj import Guidance, setting
from uvms_mj.guidance import hold


@dataclass(frozen=True)
class Circle(Guidance):
    """A horizontal circle through the position of the first instant. Its centre is in the direction of y."""

    radius: float = setting(0.5, "m", "radius")
    omega: float = setting(0.2, "rad/s", "angular velocity about z")

    states = {"centre": 3}
    units = {"centre": "m"}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        hold(settings, given, out)
        radius, omega = settings.radius, settings.omega
        if given.instant == 0:
            state.centre[:] = given.p_WB
            state.centre[1] += radius
        sine, cosine = math.sin(omega * given.t), math.cos(omega * given.t)
        out.p_d[0] = state.centre[0] + radius * sine
        out.p_d[1] = state.centre[1] - radius * cosine
        out.p_d_dot[0], out.p_d_dot[1] = radius * omega * cosine, radius * omega * sine
        out.p_d_ddot[0], out.p_d_ddot[1] = -radius * omega**2 * sine, radius * omega**2 * cosine
