"""White noise of the sensors: standard deviations of long runs against the discrete Lyapunov equation, within 3 %.

A run of 800 s has some 7000 time constants of the loop, so that the deviation of a run is known to 1 %.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from uvms_mj import Scenario, Simulation, simulate
from uvms_mj.analysis.summary import summary
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.navigation import Perfect
from uvms_mj.setup.base import set_up
from uvms_mj.setup.linear_loop import Deviations, RestingVehicle, deviations

PUSHING = {
    "navigation.name": "sensors",
    "simulation.timestep": 2e-3,
    "simulation.duration": 800.0,
    "wall.stiffness": 2e3,
    "wall.damping": 150.0,
    "reference.target": [1.4, 0.0, 0.0],
    "initial.position": [1.02, 0.0, 0.0],
    "current.speed": 0.1,
    "impedance.M_d": [10.0, 20.0, 20.0, 0.3, 0.3, 0.3],
}
LAYER = {"controller.epsilon": 0.05, "controller.K_s": 8.0}
CUBE = {"vehicle.model": "examples/cube.xml", "current.speed": 0.0, "impedance.M_d": [20.0, 20.0, 20.0, 1.0, 1.0, 1.0]}
FREE = PUSHING | {"wall.position": 50.0, "initial.position": [1.4, 0.0, 0.0]}


BODIES = {"vehicle.contact_bodies": [{"position": [0.2, y, 0.0], "radius": 0.04} for y in (-0.15, 0.1)]}
SIDE = {"shape": "plane", "position": [0.0, 0.35, 0.0], "attitude_deg": [0.0, 0.0, 90.0], "stiffness": 1e3}
CORNER = {"walls": [SIDE | {"damping": 100.0}], "reference.target": [1.4, 0.4, 0.0]}


def setup_of(settings, law="impedance"):
    return set_up(Scenario.load("push_wall", settings, law))


def compared(settings, law="impedance"):
    """The closed form, and the settled rows of a long run."""
    found = deviations(setup_of(settings, law))
    assert isinstance(found, Deviations), found
    trace = simulate(Scenario.load("push_wall", settings, law), engine="free_body", log_rate=100.0)
    settled = trace.t > 20.0
    return found, trace, settled


@pytest.mark.slow
@pytest.mark.parametrize(
    ("quantity", "levels"),
    [("force", (0.2, 5.0)), ("position", (1e-4, 5e-3)), ("velocity", (1e-3, 2e-2))],
)
def test_weak_and_strong_noise_give_the_push_its_deviation(quantity, levels):
    for level in levels:
        found, trace, settled = compared(PUSHING | {f"navigation.{quantity}_noise": level})
        assert trace.push[settled].std() == pytest.approx(found.push, rel=0.03)
        assert trace.p_WB[settled, 0].std() == pytest.approx(found.position[0], rel=0.03)
        assert trace.tau[settled, 0].std() == pytest.approx(found.tau[0], rel=0.03)
        error = 4.0 * found.push * np.sqrt(2.0 * found.slowest / 800.0)
        assert trace.push[settled].mean() == pytest.approx(trace.analytic.force, abs=error)


def test_slow_late_sensors_and_a_slow_law():
    """The loop is periodic in time: 20 ms and 30 ms of the sensors, 10 ms of the law, whose commands take 14 ms, and
    4 ms of the thrusters."""
    settings = {
        "navigation.velocity_noise": 5e-3,
        "navigation.velocity_period": 0.02,
        "navigation.velocity_delay": 0.026,
        "navigation.force_noise": 1.0,
        "navigation.force_period": 0.03,
        "navigation.force_delay": 0.006,
        "controller.period": 0.01,
        "controller.delay": 0.014,
        "actuation.period": 0.004,
    }
    found, trace, settled = compared(PUSHING | settings)
    assert trace.push[settled].std() == pytest.approx(found.push, rel=0.03)
    fast = deviations(setup_of(PUSHING | {name: settings[name] for name in settings if name.endswith("noise")}))
    assert found.push > 2.0 * fast.push


@pytest.mark.slow
def test_every_axis_of_a_vehicle_without_contact():
    settings = {"navigation.position_noise": [0.01, 0.005, 0.002], "navigation.attitude_noise": [0.002, 0.004, 0.006]}
    found, trace, settled = compared(FREE | settings)
    assert found.push == 0.0
    assert np.allclose(trace.p_WB[settled].std(axis=0), found.position, rtol=0.03)
    assert np.allclose(2.0 * trace.quat_WB[settled, 1:].std(axis=0), found.attitude, rtol=0.03)
    assert np.allclose(trace.nu[settled].std(axis=0), found.nu, rtol=0.03)


def test_without_a_wall_the_deviations_are_those_far_away_from_one():
    """A wall that is not there is not touched, wherever its position is; a wall that is there is."""
    noise = {"navigation.position_noise": 1e-3, "navigation.velocity_noise": 1e-3}
    far, absent = (deviations(setup_of(FREE | noise | other)) for other in ({}, {"wall.present": False}))
    beside = deviations(setup_of(FREE | noise | {"wall.present": False, "wall.position": 1.3}))
    x = steady_state(setup_of(FREE | noise)).position[0]
    near, clear = (deviations(setup_of(FREE | noise | {"wall.position": x + k * far.position[0]})) for k in (3.5, 4.5))
    assert near == "the vehicle would touch the wall at times"
    assert clear.push == 0.0
    for found in (absent, beside):
        assert found.push == 0.0
        for name in ("position", "attitude", "nu", "tau"):
            assert np.allclose(getattr(found, name), getattr(far, name), rtol=1e-9, atol=0.0), name


@pytest.mark.slow
@pytest.mark.parametrize("contacts", [BODIES, CORNER])
def test_two_bodies_on_a_wall_and_a_corner_of_two_walls(contacts):
    found, trace, settled = compared(PUSHING | contacts | {"navigation.force_noise": 1.0})
    assert trace.push[settled].std() == pytest.approx(found.push, rel=0.03)
    assert np.allclose(trace.p_WB[settled].std(axis=0), found.position, rtol=0.03)
    assert np.allclose(2.0 * trace.quat_WB[settled, 1:].std(axis=0), found.attitude, rtol=0.03)


def test_a_wall_that_is_not_touched_changes_nothing_until_it_is_near():
    """A second wall beside the vehicle, at multiples of the deviation from its reach."""
    noise = PUSHING | {"navigation.position_noise": 1e-3}
    alone, reach = deviations(setup_of(noise)), setup_of(noise).contacts.pairs[0].radius
    y = steady_state(setup_of(noise)).position[1] + reach
    beside = [{"walls": [SIDE | {"position": [0.0, y + k * alone.position[1], 0.0]}]} for k in (3.5, 4.5)]
    near, clear = (deviations(setup_of(noise | each)) for each in beside)
    assert near == "the vehicle would touch the wall at times"
    assert clear.push == pytest.approx(alone.push, rel=1e-6)


def test_another_law_is_linearised_by_its_own_function():
    settings = PUSHING | {"navigation.force_noise": 1.0, "navigation.velocity_noise": 5e-3}
    found, trace, settled = compared(settings, "admittance")
    assert trace.push[settled].std() == pytest.approx(found.push, rel=0.03)


@pytest.mark.parametrize("law", ["dob_impedance", "pid"])
def test_a_law_that_sets_its_own_states_is_linear_in_what_it_makes_of_them(law):
    """The residual of an observer; an integral that is at its limit at every instant, and acts no more."""
    settings = PUSHING | {"navigation.position_noise": 1e-3, "navigation.velocity_noise": 5e-3}
    found, trace, settled = compared(settings, law)
    assert trace.push[settled].std() == pytest.approx(found.push, rel=0.03)
    assert trace.tau[settled, 0].std() == pytest.approx(found.tau[0], rel=0.03)


def test_fosm_is_linear_inside_its_boundary_layer():
    settings = PUSHING | LAYER | {"navigation.force_noise": 0.5}
    found, trace, settled = compared(settings, "fosm")
    assert trace.push[settled].std() == pytest.approx(found.push, rel=0.03)


def test_the_deviation_is_proportional_to_the_noise_and_variances_add_up():
    one, two = (deviations(setup_of(PUSHING | {"navigation.force_noise": level})) for level in (0.5, 1.0))
    assert two.push == pytest.approx(2.0 * one.push, rel=1e-9)
    other = deviations(setup_of(PUSHING | {"navigation.position_noise": 1e-3}))
    both = deviations(setup_of(PUSHING | {"navigation.position_noise": 1e-3, "navigation.force_noise": 1.0}))
    assert both.push == pytest.approx(np.hypot(two.push, other.push), rel=1e-9)


def test_the_vehicle_about_its_rest_has_the_acceleration_of_the_engine():
    """At a random state in a current with effects of the water, under a disturbance and no thrust."""
    position, nu = [0.1, -0.2, 0.3], [0.3, -0.2, 0.1, 0.4, -0.5, 0.6]
    here = {"initial.position": position, "initial.attitude_deg": [10.0, -20.0, 30.0], "initial.velocity": nu}
    here |= {"tether.length": 5.0, "drag": [{"forward": [20.0, 30.0, 40.0], "position": [0.1, 0.2, -0.3]}]}
    here |= {"current.speed": 0.7, "disturbance.bias": [1.0, -2.0, 0.5, 0.1, -0.2, 0.3], "vehicle.mass": 1.2}
    with Simulation(Scenario.load("push_wall", here, "external"), engine="free_body") as sim:
        rest = SimpleNamespace(position=position, quat=sim.signals.quat_WB.copy(), tau=np.zeros(6), force=0.0)
        expected = RestingVehicle(sim.setup, rest).acceleration(np.array([0.0] * 6 + nu), np.zeros(6))
        sim.step()
        assert np.allclose(sim.signals.nu_dot, expected, rtol=0.0, atol=1e-11)


def test_a_scalar_loop_by_hand():
    """Deep in the wall, x_ddot = -a x - b v - g n with the force noise n, sampled by semi-implicit Euler."""
    h, sigma = 2e-3, 1.0
    still = {
        "current.speed": 0.0,
        "impedance.D_d": [60.0, 280.0, 280.0, 10.0, 8.0, 8.0],
        "navigation.force_noise": sigma,
    }
    setup = setup_of(PUSHING | still)
    M, M_d, D_d, k_c, b_c = 7.31 + 5.5, 10.0, 60.0, 2e3, 150.0
    # M v_dot = M (-w) - tau_c,m + tau_c + (the water's damping is compensated) with tau_c = -(k_c x + b_c v)
    gain = (M / M_d - 1.0) / M
    a, b = (150.0 + k_c) / M_d, (D_d + b_c) / M_d
    A = np.array([[1.0 - h * h * a, h - h * h * b], [-h * a, 1.0 - h * b]])
    G = gain * sigma * np.array([h * h, h])
    P = np.zeros((2, 2))
    for _ in range(20_000):
        P = A @ P @ A.T + np.outer(G, G)
    c = np.array([k_c, b_c])
    assert deviations(setup).push == pytest.approx(np.sqrt(c @ P @ c), rel=1e-3)


@pytest.mark.parametrize(
    ("law", "settings", "reason"),
    [
        ("gsta", {}, "gsta is not smooth at its rest"),
        ("sta", {}, "sta is not smooth at its rest"),
        ("pid", {"controller.k_i": 0.0}, "a state of the law neither decays nor grows about the rest"),
        ("ideal", {}, "the law is told the truth"),
        ("fosm", {"navigation.velocity_noise": 0.1} | LAYER, "fosm is not linear over 3 standard"),
        (
            "impedance",
            {"navigation.force_jitter": 0.01},
            "white noise with a constant delay only: navigation.force_jitter",
        ),
        (
            "impedance",
            {"navigation.force_limit": 200.0},
            "white noise with a constant delay only: navigation.force_limit",
        ),
        ("impedance", {"navigation.mass_behind": 1.0}, "sees an acceleration"),
        ("impedance", {"bumper.stiffness": 1e4}, "rigid bodies on walls of one layer that stand, not for wall"),
        ("impedance", {"navigation.force_noise": 30.0, "reference.target": [1.02, 0.0, 0.0]}, "would lose contact"),
        ("impedance", {"navigation.position_noise": 0.05} | CUBE, "a thruster would saturate at times"),
        (
            "impedance",
            {"navigation.velocity_period": 0.02, "navigation.velocity_delay": 0.3},
            "is unstable without contact",
        ),
    ],
)
def test_where_there_is_no_closed_form_a_sentence_says_why(law, settings, reason):
    found = deviations(setup_of(PUSHING | {"navigation.force_noise": 1.0} | settings, law))
    assert isinstance(found, str)
    assert reason in found


def test_without_noise_nothing_is_computed():
    assert deviations(setup_of(PUSHING)) is None
    assert deviations(setup_of({})) is None
    assert Perfect().white_channels == {}


def test_the_summary_has_both_deviations():
    settings = PUSHING | {"navigation.force_noise": 1.0, "simulation.duration": 60.0}
    noise = summary(simulate(Scenario.load("push_wall", settings, "impedance"), engine="free_body"), {})["noise"]
    assert noise["none_because"] is None
    assert noise["push_N"] == pytest.approx(noise["analytic_N"], rel=0.2)
    quiet = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01}), engine="free_body")
    assert summary(quiet, {})["noise"] == {"push_N": None, "analytic_N": None, "none_because": None}
