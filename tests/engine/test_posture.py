"""The posture in the loop: the tool does not feel it, its levels follow closed forms, and bad input is refused."""

import numpy as np
import pytest

from armed import armed_xml
from uvms_mj import Scenario, Simulation, simulate
from uvms_mj.errors import InputError
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.physics.statics import Statics
from uvms_mj.setup.base import set_up

STILL = {"wall.present": False, "current.speed": 0.0, "reference.step_time": 0.0, "simulation.timestep": 1e-3}
START = {"initial.joints": [0.3, -0.8, 0.5, 0.4], "initial.attitude_deg": [4.0, -6.0, 30.0]}


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("armed") / "armed.xml"
    path.write_text(armed_xml(4))
    return str(path)


@pytest.fixture(scope="module")
def at_rest(arm):
    """Settings of a tool that holds its initial pose."""
    settings = STILL | START | {"vehicle.model": arm, "task.frame": "tool"}
    initial = set_up(Scenario.load("push_wall", settings)).initial
    return settings | {"reference.target": initial.position, "reference.attitude_deg": initial.attitude_deg}


def scenario(settings, **posture):
    return Scenario.load("push_wall", settings | {f"posture.{k}": v for k, v in posture.items()}, "impedance")


def accelerations(settings, zeta, **posture):
    """zeta_dot (10,) of the first step from a velocity, and the Jacobian of the tool."""
    with Simulation(scenario(settings, **posture)) as sim:
        sim.data.qvel[:] = [*(rotation_matrix(sim.data.qpos[3:7]) @ zeta[:3]), *zeta[3:]]
        J = Statics(sim.setup.vehicle, sim.data.qpos[7:].copy()).jacobian(sim.setup.vehicle.arm.sites["tool"])
        sim.step()
        return np.concatenate([sim.signals.nu_dot, sim.data.qacc[6:]]), J


def test_the_tool_does_not_feel_the_posture(at_rest):
    """MuJoCo's accelerations of the tool are the same for every posture, and those of the levels as demanded."""
    zeta = np.random.default_rng(4).normal(size=10) * 0.3
    found, J = accelerations(at_rest, zeta, order=["joints"], free_damping=0.0)
    for posture in (
        {"order": ["joints"], "joints": [1.0, -0.2, 0.3, -0.5]},
        {"order": ["attitude", "joints"], "attitude_deg": [10.0, 20.0, 0.0]},
        {"order": ["station", "attitude"], "yaw": True, "station": [0.5, 0.2, -0.3]},
        {"order": [], "free_damping": 3.0},
    ):
        other, _ = accelerations(at_rest, zeta, **posture)
        assert np.abs(other - found).max() > 0.1
        assert np.allclose(J @ other, J @ found, rtol=0.0, atol=1e-9)
    moved, _ = accelerations(at_rest, zeta, order=["joints"], joints=[1.0, -0.2, 0.3, -0.5], joints_frequency=1.5)
    same, _ = accelerations(at_rest, zeta, order=["joints"], joints_frequency=1.5)
    expected = 1.5**2 * (np.array([1.0, -0.2, 0.3, -0.5]) - START["initial.joints"])
    assert np.allclose((moved - same)[6:], expected, rtol=0.0, atol=1e-9)


def critical(t, omega):
    return (1.0 + omega * t) * np.exp(-omega * t)


@pytest.mark.parametrize("frame", ["tool", "body"])
def test_the_joints_follow_their_natural_frequency_while_the_task_rests(at_rest, frame):
    """q - q_d = (1 + omega t) exp(-omega t) (q_0 - q_d), to first order of the time step."""
    body = {"task.frame": "body", "joints.name": "torque", "reference.target": [0.0] * 3}
    body |= {"reference.attitude_deg": START["initial.attitude_deg"]}
    q_d, worst = np.array([0.1, -0.5, 0.2, 0.6]), []
    for h in (2e-3, 1e-3):
        settings = at_rest | (body if frame == "body" else {}) | {"simulation.timestep": h, "simulation.duration": 2.0}
        trace = simulate(scenario(settings, order=["joints"], joints=q_d.tolist(), joints_frequency=2.5))
        assert np.abs(trace.eta_e).max() < 1e-4
        expected = q_d + critical(trace.t, 2.5)[:, None] * (np.array(START["initial.joints"]) - q_d)
        worst.append(np.abs(trace.q - expected).max())
    assert worst[0] / worst[1] == pytest.approx(2.0, rel=0.1)
    assert worst[1] < 2e-3


@pytest.mark.filterwarnings("ignore:posture.order")
def test_the_order_decides_what_gives_way(at_rest):
    """Four joints leave two components below the attitude: it is met, and the joints in part; and the other way."""
    settings = at_rest | {"simulation.duration": 8.0}
    targets = {"attitude_deg": [0.0, 0.0, 0.0], "joints": [0.0, 0.0, 0.0, 0.0], "damping_ratio": 0.7}
    errors = []
    for order in (["attitude", "joints"], ["joints", "attitude"]):
        trace = simulate(scenario(settings, order=order, **targets), log_rate=10.0)
        assert np.abs(trace.eta_e[-1]).max() < 1e-6
        tilt = np.arccos(rotation_matrix(trace.quat_WB[-1])[2, 2])
        errors.append((tilt, np.abs(trace.q[-1]).max()))
    (level, bent), (tilted, straight) = errors
    assert level < 1e-5
    assert straight < 1e-5
    assert bent > 0.1
    assert tilted > 0.1


