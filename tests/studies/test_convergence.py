"""Error bars: orders and limits of synthetic sequences, of an impact in closed form, and of runs against finer runs."""

import dataclasses
import math

import numpy as np
import pytest

from uvms_mj import Fosm, Impedance, InputError, Scenario, converge, simulate
from uvms_mj.analysis import residual
from uvms_mj.studies.convergence import Estimate, NotCompletedError, extrapolated, with_error

MASS_ALONE = {
    "current.speed": 0.0,
    "impedance.K_d": [0.0] * 6,
    "impedance.D_d": [0.0] * 6,
    "initial.velocity": [0.3, 0.0, 0.0, 0.0, 0.0, 0.0],
    "reference.target": [0.0, 0.0, 0.0],
    "wall.position": 0.05005,
    "wall.stiffness": 1e4,
    "simulation.timestep": 5e-4,
    "simulation.duration": 0.4,
}
"""Impedance control without spring and damper cancels C, D and g: the plant is then a mass that meets a spring."""


def by_name(found):
    return {each.name: each for each in found.estimates}


@pytest.mark.parametrize("p", [0.6, 1.0, 1.5, 2.0])
@pytest.mark.parametrize(("f_0", "c"), [(17.87, 1200.0), (-3.0, 2e3), (0.0, 50.0)])
def test_a_power_of_the_step_is_extrapolated_exactly(f_0, c, p):
    h = 1e-4
    found = extrapolated("f", tuple(f_0 + c * (h / 2**i) ** p for i in range(3)))
    assert found.order == pytest.approx(p, abs=1e-6)
    assert found.value == pytest.approx(f_0, abs=1e-6 * c * h**p + 1e-14)
    assert found.uncertainty == pytest.approx(1.25 * c * (h / 4) ** p, rel=1e-5)


@pytest.mark.parametrize("p", [0.2, 3.0, 4.0])
def test_an_order_that_the_scheme_can_not_have_is_none(p):
    values = tuple(5.0 + 0.1 * 0.5 ** (p * i) for i in range(3))
    found = extrapolated("f", values)
    assert found.order is None
    assert found.value == values[2]
    assert found.uncertainty == pytest.approx(3.0 * (max(values) - min(values)))
    assert f"order {p:.2f}" in found.remark


def test_differences_that_grow_are_called_so():
    found = extrapolated("f", (1.0, 1.1, 1.3))
    assert found.order is None
    assert found.remark.startswith("differences don't shrink")


def test_numbers_that_go_back_and_forth_have_a_band_of_their_spread():
    found = extrapolated("f", (1.0, 1.2, 1.1))
    assert (found.order, found.value) == (None, 1.1)
    assert found.uncertainty == pytest.approx(0.6)
    assert "not monotone" in found.remark


def test_counts_agree_or_differ_and_are_not_extrapolated():
    same, other = extrapolated("n", (9, 9, 9)), extrapolated("n", (10, 9, 8))
    assert (same.value, same.uncertainty, same.remark) == (9, 0.0, "counts agree")
    assert (other.value, other.uncertainty, other.order, other.remark) == (None, None, None, "counts differ")


def test_what_is_missing_or_equal_is_said():
    assert extrapolated("f", (None, None, None)).remark == "missing in every run"
    assert extrapolated("f", (None, 1.0, 1.0)).remark == "missing in some runs"
    equal = extrapolated("f", (1.5, 1.5 + 1e-11, 1.5 - 1e-11))
    assert (equal.value, equal.order, equal.remark) == (1.5 - 1e-11, None, "equal up to rounding")


def test_an_instant_is_known_to_a_step_only():
    found = extrapolated("t", (0.167, 0.167, 0.167), grain=2.5e-4)
    assert found.uncertainty == 2.5e-4
    assert found.order is None


@pytest.mark.parametrize(
    ("value", "uncertainty", "text"),
    [
        (17.8712, 0.0372, "17.871 ± 0.037"),
        (-3.2e-8, 4.1e-9, "-3.20e-08 ± 4.1e-09"),
        (1475.198, 18.4, "1475 ± 18"),
        (1e-3, 0.5, "0 ± 0.50"),
        (1.4977533696, 3e-10, "1.49775337"),
        (9, 0.0, "9"),
        (0.0, 0.0, "0"),
        (None, None, "-"),
    ],
)
def test_a_number_is_printed_to_the_second_digit_of_its_uncertainty(value, uncertainty, text):
    assert with_error(Estimate("f", (), None, value, uncertainty)) == text


@pytest.mark.parametrize("timestep", [2e-3, 5e-4, 2e-4])
def test_the_impact_of_a_mass_on_a_spring_is_where_it_tends_to(timestep):
    """The closed form gives the peak v (k m)^(1/2), the impulse 2 m v, and the instant of contact."""
    scenario = Scenario.load("push_wall", MASS_ALONE | {"simulation.timestep": timestep}, "impedance")
    found = by_name(converge(scenario))
    m = float(residual.design_of(simulate(scenario.updated({"simulation.duration": 0.01}))).M[0, 0])
    v, k = 0.3, scenario.wall.stiffness
    expected = {
        "contact.peak_N": v * math.sqrt(k * m),
        "contact.impulse_Ns": 2.0 * m * v,
        "contact.first_s": scenario.wall.position / v,
    }
    for name, value in expected.items():
        # 6e-5: the contact's inerter, at any step
        assert abs(found[name].value - value) <= found[name].uncertainty + 6e-5 * value, name
        assert found[name].uncertainty < 0.05 * value, name
    assert found["contact.touches"].remark == "counts agree"
    assert found["contact.touches"].value == 1


