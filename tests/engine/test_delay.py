"""The computation delay: the command of t_k acts from t_k + controller.delay on, exact to the step."""

import numpy as np
import pytest

from uvms_mj import InputError, McapLog, Scenario, Simulation, Trace, simulate

SHORT = {"simulation.timestep": 1e-3, "simulation.duration": 0.4, "reference.step_time": 0.05}


def run(**more):
    return simulate(Scenario.load("push_wall", SHORT | more), log_rate="full", engine="free_body")


@pytest.mark.parametrize(("steps", "period"), [(0, 1), (3, 1), (3, 10), (25, 10), (40, 10), (200, 7)])
def test_the_actuation_gets_the_command_of_so_many_steps_ago(steps, period):
    """Also for delays that are shorter or longer than the control period, and no multiples of it."""
    trace = run(**{"controller.delay": steps * 1e-3, "controller.period": period * 1e-3})
    assert not trace.tau_cmd_delayed[:steps].any()
    assert np.array_equal(trace.tau_cmd_delayed[steps:], trace.tau_cmd[: len(trace.t) - steps])
    inside = np.abs(trace.u).max() < 40.0
    assert not inside or np.allclose(trace.tau[:-1], trace.tau_cmd_delayed[:-1], atol=1e-9)
    assert np.abs(trace.tau_cmd[-1]).max() > 0.1


def test_a_delay_of_zero_is_no_delay():
    without, zero = run(), run(**{"controller.delay": 0.0})
    assert "tau_cmd_delayed" not in without.header.by_name
    assert np.array_equal(without.p_WB, zero.p_WB)
    assert np.array_equal(without.tau_cmd, zero.tau_cmd_delayed)


def test_a_delay_changes_by_a_reset_alone_and_neither_comes_nor_goes():
    with Simulation(Scenario.load("push_wall", SHORT | {"controller.delay": 0.0}), engine="free_body") as sim:
        sim.reset(overrides={"controller.delay": 0.02})
        sim.step(19)
        assert not sim.signals.tau.any()  # the queue is empty
        with pytest.raises(InputError, match=r"controller.delay: can't change during a run"):
            sim.set({"controller.delay": 0.01})
    with (
        Simulation(Scenario.load("push_wall", SHORT), engine="free_body") as sim,
        pytest.raises(InputError, match=r"controller.delay: reset can't add or remove the delay"),
    ):
        sim.reset(overrides={"controller.delay": 0.02})


def test_a_command_from_outside_is_delayed_too():
    outside = {"controller.name": "external", "controller.delay": 0.005}
    with Simulation(Scenario.load("push_wall", SHORT | outside), engine="free_body") as sim:
        sim.tau_cmd[0] = 3.0
        sim.step(5)
        assert sim.signals.tau[0] == 0.0
        sim.tau_cmd[0] = 4.0
        sim.step(1)
        assert sim.signals.tau[0] == pytest.approx(3.0, abs=1e-9)
        assert sim.signals.tau_cmd[0] == 4.0
        sim.step(5)
        assert sim.signals.tau[0] == pytest.approx(4.0, abs=1e-9)


def test_both_commands_are_in_the_log(tmp_path):
    scenario = Scenario.load("push_wall", SHORT | {"controller.delay": 0.01})
    trace = simulate(scenario, sinks=[McapLog(tmp_path / "run.mcap")], engine="free_body")
    loaded = Trace.load(tmp_path / "run.mcap")
    for name in ("tau_cmd", "tau_cmd_delayed"):
        assert np.array_equal(loaded[name], trace[name])
    assert loaded.scenario.controller.delay == 0.01


def test_each_stage_has_the_period_of_the_table_on_the_page_and_those_beside_it_follow():
    """``sampling.md``: what measures runs with the law or at every step, what acts at every step."""
    own = {
        "controller.period": 0.01,
        "controller.delay": 0.004,
        "navigation.name": "sensors",
        "thrusters.period": 0.002,
    }
    own |= {"observer.name": "momentum_observer", "vehicle.model": "bluerov2_heavy", "thrusters.name": "t200"}
    with Simulation(Scenario.load("push_wall", SHORT | own), engine="free_body") as sim:
        found = dict(zip(sim._stages.stages, sim._stages.rows["period_steps"].tolist(), strict=True))
    before = {"navigation": 1, "sensed": 1, "model": 10, "reference": 10, "tracking": 10, "observer": 10, "task": 10}
    behind = {"controller": 10, "delay": 2, "actuation": 1, "inflow": 2, "thrusters": 2}
    assert found == before | behind
    assert [*found] == [*before, *behind]
