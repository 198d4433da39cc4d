"""The one list of the effects of the water: what engines, resets, attach and theory take from it."""

import dataclasses

import numpy as np
import pytest

from twin import TwinParameters
from uvms_mj import Current, Disturbance, InputError, Scenario, Simulation, Tether, attach
from uvms_mj.physics.effects import EFFECTS, FLOWS, PUSHES, TABLES, counted
from uvms_mj.plant.effects import each_table, effect_records, effect_tables, situation_of
from uvms_mj.plant.settings import Situation, Surface
from uvms_mj.plant.water import EFFECT_TABLES
from uvms_mj.setup.base import set_up
from vehicles import load

SOME = {
    "current": ("current.speed", 0.4),
    "disturbance": ("disturbance.bias", [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    "obstacle": ("obstacle.half_width", 1.0),
    "sea": ("sea.height", 0.3),
    "pads": ("pads", [{"radius": 0.1, "position": [0.05, 0.0, 0.0]}]),
    "near_wall": ("near_wall", [{"radius": 0.2}]),
    "buoyancy": ("buoyancy.shapes", [{"shape": "box", "edges": [0.2, 0.2, 5.0]}]),  # up to the surface
    "tether": ("tether.length", 3.0),
    "fins": ("fins", [{"area": 0.01, "position": [0.0, 0.0, 0.0]}]),
    "drag": ("drag", [{"forward": [1.0, 1.0, 1.0]}]),
}
"""A key and a value with which each effect is in use."""
TO_THE_WALL = {"current.direction_deg": 30.0}
"""In the lee of a wall the current is not computed."""
ALWAYS = {"current", "disturbance"}
"""The effects of which each vehicle has one, so that a reset may set them."""


def test_a_run_finds_each_field_of_a_situation_and_no_other_one():
    setup = set_up(Scenario())
    found = situation_of(setup.scenario, setup.plant)
    assert all(hasattr(found, name) for name in Situation._fields)
    assert found.inertia.shape == (6, 6)
    assert not hasattr(found, "depth")


def test_each_effect_has_records_a_table_and_a_field():
    further = {"products", "cable", "nodes", "pulls", "touches"}  # a tether has a cable, a coupling a pull and a touch
    of_two = {"couplings"}  # tests/test_world.py
    assert set(EFFECT_TABLES) == set(EFFECTS) - further == set(SOME) | of_two
    fields = {field.name for field in dataclasses.fields(Scenario)}
    assert set(EFFECT_TABLES) <= fields
    scenario = Scenario.load("push_wall", TO_THE_WALL | dict(SOME.values()))
    for name, _, table in each_table(effect_tables(scenario)):
        assert isinstance(table, EFFECT_TABLES[name])
        assert set(table.tables) == set(TABLES.get(name, ()))
        records = effect_records({name: table}, Situation(face=0.5, walls={"wall": Surface("plane", (1.0, 0.0, 0.0))}))
        assert dict(counted(records)) == {name: 1}
    assert all(hasattr(EFFECT_TABLES[name], "velocity_W") for name in FLOWS)
    assert all(hasattr(EFFECT_TABLES[name], "rate") for name in PUSHES)


@pytest.mark.parametrize("name", SOME)
def test_each_effect_acts(name):
    """An effect of the table without its line in a kernel would do nothing."""
    moving = TO_THE_WALL | {"initial.position": [0.9, 0.0, 0.0], "initial.velocity": [0.2, 0.1, 0.0, 0.0, 0.1, 0.0]}
    key, value = SOME[name]
    with_it, without = (Scenario.load("push_wall", moving | more) for more in ({key: value}, {}))
    with Simulation(with_it, engine="free_body") as sim, Simulation(without, engine="free_body") as same:
        sim.step(50)
        same.step(50)
        assert np.abs(sim.signals.nu - same.signals.nu).max() > 1e-9


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_reset_changes_the_effects_there_are_and_adds_none(engine):
    scenario = Scenario.load("push_wall", TO_THE_WALL)
    with Simulation(scenario, engine=engine) as sim, Simulation(scenario, engine=engine) as same:
        for name, (key, value) in SOME.items():
            if name in ALWAYS:
                continue
            with pytest.raises(InputError, match=rf"{name}: .*can't add an effect of the water"):
                sim.reset({key: value})
        sim.step(50)
        same.step(50)
        assert np.array_equal(sim.signals.nu, same.signals.nu)
        always = dict(SOME[name] for name in ALWAYS)
        sim.reset(always)
        sim.step(50)
        with Simulation(scenario.updated(always), engine=engine) as fresh:
            fresh.step(50)
            assert np.array_equal(sim.signals.nu, fresh.signals.nu)


def test_a_reset_may_take_each_effect_away_and_back():
    together = {name: each for name, each in SOME.items() if name != "buoyancy"}  # which pads are refused beside
    scenario = Scenario.load("push_wall", TO_THE_WALL | dict(together.values()))
    without = {key: [] if key in ("pads", "near_wall", "fins", "drag") else 0.0 for key, _ in together.values()}
    without |= {"disturbance.bias": [0.0] * 6, "obstacle.half_width": None}
    with Simulation(scenario, engine="free_body") as sim, Simulation(scenario, engine="free_body") as fresh:
        sim.reset(without)
        sim.step(50)
        with Simulation(scenario.updated(without), engine="free_body") as plain:
            plain.step(50)
            np.testing.assert_allclose(
                sim.signals.nu, plain.signals.nu, rtol=0.0, atol=1e-14
            )  # M is solved with, or not
        sim.reset()
        sim.step(50)
        fresh.step(50)
        assert np.array_equal(sim.signals.nu, fresh.signals.nu)


GUSTY = {
    "current.deviation": [0.1, 0.05, 0.02],
    "disturbance.deviation": [1.0, 2.0, 0.5, 0.1, 0.2, 0.3],
    "disturbance.correlation_time": 2.0,
}


@pytest.mark.parametrize(
    "over",
    [
        {"current.speed": 0.1},
        {"simulation.seed": 9},
        {"current.correlation_time": 3.0},
        {"disturbance.deviation": [3.0, 0.0, 0.0, 0.0, 0.0, 0.0]},
    ],
)
def test_gusts_after_a_reset_are_those_of_a_new_run(over):
    """Nodes in memory are kept where they are the same, and drawn again where they are not."""
    scenario = Scenario.load("push_wall", GUSTY)
    with Simulation(scenario, engine="free_body") as sim:
        sim.step(200)
        for given in (over, None, over):
            sim.reset(given)
            sim.step(200)
            changed = scenario if given is None else scenario.updated(given)
            with Simulation(changed, engine="free_body") as fresh:
                fresh.step(200)
                assert np.array_equal(sim.signals.v_c_W, fresh.signals.v_c_W)
                assert np.array_equal(sim.signals.tau_dist, fresh.signals.tau_dist)


def test_a_current_of_a_vector_is_this_vector(rng):
    """To a rounding of its speed; and a tether without length, in attach, is none."""
    model, data = load(TwinParameters())
    for v_c_W in (*rng.normal(size=(20, 3)), np.zeros(3), np.array([-0.3, 0.0, 0.2])):
        with attach(model, data, current=Current.of(v_c_W), tether=Tether()) as attachment:
            assert np.abs(attachment.current_W - v_c_W).max() <= 4e-16 * np.linalg.norm(v_c_W)
    with pytest.raises(ValueError, match="unpack"):
        Current.of((0.1, 0.2))


def test_attach_refuses_two_currents_and_a_disturbance_that_a_scenario_refuses():
    model, data = load(TwinParameters())
    with pytest.raises(InputError, match=r"current: .* is not a uvms_mj.Current"):
        attach(model, data, current=[Current(), Current()])
    with pytest.raises(InputError, match=r"disturbance.frequency_hz\[0\]: .*half the step rate"):
        attach(model, data, disturbance=Disturbance(amplitude=(1.0,) * 6, frequency_hz=(1e5,) * 6))
    with pytest.raises(InputError, match=r"current_W: is no effect of the water.*did you mean 'current'"):
        attach(model, data, current_W=(0.1, 0.0, 0.0))


def test_the_mean_water_is_the_mean_with_shear_and_the_last_row():
    shear = [[-1.0, 1.2], [0.0, 1.0], [3.0, 0.4]]
    table = [[0.0, *[5.0] * 6], [1.0, *[2.0] * 6]]
    scenario = Scenario.load(
        "push_wall",
        GUSTY
        | {
            "current.vertical": 0.05,
            "current.shear": shear,
            "current.amplitude": [0.1, 0.0, 0.0],
            "current.frequency_hz": [0.2, 0.0, 0.0],
            "disturbance.bias": [1.0, -2.0, 3.0, 0.0, 0.5, 0.25],
            "disturbance.table": table,
        },
    )
    water, mean = set_up(scenario).mean_water, np.array(scenario.current.velocity_W)
    for z in (3.0, 0.3, -0.7, -2.9, -8.0):
        factor = np.interp(-z, *np.array(shear).T)
        assert water.flow(np.array([7.0, -3.0, z])) == pytest.approx(mean * [factor, factor, 1.0], rel=1e-14)
    assert water.push == pytest.approx(np.array(scenario.disturbance.bias) + 2.0)