def test_a_smooth_approach_converges_with_order_one_to_what_a_finer_run_has(smooth_overrides):
    scenario = Scenario.load("push_wall", smooth_overrides(1.0) | {"simulation.timestep": 2e-3}, "impedance")
    found = by_name(converge(scenario, ["final.position_m", "effort_N2s"]))
    fine = simulate(scenario.updated({"simulation.timestep": 2e-3 / 64}))
    expected = {f"final.position_m[{i}]": fine.p_WB[-1, i] for i in range(3)}
    expected["effort_N2s"] = fine.effort[-1, :3].sum()
    for name, value in expected.items():
        each = found[name]
        assert each.order == pytest.approx(1.0, abs=0.1), name
        assert abs(each.value - value) < each.uncertainty, name
        assert abs(each.value - value) < 0.2 * abs(each.values[2] - value), name


def test_the_first_impact_of_gsta_is_inside_its_error_bars():
    settings = {"wall.position": 0.02, "reference.target": [0.1, 0.0, 0.0], "reference.step_time": 0.0}
    scenario = Scenario.load("push_wall", settings | {"simulation.duration": 1.0, "simulation.timestep": 2e-4})
    each = by_name(converge(scenario))["contact.peak_N"]
    fine = simulate(scenario.updated({"simulation.timestep": 2e-4 / 32}))
    assert abs(each.value - fine.force_peak[-1]) < each.uncertainty
    assert 0.0 < each.uncertainty < 0.05 * each.value


@pytest.mark.slow
def test_a_given_control_period_stays_and_its_limit_is_that_of_the_sampled_law(smooth_overrides):
    settings = smooth_overrides(1.0) | {"simulation.timestep": 2e-3}
    law = Impedance(period=0.1)
    sampled, continuous = (
        by_name(converge(Scenario.load("push_wall", settings), ["final.position_m"], controller=each))
        for each in (law, Impedance())
    )
    fine = simulate(Scenario.load("push_wall", settings | {"simulation.timestep": 2e-3 / 64}), law)
    for i in range(3):
        name = f"final.position_m[{i}]"
        assert abs(sampled[name].value - fine.p_WB[-1, i]) < sampled[name].uncertainty + 1e-9
        both = sampled[name].uncertainty + continuous[name].uncertainty
        assert abs(sampled[name].value - continuous[name].value) > both


@pytest.mark.slow
def test_the_runs_end_at_one_instant_also_where_the_duration_is_no_multiple_of_the_step():
    overrides = MASS_ALONE | {"simulation.timestep": 3e-4, "simulation.duration": 0.1}
    found = converge(Scenario.load("push_wall", overrides, "impedance"), ["final.position_m"])
    assert found.scenario.simulation.duration == pytest.approx(333 * 3e-4)
    at_end = 0.3 * 333 * 3e-4  # before any contact
    assert by_name(found)["final.position_m[0]"].values == pytest.approx((at_end,) * 3, rel=1e-9)


def test_an_unknown_metric_is_refused_before_any_run():
    with pytest.raises(InputError, match=r"2 errors\n.*did you mean 'contact.peak_N'(.|\n)*final\.s") as raised:
        converge(Scenario(), ["contact.peak", "contact.final_N", "final.sz"])
    assert len(raised.value.faults) == 2


def test_a_step_that_can_not_be_quartered_is_refused_with_its_own_value():
    with pytest.raises(InputError, match=r"quarter of the time step 2e-07 s.*1e-07"):
        converge(Scenario.load("push_wall", {"simulation.timestep": 2e-7, "simulation.duration": 1e-4}))


def test_a_run_that_becomes_unstable_is_named():
    scenario = Scenario.load("push_wall", {"simulation.timestep": 0.2, "wall.stiffness": 10.0, "wall.position": 9.0})
    with pytest.raises(NotCompletedError, match=r"time step of 0\.2 s is unstable"):
        converge(dataclasses.replace(scenario, controller=Fosm(K_s=1e4)))


def test_warnings_of_each_run_are_notes_with_its_step():
    scenario = Scenario.load("push_wall", {"simulation.timestep": 2e-4, "simulation.duration": 0.01}, "fosm")
    with np.testing.assert_no_warnings():
        found = converge(scenario)
    chatters = [note for note in found.notes if "chatters" in note]
    assert [note.partition(":")[0] for note in chatters] == ["at 0.0002 s"]
    held = Scenario.load("push_wall", {"controller.period": 1e-2, "simulation.duration": 0.02}, "fosm")
    notes = converge(held).notes  # the warning occurs at all three steps but is listed once
    assert len([note for note in notes if "chatters" in note]) == 1
