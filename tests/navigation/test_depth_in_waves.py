"""The depth by a pressure sensor in waves, against the dynamic pressure of linear theory in its usual form."""

import math

import numpy as np
import pytest

import uvms_mj.engine.native.compilation  # noqa: F401  # machine code for called_on
from uvms_mj import Scenario, Sea, Simulation, simulate
from uvms_mj.physics.kernels import called_on, kernel
from uvms_mj.physics.waves import WAVE, add_waves
from uvms_mj.plant.sea import spectral_density, wave_number
from uvms_mj.plant.settings import Situation
from uvms_mj.setup.base import set_up

REGULAR = {
    "sea.height": 0.3,
    "sea.period": 3.0,
    "sea.depth": 6.0,
    "sea.surface": 2.0,
    "sea.direction_deg": 25.0,
    "initial.position": [0.4, 0.2, 0.1],
    "simulation.duration": 4.0,
    "controller.name": "impedance",
}
QUIET = {"navigation.depth_noise": 1e-10, "navigation.depth_period": 0.005, "navigation.imu_period": 0.005}
ENGINES = pytest.mark.parametrize("engine", ["free_body", "mujoco"])


def head(over, t, p, g, face=None):
    """p_dyn / (rho g) at times (n,) and places (n, 3), by cosh k(z + d) / cosh k d."""
    omega, d = 2.0 * math.pi / over["sea.period"], over["sea.depth"]
    k, angle = wave_number(omega, g, d), math.radians(over["sea.direction_deg"])
    along, across = math.cos(angle) * p[:, 0], math.sin(angle) * p[:, 1]
    a = 0.5 * over["sea.height"] * np.cosh(k * (p[:, 2] - over["sea.surface"] + d)) / math.cosh(k * d)
    found = np.cos(k * (along + across) - omega * t)
    if face is not None:  # the wave that begins at the image of the same place behind the wall, at x = 2 face - x
        found = found + np.cos(k * (math.cos(angle) * (2.0 * face - p[:, 0]) + across) - omega * t)
    return a * found


def gravity_and_face(over):
    setup = set_up(Scenario.load("push_wall", over))
    return float(np.linalg.norm(setup.gravity_W)), setup.scenario.wall.position + setup.plant.probe.radius


@ENGINES
@pytest.mark.parametrize("reflecting", [False, True])
def test_the_measured_depth_has_the_pressure_of_the_waves(engine, reflecting):
    """Amplitude and phase at once: at all instants, along the way of the vehicle."""
    over = REGULAR | {"sea.reflecting": reflecting, "navigation.name": "sensors"}
    trace = simulate(Scenario.load("push_wall", over), engine=engine)
    g, face = gravity_and_face(over)
    expected = head(over, trace.t, trace.p_WB, g, face if reflecting else None)
    assert np.ptp(expected) > 0.1
    np.testing.assert_allclose(trace.p_WB[:, 2] - trace.p_WB_m[:, 2], expected, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(trace.p_WB_m[:, :2], trace.p_WB[:, :2], rtol=0.0, atol=0.0)
    np.testing.assert_allclose(trace.wave_head, expected, rtol=0.0, atol=1e-9)


@ENGINES
def test_the_filter_measures_the_same_depth_and_follows_it(engine):
    over = REGULAR | {"navigation.name": "ekf"} | QUIET
    with Simulation(Scenario.load("push_wall", over), engine=engine) as sim:
        (g, _), depth = gravity_and_face(over), sim._stages.stages["navigation"].state["depth"][0]
        for _ in range(40):
            sim.step(50)
            p = sim.memory.run["true"]["p_WB"][0].copy()
            expected = p[2] - head(over, np.array([sim.t]), p[None], g)[0]
            assert depth[0] == pytest.approx(expected, abs=1e-9)


def test_a_depth_that_is_not_by_pressure_has_no_waves_in_it():
    over = REGULAR | {"navigation.name": "sensors", "navigation.pressure_depth": False}
    trace = simulate(Scenario.load("push_wall", over), engine="free_body")
    assert np.ptp(trace.wave_head) > 0.1
    assert trace.p_WB_m.tobytes() == trace.p_WB.tobytes()


def test_still_water_has_no_head():
    over = {"navigation.name": "sensors", "simulation.duration": 1.0}
    trace = simulate(Scenario.load("push_wall", over), engine="free_body")
    assert "wave_head" not in trace.arrays
    assert trace.p_WB_m.tobytes() == trace.p_WB.tobytes()


@kernel
def head_at(waves, instants, found):
    """The pressure head (n,) at times and places (n, 4)."""
    for i in range(instants.shape[0]):
        found[i] = add_waves(waves, instants[i, 0], instants[i, 1:], np.zeros(3), np.zeros(3), np.zeros((3, 3)))


def test_irregular_waves_give_a_held_sensor_the_deviation_of_their_spectrum():
    """sigma^2 is the integral of S (cosh k(z + d) / cosh k d)^2; over so long a time and ten seeds a mean variance
    scatters by about a hundredth."""
    height, period, d, z, g = 0.5, 4.0, 10.0, -1.5, 9.81
    omega = np.linspace(0.3, 8.0, 4001) * 2.0 * math.pi / period
    k = np.array([wave_number(each, g, d) for each in omega])
    ratio = np.exp(k * z) * (1.0 + np.exp(-2.0 * k * (z + d))) / (1.0 + np.exp(-2.0 * k * d))
    expected = np.trapezoid(spectral_density(omega, height, period, 3.3) * ratio**2, omega)
    instants = np.array([(t, 0.7, -0.2, z) for t in np.arange(0.0, 3600.0, 0.25)])
    variances = []
    for seed in range(10):
        sea = Sea(height=height, period=period, depth=d, surface=0.0, spectrum="jonswap", components=200)
        waves, found = np.array(sea.records(Situation(seed, g)), WAVE), np.zeros(len(instants))
        called_on(head_at, waves, instants, found)()
        variances.append(found.var())
    assert np.std(variances) < 0.05 * expected
    assert np.mean(variances) == pytest.approx(expected, rel=0.02)
