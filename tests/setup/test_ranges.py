"""Extreme quantities are refused by name before a run, and a run's overflow names its keys."""

import re

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, simulate
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import checked, no_overflow, wall_faults

SHORT = {"simulation.duration": 0.005}


def refused(overrides, match):
    with pytest.raises(InputError, match=match):
        simulate(Scenario.load("push_wall", SHORT | overrides))


@pytest.mark.parametrize(("frequency", "acts_as"), [(5000.0, "5000 Hz"), (9999.0, "1 Hz"), (10000.0, "0 Hz")])
def test_a_disturbance_that_the_time_step_would_alias_is_refused(frequency, acts_as):
    refused({"disturbance.frequency_hz": [0.0, 0.0, frequency, 0.0, 0.0, 0.0]}, rf"frequency_hz\[2\].*act as {acts_as}")
    t = 1e-4 * np.arange(1000)
    aliased = float(acts_as.split()[0])
    assert np.allclose(np.abs(np.sin(2 * np.pi * frequency * t)), np.abs(np.sin(2 * np.pi * aliased * t)), atol=1e-9)


def test_a_disturbance_below_half_the_step_rate_runs():
    overrides = {"disturbance.frequency_hz": [4999.0] * 6, "disturbance.amplitude": [1.0] * 6}
    assert simulate(Scenario.load("push_wall", SHORT | overrides)).status.name == "completed"
    refused({"disturbance.frequency_hz": [-1.0] + [0.0] * 5}, r"must be from 0 to 1e\+07 Hz")


def test_an_error_names_the_number_of_the_wall_that_is_too_large_for_the_step():
    """The stability limit of symplectic Euler is h^2 k/m + 2 h b/m < 4."""
    setup = set_up(Scenario())
    h, m = 1e-4, setup.design.along_normal(setup.design.M)

    def found(k, b):
        wall = Scenario.load("push_wall", {"wall.stiffness": k, "wall.damping": b})
        return list(wall_faults(set_up(wall)))

    for k, b in [(1.0, 1e9), (1e5, 2.6e5), (5.2e9, 0.0), (2e9, 1.7e5), (1e5, 2.5e5), (5.1e9, 0.0)]:
        assert (h * h * k + 2.0 * h * b >= 4.0 * m) == bool(found(k, b))
    (fault,) = found(1e5, 1e9)
    assert fault.key == "wall.damping"
    assert "choose less than 2.562e+05 N s/m" in fault.message
    (fault,) = found(1e10, 0.0)
    assert fault.key == "wall.stiffness"
    assert "choose less than 5.124e+09 N/m" in fault.message


def test_the_lightest_contact_of_a_wall_decides_whether_the_step_is_short_enough():
    """A body far from the centre turns the vehicle, and is lighter at the wall, in whichever order they are given."""
    stiff = {"wall.present": False, "walls": [{"shape": "plane", "position": [1.5, 0.0, 0.0], "stiffness": 1e10}]}
    near, far = ({"position": place, "radius": 0.03} for place in ([0.2, 0.0, 0.0], [0.2, 0.5, 0.4]))

    def mass(*bodies):
        with pytest.raises(InputError) as refusal:
            checked(Scenario.load("push_wall", stiff | {"vehicle.contact_bodies": list(bodies)}))
        return float(re.search(r"([\d.]+) kg at the contact", str(refusal.value))[1])

    assert mass(far) < 0.9 * mass(near)
    assert mass(near, far) == mass(far, near) == mass(far)


def test_an_overflow_names_the_keys_with_extreme_numbers():
    refused({"impedance.M_d": [1e-300, 1.0, 1.0, 1.0, 1.0, 1.0]}, r"impedance\.M_d\[0\]: 1e-300 is too small")
    with pytest.raises(InputError, match="no finite result"), no_overflow(Scenario()):
        np.linalg.inv(np.zeros((2, 2)))
