"""The commands that list stages, keys and signals."""

import re

import pytest

from uvms_mj.cli.listing import stage_list
from uvms_mj.scenario import CHOICES, STAGES
from uvms_mj.stages.signals import GIVEN, RECORDED, TRUE, actuation_given, thrusters_given

HEADINGS = re.compile(r"^\[\w+\]$|^\w+: ", re.MULTILINE)
"""Tables of a scenario, and titles of stages, in a listing."""


def test_keys_and_signals_list_all(here):
    text = "".join(here("keys").stdout.split())
    listed = ("controller.period", "task.F_1", "task.integral", "simulation.seed", "{time=1.0,position=[1.01")
    for word in (*listed, *(f"{table}.name" for table in STAGES)):
        assert word in text
    text = here("signals").stdout
    for each in (*GIVEN, *TRUE, *actuation_given(6), *thrusters_given(6), *RECORDED):
        assert each.name in text


def test_stages_lists_all_with_settings_and_states(here, tmp_path):
    """`controllers` is the part of `stages` for laws; a stage of a file is listed as a shipped one is."""
    text = here("stages").stdout
    rooms = {"guidance": "reference", "navigation": "navigation", "control": "controller", "actuation": "actuation"}
    for room, table in rooms.items():
        part = here("stages", room).stdout
        assert part in text
        assert here("stages", table).stdout == part
        for name, cls in ((name, cls) for choice in _choices(room) for name, cls in choice.shipped.items()):
            assert f"{name}: " in part
            for word in (*(field.name for field in cls.setting_fields()), *cls.states):
                assert word in part, (name, word)
    assert here("controllers").stdout in here("stages", "control").stdout
    assert "zeta (6)" in here("stages", "control").stdout
    listed = [(f"[{table}]", list(choice.shipped)) for table, choice in STAGES.items()]
    listed.insert(list(STAGES).index("controller"), ("[task]", ["impedance_task"]))
    expected = [word for table, names in listed for word in (table, *(f"{name}: " for name in names))]
    assert HEADINGS.findall(text) == expected  # the name of a table stands before its stages
    (tmp_path / "lag.py").write_text(LAG)
    own = here("stages", "actuation", f"{tmp_path / 'lag.py'}:Lag").stdout
    for word in ("Lag: Slow thrusters.", "T_u", "0.3", "thrust (thrusters)"):
        assert word in own
    wrong = here("stages", "navigation", f"{tmp_path / 'lag.py'}:Lag")
    assert wrong.exit_code == 2
    assert "it is an actuation stage: use actuation.name" in wrong.stderr


def test_the_summary_of_a_stage_is_whole():
    """A summary of several lines is not cut at the first."""
    for cls in (each for choice in CHOICES.values() for each in choice.shipped.values()):
        title = stage_list(cls).title
        assert title.endswith((".", ": ")) or not cls.__doc__ or cls.__doc__.startswith(cls.__name__), title


