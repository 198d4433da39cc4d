"""What belongs to the loop and not to one stage: it stays when the stage changes, and no class widens its range."""

import dataclasses

import pytest

from law_files import law_file, one_liner
from uvms_mj import InputError, Scenario
from uvms_mj.scenario import STAGES
from uvms_mj.studies.plan import Plan

GIVEN = {"period": 0.02, "delay": 0.03, "attitude_deg": (0.0, 0.0, 30.0)}
MINE = one_liner("Mine", "tau_cmd[:] = 0.0")


@pytest.mark.parametrize("table", STAGES)
def test_what_every_stage_of_a_table_has_stays_when_another_one_takes_its_place(table):
    choice = STAGES[table]
    of_all = {field.name for field in dataclasses.fields(choice.base) if field.kw_only}
    given = {word: value for word, value in GIVEN.items() if word in of_all}
    assert given.keys() == of_all  # a setting that is new to all stages has a value above
    for before in choice.shipped.values():
        for name, cls in choice.shipped.items():
            left_out = []
            found = choice.replaced({"name": before.name, **given}, name, (), left_out)
            if cls.runs or before is cls or name == "auto":
                assert (found, left_out) == ({"name": name, **given}, [])
            else:  # the absence of a stage has no period
                assert found == {"name": name}
                assert left_out[0].endswith(f"so {table}.period is left out")


def test_a_period_and_a_delay_stay_with_every_law_of_a_scenario_and_of_a_study(tmp_path):
    own = law_file(tmp_path, MINE, "mine.py")
    path = tmp_path / "s.toml"
    path.write_text("[controller]\nname = 'gsta'\nperiod = 0.02\ndelay = 0.04\nk_1 = 8.0\n")
    with pytest.warns(UserWarning, match="so controller.k_1 is left out"):
        laws = [Scenario.load(path, controller=law).controller for law in ("fosm", f"{own}:Mine")]
    plan = Plan.from_dict(
        {
            "base": {"scenario": str(path)},
            "laws": ["gsta", "fosm", f"{own}:Mine", {"name": "sta", "controller.period": 0.01}],
            "vary": [{"key": "wall.stiffness", "values": [1e4]}],
        }
    )
    laws += [plan.scenario(i).controller for i in range(3)]
    assert {(law.period, law.delay) for law in laws} == {(0.02, 0.04)}
    assert (plan.scenario(3).controller.period, plan.scenario(3).controller.delay) == (0.01, 0.04)


def test_the_default_period_of_a_law_is_that_laws_alone(tmp_path):
    slow = law_file(tmp_path, MINE.replace("    @static", "    period: float = 0.1\n\n    @static"), "slow.py")
    scenario = Scenario.load("push_wall", controller=f"{slow}:Mine")
    assert scenario.controller.period == 0.1
    assert scenario.updated({}, "gsta").controller.period is None
    assert scenario.updated({"controller.period": 0.05}).updated({}, "gsta").controller.period == 0.05


@pytest.mark.parametrize(
    ("line", "settings", "said"),
    [
        ("period: float = 2.0", {}, "controller.period: 2.0 must be from 1e-07 to 1 s; it is the default in the class"),
        ("period: float = 0.1", {"controller.period": 2.0}, "controller.period: 2.0 must be from 1e-07 to 1 s"),
        ("delay: float = 50.0", {}, "controller.delay: 50.0 must be from 0 to 10 s; it is the default in the class"),
        ("period = 0.1", {}, "period = 0.1 has no effect without its type; write period: float = ..."),
    ],
)
def test_a_class_has_the_ranges_of_all_stages(tmp_path, line, settings, said):
    path = law_file(tmp_path, MINE.replace("    @static", f"    {line}\n\n    @static"))
    with pytest.raises(InputError) as caught:
        Scenario.load("push_wall", settings, f"{path}:Mine")
    assert said in str(caught.value)
