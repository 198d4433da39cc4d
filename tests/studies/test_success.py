"""The table ``[success]``: every name of a metric that is kept, in the plan, in rows, and in a tuning."""

import math

import numpy as np
import pytest
import tomli_w

from short_study import HERE
from uvms_mj import InputError, Study
from uvms_mj.studies.bundle import StudyBundle
from uvms_mj.studies.plan import Plan
from uvms_mj.studies.plan.metrics import succeeded, successes
from uvms_mj.studies.rows import one_row
from uvms_mj.studies.tune import Tuning

METRICS = """
def far(trace):
    return float(trace.p_WB[-1, 0])

def both(trace):
    return {"near": 1.0, "infinite": float("inf")}
"""
TABLES = {
    "base": {"scenario": "push_wall", "simulation.duration": 0.002},
    "vary": [{"key": "initial.position[0]", "values": [0.1, 0.5]}],
    "keep": {"metrics": ["contact.settled", "final.position_m", "own.py:far", "own.py:both"]},
    "run": {"engine": "free_body"},
}


@pytest.fixture
def plan(tmp_path):
    (tmp_path / "own.py").write_text(METRICS)
    return lambda success, **tables: Plan.from_dict(TABLES | {"success": success} | tables, tmp_path)


@pytest.mark.parametrize("name", ["own.py:far", "far", "{folder}/own.py:far", "final.position_m.x"])
def test_one_number_has_one_column_whatever_it_is_called(plan, tmp_path, name):
    """Here, and in a worker, where the files are elsewhere; the column of the rows is the criterion."""
    made = plan({name.format(folder=tmp_path): [0.4, 1.0]})
    column = "final.position_m.x" if name.startswith("final") else "far"
    assert made.success == {column: (0.4, 1.0)}
    assert Plan.from_dict(made.tables).success == made.success
    there = StudyBundle.of(made).plan()
    rows = [one_row(there, index) for index in range(2)]
    assert [row["success"] for row in rows] == [False, True]
    assert [row[column] == pytest.approx(x, abs=1e-3) for row, x in zip(rows, (0.1, 0.5), strict=True)] == [True, True]


@pytest.mark.parametrize(
    ("limit", "met"),
    [
        ({"both.near": [0, 2]}, True),
        ({"own.py:both.infinite": [0, 2]}, False),
        ({"both.infinite": [0, math.inf]}, True),
    ],
)
def test_a_number_of_a_dictionary_is_named_behind_its_function(plan, limit, met):
    assert one_row(plan(limit), 0)["success"] is met


def test_a_number_that_the_metric_does_not_give_is_a_failed_row_that_says_so(plan):
    row = one_row(plan({"both.far": [0, 1]}), 0)
    assert (row["status"], row["success"]) == ("failed", False)
    assert row["message"] == "success.both.far: no such number; the metric both gives both.near, both.infinite"


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        ({"overshoot": [0, 1]}, "is not one of keep.metrics"),
        ({"fat": [0, 1]}, "did you mean 'far'?"),
        ({"final.position_m": [0, 1]}, "has components: give final.position_m.x or"),
        ({"final.position_m.w": [0, 1]}, "is not a component of final.position_m"),
        ({"contact.settled": [0, 1]}, "must be true or false"),
        ({"final.position_m.x": True}, "must be a range [low, high]"),
        ({"far": [0, 1], "own.py:far": [0, 1]}, "is given twice"),
    ],
)
def test_a_limit_that_means_nothing_is_refused_by_name(plan, limit, said):
    with pytest.raises(InputError) as caught:
        plan(limit)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("row", "given", "met"),
    [
        ({"status": "completed"}, {}, True),
        ({"status": "completed", "contact.settled": False}, {}, False),
        ({"status": "completed", "contact.settled": None}, {}, False),
        ({"status": "unstable", "contact.settled": True}, {}, False),
        ({"status": "completed", "x": 1.0}, {"x": (1.0, 1.0)}, True),
        ({"status": "completed", "x": math.nan}, {"x": (-math.inf, math.inf)}, False),
        ({"status": "completed", "x": None}, {"x": (0.0, 1.0)}, False),
    ],
)
def test_a_run_is_a_success_if_it_completed_within_every_limit(row, given, met):
    assert succeeded(row, given) is met


def test_rows_of_a_folder_have_the_column_and_logs_take_the_same_names(plan, tmp_path):
    keep = TABLES["keep"] | {"logs": {"kind": "worst", "k": 1, "metric": "own.py:far"}}
    made = plan({"far": [0.4, 1.0]}, keep=keep)
    frame = Study(made).run(tmp_path / "out", executor=HERE).frame
    assert frame["success"].dtype == bool
    assert frame["success"].tolist() == [False, True]
    assert np.isposinf(frame["both.infinite"]).all()
    assert successes(frame, made.success).tolist() == successes(frame.drop(columns="success"), made.success).tolist()
    assert [path.name for path in (tmp_path / "out" / "logs").iterdir()] == ["row-00001.mcap"]


@pytest.mark.parametrize("name", ["own.py:far", "far", "own.py:both.near", "both.near", "final.position_m.x"])
def test_an_objective_takes_the_same_names(tmp_path, name):
    (tmp_path / "own.py").write_text(METRICS)
    gain = {"key": "controller.k_1", "low": 1.0, "high": 20.0}
    tables = TABLES | {"gain": [gain], "objective": {"metric": name}, "tune": {"trials": 1}}
    (tmp_path / "tune.toml").write_text(tomli_w.dumps(tables))
    tuning = Tuning.load(tmp_path / "tune.toml")
    assert Tuning.from_dict(tuning.tables).objective == tuning.objective
