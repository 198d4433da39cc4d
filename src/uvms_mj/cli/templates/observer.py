"""template_name: an observer of the contact force, for a vehicle without a force sensor.

uvms-mj run --set observer.name=template_name.py:TemplateName --set current.speed=0 --set wall.stiffness=2e3
uvms-mj stages observer template_name.py:TemplateName      its settings as the program reads them
uvms-mj signals                                            all signals that an observer is given and sets
"""

from dataclasses import dataclass

from uvms_mj import setting
from uvms_mj.navigation import Observer
from uvms_mj.quantities import Positive


@dataclass(frozen=True)
class TemplateName(Observer):
    """The wrench that the controller's model does not explain, behind a first-order lag, without an acceleration."""

    # settings: default, unit, meaning
    time_constant: Positive = setting(0.02, "s", "T of the lag of the estimated wrench")

    # states are zero at the start, advance by state_dot, and are recorded under their names
    states = {"integral": 6}
    units = {"integral": "N s, N m s"}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        # this function is compiled: numbers, arrays and loops; it fills the contact force in both frames
        for i in range(6):
            momentum = 0.0
            for j in range(6):
                momentum += given.M_hat[i, j] * given.nu[j]
            if given.instant == 0:
                state.integral[i] = momentum
            residual = (momentum - state.integral[i]) / settings.time_constant
            explained = given.tau_hat[i] - given.C_hat_nu[i] - given.D_hat_nu[i] - given.g_hat[i]
            state_dot.integral[i] = explained + residual
            out.tau_contact_m_B[i] = residual
        for i in range(3):
            out.f_contact_m_W[i] = 0.0
            for j in range(3):
                out.f_contact_m_W[i] += given.R_WB[i, j] * out.tau_contact_m_B[j]
