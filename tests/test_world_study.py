"""Studies and tunings of worlds: keys and metrics of each vehicle, and the same rows by any way."""

import os
import signal
import time

import pytest
from click.testing import CliRunner
from pandas.testing import assert_frame_equal

from forked import ended, started
from short_study import HERE
from uvms_mj import InputError, Scenario, Study, Trace, World
from uvms_mj.cli import main
from uvms_mj.envs.domain import domain_of
from uvms_mj.studies.plan.metrics import METRICS, parted, unit_of_column
from uvms_mj.studies.plan.places import overlap, sets_in_vain
from uvms_mj.studies.tune import Tuning

METRIC = """
import numpy as np


def apart(traces):
    gap = traces["left"].p_WB - traces["right"].p_WB
    return float(np.linalg.norm(gap, axis=1).min())
"""
STUDY = """
name = "two"
[base]
scenario = "press_together"
simulation.duration = 0.06
simulation.timestep = 2e-4
"vehicles[0].initial.position" = [0.995, 0.4, 0.0]
"vehicles[1].initial.position" = [0.995, -0.4, 0.0]
initial.velocity = [0.2, 0.0, 0.0, 0.0, 0.0, 0.0]
[design]
runs = {runs}
seed = 7
[keep]
metrics = ["contact.peak_N", "right.final.position_m", "contact.settled"{metrics}]
{keep}
[run]
engine = "free_body"
[[vary]]
key = "vehicles[left].controller.k_1"
distribution = "uniform"
low = 4.0
high = 8.0
[[vary]]
key = "wall.stiffness"
distribution = "loguniform"
low = 2e4
high = 2e5
{more}
"""
"""Two vehicles that touch a wall, and no coupling."""


@pytest.fixture
def study_file(tmp_path):
    def write(runs=4, metrics="", keep="", more=""):
        path = tmp_path / "two.toml"
        path.write_text(STUDY.format(runs=runs, metrics=metrics, keep=keep, more=more))
        return path

    return write


def parts(folder):
    return {path.name: path.read_bytes() for path in sorted((folder / "rows").glob("part-*.parquet"))}


@pytest.mark.processes
def test_rows_have_the_same_bytes_for_one_and_two_workers_and_after_kill_9(study_file, tmp_path):
    path = study_file(runs=24)
    one = Study.load(path).run(tmp_path / "one", executor=HERE)
    Study.load(path).run(tmp_path / "two", workers=2)
    process = started("study", str(path), "-o", "killed", "--workers", "1", "-q", cwd=tmp_path)
    until = time.monotonic() + 60.0
    while time.monotonic() < until and len(list(tmp_path.glob("killed/rows/part-*.parquet"))) < 3:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    assert ended(process) == -signal.SIGKILL
    assert 3 <= len(parts(tmp_path / "killed")) < 24
    Study.load(tmp_path / "killed").run(executor=HERE)
    assert len(parts(tmp_path / "one")) == 24
    assert parts(tmp_path / "one") == parts(tmp_path / "two") == parts(tmp_path / "killed")
    assert one.frame["left.contact.peak_N"].nunique() == 24


def test_a_row_of_two_uncoupled_vehicles_has_the_numbers_of_both_single_studies(study_file, tmp_path):
    """The single studies have the same seeds, draws and names of vehicles."""
    both = Study.load(study_file())
    tables = both.plan.tables
    whole = both.run(tmp_path / "both", executor=HERE).frame
    for name, scenario in both.plan.base.scenarios.items():
        own = [each for each in tables["vary"] if name == "left" or "vehicles" not in each["key"]]
        single = {
            "base": scenario.to_dict(),
            "vary": [{**each, "key": each["key"].removeprefix("vehicles[left].")} for each in own],
            "design": tables["design"],
            "keep": {"metrics": ["contact.peak_N", "final.position_m", "contact.settled"]},
            "run": tables["run"],
        }
        if name == "left":  # the draws of an entry follow from its key
            single["vary"][0] = {"key": "controller.k_1", "values": whole["vehicles[left].controller.k_1"].tolist()}
            single["vary"][1] = {"key": "wall.stiffness", "values": whole["wall.stiffness"].tolist()}
            single["vary"] = [
                {
                    "keys": [each["key"] for each in single["vary"]],
                    "values": list(map(list, zip(*(each["values"] for each in single["vary"]), strict=True))),
                }
            ]
            single["design"] = {"seed": 7}
        rows = Study.from_dict(single).run(tmp_path / name, executor=HERE).frame
        kept = [column for column in rows if f"{name}.{column}" in whole]
        assert len(kept) == (2 if name == "left" else 5)
        mine = whole[[f"{name}.{column}" for column in kept]].set_axis(kept, axis="columns")
        assert_frame_equal(mine, rows[kept], check_exact=True)


