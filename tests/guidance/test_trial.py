"""A user's reference without states is tried out before the run: its beginning, and p_d_dot."""

import pytest

from uvms_mj import Scenario
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import warnings_of

HEADER = """
import math
from dataclasses import dataclass
from uvms_mj import Guidance, setting
from uvms_mj.guidance import station_keep

def angle(t):
    return 0.5 * t

@dataclass(frozen=True)
class Wave(Guidance):
    factor: float = setting(1.0, "1", "of p_d_dot")
    shift: float = setting(0.0, "m", "of the beginning")
"""
STEP = """
    @staticmethod
    def step(settings, state, given, state_dot, out):
        station_keep(settings, given, out)
        print("called")
        out.p_d[1] = settings.shift + 0.1 * (1.0 - math.cos(angle(given.t)))
        out.p_d_dot[1] = settings.factor * 0.05 * math.sin(angle(given.t))
"""


@pytest.fixture
def notes(tmp_path):
    """A function that gives the warnings about a run with the reference, with changes of its text and settings."""

    def of(settings=(), more="", old="", new=""):
        (tmp_path / "wave.py").write_text(HEADER + more + STEP.replace(old, new))
        name = {"reference.name": f"{tmp_path / 'wave.py'}:Wave", "wall.position": 5.0}
        said = warnings_of(set_up(Scenario.load("push_wall", name | dict(settings))))
        return [note for note in said if "Wave" in note]

    return of


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"controller.period": 0.05},
        {"reference.period": 0.1},
        {"initial.velocity": [0.2, 0.3, 0.0, 0.0, 0.0, 0.1]},
        {"initial.position": [0.1, 0.0, 0.3], "simulation.duration": 1e-3},
        {"initial.attitude_deg": [0.0, 0.0, 20.0], "reference.attitude_deg": [0.0, 0.0, 20.0]},
    ],
)
def test_a_reference_that_is_right_has_no_warning(notes, settings, capsys):
    assert notes(settings) == []
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("factor", [0.5, -1.0, 1.5])
def test_a_rate_that_is_not_the_derivative_is_announced(notes, factor):
    (said,) = notes({"reference.factor": factor})
    assert said.startswith("Wave: p_d_dot[1] is not the derivative of p_d: at 2.857 s it is ")


def test_a_reference_that_begins_far_from_the_vehicle_is_announced(notes):
    assert notes({"reference.shift": 0.3}) == [
        "the law sees a jump at the start: Wave begins 0.3 m and 0 deg from the vehicle's initial pose"
    ]
    (said,) = notes({"reference.attitude_deg": [0.0, 0.0, 30.0]})
    assert "0 m and 30 deg" in said


@pytest.mark.parametrize(
    "change",
    [
        {"more": '    states = {"x": 1}\n    units = {"x": "m"}\n'},
        {"more": '    memory = {"x": 1}\n'},
        {"old": 'print("called")', "new": "raise ValueError"},
        {"old": 'print("called")', "new": "raise SystemExit"},
        {"old": "station_keep(settings, given, out)", "new": "return"},
    ],
)
def test_a_reference_with_states_or_that_fails_has_no_warning(notes, change):
    assert notes({"reference.factor": 2.0, "reference.shift": 1.0}, **change) == []
