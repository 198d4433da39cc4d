"""Runs against records of a pool: on records that the simulator made, and on the real ones."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from page_numbers import page as page_of
from pool_records import reach, write
from tree_twin import Rigid, TwinBody, TwinTree, inertia, resistance
from twin import rotation, skew
from uvms_mj import InputError
from uvms_mj.cli import main
from uvms_mj.engine.native.attachment import immerse
from uvms_mj.physics.frames import quat_from_euler_deg
from uvms_mj.reproduce.validate import results as judging
from uvms_mj.reproduce.validate import speed
from uvms_mj.reproduce.validate.data import AXES, Attitude, Motion, records
from uvms_mj.reproduce.validate.page import CONSTANT, FITTED, numbers
from uvms_mj.reproduce.validate.results import PITCH, compute
from uvms_mj.reproduce.validate.vehicle import (
    FASTEST,
    STATIC,
    VARIANTS,
    Variant,
    at_rest,
    driven,
    floating,
    model,
    righting,
    swing,
    vehicle,
)

STRETCHED = np.radians([30.0, 70.0, 150.0, 20.0])
HEIGHT, LATE = 0.0231, 0.3
ENDS = ((0.5, 2.5, 1.5, 1.0), (-1.0, 1.2, 2.8, 0.5), (0.2, 0.8, 2.6, 0.0), (-0.6, 1.5, 2.0, 1.5))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with four trials of a vehicle whose centre of buoyancy is higher; the clock of the last one is late. In
    a fifth one the motion capture loses the vehicle."""
    folder = tmp_path_factory.mktemp("pool")
    for k, end in enumerate(ENDS):
        write(folder, f"traj00{k}-0", reach(end), Variant(height=HEIGHT), LATE if k == 3 else 0.0)
    write(folder, "traj004-0", reach(ENDS[0]), Variant(height=HEIGHT), lost=8.0)
    write(folder, "baseline1", Motion(0.0, 10.0, CubicSpline([0.0, 5.0, 10.0], [STRETCHED] * 3)), Variant())
    return folder


@pytest.fixture(scope="module")
def results(made):
    with ThreadPoolExecutor(1) as executor:
        return compute(*records(made), executor, lambda done, total: None)


def test_records_are_read_as_they_were_written(made):
    trials, resting = records(made)
    assert [trial.name for trial in trials] == ["000-0", "001-0", "002-0", "003-0", "004-0"]
    assert [record.name for record in resting] == ["baseline1"]
    motion = reach(ENDS[1])
    found, t = trials[1], np.linspace(0.5, 6.5, 50)
    assert np.abs(found.motion.q(t) - motion.q(t)).max() < 1e-3  # the smoothing's
    assert 1.0 < found.starts < 3.0
    response = floating(motion, Variant(height=HEIGHT))
    assert np.abs(found.mocap.at(response.t) - response.angles).max() < 1e-9


def test_yaw_has_no_jump_and_the_order_of_the_rotations_is_that_of_the_paper():
    t = np.linspace(0.0, 1.0, 200)
    angles = np.column_stack([0.3 * t, -0.4 * t, 3.0 + t])
    half = 0.5 * angles.T
    (c_x, c_y, c_z), (s_x, s_y, s_z) = np.cos(half), np.sin(half)  # R_z(yaw) R_y(pitch) R_x(roll)
    w, x = c_x * c_y * c_z + s_x * s_y * s_z, s_x * c_y * c_z - c_x * s_y * s_z
    y, z = c_x * s_y * c_z + s_x * c_y * s_z, c_x * c_y * s_z - s_x * s_y * c_z
    assert np.abs(Attitude.of(t, np.column_stack([w, x, y, z])).angles - angles).max() < 1e-12


def test_the_lag_is_recovered_whatever_offset_and_scale():
    t, of = np.linspace(0.0, 20.0, 800), np.linspace(0.0, 19.0, 1000)
    slow = np.sin(0.5 * of) + 0.2 * np.cos(1.7 * of)
    for late in (-0.4, 0.0, 0.7):
        value = 3.0 + 1.3 * (np.sin(0.5 * (t - late)) + 0.2 * np.cos(1.7 * (t - late)))
        assert judging.lag(t, value, of, slow) == pytest.approx(late, abs=1e-9)


