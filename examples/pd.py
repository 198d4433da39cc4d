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
        if setup.no_simple_form:  # more acts than the probe at [wall], a current and a constant disturbance
            return setup.no_simple_form
        scenario, wall = setup.scenario, setup.scenario.wall
        if scenario.current.flows:
            return "the current pushes a PD law off the reference"
        if any(scenario.disturbance.bias[3:]):
            return "the disturbance turns the vehicle"
        p_d, _ = setup.rest_pose
        pull = self.k_p * (p_d[0] - wall.position) + scenario.disturbance.bias[0]
        return max(0.0, pull / (1.0 + self.k_p / wall.stiffness))


if __name__ == "__main__":
    from uvms_mj import Scenario, simulate

    trace = simulate(Scenario.load("push_wall", {"current.speed": 0.0}), controller=Pd(k_p=300.0))
    print(f"push {trace.push[-1]:.6f} N, closed form {trace.analytic.force:.6f} N")
    force_figure = trace.plot("force", width=6.5)
    position_figure = trace.plot("position", width=6.5)
