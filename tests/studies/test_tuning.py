"""Tuning: a known optimum is found, limits hold, an interrupted search goes on as if it had not been."""

import contextlib
import json
import os
import shutil
import signal
import time
from pathlib import Path

import pandas as pd
import pytest
from pandas.testing import assert_frame_equal

from forked import started
from short_study import HERE
from short_tuning import force_at, stiffness_for, tuning_text
from uvms_mj import InputError, Scenario, Study, simulate
from uvms_mj.studies.results import VERSION
from uvms_mj.studies.tune import Tuning
from uvms_mj.studies.tune.search import JOURNAL
from uvms_mj.studies.tune.tuning import FOUND, TRIALS

AT_LEAST_10_N = """
[[constraint]]
metric = "contact.final_N"
over = "quantile"
q = 0.0
at_least = 10.0
"""
METRICS = """
def gap(trace):
    stiffness = trace.scenario.impedance.K_d[0]
    if stiffness > 300.0:
        raise ValueError("too stiff")
    return None if stiffness < 100.0 else abs(stiffness - 200.0)
"""


DRAG = """
from dataclasses import dataclass
from uvms_mj import Effect, setting

@dataclass(frozen=True)
class Drag(Effect):
    k: float = setting(1.0, "N s/m", "drag")

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        tau[:] = 0.0
        tau[0] = -settings.k * given.nu_r[0]
"""


