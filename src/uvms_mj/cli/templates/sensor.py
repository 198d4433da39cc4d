"""template_name: a sensor.

uvms-mj run --set navigation.name=template_name.py:TemplateName --set navigation.noise=0.005
uvms-mj stages navigation template_name.py:TemplateName      its settings as the program reads them
uvms-mj signals                                              all signals that a sensor is given and sets
"""

from dataclasses import dataclass

from uvms_mj import Navigation, setting
from uvms_mj.navigation import perfect
from uvms_mj.physics.random import standard_normal
from uvms_mj.quantities import NonNegative


@dataclass(frozen=True)
class TemplateName(Navigation):
    """Linear velocity with white noise. Everything else is measured perfectly."""

    # settings: default, unit, meaning
    noise: NonNegative = setting(0.002, "m/s", "standard deviation of each component at each instant")

    # states are zero at the start and recorded under their names
    states = {"velocity_error": 3}
    units = {"velocity_error": "m/s"}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        perfect(given, out)  # fills every output with the truth
        for i in range(3):
            # the seed, the stage, the instant and the last argument decide the random number
            state.velocity_error[i] = settings.noise * standard_normal(given.key, given.instant, i)
            out.nu[i] += state.velocity_error[i]
