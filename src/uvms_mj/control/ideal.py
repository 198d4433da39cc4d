"""The ideal law: a yardstick that no vehicle can have, for it knows the current and the disturbance."""

from dataclasses import dataclass
from typing import ClassVar

from .base import Controller

TOLD_THE_TRUTH = "the truth, current and disturbance included: a yardstick, no vehicle's law"
"""What any output says of it."""


@dataclass(frozen=True)
class Ideal(Controller):
    """Ideal impedance control (13), the yardstick: it uses the truth, current and disturbance included."""

    name = "ideal"
    uses_truth: ClassVar[bool] = True

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            tau_cmd[i] = signals.C_nu_r[i] + signals.D_nu_r[i] + signals.g_eta[i] - signals.tau_dist[i]
            tau_cmd[i] -= signals.tau_contact_m_B[i]
            for j in range(6):  # w has the desired impedance and K_f (tau_c - F_d) in it
                tau_cmd[i] += signals.M[i, j] * (signals.nu_d_dot[j] - signals.nu_c_dot[j] - signals.w[j])