def test_the_station_is_kept_while_the_tool_rests(at_rest):
    settings = at_rest | {"simulation.duration": 3.0}
    away = [0.06, -0.05, 0.04]
    trace = simulate(scenario(settings, order=["station"], station=away, station_frequency=2.0), log_rate=100.0)
    expected = np.array(away) * (1.0 - critical(trace.t, 2.0))[:, None]
    assert np.allclose(trace.p_WB, expected, rtol=0.0, atol=1e-3)


def test_motion_without_a_level_comes_to_rest(at_rest):
    """Joints that nothing governs stop, and keep their momentum without free_damping."""
    speeds = []
    for free_damping in (2.0, 0.0):
        settings = at_rest | {"simulation.duration": 4.0}
        with Simulation(scenario(settings, order=[], free_damping=free_damping)) as sim:
            sim.data.qvel[6:] = 0.3
            sim.step(4000)
            speeds.append(np.abs(sim.signals.q_dot).max())
    assert speeds[0] < 2e-3
    assert speeds[1] > 0.05


@pytest.mark.parametrize(
    ("posture", "message"),
    [
        ({"order": ["joints", "joints"]}, "posture.order: ['joints', 'joints'] names a level twice"),
        ({"order": ["altitude"]}, "posture.order[0]: 'altitude' must be 'attitude', 'station' or 'joints'"),
        ({"joints": [0.0] * 3}, "posture.joints: has 3 values; 4 are needed, for joint1, joint2, joint3, joint4"),
        ({"joints": [0.0, 0.0, 7.0, 0.0]}, "posture.joints[2]: 7 is outside the range of joint3, -2.96706 to 2.96706"),
        ({"damping_ratio": -1.0}, "posture.damping_ratio: -1.0 must be from 0 to 1000"),
        ({"stiffness": 3.0}, "posture.stiffness: no such key"),
    ],
)
def test_errors_name_the_key_the_value_and_what_would_be_right(at_rest, posture, message):
    with pytest.raises(InputError) as refused, Simulation(scenario(at_rest, **posture)):
        pass
    assert message in str(refused.value)


def test_joints_that_hold_themselves_have_no_posture(at_rest):
    held = at_rest | {"joints.name": "position", "task.frame": "body"}
    with pytest.raises(InputError, match=r"posture: the joint interface position holds the joints itself"):
        simulate(scenario(held, order=["joints"]))
    with Simulation(scenario(held)) as sim:
        sim.step(20)
        assert not sim._memory.run["model"]["tau_posture"].any()


@pytest.mark.parametrize(
    ("order", "frame", "above"),
    [
        (["joints", "attitude"], "tool", "the task and joints"),
        (["attitude", "joints"], "tool", None),
        (["station", "attitude", "joints"], "tool", "the task and station and attitude"),
        (["station", "joints"], "body", "the task"),
        (["station", "attitude"], "tool", None),
    ],
)
def test_a_level_without_freedom_gets_a_note(at_rest, order, frame, above):
    with Simulation(scenario(at_rest | {"task.frame": frame, "joints.name": "torque"}, order=order)) as sim:
        found = [note for note in sim.notes if note.startswith("posture")]
        sim.step(5)
        assert np.isfinite(sim.signals.tau_q).all()
    assert len(found) == (above is not None)
    assert all(note.endswith(f" by {above}") for note in found)


def test_a_planar_arm_pitches_its_base_and_leaves_the_roll():
    """Two links in the x-z plane: of the attitude the pitch is held, the roll is not tried, and one joint is left."""
    settings = STILL | {"vehicle.model": "planar_arm", "task.frame": "tool", "initial.joints": [0.6, 0.9]}
    settings |= {"simulation.duration": 6.0, "initial.attitude_deg": [0.0, 8.0, 0.0]}
    initial = set_up(Scenario.load("push_wall", settings)).initial
    settings |= {"reference.target": initial.position, "reference.attitude_deg": initial.attitude_deg}
    level = scenario(settings, order=["attitude", "joints"], attitude_deg=[5.0, 0.0, 0.0], attitude_frequency=2.0)
    with Simulation(level) as sim:
        assert not [note for note in sim.notes if note.startswith("posture")]
    trace = simulate(level, log_rate=100.0)
    roll, pitch = rotation_matrix(trace.quat_WB)[:, 2, 1], -rotation_matrix(trace.quat_WB)[:, 2, 0]
    assert np.abs(roll).max() < 1e-6
    assert np.allclose(pitch, np.sin(np.radians(8.0) * critical(trace.t, 2.0)), rtol=0.0, atol=2e-3)
    assert np.abs(trace.eta_e).max() < 1e-4
