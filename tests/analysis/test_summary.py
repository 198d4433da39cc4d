"""The numbers of a run: each has a unit, and is the same whether a run keeps all of its rows or the last ones."""

import re

import numpy as np
import pytest

from uvms_mj import Scenario, simulate
from uvms_mj.analysis.metrics import AROUND_THE_END_S
from uvms_mj.analysis.summary import COURSES, NUMBERS, summary
from uvms_mj.studies.plan.metrics import METRICS, unit_of_column, without_unit


def test_every_metric_has_a_meaning_and_one_unit():
    for name, each in METRICS.items():
        assert each.meaning, name
        unit = unit_of_column(name)
        if each.kind is float:
            assert bool(unit) != bool(re.search(r" \[.+\]", each.meaning)), name
            assert not re.search(r"_[A-Z]", without_unit(name)), f"{name}: {unit} is a part of a unit that nobody knows"
        else:
            assert not unit, name


def test_numbers_that_do_not_need_the_whole_run_are_those_of_its_end():
    pressing = {"impedance.F_d": [-10.0, 0.0, 0.0, 0.0, 0.0, 0.0], "simulation.duration": 20.0}
    for noise, different in (
        ({}, {"contact.settling_s"}),
        ({"navigation.name": "sensors", "navigation.force_noise": 0.5}, {"contact.settling_s", "noise.push_N"}),
    ):
        scenario = Scenario.load("push_wall", pressing | noise)
        whole, end = (simulate(scenario, engine="free_body", keep_s=keep) for keep in (None, AROUND_THE_END_S))
        assert end.t[0] >= 11.0
        for name, each in NUMBERS.items():
            if not each.of_whole_run and name not in ("wall_time_s", "real_time_factor"):
                assert each.of(whole) == each.of(end), name
        assert different == {
            name for name, each in NUMBERS.items() if each.of_whole_run and each.of(whole) != each.of(end)
        } - set(COURSES)


@pytest.mark.parametrize("engine", ["mujoco", "free_body"])
def test_each_thruster_counts_the_steps_with_its_command_at_a_limit(engine):
    """Against the recorded thrusts of every step, which are the commands of ideal thrusters. The run's own time counts
    the steps with any of them there."""
    keys = {
        "reference.target": [3.0, 0.0, 0.0],
        "wall.present": False,
        "simulation.duration": 3.0,
        "vehicle.model": "bluerov2",
    }
    keys |= {"simulation.timestep": 1e-3, "impedance.K_d": [300.0] * 3 + [100.0] * 3, "reference.step_time": 0.0}
    trace = simulate(Scenario.load("push_wall", keys), engine=engine, log_rate="full")
    u, h = trace.u[:-1], 1e-3
    vehicle = trace.header.mjcf.vehicle
    times = trace.thruster_saturation_time[-1]
    limited = times > 0.0
    assert limited.any()
    assert not limited.all()
    at = (u <= vehicle.u_min) | (u >= vehicle.u_max)
    np.testing.assert_allclose(times, h * at.sum(axis=0), atol=1e-9)
    assert trace.saturation_time[-1] == pytest.approx(h * at.any(axis=1).sum(), abs=1e-9)
    named = summary(trace, {})["saturated_thrusters_s"]
    assert list(named) == list(vehicle.thrusters)
    assert list(named.values()) == pytest.approx(times.tolist(), abs=1e-9)
