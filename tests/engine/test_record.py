"""A run is one record in one image of memory."""

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, Simulation
from uvms_mj.engine.native.record import MOST_ROWS, Field, Shape, room_for, with_numbers
from uvms_mj.engine.native.run_memory import shape_of
from uvms_mj.setup.base import set_up

GUSTY = {"current.deviation": [0.1, 0.1, 0.0], "disturbance.deviation": [0.5] * 6, "wall.stiffness": 2e3}


def test_a_run_goes_on_in_a_copy_of_its_image():
    """Nothing in the image of a free_body run depends on where it lies but its own address."""
    with Simulation(Scenario.load("push_wall", GUSTY), engine="free_body") as sim:
        sim.step(2000)
        memory = sim._memory
        copy = np.zeros_like(memory.image.bytes)
        copy[:] = memory.image.bytes
        run = np.ndarray(1, memory.run.dtype, copy)
        run["address"] = copy.ctypes.data
        assert memory.code["free_steps"].ctypes(copy.ctypes.data, 60000, 1) == 60000
        memory.code["free_steps"].ctypes(memory.address, 60000, 1)
        assert sim.signals.touches > 0.0
        memory.run["address"] = copy.ctypes.data
        assert np.array_equal(copy, memory.image.bytes)
        memory.run["address"] = memory.address


def test_a_reset_copies_the_image_of_the_start():
    with Simulation(Scenario.load("push_wall", GUSTY), engine="free_body") as sim:
        memory = sim._memory
        start = memory.image.fixed.copy()
        sim.step(500)
        assert not np.array_equal(memory.image.fixed, start)
        memory.restart(sim.setup)
        block = memory.run["plant"]["effects"]["current"]["block"]
        assert block[0] == 0  # whose nodes are still in memory
        for name in ("current", "disturbance"):
            memory.run["plant"]["effects"][name]["block"] = -1
        assert np.array_equal(memory.image.fixed, start)


def test_a_table_that_is_too_long_for_a_reset_is_refused_and_nothing_changes():
    rows = [[float(k), 0.1, 0.0, 0.0] for k in range(MOST_ROWS + 1)]
    scenario, free = Scenario.load("push_wall"), {"engine": "free_body"}
    with Simulation(scenario, **free) as sim, Simulation(scenario, **free) as same:
        with pytest.raises(InputError, match=rf"current.table: has {len(rows)} rows; a reset takes {MOST_ROWS}"):
            sim.reset({"current.table": rows})
        sim.reset({"current.table": rows[:-1]})
        sim.reset()
        sim.step(100)
        same.step(100)
        assert np.array_equal(sim.signals.tau_cmd, same.signals.tau_cmd)
    with Simulation(Scenario.load("push_wall", {"current.table": rows}), engine="free_body") as sim:
        sim.reset({"current.table": rows})


def test_all_numbers_of_the_image_are_fields_of_the_record_for_kernels():
    dtype = Shape(joints=2, thrusters=6, carriers=2, carried=True, surfaces=8, pairs=8, resolves=True).layout
    whole = with_numbers(dtype)
    place = Field.of(dtype, "plant", "links").place
    assert {name: dtype.fields[name][1] for name in dtype.names} == {
        name: whole.fields[name][1] for name in dtype.names
    }
    assert whole.fields["numbers"][1] == whole.fields["integers"][1] == 0
    assert all(at % 8 == 0 for _, at in (dtype.fields[name][:2] for name in dtype.names))
    assert place > 0


def test_vehicles_among_more_or_fewer_walls_share_their_code():
    assert [room_for(n) for n in (0, 1, 8, 9, 17)] == [0, 8, 8, 16, 32]


WRIST = {"wrist.name": "sensor", "wrist.site": "tool"}
SPHERES = [{"shape": "sphere", "position": [2.0 + k, 0.0, 0.0], "radius": 0.1} for k in range(3)]


@pytest.mark.parametrize("other", [{"wall.present": False}, {"walls": SPHERES}, WRIST, {"task.frame": "body"}])
def test_walls_a_wrist_sensor_and_the_frame_of_the_task_change_no_code_of_an_arm(other):
    """They change numbers and stages only."""
    shapes = [shape_of(set_up(Scenario.load("tool_push", each))) for each in ({}, other)]
    assert shapes[0] == shapes[1]


PLATE = {"shape": "plane", "position": [0.3, 0.0, 0.0], "attitude_deg": [0.0, 0.0, 0.0]}
MOVED = PLATE | {"motion": [[0.0, 0.0, 0.0, 0.0], [1.0, -0.1, 0.0, 0.0]]}


@pytest.mark.parametrize("engine", ["mujoco", "free_body"])
def test_friction_that_is_switched_off_in_contact_is_gone_at_the_next_instant(engine):
    held = {"initial.position": [1.002, 0.0, 0.0], "initial.velocity": [0.0, 0.0, 0.2, 0.0, 0.0, 0.0]}
    with Simulation(Scenario.load("push_wall", held | {"wall.friction": 0.5}), engine=engine) as sim:
        sim.step(20)
        assert abs(sim.signals.f_contact_W[2]) > 1.0
        sim.set({"wall.friction": 0.0})
        sim.step(2)  # the force of the first step is that of the instant before
        assert np.array_equal(sim.signals.f_contact_W[1:], np.zeros(2))


def test_walls_may_take_each_others_place_in_a_reset():
    """[wall] of the list goes and another wall with a motion comes."""
    bumper = {"bumper.stiffness": 5e3}
    with Simulation(Scenario.load("push_wall", bumper), engine="free_body") as sim:
        sim.reset({"wall.present": False, "walls": [MOVED]})
        with Simulation(sim.scenario, engine="free_body") as fresh:
            for each in (sim, fresh):
                each.step(9000)
            assert np.array_equal(sim.signals.p_WB, fresh.signals.p_WB)


def test_estimates_that_are_set_act_from_the_next_step_on():
    with Simulation(Scenario.load("push_wall"), engine="free_body") as sim:
        sim.step(5)
        before = sim.signals.M_hat.copy()
        sim.set({"estimates.inertia": 1.2})
        assert np.array_equal(sim.signals.M_hat, before)
        sim.step(1)
        np.testing.assert_allclose(sim.signals.M_hat, 1.2 * before)
