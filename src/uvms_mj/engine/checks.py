"""The check of a whole scenario before its first step; :mod:`.changes` has that of a reset."""

from ..control.design import no_overflow
from ..plant.mjcf import Mjcf
from ..scenario import Scenario
from ..setup.base import Setup, set_up
from ..setup.checks import refuse
from ..stages.loader import check_stage


def checked(scenario: Scenario, mjcf: Mjcf | None = None) -> Setup:
    """Check a scenario and its stages, and build its plant and its design. The arguments are those of
    :func:`uvms_mj.setup.base.set_up`. Raises InputError if the scenario cannot run."""
    for stage in scenario.stages:
        check_stage(stage)
    with no_overflow(scenario):
        setup = set_up(scenario, mjcf)
        refuse(setup)
    return setup
