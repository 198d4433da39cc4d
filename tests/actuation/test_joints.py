"""Joint motors and interfaces against closed forms: the torque-speed line, given motions, the servo loops."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from uvms_mj import InputError
from uvms_mj.actuation import Position, Velocity
from uvms_mj.actuation.joints import rate_at, read_motion, segment_at, segments, value_at, velocity_loop
from uvms_mj.physics.tree import deliverable
from uvms_mj.stages.signals import joints_given, record_dtype

# the torque-speed line


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("q_dot", "most"), [(0.0, 9.0), (0.1, 7.2), (0.25, 4.5), (0.5, 0.0), (0.7, 0.0)])
def test_in_the_direction_of_motion_the_torque_falls_linearly_to_zero(sign, q_dot, most):
    """Effort 9 N m, speed limit 0.5 rad/s."""
    assert deliverable(sign * 20.0, sign * q_dot, 9.0, 0.5) == pytest.approx(sign * most, abs=1e-14)
    assert deliverable(sign * 1e-3, sign * q_dot, 9.0, 0.5) == pytest.approx(sign * min(1e-3, most), abs=1e-16)
    assert deliverable(-sign * 20.0, sign * q_dot, 9.0, 0.5) == -sign * 9.0


def test_a_motor_without_limits_gives_every_torque_and_none_without_effort():
    assert deliverable(1e6, 3.0, math.inf, math.inf) == 1e6
    assert deliverable(20.0, 3.0, 9.0, math.inf) == 9.0
    assert deliverable(20.0, -3.0, 0.0, 1.0) == 0.0


# given motions

TIMES = np.array([0.5, 1.0, 1.7, 3.0, 3.1])
VALUES = np.array([[0.0, 1.0], [0.4, -1.0], [0.3, 2.0], [0.0, 2.5], [0.1, 2.0]])


def sampled(constants, t, function):
    begins, c = constants["begins"], constants["coefficients"]
    return np.array([[function(begins, c, segment_at(begins, x), j, x) for j in range(c.shape[2])] for x in t])


def test_linear_interpolation_is_numpys_and_holds_both_ends():
    constants, t = segments(TIMES, VALUES, "linear"), np.linspace(-1.0, 5.0, 601)
    expected = np.stack([np.interp(t, TIMES, each) for each in VALUES.T], axis=1)
    assert np.abs(sampled(constants, t, value_at) - expected).max() < 1e-14


def test_cubic_interpolation_is_the_clamped_spline_and_holds_both_ends():
    constants, t = segments(TIMES, VALUES, "cubic"), np.linspace(-1.0, 5.0, 601)
    spline, inside = CubicSpline(TIMES, VALUES, bc_type="clamped"), np.clip(t, TIMES[0], TIMES[-1])
    assert np.abs(sampled(constants, t, value_at) - spline(inside)).max() < 1e-13
    moves = (t > TIMES[0]) & (t < TIMES[-1])
    assert np.abs(sampled(constants, t, rate_at) - spline(inside, 1) * moves[:, None]).max() < 1e-12


def test_cubic_interpolation_of_a_smooth_motion_is_of_fourth_order():
    def error(m):
        times = np.linspace(0.0, 2.0 * np.pi, m)
        t = np.linspace(0.0, 2.0 * np.pi, 977)
        return np.abs(sampled(segments(times, np.cos(times)[:, None], "cubic"), t, value_at)[:, 0] - np.cos(t)).max()

    assert math.log2(error(21) / error(41)) == pytest.approx(4.0, abs=0.3)


@pytest.mark.parametrize("m", [1, 2, 3, 4, 7, 8, 9, 1000])
def test_every_time_is_found_in_motions_of_every_length(m):
    times = np.sort(np.random.default_rng(m).uniform(0.0, 10.0, m))
    begins = segments(times, np.zeros((m, 1)), "linear")["begins"]
    for t in (-1.0, *times, *(0.5 * (times[1:] + times[:-1])), 11.0):
        assert segment_at(begins, t) == np.searchsorted(times, t, side="right")


def test_a_file_is_read_by_the_names_of_its_columns(tmp_path):
    path = tmp_path / "swing.csv"
    path.write_text("shoulder, other ,time,elbow\n1,x,0,2\n\n3,y,0.5,4\n", encoding="utf-8")
    times, values = read_motion(str(path), ("elbow", "shoulder"))
    assert times.tolist() == [0.0, 0.5]
    assert values.tolist() == [[2.0, 1.0], [4.0, 3.0]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,a\n0,1\n", "has no column b; its columns are time, a"),
        ("", "has no column time, a, b; it is empty"),
        ("time,a,b\n0,1,2\n1,x,2\n", "line 3: has no number in a column of time, a, b"),
        ("time,a,b\n0,1,nan\n", "line 2: has no number"),
        ("time,a,b\n0,1,2\n1,1\n", "line 3: has no number"),
        ("time,a,b\n0,1,2\n0,1,2\n", "line 3: the time 0 s does not increase after 0 s"),
        ("time,a,b\n", "has 0 times"),
    ],
)
def test_a_wrong_file_is_one_message_with_its_line(tmp_path, text, message):
    path = tmp_path / "swing.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as raised:
        read_motion(str(path), ("a", "b"))
    assert message in str(raised.value)
    assert str(raised.value).count("swing.csv") == 1


def test_a_file_that_is_not_there_is_one_message(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_motion(str(tmp_path / "none.csv"), ("a",))


# the servo loops


def servo_run(kind, timestep, load, **settings):
    """Velocity and position (m, 2) over 0.2 s of one joint of 0.02 kg m^2 under a constant load, from rest at 0."""
    inertia, steps = 0.02, round(0.2 / timestep)
    stage, arm = kind(**settings), SimpleNamespace(links=(SimpleNamespace(damping=0.0, friction=0.0),), joints=("a",))
    setup = SimpleNamespace(
        vehicle=SimpleNamespace(arm=arm),
        nominal=SimpleNamespace(arm=arm),
        joint_inertia=np.array([inertia]),
        initial_joints=np.zeros(1),
    )
    constants = stage.record(setup).view(np.recarray)[0]
    state, state_dot = (kind.state_record(1).view(np.recarray)[0] for _ in range(2))
    given = np.zeros(1, record_dtype(joints_given(1))).view(np.recarray)[0]
    given.effort[:], given.speed_limit[:], given.period = math.inf, math.inf, timestep
    q, q_dot, tau, found = 0.0, 0.0, np.zeros(1), []
    for k in range(steps):
        given.t, given.q_m[0], given.q_dot_m[0] = k * timestep, q, q_dot
        kind.step(constants, state, given, state_dot, tau)
        q_dot += timestep * (tau[0] + load) / inertia
        q += timestep * q_dot
        found.append((q_dot, q))
    return np.array(found)


def test_a_load_on_the_velocity_interface_gives_the_response_of_its_double_pole():
    """v = (load / I) t exp(-omega_v t / 2): the integral takes the whole load, and no velocity is left. The difference
    is of first order in the step."""

    def error(timestep):
        t = timestep * np.arange(1, round(0.2 / timestep) + 1)
        v = 1.3 / 0.02 * t * np.exp(-50.0 * t)
        return np.abs(servo_run(Velocity, timestep, 1.3, velocity_bandwidth=100.0)[:, 0] - v).max()

    assert error(1e-4) < 5e-3
    assert error(2e-4) / error(1e-4) == pytest.approx(2.0, abs=0.1)


def test_the_position_interface_returns_from_a_load_and_reaches_its_target():
    loaded = servo_run(Position, 1e-4, 1.3, velocity_bandwidth=400.0, position_bandwidth=80.0)
    assert abs(loaded[-1, 1]) < 1e-3 * np.abs(loaded[:, 1]).max()
    moved = servo_run(Position, 1e-4, 0.0, target=(0.3,), velocity_bandwidth=400.0, position_bandwidth=80.0)
    assert moved[-1, 1] == pytest.approx(0.3, abs=1e-4)


def test_a_servo_at_its_limit_does_not_wind_up():
    """The integral goes to the torque that the motor gives, not beyond it."""
    settings = Velocity(velocity_bandwidth=100.0)
    state = Velocity.state_record(1).view(np.recarray)[0]
    given = np.zeros(1, record_dtype(joints_given(1))).view(np.recarray)[0]
    given.effort[:], given.speed_limit[:], given.period = 2.0, math.inf, 1e-3
    constants = np.zeros(1, [("K_v", "f8", (1,)), ("omega_i", "f8"), ("viscous", "f8", (1,)), ("coulomb", "f8", (1,))])
    constants = constants.view(np.recarray)[0]
    constants.K_v[0], constants.omega_i = 10.0, 25.0
    assert settings.velocity_bandwidth / 4.0 == constants.omega_i
    for _ in range(3000):
        assert velocity_loop(constants, state, given, 0, 5.0) == 2.0
    assert state.carried[0] == pytest.approx(2.0, rel=1e-9)


def test_two_sources_of_a_motion_are_refused():
    with pytest.raises(InputError, match=r"joints.motion_file: is given beside joints.target"):
        Position(target=(0.1,), motion_file="swing.csv")


def test_waypoints_must_be_in_time():
    with pytest.raises(InputError, match="has the time 1 s after 2 s"):
        Position(motion=({"time": 2.0, "joints": [0.0]}, {"time": 1.0, "joints": [0.0]}))
