"""Scenarios: TOML in and out, all errors at once, suggestions."""

import dataclasses
import math
import warnings
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from uvms_mj import Fosm, Gsta, InputError, Scenario, Simulation
from uvms_mj.control import ImpedanceTask
from uvms_mj.files import parse_setting, shipped
from uvms_mj.quantities import radians_notes
from uvms_mj.scenario import keys
from uvms_mj.setup.world import vehicles_of

SCENARIOS = sorted(name for name in shipped("scenarios") if not vehicles_of(name))


def write(tmp_path, text):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return path


def test_the_shipped_scenario_is_the_default():
    shipped = Scenario.load("push_wall")
    assert dataclasses.replace(shipped, description="") == Scenario()


@pytest.mark.parametrize("name", SCENARIOS)
def test_an_updated_scenario_is_the_one_made_from_all_of_its_tables(name):
    scenario = Scenario.load(name)
    tables = scenario.to_dict()
    for key, value, _ in keys():
        if value is None or key == "walls":
            continue
        assert updated_or_refused(lambda: scenario.updated({key: value})) == updated_or_refused(  # noqa: B023
            lambda: Scenario.from_dict(tables, {key: value})  # noqa: B023
        )


def updated_or_refused(make):
    try:
        return make()
    except InputError as error:
        return str(error)


def test_round_trip_through_toml(tmp_path):
    scenario = Scenario.load(
        "push_wall",
        {
            "wall.stiffness": 12345.678901234567,
            "impedance.M_d": [[float(i == j) * (i + 1) for i in range(6)] for j in range(6)],
            "reference.waypoints": [{"time": 1.0, "position": [0.1, 0.2, 0.3]}],
            "controller.K_s": 3,
            "controller.period": 2e-4,
        },
        "fosm",
    )
    assert Scenario.load(write(tmp_path, scenario.to_toml())) == scenario


def test_a_scenario_that_does_not_exist_is_said_so():
    with pytest.raises(InputError, match="did you mean 'push_wall'"):
        Scenario.load("pushwall")
    with pytest.raises(InputError, match="no such file"):
        Scenario.load("nowhere/mine.toml")


def test_the_files_gains_are_kept_only_if_they_are_that_laws(tmp_path):
    path = write(tmp_path, "[controller]\nname = 'gsta'\nk_1 = 8.0\n[task]\nA = -50.0")
    for controller in (None, "gsta"):
        scenario = Scenario.load(path, controller=controller)
        assert scenario.controller == Gsta(k_1=8.0)
        assert scenario.task == ImpedanceTask(A=-50.0)
    with pytest.warns(UserWarning, match=r"controller\.k_1 is left out"):
        other = Scenario.load(path, controller="fosm")
    assert other.controller == Fosm()
    assert other.task == ImpedanceTask(A=-50.0)
    with pytest.warns(UserWarning, match="left out"):
        assert Scenario.load(path, {"controller.K_s": 3.0}, "fosm").controller == Fosm(K_s=3.0)


@pytest.mark.parametrize(
    ("text", "overrides", "said"),
    [
        ("[controller]\nname = 'gsta'\nperiod = 0.01\nk_1 = 8.0", {}, "controller.k_1 is left out"),
        ("[controller]\nk_1 = 8.0\nbeta = 3.0", {}, "controller.k_1, controller.beta are left out"),
        ("[controller]\nname = 'gsta'\nperiod = 0.01", {"controller.period": 0.02}, ""),
        ("[controller]\nname = 'gsta'\nk_1 = 5.0", {}, ""),  # its default
        ("[controller]\nname = 'gsta'", {}, ""),
        ("[controller]\nname = 'fosm'\nK_s = 3.0", {}, ""),
    ],
)
@pytest.mark.parametrize("as_override", [True, False])
def test_settings_that_another_stage_does_not_take_over_are_named(tmp_path, text, overrides, said, as_override):
    overrides, controller = (overrides | {"controller.name": "fosm"}, None) if as_override else (overrides, "fosm")
    path = write(tmp_path, text)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scenario = Scenario.load(path, overrides, controller)
    assert scenario.controller.source() == "fosm"
    assert [str(each.message) for each in caught] == (
        [f"controller.name: fosm takes the place of gsta, so {said}"] if said else []
    )
    notes = []
    assert Scenario.load(path).updated(overrides, controller, note=notes.append).controller == scenario.controller
    assert len(notes) == said.count("k_1")
    for kept in ("period", "delay"):  # of the loop
        given = overrides.get(f"controller.{kept}", Scenario.load(path).controller.__dict__[kept])
        assert getattr(scenario.controller, kept) == given


LAW = """
from dataclasses import dataclass
from uvms_mj import Controller, gain

@dataclass(frozen=True)
class Mine(Controller):
    k: float = gain(1.0, "N/m", "stiffness")

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[0] = -gains.k
"""


def test_two_ways_to_one_file_are_one_law(tmp_path):
    law = tmp_path / "mine.py"
    law.write_text(LAW)
    (tmp_path / "link.py").symlink_to(law)
    (tmp_path / "other.py").write_text(law.read_text())
    (tmp_path / "inner").mkdir()
    around = f"{tmp_path}/inner/../mine.py:Mine"
    path = write(tmp_path, f"[controller]\nname = '{around}'\nk = 4.5")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for source in (f"{law}:Mine", f"{tmp_path}/link.py:Mine"):
            assert Scenario.load(path, controller=source).controller.k == 4.5
    with pytest.warns(UserWarning, match=r"controller\.k is left out"):
        Scenario.load(path, controller=f"{tmp_path}/other.py:Mine")


