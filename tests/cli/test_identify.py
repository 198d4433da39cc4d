"""``uvms-mj identify``: what it prints, what it writes, and its exit status."""

import json
from pathlib import Path

import pytest

from pages import complete_by_itself
from strict_json import no_constants
from uvms_mj.plant.mjcf import Mjcf


@pytest.fixture
def file(here):
    assert here("new", "identify", "my_rov").exit_code == 0
    return "my_rov.toml"


def test_it_prints_one_object_and_writes_a_vehicle_and_a_page(here, file):
    done = here("identify", file, "--out", "found", "--json")
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout, parse_constant=no_constants)
    X_uu = report["coefficients"]["X_uu"]
    assert abs(X_uu["value"] + 180.0) < X_uu["half_width_95"]  # the data of the example were made with it
    assert report["not_told_apart"] == []
    assert {path.name for path in Path("found").iterdir()} == {
        *("my_rov.xml", "identified.toml", "report.html", "journal.json")
    }
    vehicle = Mjcf.find(report["vehicle"])
    assert vehicle.vehicle.D_quadratic[0, 0] == -X_uu["value"]
    assert "X_uu = -1" in vehicle.remarks["identified"]
    assert "von Benzon" in vehicle.remarks["source"]
    text = " ".join(complete_by_itself(Path("found/report.html").read_text()).text)
    for words in ("95 %", "Eigenvalues of the information", "vehicle before", "X_uu"):
        assert words in text
    assert here("vehicles", "found/my_rov.xml").exit_code == 0
    assert here("run", "vehicle.model=found/my_rov.xml", "-q", "-o", "r", "simulation.duration=0.01").exit_code == 0


@pytest.mark.usefixtures("undrawn")
def test_what_is_not_given_is_said(here, file):
    Path(file).write_text(Path(file).read_text().replace('name = "X_u"', 'name = "Y_v"'))
    done = here("identify", file, "--out", "found")
    assert done.exit_code == 0, done.output
    assert "Y_v is not given: the data do not show it" in done.stdout
    assert "found/report.html" in done.stdout


def test_a_vehicle_of_this_name_is_not_written_over(here, file):
    done = here("identify", file, "--out", "first", "--json")
    vehicle = Path(json.loads(done.stdout)["vehicle"])
    mine = Path("mine", vehicle.name)
    mine.parent.mkdir()
    mine.write_text("<mine/>")
    done = here("identify", file, "--out", "mine")
    assert done.exit_code == 2, done.output
    assert f"has a vehicle {vehicle.name} already" in done.stderr
    assert mine.read_text() == "<mine/>"


def test_bad_input_is_one_line_with_its_place(here, file):
    lines = Path("my_rov.csv").read_text().splitlines()
    Path("my_rov.csv").write_text("\n".join([*lines[:4], "0.01,0.5", *lines[5:]]))
    done = here("identify", file, "--out", "found")
    assert done.exit_code == 2
    assert "my_rov.csv: column 't', row 5: the time goes back" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not Path("found").exists()
    done = here("identify", "nowhere.toml")
    assert done.exit_code == 2
    assert "no such file" in done.stderr
