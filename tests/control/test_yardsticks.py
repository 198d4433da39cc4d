"""The yardsticks that have a law's structure and are told the truth."""

import numpy as np
import pytest

from uvms_mj import Scenario, simulate

STILL = {"current.speed": 0.0, "impedance.F_d": [-1.5, 0.0, 0.0, 0.0, 0.0, 0.0], "simulation.duration": 8.0}


def ran(law, settings):
    return simulate(Scenario.load("push_wall", settings, law), engine="free_body")


@pytest.mark.parametrize("law", ["admittance", "parallel"])
def test_where_the_estimates_are_true_the_yardstick_is_the_law(law):
    """Still water and the vehicle of the file: eqs. (13) and (23) demand the same wrench, by two ways."""
    one, other = ran(law, STILL), ran(f"ideal_{law}", STILL)
    assert other.push.max() > 1.0
    np.testing.assert_allclose(other.tau_cmd, one.tau_cmd, atol=1e-7 * np.abs(one.tau_cmd).max())


def test_without_its_integral_the_parallel_yardstick_is_ideal():
    """In a current, with another vehicle than the file's."""
    settings = {"vehicle.added_mass": 1.5, "vehicle.quadratic_damping": 0.7, "simulation.duration": 8.0}
    one, other = ran("ideal", settings), ran("ideal_parallel", settings | {"controller.k_i": 0.0})
    assert other.push.max() > 1.0
    np.testing.assert_allclose(other.tau_cmd, one.tau_cmd, atol=1e-7 * np.abs(one.tau_cmd).max())


def test_the_admittance_yardstick_needs_no_integral_against_a_current():
    """A PD loop of the pose gives way to the current's drag by drag / (M k_p); with the drag known it does not."""
    settings = {"controller.k_i": 0.0, "reference.target": [0.5, 0.0, 0.0], "simulation.duration": 12.0}
    law, told = (ran(name, settings).eta_e[-1, :3] for name in ("admittance", "ideal_admittance"))
    assert np.linalg.norm(law) > 1e-4
    assert np.linalg.norm(told) < 1e-3 * np.linalg.norm(law)
