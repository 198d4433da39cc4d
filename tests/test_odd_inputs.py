"""What a careless hand writes for the effects of the water and for walls: each error is a sentence with its place."""

import re

import pytest

from uvms_mj import InputError, Scenario, Simulation
from uvms_mj.setup.checks import checked

EFFECTS = """
from dataclasses import dataclass
import numpy as np
from uvms_mj import Controller, Effect, setting

@dataclass(frozen=True)
class Good(Effect):
    c: float = setting(2.0, "N", "force")

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        tau[:] = settings.c

@dataclass(frozen=True)
class Without(Effect):
    c: float = setting(2.0, "N", "force")

@dataclass(frozen=True)
class Few(Effect):
    @staticmethod
    def wrench(settings, given, tau):
        tau[:] = 0.0

@dataclass(frozen=True)
class Swapped(Effect):
    @staticmethod
    def wrench(settings, state, given, tau, state_dot):
        tau[:] = 0.0

@dataclass(frozen=True)
class Misspelt(Effect):
    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        tau[:] = given.f_normal

@dataclass(frozen=True)
class Law(Controller):
    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = 0.0

class Plain:
    pass
"""
NAN = float("nan")
BALL = {"shape": "sphere", "position": [1.0, 0.0, 0.0], "radius": 0.3}
FIN = {"area": 0.01, "position": [0.0, 0.0, 0.0]}
PAD = {"radius": 0.1, "position": [0.0, 0.0, 0.0]}
GOOD = {"name": "e.py:Good"}
ODD = [
    ({"current.speed": "fast"}, "current.speed"),
    ({"current.speed": NAN}, "current.speed"),
    ({"current.speed": -1}, "current.speed"),
    ({"current.speed": [0.2]}, "current.speed"),
    ({"current.speed": True}, "current.speed"),
    ({"current.speed": "0.3 m/s"}, "current.speed"),
    ({"current.speed": 300}, "current.speed"),
    ({"current.sped": 0.2}, "current.sped"),
    ({"sea.components": "30"}, "sea.components"),
    ({"sea.components": True}, "sea.components"),
    ({"sea.reflecting": "yes"}, "sea.reflecting"),
    ({"wall.present": 0}, "wall.present"),
    ({"posture.yaw": "yes"}, "posture.yaw"),
    ({"current": 0.2}, "current"),
    ({"current": {}}, "current"),
    ({"current.shear": []}, "current.shear"),
    ({"current.shear": [[0, 1, 2]]}, "current.shear"),
    ({"current.shear": [[1, 1], [0, 1]]}, "current.shear"),
    ({"current.amplitude": [0.1]}, "current.amplitude"),
    ({"current.amplitude": [0.1, 0, 0]}, "current.amplitude"),
    ({"current.amplitude": [0.1, 0, 0], "current.frequency_hz": [1e6, 0, 0]}, "current.frequency_hz"),
    ({"current.table": "not_there.csv"}, "current.table"),
    ({"current.table": [[0, 1, 1]]}, "current.table"),
    ({"disturbance.bias": [1, 2, 3]}, "disturbance.bias"),
    ({"disturbance.bias": 10}, "disturbance.bias"),
    ({"disturbance.bias": {"x": 1}}, "disturbance.bias"),
    ({"disturbance.bias": ["1 N", 0, 0, 0, 0, 0]}, "disturbance.bias"),
    ({"disturbance.deviation": [-1] * 6}, "disturbance.deviation"),
    ({"disturbance": [{}]}, "disturbance"),
    ({"walls": [{}]}, "walls[0]"),
    ({"walls": {}}, "walls"),
    ({"walls": BALL}, "walls"),
    ({"walls": ["sphere"]}, "walls[0]"),
    ({"walls": [BALL | {"radius": -0.3}]}, "walls[0].radius"),
    ({"walls": [BALL | {"edges": [1, 1, 1]}]}, "walls[0]"),
    ({"walls": [{"shape": "box", "position": [1, 0, 0], "edges": 1.0}]}, "walls[0].edges"),
    ({"walls": [BALL | {"shape": "cone"}]}, "walls[0].shape"),
    ({"walls": [BALL | {"position": [1, 0]}]}, "walls[0].position"),
    ({"walls": [BALL | {"stiffness": "1e4 N/m"}]}, "walls[0].stiffness"),
    ({"walls": [BALL | {"motion": [[1, 0, 0, 0], [0, 0, 0, 0]]}]}, "walls[0]"),
    ({"walls": [BALL | {"colour": "red"}]}, "walls[0].colour"),
    ({"walls[0].radius": 0.2}, "walls[0].radius"),
    ({"walls": [BALL], "walls[1].radius": 0.2}, "walls[1].radius"),
    ({"walls.radius": 0.2}, "walls.radius"),
    ({"walls[-1].radius": 0.2}, "walls[-1].radius"),
    ({"wall": [BALL]}, "wall"),
    ({"fins": [{}]}, "fins[0]"),
    ({"fins": FIN}, "fins"),
    ({"fins": 3}, "fins"),
    ({"fins": [FIN | {"area": 0}]}, "fins[0].area"),
    ({"fins": [FIN | {"stall_deg": 120}]}, "fins[0].stall_deg"),
    ({"fins": [FIN | {"stall": 0.3}]}, "fins[0].stall"),
    ({"fins": [FIN | {"mixing_deg": [1, 2]}]}, "fins[0].mixing_deg"),
    ({"drag": [{}]}, "drag[0].forward"),
    ({"drag": [{"forward": 3.0}]}, "drag[0].forward"),
    ({"drag": [{"forward": [-1, 1, 1]}]}, "drag[0].forward"),
    ({"drag": {"forward": [1, 1, 1]}}, "drag"),
    ({"drag": [{"forward": [1, 1, 1], "of_speed": "maybe"}]}, "drag[0].of_speed"),
    ({"sea": []}, "sea"),
    ({"sea.height": "1 m"}, "sea.height"),
    ({"sea.hight": 1.0}, "sea.hight"),
    ({"sea.height": 1.0, "sea.period": 0}, "sea.period"),
    ({"sea.height": 0.5, "sea.components": 2.5}, "sea.components"),
    ({"sea.height": 0.3, "initial.position": [0, 0, 2]}, "sea.surface"),
    ({"pads": [{}]}, "pads[0]"),
    ({"pads": PAD}, "pads"),
    ({"pads": [PAD], "wall.present": False}, "pads[0].point"),
    ({"pads": [PAD | {"radius": "10 cm"}]}, "pads[0].radius"),
    ({"pads": [PAD | {"position": [5.0, 0.0, 0.0]}]}, "pads[0].position"),
    ({"pads": [PAD | {"position": [0.0, 0.0, 2.0]}], "initial.attitude_deg": [0, 90, 0]}, "pads[0].position"),
    ({"pads": [PAD | {"normal": [0.0, 0.0, 1.0]}]}, "pads[0].normal"),
    ({"effects": "e.py:Good"}, "effects"),
    ({"effects": ["e.py:Good"]}, "effects[0]"),
    ({"effects": GOOD}, "effects"),
    ({"effects": None}, "effects"),
    ({"effects": [{}]}, "effects[0]"),
    ({"effects": [{"name": "not_there.py:Good"}]}, "effects[0].name"),
    ({"effects": [{"name": "e.py"}]}, "effects[0].name"),
    ({"effects": [{"name": "e.py:Better"}]}, "effects[0].name"),
    ({"effects": [{"name": "tether"}]}, "effects[0].name"),
    ({"effects": [{"name": 3}]}, "effects[0].name"),
    ({"effects": [{"name": "e.py:Without"}]}, "effects[0].name"),
    ({"effects": [{"name": "e.py:Few"}]}, "effects[0].name"),
    ({"effects": [{"name": "e.py:Swapped"}]}, "effects[0].name"),
    ({"effects": [{"name": "e.py:Misspelt"}]}, "effects[0].name"),
    ({"effects": [{"name": "e.py:Law"}]}, "effects[0].name"),
    ({"effects": [{"name": "e.py:Plain"}]}, "effects[0].name"),
    ({"effects": [GOOD | {"c": NAN}]}, "effects[0].c"),
    ({"effects": [GOOD | {"cc": 1.0}]}, "effects[0].cc"),
    ({"effects": [GOOD | {"at": "nowhere"}]}, "effects[0].at"),
    ({"effects": [GOOD] * 9}, "effects"),
    ({"effects": [GOOD], "effects[1].c": 2.0}, "effects[1].c"),
    ({"effects": [GOOD], "effects.c": 2.0}, "effects.c"),
    ({"effects": [GOOD], "effects.0.c": 2.0}, "effects.0.c"),
    ({"effect": [GOOD]}, "effect"),
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "e.py").write_text(EFFECTS)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("odd", "place"), ODD, ids=lambda each: each if isinstance(each, str) else "")
def test_an_odd_input_is_refused_in_a_sentence_that_names_its_place(folder, odd, place):
    with pytest.raises(InputError) as raised:
        checked(Scenario.load("push_wall", odd))
    for fault in raised.value.faults:
        assert re.match(rf"{re.escape(place)}(\[\d\]|\.\w+)*$", fault.key), fault
        assert "\n" not in fault.message
        assert not re.search(r"Error\b|<class|choose from *;|choose from *$|no valid choices", fault.message), fault
    assert len({fault.message for fault in raised.value.faults}) <= 2  # all say the same of each entry


