"""Guidance in motion: derivatives, poses on the path, constant speed, and a law that follows without an error."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uvms_mj import InputError, Scenario, simulate
from uvms_mj.analysis.residual import impedance_error
from uvms_mj.setup.base import set_up
from uvms_mj.stages.signals import CLOCK, MEASURED, REFERENCE, record_dtype

POSES = [
    {"time": 2.0, "position": [0.4, 0.3, 0.1], "attitude_deg": [0.0, 10.0, 40.0]},
    {"time": 3.5, "position": [0.8, 0.0, -0.2], "attitude_deg": [20.0, 0.0, 130.0], "dwell": 0.7},
    {"time": 6.0, "position": [0.2, -0.4, 0.0], "attitude_deg": [0.0, -30.0, -150.0]},
    {"time": 7.0, "position": [0.0, 0.1, 0.3], "attitude_deg": [0.0, 0.0, -80.0]},
]
ROUTE = [{key: value for key, value in pose.items() if key != "time"} for pose in POSES]
STAGES = {
    "spline": {"reference.poses": POSES},
    "path": {"reference.poses": ROUTE, "reference.speed": 0.3, "reference.acceleration": 0.2},
    "straight": {
        "reference.name": "path",
        "reference.poses": ROUTE[:1],
        "reference.speed": 0.2,
        "reference.acceleration": 0.2,
    },
    "short": {"reference.name": "path", "reference.poses": [{"position": [0.05, 0.0, 0.0]}], "reference.speed": 1.0},
    "circle": {
        "reference.plane_deg": [20.0, -30.0, 50.0],
        "reference.turns": 1.3,
        "reference.speed": -0.4,
        "reference.heading": True,
    },
    "along_wall": {"reference.points": [[0.5, 0.0], [0.7, 0.4]], "reference.dwell": 0.5, "reference.speed": 0.3},
    "filtered_steps": {},
}


def scenario_of(name, **more):
    overrides = {"reference.name": name, "wall.position": 50.0, "current.speed": 0.0, **STAGES[name], **more}
    return Scenario.load("push_wall", overrides)


def reference(scenario, times):
    """The signals of the reference at times (n,), (n, size) each, by the stage's function as plain Python."""
    stage = scenario.reference
    settings = stage.record(set_up(scenario)).view(np.recarray)[0]
    out, rows = np.zeros(1, record_dtype(REFERENCE)).view(np.recarray), []
    given = np.zeros(1, record_dtype(CLOCK + MEASURED)).view(np.recarray)[0]
    for t in times:
        given.t = t
        type(stage).step(settings, None, given, None, out[0])
        rows.append(out.copy())
    return np.concatenate(rows).view(np.recarray)


