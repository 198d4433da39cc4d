"""template_name: a reference.

uvms-mj run --set reference.name=template_name.py:TemplateName --set reference.amplitude=0.2
uvms-mj stages reference template_name.py:TemplateName      its settings as the program reads them
uvms-mj signals                                             all signals that a reference is given and sets
"""

import math
from dataclasses import dataclass

from uvms_mj import Guidance, setting
from uvms_mj.guidance import hold
from uvms_mj.quantities import NonNegative


@dataclass(frozen=True)
class TemplateName(Guidance):
    """From rest, to and fro along y about the position of the first instant."""

    # settings: default, unit, meaning
    amplitude: float = setting(0.1, "m", "amplitude")
    omega: NonNegative = setting(0.5, "rad/s", "angular frequency")

    # states are zero at the start and recorded under their names
    states = {"origin": 3}
    units = {"origin": "m"}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        hold(settings, given, out)  # fills every output: rest, with the attitude of reference.attitude_deg
        if given.instant == 0:
            state.origin[:] = given.p_WB
        amplitude, omega = settings.amplitude, settings.omega
        out.p_d[1] = state.origin[1] + amplitude * (1.0 - math.cos(omega * given.t))
        # the law feeds these forward: they must be the derivatives of p_d
        out.p_d_dot[1] = amplitude * omega * math.sin(omega * given.t)
        out.p_d_ddot[1] = amplitude * omega**2 * math.cos(omega * given.t)
