"""A reset writes the numbers that a setup made from the scenario alone gives, whatever keys it changes."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from everything import EVERYTHING
from tree_run import AT_TOOL, MOVING
from uvms_mj import InputError, Scenario, Simulation
from uvms_mj.scenario import LISTS
from uvms_mj.setup.checks import checked

USERS = Path(__file__).parents[1] / "data" / "users_stages.py"
IN_WATER = {
    **{"sea.height": 0.4, "sea.spectrum": "jonswap", "sea.reflecting": True, "sea.surface": 3.0, "sea.components": 3},
    **{"obstacle.half_width": 1.5, "current.direction_deg": 30.0},
    "pads": [{"radius": 0.1, "position": [0.2, 0.0, 0.0]}],
    "near_wall": [{"radius": 0.2}],
    "fins": [{"area": 0.02, "position": [-0.2, 0.0, 0.0], "mixing_deg": [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]}],
    "drag": [{"forward": [1.0, 2.0, 3.0]}],
    "walls": [{"shape": "plane", "position": [0.0, 0.0, -1.0], "motion": [[0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.1]]}],
    **{"tether.length": 2.0, "bumper.stiffness": 3e4, "wall.friction": 0.2},
    **{"controller.name": f"{USERS}:Pid", "controller.period": 4e-4},
}
RUNS = {
    "the paper's": ("mujoco", {}),
    "sensors": ("free_body", EVERYTHING["sensors"]),
    "in water": ("free_body", IN_WATER),
    "at the surface": (
        "free_body",
        {
            "buoyancy.shapes": [{"shape": "box", "edges": [0.5, 0.3, 0.25]}, {"shape": "sphere", "radius": 0.1}],
            **{"sea.height": 0.2, "sea.surface": 0.3, "tether.length": 2.0, "controller.name": "impedance"},
        },
    ),
    "a tool": (
        "mujoco",
        MOVING | AT_TOOL | {"controller.name": "impedance", "wrist.name": "sensor", "wrist.site": "tool"},
    ),
}
GIVEN = {
    "current.table": [[0.0, 0.1, 0.0, 0.0], [0.2, 0.0, 0.1, 0.0]],
    "current.shear": [[0.0, 1.0], [5.0, 0.5]],
    "disturbance.table": [[0.0] * 7, [0.01, 1.0, 0.0, 2.0, 0.0, 0.0, 0.0]],
    "disturbance.deviation": [1.0] * 6,
    "impedance.M_d": [20.0, 25.0, 25.0, 4.0, 4.0, 4.0],
    "impedance.D_d": [90.0, 95.0, 95.0, 14.0, 14.0, 14.0],
    "wall.tangential_damping": 30.0,
    "walls[0].damping": 3.0,
    "walls[0].motion": [[0.0, 0.0, 0.0, 0.0], [1.0, 0.1, 0.0, 0.1], [2.0, 0.0, 0.0, 0.1]],
    "pads[0].radius": 0.2,
    "near_wall[0].radius": 0.15,
    "fins[0].area": 0.03,
    "drag": [],
    "estimates.links": [{"name": "rod", "inertia": 1.5}],
    "sea.height": 0.0,
    "buoyancy.shapes": [{"shape": "capsule", "radius": 0.1, "length": 0.5}],
}
"""Keys whose other value is not a number near the old one."""


def other(value, random):
    """A number or numbers near the old ones, or None."""
    if isinstance(value, bool) or value is None:
        return None
    if isinstance(value, int):
        return value + 1
    if isinstance(value, float):
        return float(value * random.choice([0.5, 0.9, 1.1]) or random.choice([0.01, 0.1]))
    numbers = isinstance(value, tuple) and value and all(isinstance(each, float) for each in value)
    return [other(each, random) for each in value] if numbers else None


def changes(scenario, random):
    """Another value of each key of a scenario that has one."""
    found = dict(GIVEN)
    for table in dataclasses.fields(scenario):
        if table.name not in (*LISTS, "name", "description"):
            of = getattr(scenario, table.name)
            for field in dataclasses.fields(of):
                if (value := other(getattr(of, field.name), random)) is not None:
                    found.setdefault(f"{table.name}.{field.name}", value)
    return found


def numbers(sim):
    """The numbers in memory, as integers, so that each bit counts."""
    return sim._memory.image.numbers.view("i8").copy()


def written_as_a_whole(sim, scenario):
    """The numbers in memory at the start of a scenario whose setup is made anew."""
    sim._memory.restart(checked(scenario))
    sim._prepare()
    return numbers(sim)


@pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")
@pytest.mark.parametrize("name", RUNS)
def test_a_reset_of_any_keys_writes_what_a_new_setup_gives(name):
    """Keys in random order, alone or with the key before, directly after another reset or after steps."""
    engine, keys = RUNS[name]
    random, taken = np.random.default_rng(0), 0
    base = Scenario.load("push_wall", {"simulation.duration": 0.3, **keys})
    with Simulation(base, engine=engine) as sim:
        found, before, last = changes(base, random), {}, "current.table"
        for key in random.permutation(list(found))[:90].tolist():
            overrides = {key: found[key]} | (before if random.random() < 0.3 else {})
            before = {key: found[key]}
            if random.random() < 0.2:
                sim.step(3)
            try:
                if random.random() < 0.5:
                    sim.reset({last: found[last]})
                last = key
                sim.reset(overrides)
            except InputError:
                continue
            taken += 1
            assert np.array_equal(numbers(sim), written_as_a_whole(sim, base.updated(overrides))), overrides
            if taken % 8 == 0:
                sim.reset()
                assert np.array_equal(numbers(sim), written_as_a_whole(sim, base)), key
    assert taken > 30, taken


FEWER = {
    "a pad, a hull, many waves and a cable": {
        "pads": [{"radius": 0.1, "position": [0.2, 0.0, 0.0]}],
        "near_wall": [{"radius": 0.2}],
        **{"sea.height": 0.3, "sea.spectrum": "jonswap", "initial.position": [0.0, 0.0, 0.1]},
        **{"tether.length": 3.0, "tether.elements": 3, "tether.anchor": [-2.5, 0.0, 0.0]},
    },
    "fins, drag, a tether and what the current meets": {
        "fins": [{"area": 0.02, "position": [-0.2, 0.0, 0.0], "mixing_deg": [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]}] * 2,
        "drag": [{"forward": [30.0, 20.0, 10.0]}],
        "tether.length": 3.0,
        **{"obstacle.half_width": 1.5, "current.direction_deg": 30.0},
    },
}
WITHOUT = {
    **{"pads": [], "near_wall": [], "sea.spectrum": "regular", "fins": [], "drag": [], "obstacle.half_width": None},
    **{"tether.length": 0.0, "tether.elements": 0, "tether.anchor": [0.0, 0.0, 0.0]},
}


@pytest.mark.parametrize("name", FEWER)
@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_reset_that_takes_effects_away_steps_as_a_new_simulation(engine, name):
    """To the bit, though the memory has room for the effects."""
    turns = {"initial.velocity": [0.3, 0.1, -0.1, 0.2, 0.3, -0.2], "initial.attitude_deg": [5.0, 10.0, 0.0]}
    base = Scenario.load("push_wall", turns | FEWER[name] | {"simulation.timestep": 1e-3}, "impedance")
    taken = {key: value for key, value in WITHOUT.items() if key in FEWER[name]}
    with Simulation(base, engine=engine) as sim, Simulation(base.updated(taken), engine=engine) as new:
        sim.step(20)
        with_it = sim.signals.nu.copy()
        sim.reset(taken)
        for each in (sim, new):
            each.step(20)
        assert not np.array_equal(sim.signals.nu, with_it)
        found = {signal.name: memory for signal, memory in sim.memory.recorded}
        for signal, memory in new.memory.recorded:
            assert np.array_equal(found[signal.name], memory), signal.name
