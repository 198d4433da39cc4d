"""Rest with real thrusters: closed forms against runs, and the reasons where there is none."""

import re

import numpy as np
import pytest

from uvms_mj import Scenario, simulate
from uvms_mj.control.base import NoClosedForm, SteadyState
from uvms_mj.control.theory.loop import ForceAge
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.setup.base import set_up

SOFT = {
    "wall.stiffness": 2e3,
    "wall.damping": 50.0,
    "simulation.timestep": 1e-3,
    "simulation.duration": 30.0,
    "current.speed": 0.2,
}
SHAPED = {"impedance.M_d": [20.0] * 3 + [2.0] * 3}
PUSHING = SOFT | {"reference.target": [1.3, 0.0, 0.0]}
STRONG = {"curve_command": [-20.0, -2.0, 2.0, 30.0], "curve_thrust": [-60.0, 0.0, 0.0, 90.0]}
CURVE = {"curve_command": [-2.0, -1.0, 1.0, 3.0], "curve_thrust": [-10.0, 0.0, 0.0, 20.0]}


def scenario_with(law: str, name: str, overrides, **settings) -> Scenario:
    tables = {"thrusters.name": name} | {f"thrusters.{key}": value for key, value in settings.items()}
    return Scenario.load("push_wall", overrides | tables, law)


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["bluerov1", "bluerov2_heavy"])
@pytest.mark.parametrize(
    ("law", "own", "settings"),
    [
        ("impedance", {}, {"efficiency": 0.8}),
        ("impedance", {"actuation.name": "constrained"}, {"efficiency": 0.9, "assumed_efficiency": 0.7, **STRONG}),
        ("impedance", {"actuation.name": "weighted"}, {"failed": 1, "failed_fraction": 0.7}),
        ("impedance", {}, {"lag": "third_order", "rate_limit": 300.0}),
        ("fosm", {"controller.epsilon": 5e-2}, {"efficiency": 0.7, "lag": "first_order", "time_constant": 0.004}),
        ("ideal", {}, {"efficiency": 0.8}),
        ("ideal", {"observer.name": "momentum_observer", "observer.threshold": 0.0, **SHAPED}, {"efficiency": 0.8}),
    ],
)
def test_a_law_without_an_integral_term_rests_where_the_gain_of_the_thrusters_says(vehicle, law, own, settings):
    """Within 1e-6 of the force, which differs from that of ideal thrusters where the gain does."""
    overrides = PUSHING | own | {"vehicle.model": vehicle}
    trace = simulate(scenario_with(law, "general", overrides, **settings), log_rate=100, engine="free_body")
    assert isinstance(trace.analytic, SteadyState), trace.analytic
    assert trace.push[-1] == pytest.approx(trace.analytic.force, rel=1e-6)
    assert trace.p_WB[-1] == pytest.approx(trace.analytic.position, abs=1e-6)
    ideal = steady_state(set_up(Scenario.load("push_wall", overrides, law)))
    differs = "efficiency" in settings or "failed" in settings
    assert (abs(trace.analytic.force / ideal.force - 1.0) > 1e-3) == differs


@pytest.mark.parametrize(
    ("vehicle", "name", "settings"),
    [
        ("bluerov1", "general", {"efficiency": 0.7}),
        ("bluerov2_heavy", "general", {"failed": 1}),
        ("bluerov2_heavy", "t200", {"voltage": 13.0, "assumed_voltage": 16.0, "lag": "none", "quantum": 0.0}),
        ("bluerov2_heavy", "t200", {"efficiency": 0.8, "lag": "none"}),
    ],
)
def test_super_twisting_rejects_the_errors_of_thrusters(vehicle, name, settings):
    """A gain, a dead thruster among eight, another voltage, quantisation: the rest force is that of ideal thrusters."""
    overrides = SOFT | {"vehicle.model": vehicle}
    trace = simulate(scenario_with("gsta", name, overrides, **settings), log_rate=100, engine="free_body")
    ideal = steady_state(set_up(Scenario.load("push_wall", overrides)))
    assert trace.analytic.force == pytest.approx(ideal.force, rel=1e-12)
    rest = trace.push[trace.t > 25.0]
    assert rest.mean() == pytest.approx(ideal.force, rel=5e-4)