def test_an_offset_is_all_error():
    t = np.linspace(0.0, 10.0, 300)
    found = judging.error(t, np.sin(t), t, np.sin(t) + 0.1)
    assert (found.rms, found.peak, found.mean) == pytest.approx((0.1, 0.1, 0.1), abs=1e-12)


def test_lag_and_height_of_the_simulated_pool_are_recovered(results):
    assert results.lag(3, results.fitted) == pytest.approx(LATE, abs=1e-9)  # one of LAGS
    assert results.lag(1, results.fitted) == pytest.approx(0.0, abs=1e-9)
    assert results.lag(3, Variant()) == pytest.approx(LATE, abs=0.05)  # a wrong stiffness also shifts the response
    assert results.fitted.height == pytest.approx(HEIGHT, abs=3e-4)
    assert np.degrees(results.pitch(0, results.fitted).rms) < 0.03 < np.degrees(results.pitch(0, Variant()).rms)
    assert (
        np.degrees(results.pitch(3, results.fitted, LATE).rms) < 0.03 < np.degrees(results.pitch(3, results.fitted).rms)
    )


def test_the_fit_finds_the_bottom_of_a_parabola_and_refuses_an_end():
    heights = np.array(judging.HEIGHTS)
    errors = np.array([np.hypot(0.01, 2.0 * (heights - low)) for low in (0.021, 0.023, 0.025, 0.03)])
    assert judging.fitted_height(errors, (1,)) == pytest.approx(0.023, abs=1e-9)
    assert judging.fitted_height(errors, (0, 1, 2)) == pytest.approx(0.023, abs=2e-4)
    assert len(judging.every_choice(errors)) == 4
    level = np.repeat([[1.0], [2.0], [3.0], [4.0]], errors.shape[1], axis=1)  # each choice is judged on what it left
    assert judging.every_choice(level) == pytest.approx([4.0, 3.0, 2.0, 1.0])
    with pytest.raises(InputError, match=r"no height of the centre of buoyancy from 0\.012 to 0\.036 m"):
        judging.fitted_height(np.array([heights, heights, heights]), (0, 1, 2))


def test_the_joints_follow_their_motion_within_a_ten_thousandth():
    motion = reach(ENDS[0])
    t, states = driven(motion, Variant())
    assert np.abs(states[:, 7:] - motion.q(t)).max() < 1e-4


def test_no_moment_acts_on_a_vehicle_in_its_closed_form_of_rest():
    given = vehicle(Variant(), STRETCHED)
    roll, pitch = at_rest(righting(given, STRETCHED))
    assert min(abs(roll), abs(pitch)) > 0.05  # far from level: the arm is stretched to one side
    for heel, moment in ((0.0, 0.0), (0.1, 0.1 * np.linalg.norm(righting(given, STRETCHED)))):
        data = mujoco.MjData(model())
        data.qpos[3:7], data.qpos[7:] = quat_from_euler_deg(*np.degrees((roll + heel, pitch, 0.0))), STRETCHED
        with immerse(model(), data, given):
            mujoco.mj_forward(model(), data)
            found = data.qfrc_passive[3:6] - data.qfrc_bias[3:6]
        assert np.linalg.norm(found) == pytest.approx(moment * np.cos(pitch), rel=3e-3, abs=1e-12)


def test_weights_foam_and_arm_leave_the_vehicle_neutral():
    given = vehicle(Variant(), STRETCHED)
    links = given.arm.links
    net = given.displaced_mass + sum(k.displaced_mass for k in links) - given.mass - sum(k.mass for k in links)
    assert abs(net) < 0.02  # [kg]


