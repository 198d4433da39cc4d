"""``uvms-mj new``: each template runs as it is written, and says only what is true."""

import re
import shlex
import tomllib
from pathlib import Path

import numpy as np
import pytest

from uvms_mj import Scenario, Trace
from uvms_mj.cli.new import EXAMPLE, HEADER_OF, KINDS, new
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.scenario import CHOICES
from uvms_mj.stages.loader import tables_by_word


def ran(here, kind: str, *settings: str) -> Trace:
    """A run of a new file by the command that is printed, with further settings."""
    done = here("new", kind, "mine")
    assert done.exit_code == 0, done.stderr
    path, _, command = done.stdout.strip().partition(": uvms-mj ")
    assert Path(path).is_file()
    options = ("--out", "out", "--engine", "free_body", "-q")
    run = here(*shlex.split(command), *settings, *options)
    assert run.exit_code == 0, run.stderr
    assert run.stderr == ""
    return Trace.load("out/run.mcap")


def test_the_texts_have_the_name(here, tmp_path):
    for kind, (template, _) in KINDS.items():
        here("new", kind, "sea_cow")
        text = (tmp_path / f"sea_cow.{template.partition('.')[2]}").read_text()
        assert "emplate" not in text
        assert ("class SeaCow(" in text) == template.endswith(".py")
        own = re.findall(r"uvms-mj (?:run|vehicles|controllers|stages|identify).*(sea_cow\S*)", text)
        assert own
        assert all(use.startswith(f"sea_cow.{template.partition('.')[2]}") for use in own)


def test_the_help_names_every_kind():
    words = new.help.split("KIND is ")[1].partition(".")[0]
    assert re.split(r", | or ", words) == [*KINDS, HEADER_OF, EXAMPLE]


def test_a_kind_of_stage_is_the_name_of_its_table_or_a_word_for_it():
    meant = {kind: re.findall(r"--set '?(\w+)(?:\.name|=\[)", use) for kind, (_, use) in KINDS.items()}
    words = {table: table for table in CHOICES} | tables_by_word(CHOICES)
    for kind, (template, _) in KINDS.items():
        if template.endswith(".py"):
            assert [words[kind]] == (meant[kind] or ["controller"])


@pytest.mark.parametrize("kind", KINDS)
def test_the_commands_in_a_file_work(here, kind):
    here("new", kind, "mine")
    path = Path(f"mine.{KINDS[kind][0].partition('.')[2]}")
    commands = [line.partition("   ")[0] for line in re.findall(r"^\W*uvms-mj (.*)", path.read_text(), re.MULTILINE)]
    assert len(commands) > 1
    for i, command in enumerate(commands):
        short = ("simulation.duration=0.01", "--engine", "free_body", "-q", "-o", f"out{i}")
        done = here(*shlex.split(command), *(short if command.startswith("run") else ()))
        assert done.exit_code == 0, (command, done.stderr)


def test_the_keys_that_a_scenario_leaves_out_are_valid_and_have_their_defaults(here, tmp_path):
    here("new", "scenario", "mine")
    text = (tmp_path / "mine.toml").read_text()
    whole, n = re.subn(r"^# (\w+ = )", r"\1", text, flags=re.MULTILINE)
    assert n > 8
    (tmp_path / "whole.toml").write_text(whole)
    plain, full = (Scenario.load(tmp_path / name).to_dict() for name in ("mine.toml", "whole.toml"))
    assert full.pop("controller").items() >= plain.pop("controller").items()
    assert plain == full
    assert tomllib.loads(text)["vehicle"]["model"] == "bluerov2_heavy"


def test_the_scenario_rests_at_its_closed_form(here):
    trace = ran(here, "scenario", "simulation.timestep=2e-4")
    assert trace.push[-1] == pytest.approx(1.5 / (1.0 + 150.0 / 1e5), rel=1e-6)


def test_the_vehicle_is_complete(here):
    trace = ran(here, "vehicle", "simulation.timestep=2e-4")
    assert trace.push[-1] == pytest.approx(1.5 / (1.0 + 150.0 / 1e5), rel=1e-6)
    mjcf = Mjcf.find("mine.xml")
    assert np.linalg.matrix_rank(mjcf.vehicle.B) == 6
    assert set(mjcf.remarks) == {"description", "source", "licence", "trust"}


def test_the_law_brings_the_vehicle_back_against_a_force(here):
    """The integral takes the force over: k_i xi = force at rest."""
    settings = ("current.speed=0", "disturbance.bias=[0,3,0,0,0,0]", "wall.position=5", "reference.target=[0,0,0]")
    trace = ran(here, "law", *settings, "controller.k_i=60", "simulation.timestep=1e-3")
    assert trace.p_WB[-1] == pytest.approx([0, 0, 0], abs=1e-3)
    assert 60.0 * trace["xi"][-1, 1] == pytest.approx(3.0, rel=1e-2)


def test_the_reference_gives_its_own_derivatives(here):
    trace = ran(here, "reference", "simulation.duration=0.5", "simulation.timestep=1e-3", "--log-rate=full")
    for value, rate in ((trace.p_d, trace.p_d_dot), (trace.p_d_dot, trace.p_d_ddot)):
        assert np.abs(np.gradient(value, trace.t, axis=0) - rate)[1:-1].max() < 1e-6
    assert np.ptp(trace.p_d[:, 1]) > 1e-3


def test_the_sensor_adds_white_noise_to_the_velocity_alone(here):
    trace = ran(here, "sensor", "simulation.duration=1", "simulation.timestep=1e-3", "--log-rate=full")
    error = trace["velocity_error"]
    n = error.size
    assert n > 2900
    assert abs((error**2).sum() / 0.002**2 - n) < 4.0 * np.sqrt(2.0 * n)  # chi-square, 4 standard deviations


