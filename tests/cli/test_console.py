"""The table of a run: digits that the run supports, and a relative error only where it exists."""

import dataclasses
import re

import numpy as np
import pytest

from uvms_mj import Scenario, Status, Trace, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.analysis.summary import summary
from uvms_mj.cli.console import Console

SHORT = ("simulation.duration=0.25", "wall.position=0.002", "reference.step_time=0")


@pytest.fixture(scope="module")
def trace():
    overrides = dict(setting.split("=") for setting in SHORT)
    return simulate(Scenario.load("push_wall", {key: float(value) for key, value in overrides.items()}))


def table_of(trace, capsys) -> dict[str, str]:
    """Lines of the table that ``uvms-mj run`` prints, by name."""
    Console(as_json=False, quiet=False).report(trace, summary(trace, {"mcap": "run.mcap"}))
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
    early = Trace.of(trace.header, trace.rows(), trace.outcome)
    early.arrays["final_high"].setflags(write=True)
    early.arrays["final_high"][-1] = early.final_low[-1] + 2e-4
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
