"""Joint motors, gear friction, stops, interfaces and encoders in the loop."""

import itertools
import math
import re

import numpy as np
import pytest

from two_joints import STILL, two_joints
from uvms_mj import InputError, Scenario, Simulation, simulate
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import warnings_of

OWN = """
from dataclasses import dataclass
from uvms_mj import setting
from uvms_mj.actuation import Joints


@dataclass(frozen=True)
class Push(Joints):
    "A constant torque, from a given time on."

    push: float = setting(5.0, "N m or N", "torque")
    begins: float = setting(0.0, "s", "time")
    states = {"pushed": "joints"}

    @staticmethod
    def step(settings, state, given, state_dot, tau_q):
        for j in range(tau_q.shape[0]):
            tau_q[j] = settings.push if given.t >= settings.begins else 0.0
            state_dot.pushed[j] = tau_q[j]
"""


@pytest.fixture
def scenario(tmp_path):
    """Makes a scenario of the vehicle with two joints; keywords of the vehicle, and overrides by dotted keys."""
    numbers = itertools.count()

    def make(overrides=None, **of_vehicle):
        path = tmp_path / f"rov{next(numbers)}.xml"
        path.write_text(two_joints(**of_vehicle))
        (tmp_path / "push.py").write_text(OWN)
        return Scenario.load("push_wall", STILL | {"vehicle.model": str(path)} | (overrides or {}))

    make.push = f"{tmp_path / 'push.py'}:Push"
    return make


# motors


@pytest.mark.slow
def test_the_time_of_a_motor_at_its_limit_is_counted_at_every_step(scenario):
    """Of the shoulder, whose limit is 9 N m and then that of its torque-speed line; the jaw gives up to 20 N."""
    push = {"joints.name": scenario.push, "joints.push": 8.999, "joints.begins": 0.25, "simulation.duration": 1.0}
    for torque, shares in ((8.999, (0.0, 0.0)), (9.0, (0.75, 0.0)), (12.0, (0.75, 0.0)), (-30.0, (0.75, 0.75))):
        of_start = scenario(push | {"joints.push": torque}, gravity=0.0, hinge='damping="50"')
        trace = simulate(of_start, log_rate=100)
        times = trace.joint_saturation_time
        assert times[-1] == pytest.approx(shares, abs=1e-3 * max(shares) + 1e-12), torque
        late = trace.t >= 0.25
        np.testing.assert_allclose(times[late], np.outer(trace.t[late] - 0.25, np.array(shares) / 0.75), atol=1e-9)
        assert not times[~late].any()
    line = scenario(push, custom='<numeric name="shoulder.speed_limit" data="0.4"/>', gravity=0.0)
    trace = simulate(line, log_rate="full")  # it needs no more than 9 N m, and is limited as soon as it moves
    limited = (trace.t >= 0.25) & (trace.tau_q[:, 0] < 8.999)
    assert 0 < np.count_nonzero(limited) < np.count_nonzero(trace.t >= 0.25)
    assert trace.joint_saturation_time[-1, 0] == pytest.approx(2e-4 * np.count_nonzero(limited[:-1]), abs=1e-9)
    with Simulation(line) as sim:
        sim.step(2000)
        assert sim.signals.joint_saturation_time[0] > 0.1
        sim.reset()
        assert not sim.signals.joint_saturation_time.any()


def test_motors_that_are_too_weak_for_the_arm_are_named_before_the_run(scenario):
    """The moment of weight and buoyancy about the shoulder is 0.4 kg m times gravity; the jaw is neutral."""
    assert not any("too weak" in note for note in warnings_of(set_up(scenario())))
    said = "the motors are too weak to hold the arm against its weight and buoyancy at the initial joints: "
    notes = warnings_of(set_up(scenario(gravity=30.0)))
    assert f"{said}shoulder needs 12 and has 9 N m" in notes
    assert not any("too weak" in note for note in warnings_of(set_up(scenario(gravity=30.0, hinge='frictionloss="4"'))))
    load = [{"link": "finger", "mass": 3.0}]
    assert any("shoulder needs" in note for note in warnings_of(set_up(scenario({"vehicle.payloads": load}))))


def test_the_torque_of_a_motor_follows_its_torque_speed_line(scenario):
    """Of a user's interface that asks for more: the effort 9 N m times 1 - q_dot / limit, at every step."""
    line = '<numeric name="shoulder.speed_limit" data="0.4"/>'
    push = {"joints.name": scenario.push, "joints.push": 12.0}
    trace = simulate(scenario(push, custom=line, slide='frictionloss="50"', gravity=0.0))
    speed = trace.q_dot[:, 0]
    assert speed[-1] == pytest.approx(0.4, rel=0.05)
    assert np.abs(trace.tau_q[:, 0] - 9.0 * (1.0 - np.maximum(speed, 0.0) / 0.4)).max() < 1e-12
    assert (trace.tau_q[:, 1] == 12.0).all()
    assert "tau_q_cmd" in trace