def test_stages_finds_a_stage_by_its_name_in_whatever_room(here, tmp_path):
    (tmp_path / "lag.py").write_text(LAG)
    own = f"{tmp_path / 'lag.py'}:Lag"
    assert (
        here("stages", "gsta").stdout == here("stages", "control", "gsta").stdout == here("controllers", "gsta").stdout
    )
    assert here("stages", "t200").stdout == here("stages", "actuation", "t200").stdout  # of another table of this room
    assert here("stages", own).stdout == here("stages", "actuation", own).stdout
    assert here("stages", "impedance_task").stdout == here("stages", "task").stdout
    both = here("stages", "none", "ekf").stdout  # three tables have it, and every name is listed
    three = ("[wrist]", "none: ", "[observer]", "none: ", "[controller]", "none: ")
    assert HEADINGS.findall(both) == [*three, "[navigation]", "ekf: "]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["gst"], "no stage 'gst'; did you mean 'gsta'?; for your own give path/to/file.py:ClassName"),
        (["navigaton"], "no stage 'navigaton'; did you mean 'navigation'?; for your own"),
        (
            ["guidance", "ekf"],
            "no stage 'ekf' in guidance; choose from along_surface, along_wall, circle, filtered_steps, path, spline; ",
        ),
        (["gsta", "control"], "no stage 'control'; choose from admittance, aismc, "),  # a room comes first
        (["lag.py"], "'lag.py' names no class; give lag.py:Lag"),
        (["no.py:Lag"], "no file 'no.py' (looked in "),
        (["none.py:Lag"], "no stage 'Lag' in none.py; it has none"),
        (["lag.py:Leg"], "no stage 'Leg' in lag.py; did you mean 'Lag'?"),
    ],
)
def test_a_wrong_name_of_a_stage_is_one_sentence(here, tmp_path, words, said):
    (tmp_path / "lag.py").write_text(LAG)
    (tmp_path / "none.py").write_text("class Lag: pass")
    done = here("stages", *words)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"error: {said}")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("table", ["wall", "simulation", "impedance"])
def test_keys_of_a_table_are_the_lines_of_the_whole_list_that_begin_with_it(here, table):
    def listed(*words):
        return [line.split()[1] for line in here("keys", *words).stdout.splitlines() if re.match(r"│ \S", line)]

    every = listed()
    assert listed(table) == [key for key in every if key.startswith(table)]
    assert listed(table.upper()) == listed(table)
    assert listed(table, "tether") == [key for key in every if key.startswith((table, "tether"))]
    assert {"wall.stiffness", "bumper.stiffness", "impedance.K_d"} < {*listed("stiffness")}  # the last by its meaning


def test_signals_of_a_stage_and_signals_of_a_name(here):
    def titles(*words):
        return re.findall(r"^(\w+ .*?)(?:: .*)?$", here("signals", *words).stdout, re.MULTILINE)

    def names(*words):
        return [line.split()[1] for line in here("signals", *words).stdout.splitlines() if re.match(r"│ \S", line)]

    assert titles("law") == titles("controller") == ["Inputs of the law"]
    assert names("law") == [signal.name for signal in GIVEN]
    assert titles("sensor") == ["Inputs of the navigation stage", "Outputs of the navigation stage"]
    assert names("law", "s") == ["s"]  # the signal itself, not all with an s
    assert {"f_contact_W", "force_peak"} <= {*names("recorded", "force")}
    assert set(names("force")) <= set(names())
    assert "touches" not in names("force")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["keys", "stifness"], "no key has 'stifness' in its name or meaning; did you mean 'stiffness'?"),
        (["keys", "controller.k_1"], "it is a setting of gsta, sta: uvms-mj stages gsta"),
        (["keys", "zzzz"], "no key has 'zzzz' in its name or meaning; uvms-mj keys lists all"),
        (["signals", "laww"], "no signal has 'laww' in its name or meaning; did you mean 'law'?"),
        (["signals", "law", "f_contact_W"], "no signal has 'f_contact_W' in its name or meaning; did you mean"),
    ],
)
def test_a_word_that_no_key_and_no_signal_has_is_one_sentence(here, words, said):
    done = here(*words)
    assert done.exit_code == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


def test_words_for_stages_choose_their_table(here):
    assert here("stages", "law").stdout == here("stages", "controller").stdout
    assert HEADINGS.findall(here("stages", "sensor", "perfect").stdout) == ["[navigation]", "perfect: "]


def _choices(room):
    return [choice for choice in STAGES.values() if choice.base.room.name == room]


LAG = """
from dataclasses import dataclass
from uvms_mj.actuation import Actuation
from uvms_mj.stages.base import setting

@dataclass(frozen=True)
class Lag(Actuation):
    "Slow thrusters."
    T_u: float = setting(0.3, "s", "time constant")
    states = {"thrust": "thrusters"}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        u[:] = state.thrust
"""
