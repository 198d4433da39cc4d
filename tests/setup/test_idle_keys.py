"""Keys of the water that have no effect, since there is no wave, tether, sine, gust or volume: said or refused."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, Simulation
from uvms_mj.plant.effects import each_table, effect_tables
from uvms_mj.setup.checks import checked, warnings_of

GIVEN = {  # keys whose default says no number
    "current.table": [[0.0, 0.1, 0.0, 0.0], [1.0, 0.2, 0.0, 0.0]],
    "current.shear": [[0.0, 1.0], [1.0, 0.5]],
    "current.shortest_gust": 2.0,
    "disturbance.table": [[0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0]],
    "sea.spreading": 2.0,
    "sea.depth": 30.0,
    "sea.seed": 3,
    "tether.stiffness": 1e4,
    "tether.floor": -3.0,
    "obstacle.wall": "wall",
    "obstacle.half_width": 1.0,
    "buoyancy.shapes": [{"shape": "box", "edges": [0.4, 0.4, 0.4]}],
}
WITH = {  # what a key that has an effect needs beside it
    "current.amplitude": {"current.frequency_hz": (0.2, 0.2, 0.2)},
    "disturbance.amplitude": {"disturbance.frequency_hz": (0.2,) * 6},
    "obstacle.wall": {"obstacle.half_width": 1.0},
    "buoyancy.shapes": {"sea.surface": -0.3},
}


def another(key: str, default: Any) -> Any:
    """A value of a key that is not its default."""
    if key in GIVEN:
        return GIVEN[key]
    if isinstance(default, bool):
        return not default
    if isinstance(default, str):
        return "jonswap"
    if isinstance(default, tuple):
        return (0.2,) * len(default)
    return default + (2 if isinstance(default, int) else 0.3)


BASE = {
    "current.direction_deg": 10.0,
    "initial.position": (0.0, 0.0, -0.3),
    "initial.velocity": (0.1, 0.1, 0.1, 0.1, 0.1, 0.1),
    "controller.name": "impedance",
    "simulation.timestep": 1e-3,
}


def motion(scenario: Scenario) -> bytes:
    """The state of a vehicle after 30 steps."""
    with Simulation(scenario, engine="free_body") as sim:
        sim.step(30)
        return b"".join(np.array(sim.signals[name]).tobytes() for name in ("p_WB", "quat_WB", "nu"))


def keys() -> list[tuple[str, Any]]:
    tables = [(key, table) for _, key, table in each_table(effect_tables(Scenario()))]
    return [(f"{key}.{field.name}", field.default) for key, table in tables for field in dataclasses.fields(table)]


PICTURES = {"sea.surface"}
"""Keys that views show where nothing else follows from them."""


@pytest.mark.parametrize(("key", "default"), [each for each in keys() if each[0] not in PICTURES])
def test_a_key_is_named_if_and_only_if_the_run_stays_the_same(key: str, default: Any) -> None:
    try:
        given = Scenario.load("push_wall", BASE | {key: another(key, default)} | WITH.get(key, {}))
        notes = warnings_of(checked(given))
    except InputError as error:
        wrong = str(error)
        assert any(word in wrong for word in ("belongs to", "which a tether is with", "needs a length")), wrong
        assert key.rpartition(".")[2] in wrong, wrong
        return
    named = any("no effect" in note and key in note for note in notes)
    assert named == (motion(given) == motion(Scenario.load("push_wall", BASE)))


def test_a_key_that_has_an_effect_is_not_named() -> None:
    acts = {"sea.height": 0.2, "sea.period": 5.0, "sea.direction_deg": 30.0} | {
        "tether.length": 3.0,
        "tether.diameter": 0.01,
        "current.deviation": (0.1, 0.0, 0.0),
        "current.correlation_time": 5.0,
        "disturbance.amplitude": (1.0,) * 6,
        "disturbance.frequency_hz": (0.3,) * 6,
        "walls": [{"shape": "plane", "position": (3.0, 0.0, 0.0), "frequency_hz": 0.1, "amplitude": (0.1, 0.0, 0.0)}],
    }
    assert not [note for note in warnings_of(checked(Scenario.load("push_wall", acts))) if "no effect" in note]


def test_the_sine_of_a_wall_without_an_amplitude_is_named() -> None:
    wall = {"shape": "plane", "position": np.array([3.0, 0.0, 0.0]), "frequency_hz": 0.1}
    notes = warnings_of(checked(Scenario.load("push_wall", {"walls": [wall]})))
    assert "walls[0].frequency_hz has no effect: walls[0].amplitude is 0" in notes


BESIDE = {
    "impedance.damping_ratio": {"impedance.D_d": (50.0,) * 6},
    "impedance.damping_period": {"impedance.M_d": (20.0, 20.0, 20.0, 0.3, 0.3, 0.3)},
    "reference.step_time": {"reference.waypoints": [{"time": 0.005, "position": (0.5, 0.1, 0.0)}]},
    "reference.target": {"reference.waypoints": [{"time": 0.005, "position": (0.5, 0.1, 0.0)}]},
}
"""Keys in whose place the keys beside them act."""
OTHER = {
    "impedance.damping_ratio": 0.4,
    "impedance.damping_period": 2e-3,
    "reference.step_time": 0.01,
    "reference.target": (0.7, 0.2, 0.0),
}


@pytest.mark.parametrize("key", BESIDE)
def test_a_key_in_whose_place_another_one_acts_is_named(key: str) -> None:
    both = Scenario.load("push_wall", BASE | BESIDE[key] | {key: OTHER[key]})
    assert any("no effect" in note and key in note for note in warnings_of(checked(both)))
    assert motion(both) == motion(Scenario.load("push_wall", BASE | BESIDE[key]))


@pytest.mark.parametrize("key", ["impedance.damping_ratio", "reference.target"])
def test_it_acts_and_is_not_named_without_the_other_one(key: str) -> None:
    start = BASE | {"reference.step_time": 0.001}
    alone = Scenario.load("push_wall", start | {key: OTHER[key]})
    assert not any("no effect" in note for note in warnings_of(checked(alone)))
    assert motion(alone) != motion(Scenario.load("push_wall", start))


def test_a_reference_with_a_function_of_its_own_is_not_told_that_its_target_has_no_effect(tmp_path) -> None:
    """Its function may use the target and the waypoints."""
    (tmp_path / "own.py").write_text(
        "from dataclasses import dataclass\nfrom uvms_mj.guidance import FilteredSteps\n\n\n"
        "@dataclass(frozen=True)\nclass Own(FilteredSteps):\n    @staticmethod\n"
        "    def step(settings, state, given, state_dot, out):\n        out.quat_d[0] = 1.0\n"
    )
    keys = BESIDE["reference.target"] | {"reference.target": OTHER["reference.target"]}
    for name, told in (("filtered_steps", True), (f"{tmp_path / 'own.py'}:Own", False)):
        notes = warnings_of(checked(Scenario.load("push_wall", keys | {"reference.name": name})))
        assert any("no effect" in note for note in notes) == told