@pytest.mark.parametrize(("odd", "words"), [
    ({"walls.radius": 0.2}, r"walls is a list of tables; a key of its first one is walls\[0\].radius"),
    ({"effects.0.c": 0.2}, r"effects is a list of tables; a key of its first one is effects\[0\].c"),
    ({"effect": [GOOD]}, "the list is called effects"),
    ({"effects": [{"name": "tether"}]}, "no effect 'tether'; for your own effect give path/to/file.py:ClassName"),
    ({"effects": [{"name": "e.py:Swapped"}]}, r"wrench must take \(settings, state, given, state_dot, tau\)"),
])  # fmt: skip
def test_it_says_what_to_write(folder, odd, words):
    with pytest.raises(InputError, match=words):
        Scenario.load("push_wall", odd)


@pytest.mark.parametrize("odd", [{"effects": [GOOD]}, {"fins": [FIN]}, {"sea.height": 0.1}, {"walls": [BALL]}])
def test_a_reset_that_would_add_one_is_refused_and_changes_nothing(folder, odd):
    with Simulation(Scenario.load("push_wall"), engine="free_body") as sim:
        sim.step(10)
        before = sim.signals.nu.copy()
        with pytest.raises(InputError, match=rf"reset: {next(iter(odd)).split('.')[0]}: reset can't"):
            sim.reset(odd)
        assert (sim.signals.nu == before).all()
