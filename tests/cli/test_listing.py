"""The commands that list stages, keys and signals."""

from uvms_mj.scenario import STAGES
from uvms_mj.stages.signals import GIVEN, RECORDED, TRUE, actuation_given, thrusters_given


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
    (tmp_path / "lag.py").write_text(LAG)
    own = here("stages", "actuation", f"{tmp_path / 'lag.py'}:Lag").stdout
    for word in ("Lag: Slow thrusters.", "T_u", "0.3", "thrust (thrusters)"):
        assert word in own
    wrong = here("stages", "navigation", f"{tmp_path / 'lag.py'}:Lag")
    assert wrong.exit_code == 2
    assert "it is an actuation stage: use actuation.name" in wrong.stderr


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
