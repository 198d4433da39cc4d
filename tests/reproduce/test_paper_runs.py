"""The study's runs: their plan, their logs, an interrupt, and logs of other runs."""

import functools

import pytest

from uvms_mj import InputError, Scenario, Trace, simulate
from uvms_mj.records.mcap import McapLog
from uvms_mj.reproduce.paper import runs as study


def test_a_study_that_is_stopped_ends_its_logs(tmp_path):
    """An exception raised by progress, e.g. by Ctrl-C, stops all runs. Their logs can be read."""
    jobs = {name: Scenario.load("push_wall", {"simulation.duration": 1000.0}) for name in ("a", "b", "c")}

    def interrupt(done, total):
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        study.run(jobs, tmp_path, interrupt, workers=2)
    assert {Trace.load(path).status.name for path in tmp_path.glob("*.mcap")} == {"interrupted"}
    assert not (tmp_path / "c.mcap").exists()


def test_a_study_needs_its_logs_whole(tmp_path):
    with pytest.raises(ValueError, match=r"missing logs: impedance\.mcap"):
        study.load(tmp_path, ["impedance"])
    log = McapLog(tmp_path / "impedance.mcap")

    def stop(done, total):
        raise KeyboardInterrupt

    simulate(Scenario.load("push_wall", {"simulation.duration": 0.1}), sinks=[log], progress=stop)
    with pytest.raises(ValueError, match="incomplete logs"):
        study.load(tmp_path, ["impedance"])


@pytest.mark.slow
def test_a_log_of_another_run_than_its_name_says_is_refused(tmp_path, monkeypatch):
    read_once = functools.cache(Trace.load)
    monkeypatch.setattr(Trace, "load", lambda path: read_once(path.resolve()))  # the folders are of links
    jobs = study.plan(Scenario.load("push_wall", {"simulation.duration": 0.02, "controller.k_1": 8.0}))
    (tmp_path / "logs").mkdir()
    study.run(jobs, tmp_path / "logs", lambda done, total: None)
    assert study.load(tmp_path / "logs", jobs).traces["gsta_alone"].scenario == jobs["gsta_alone"]
    longer = Scenario.load("push_wall", {"simulation.duration": 0.03, "controller.k_1": 8.0}, "gsta")
    simulate(longer, sinks=[McapLog(tmp_path / "longer.mcap")])
    names = list(study.RUNS)
    exchanged = [(a, tmp_path / "logs" / f"{b}.mcap") for a, b in zip(names, names[1:] + names[:1], strict=True)]
    variation = tmp_path / "logs" / "sweep_impedance_still.mcap"
    for i, (name, other) in enumerate([*exchanged[2:], ("gsta", tmp_path / "longer.mcap"), ("impedance", variation)]):
        folder = tmp_path / f"{i}"
        folder.mkdir()
        for log in (tmp_path / "logs").iterdir():
            (folder / log.name).symlink_to(other if log.stem == name else log)
        with pytest.raises(ValueError, match=rf"{name}\.mcap: contains a run of"):
            study.load(folder, jobs)


def test_gains_of_one_law_are_for_its_runs_alone():
    plan = study.plan(Scenario(), {"fosm": {"controller.K_s": 24.0}, "gsta": {"controller.k_1": 8.0}})
    for name, scenario in plan.items():
        law = scenario.controller
        assert getattr(law, "K_s", 24.0) == (48.0 if name == "sweep_fosm_double_K_s" else 24.0), name
        assert getattr(law, "k_1", 8.0) == 8.0, name
    assert [plan[name].controller.nominal for name in ("gsta", "gsta_alone")] == [True, False]
    with pytest.raises(InputError, match="fosm has no such gain"):
        study.plan(Scenario(), {"fosm": {"controller.k_1": 1.0}})


def test_gains_of_a_scenario_stay_with_their_law():
    plan = study.plan(Scenario.load("push_wall", {"controller.k_1": 8.0, "wall.stiffness": 2e4}))
    assert [plan[name].controller.k_1 for name in ("gsta", "gsta_alone", "sweep_gsta_quarter_step")] == [8.0] * 3
    assert plan["gsta"].controller.nominal
    assert not plan["gsta_alone_fine"].controller.nominal
    assert {each.wall.stiffness for each in plan.values()} == {2e4}
    assert plan["sweep_fosm_half_epsilon"].controller.epsilon == 0.5 * plan["fosm"].controller.epsilon