def test_a_stages_settings_that_are_left_out_are_named_at_any_stage(tmp_path):
    path = write(tmp_path, "[reference]\nname = 'circle'\nradius = 0.3\n[thrusters]\nname = 't200'\nvoltage = 14.0")
    with pytest.warns(UserWarning, match="left out") as caught:
        Scenario.load(path, {"reference.name": "filtered_steps", "thrusters.name": "ideal"})
    assert {str(each.message) for each in caught} == {
        "reference.name: filtered_steps takes the place of circle, so reference.radius is left out",
        "thrusters.name: ideal takes the place of t200, so thrusters.voltage is left out",
    }


def test_paths_in_a_file_are_relative_to_it(tmp_path, monkeypatch):
    (tmp_path / "mine.xml").write_text("<mujoco/>")
    path = write(tmp_path, "[vehicle]\nmodel = 'mine.xml'")
    monkeypatch.chdir("/")
    assert Scenario.load(path).vehicle.model == str(tmp_path / "mine.xml")


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_settings_keep_numbers_to_the_last_bit(value):
    assert parse_setting(f"wall.position={value!r}") == ("wall.position", value)


def test_a_point_may_stand_at_either_end_of_a_number():
    assert [parse_setting(f"x={text}")[1] for text in (".2", "5.", "-.5e-3", "+1.")] == [0.2, 5.0, -0.5e-3, 1.0]
    assert parse_setting("x=.")[1] == "."


def test_settings():
    assert parse_setting("a.b=[1, 2.5]") == ("a.b", [1, 2.5])
    assert parse_setting("vehicle.model=my model.xml") == ("vehicle.model", "my model.xml")
    assert parse_setting("controller.nominal=false") == ("controller.nominal", False)
    with pytest.raises(InputError, match="key=value"):
        parse_setting("wall.stiffness")


def test_every_key_has_a_meaning_and_a_default_that_is_valid():
    for key, default, meaning in keys():
        assert meaning, key
        if default is not None:
            Scenario.load("push_wall", {key: default})


def test_gains_are_checked_at_construction():
    with pytest.raises(InputError, match="k_1"):
        Gsta(k_1=float("nan"))
    with pytest.raises(InputError, match="has 2 values; 6 are needed"):
        ImpedanceTask(A=(-1.0, -2.0))
    assert ImpedanceTask(A=-50.0).A == (-50.0,) * 6


def test_the_tasks_gains_have_a_table_of_their_own(tmp_path):
    """A law may have a gain of the same name."""
    assert Scenario.load(write(tmp_path, "[task]\nF_1 = 2.0\nintegral = true")).task == ImpedanceTask(
        F_1=2.0, integral=True
    )
    assert Scenario.load("push_wall", {"task.F_1": 2.0}).updated({}, "fosm").task == ImpedanceTask(F_1=2.0)


def test_a_message_stays_short():
    with pytest.raises(InputError) as caught:
        Scenario.from_dict({f"a{i}": 1 for i in range(1000)})
    assert len(str(caught.value).splitlines()) == 52
    assert "1000 errors" in str(caught.value)
    assert "and 950 more" in str(caught.value)
    with pytest.raises(InputError) as caught:
        Scenario.from_dict({"a" * 5000: 1})
    assert len(str(caught.value)) < 500


def test_a_scenario_prints_what_differs_from_the_defaults():
    assert repr(Scenario()) == "<Scenario 'push_wall', gsta, defaults>"
    other = Scenario.load("push_wall", {"wall.stiffness": 2e4, "controller.K_s": 3.0}, "fosm")
    assert repr(other).splitlines()[1:] == ["    wall.stiffness = 20000.0", "    controller.K_s = 3.0>"]
    circle = str(Path(__file__).parents[1] / "examples" / "circle.py") + ":Circle"
    other = Scenario.load("push_wall", {"reference.name": circle, "reference.radius": 0.3})
    shown = ["    reference.name = 'circle.py:Circle'", "    reference.radius = 0.3>"]
    assert repr(other).splitlines()[1:] == shown


@pytest.mark.parametrize("degrees", [30, 45, 60, 90, 135, 180, 270, 360])
@pytest.mark.parametrize("decimals", [2, 3, 4, 17])
def test_a_common_angle_in_radians_in_a_key_in_degrees_is_noted(degrees, decimals):
    radians = math.radians(degrees)
    for value in (round(radians, decimals), -math.floor(radians * 10**decimals) / 10**decimals):
        (note,) = radians_notes({"initial": {"attitude_deg": [0.0, 0.0, value]}, "posture": {"yaw": radians}})
        meant = f"{math.copysign(degrees, value):g} deg"
        assert note == f"initial.attitude_deg is in degrees; {value:g} looks like radians, of {meant}"


def test_angles_in_degrees_are_not_taken_for_radians():
    """The common angles themselves, all whole degrees, all tenths, and a list of which one number is no such angle."""
    for value in (*range(-360, 361), *(0.1 * n for n in range(-100, 100)), 22.5, 0.25, 1.25):
        assert radians_notes({"current": {"direction_deg": round(value, 2)}}) == []
    assert radians_notes({"initial": {"attitude_deg": [10.0, 0.0, 1.57]}}) == []


def test_the_note_on_radians_reaches_a_run():
    wall = {"shape": "plane", "position": [2.0, 0.0, 0.0], "attitude_deg": [0.0, 0.0, 1.57]}
    with Simulation(Scenario.load("push_wall", {"walls": [wall]}), engine="free_body") as sim:
        assert "walls[0].attitude_deg is in degrees; 1.57 looks like radians, of 90 deg" in sim.notes