def test_a_row_is_replayed_and_its_logs_are_kept(study_file, tmp_path):
    """The command repeats a row's run, and its logs are those that the study keeps."""
    (tmp_path / "metric.py").write_text(METRIC)
    path = study_file(runs=2, metrics=', "metric.py:apart"', keep='logs = { kind = "listed", indices = [1] }')
    study = Study.load(path).run(tmp_path / "out", executor=HERE)
    said = ["run", "--from", str(tmp_path / "out"), "--row", "1", "-o", str(tmp_path / "again"), "-q", "--log-rate"]
    assert CliRunner().invoke(main, [*said, "1000"]).exit_code == 0
    row = study.frame.iloc[1]
    kept = {each.name for each in (tmp_path / "out" / "logs").iterdir()}
    assert kept == {"row-00001.left.mcap", "row-00001.right.mcap"}
    traces = {}
    for name in ("left", "right"):
        trace = traces[name] = Trace.load(tmp_path / "again" / f"{name}.mcap")
        log = Trace.load(tmp_path / "out" / "logs" / f"row-00001.{name}.mcap")
        assert trace.rows().tobytes() == log.rows().tobytes()
        assert trace.scenario.wall.stiffness == row["wall.stiffness"]
    assert traces["left"].scenario.controller.k_1 == row["vehicles[left].controller.k_1"]
    assert traces["right"].p_WB[-1].tolist() == [row[f"right.final.position_m.{axis}"] for axis in "xyz"]
    assert 0.75 < row["apart"] < 0.85
    assert study.table()[1] == ("gsta and fosm", "2", "2", "0")


def test_coupled_vehicles_are_in_a_study_and_both_engines_agree(tmp_path):
    tables = {
        "base": {"scenario": "press_bar", "simulation": {"duration": 0.02}},
        "vary": [{"key": "couplings[0].stiffness", "values": [2e3, 4e3]}],
        "keep": {"metrics": ["bar.final.position_m"]},
        "laws": [{"label": "its own"}, {"label": "soft", "vehicles[left].impedance.K_d": [50.0] * 6}],
    }
    study = Study.from_dict(tables).run(tmp_path / "out", executor=HERE)
    assert set(study.frame["status"]) == {"completed"}
    assert study.frame["bar.final.position_m.x"].nunique() == 4
    assert study.check is not None
    assert study.check["within"].all()
    assert {number.partition(".")[0] for number in study.check["number"]} == {"status", "left", "right", "bar"}