def _twin(given):
    """The independent twin of a vehicle, from its coefficients."""

    def body(parent, M_RB, of, **joint):
        m, r_g = M_RB[0, 0], np.array([M_RB[5, 1], M_RB[3, 2], M_RB[4, 0]]) / M_RB[0, 0]
        part = Rigid(m, r_g, M_RB[3:, 3:] + m * skew(r_g) @ skew(r_g))
        return TwinBody(parent, (part,), of.M_A, of.D_linear, of.D_quadratic, of.displaced_mass, of.r_b, **joint)

    links = [body(k.parent + 1, k.M_RB, k, p_0=k.p_0, R_0=k.R_0, axis=k.axis, anchor=k.anchor) for k in given.arm.links]
    return TwinTree((body(-1, given.M_RB, given), *links))


def _prescribed(tree, motion, attitude, end):
    """Attitude (3,) at a time of a twin whose joints follow a motion exactly: six equations, no servo, no MuJoCo."""

    def rate(t, y):
        R, nu = rotation(y[:4] / np.linalg.norm(y[:4])), y[4:]
        zeta = np.r_[nu, motion.q(t, 1)]
        M = inertia(tree, motion.q(t))
        load = -resistance(tree, R, motion.q(t), zeta)[:6] - M[:6, 6:] @ motion.q(t, 2)
        w, v = y[0], y[1:4]
        quat_dot = 0.5 * np.r_[-v @ nu[3:], w * nu[3:] + np.cross(v, nu[3:])]
        return np.r_[quat_dot, np.linalg.solve(M[:6, :6], load)]

    begin = np.r_[quat_from_euler_deg(*np.degrees(attitude)), np.zeros(6)]
    found = solve_ivp(rate, (motion.begin, end), begin, rtol=1e-6, atol=1e-8).y[:4, -1]
    return Attitude.of(np.zeros(1), found[None] / np.linalg.norm(found)).angles[0]


def test_the_vehicle_answers_the_arm_as_the_independent_twin_does():
    motion, end = replace(swing(), end=2.0), 1.98
    last = {}
    for name in VARIANTS:
        found = floating(motion, Variant(name))
        twin = _prescribed(_twin(vehicle(Variant(name), motion.q(0.0))), motion, found.angles[0], end)
        last[name] = found.at(np.array([end]))[0]
        assert np.degrees(np.abs(last[name] - twin).max()) < 1e-3  # first order in the time step, and the servos
    for name in VARIANTS[1:]:
        assert np.degrees(np.abs(last[name] - last["as is"]).max()) > 0.3


def test_lumped_added_mass_is_the_base_block_of_the_inertia():
    blocks = {}
    for name in VARIANTS:
        data = mujoco.MjData(model())
        data.qpos[3], data.qpos[7:] = 1.0, STRETCHED
        with immerse(model(), data, vehicle(Variant(name), STRETCHED)):
            mujoco.mj_forward(model(), data)
            full = np.zeros((model().nv, model().nv))
            mujoco.mj_fullM(model(), data, full)
        blocks[name] = full[:6, :6]
    dry = blocks["no water on the links"]
    assert np.diag(blocks["lumped"] - dry) == pytest.approx(np.diag(blocks["as is"] - dry), rel=1e-9)
    assert (
        np.abs((blocks["as is"] - blocks["lumped"]) - np.diag(np.diag(blocks["as is"] - blocks["lumped"]))).max() > 0.01
    )


def test_the_swing_is_within_the_speed_of_the_arm_and_tells_the_models_apart(results):
    motion = swing()
    assert np.abs(motion.q(np.arange(0.0, motion.end, 0.01), 1)).max() <= FASTEST * 1.001
    as_is, dry, lumped = (found.angles[:, PITCH] for found in results.swings().values())
    assert np.degrees(np.abs(dry - as_is).max()) > 2.0
    assert np.degrees(np.abs(lumped - as_is).max()) > 1.0