@pytest.fixture
def tuning_file(tmp_path):
    """A function that writes a tuning file and returns its path."""

    def write(**lines):
        path = tmp_path / "t.toml"
        path.write_text(tuning_text(**lines))
        return path

    return write


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a tuning of twelve trials that ran without an interruption, with one worker."""
    path = tmp_path_factory.mktemp("whole") / "t.toml"
    path.write_text(tuning_text(duration=0.5))
    Tuning.load(path).run(path.with_name("out"), executor=HERE)
    return path.with_name("out")


def same(a: Path, b: Path) -> None:
    """The trials of two folders are equal, bit for bit."""
    assert_frame_equal(pd.read_parquet(a / TRIALS), pd.read_parquet(b / TRIALS), check_exact=True)


@pytest.mark.slow
def test_the_least_stiffness_that_presses_hard_enough_is_found(tuning_file, tmp_path):
    """The least force of at least 10 N at rest is 10 N, by the stiffness of the closed form."""
    tuning, optimum = Tuning.load(tuning_file(trials=40, constraint=AT_LEAST_10_N)), stiffness_for(10.0)
    tuning.run(tmp_path / "out", executor=HERE)
    trials, best = tuning.trials(tmp_path / "out"), tuning.best(tmp_path / "out")
    for each in trials:
        stiffness = each.gains["impedance.K_d[0]"]
        if stiffness > 100.0:  # softer ones have not come to rest after 4 s
            assert each.outcome.objective == pytest.approx(force_at(stiffness), rel=1e-4)
            assert (each.outcome.state == "feasible") == (stiffness > optimum)
    assert optimum < best.gains["impedance.K_d[0]"] < 1.02 * optimum
    assert best.outcome.objective == min(each.outcome.objective for each in trials if each.outcome.state == "feasible")
    assert trials[0].gains == {"impedance.K_d[0]": 150.0}
    found = Scenario.load(tmp_path / "out" / FOUND)
    assert found.impedance.K_d[0] == best.gains["impedance.K_d[0]"]
    assert simulate(found, engine="free_body").push[-1] == pytest.approx(best.outcome.objective, rel=1e-4)


def test_the_result_is_the_same_for_any_number_of_workers_and_after_an_interruption(whole, tuning_file, tmp_path):
    tuning = Tuning.load(tuning_file(duration=0.5))

    def give_up(done, total, best):
        if done == 5:
            raise KeyboardInterrupt

    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        tuning.run(out, workers=2, progress=give_up)
    assert len(tuning.trials(out)) == 5
    with (out / JOURNAL).open("ab") as journal:
        journal.write(b'{"op_code": 4, "worker')  # as a killed process leaves it
    tuning.run(out, workers=2)
    same(whole, out)
    assert (whole / FOUND).read_bytes() == (out / FOUND).read_bytes()


def test_more_trials_go_on_with_a_search(whole, tuning_file, tmp_path):
    path = tuning_file(duration=0.5)
    for trials in (7, 12):
        Tuning.load(path, {"tune.trials": trials}).run(tmp_path / "out", executor=HERE)
    same(whole, tmp_path / "out")


@pytest.mark.slow
def test_a_killed_search_loses_the_trial_in_hand_alone(whole, tuning_file, tmp_path):
    path, out = tuning_file(duration=0.5), tmp_path / "out"
    for trials in (3, 8):
        process = started("tune", path, "--out", out, "-j", "1", "-q", cwd=tmp_path)
        while process.is_alive() and (not (out / JOURNAL).exists() or lines(out) < trials):
            time.sleep(0.005)
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGKILL)
        process.join()
        assert lines(out) >= trials
    Tuning.load(path).run(out, executor=HERE)
    same(whole, out)


def lines(folder):
    """Number of trials in a journal: its first line is the search."""
    return (folder / JOURNAL).read_bytes().count(b"\n") - 1


def test_a_trial_without_all_its_numbers_is_incomplete_and_kept(tuning_file, tmp_path):
    (tmp_path / "metrics.py").write_text(METRICS)
    text = tuning_text(duration=0.05, trials=25).replace("contact.final_N", "metrics.py:gap")
    path = tuning_file()
    path.write_text(text)
    tuning = Tuning.load(path)
    tuning.run(tmp_path / "out", executor=HERE)
    trials = tuning.trials(tmp_path / "out")
    assert len(trials) == 25
    for each in trials:
        stiffness, found = each.gains["impedance.K_d[0]"], each.outcome
        if stiffness > 300.0:
            assert (found.state, found.objective, found.completed) == ("incomplete", None, 0)
            assert "2 of 2 runs did not complete, e.g. failed: ValueError: too stiff" in found.message
        elif stiffness < 100.0:
            assert (found.state, found.completed) == ("incomplete", 2)
            assert "has no value in 2 of 2 runs" in found.message
        else:
            assert (found.state, found.objective) == ("feasible", pytest.approx(abs(stiffness - 200.0)))
    assert {each.outcome.state for each in trials} == {"feasible", "incomplete"}
    assert tuning.best(tmp_path / "out").outcome.objective < 10.0


@pytest.mark.slow
def test_the_engines_are_compared_for_what_was_found(tuning_file, tmp_path):
    tuning = Tuning.load(tuning_file(trials=3, duration=0.5, engine="auto"))
    tuning.run(tmp_path / "out", executor=HERE)
    best = tuning.best(tmp_path / "out")
    study = tuning.study_of(tmp_path / "out", best)
    assert study.check["within"].all()
    assert set(study.check["index"]) == {0, 1}
    assert study.frame["contact.final_N"].mean() == pytest.approx(best.outcome.objective, rel=1e-12)


def test_a_folder_of_another_tuning_is_refused(whole, tuning_file):
    path = tuning_file(duration=0.5)
    path.write_text(path.read_text().replace("high = 400.0", "high = 500.0"))
    other = Tuning.load(path, {"tune.seed": 2})
    with pytest.raises(InputError, match=r"differs in gain\[0\]\.high, tune\.seed; choose another folder"):
        other.run(whole, executor=HERE)


@pytest.mark.parametrize("name", ["search", "optuna", "vehicles"])
def test_a_tuning_goes_on_with_the_same_code_alone(whole, tuning_file, tmp_path, name):
    folder = tmp_path / "out"
    shutil.copytree(whole, folder)
    about = json.loads((folder / VERSION).read_text())
    about["code"][name] = "0.0"
    (folder / VERSION).write_text(json.dumps(about))
    with pytest.raises(InputError, match=rf"begun with other code: {name} 0\.0 then, [\w.]+ now"):
        Tuning.load(tuning_file(duration=0.5)).run(folder, executor=HERE)


def test_fewer_trials_than_are_done_are_refused(whole, tuning_file):
    before = (whole / "tune.toml").read_text()
    with pytest.raises(InputError, match=r"tune.trials: 2, and .* has 12 already"):
        Tuning.load(tuning_file(duration=0.5), {"tune.trials": 2}).run(whole, executor=HERE)
    assert (whole / "tune.toml").read_text() == before


def test_a_tuning_does_not_begin_in_the_folder_of_a_study(tuning_file, tmp_path):
    tuning = Tuning.load(tuning_file(duration=0.5))
    Study(tuning.plan).run(tmp_path / "out", executor=HERE)
    with pytest.raises(InputError, match=r"has the results of a study; choose another folder"):
        tuning.run(tmp_path / "out", executor=HERE)


def test_a_study_does_not_begin_in_the_folder_of_a_tuning(whole, tuning_file):
    study = Study(Tuning.load(tuning_file(duration=0.5)).plan)
    with pytest.raises(InputError, match=r"has the results of a tuning; choose another folder"):
        study.run(whole, executor=HERE)


def test_every_error_of_a_file_is_reported_at_once(tuning_file):
    path = tuning_file()
    path.write_text("""
