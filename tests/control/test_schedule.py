"""The schedule of K_f and F_d: a hybrid of force and motion over time."""

import numpy as np
import pytest

from uvms_mj import InputError, McapLog, Scenario, Simulation, Trace, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.analysis.residual import impedance_error
from uvms_mj.control.design import demanded_force
from uvms_mj.guidance import AlongWall

PUSHES = [
    {"time": 8.0, "K_f": [2.0] + [1.0] * 5, "F_d": [-2.0] + [0.0] * 5, "ramp": 2.0},
    {"time": 14.0, "F_d": [-4.0] + [0.0] * 5},
]


def scenario_of(schedule=PUSHES, **more):
    overrides = {"impedance.schedule": schedule, "simulation.timestep": 1e-3, "wall.stiffness": 1e4}
    overrides |= {"current.speed": 0.2, "simulation.duration": 24.0}
    if more.get("controller.name") != "ideal":
        overrides |= {"controller.k_1": 1.0, "controller.k_2": 1.0}
    return Scenario.load("push_wall", overrides | more)


def test_each_entry_is_reached_on_a_smooth_ramp_and_recorded(tmp_path):
    scenario = scenario_of()
    trace = simulate(scenario, log_rate=100, engine="free_body", sinks=[McapLog(tmp_path / "run.mcap")])
    t, K_x, F_x = trace.t, trace.K_f[:, 0], trace.F_d[:, 0]
    assert (K_x[t < 8.0] == 1.0).all()
    assert (K_x[t >= 10.0] == 2.0).all()
    assert (F_x[(t >= 10.0) & (t < 14.0)] == -2.0).all()
    assert (F_x[t >= 14.0] == -4.0).all()
    x = (t[(t >= 8.0) & (t < 10.0)] - 8.0) / 2.0
    assert np.allclose(F_x[(t >= 8.0) & (t < 10.0)], -2.0 * (10.0 * x**3 - 15.0 * x**4 + 6.0 * x**5), atol=1e-13)
    assert np.abs(np.diff(K_x, 2)).max() < 2e-4  # h^2 times the second derivative, at most 5.8/4
    loaded = Trace.load(tmp_path / "run.mcap")
    assert np.array_equal(loaded.K_f, trace.K_f)
    assert loaded.scenario == scenario


def test_the_vehicle_rests_at_the_closed_form_of_the_last_entry():
    trace = simulate(scenario_of(), log_rate=100, engine="free_body")
    phases = [{}, {"impedance.K_f": PUSHES[0]["K_f"], "impedance.F_d": PUSHES[0]["F_d"]}]
    phases.append(phases[1] | {"impedance.F_d": PUSHES[1]["F_d"]})
    forces = [demanded_force(scenario_of([], **phase)) for phase in phases]
    assert demanded_force(scenario_of()) == forces[2]
    assert trace.analytic.force == pytest.approx(forces[2], rel=1e-9)
    force, settled = final_force(trace)
    assert settled
    assert force == pytest.approx(forces[2], rel=1e-4)
    for t, wanted in ((7.9, forces[0]), (13.9, forces[1])):
        at = round(100 * t)
        assert trace.push[at] == pytest.approx(wanted, rel=2e-2)


def test_without_a_schedule_nothing_is_added_and_an_entry_with_the_same_values_changes_nothing():
    none = simulate(scenario_of([]), log_rate=100, engine="free_body")
    same = simulate(scenario_of([{"time": 1.0, "ramp": 5.0}]), log_rate=100, engine="free_body")
    assert "K_f" not in none.header.by_name
    assert np.array_equal(none.tau, same.tau)


def test_the_ideal_law_has_the_impedance_of_the_schedule_at_each_instant():
    """The residual of eq. (7) with K_f and F_d over time is of the order of the step."""
    ideal = {"controller.name": "ideal", "simulation.duration": 15.0}
    trace = simulate(scenario_of(**ideal), log_rate="full", engine="free_body")
    left = impedance_error(trace, 7.5, 12.0)
    assert left[0] < 2e-3  # of forces of newtons


def test_an_entry_may_begin_where_the_one_before_it_ends():
    """0.1 + 0.2 is above 0.3 by rounding."""
    schedule = [{"time": 0.1, "ramp": 0.2}, {"time": 0.3, "F_d": [-1.0] + [0.0] * 5}]
    assert [change.time for change in scenario_of(schedule).impedance.schedule] == [0.1, 0.3]


def test_reset_changes_the_entries():
    with Simulation(scenario_of(), engine="free_body") as sim:
        sim.step(9000)
        assert sim.signals.K_f[0] > 1.0
        sim.reset(overrides={"impedance.schedule": [{"time": 0.1, "K_f": [0.5] * 6}]})
        sim.step(50)
        assert (sim.signals.K_f == 1.0).all()
        sim.step(100)
        assert (sim.signals.K_f == 0.5).all()
        with pytest.raises(InputError, match=r"impedance.schedule: reset can't add or remove"):
            sim.reset(overrides={"impedance.schedule": []})


def test_a_path_along_the_wall_keeps_the_push_that_it_is_given():
    """Position in the plane, force along the normal: 4 N at rest and on the way, without a current."""
    overrides = {"reference.name": "along_wall", "reference.push": 4.0, "reference.points": [[0.3, 0.1]]}
    overrides |= {"reference.dwell": 8.0, "simulation.duration": 26.0, "current.speed": 0.0, "controller.k_2": 2.0}
    overrides |= {"impedance.K_f": [2.0] + [1.0] * 5, "impedance.F_d": [-1.0] + [0.0] * 5}
    scenario = scenario_of([], **overrides)
    assert isinstance(scenario.reference, AlongWall)
    assert demanded_force(scenario) == pytest.approx(4.0, rel=1e-12)
    trace = simulate(scenario, log_rate=100, engine="free_body")
    assert final_force(trace)[0] == pytest.approx(4.0, rel=1e-4)
    assert trace.analytic.force == pytest.approx(4.0, rel=1e-9)
    moving = np.linalg.norm(trace.p_d_dot[:, 1:], axis=1) > 1e-6
    moving &= trace.t > 12.0
    assert moving.sum() > 200
    assert np.abs(trace.push[moving] - 4.0).max() < 0.02
    assert np.linalg.norm((trace.p_WB - trace.p_d)[moving, 1:], axis=1).max() < 2e-3