def test_an_accelerated_joint_obeys_newton(scenario):
    """The slide, and the rest of 52 kg with 40 kg of added mass, are pushed apart."""
    push = {"joints.name": scenario.push, "joints.push": 3.0, "controller.name": "external"}
    with Simulation(scenario(push, hinge='frictionloss="50"', gravity=0.0)) as sim:
        sim.step(250)
        found = sim.signals.q_dot[1] / sim.t
    assert found == pytest.approx(3.0 / 0.5 + 3.0 / 92.0, rel=1e-3)


def test_a_users_states_are_of_the_number_of_joints(scenario):
    trace = simulate(scenario({"joints.name": scenario.push, "simulation.duration": 0.01}))
    assert trace.pushed.shape == (len(trace.t), 2)
    assert trace.pushed[-1] == pytest.approx(5.0 * trace.t[-1], rel=1e-9)


# friction and stops


def test_a_joint_sticks_below_its_coulomb_friction_and_slips_above(scenario):
    """Weight less buoyancy at the shoulder, 2 * 0.3 - 0.8 * 0.25 kg m, gives 3.9 N m; the slide is loaded by 3 N."""
    held = {"joints.name": scenario.push, "joints.push": 0.0}
    stuck = simulate(scenario(held, hinge='frictionloss="5"', slide='frictionloss="5"'))
    assert np.abs(stuck.q_dot[-1]).max() < 1e-7
    assert np.abs(stuck.q[-1]).max() < 1e-6
    slips = simulate(scenario(held, hinge='frictionloss="3"'))
    assert slips.q[-1, 0] > 0.02


def test_a_gear_that_slips_slows_its_joint_by_the_coulomb_torque(scenario):
    """Two pushes of the slide, with and without friction: the accelerations differ by friction over mass."""
    push = {"joints.name": scenario.push, "joints.push": 4.0, "simulation.duration": 0.05}
    free, slowed = (
        simulate(scenario(push, slide=f'frictionloss="{friction}"', hinge='frictionloss="50"', gravity=0.0))
        for friction in (0.0, 1.5)
    )
    difference = (free.q_dot[-1, 1] - slowed.q_dot[-1, 1]) / free.t[-1]
    assert difference == pytest.approx(1.5 / 0.5, rel=0.02)


def test_a_joint_stops_at_its_range(scenario):
    """Pushed with 20 N: it rests within a micrometre of the end of its range."""
    push = {"joints.name": scenario.push, "joints.push": 20.0, "simulation.duration": 1.0}
    trace = simulate(scenario(push, slide='range="-0.05 0.1" damping="20"', hinge='frictionloss="50"', gravity=0.0))
    assert trace.q[-1, 1] == pytest.approx(0.1, abs=1e-6)
    assert trace.q[:, 1].max() < 0.1 + 1.0 * 2e-3 / math.e


# interfaces


def test_by_default_the_joints_hold_their_initial_positions(scenario):
    trace = simulate(scenario({"initial.joints": [0.4, 0.02], "simulation.duration": 1.0}))
    assert trace.q[0].tolist() == [0.4, 0.02]
    assert np.abs(trace.q - [0.4, 0.02]).max() < 0.05
    assert np.abs(trace.q[-1] - [0.4, 0.02]).max() < 1e-6
    assert trace.tau_q[-1, 0] == pytest.approx(-9.81 * 0.4 * math.cos(0.4), rel=0.02)
    assert "tau_q_cmd" not in trace
    assert "q_m" not in trace


def test_the_position_interface_follows_a_file(scenario, tmp_path):
    t = np.linspace(0.0, 1.0, 51)
    q = np.stack([0.3 * (1.0 - np.cos(np.pi * t)), 0.02 * t**2 * (3.0 - 2.0 * t)], axis=1)
    rows = [f"{x:.6f},{b:.12f},{a:.12f}" for x, (a, b) in zip(t, q, strict=True)]
    (tmp_path / "swing.csv").write_text("\n".join(["time,jaw,shoulder", *rows]))
    own = {"joints.name": "position", "joints.motion_file": str(tmp_path / "swing.csv"), "joints.motion_start": 0.2}
    trace = simulate(scenario(own | {"simulation.duration": 1.6}, gravity=0.0, hinge='frictionloss="1"'))
    then = np.clip(trace.t - 0.2, 0.0, 1.0)
    expected = np.stack([np.interp(then, t, each) for each in q.T], axis=1)
    assert np.abs(trace.q - expected).max() < 3e-3
    assert np.abs(trace.q[-1] - q[-1]).max() < 5e-4


def test_the_velocity_interface_holds_a_velocity_against_the_weight(scenario):
    own = {"joints.name": "velocity", "joints.target": [0.3, -0.01], "simulation.duration": 1.0}
    trace = simulate(scenario(own))
    assert np.abs(trace.q_dot[-1] - [0.3, -0.01]).max() < 1e-3
    assert trace.q[-1, 1] == pytest.approx(-0.01, rel=0.05)


# the encoder


