"""``uvms-mj vehicles``: the list, the numbers of one, and a user's file."""

import json
from pathlib import Path

import numpy as np
import pytest

from uvms_mj.files import shipped
from uvms_mj.plant.mjcf import Mjcf

CUBE = Path(__file__).parents[2] / "examples" / "cube.xml"


def test_the_list_has_every_vehicle_with_source_licence_and_trust(here):
    text = here("vehicles").stdout
    for name in shipped("models"):
        assert f" {name} " in text
    for words in ("von Benzon", "Apache-2.0", "medium", "5 of 6"):
        assert words in text


@pytest.mark.parametrize("name", ["bluerov2_heavy", "lauv", str(CUBE)])
def test_the_numbers_are_those_of_the_vehicle(here, name):
    vehicle = Mjcf.find(name).vehicle
    about = json.loads(here("vehicles", name, "--json").stdout)[name]
    for matrix in ("M_RB", "M_A", "D_linear", "D_quadratic"):
        assert np.array_equal(about[matrix], getattr(vehicle, matrix))
    assert [about["mass"], about["displaced_mass"]] == [vehicle.mass, vehicle.displaced_mass]
    assert np.array_equal([each["wrench"] for each in about["thrusters"].values()], vehicle.B.T)
    assert [each["greatest"] for each in about["thrusters"].values()] == vehicle.u_max.tolist()
    text = here("vehicles", name).stdout
    assert f"they span {about['axes']} of 6 axes" in text
    assert about["source"][:40] in text


def test_a_limit_that_is_not_there_is_null_in_json(here):
    about = json.loads(here("vehicles", "--json").stdout)
    assert list(about) == list(shipped("models"))
    assert {each["least"] for each in about["bluerov1"]["thrusters"].values()} == {None}
    assert about["bluerov1"]["axes"] == 6


def test_cross_terms_are_named_by_row_and_column(here):
    text = here("vehicles", "lauv").stdout
    assert "(2,6) -11.5, (3,5) 11.5, (5,3) -3.1, (6,2) 3.1" in text


def test_a_file_without_remarks_is_told_how_to_give_them(here):
    assert 'licence not given: <text name="licence" data="..."/> in <custom>' in here("vehicles", CUBE).stdout


def test_damping_that_feeds_energy_in_is_a_warning(here, tmp_path):
    text = shipped("models")["lauv"].read_text().replace('"Y_r" data="11.5"', '"Y_r" data="60"')
    (tmp_path / "wrong.xml").write_text(text)
    done = here("vehicles", "wrong.xml")
    assert done.exit_code == 0
    assert "the damping of lauv can feed energy in" in done.stderr


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("bluerov3", "neither a file nor a shipped model; did you mean"),
        ("broken.xml", "broken.xml: is not well-formed"),
    ],
)
def test_a_vehicle_that_cannot_be_read_is_one_message(here, tmp_path, name, reason):
    (tmp_path / "broken.xml").write_text("<mujoco>")
    done = here("vehicles", name)
    assert done.exit_code == 2
    assert done.stderr.count("\n") == 1
    assert reason in done.stderr


def test_remarks_of_an_attached_model_are_found_and_control_no_terminal(here, tmp_path):
    model = shipped("models")["bluerov2"].read_text().replace("Wu (2018)", "Wu\t[red](2018)")
    (tmp_path / "rov.xml").write_text(model)
    (tmp_path / "mine.xml").write_text("""<mujoco><asset><model name="rov" file="rov.xml"/></asset>
        <worldbody><attach model="rov" body="bluerov2" prefix="my/"/></worldbody></mujoco>""")
    text = here("vehicles", "mine.xml").stdout
    assert "thesis, Flinders" in text
    assert "\t" not in text
    assert "[red](2018)" in text
