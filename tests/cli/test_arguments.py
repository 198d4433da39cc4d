"""Bad arguments: one message that names them, exit status 2, nothing written."""

import re
import time
from pathlib import Path

import pytest

from uvms_mj import InputError
from uvms_mj.control import SHIPPED
from uvms_mj.files import parse_setting, parsed_toml

ROOT = Path(__file__).parents[2]
SHORT = ("--set", "simulation.duration=0.05")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run", "push_wal"], "did you mean 'push_wall'?"),
        (["run", "nowhere.toml"], "no such file"),
        (["run", "--controller", "gtsa"], "did you mean 'gsta'?"),
        (["run", "--set", "wall.stifness=3"], "did you mean 'stiffness'?"),
        (["run", "--set", "wall.stiffness"], "key=value"),
        (["run", "--set", "wall.stiffness=soft"], "'soft' is not a finite number"),
        (["run", "--set", "simulation.timestep=0"], "must be from 1e-07 to 1 s"),
        (["run", "--set", "simulation.timestep=0.1"], "or a time step below 0.02264 s"),
        (["run", "--set", "impedance.M_d=[1,1,1,1,1,-1]"], "not positive definite"),
        (["run", "--set", "controller.period=1.5e-4"], "the nearest are 0.0001 and 0.0002 s"),
        (["run", "--set", "vehicle.model=submarine"], "models that ship|bluerov1"),
        (["run", "--log-rate", "3000"], "the nearest are 2500 and 3333.33333333 Hz"),
        (["run", "--log-rate", "often"], "must be a number"),
        (["run", "--out", "/proc/nothing"], "can't write"),
        (["run", "a", "b"], "one scenario at a time"),
        (["run", "wall.stiffness", "2e4"], "wall.stiffness: is a key, not the name of a scenario; give its value in"),
        (
            ["run", "x.mcap"],
            "x.mcap: is a log, not a scenario; --from x.mcap uses the scenario and the vehicle of a log",
        ),
        (["run", "--engine", ""], "engine '': is not an engine"),
        (["run", "--engine", "gpu"], "engine 'gpu': takes many runs at once: in a study, or as uvms_mj.Fleet"),
        (["run", "--set", "wall.stiffness.x=3"], "wall.stiffness.x: no such key; did you mean 'stiffness'?"),
        (["run", "--set", "simulation.seed=1.5"], "simulation.seed: 1.5 is not a whole number"),
        (
            ["run", "--set", "reference.target=1,2,3"],
            "'1,2,3' is not a list of numbers; write it in brackets, [1.0, 2.0]",
        ),
        (["replay", "x.mcap", "--save", "x.txt"], "--save x.txt: the name must end in .rrd"),
        (["run", "--controler", "gsta"], "No such option"),
        (["controllers", "lqr"], "no law 'lqr'"),
        (["fly"], "No such command"),
    ],
)
def test_bad_input_gives_one_message_and_status_2(here, arguments, expected):
    done = here(*arguments, *(["--json"] if arguments[0] == "run" else []))
    assert done.exit_code == 2
    assert any(each in done.stderr for each in expected.split("|")), done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    assert not list(Path().iterdir())


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("mine.py:Own", "mine.py:Own: is a law, not a scenario: use --controller mine.py:Own"),
        ("mine.py:Sense", "is a navigation stage, not a scenario: use --set navigation.name=mine.py:Sense"),
        (
            "mine.py",
            "mine.py: is a Python file, not a scenario: use --controller mine.py:Own or --set navigation.name=",
        ),
    ],
)
def test_a_file_with_stages_in_place_of_a_scenario_is_sent_to_its_option(here, tmp_path, word, said):
    lines = ["from uvms_mj import Controller", "from uvms_mj.navigation import Navigation"]
    lines += ["class Own(Controller): pass", "class Sense(Navigation): pass"]
    (tmp_path / "mine.py").write_text("\n".join(lines))
    assert said in here("run", word).stderr
    assert "mine.py: is Python, not a study" in here("study", "mine.py").stderr
    said = "'mine.py' names no class; give mine.py:Own\n"
    assert here("run", "-c", "mine.py").stderr == f"error: push_wall: controller.name: {said}"


@pytest.mark.parametrize(
    ("numeric", "value", "expected"),
    [
        ("X_udot", "5.5", "must not be positive"),
        ("N_rr", "abc", "must be finite numbers"),
        ("displaced_mass", "-1", "negative"),
    ],
)
def test_an_unphysical_vehicle_is_refused(here, tmp_path, numeric, value, expected):
    lines = (ROOT / "models" / "bluerov1.xml").read_text().splitlines()
    lines = [f'<numeric name="{numeric}" data="{value}"/>' if f'name="{numeric}"' in line else line for line in lines]
    (tmp_path / "mine.xml").write_text("\n".join(lines))
    done = here("run", "--set", "vehicle.model=mine.xml")
    assert done.exit_code == 2
    assert expected in done.stderr
    assert numeric in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("option", "reason"),
    [
        ('solver="PGS"', "PGS"),
        ('noslip_iterations="5"', "noslip"),
        ('iterations="0"', "iterations"),
        ('><flag contact="disable"/></option><option', "<flag>"),
    ],
)
def test_a_vehicle_file_whose_settings_break_the_plant_is_refused(here, tmp_path, option, reason):
    text = (ROOT / "models" / "bluerov1.xml").read_text().replace("<option", f"<option {option}", 1)
    (tmp_path / "mine.xml").write_text(text)
    done = here("run", *SHORT, "--set", "vehicle.model=mine.xml")
    assert done.exit_code == 2
    assert reason in done.stderr