def test_a_vehicle_that_diverges_is_named_in_the_row(study_file, tmp_path):
    wild = {"vehicles[right].disturbance.bias": [1e6, 0.0, 0.0, 0.0, 0.0, 0.0]}
    row = Study.load(study_file(runs=1), wild).run(tmp_path / "out", executor=HERE).frame.iloc[0]
    assert row["status"] == "unstable"
    assert row["message"].startswith("right: t = ")
    assert not row["success"]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ({"more": "[[vary]]\nkey = 'vehicles[0].controller.k_1'\nvalues = [1.0]"}, "varies in vary[0] already"),
        ({"more": "[[vary]]\nkey = 'controller.k_1'\nvalues = [1.0]"}, "varies in vary[0] already"),
        ({"more": "[[vary]]\nkey = 'vehicles[lef].controller.k_2'\nvalues = [1.0]"}, "the world has left, right"),
        ({"more": "[[vary]]\nkey = 'vehicles[7].controller.k_2'\nvalues = [1.0]"}, "the world has left, right"),
        ({"more": "[[vary]]\nkey = 'initial.position[0]'\nvalues = [1.0]"}, "of one vehicle it is vehicles[left].init"),
        ({"more": "[[vary]]\nkey = 'vehicles[left].wall.damping'\nvalues = [1.0]"}, "is the world's, for all vehicles"),
        ({"metrics": ", 'lef.contact.final_N'"}, "no vehicle 'lef'; did you mean"),
        ({"metrics": ", 'left.contact.peak_N'"}, "is given twice"),
        ({"metrics": ", 'left.contact.peek_N'"}, "no metric 'left.contact.peek_N'"),
        ({"keep": "logs = { kind = 'worst', metric = 'contact.peak_N' }"}, "is not one of keep.metrics"),
        ({"more": "[success]\ncontact.settled = true"}, "is not one of keep.metrics"),
    ],
)
def test_a_wrong_study_of_a_world_is_refused_by_name(study_file, lines, said):
    with pytest.raises(InputError) as raised:
        assert Study.load(study_file(**lines)).plan
    assert said in str(raised.value)


def test_what_is_of_one_vehicle_refuses_a_world(study_file):
    path = study_file()
    with pytest.raises(InputError, match="a GPU runs one vehicle, and the base is a world"):
        Study.load(path, {"run.engine": "gpu"})
    with pytest.raises(InputError, match="run 0 is of a world of several vehicles"):
        Study.load(path).plan.scenario(0)
    with pytest.raises(InputError, match="is a study of a world; an environment has one vehicle"):
        domain_of(path)
    for key in ("vehicles[left].controller.k_1", "vehicles[0].controller.k_1"):
        with pytest.raises(InputError, match="the base scenario is of one vehicle"):
            Study.from_dict({"base": Scenario().to_dict(), "vary": [{"key": key, "values": [1.0]}]})
    with pytest.raises(InputError, match=r"no vehicle 'left'; the base scenario is of one"):
        Study.from_dict({"base": Scenario().to_dict(), "keep": {"metrics": ["left.contact.peak_N"]}})


def test_a_tuning_finds_a_gain_of_one_vehicle(study_file, tmp_path):
    own = "[[gain]]\nkey = '{}'\nlow = 4.0\nhigh = 12.0\n[objective]\nmetric = '{}'\n[tune]\ntrials = 3\n"
    base = STUDY.partition("[design]")[0]
    path = tmp_path / "tune.toml"
    path.write_text(base + own.format("vehicles[0].controller.k_1", "left.contact.peak_N"))
    tuning = Tuning.load(path)
    tuning.run(tmp_path / "out", executor=HERE)
    trials = tuning.trials(tmp_path / "out")
    assert len({each.outcome.objective for each in trials}) == 3
    found = World.load(tmp_path / "out" / "found.toml")
    best = tuning.best(tmp_path / "out")
    assert found.scenarios["left"].controller.k_1 == best.gains["vehicles[left].controller.k_1"]
    assert found.scenarios["right"].controller == World.load("press_together").scenarios["right"].controller
    path.write_text(base + own.format("controller.k_1", "contact.peak_N"))
    with pytest.raises(InputError) as raised:
        Tuning.load(path)
    assert "objective.metric: name a vehicle: left.contact.peak_N" in str(raised.value)
    assert "gain[0].key: name a vehicle: vehicles[left].controller.k_1" in str(raised.value)


def test_names_of_metrics_and_places_are_of_one_vehicle_at_most():
    """No metric is another one behind a word: the first word of a name is a vehicle, or belongs to the metric."""
    assert all(parted(name) == ("", name) for name in METRICS)
    assert all(parted(f"left_N.{name}") == ("left_N", name) for name in METRICS)
    assert unit_of_column("left_N.contact.settled") == ""
    assert unit_of_column("left_N.final.position_m.x") == "m"
    assert sets_in_vain("vehicles[left].controller.k_1", "controller.k_1")
    assert not sets_in_vain("controller.k_1", "vehicles[left].controller.k_1")
    assert overlap("initial.position", "vehicles[left].initial.position[0]")
    assert not overlap("vehicles[right].initial.position", "vehicles[left].initial.position[0]")
