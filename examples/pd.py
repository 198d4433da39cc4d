"""PD about the reference, with compensation of gravity and buoyancy, and its closed form in still water.

uvms-mj run --controller examples/pd.py:Pd current.speed=0
"""

from dataclasses import dataclass

from uvms_mj import Controller, gain


@dataclass(frozen=True)
class Pd(Controller):
    """PD about the reference, with compensation of gravity and buoyancy."""

    k_p: float = gain(200.0, "N/m, N m", "stiffness")
    k_d: float = gain(150.0, "N s/m, N m s", "damping")

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            tau_cmd[i] = signals.g_hat[i] - gains.k_p * signals.eta_e[i] - gains.k_d * signals.nu_e[i]

    def at_rest(self, setup):
        """Two springs in a row: k_p (x_d - x) = k_c (x - x_c)."""
        scenario = setup.scenario
        if scenario.current.speed > 0.0:
            return "the current pushes a PD law off the reference"
        distance = scenario.reference.target[0] - scenario.wall.position
        return max(0.0, self.k_p * distance / (1.0 + self.k_p / scenario.wall.stiffness))
