"""A vehicle with biased sensors rests where the static balance says, to 1e-6 of the force and 1e-8 m."""

import numpy as np
import pytest

from uvms_mj import Scenario, simulate
from uvms_mj.control.base import NoClosedForm, SteadyState
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.setup.base import set_up

BASE = {
    "navigation.name": "sensors",
    "simulation.duration": 14.0,
    "simulation.timestep": 2e-4,
    "wall.stiffness": 1e4,
    "wall.damping": 100.0,
    "reference.target": [1.1, 0.02, -0.03],
    "reference.attitude_deg": [3.0, -5.0, 10.0],
    "current.speed": 0.2,
    "impedance.M_d": [10.0, 20.0, 20.0, 0.3, 0.3, 0.3],
    "impedance.K_f": [0.8, 1.0, 1.0, 1.0, 1.0, 1.0],
    "disturbance.bias": [1.0, -0.5, 0.5, 0.05, 0.0, -0.05],
    "vehicle.displaced_mass": 1.01,
    "estimates.damping": 0.7,
}
LAWS = {
    "impedance": {"reference.target": [1.3, 0.02, -0.03]},
    "gsta": {},
    "fosm": {"controller.epsilon": 5e-2, "controller.K_s": 8.0},
    "ideal": {},
}
BIASES = {
    "force": {"force_bias": [0.4, -0.2, 0.1], "force_scale": -0.1},
    "force, large": {"force_bias": [-3.0, 1.0, 2.0]},
    "moment": {"moment_bias": [0.1, -0.2, 0.3], "moment_scale": 0.2},
    "position": {"position_bias": [0.004, 0.002, -0.003], "position_scale": 0.003},
    "position, large": {"position_bias": [-0.02, 0.03, 0.05]},
    "attitude": {"attitude_bias": [0.02, -0.03, 0.05]},
    "velocity": {"velocity_bias": [0.004, -0.002, 0.003], "angular_velocity_bias": [0.02, 0.01, -0.03]},
    "depth": {"depth_drift": [5.0, 0.0, -2.0], "force_limit": 200.0},
}


def scenario(law, settings):
    overrides = BASE | LAWS[law] | {f"navigation.{name}": value for name, value in settings.items()}
    return Scenario.load("push_wall", overrides, law)


@pytest.mark.parametrize(
    ("law", "K_f", "share"), [("impedance", 1.0, 0.0), ("impedance", 0.5, -0.5), ("gsta", 1.0, 1.0)]
)
def test_impedance_with_its_defaults_does_not_feel_a_biased_force(law, K_f, share):
    """F (K_f + K_x/k_c) = K_x (x_d - x_c) + share f_b: K_f - 1 of the bias f_b is in the command of impedance with
    M_d = M_hat, which is the nominal control alone; z of gsta integrates, and K_f of the bias is in its balance."""
    pushes = []
    for f_b in (0.0, 0.5):
        sensor = {"navigation.name": "sensors", "navigation.force_bias": [f_b, 0.0, 0.0], "current.speed": 0.0}
        trace = simulate(Scenario.load("push_wall", sensor | {"impedance.K_f": [K_f] * 6}, law), engine="free_body")
        pushes.append(trace.push)
    assert pushes[1][-1] - pushes[0][-1] == pytest.approx(share * 0.5 / (K_f + 150.0 / 1e5), abs=2e-6)
    assert (np.abs(pushes[1] - pushes[0]).max() < 1e-9) == (share == 0.0), "in the whole run, to rounding"


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("bias", BIASES)
def test_a_constant_bias_shifts_the_rest_by_the_static_balance(law, bias):
    trace = simulate(scenario(law, BIASES[bias]), engine="free_body")
    rest = trace.analytic
    assert isinstance(rest, SteadyState), rest
    assert rest.force > 1.0
    assert trace.push[-2000:].mean() == pytest.approx(rest.force, rel=1e-6)
    assert np.abs(trace.p_WB[-1] - rest.position).max() < 1e-8
    assert np.abs(trace.quat_WB[-1] - rest.quat).max() < 1e-8
    assert np.abs(trace.s[-1] - rest.s).max() < 1e-5


def test_a_bias_matters():
    """The forces of the closed forms differ by far more than the tolerance above."""
    for law in LAWS:
        plain = steady_state(set_up(scenario(law, {})))
        for settings in BIASES.values():
            shifted = steady_state(set_up(scenario(law, settings)))
            assert np.abs(np.asarray(shifted.s) - plain.s).max() > 1e-7 or abs(shifted.force - plain.force) > 1e-3


def test_three_biases_of_the_force_shift_the_push_of_gsta_by_the_springs():
    """In front of the paper's wall, F (1 + K_x / k_c) = K_x (x_d - x_c) + b."""
    K_x, k_c = 150.0, 1e5
    for bias in (-1.0, 0.3, 2.0):
        given = {"navigation.name": "sensors", "navigation.force_bias": [bias, 0.0, 0.0], "current.speed": 0.0}
        state = steady_state(set_up(Scenario.load("push_wall", given)))
        assert state.force == pytest.approx((K_x * 0.01 + bias) / (1.0 + K_x / k_c), rel=1e-6)


def test_three_biases_of_the_position_shift_the_push_of_gsta_by_the_springs():
    """The law holds x + b at x_d, so that F (1 + K_x / k_c) = K_x (x_d - b - x_c)."""
    K_x, k_c = 150.0, 1e5
    for bias in (-0.02, 0.001, 0.005):
        given = {"navigation.name": "sensors", "navigation.position_bias": [bias, 0.0, 0.0], "current.speed": 0.0}
        state = steady_state(set_up(Scenario.load("push_wall", given)))
        assert state.force == pytest.approx(K_x * (0.01 - bias) / (1.0 + K_x / k_c), rel=1e-6)


def test_noise_and_late_samples_leave_the_mean():
    given = {"navigation.name": "sensors", "navigation.force_noise": 1.0, "navigation.velocity_delay": 1e-3}
    noisy, plain = (steady_state(set_up(Scenario.load("push_wall", each))) for each in (given, {}))
    assert noisy.force == plain.force


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"force_walk": 0.1}, "the force drifts: navigation.force_walk"),
        ({"force_limit": 1.0}, "the force is out of the sensor's range: navigation.force_limit"),
        (
            {"force_limit": 2.0, "force_noise": 0.2},
            "noise takes the force to the sensor's limit, which shifts its mean: navigation.force_limit",
        ),
        ({"attitude_quantum": 0.01}, "the rest is not unique with a resolution: navigation.attitude_quantum"),
    ],
)
def test_a_rest_that_is_not_known_has_a_reason(settings, reason):
    given = {"navigation.name": "sensors"} | {f"navigation.{name}": value for name, value in settings.items()}
    assert steady_state(set_up(Scenario.load("push_wall", given))) == NoClosedForm(reason)


def test_a_late_force_counts_as_its_age():
    """T < D_d / (K_f k_c): the delay and the hold of a force sensor add up."""
    late = {"navigation.name": "sensors", "navigation.force_delay": 0.5e-3, "navigation.force_period": 1e-3}
    state = steady_state(set_up(Scenario.load("push_wall", late)))
    assert isinstance(state, NoClosedForm)
    assert "the sampled law limit-cycles against this wall" in state.reason
    softer = late | {"wall.stiffness": 5e4}
    assert isinstance(steady_state(set_up(Scenario.load("push_wall", softer))), SteadyState)
