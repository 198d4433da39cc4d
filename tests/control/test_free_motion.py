"""Where base and joints rest behind a tool that the law holds: against runs, and the warnings before a run."""

import numpy as np
import pytest

from uvms_mj import Scenario, Simulation, simulate
from uvms_mj.control.theory.free_motion import FreeMotion
from uvms_mj.control.theory.terms import ThrustMap
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import _still, free_motion_notes

COARSE = {"simulation.timestep": 4e-4}
ALPHA = {"vehicle.model": "bluerov2_alpha5", "vehicle.coulomb_friction": 0.0, "initial.joints": [0.0, 1.0, 1.961, 0.0]}
WRONG = {"estimates.restoring": 1.3, "estimates.inertia": 0.8, "disturbance.bias": [2.0, -1.0, 3.0, 0.2, 0.5, -0.3]}
TETHERED = {"tether.length": 4.0, "tether.position": [-0.2, 0.0, 0.1], "posture.order": ["joints"]}


def free_motion(scenario: Scenario, push: float = 0.0) -> FreeMotion:
    setup = set_up(scenario)
    thrust_map = ThrustMap.of(setup)
    assert not isinstance(thrust_map, str)
    return FreeMotion(setup, thrust_map, _still(*setup.rest_pose, -push * setup.design.normal))


def notes(**overrides) -> list[str]:
    return list(free_motion_notes(set_up(Scenario.load("tool_push", overrides))))


@pytest.mark.slow
@pytest.mark.parametrize(
    "overrides",
    [
        {"current.direction_deg": 30.0, "current.vertical": -0.2},
        {"current.direction_deg": 180.0, "posture.order": ["attitude"]},
        {"current.direction_deg": -60.0} | WRONG,
        {"current.direction_deg": 70.0} | ALPHA | TETHERED,
    ],
)
@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
def test_a_run_rests_where_the_slow_motion_ends(overrides):
    """Joints, thrust and torques, which come from the stages in the loop and from the balance of the tree."""
    trace = simulate(Scenario.load("tool_push", overrides | COARSE), log_rate=500)
    motion = free_motion(trace.scenario, float(trace.push[-1]))
    q = motion.rest()
    np.testing.assert_allclose(q, trace.q[-1], atol=2e-4)
    tau = motion.push(q).tau
    last = trace.t > trace.t[-1] - 1.0  # the law chatters about its mean
    np.testing.assert_allclose(tau[:6], trace.tau[last].mean(axis=0), atol=2e-3)
    np.testing.assert_allclose(tau[6:], trace.tau_q[last].mean(axis=0), atol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("vehicle", "direction"), [({}, 60.0), (ALPHA, 0.0)])
def test_joints_begin_to_drift_as_fast_as_estimated(vehicle, direction):
    """In a weak current while the tool holds its pose, where the motion is small."""
    base = {"wall.present": False, "current.speed": 0.15, "current.direction_deg": direction} | vehicle | COARSE
    initial = set_up(Scenario.load("tool_push", base)).initial
    held = {"reference.target": initial.position, "reference.attitude_deg": initial.attitude_deg}
    trace = simulate(Scenario.load("tool_push", base | held | {"simulation.duration": 3.0}), log_rate=250)
    estimated = free_motion(trace.scenario).speeds(np.zeros((200, 3)), 0.01)
    measured = np.abs(trace.q_dot).max(axis=0)
    assert np.abs(estimated - measured).max() < 0.1 * measured.max()


@pytest.mark.slow
def test_joints_follow_the_tool_as_fast_as_estimated():
    """In still water: the largest speed of the joints as the tool moves by 0.1 m."""
    base = {"wall.present": False, "current.speed": 0.0, "simulation.duration": 6.0} | COARSE
    start = set_up(Scenario.load("tool_push", base)).initial.position
    target = [start[0] + 0.1, start[1], start[2]]
    trace = simulate(Scenario.load("tool_push", base | {"reference.target": target}), log_rate=100)
    estimated = free_motion(trace.scenario).speeds(trace.p_d_dot, 0.01)
    np.testing.assert_allclose(estimated, np.abs(trace.q_dot).max(axis=0), rtol=0.15)


@pytest.mark.parametrize("direction", [0.0, 60.0])
def test_a_posture_that_leaves_a_motion_free_is_named(direction):
    (note,) = notes(**{"posture.order": ["attitude"], "current.direction_deg": direction})
    moved = "elbow moves to the end of its range, 150 deg"
    left = 'the motion that posture.order = ["attitude"] leaves free while the law holds tool'
    assert note == f'nothing holds {left}: {moved}; add "joints" to it'


def test_a_free_motion_that_the_current_carries_away_is_named():
    (note,) = notes(**{"posture.order": ["attitude"], "current.direction_deg": 180.0})
    assert "shoulder moves from -40 deg to 13.2 deg" in note


@pytest.mark.parametrize("order", [["attitude"], [], ["station"], ["joints"]])
def test_in_still_water_nothing_moves_on_its_own(order):
    assert notes(**{"posture.order": order, "current.speed": 0.0}) == []


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        ({"current.speed": 2.0, "current.direction_deg": 0.0}, "gives way while the law holds tool: shoulder moves to"),
        ({"current.speed": 2.0, "current.direction_deg": 90.0}, "the thrusters are too weak: surge_left needs 14"),
        (ALPHA, "axis_d about"),
    ],
)
def test_what_the_posture_the_motors_or_the_thrusters_cannot_hold_is_named_before_the_run(overrides, reason):
    (note,) = notes(**overrides)
    assert reason in note


@pytest.mark.slow
def test_the_warning_reaches_the_run():
    folding = {"posture.order": ["attitude"], "current.direction_deg": 0.0}
    with Simulation(Scenario.load("tool_push", folding)) as sim:
        assert any(note.startswith("nothing holds the motion") for note in sim.notes)
    with Simulation(Scenario.load("tool_push")) as sim:
        assert sim.notes == ()


def test_joints_that_hold_themselves_have_no_free_motion():
    overrides = {"vehicle.model": "planar_arm", "current.speed": 2.0}
    assert list(free_motion_notes(set_up(Scenario.load("push_wall", overrides)))) == []