def test_the_observer_finds_the_force_of_the_wall(here):
    """In still water the model explains everything else, so that the law rests where the true force would have it."""
    settings = ("controller.name=impedance", "current.speed=0", "wall.stiffness=2e3", "simulation.timestep=5e-4")
    trace = ran(here, "observer", *settings)
    assert trace.f_contact_m_W[-1] == pytest.approx(trace.f_contact_W[-1], abs=1e-6)
    assert trace.push[-1] == pytest.approx(1.5 / (1.0 + 150.0 / 2e3), rel=1e-6)


def test_the_thrusters_lag_and_have_a_dead_band(here):
    """T u_dot = u_cmd - u by explicit Euler, where u_cmd is zero within the dead band."""
    settings = ("simulation.duration=0.3", "simulation.timestep=1e-3", "--log-rate=full")
    trace = ran(here, "thrusters", *settings, "thrusters.dead_band=1.5")
    command = np.where(np.abs(trace.u_cmd) <= 1.5, 0.0, trace.u_cmd)
    assert 0.0 < np.mean(command == 0.0) < 1.0
    expected = trace["thrust"][:-1] + 1e-3 / 0.02 * (command - trace["thrust"])[:-1]
    assert trace["thrust"][1:] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("name", ["a/b", "two words", "2nd", "class", "none", "", "__", "my-law", "café"])
def test_a_name_that_is_not_a_plain_word_is_refused(here, tmp_path, name):
    done = here("new", "law", name)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"error: NAME {name!r}: must be a word of letters")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["numpy", "uvms_mj", "json"])
def test_a_name_that_would_hide_a_module_is_refused(here, tmp_path, name):
    done = here("new", "law", name)
    assert (done.exit_code, list(tmp_path.iterdir())) == (2, [])
    assert done.stderr.startswith(f"error: NAME {name!r}: is a module")


@pytest.mark.parametrize(("word", "kind"), [("controller", "law"), ("navigation", "sensor"), ("guidance", "reference")])
def test_a_table_and_its_words_name_the_kind_of_file(here, word, kind):
    assert here("new", word, "mine").stdout == here("new", kind, "mine", "--force").stdout


def test_a_kind_that_is_none_is_one_sentence(here):
    done = here("new", "thruster", "mine")
    assert done.exit_code == 2
    assert done.stderr == "error: 'thruster': is not a kind of file; did you mean 'thrusters'?\n"


def test_the_examples_are_written_as_they_are(here, tmp_path):
    """So the commands of the guides, which name examples/..., also work without a checkout."""
    done = here("new", "example", "all")
    assert done.exit_code == 0, done.stderr
    source = Path(__file__).parents[2] / "examples"
    written = {path.name: path.read_bytes() for path in (tmp_path / "examples").iterdir()}
    assert written == {path.name: path.read_bytes() for path in source.iterdir() if path.is_file()}
    assert done.stdout.split() == [f"examples/{name}" for name in sorted(written)]
    assert here("new", "example", "circle").stdout == "circle.py\n"
    again = here("new", "example", "all")
    assert again.exit_code == 2
    assert "exists; choose another name, or replace it with --force" in again.stderr
    wrong = here("new", "example", "circel")
    assert wrong.stderr == "error: NAME 'circel': is not an example; did you mean 'circle'?\n"


def test_a_file_is_not_overwritten_without_force(here, tmp_path):
    (tmp_path / "mine.py").write_text("precious")
    done = here("new", "law", "mine")
    assert done.exit_code == 2
    assert "NAME mine.py: exists; choose another name, or replace it with --force" in done.stderr
    assert (tmp_path / "mine.py").read_text() == "precious"
    assert here("new", "law", "mine", "--force").exit_code == 0
    assert "class Mine" in (tmp_path / "mine.py").read_text()


def test_a_folder_that_is_not_there_is_made(here, tmp_path):
    for file, *kind in (("mine.py", "law"), ("in_c.c", "law", "--language", "c"), ("cube.xml", "example")):
        name = Path(file).stem
        done = here("new", *kind, name, "--out", f"new/{name}")
        assert done.exit_code == 0, done.stderr
        assert (tmp_path / "new" / name / file).is_file()


def test_a_folder_that_cannot_be_made_is_one_message_and_leaves_nothing(here, tmp_path):
    (tmp_path / "file").touch()
    done = here("new", "law", "mine", "--out", "file/nowhere")
    assert (done.exit_code, done.stderr) == (2, "error: --out file/nowhere: can't write there: Not a directory\n")
    done = here("new", "law", "in_c", "--language", "c", "--from", "nothing", "--out", "new/folder")
    assert done.exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_arm_of_the_vehicle_is_one_when_its_marks_are_removed(here, tmp_path):
    here("new", "vehicle", "mine")
    text = (tmp_path / "mine.xml").read_text()
    (arm,) = re.findall(r"<!-- A link of an arm:.*?-->", text, re.DOTALL)
    numeric, motor = re.findall(r"<(?:numeric|motor) .*?/>", arm)
    text = text.replace(arm, arm[arm.index("<body") : -len("-->")])
    text = text.replace("</custom>", f"{numeric}</custom>").replace("</actuator>", f"{motor}</actuator>")
    (tmp_path / "mine.xml").write_text(text)
    (link,) = Mjcf.find("mine.xml").vehicle.arm.links
    assert (link.joint, link.effort, link.filled_in[0]) == ("elbow", 5.0, "displaced_mass")
    assert "tool" in here("vehicles", "mine.xml").stdout
