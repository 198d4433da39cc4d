"""template_name: a thruster model, between the allocation and the vehicle.

uvms-mj run --set thrusters.name=template_name.py:TemplateName --set thrusters.time_constant=0.1
uvms-mj stages thrusters template_name.py:TemplateName      its settings as the program reads them
uvms-mj signals                                             all signals that a thruster model is given
"""

from dataclasses import dataclass

from uvms_mj import setting
from uvms_mj.actuation import Thrusters
from uvms_mj.quantities import NonNegative, Positive


@dataclass(frozen=True)
class TemplateName(Thrusters):
    """A dead band of the command, and a first-order lag."""

    # settings: default, unit, meaning
    dead_band: NonNegative = setting(0.2, "N", "commands up to this give no thrust")
    time_constant: Positive = setting(0.02, "s", "time constant of the lag")

    # states are zero at the start, advance by state_dot, and are recorded; "thrusters" is the number of thrusters
    states = {"thrust": "thrusters"}
    units = {"thrust": "N"}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        # this function is compiled: numbers, arrays and loops; it fills the thrust of each thruster [N]
        for i in range(u.shape[0]):
            u_cmd = given.u_cmd[i]
            if abs(u_cmd) <= settings.dead_band:
                u_cmd = 0.0
            state_dot.thrust[i] = (u_cmd - state.thrust[i]) / settings.time_constant
            u[i] = state.thrust[i]
