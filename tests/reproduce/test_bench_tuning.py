"""Gains by a stated budget: the cost of a run, and a search that goes on where it was."""

import math
import tomllib

import pytest

from short_study import HERE
from uvms_mj.reproduce.bench import bench
from uvms_mj.reproduce.bench.results import broken
from uvms_mj.reproduce.bench.task import Entry, entries_of, tasks
from uvms_mj.reproduce.bench.tuning import FOLDER, LAWS, RANGE, WORST, cost, gains_of
from uvms_mj.studies.tune.search import Journal

TASKS = tasks()


@pytest.mark.parametrize("name", TASKS)
def test_a_run_costs_at_most_one_where_it_is_passed_and_more_where_it_is_not(name):
    task = TASKS[name]
    good = {"status": "completed", **{each: low for each, (low, _) in task.criteria.items()}}
    assert cost(task, good) <= 1.0
    at_bounds = good | {each: high for each, (_, high) in task.criteria.items()}
    assert broken(task, at_bounds) == []
    assert cost(task, at_bounds) <= 1.0
    for each, (low, high) in task.criteria.items():
        for value in (high + 0.1 * max(high, 1.0), high + 50.0 * max(high, 1.0), *([low - 1.0] if low else [])):
            wrong = at_bounds | {each: value}
            assert broken(task, wrong) == [each]
            assert 1.0 < cost(task, wrong) <= WORST
        assert cost(task, good | {each: None}) == cost(task, good | {each: math.nan}) == WORST
    assert cost(task, good | {"status": "unstable"}) == WORST


def test_the_gains_of_a_law_are_scaled_and_nothing_of_the_tasks():
    plan = Entry("gsta", "gsta").plan(TASKS["gusts_and_delay"], 1, most=1)
    keys = {gain.key for gain in gains_of(plan)}
    assert keys >= {"controller.k_1", "controller.k_2", "controller.beta", "impedance.K_f"}
    assert {key for key in keys if not key.startswith("controller.")} == {"impedance.K_f"}, "no task sets it"
    assert not any("K_f" in str(task.tables["base"].get("impedance")) for task in TASKS.values())
    assert not keys & {"controller.period", "controller.delay"}
    (k_1,) = (gain for gain in gains_of(plan) if gain.key == "controller.k_1")
    assert dict(k_1.places(2.0)) == {"controller.k_1": 2.0 * k_1.value}


@pytest.mark.usefixtures("undrawn")
def test_a_tuned_law_is_a_second_row_and_the_search_goes_on(tmp_path):
    done = []
    how = {"only": ["two_bumpers"], "at_most": 1, "executor": HERE}
    found = bench(["parallel"], tmp_path, tune=2, progress=lambda n, total: done.append((n, total)), **how)
    assert [law["label"] for law in found["laws"]] == ["parallel", "parallel, tuned"]
    assert (1, 2) in done
    assert (2, 2) in done
    folder = tmp_path / "parallel" / FOLDER
    first = journal(folder)
    assert len(first) == 2
    assert first[0].params == dict.fromkeys(first[0].params, 1.0), "trial 0 is the law's own"
    assert all(1.0 / RANGE <= x <= RANGE for trial in first for x in trial.params.values())
    bench(["parallel"], tmp_path, tune=3, **how)
    again = journal(folder)
    assert [trial.value for trial in again[:2]] == [trial.value for trial in first]
    assert len(again) == 3
    laws = tomllib.loads((tmp_path / LAWS).read_text())["laws"]
    assert [law["label"] for law in laws] == ["parallel", "parallel, tuned"]
    entries = entries_of([str(tmp_path / LAWS)], TASKS)
    assert [entry.trials for entry in entries] == [0, 3], "the budget goes with the gains"
    assert found["laws"][1]["trials"] == 2
    assert "trials" not in found["laws"][0]
    best = min(again, key=lambda trial: trial.value)
    own = entries[0].plan(TASKS["two_bumpers"], 1, most=1).base
    assert own.controller.name == "gsta", "the base is the task's"
    tuned = entries[1].plan(TASKS["two_bumpers"], 1, most=1).scenario(0).controller
    plain = entries[0].plan(TASKS["two_bumpers"], 1, most=1).scenario(0).controller
    assert tuned.limit == pytest.approx(plain.limit * best.params["controller.limit"], rel=1e-3)


def journal(folder):
    """The trials of a folder."""
    import optuna

    backend = optuna.storages.journal.JournalFileBackend(str(folder / "trials.journal"))
    (study,) = optuna.storages.JournalStorage(backend).get_all_studies()
    return Journal(folder, study.study_name, "minimize").trials
