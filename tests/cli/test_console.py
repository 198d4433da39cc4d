"""The table of a run: digits that the run supports, and a relative error only where it exists."""

import dataclasses
import math
import re

import numpy as np
import pytest

from uvms_mj import Scenario, Status, Trace, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.analysis.summary import summary
from uvms_mj.cli.common import Console

SHORT = ("simulation.duration=0.25", "wall.position=0.002", "reference.step_time=0")


@pytest.fixture(scope="module")
def trace():
    overrides = dict(setting.split("=") for setting in SHORT)
    return simulate(Scenario.load("push_wall", {key: float(value) for key, value in overrides.items()}))


def table_of(trace, capsys) -> dict[str, str]:
    """Lines of the table that ``uvms-mj run`` prints, by name."""
    Console(as_json=False, quiet=False).report({"": trace}, summary(trace, {"mcap": "run.mcap"}))
    lines = [line.split("│") for line in capsys.readouterr().out.splitlines() if line.startswith("│")]
    return {name.strip(): value.rstrip() for _, name, value, _ in lines}


def test_a_run_too_short_for_the_wall_has_no_relative_error(capsys):
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.6}))
    assert trace.analytic.force > 0.0
    assert summary(trace, {})["contact"]["relative_error"] is None
    table = table_of(trace, capsys)
    assert "relative error" not in table
    assert table["contact"].strip() == "none"


def test_a_run_in_contact_that_has_not_settled_has_no_relative_error(trace, capsys):
    assert trace.touches[-1] > 0
    assert not final_force(trace)[1]
    assert "relative error" not in table_of(trace, capsys)


def test_a_run_that_was_stopped_has_no_error_bars(trace, capsys):
    assert "error bars" in table_of(trace, capsys)
    stopped = dataclasses.replace(trace, outcome=dataclasses.replace(trace.outcome, status=Status.failed))
    assert "error bars" not in table_of(stopped, capsys)


def test_a_run_that_was_interrupted_says_whether_it_had_settled_by_then(paper_run, capsys):
    whole = paper_run("gsta")
    for until, words in ((6.0, "N (interrupted before it settled)"), (15.0, "1.498 N (settled)")):
        outcome = dataclasses.replace(whole.outcome, status=Status.interrupted, steps=round(until * 1e4))
        rows = whole.rows()[whole.t <= until + 1e-9]
        table = table_of(Trace.of(whole.header, rows, outcome), capsys)
        assert table["final force"].strip().endswith(words)
        assert "relative error" not in table


def test_the_table_prints_the_digits_that_a_run_supports(paper_run, capsys):
    trace = paper_run("gsta")
    table = table_of(trace, capsys)
    peak, first = table["peak force"].split()[0], table["first contact"].split()[0]
    assert peak == f"{trace.force_peak[-1]:.4g}"
    assert first == f"{trace.first_contact[-1]:.4g}"
    assert table["final force"].split()[0] == table["analytic force"].split()[0] == "1.497753"
    assert table["relative error"].strip() == "below 1e-9"  # and not -3.7e-11
    assert "converge" in table["error bars"]
    rows = trace.rows()
    rows[-1, trace.header.places["final_high"]] = trace.final_low[-1] + 2e-4
    early = Trace.of(trace.header, rows, trace.outcome)
    assert table_of(early, capsys)["final force"].split()[0] == "1.498"


def test_a_vehicle_that_touched_and_left_rests_with_zero_force(capsys):
    settings = {"initial.velocity": [0.2, 0, 0, 0, 0, 0], "wall.position": 0.01, "reference.target": [-0.05, 0.0, 0.0]}
    settings |= {"current.speed": 0.0, "simulation.duration": 8.0, "reference.step_time": 0.0}
    trace = simulate(Scenario.load("push_wall", settings, "impedance"))
    assert trace.touches[-1] > 0
    assert final_force(trace) == (0.0, True)
    table = table_of(trace, capsys)
    assert table["final force"].strip() == "0 N (settled)"
    assert "relative error" not in table


def test_vectors_of_the_table_stand_under_each_other(paper_run, capsys):
    table = table_of(paper_run("gsta"), capsys)
    points = [[i for i, c in enumerate(table[name]) if c == "."] for name in ("final position", "analytic position")]
    assert points[0] == points[1]
    assert len({len(number.partition(".")[2]) for number in re.findall(r"\d+\.\d+", table["final position"])}) == 1
    assert "-0.00000" not in table["final position"]


def test_each_component_of_the_largest_tau_has_three_digits(paper_run, capsys):
    """Moments are a thousand times smaller than forces, and are not 0.00 for that."""
    trace = paper_run("gsta")
    shown = [float(number) for number in table_of(trace, capsys)["largest tau"].split("N")[0].split()]
    assert shown == pytest.approx(trace.tau_max[-1], rel=5e-3)


def test_the_table_of_a_run_at_a_tool_has_the_tool_and_the_joints(capsys):
    trace = simulate(Scenario.load("tool_push", {"simulation.duration": 0.01}))
    table = table_of(trace, capsys)
    assert float(table["final position, tool"].split()[0]) == pytest.approx(trace.p_WT[-1][0], abs=1e-5)
    assert [float(q) for q in table["final joints"].split()[:2]] == pytest.approx(trace.q[-1].tolist(), abs=1e-4)