def test_the_command_writes_a_page_with_every_trial_and_what_was_fitted(made, results, tmp_path, monkeypatch):
    monkeypatch.setattr("uvms_mj.reproduce.validate.results.compute", lambda *given: results)
    done = CliRunner().invoke(main, ["validate", "pool", "--data", str(made), "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "height fitted on 000-0, 001-0, 002-0, and judged on the others" in done.output
    assert "left out, since the two instruments differ by more than 2 deg: 004-0 (" in done.output
    assert done.output.splitlines()[-1] == f"{tmp_path}/report.html"
    html = (tmp_path / "report.html").read_text()
    for name in ("000-0 *", "001-0 *", "002-0 *", "003-0", "baseline1, pitch"):
        assert f">{name}<" in html
    assert "Only the height of the centre of buoyancy fitted, on 000-0, 001-0, 002-0" in html
    found = json.loads((tmp_path / "numbers.json").read_text())
    assert found["mean_rms_pitch_deg"][FITTED] == pytest.approx(np.degrees(results.pitch(3, results.fitted).rms))
    assert found["disagreeing"] == ["004-0"]
    assert ">004-0 (instruments disagree)<" in html
    rows = html.split("Error of the pitch over the trials, by model")[1]
    assert all(f">{name}<" in rows for name in ("hydrostatics alone", "hydrostatics alone, height fitted", CONSTANT))


def test_a_trial_whose_motion_capture_lost_the_vehicle_is_in_no_mean_and_no_fit(results):
    assert results.agreeing == [0, 1, 2, 3]
    assert np.degrees(results.instruments(4)[1]) > 4.0
    assert results.left == [3]
    found, own = numbers(results), np.degrees([results.pitch(k, Variant()).rms for k in range(5)])
    assert found["mean_rms_pitch_deg"]["as is"] == pytest.approx(own[:4].mean())
    assert found["median_rms_pitch_deg"]["as is"] == pytest.approx(np.median(own[:4]))
    assert found["mean_rms_pitch_of_all_deg"] == pytest.approx(own.mean())
    assert own[4] > 3.0 * own[:4].max()


def test_an_arm_that_moves_slowly_leaves_hydrostatics_alone():
    """The slower the motion, the nearer is the simulation to the balance of weight and buoyancy."""
    far = []
    for duration in (5.0, 20.0):
        motion = Motion(0.0, duration, CubicSpline([0.0, duration], [STRETCHED, STRETCHED * 0.5], bc_type="clamped"))
        moving, still = (floating(motion, Variant(links)) for links in ("as is", STATIC))
        assert np.ptp(still.angles[:, PITCH]) > np.radians(1.5)
        far.append(np.abs(moving.angles[:, PITCH] - still.at(moving.t)[:, PITCH]).max())
    assert far[1] < 0.2 * far[0]
    assert far[1] < np.radians(0.02)


def test_no_constant_pitch_is_better_than_the_mean_of_the_measured_one(results):
    pitch = results.trials[0].mocap.angles[:, PITCH]
    assert results.constant(0) == pytest.approx(np.sqrt(np.mean((pitch - pitch.mean()) ** 2)))


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda folder: (folder / "a_imu.csv").unlink(), "a_imu.csv: is missing"),
        (lambda folder: (folder / "a_mocap.csv").write_text(""), "a_mocap.csv: can't be read: No columns"),
        (lambda folder: _change(folder / "a_joint_states.csv", "axis_c_pos", "axis_x"), "lacks the columns axis_c_pos"),
        (lambda folder: _line(folder / "a_imu.csv", 7, "0.1,0,0,wide,1"), "a_imu.csv: z_ori in line 7 is not a finite"),
        (lambda folder: _line(folder / "a_imu.csv", 7, "0.0,0,0,0,1"), "with time_secs growing from each line"),
        (
            lambda folder: _line(folder / "a_mocap.csv", 9, "0.22,0,0,0,0"),
            "quaternion in line 9 has the length 0, not 1",
        ),
        (lambda folder: _later(folder), "a: its files share -11 s; 5 to 600 s are needed"),
        (
            lambda folder: [path.unlink() for path in folder.iterdir()],
            "has no record; a record is the files NAME_mocap",
        ),
    ],
)
def test_a_wrong_folder_gets_one_message(tmp_path, harm, message):
    t = np.linspace(0.0, 6.0, 200)
    for kind, names in (("mocap", "x_ori y_ori z_ori w_ori"), ("imu", "x_ori y_ori z_ori w_ori")):
        rows = np.column_stack([t, np.zeros((200, 3)), np.ones(200)])
        np.savetxt(
            tmp_path / f"a_{kind}.csv", rows, "%g", ",", header=",".join(["time_secs", *names.split()]), comments=""
        )
    names = ["time_secs", *(f"{axis}_pos" for axis in AXES)]
    rows = np.column_stack([t, np.outer(t, np.ones(4))])
    np.savetxt(tmp_path / "a_joint_states.csv", rows, "%g", ",", header=",".join(names), comments="")
    assert len(records(tmp_path)[0]) == 1
    harm(tmp_path)
    with pytest.raises(InputError) as raised:
        records(tmp_path)
    assert message in str(raised.value)
    assert str(raised.value).startswith(f"--data {tmp_path}")


