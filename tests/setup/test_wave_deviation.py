"""The push's standard deviation in waves: the sampled loop's answer to the wrench of the sea on a held vehicle, against
runs, and both parts by themselves."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from uvms_mj import Scenario, Sea, Simulation, simulate
from uvms_mj.analysis.summary import summary
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.control.theory.waves import sea_rate, sea_wrenches
from uvms_mj.setup import linear_loop
from uvms_mj.setup.base import set_up
from uvms_mj.setup.linear_loop import Deviations, deviations

PRESSING = {
    "vehicle.model": "bluerov2_heavy",
    "initial.position": [0.97, 0.0, 0.0],
    "reference.target": [1.0, 0.0, 0.0],
    "reference.step_time": 0.0,
    "impedance.F_d": [-20.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    "wall.stiffness": 2e4,
    "wall.damping": 100.0,
    "simulation.timestep": 1e-3,
    "simulation.duration": 620.0,
    "current.speed": 0.0,
    "controller.period": 0.005,
    "sea.surface": 1.0,
    "sea.depth": 2.0,
    "sea.period": 5.0,
}


def setup_of(settings, law="impedance"):
    return set_up(Scenario.load("push_wall", PRESSING | settings, law))


@pytest.mark.parametrize("law", ["impedance", "admittance", "dob_impedance"])
@pytest.mark.parametrize(("spectrum", "height"), [("regular", 0.2), ("jonswap", 0.1), ("jonswap", 0.4)])
def test_the_announced_deviation_is_the_runs(law, spectrum, height):
    """Over ten minutes of a spectrum, or twenty periods of a regular wave."""
    if law == "impedance" and height == 0.4:
        height = 0.2  # it is thrown off the wall by more
    settings = {"sea.height": height, "sea.spectrum": spectrum}
    settings |= {"simulation.duration": 120.0} if spectrum == "regular" else {}
    found = deviations(setup_of(settings, law))
    assert isinstance(found, Deviations), found
    trace = simulate(Scenario.load("push_wall", PRESSING | settings, law), engine="free_body", log_rate=50.0)
    settled = trace.t > 20.0
    assert trace.push[settled].std() == pytest.approx(found.push, rel=0.02)
    assert trace.tau[settled, 0].std() == pytest.approx(found.tau[0], rel=0.02)


def test_oblique_waves_and_a_current_with_noise_of_a_sensor():
    """The wave's share and the noise's add up as variances; the drag is that of current and waves together."""
    noise = {"navigation.name": "sensors", "navigation.force_noise": 0.2, "navigation.pressure_depth": False}
    waves = {"sea.height": 0.15, "sea.spectrum": "jonswap", "sea.direction_deg": 50.0, "current.speed": 0.2}
    both, alone = (deviations(setup_of(each, "admittance")) for each in (noise | waves, waves))
    quiet = deviations(setup_of(noise | {"current.speed": 0.2}, "admittance"))
    assert both.push == pytest.approx(np.hypot(alone.push, quiet.push), rel=1e-6)
    assert min(alone.push, quiet.push) > 0.2 * both.push
    run = Scenario.load("push_wall", PRESSING | noise | waves, "admittance")
    trace = simulate(run, engine="free_body", log_rate=50.0)
    assert trace.push[trace.t > 20.0].std() == pytest.approx(both.push, rel=0.03)


@pytest.mark.parametrize(("law", "height"), [("impedance", 0.03), ("admittance", 0.1)])
def test_a_depth_by_pressure_moves_the_vehicle_up_and_down(law, height):
    """In waves along the wall, a depth sensor of 20 Hz: the law follows the pressure in it."""
    here = {"sea.height": height, "sea.spectrum": "jonswap", "sea.direction_deg": 90.0, "navigation.name": "sensors"}
    here |= {"navigation.position_period": 0.05, "navigation.position_delay": 0.01}
    found, without = (deviations(setup_of(here | {"navigation.pressure_depth": each}, law)) for each in (True, False))
    assert isinstance(found, Deviations), found
    assert found.position[2] > 10.0 * without.position[2]
    trace = simulate(Scenario.load("push_wall", PRESSING | here, law), engine="free_body", log_rate=50.0)
    assert trace.p_WB[trace.t > 20.0, 2].std() == pytest.approx(found.position[2], rel=5e-3)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_wrench_of_the_sea_is_what_the_engine_adds_to_a_vehicle_at_rest(seed):
    here = {"initial.attitude_deg": [10.0, -20.0, 30.0], "initial.velocity": [0.0] * 6, "simulation.duration": 1.0}
    here |= {"sea.spectrum": "jonswap", "sea.spreading": 2.0, "sea.seed": seed, "current.speed": 0.3}
    here |= {"wall.present": False, "tether.length": 5.0}
    nu_dot, tau = [], []
    for height in (0.4, 1e-9):
        with Simulation(Scenario.load("push_wall", PRESSING | here | {"sea.height": height, "controller.period": 1e-3},
                                      "external"), engine="free_body") as sim:  # fmt: skip
            setup, R_WB = sim.setup, sim.signals.R_WB.copy()
            position = np.array(setup.initial.position)
            calm = set_up(dataclasses.replace(setup.scenario, sea=Sea()))
            tau.append(sea_wrenches(setup, position, R_WB, calm.mean_water.flow, np.zeros(1))[0])
            sim.step()
            nu_dot.append(sim.signals.nu_dot.copy())
    added = setup.vehicle.M @ (nu_dot[0] - nu_dot[1])
    assert np.abs(added).min() > 1e-3
    assert np.allclose(tau[0] - tau[1], added, rtol=0.0, atol=1e-9)


def test_answers_to_all_frequencies_are_the_covariance_of_white_noise():
    """Parseval: a wrench that is white from step to step has the same power at all frequencies of the circle."""
    setup = setup_of({"controller.period": 0.004, "simulation.timestep": 2e-3})
    rest = steady_state(setup)
    vehicle = linear_loop.RestingVehicle(setup, rest)
    known = setup.scenario.navigation.rest_errors(setup)(vehicle.position, vehicle.quat, vehicle.contact(np.zeros(12)))
    law = linear_loop.LinearLaw.of(linear_loop.RestingLaw(setup, rest, known))
    channels = dict.fromkeys(linear_loop._PLACES, linear_loop.Channel())
    loop = linear_loop._Loop(setup, vehicle, law, channels)
    found = [[np.hsplit(each, [loop.size, loop.size + 18]) for each in loop.at(k)] for k in range(loop.steps)]
    assert loop.steps == 2
    (A_0, _, B_0), (A_1, _, B_1) = (each[0] for each in found)
    phi = A_1 @ A_0
    expected = solve_discrete_lyapunov(phi, A_1 @ B_0 @ B_0.T @ A_1.T + B_1 @ B_1.T)
    m = 4096
    omega = 2.0 * np.pi / (m * loop.h) * np.arange(m)
    state = [np.eye(loop.size, loop.size + 7)] * loop.steps
    before, between = loop._answers(omega, np.broadcast_to(np.eye(7) / m, (m, 7, 7)), found, phi, state)
    assert np.allclose(before, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())
    assert np.allclose(between, A_0 @ expected @ A_0.T + B_0 @ B_0.T, rtol=0.0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("law", "settings", "reason"),
    [
        ("gsta", {}, "gsta is not smooth at its rest"),
        ("admittance", {"thrusters.name": "t200"}, "the noise's way through"),
        ("impedance", {"sea.height": 0.4}, "would lose contact at times"),
        ("ideal", {}, "the law is told the truth"),
        ("admittance", {"navigation.name": "ekf"}, "the way through ekf is not known"),
        ("impedance", {"current.amplitude": [0.1, 0.0, 0.0], "current.frequency_hz": [0.1, 0.0, 0.0]}, "current"),
    ],
)
def test_where_it_is_not_announced_a_sentence_says_why(law, settings, reason):
    found = deviations(setup_of({"sea.height": 0.1, "sea.spectrum": "jonswap"} | settings, law))
    assert isinstance(found, str)
    assert reason in found


def test_the_summary_has_both_deviations():
    settings = PRESSING | {"sea.height": 0.2, "simulation.duration": 60.0}
    report = summary(simulate(Scenario.load("push_wall", settings, "admittance"), engine="free_body"), {})
    assert report["noise"]["none_because"] is None
    assert report["noise"]["push_N"] == pytest.approx(report["noise"]["analytic_N"], rel=0.02)


def test_super_twisting_is_held_to_the_rate_of_the_waves():
    """In long waves of small height nothing but inertia acts, and its rate is a omega^3 times (rho V + A)/M; the note
    is given where k_2/2 is less."""
    settings = {"sea.height": 1e-3, "sea.period": 4.0, "sea.depth": None, "sea.surface": 2.0}
    setup = setup_of(settings, "gsta")
    vehicle, omega = setup.vehicle, 2.0 * np.pi / 4.0
    k = omega**2 / float(np.linalg.norm(setup.gravity_W))
    u = 0.5e-3 * omega * np.exp(-2.0 * k)
    force = np.hypot((vehicle.displaced_mass + vehicle.M_A[0, 0]) * omega, vehicle.D_linear[0, 0])
    expected = force * u * omega / setup.design.M_hat[0, 0]
    assert sea_rate(setup)[0] == pytest.approx(expected, rel=0.01)
    for k_2, noted in ((2.2, False), (1.8, True)):
        largest = float(sea_rate(setup).max())
        scenario = setup.scenario.updated({"controller.k_2": k_2 * largest})
        notes = list(scenario.controller.notes(set_up(scenario)))
        assert any("faster than k_2/2" in note for note in notes) == noted


@pytest.mark.parametrize("case", range(4))
def test_drawn_seas_vehicles_and_gains_are_announced_within_a_tenth(case):
    """Spectra in any depth and direction, at a wall that throws them back or not, with a tether's drag and a model that
    is wrong; walls of springs and of Hertz."""
    random = np.random.default_rng(case)
    law, vehicle = ("impedance", "admittance", "dob_impedance")[case % 3], ("bluerov1", "bluerov2_heavy")[case % 2]
    settings = {
        "vehicle.model": vehicle,
        "impedance.F_d": [-random.uniform(15.0, 35.0), 0.0, 0.0, 0.0, 0.0, 0.0],
        "impedance.K_d": [*random.uniform(50.0, 500.0, 3).tolist(), *random.uniform(20.0, 100.0, 3).tolist()],
        "impedance.damping_ratio": random.uniform(0.6, 1.4),
        "estimates.inertia": random.uniform(0.8, 1.2),
        "tether.length": random.uniform(0.0, 15.0),
        "current.speed": random.uniform(0.0, 0.2),
        "current.direction_deg": random.uniform(-180.0, 180.0),
        "sea.spectrum": "jonswap",
        "sea.height": random.uniform(0.05, 0.15) * (0.3 if law == "impedance" else 1.0),
        "sea.period": random.uniform(3.0, 8.0),
        "sea.direction_deg": random.uniform(-180.0, 180.0),
        "sea.surface": random.uniform(1.5, 4.0),
        "sea.depth": random.uniform(5.0, 15.0),
        "sea.spreading": 4.0,
        "sea.reflecting": bool(case % 4 == 0),
        "sea.seed": case,
    }
    if case % 4 == 3:
        reach = set_up(Scenario.load("push_wall", {"vehicle.model": vehicle})).plant.probe.radius
        wall = {"shape": "plane", "position": [1.0 + reach, 0.0, 0.0], "contact": "hertz", "modulus": 1e5}
        settings |= {"wall.present": False, "walls": [wall | {"restitution": 0.6}]}
    else:
        settings |= {"wall.stiffness": 10.0 ** random.uniform(3.5, 4.6)}
    base = {key: value for key, value in PRESSING.items() if not (case % 4 == 3 and key.startswith("wall."))}
    scenario = Scenario.load("push_wall", base | settings, law)
    found = deviations(set_up(scenario))
    assert isinstance(found, Deviations), found
    trace = simulate(scenario, engine="free_body", log_rate=50.0)
    assert trace.push[trace.t > 20.0].std() == pytest.approx(found.push, rel=0.1)
