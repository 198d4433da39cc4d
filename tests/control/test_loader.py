"""Files with laws: what cannot be loaded is explained, and names of states are checked."""

import os
import sys

import pytest

from law_files import law_file, one_liner
from uvms_mj import Controller, Gsta, Ideal, InputError, Scenario, Trace
from uvms_mj.engine.native.run_memory import check_states
from uvms_mj.stages.loader import load_file

SHORT = {"simulation.duration": 0.2}


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("nowhere.py:Law", "no file"),
        ("{path}:Lew", "its laws are Law"),
        ("{path}", "names no class; give"),
        ("{broken}:Law", "line 3"),
        ("{failing}:Law", "line 2: ZeroDivisionError"),
        ("{undecorated}:Law", "@dataclass"),
        ("{empty}:Law", "no method 'law'"),
        ("{sizeless}:Law", "states.x: 0 must be a whole number from 1"),
        ("{listed}:Law", "a setting is a tuple: write (80.0, ...) in place of [80.0, ...]"),
        ("{named}:Law", "'label' is an attribute of every law"),
        ("{short}:Law", "must take (gains, state, signals, state_dot, tau_cmd)"),
    ],
)
def test_a_law_that_cannot_be_loaded_is_explained(tmp_path, source, reason):
    good = one_liner("Law", "tau_cmd[:] = 0.0")
    files = {
        "path": law_file(tmp_path, good),
        "broken": law_file(tmp_path, "\n\ndef (:\n", "broken.py", ""),
        "failing": law_file(tmp_path, "\n1 / 0\n", "failing.py", ""),
        "undecorated": law_file(tmp_path, good.replace("@dataclass(frozen=True)", ""), "undecorated.py"),
        "named": law_file(tmp_path, good.replace("    @static", "    label: float = 1.0\n\n    @static"), "named.py"),
        "short": law_file(tmp_path, good.replace("state_dot, ", ""), "short.py"),
        "sizeless": law_file(tmp_path, f"{good}    states = {{'x': 0}}\n", "sizeless.py"),
        "listed": law_file(tmp_path, f"{good}    k: tuple[float, ...] = gain([1.0], '1', 'k')\n", "listed.py"),
        "empty": law_file(
            tmp_path, "@dataclass(frozen=True)\nclass Law(Controller):\n    k: float = 1.0\n", "empty.py"
        ),
    }
    with pytest.raises(InputError) as caught:
        Scenario.load("push_wall", controller=source.format(**files))
    assert reason in str(caught.value)


def test_a_state_may_not_take_the_name_of_a_recorded_signal(tmp_path):
    path = law_file(tmp_path, one_liner("Taken", "tau_cmd[:] = 0.0") + "    states = {'s': 6}\n")
    with pytest.raises(InputError, match="'s' is the name of a signal; give the state another name"):
        Scenario.load("push_wall", SHORT, f"{path}:Taken")


@pytest.mark.parametrize("name", sorted({name for name in dir(Trace) if name[0] != "_"}))
def test_a_state_may_not_hide_what_a_trace_has(name):
    with pytest.raises(InputError, match=f"'{name}'.*is the name of"):
        check_states([(Ideal(), name)], set())


def test_updating_a_scenario_keeps_a_law_that_has_no_file():
    import dataclasses

    @dataclasses.dataclass(frozen=True)
    class Local(Gsta):
        pass

    Local.name = ""
    scenario = Scenario.load("push_wall").updated({"wall.position": 2.0})
    assert scenario.controller == Gsta()
    mine = dataclasses.replace(scenario, controller=Local(k_1=3.0)).updated({"controller.k_2": 4.0})
    assert mine.controller == Local(k_1=3.0, k_2=4.0)
    assert isinstance(mine.controller, Controller)


def test_the_second_of_two_edits_within_a_second_is_seen(tmp_path):
    """Also in a file that the first one imports. Byte code of the first edit would have the time and size of both."""
    path, beside = tmp_path / "first_of_two.py", tmp_path / "second_of_two.py"
    path.write_text("from second_of_two import x\n")
    for value in (1, 2):
        beside.write_text(f"x = {value}\n")
        for each in (path, beside):
            os.utime(each, (1e9, 1e9))
        sys.modules.pop("second_of_two", None)
        module = load_file(path, "controller.name")
        assert module.x == value
    assert not (tmp_path / "__pycache__").exists()