laws = ["impedance", "gsta"]
[base]
scenario = "push_wall"
wall.stiffnes = 1.0
[design]
runs = 2
[[vary]]
key = "wall.damping"
low = 0.0
[[gain]]
key = "impedance.K_d"
low = 1.0
high = 2.0
[[gain]]
key = "controller.k_9"
low = 1.0
high = 2.0
[[gain]]
key = "wall.damping"
low = 1.0
high = 2.0
[[gain]]
key = "impedance.damping_ratio"
low = 2.0
high = 1.0
[[gain]]
key = "wall.position"
low = 2.0
high = 3.0
[objective]
metric = "contact.peak"
over = "quantile"
[[constraint]]
metric = "final.position_m"
at_most = 1.0
[[constraint]]
metric = "contact.peak_N"
[tune]
trial = 3
""")
    with pytest.raises(InputError) as raised:
        Tuning.load(path)
    keys = [fault.key for fault in raised.value.faults]
    for key in ("base.wall.stiffnes", "vary[0]", "gain[0].key", "gain[1].key", "gain[2]", "gain[3].low", "gain[4]"):
        assert key in keys, (key, keys)
    for key in ("objective.q", "constraint[0].metric", "constraint[1]", "tune.trial"):
        assert key in keys, (key, keys)
    text = str(raised.value)
    assert "did you mean 'trials'?" in text
    assert "give one gain for each that is tuned, impedance.K_d[0]" in text
    assert "wall.position is 1 in the file, outside low to high, 2 to 3" in text


@pytest.mark.slow
def test_a_key_of_a_list_is_tuned(tuning_file, tmp_path):
    """A wall of a list, and an effect of a user's own: the search begins with their values."""
    path = tuning_file(duration=0.05)
    (tmp_path / "drag.py").write_text(DRAG)
    lists = {"drag": [{"forward": [20.0, 1.0, 1.0]}], "effects": [{"name": f"{tmp_path / 'drag.py'}:Drag", "k": 100.0}]}
    scenario = Scenario.load("push_wall", lists)
    (tmp_path / "base.toml").write_text(scenario.to_toml())
    text = path.read_text().replace('scenario = "push_wall"', 'scenario = "base.toml"')
    path.write_text(text.replace("impedance.K_d[0]", "effects[0].k"))
    tuning = Tuning.load(path, {"tune.trials": 2})
    tuning.run(tmp_path / "out", executor=HERE)
    first, second = tuning.trials(tmp_path / "out")
    assert first.gains == {"effects[0].k": 100.0}
    assert 50.0 <= second.gains["effects[0].k"] <= 400.0
    path.write_text(text.replace("impedance.K_d[0]", "drag[0].forward[0]").replace("low = 50.0", "low = 10.0"))
    assert Tuning.load(path).start == {"drag[0].forward[0]": 20.0}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[objective]", "[objectives]", "objective: lacks this table"),
        ("impedance.K_d[0]", "impedance.K_d[7]", "impedance.K_d has 6 components"),
        ("impedance.K_d[0]", "vehicle.added_mass", "vehicle.added_mass is varied or tuned already"),
        ("impedance.K_d[0]", "vehicle.model", "only numbers can be tuned"),
        ("impedance.K_d[0]", "wall.tangential_stiffness", "has no value in the base scenario"),
        ("low = 50.0", "low = -50.0", "must be greater than 0 for a logarithm"),
        ('metric = "contact.final_N"', 'metric = "contact.final"', "did you mean 'contact.final_N'?"),
        ('"impedance"', '"inertia"', "controller.name"),
        ("trials = 12", "trials = 0", "tune.trials: 0 must be at least 1"),
        ("trials = 12", 'sampler = "cma"', "tune.sampler: 'cma' must be 'tpe' or 'random'"),
    ],
)
def test_an_error_has_its_place_and_what_would_be_right(tuning_file, old, new, said):
    path = tuning_file()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError) as raised:
        Tuning.load(path)
    assert said in str(raised.value)
