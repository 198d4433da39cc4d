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

    uses_task = False  # the law uses neither s nor zeta

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            tau_cmd[i] = signals.g_hat[i] - gains.k_p * signals.eta_e[i] - gains.k_d * signals.nu_e[i]

    def at_rest(self, setup):
        """The pushing force at rest [N]: k_p (x_d - x) + d = k_c (x - x_c), with the constant force d along x."""
        scenario, wall, disturbance = setup.scenario, setup.scenario.wall, setup.scenario.disturbance
        p_d = scenario.reference.rests_at()
        exclusions = {
            "the reference does not come to rest": p_d is None,
            "the reference is not aligned with the wall": any(scenario.reference.attitude_deg),
            "the current pushes a PD law off the reference": scenario.current.flows,
            "the disturbance is not constant": not disturbance.steady,
            "the disturbance turns the vehicle": any(disturbance.bias[3:]),
            "with friction, the rest position depends on the path": wall.friction > 0.0,
            "the law gets other measurements than the true ones": scenario.navigation.name != "perfect",
            "the thrusters may not produce what the law commands": scenario.actuation.name != "pseudo_inverse",
        }
        for reason, holds in exclusions.items():
            if holds:
                return reason
        pull = self.k_p * (p_d[0] - wall.position) + disturbance.bias[0]
        return max(0.0, pull / (1.0 + self.k_p / wall.stiffness))
