"""template_name: a control law.

uvms-mj run --controller template_name.py:TemplateName --set controller.k_p=300
uvms-mj controllers template_name.py:TemplateName      its gains as the program reads them
uvms-mj signals                                        all signals that a law is given
"""

from dataclasses import dataclass

from uvms_mj import Controller, gain
from uvms_mj.quantities import NonNegative, Positive


@dataclass(frozen=True)
class TemplateName(Controller):
    """PID about the reference, with compensation of gravity and buoyancy."""

    # gains: default, unit, meaning; --set controller.k_p=300 changes one
    k_p: Positive = gain(200.0, "N/m, N m", "stiffness")
    k_d: Positive = gain(150.0, "N s/m, N m s", "damping")
    k_i: NonNegative = gain(10.0, "N/(m s), N m/s", "integral gain")

    # states are zero at the start, advance by state_dot, and are recorded under their names
    states = {"xi": 6}
    units = {"xi": "m s, s"}

    uses_task = False  # True for a law that uses s, z or zeta of the impedance task

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        # this function is compiled: numbers, arrays and loops; it fills all six entries of tau_cmd, in B [N, N m]
        for i in range(6):
            state_dot.xi[i] = signals.eta_e[i]
            tau_cmd[i] = (
                signals.g_hat[i] - gains.k_p * signals.eta_e[i] - gains.k_d * signals.nu_e[i] - gains.k_i * state.xi[i]
            )

    # A closed form of the force at rest, if there is one, is compared with each run:
    # def at_rest(self, setup):
    #     return force_in_newtons  # or a text that says why there is none