@pytest.mark.parametrize("name", STAGES)
def test_each_derivative_is_the_derivative(name):
    """Central differences over 2 h and 4 h agree with p_d_dot, p_d_ddot, omega_d and omega_d_dot to the order h^2, and
    the acceleration is continuous."""
    scenario, errors = scenario_of(name), []
    at = np.random.default_rng(1).uniform(0.0, 9.0, 150)
    for h in (4e-4, 2e-4):
        before, here, after = (reference(scenario, at + shift) for shift in (-h, 0.0, h))
        turn = (
            Rotation.from_quat(after.quat_d, scalar_first=True)
            * Rotation.from_quat(before.quat_d, scalar_first=True).inv()
        )
        pairs = [
            (after.p_d - before.p_d, here.p_d_dot),
            (after.p_d_dot - before.p_d_dot, here.p_d_ddot),
            (turn.as_rotvec(), here.omega_d),
            (after.omega_d - before.omega_d, here.omega_d_dot),
        ]
        errors.append([np.abs(change / (2.0 * h) - rate) for change, rate in pairs])
        assert np.allclose(np.linalg.norm(here.quat_d, axis=1), 1.0, atol=1e-14)
    for coarse, fine in zip(*errors, strict=True):
        assert np.median(fine) < 1e-6
        assert fine.max() < 5e-3  # where the jerk jumps, the difference is of first order
        assert np.median(fine) < max(0.3 * np.median(coarse), 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", STAGES)
def test_position_velocity_acceleration_and_attitude_are_continuous(name):
    h = 5e-3
    rows = reference(scenario_of(name), np.arange(0.0, 12.0, h))
    for signal, fastest in (
        ("p_d", 2.0),
        ("p_d_dot", 5.0),
        ("p_d_ddot", 50.0),
        ("omega_d", 20.0),
        ("omega_d_dot", 200.0),
    ):
        assert np.abs(np.diff(rows[signal], axis=0)).max() < fastest * h, signal
    assert np.abs(np.sum(rows.quat_d[1:] * rows.quat_d[:-1], axis=1)).min() > 1.0 - 2e-5


def test_a_spline_is_at_its_poses_in_time_and_rests_at_dwells():
    times = [0.0, *(pose["time"] for pose in POSES)]
    rows = reference(scenario_of("spline"), [*times, 3.8, 4.2, 30.0])
    attitudes = [pose.get("attitude_deg", [0.0] * 3) for pose in POSES]
    wanted = Rotation.from_euler("ZYX", [a[::-1] for a in [[0.0] * 3, *attitudes]], degrees=True)
    assert np.allclose(rows.p_d[:5], [[0.0] * 3, *(pose["position"] for pose in POSES)], atol=1e-13)
    found = Rotation.from_quat(rows.quat_d[:5], scalar_first=True)
    assert (found * wanted.inv()).magnitude().max() < 1e-12
    for rest in (0, 5, 6, 7):
        for signal in ("p_d_dot", "p_d_ddot", "omega_d", "omega_d_dot"):
            assert np.abs(rows[signal][rest]).max() < 1e-12
    assert np.allclose(rows.p_d[5], rows.p_d[6], atol=1e-14)


def test_a_path_has_constant_speed_and_a_limited_acceleration_along_it():
    scenario = scenario_of("path")
    rows = reference(scenario, np.arange(0.0, 16.0, 5e-3))
    speed = np.linalg.norm(rows.p_d_dot, axis=1)
    moving = speed > 1e-9
    along = np.sum(rows.p_d_dot * rows.p_d_ddot, axis=1)[moving] / speed[moving]
    assert speed.max() == pytest.approx(0.3, rel=1e-6)
    assert np.mean(np.abs(speed[moving] - 0.3) < 1e-9) > 0.3
    assert np.abs(along).max() == pytest.approx(0.2, rel=2e-3)
    for pose in ROUTE:
        assert np.linalg.norm(rows.p_d - pose["position"], axis=1).min() < 0.3 * 2.6e-3  # between two samples
    straight = reference(scenario_of("straight"), np.arange(0.0, 9.0, 1e-2))
    direction = np.array(ROUTE[0]["position"]) / np.linalg.norm(ROUTE[0]["position"])
    assert np.abs(np.cross(straight.p_d, direction)).max() < 1e-14
    inside = np.abs(np.linalg.norm(straight.p_d_ddot, axis=1)) < 1e-9
    assert set(np.round(np.linalg.norm(straight.p_d_dot[inside], axis=1), 9)) == {0.0, 0.2}


def test_a_leg_that_is_too_short_for_its_speed_is_done_slower():
    rows = reference(scenario_of("short"), np.arange(0.0, 6.0, 5e-3))
    along = np.abs(rows.p_d_ddot[:, 0])
    assert along.max() == pytest.approx(0.1, rel=1e-4)
    assert rows.p_d_dot[:, 0].max() == pytest.approx(np.sqrt(0.05 * 0.1 / 1.5), rel=1e-5)
    assert rows.p_d[-1, 0] == pytest.approx(0.05, abs=1e-14)


def test_a_circle_is_a_circle_with_the_heading_along_it():
    scenario = scenario_of("circle")
    rows = reference(scenario, np.linspace(0.0, 16.0, 201))
    plane = Rotation.from_euler("ZYX", [50.0, -30.0, 20.0], degrees=True)
    centre = 0.5 * plane.apply([0.0, 1.0, 0.0])
    normal = plane.apply([0.0, 0.0, 1.0])
    arms = rows.p_d - centre
    assert np.allclose(np.linalg.norm(arms, axis=1), 0.5, atol=1e-14)
    assert np.abs(arms @ normal).max() < 1e-14
    assert np.linalg.norm(rows.p_d_dot, axis=1).max() == pytest.approx(0.4, rel=1e-12)
    B_p_dot = Rotation.from_quat(rows.quat_d, scalar_first=True).inv().apply(rows.p_d_dot)
    speed = np.linalg.norm(rows.p_d_dot, axis=1)
    moving = speed > 1e-3
    heading = B_p_dot[moving] / speed[moving, None]
    assert np.abs(heading - heading[0]).max() < 1e-9  # constant in the desired body
    position, attitude = scenario.reference.rest_pose(scenario)
    assert np.allclose(rows.p_d[-1], position, atol=1e-13)
    last = Rotation.from_euler("ZYX", attitude[::-1], degrees=True)
    assert (Rotation.from_quat(rows.quat_d[-1], scalar_first=True) * last.inv()).magnitude() < 1e-12


@pytest.mark.parametrize("name", ["spline", "path", "circle"])
def test_the_ideal_law_follows_a_motion_in_six_degrees_of_freedom(name):
    """The error is that of the time step: it halves with the step."""
    errors, left = [], []
    for timestep in (2e-3, 1e-3):
        more = {"simulation.timestep": timestep, "simulation.duration": 6.0, "current.speed": 0.4}
        trace = simulate(scenario_of(name, **more, **{"controller.name": "ideal"}), log_rate="full", engine="free_body")
        errors.append(np.abs(trace.eta_e).max())
        left.append(impedance_error(trace))
        turned = np.abs(np.sum(trace.quat_d * trace.quat_d[0], axis=1)).min()
        assert turned < 0.8
    assert errors[1] < 4e-4
    assert errors[1] == pytest.approx(0.5 * errors[0], rel=0.1)
    assert left[1].max() < 0.02  # N, N m; and of the order of the step
    assert np.allclose(left[1], 0.5 * left[0], rtol=0.2, atol=1e-4)


@pytest.mark.parametrize("name", ["spline", "circle"])
def test_nu_e_is_the_rate_of_the_pose_error_while_the_reference_turns(name):
    """With e = R^T (p - p_d) and q_e = conj(q_d) q: e_dot = v_e - omega x e and q_e_dot = q_e omega_e / 2, to the order
    of the time step. The vehicle starts off the reference and does not know the current, and so it swings."""
    errors = []
    for h in (1e-3, 5e-4):
        more = {"simulation.timestep": h, "simulation.duration": 4.0, "initial.velocity": [0.0] * 3 + [0.5, -0.4, 0.3]}
        more |= {"reference.start": [0.2, 0.1, -0.1], "controller.name": "impedance", "current.speed": 0.5}
        with pytest.warns(match="jump at the start"):
            trace = simulate(scenario_of(name, **more), log_rate="full", engine="free_body")
        e, nu_e = trace.eta_e[:, :3], trace.nu_e[1:-1]
        assert np.abs(e).max() > 0.1
        assert np.abs(nu_e[:, 3:]).max() > 0.1
        v_e = (e[2:] - e[:-2]) / (2.0 * h) + np.cross(trace.nu[1:-1, 3:], e[1:-1])
        q_e = Rotation.from_quat(trace.quat_d, scalar_first=True).inv() * Rotation.from_quat(
            trace.quat_WB, scalar_first=True
        )
        omega_e = (q_e[:-2].inv() * q_e[2:]).as_rotvec() / (2.0 * h)
        errors.append([np.abs(v_e - nu_e[:, :3]).max(), np.abs(omega_e - nu_e[:, 3:]).max()])
    assert max(errors[1]) < 0.01 * np.abs(nu_e).max()
    assert np.allclose(errors[1], 0.5 * np.array(errors[0]), rtol=0.05)


def test_a_circle_of_whole_turns_stops_as_smoothly_as_it_began():
    """Also while it slows down the recorded rates are those of the motion, and it comes to rest where it started."""
    turns = {"reference.name": "circle", "reference.turns": 1.0, "reference.radius": 0.1, "reference.heading": True}
    scenario, h = Scenario.load("push_wall", turns), 1e-4
    at = np.linspace(0.5, 9.0, 400)
    before, here, after = (reference(scenario, at + shift) for shift in (-h, 0.0, h))
    for motion, rate in (("p_d", "p_d_dot"), ("p_d_dot", "p_d_ddot"), ("omega_d", "omega_d_dot")):
        found = (after[motion] - before[motion]) / (2.0 * h)
        assert np.abs(found - here[rate]).max() < 1e-3, rate
    assert np.abs(here.p_d_ddot).max() > 0.1
    assert np.allclose(here.p_d[-1], here.p_d[0], atol=1e-12)
    assert not here.p_d_dot[-1].any()


@pytest.mark.parametrize("name", ["path", "along_wall"])
def test_a_leg_of_thousands_of_years_is_followed(name):
    """Its ramp takes less time than a double resolves at its end: the speed is there from the start."""
    keys = {"reference.name": name, "reference.speed": 1e-12, "reference.start_time": 1.0, "simulation.duration": 2.0}
    trace = simulate(Scenario.load("push_wall", keys), engine="free_body", log_rate=10)
    np.testing.assert_allclose(trace.p_d[:, 0], 1e-12 * np.maximum(trace.t - 1.0, 0.0), atol=1e-20)


def test_a_path_with_many_stops_is_that_with_fewer_and_one_with_too_many_curves_is_refused():
    """A straight leg with one segment in each ramp is the leg with six: s is of degree four in time."""

    def path(n, curved=()):
        zigzag = [
            {"position": [0.3 + 0.2 * (i % 2), 0.05 * i, 0.0], "attitude_deg": [0.0, 10.0 * (i % 2), 20.0 * (i % 3)]}
            for i in range(n)
        ]
        return [pose | {"dwell": 0.0 if i in curved else 0.4} for i, pose in enumerate(zigzag)]

    few, many = (scenario_of("path", **{"reference.poses": path(n)}) for n in (36, 100))
    times = np.linspace(0.0, 60.0, 997)
    one, other = reference(few, times), reference(many, times)
    for name in one.dtype.names:
        np.testing.assert_allclose(one[name], other[name], atol=1e-11, err_msg=name)
    assert np.ptp(one.p_d[:, 1]) > 0.9
    bent = scenario_of("path", **{"reference.poses": path(100, curved={50})})
    late = many.reference.constants(set_up(many))["begins"]
    end = late[np.isfinite(late)].max()
    assert reference(bent, [end + 100.0]).p_d[0] == pytest.approx(path(100)[-1]["position"], abs=1e-12)
    stops = {"reference.points": [[0.1 * (i % 2), 0.1 * i + 0.1] for i in range(80)], "reference.stop": True}
    assert reference(scenario_of("along_wall", **stops), [1e4]).p_d[0, 1:] == pytest.approx([0.1, 8.0])
    too_many = scenario_of("path", **{"reference.poses": path(100, curved=range(0, 80, 2))})
    with pytest.raises(InputError, match=r"60 stops, with a curve through other poses before 40 of them; at most 30"):
        set_up(too_many).scenario.reference.constants(set_up(too_many))