@pytest.mark.slow
def test_the_interface_is_given_what_the_encoder_reads(scenario):
    """A biased encoder: the joint rests beside its target by the bias."""
    own = {"encoder.name": "encoder", "encoder.bias": [0.02, -0.003], "simulation.duration": 1.0}
    trace = simulate(scenario(own | {"initial.joints": [0.3, 0.02]}))
    assert trace.q_m[-1] == pytest.approx([0.3, 0.02], abs=1e-4)
    assert trace.q[-1] == pytest.approx([0.28, 0.023], abs=1e-4)
    assert np.abs(trace.q_m - trace.q - [0.02, -0.003]).max() < 1e-12


def test_an_encoder_with_a_period_is_held_between_its_samples(scenario):
    own = {"encoder.name": "encoder", "encoder.period": 4e-3, "simulation.duration": 0.1}
    trace = simulate(scenario(own))
    n = round(4e-3 / trace.t[1])
    assert n > 1
    assert np.array_equal(trace.q_m, np.repeat(trace.q[::n], n, axis=0)[: len(trace.t)])


# errors


def test_a_servo_runs_at_every_step_under_a_slow_law(scenario):
    """200 rad/s are unstable at the control period, 0.02 s, at which the servo does not run."""
    own = {"joints.name": "position", "joints.target": [0.1, 0.0], "controller.period": 0.02}
    with Simulation(scenario(own)) as simulation:
        stages = simulation._memory.stages
        steps = dict(zip(stages.stages, stages.rows["period_steps"], strict=True))
    assert (steps["joints"], steps["controller"]) == (1, round(0.02 / simulation.scenario.simulation.timestep))


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"joints.name": "position", "joints.target": [0.1]}, "joints.target: has 1 values; the vehicle has 2 joints"),
        (
            {"joints.name": "position", "joints.target": [9.0, 0.0]},
            "joints.target: 9 is outside the range of shoulder, -1 to 1 rad",
        ),
        ({"joints.name": "position", "joints.motion_file": "none.csv"}, "none.csv: No such file or directory"),
        (
            {"joints.name": "position", "joints.period": 0.02},
            "200 rad/s is unstable at a period of 0.02 s",
        ),
        ({"initial.joints": [9.0, 0.0]}, "initial.joints[0]: 9 is outside the range of shoulder"),
        ({"joints.target": [0.1, 0.0]}, "for this one choose joints.name = velocity or position"),
        (
            {"joints.name": "velocity", "task.frame": "tip"},
            "joints.name: 'velocity' follows a given motion, and the law at a tool commands torques; choose torque",
        ),
        ({"joints.name": "spring"}, "joints.name: no joint interface 'spring'"),
        ({"encoder.name": "encoder", "encoder.bias": [1.0, 2.0, 3.0]}, "encoder.bias: has 3 values"),
        ({"encoder.period": 1e-3}, "a perfect encoder has no period"),
    ],
)
def test_wrong_input_is_refused_before_the_run(scenario, overrides, message):
    with pytest.raises(InputError) as raised:
        Simulation(scenario(overrides, hinge='range="-1 1"'))
    assert message in str(raised.value)


@pytest.mark.parametrize("key", ["initial.joints", "joints.target", "posture.joints"])
@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ([30.0, 0.0], "30 is outside the range of shoulder, -1 to 1 rad (in degrees? 30 deg are 0.524 rad)"),
        ([60.0, 0.0], "60 is outside the range of shoulder, -1 to 1 rad"),  # in degrees it is outside too
        ([0.0, 0.5], "0.5 is outside the range of jaw, -0.1 to 0.1 m"),  # a slide has no degrees
    ],
)
def test_a_joint_out_of_range_is_told_in_its_own_unit(scenario, key, joints, message):
    of_key = {"joints.target": {"joints.name": "position"}, "posture.joints": {"task.frame": "tip"}}
    overrides = of_key.get(key, {}) | {key: joints}
    with pytest.raises(InputError, match=rf"{re.escape(message)}$"):
        Simulation(scenario(overrides, hinge='range="-1 1"', slide='range="-0.1 0.1"'))


def test_solver_settings_of_the_file_are_refused(scenario):
    with pytest.raises(InputError, match=r'solreflimit="0.01 1">: solreflimit is not supported'):
        Simulation(scenario(hinge='solreflimit="0.01 1"'))


def test_the_path_of_a_motion_is_relative_to_the_scenario_file(tmp_path):
    (tmp_path / "rov.xml").write_text(two_joints())
    (tmp_path / "swing.csv").write_text("time,shoulder,jaw\n0,0,0\n1,0.1,0\n")
    (tmp_path / "swing.toml").write_text(
        '[vehicle]\nmodel = "rov.xml"\n[joints]\nname = "position"\nmotion_file = "swing.csv"\n'
    )
    with Simulation(Scenario.load(tmp_path / "swing.toml", STILL)) as sim:
        assert sim.scenario.joints.motion_file == str(tmp_path / "swing.csv")
