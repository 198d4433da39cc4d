"""A control law with a closed form: impedance control with integral action on the residual of the impedance.

uvms-mj run --controller examples/integral_impedance.py:IntegralImpedance --set controller.k_i=3
"""

from dataclasses import dataclass

from uvms_mj import Controller, gain
from uvms_mj.quantities import Positive


@dataclass(frozen=True)
class IntegralImpedance(Controller):
    """Impedance control with integral action on the residual of eq. (6), for F_d = 0 and K_f = 1."""

    k_i: Positive = gain(2.0, "1/s", "integral gain")

    states = {"e": 6}
    units = {"e": "N s, N m s"}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        residual = signals.K_d * signals.eta_e + signals.D_d @ signals.nu_e - signals.tau_contact_m_B
        state_dot.e[:] = residual
        tau_cmd[:] = signals.tau_nom - gains.k_i * state.e

    def at_rest(self, setup):
        """The pushing force at rest [N], with perfect sensing. The state e is constant at rest, so that the residual is
        zero: K_x (x_d - x) = F, with the wall's spring F = k_c (x - x_c)."""
        reference, wall = setup.scenario.reference, setup.scenario.wall
        p_d = reference.rests_at()
        if p_d is None or any(reference.attitude_deg):
            return "the formula is for a reference that comes to rest with its attitude along W"
        K_x = setup.scenario.impedance.K_d[0]
        return max(0.0, K_x * (p_d[0] - wall.position) / (1.0 + K_x / wall.stiffness))
