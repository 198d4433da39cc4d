"""One row of a study: its columns, and each way in which a run can end."""

import math
import time

import pytest

from law_files import HEADER, one_liner
from uvms_mj import Study, simulate
from uvms_mj.analysis.summary import summary
from uvms_mj.studies.rows import STATUSES, lost_row, one_row

LAW = (
    f"{HEADER}import time\n"
    + one_liner("Raises", "tau_cmd[:] = 0.0\nif signals.t > 0.01:\n    raise ValueError('enough')")
    + one_liner("Endless", "tau_cmd[:] = 0.0\nwhile signals.t > 0.01:\n    tau_cmd[0] += 1.0")
    + one_liner("Sleeps", "tau_cmd[:] = 0.0\ntime.sleep(0.1)")
)

METRICS = """
def number(trace):
    return len(trace)


def several(trace):
    return {"first": trace.p_WB[0, 0], "infinite": float("inf"), "none": None}


def text(trace):
    return "a"


def raises(trace):
    raise KeyError("no such thing")


def exits(trace):
    raise SystemExit(3)


def endless(trace):
    while True:
        pass
"""


@pytest.fixture
def files(tmp_path):
    (tmp_path / "law.py").write_text(LAW)
    (tmp_path / "metric.py").write_text(METRICS)


def rows_of(path, **overrides):
    plan = Study.load(path, overrides).plan
    return [one_row(plan, index) for index in range(plan.runs)]


def test_a_row_has_the_numbers_of_the_run_under_their_names(study_file):
    plan = Study.load(study_file(runs=2)).plan
    row = one_row(plan, 2)
    trace = simulate(plan.scenario(2), engine="free_body")
    report = summary(trace, {})
    expected = {
        "index": 2,
        "draw": 1,
        "law": "gsta",
        "repeat": 0,
        "seed": plan.run(2).seed,
        "wall.stiffness": plan.scenario(2).wall.stiffness,
        "status": "completed",
        "message": "",
        "steps": 300,
        "warnings": len(report["warnings"]),
        "success": report["contact"]["settled"],
        "engine": "free_body",
        "contact.peak_N": report["contact"]["peak_N"],
        "contact.touches": report["contact"]["touches"],
        "contact.settled": report["contact"]["settled"],
        **{f"final.position_m.{axis}": trace.p_WB[-1, i] for i, axis in enumerate("xyz")},
    }
    assert row == expected
    assert row["contact.peak_N"] > 1.0
    assert list(row) == list(expected)
    assert row == one_row(plan, 2)
    assert list(lost_row(plan, 2)) == list(expected)


def test_auto_takes_the_engine_that_can_run_the_scenario(study_file):
    assert [row["engine"] for row in rows_of(study_file(engine="auto", runs=1))] == ["free_body"] * 2
    rows = rows_of(study_file(engine="mujoco", runs=1))
    assert [row["engine"] for row in rows] == ["mujoco"] * 2


def test_metrics_of_a_user_are_columns(study_file, files):
    (row, _) = rows_of(study_file(runs=1, metrics=', "metric.py:number", "metric.py:several"'))
    assert row["number"] == 61.0
    assert [row[f"several.{key}"] for key in ("first", "infinite", "none")] == [0.995, math.inf, None]


@pytest.mark.parametrize(
    ("metric", "said"),
    [
        ("raises", "KeyError: 'no such thing'"),
        ("text", "TypeError: metric text: 'a' is not a number"),
        ("exits", "SystemExit: 3"),
    ],
)
def test_a_metric_that_fails_is_a_row(study_file, files, metric, said):
    (row, _) = rows_of(study_file(runs=1, metrics=f', "metric.py:{metric}"'))
    assert (row["status"], row["message"].partition(";")[0]) == ("failed", said)
    assert row["contact.peak_N"] is None


def test_a_law_that_raises_is_a_row_with_its_line(study_file, files):
    (*_, row) = rows_of(study_file(runs=1, more='[[laws]]\nname = "law.py:Raises"'))
    assert (row["law"], row["status"]) == ("Raises", "failed")
    assert "enough" in row["message"]
    assert 50 <= row["steps"] < 60


def test_a_run_that_diverges_is_a_row_with_what_it_measured(study_file):
    row, _ = rows_of(study_file(runs=1), **{"impedance.D_d": [1e5] * 6, "simulation.duration": 5.0})
    assert row["status"] == "unstable"
    assert "t = " in row["message"]
    assert math.isfinite(row["contact.peak_N"])


def test_a_scenario_that_cannot_run_is_a_row(study_file):
    """Each key alone stays in its range; together they may not."""
    uniform = '[[vary]]\nkey = "{}"\ndistribution = "uniform"\nlow = {}\nhigh = {}\n'
    more = uniform.format("wall.damping", 1.0, 1.2e5) + uniform.format("simulation.timestep", 1e-4, 4e-4)
    rows = rows_of(study_file(runs=8, more=more))
    assert {row["status"] for row in rows} == {"completed", "refused"}
    for row in rows:
        assert ("time step" in row["message"]) == (row["status"] == "refused")


def test_a_metric_beyond_the_time_of_its_run_is_a_row(study_file, files):
    (row, _) = rows_of(study_file(runs=1, run="time_limit_s = 0.5", metrics=', "metric.py:endless"'))
    assert (row["status"], row["steps"], row["contact.peak_N"]) == ("timed_out", None, None)


@pytest.mark.parametrize("law", ["Endless", "Sleeps"])
def test_a_run_beyond_its_time_is_a_row(study_file, files, law):
    start = time.monotonic()
    (*_, row) = rows_of(study_file(runs=1, run="time_limit_s = 0.5", more=f'[[laws]]\nname = "law.py:{law}"'))
    assert row["status"] == "timed_out"
    assert row["message"] == "longer than run.time_limit_s, 0.5 s of wall time"
    assert row["steps"] is None
    assert time.monotonic() - start < 60.0
    assert row["status"] in STATUSES