@pytest.mark.parametrize(
    ("law", "name", "overrides", "settings", "said"),
    [
        (
            "gsta",
            "t200",
            {"impedance.F_d": [-80.0, 0.0, 0.0, 0.0, 0.0, 0.0]},
            {"voltage": 10.0},
            r"^the thrusters are too weak: surge_left needs 3\d.* N at rest and has 28.73 N; surge_right needs",
        ),
        (
            "gsta",
            "t200",
            {"impedance.F_d": [-80.0, 0.0, 0.0, 0.0, 0.0, 0.0]},
            {"voltage": 10.0, "assumed_voltage": 12.0, "efficiency": 0.5},
            r"surge_left needs 3\d.* N at rest and has 14.37 N",
        ),
        (
            "gsta",
            "general",
            {},
            {"dead_band": 1.0},
            r"^the dead band of the thrusters: .* N at rest and starts at -?1 N",
        ),
        ("gsta", "general", {}, {"failed": 2, "failed_stuck": True}, "a thruster is stuck"),
        ("gsta", "general", {}, {"failed": 2}, "the thrusters can't produce every wrench"),
        ("gsta", "general", {}, {"inflow_loss": 1.0}, "the current costs thrust"),
        ("impedance", "t200", {}, {}, "the command of the thrusters is quantised, and the law does not integrate"),
        ("ideal", "t200", {}, {"lag": "none"}, "is quantised, and the law does not integrate"),
        (
            "impedance",
            "t200",
            {},
            {"voltage": 12.0, "assumed_voltage": 16.0},
            "differs from the control system's",
        ),
        ("impedance", "general", {}, {"inverted": False, **CURVE}, "differs from the control system's"),
    ],
)
def test_the_reason_is_said_where_there_is_no_closed_form(law, name, overrides, settings, said):
    found = steady_state(set_up(scenario_with(law, name, SOFT | overrides, **settings)))
    assert isinstance(found, NoClosedForm)
    assert re.search(said, found.reason), found.reason


def test_limits_of_the_vehicles_file_are_said_too():
    """The ideal thrusters of the Heavy have those of its file."""
    heavy = {"vehicle.model": "bluerov2_heavy", "impedance.F_d": [-2000.0, 0.0, 0.0, 0.0, 0.0, 0.0]}
    setup = set_up(Scenario.load("push_wall", SOFT | heavy))
    assert np.isfinite(setup.vehicle.u_max).all()
    found = steady_state(setup)
    assert isinstance(found, NoClosedForm)
    assert f"N at rest and has {setup.vehicle.u_max[0]:.4g} N" in found.reason


def test_a_failure_after_the_end_of_the_run_is_none():
    late = {"failed": 1, "failed_at": 31.0, "failed_stuck": True}
    assert isinstance(steady_state(set_up(scenario_with("gsta", "general", SOFT, **late))), SteadyState)


@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
@pytest.mark.parametrize(("stiffness", "rests"), [(2e3, True), (1e5, False)])
def test_the_identified_lag_is_for_a_soft_wall_and_a_run_against_a_stiff_one_is_warned_of(stiffness, rests):
    overrides = SOFT | {"wall.stiffness": stiffness, "wall.damping": 0.0, "simulation.timestep": 2e-4}
    overrides |= {"current.speed": 0.0, "simulation.duration": 15.0}
    trace = simulate(scenario_with("gsta", "t200", overrides), log_rate=100, engine="free_body")
    assert (np.ptp(trace.push[trace.t > 12.0]) < 1.0) == rests
    assert rests or trace.notes


@pytest.mark.parametrize(("lag", "delay"), [("first_order", 0.004), ("third_order", (9258.0 - 6136.0) / 108700.0)])
def test_a_lag_is_an_age_of_the_force_in_the_thrust(lag, delay):
    ages = []
    for name in ("none", lag):
        setup = set_up(scenario_with("impedance", "general", SOFT, lag=name, time_constant=0.004))
        ages.append(ForceAge.of(setup, setup.design.M_hat).age)
    assert ages[1] - ages[0] == pytest.approx(delay, rel=1e-12)


def test_the_hold_of_the_thrusters_ages_the_force():
    overrides = SOFT | {"controller.period": 6e-3, "thrusters.period": 4e-3}
    setup = set_up(scenario_with("impedance", "general", overrides))
    assert ForceAge.of(setup, setup.design.M_hat).age == pytest.approx(_mean_age(6, 4) * 1e-3)


def _mean_age(control: int, thrusters: int) -> float:
    """Mean age [steps] of a command that is held over a control period and read at the thrusters' instants."""
    ages = []
    for step in range(24 * control * thrusters):
        read = step - step % thrusters
        ages.append(step - (read - read % control))
    return float(np.mean(ages))
