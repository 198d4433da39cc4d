"""MuJoCo's timers stand still while a Simulation steps, and go on as before after it."""

import threading
import time

import mujoco
import numpy as np
import pytest

from uvms_mj import Scenario, Simulation
from uvms_mj.engine.native.callback import timers_stopped

STEP = mujoco.mjtTimer.mjTIMER_STEP


@pytest.fixture
def bare():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    return model, mujoco.MjData(model)


def timed(bare) -> float:
    """What MuJoCo's timer says of ten steps of a model of its own [ms]."""
    model, data = bare
    data.timer[STEP].duration = 0.0
    mujoco.mj_step(model, data, 10)
    return data.timer[STEP].duration


def test_a_step_of_a_simulation_reads_no_clock_and_leaves_that_of_others(bare):
    assert timed(bare) > 0.0
    with Simulation(Scenario.load("push_wall")) as sim:
        sim.step(100)
        assert sim.data.timer[STEP].duration == 0.0
        assert timed(bare) > 0.0


def test_a_clock_of_the_user_is_kept_and_asked_no_more_than_when_it_stops(bare):
    calls = []
    mujoco.set_mjcb_time(lambda: float(len(calls.append(None) or calls)))
    try:
        with Simulation(Scenario.load("push_wall")) as sim:
            sim.step(10)  # the first step is slow, and decides how many are taken before the clock is asked again
            calls.clear()
            sim.step(100)
            assert len(calls) <= 2  # and not some thirty times in each of the 100 steps
        assert timed(bare) > 0.0
        assert calls
    finally:
        mujoco.set_mjcb_time(None)
    assert timed(bare) > 0.0


def test_the_clock_goes_on_when_the_last_of_several_threads_has_stepped(bare):
    def run():
        with Simulation(Scenario.load("push_wall")) as sim:
            for _ in range(50):
                sim.step(20)

    threads = [threading.Thread(target=run) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert timed(bare) > 0.0


def test_the_timers_of_another_thread_never_jump(bare):
    """A step that begins with the stopped clock, and ends with the other, takes what passed in between."""
    model, data = bare
    go, largest = threading.Event(), []

    def run():
        with Simulation(Scenario.load("push_wall")) as sim:
            go.set()
            for _ in range(5000):
                sim.step(1)
        go.clear()

    thread = threading.Thread(target=run)
    thread.start()
    go.wait()
    began = time.perf_counter()
    while go.is_set():
        before = data.timer[STEP].duration
        mujoco.mj_step(model, data)
        largest.append(data.timer[STEP].duration - before)
    thread.join()
    took = time.perf_counter() - began
    assert max(abs(each) for each in largest) <= took
    assert abs(sum(largest)) <= 1.1 * took


def test_the_clock_goes_on_after_an_error(bare):
    def fail():
        with timers_stopped:
            with timers_stopped:
                assert timed(bare) == 0.0
            assert timed(bare) == 0.0
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert timed(bare) > 0.0


def test_the_results_are_those_with_the_clock(monkeypatch):
    states = []
    for still in (True, False):
        if not still:
            monkeypatch.setattr(timers_stopped, "_inside", 1)
        with Simulation(Scenario.load("push_wall")) as sim:
            sim.step(500)
            assert (sim.data.timer[STEP].duration == 0.0) == still
            states.append(np.r_[sim.data.qpos, sim.data.qvel])
    np.testing.assert_array_equal(*states)