def _change(path: Path, before: str, after: str) -> None:
    path.write_text(path.read_text().replace(before, after))


def _later(folder: Path) -> None:
    """The clock of the motion capture begins when the others have ended."""
    rows = np.loadtxt(folder / "a_mocap.csv", delimiter=",", skiprows=1)
    rows[:, 0] += 17.0
    header = (folder / "a_mocap.csv").read_text().splitlines()[0]
    np.savetxt(folder / "a_mocap.csv", rows, "%g", ",", header=header, comments="")


def _line(path: Path, number: int, text: str) -> None:
    lines = path.read_text().splitlines()
    lines[number - 1] = text
    path.write_text("\n".join(lines))


def test_too_few_trials_are_refused(made):
    trials, resting = records(made)
    with (
        ThreadPoolExecutor(1) as executor,
        pytest.raises(InputError, match=r"has 3 trials .* agree within 2 deg; at least 4 are needed"),
    ):
        compute(trials[:3], resting, executor, lambda done, total: None)


def test_the_command_names_what_it_looks_for(tmp_path):
    done = CliRunner().invoke(
        main, ["validate", "pool", "--data", str(tmp_path / "none"), "--out", str(tmp_path / "out")]
    )
    assert done.exit_code == 2
    assert done.output.count("\n") == 1
    assert "no such folder; a record is the files NAME_mocap.csv, NAME_imu.csv, NAME_joint_states.csv" in done.output
    assert not (tmp_path / "out").exists()


def test_the_speed_of_a_heavy_is_that_of_a_laboratory_and_of_the_closed_form():
    """Nothing is fitted. At another voltage the bound is missed."""
    found = speed.speeds()
    assert speed.rms_error(found) < speed.BOUND
    assert max(abs(each.run / each.closed_form - 1.0) for each in found) < 0.02
    text = page_of("validation").read_text(encoding="utf-8")
    worst = max(found, key=lambda each: abs(each.run / each.measured - 1.0))
    rms, by_formula = 100.0 * speed.rms_error(found), 100.0 * speed.rms_error(found, "closed_form")
    said = f"The rms error is {rms:.1f} % of the mean speed over axes from 0.2 to 0.5, and the worst one"
    assert f"{said} {100.0 * abs(worst.run / worst.measured - 1.0):.1f} %, at an axis of {worst.axis:g}." in " ".join(
        text.split()
    )
    assert f"of the vehicle's file, it is {by_formula:.1f} %." in text
    others = [100.0 * speed.rms_error(speed.speeds(voltage)) for voltage in (14.0, 16.0)]
    assert f"at 14 V the rms error is {others[0]:.1f} %, at 16 V {others[1]:.1f} %" in text
    assert min(others) > 100.0 * speed.BOUND


def test_the_command_prints_the_speeds_and_judges_them():
    done = CliRunner().invoke(main, ["validate", "speed", "--json"])
    assert done.exit_code == 0
    told = json.loads(done.stdout)
    assert len(told["speeds_m_per_s"]) == len(speed.AXES)
    assert told["rms_error"] < speed.BOUND
