"""The page from ideal to real: boundaries and steps on rows that are formulas, the page, and the command's refusals."""

import importlib
import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

from pages import complete_by_itself
from strict_json import no_constants
from synthetic_study import frame_of
from uvms_mj import InputError
from uvms_mj.cli.experiments import practicality
from uvms_mj.files import shipped
from uvms_mj.reproduce.claims import judged
from uvms_mj.reproduce.practicality.results import (
    AXES,
    CLAIMS,
    DEMANDED,
    KEPT,
    LABELS,
    LAWS,
    MAPS,
    RETUNED,
    STEPS,
    STEPS_NAME,
    Results,
    plans,
    step_label,
    why,
)
from uvms_mj.setup.base import set_up

VIBRATES = {"force_range_N": 20.0}
WRONG = {"force_error_N": -0.5, "contact.final_N": 1.0}
DIVERGED = {"status": "unstable", "message": "diverged at t = 1 s", "force_error_N": np.nan, "force_range_N": np.nan}


@pytest.fixture(scope="module")
def planned():
    return plans({})


def rows(plan, broken=()):
    """Rows in which every run works but those of ``broken``: pairs of a condition on the row and what it changes."""
    good = dict.fromkeys(KEPT, 0.0) | {"contact.final_N": DEMANDED, "contact.touches": 1, "contact.settled": True}
    frame = frame_of(plan, lambda given: {name: np.full(len(given["index"]), value) for name, value in good.items()})
    for condition, changes in broken:
        for name, value in changes.items():
            frame.loc[frame.apply(condition, axis=1), name] = value
    return frame


def results_of(planned, **broken):
    return Results(planned, {name: rows(plan, broken.get(name, ())) for name, plan in planned.items()})


def beyond(law, key, value):
    """Whether a row is one of a law at a value or above."""
    return lambda row: row["law"] == law and row[key] >= value


@pytest.fixture(scope="module")
def results(planned):
    """GSTA vibrates from a delay of 3 ms on, fosm presses wrongly everywhere along the friction and diverges at the
    last wall stiffness; after the third step GSTA without the bumper vibrates, and works again after the fifth."""
    last = AXES["wall_stiffness"].values[-1]
    third = step_label("gsta", False, 3)
    return results_of(
        planned,
        force_delay=[(beyond("gsta", "navigation.force_delay", 3e-3), VIBRATES)],
        friction=[(beyond("fosm", "wall.friction", 0.0), WRONG)],
        wall_stiffness=[(beyond("fosm", "wall.stiffness", last), DIVERGED)],
        **{STEPS_NAME: [(lambda row: row["law"] == third, VIBRATES)]},
    )


def test_a_boundary_is_between_the_last_value_that_works_and_the_first_that_does_not(results):
    axis, found = AXES["force_delay"], results.boundaries["force_delay", "gsta"]
    after = next(value for value in axis.values if value >= 3e-3)
    before = axis.values[axis.values.index(after) - 1]
    assert (found.last, found.first) == (before, after)
    assert found.between == pytest.approx(math.sqrt(before * after), rel=1e-15)
    assert found.why == "vibrates: the push varies by 20 N"
    assert found.text == f"to {before:g} s"


def test_a_law_that_never_or_always_works_has_no_boundary(results):
    never, always = results.boundaries["friction", "fosm"], results.boundaries["friction", "gsta"]
    assert (never.last, never.first, never.between) == (None, 0.0, None)
    assert (never.text, never.why) == ("not even at 0", "presses with 1 N, -0.5 N wrong")
    assert (always.last, always.first, always.between, always.why) == (1.0, None, None, "")
    assert always.text == "works at all values, to 1"


def test_the_first_gap_ends_what_works(planned):
    """A law that works again further on has its boundary at the first failure."""
    axis = AXES["friction"]
    gap = [(lambda row: row["law"] == "gsta" and row["wall.friction"] == 0.1, WRONG)]
    found = results_of(planned, friction=gap).boundaries["friction", "gsta"]
    assert (found.last, found.first) == (axis.values[axis.values.index(0.1) - 1], 0.1)


def test_a_law_works_in_noise_if_it_does_with_all_random_numbers(planned):
    """One draw of noise decides nothing: one failure of all repeats of a value ends what works."""
    axis = AXES["force_noise"]
    assert axis.repeats > 1
    assert planned[STEPS_NAME].repeats > 1
    assert len(rows(planned["force_noise"])) == len(axis.values) * len(LAWS) * axis.repeats
    value, last = axis.values[6], step_label("gsta", True, 2)
    once = [(lambda row: row["law"] == "gsta" and row[axis.key] == value and row["repeat"] == 5, VIBRATES)]
    step = [(lambda row: row["law"] == last and row["repeat"] == 3, DIVERGED)]
    found = results_of(planned, force_noise=once, **{STEPS_NAME: step})
    assert found.boundaries["force_noise", "gsta"].last == axis.values[5]
    assert found.boundaries["force_noise", "gsta"].why == "vibrates: the push varies by 20 N"
    assert found.boundaries["force_noise", "fosm"].last == axis.values[-1]
    assert found.steps_survived("gsta", True) == 2


