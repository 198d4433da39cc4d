"""A control law with a closed form: two springs in a row.

uvms-mj run --controller examples/pd.py:Pd --set controller.k_p=300 --set current.speed=0
"""

from dataclasses import dataclass

from uvms_mj import Controller, gain
from uvms_mj.quantities import Positive


@dataclass(frozen=True)
class Pd(Controller):
    """PD about the reference, with compensation of gravity and buoyancy."""

    k_p: Positive = gain(200.0, "N/m, N m", "stiffness")
    k_d: Positive = gain(150.0, "N s/m, N m s", "damping")

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            tau_cmd[i] = signals.g_hat[i] - gains.k_p * signals.eta_e[i] - gains.k_d * signals.nu_e[i]

    def at_rest(self, setup):
        """The pushing force at rest [N]: k_p (x_d - x) = k_c (x - x_c)."""
        scenario = setup.scenario
        if scenario.current.speed > 0.0:
            return "the current pushes a PD law off the reference"
        p_d = scenario.reference.rests_at()
        if p_d is None:
            return "the reference does not come to rest"
        distance = p_d[0] - scenario.wall.position
        return max(0.0, self.k_p * distance / (1.0 + self.k_p / scenario.wall.stiffness))
