"""A reference: a horizontal circle through the start.

uvms-mj run --set reference.name=examples/circle.py:Circle --set wall.position=5
"""

import math
from dataclasses import dataclass

from uvms_mj import Guidance, setting
from uvms_mj.guidance import station_keep
from uvms_mj.quantities import Positive


@dataclass(frozen=True)
class Circle(Guidance):
    """A horizontal circle from rest at the position of the first instant. Its centre is in the direction of y."""

    radius: float = setting(0.5, "m", "radius")
    omega: float = setting(0.2, "rad/s", "angular velocity about z")
    rise: Positive = setting(1.0, "s", "time constant of the angular velocity, which starts at zero")

    states = {"centre": 3}
    units = {"centre": "m"}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        station_keep(settings, given, out)
        radius, omega = settings.radius, settings.omega
        if given.instant == 0:
            state.centre[:] = given.p_WB
            state.centre[1] += radius
        missing = math.exp(-given.t / settings.rise)
        angle = omega * (given.t - settings.rise * (1.0 - missing))
        rate, acceleration = omega * (1.0 - missing), omega * missing / settings.rise
        sine, cosine = math.sin(angle), math.cos(angle)
        out.p_d[0] = state.centre[0] + radius * sine
        out.p_d[1] = state.centre[1] - radius * cosine
        out.p_d_dot[0], out.p_d_dot[1] = radius * rate * cosine, radius * rate * sine
        out.p_d_ddot[0] = radius * (acceleration * cosine - rate**2 * sine)
        out.p_d_ddot[1] = radius * (acceleration * sine + rate**2 * cosine)


if __name__ == "__main__":
    from dataclasses import replace

    from uvms_mj import Scenario, simulate

    scenario = replace(Scenario.load("push_wall", {"wall.position": 5.0}), reference=Circle())
    trace = simulate(scenario)
    position_figure = trace.plot("position", width=6.5)
    error_figure = trace.plot("eta_e", width=6.5)
