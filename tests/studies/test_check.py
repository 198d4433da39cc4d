"""The check of the engines: which runs are repeated, what is compared."""

import math

import numpy as np
import pandas as pd
import pytest

from short_study import HERE, study_text
from uvms_mj import Study
from uvms_mj.studies.rows import differences, sample


@pytest.fixture
def plan(tmp_path):
    (tmp_path / "s.toml").write_text(study_text(runs=1000, engine="auto"))
    return Study.load(tmp_path / "s.toml").plan


def rows(number, **columns):
    index = np.arange(number)
    given = {"index": index, "status": "completed", "engine": "free_body", "peak": np.sin(index), "settled": True}
    return pd.DataFrame(given | columns)


@pytest.mark.parametrize(("number", "least"), [(3, 3), (40, 5), (2000, 20)])
def test_one_run_in_a_hundred_is_repeated_at_least_five_and_the_worst(plan, number, least):
    frame = rows(number)
    chosen = sample(plan, frame)
    assert least <= len(chosen) <= least + 1
    assert chosen == sorted(set(chosen)) == sample(plan, frame)
    assert frame["peak"].idxmax() in chosen


def test_only_completed_or_diverged_runs_of_free_body_are_repeated(plan):
    frame = rows(100)
    frame.loc[::2, "engine"] = "mujoco"
    frame.loc[1::4, "status"] = "failed"
    assert set(sample(plan, frame)) <= set(range(3, 100, 4))
    assert sample(plan, rows(100, engine="mujoco")) == []


def test_a_run_is_compared_by_numbers_also_if_success_needs_another_metric(tmp_path):
    """Otherwise both rows say failed, and nothing is compared."""
    more = "[success]\nforce_range_N = [0.0, 1e3]"
    text = study_text(runs=1, engine="auto", metrics=', "force_range_N"', more=more)
    (tmp_path / "s.toml").write_text(text)
    found = Study.load(tmp_path / "s.toml").run(tmp_path / "results", executor=HERE).check
    assert {"final.position_m.x", "contact.peak_N"} <= set(found["number"])
    assert found["within"].all()


def numbers(**other):
    found = {
        "status": "completed",
        "contact.touches": 3,
        "contact.settled": True,
        "contact.final_N": 1.5,
        "contact.peak_N": 20.0,
        **{f"final.position_m.{axis}": x for axis, x in zip("xyz", (1.0, 0.0, 0.0), strict=True)},
        "thrust_peak_N": 5.0,
    }
    return found | {key.replace("__", "."): value for key, value in other.items()}


def compared(plan, ours, theirs):
    found = differences(plan, [0], {(0, "free_body"): ours, (0, "mujoco"): theirs})
    return dict(zip(found["number"], found["difference"], strict=True)), bool(found["within"].all())


def test_equal_runs_have_no_difference(plan):
    differences, within = compared(plan, numbers(), numbers())
    assert within
    assert set(differences.values()) == {0.0}
    assert list(differences) == [
        "status",
        *(f"final.position_m.{a}" for a in "xyz"),
        "contact.final_N",
        "contact.peak_N",
    ]


@pytest.mark.parametrize(
    ("other", "number", "difference"),
    [
        ({"contact__final_N": 1.503}, "contact.final_N", 0.003 / 1.503),
        ({"contact__peak_N": 20.1}, "contact.peak_N", 0.1 / 25.1),
        ({"final__position_m__y": -0.002}, "final.position_m.y", 0.002),
        ({"status": "unstable"}, "status", math.inf),
    ],
)
def test_a_difference_beyond_the_tolerance_is_found(plan, other, number, difference):
    differences, within = compared(plan, numbers(), numbers(**other))
    assert differences[number] == pytest.approx(difference)
    assert not within


def test_what_rounding_decides_is_not_compared(plan):
    bounced = numbers(contact__touches=4, contact__peak_N=25.0, contact__settled=False, contact__final_N=1.0)
    differences, within = compared(plan, numbers(), bounced)
    assert within
    assert not {"contact.peak_N", "contact.final_N"} & set(differences)
    diverged = numbers(status="unstable", final__position_m__x=9.0)
    assert compared(plan, numbers(status="unstable"), diverged) == ({"status": 0.0}, True)
