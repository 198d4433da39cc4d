"""A vehicle with joints in waves: each link has the water at its own place, as the independent twin says."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from random_trees import load_tree, place_tree, random_state, random_tree, tree_acceleration, water_of_tree
from tree_twin import acceleration
from twin import rotation
from uvms_mj import InputError, Scenario, Sea, attach, simulate
from uvms_mj.control.base import NoClosedForm
from uvms_mj.plant.sea import wave_number

DEPTH, SURFACE = 9.0, 4.0
SEA = Sea(height=0.8, period=2.2, direction_deg=35.0, depth=DEPTH, surface=SURFACE)


def airy(p, t):
    """The velocity (3,) of the water of SEA, from the equations in the books, also at a complex place and time; above
    the surface it is that at the surface."""
    omega = 2.0 * math.pi / SEA.period
    k = wave_number(omega, 9.81, DEPTH)
    e = np.array([math.cos(math.radians(35.0)), math.sin(math.radians(35.0)), 0.0])
    z = p[2] if p[2].real < SURFACE else SURFACE
    theta, up, scale = k * (e @ p) - omega * t, k * (z - SURFACE + DEPTH), 0.5 * SEA.height * omega
    along, heave = np.cosh(up) * np.cos(theta), np.sinh(up) * np.sin(theta)
    return scale / math.sinh(k * DEPTH) * (along * e + heave * np.array([0.0, 0.0, 1.0]))


def accelerations(seed, joints, sea=SEA, waves=airy):
    """Of a random tree in a random state by the engine and by the twin, each (6 + n,)."""
    tree = replace(random_tree(seed, joints), waves=waves)
    state, rng = random_state(tree, seed), np.random.default_rng(seed)
    tau, t = rng.normal(size=6 + joints) * 10.0, float(rng.uniform(0, 10))
    model, data = load_tree(tree)
    place_tree(data, state)
    data.time, data.ctrl[:] = t, tau
    with attach(model, data, "rov", sea=sea, **water_of_tree(tree)):
        mujoco.mj_forward(model, data)
    p, quat, q, zeta = state
    return tree_acceleration(data, joints), acceleration(tree, rotation(quat), q, zeta, tau, t, p)


@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 3, 9]))
def test_the_acceleration_of_a_random_tree_in_waves_is_the_twins(seed, joints):
    found, expected = accelerations(seed, joints)
    assert np.linalg.norm(found - expected) <= 1e-9 * np.linalg.norm(expected)


def test_an_arm_feels_its_own_phase():
    """With the water at B on all links, the twin is wrong by far more than that."""
    tree = random_tree(3, 3)
    p = random_state(tree, 3)[0]

    def of_B(place, t):
        # of the place of the base on a path: the rate and the acceleration are those there
        return airy(np.real(p) + 1j * np.imag(place), t)

    found, expected = accelerations(3, 3)
    _, coarse = accelerations(3, 3, waves=of_B)
    assert np.linalg.norm(found - expected) < 1e-9 * np.linalg.norm(expected)
    assert np.linalg.norm(found - coarse) > 1e-2 * np.linalg.norm(expected)


WAVES = {"vehicle.model": "bluerov2_alpha5", "simulation.duration": 0.3, "sea.height": 0.4, "sea.period": 2.5}


def test_a_run_with_an_arm_goes_on_in_waves():
    over = {"simulation.duration": 1.0, "sea.height": 0.4, "sea.period": 2.5}
    scenario = Scenario.load("tool_push", over)
    waved, calm = (simulate(scenario.updated({"sea.height": height})) for height in (0.4, 0.0))
    assert np.abs(waved.tau_q - calm.tau_q).max() > 1e-2
    assert np.ptp(waved.v_c_W, axis=0).max() > 0.05
    assert isinstance(waved.analytic, NoClosedForm)
    assert "waves" in waved.analytic.reason


def test_what_has_the_water_of_the_base_at_a_link_is_refused():
    site = {"wrist.name": "sensor", "wrist.site": "jaws"}
    with pytest.raises(InputError, match="wrist's sensor has the water"):
        simulate(Scenario.load("push_wall", WAVES | site))