def test_a_negative_mass_is_refused(here, tmp_path):
    text = (ROOT / "models" / "bluerov1.xml").read_text().replace('mass="7.31"', 'mass="-7.31"')
    (tmp_path / "mine.xml").write_text(text)
    done = here("run", "--set", "vehicle.model=mine.xml")
    assert done.exit_code == 2
    assert "mass" in done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "-o", "LONG"),
        ("run", "--from", "LONG"),
        ("run", "LONG.toml"),
        ("run", "-c", "LONG.py:Law"),
        ("run", "vehicle.model=LONG.xml"),
        ("info", "LONG"),
        ("plot", "LONG", "--out", "LONG.png"),
        ("compare", "LONG", "--out", "LONG.html"),
        ("export", "LONG", "--to", "csv"),
        ("replay", "LONG", "--save", "LONG.rrd"),
        ("certify", "--from", "LONG"),
        ("paper", "--from", "LONG"),
        ("paper", "-o", "LONG"),
    ],
)
def test_a_place_that_cannot_be_looked_at_is_named_in_one_line(here, arguments):
    """An unreadable folder would do, but root can read all folders. So the name is too long for any file system."""
    done = here(*(argument.replace("LONG", 300 * "a") for argument in arguments))
    assert done.exit_code == 2, done.output
    assert "File name too long" in done.stderr or f"'{10 * 'a'}" in done.stderr  # or what could be meant in its place
    assert "aaa" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "arguments", [("run", "-o", ""), ("paper", "-o", ""), ("export", "x", "--out", ""), ("replay", "x", "--save", "")]
)
def test_an_empty_name_is_no_place(here, tmp_path, arguments):
    done = here(*arguments)
    assert done.exit_code == 2
    assert "must not be empty" in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("fosm.K=2", "fosm.K: fosm has no such gain; choose from A, F_1, F_2, K_s"),
        ("gsta.name=sta", "gsta.name: gsta has no such gain"),
        ("fosm=3", "fosm: fosm has no such gain"),
        ("gsta.nominal=false", "gsta.nominal: cannot be set"),
    ],
)
def test_paper_names_the_gain_that_was_typed(here, setting, said):
    done = here("paper", "-o", "x", setting)
    assert done.exit_code == 2
    assert said in done.stderr
    assert not Path("x").exists()


@pytest.mark.parametrize("command", ["run", "converge"])
def test_help_names_every_law_and_every_kind_of_file(here, command):
    said = " ".join(here(command, "--help").stdout.split())
    said = said[said.index("--controller LAW") : said.index("--set KEY=VALUE")]
    for name in {*SHIPPED} - {"external"}:  # which no command can run
        assert re.search(rf"\b{name}\b", said), name
    for ending in (".py:", ".c,", ".so:", ".fmu"):
        assert ending in said


def test_help_teaches_and_lists(here):
    assert "uvms-mj run --controller gsta" in here("--help").stdout
    text = here("run", "--help").stdout
    for option in ("--controller", "--set", "--out", "--log-rate", "--json", "--quiet"):
        assert option in text
    text = here("controllers").stdout
    for word in ("gsta", "fosm", "impedance", "k_1", "K_s", "epsilon", "period", "m/s^3", "nominal"):
        assert word in text
    assert "wall.stiffness" in here("keys").stdout


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[[" * 3000, "nested too deeply"),
        ("x = " + "[" * 3000 + "]" * 3000, "nested too deeply"),
        ("x = " + "9" * 5000, "thousands of digits"),
        ("a." * 60_000 + "a = 1", "fifty words"),
        ('"a".' * 60_000 + "a = 1", "fifty words"),
        ("x" * 2_000_000, "more than 1000000 characters"),
    ],
)
def test_toml_is_read_in_bounded_time(here, text, said):
    start = time.monotonic()
    with pytest.raises(ValueError, match=said if text[0] != "[" else "."):
        parsed_toml(text)
    Path("x.toml").write_text(text)
    done = here("run", "x.toml")
    assert (done.exit_code, "not a scenario in TOML" in done.stderr) == (2, True)
    assert time.monotonic() - start < 5.0


def test_settings_that_are_deep_or_long_are_refused(here):
    for value in ("[" * 3000, "[" * 3000 + "]" * 3000, "9" * 5000, "0x" + "f" * 5000):
        for key in ("reference.waypoints", "wall.stiffness"):
            done = here("run", "--set", f"{key}={value}")
            assert done.exit_code == 2, done.output
            assert len(done.stderr) < 1000
    with pytest.raises(InputError, match="one key and one value"):
        parse_setting("wall.stiffness=1\nx=2")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", "-c", "gsta", "-c", "fosm"), "--controller is given more than once"),
        (("run", "-o", "a", "--out", "b"), "--out is given more than once"),
        (("run", "--set", "wall.damping=1", "wall.damping=2"), "wall.damping: is given twice, 1 and 2"),
        (("export", "", "--to", "csv"), "must not be empty"),
        (("info", ""), "must not be empty"),
        (("run", ""), "must not be empty"),
    ],
)
def test_what_is_said_twice_or_not_at_all_is_refused(here, arguments, said):
    done = here(*arguments)
    assert done.exit_code == 2
    assert said in done.stderr
    assert not list(Path().iterdir())


def test_flags_and_settings_may_be_repeated(here):
    done = here("run", "-q", "-q", "-s", "simulation.duration=0.002", "-s", "wall.damping=1", "wall.damping=1")
    assert done.exit_code == 0, done.stderr