def test_a_diverged_run_does_not_work_and_says_why(results):
    found = results.boundaries["wall_stiffness", "fosm"]
    assert found.first == AXES["wall_stiffness"].values[-1]
    assert found.why == "unstable: diverged at t = 1 s"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"contact.touches": 0, "contact.final_N": 0.0, "force_error_N": -1.5}, "never touches the wall"),
        ({"force_range_N": 2.0, "saturated_s": 1.0}, "vibrates: the push varies by 2 N, thrusters at their limits"),
        ({"force_error_N": 0.2, "contact.final_N": 1.7}, "presses with 1.7 N, +0.2 N wrong"),
        ({}, "works"),
    ],
)
def test_why_a_run_does_not_work(planned, changes, words):
    row = rows(planned["friction"]).iloc[0].copy()
    for name, value in changes.items():
        row[name] = value
    assert why(row) == words


def test_steps_survived_end_at_the_first_gap(results):
    assert results.steps_survived("gsta", False) == 3
    assert results.steps_survived("gsta", True) == len(STEPS)
    assert results.steps_survived(RETUNED, False) == len(STEPS)


def test_the_predicted_delay_is_that_at_which_the_force_is_too_old(results):
    """By the age's definition: the mean age is the delay and half a control period, D_d/(K_f k_c) at the limit."""
    axis = AXES["force_delay"]
    setup = set_up(results.plans["force_delay"].scenario(0))
    wall, impedance = setup.scenario.wall, setup.scenario.impedance
    limit = (setup.design.D_d[0, 0] / impedance.K_f[0] + wall.damping) / wall.stiffness
    found = results.predicted(axis, "gsta")
    assert found == pytest.approx(limit, abs=1e-4)  # one control period
    assert results.predicted(AXES["friction"], "gsta") is None


def test_the_line_of_a_map_is_inversely_proportional_to_the_stiffness(results):
    line = results.limits("force_delay_and_stiffness", "gsta")
    inside = line[line[:, 0] > 1e-3]  # where the control period of 0.1 ms is small
    assert len(inside) > 3
    assert np.ptp(inside[:, 0] * inside[:, 1]) < 0.1 * np.mean(inside[:, 0] * inside[:, 1])


def test_claims_are_finite_json_and_some_of_these_rows_fail(results):
    table = json.loads(json.dumps([row.as_dict() for row in judged(CLAIMS, results)], allow_nan=False))
    verdicts = {row["id"]: row["verdict"] for row in table}
    assert {"holds", "fails"} == {*verdicts.values()}
    assert verdicts["impedance"] == "fails"  # it presses with the demanded force here


def test_the_command_writes_page_and_claims_and_ends_with_1_if_claims_fail(results, tmp_path, monkeypatch):
    """With these rows in place of the runs."""
    module = importlib.import_module("uvms_mj.cli.experiments")
    repeated = importlib.import_module("uvms_mj.reproduce.practicality")
    monkeypatch.setattr(repeated, "_run", lambda *arguments: results)
    (tmp_path / "out").mkdir()
    done = CliRunner().invoke(module.practicality, ["--out", str(tmp_path / "out"), "--json"])
    assert done.exit_code == 1, done.output
    told = json.loads(done.stdout, parse_constant=no_constants)
    claims = json.loads((tmp_path / "out" / "claims.json").read_text(encoding="utf-8"), parse_constant=no_constants)
    assert told["claims"] == claims
    assert told["failed"] == [row["id"] for row in claims if row["verdict"] == "fails"] != []
    found = complete_by_itself((tmp_path / "out" / "report.html").read_text(encoding="utf-8"))
    assert len(found.of("img")) == 2
    text = " ".join(found.text)
    assert all(axis.title in text for axis in AXES.values())
    assert "vibrates: the push varies by 20 N" in text


def test_the_studies_have_every_axis_law_and_step(planned):
    assert {*planned} == {*AXES, *MAPS, STEPS_NAME}
    assert all([law.label for law in planned[axis.name].laws] == list(LABELS) for axis in AXES.values())
    assert planned[STEPS_NAME].runs == 4 * len(STEPS) * planned[STEPS_NAME].repeats
    along = sum(len(axis.values) * axis.repeats for axis in AXES.values())
    over = sum(len(x.values) * len(y.values) for x, y in MAPS.values())
    assert sum(plan.runs for plan in planned.values()) == len(LAWS) * (along + over) + planned[STEPS_NAME].runs


@pytest.mark.parametrize("vehicle", sorted(name for name in shipped("models") if name.startswith("bluerov2")))
def test_the_studies_are_valid_for_the_shipped_vehicles(vehicle):
    found = plans({"vehicle.model": vehicle})
    assert found["force_delay"].scenario(0).vehicle.model == vehicle


def test_a_bad_key_is_refused_with_one_message(tmp_path):
    with pytest.raises(InputError, match=r"wall\.stifness"):
        plans({"wall.stifness": 1e4})
    out = str(tmp_path / "out")
    done = CliRunner().invoke(practicality, ["--out", out, "--set", "wall.stifness=1e4"])
    assert done.exit_code == 2
    assert done.output.count("wall.stifness") == 1
    assert not (tmp_path / "out").exists()
