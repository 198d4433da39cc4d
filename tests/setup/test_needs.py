"""The tables that a stage reads are those that it names, so that a reset asks it again whenever one of them changes."""

import dataclasses
from typing import Any

import pytest

from uvms_mj import Scenario
from uvms_mj.errors import InputError
from uvms_mj.scenario import STAGES
from uvms_mj.setup.base import set_up

TIMING = {"simulation.timestep", "controller.delay", "controller.period"}
FIXED = {"vehicle", "wall.present", "task.frame", "impedance.natural", "observer.runs"}
"""What a reset can't change."""


class Reader:
    """A record whose attributes are noted when they are read; ``name`` is its key, empty for a setup or a scenario.

    M_d of the design stands for the keys on which it depends.
    """

    def __init__(self, of: Any, notes: set[str], name: str = "") -> None:
        self._of, self._notes, self._name = of, notes, name

    def __getattr__(self, word: str) -> Any:
        value = getattr(self._of, word)
        if self._name:
            of_M_d = self._name == "design" and word in ("M_d", "M_d_inv")
            self._notes.update(("impedance.M_d", "initial.joints") if of_M_d else (f"{self._name}.{word}",))
            return value
        if word == "design":
            return Reader(value, self._notes, word)
        if isinstance(self._of, Scenario) and word in {field.name for field in dataclasses.fields(Scenario)}:
            return Reader(value, self._notes, word)
        if word == "initial":  # that of the frame of the task
            self._notes.update(f"initial.{key}" for key in ("position", "attitude_deg", "joints"))
        return Reader(value, self._notes) if isinstance(value, Scenario) else value


SHIPPED = [(table, name) for table, choice in STAGES.items() for name in choice.shipped]
NEEDED: dict[str, dict[str, Any]] = {
    "path": {"reference.poses": [{"position": [0.5, 0.0, 0.0], "attitude_deg": [0.0, 0.0, 5.0]}]},
    "along_wall": {"reference.points": [[0.0, 0.1], [0.1, 0.1]]},
}


@pytest.mark.parametrize(("table", "name"), SHIPPED, ids=lambda part: part)
def test_errors_and_constants_of_a_stage_depend_on_what_it_names_only(table, name):
    if name == "pwm" or STAGES[table].shipped[name].external or not STAGES[table].shipped[name].runs:
        pytest.skip("the loop does not call it")
    base = "tool_push" if table in ("encoder", "wrist", "joints") else "push_wall"
    overrides = {f"{table}.name": name, **NEEDED.get(name, {})}
    if table == "wrist":
        overrides["wrist.site"] = "gripper"
    try:
        setup = set_up(Scenario.load(base, overrides))
    except InputError as error:
        pytest.fail(f"give the settings that it needs: {error}")
    stage, read = getattr(setup.scenario, table), set[str]()
    if table == "joints":
        stage = stage.resolved(setup)
    spy: Any = Reader(setup, read)
    list(stage.faults(spy))
    stage.constants(spy)
    known = TIMING | {table, *(type(stage).needs or ())}
    if type(stage).needs is not None:
        unknown = {key for key in read if not {key, key.partition(".")[0]} & (known | FIXED)}
        assert not unknown
