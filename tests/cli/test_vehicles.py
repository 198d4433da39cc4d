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
        ("broken", "did you mean 'broken.xml'?"),
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


def test_motors_without_a_name_are_all_there(here, tmp_path):
    text = CUBE.read_text().replace('<motor name="surge_left"', "<motor").replace('<motor name="sway_low"', "<motor")
    (tmp_path / "mine.xml").write_text(text)
    thrusters = json.loads(here("vehicles", "mine.xml", "--json").stdout)["mine.xml"]["thrusters"]
    assert list(thrusters) == ["thruster 1", "surge_right", "thruster 3", "sway_high", "heave_front", "heave_rear"]


def test_the_arm_is_listed_with_joints_links_and_the_sites_that_can_be_the_tool(here):
    arm = Mjcf.find("bluerov2_alpha5").vehicle.arm
    about = json.loads(here("vehicles", "bluerov2_alpha5", "--json").stdout)["bluerov2_alpha5"]
    for found, link in zip(about["links"], arm.links, strict=True):
        assert (found["joint"], found["mass"], found["effort"]) == (link.joint, link.mass, link.effort)
        assert np.array_equal(found["M_A"], link.M_A)
    assert [link["carried_by"] for link in about["links"]] == ["bluerov2_alpha5", "shoulder", "upper_arm", "forearm"]
    assert list(about["sites"]) == ["tool"]  # the sites of thrusters are none
    assert about["sites"]["tool"]["reach"] == pytest.approx(np.hypot(0.02, 0.046) + 0.15 + 0.02 + 0.225)
    text = here("vehicles", "bluerov2_alpha5").stdout
    for words in ("-175 .. 175 deg", "2.5 N m s, 4 N m", "30 deg/s", "at most 0.4452", "15.962 kg, 15.972 kg", "tool"):
        assert words in text


def test_what_strip_theory_filled_in_is_said(here, tmp_path):
    link = """<body name="rod"><joint type="slide" range="-.1 .2"/><geom type="capsule" size=".02 .1" mass=".1"/>
        <site name="tip" pos="0 0 .1" size=".02"/></body>"""
    text = CUBE.read_text().replace(
        "<freejoint", link.replace("<geom", '<geom contype="0" conaffinity="0"') + "<freejoint"
    )
    text = text.replace("</custom>", '<numeric name="rod.strip_theory" data="1 1.1"/></custom>')
    (tmp_path / "mine.xml").write_text(text)
    about = json.loads(here("vehicles", "mine.xml", "--json").stdout)["mine.xml"]
    assert about["links"][0]["strip_theory"] == ["displaced_mass", "center_of_buoyancy", "M_A", "D_quadratic"]
    assert about["links"][0]["effort"] == 0.0
    assert about["sites"]["tip"]["reach"] == pytest.approx(0.3)
    text = here("vehicles", "mine.xml").stdout
    for words in ("displaced_mass, center_of_buoyancy, M_A, D_quadratic: from its capsules", "-0.1 .. 0.2 m", "none"):
        assert words in text
