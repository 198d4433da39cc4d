"""A sensor: the contact force with a constant bias and white noise. Everything else is measured perfectly.

uvms-mj run --set navigation.name=examples/biased_force.py:BiasedForce --set navigation.noise=0.1
"""

from dataclasses import dataclass

from uvms_mj import Navigation, setting
from uvms_mj.navigation import perfect
from uvms_mj.physics.random import standard_normal


@dataclass(frozen=True)
class BiasedForce(Navigation):
    """A force sensor at B's origin with a bias and noise, both in B."""

    bias: tuple[float, float, float] = setting((0.3, 0.0, 0.0), "N", "bias of the force in B")
    noise: float = setting(0.0, "N", "standard deviation of each component at each instant")

    states = {"force_error": 3}
    units = {"force_error": "N"}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        perfect(given, out)
        for i in range(3):
            state.force_error[i] = settings.bias[i] + settings.noise * standard_normal(given.key, given.instant, i)
            out.tau_contact_m_B[i] += state.force_error[i]
        out.f_contact_m_W += given.R_WB @ state.force_error


if __name__ == "__main__":
    from dataclasses import replace

    from uvms_mj import Scenario, simulate

    trace = simulate(replace(Scenario.load("push_wall"), navigation=BiasedForce(bias=(0.5, 0.0, 0.0), noise=0.1)))
    print(f"push {trace.push[-1]:.3f} N, measured {-trace.f_contact_m_W[-1, 0]:.3f} N")
    force_figure = trace.plot("force", width=6.5)
    force_error_figure = trace.between(19.98, 20.0).plot("force_error", width=6.5)