def test_the_table_names_the_joints_whose_motors_were_at_their_limit(trace, capsys):
    """A target that only the shoulder is far from; without joints and without a motor at its limit there is no row."""
    still = {"vehicle.model": "planar_arm", "initial.joints": [0.0, 0.5], "simulation.duration": 0.1}
    assert summary(trace, {})["saturated_joints_s"] is None
    assert "motors at their limits" not in table_of(trace, capsys)
    for target, limited in ([0.0, 0.5], False), ([1.0, 0.5], True):
        moving = simulate(Scenario.load("push_wall", still | {"joints.name": "position", "joints.target": target}))
        times = summary(moving, {})["saturated_joints_s"]
        assert list(times) == ["shoulder", "elbow"]
        assert list(times.values()) == pytest.approx(moving.joint_saturation_time[-1].tolist())
        row = table_of(moving, capsys).get("motors at their limits", "")
        assert row.strip() == (f"shoulder {times['shoulder'] / 0.1:.2%} of the time" if limited else "")
    assert times["shoulder"] > 0.01


SERVO = {"vehicle.model": "planar_arm", "simulation.duration": 1.5, "joints.name": "position", "wall.present": False}
STOP = math.radians(120.0)
"""End of the shoulder's range to both sides."""


@pytest.mark.parametrize(
    ("overrides", "off", "stopped"),
    [
        ({"joints.target": [0.3, 0.4]}, [], []),
        ({"joints.target": [0.3, 1.9], "simulation.duration": 0.05}, ["shoulder", "elbow"], []),
        ({"joints.target": [STOP, 0.1], "initial.joints": [2.05, 0.0]}, [], ["shoulder"]),
        ({"joints.name": "auto", "initial.joints": [0.0, 1.0]}, [], []),
        ({"joints.motion": [{"time": 1.0, "joints": [0.0, 0.0]}, {"time": 9.0, "joints": [0.8, 0.0]}]}, [], []),
    ],
)
def test_the_table_names_the_joints_that_are_off_their_target_or_at_a_stop(capsys, overrides, off, stopped):
    trace = simulate(Scenario.load("push_wall", SERVO | overrides))
    report, table = summary(trace, {}), table_of(trace, capsys)
    for names, place, row in (
        (off, "joints_off_target", "off their target"),
        (stopped, "joints_at_stops", "at their stops"),
    ):
        assert list(report[place] or ()) == names
        assert re.findall(r"shoulder|elbow", table.get(f"joints {row}", "")) == names


def test_the_error_of_a_velocity_servo_at_a_stop_is_the_velocity_that_it_should_have(capsys):
    """The target rises from -1 to -0.5 rad/s in 3 s, so that it is -0.75 rad/s after half of them."""
    motion = [{"time": 0.0, "joints": [-1.0, 0.0]}, {"time": 3.0, "joints": [-0.5, 0.0]}]
    of_motion = {"joints.name": "velocity", "joints.interpolation": "linear", "joints.motion": motion}
    trace = simulate(Scenario.load("push_wall", SERVO | of_motion | {"initial.joints": [-2.0, 0.0]}))
    report, table = summary(trace, {}), table_of(trace, capsys)
    assert report["joints_off_target"] == {"shoulder": pytest.approx(0.75, abs=1e-6)}
    assert report["joints_at_stops"] == {"shoulder": pytest.approx(-STOP, abs=1e-5)}
    assert table["joints off their target"].strip() == "shoulder by 0.75 rad/s"
    assert table["joints at their stops"].strip() == "shoulder -2.094 rad"


def test_a_log_without_the_file_of_its_motion_names_no_joint_off_its_target(tmp_path):
    file = tmp_path / "motion.csv"
    file.write_text("time,shoulder,elbow\n0,1.0,1.0\n")
    trace = simulate(Scenario.load("push_wall", SERVO | {"joints.motion_file": str(file), "simulation.duration": 0.01}))
    assert list(summary(trace, {})["joints_off_target"]) == ["shoulder", "elbow"]
    file.unlink()
    assert summary(trace, {})["joints_off_target"] is None


@pytest.mark.parametrize(("thrusters", "motors"), [(3, 5), (7, 13)])
def test_times_of_the_summary_are_counts_of_steps_without_the_noise_of_a_sum(trace, thrusters, motors):
    """A tenth that is added three times is 0.30000000000000004. The time step is 0.1 ms."""
    moving = simulate(Scenario.load("push_wall", {"vehicle.model": "planar_arm", "simulation.duration": 0.01}))
    summed = {"saturation_time": sum([1e-4] * thrusters), "joint_saturation_time": sum([1e-4] * motors)}
    arrays = {name: np.full_like(moving[name], summed.get(name, 0.0)) for name in moving}
    report = summary(Trace(moving.header, arrays, moving.outcome), {})
    assert summed["saturation_time"] != thrusters / 1e4
    assert report["saturated_s"] == thrusters / 1e4
    assert list(report["saturated_joints_s"].values()) == [motors / 1e4] * 2
