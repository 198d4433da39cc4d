"""Traces: rows in memory, copies, and the end of a long run."""

import copy
import pickle

import numpy as np
import pytest

from recorded import same
from uvms_mj import InputError, McapLog, Scenario, SinkError, Trace, simulate


def test_a_long_run_keeps_its_end_alone_in_memory(tmp_path):
    scenario = Scenario.load("push_wall", {"simulation.duration": 3.0})
    kept = simulate(scenario, sinks=[McapLog(tmp_path / "run.mcap")], keep_s=0.5, engine="mujoco")
    whole = Trace.load(tmp_path / "run.mcap")
    assert len(whole) == 3001
    assert 500 <= len(kept) < 900
    for name in kept:
        assert np.array_equal(kept[name], whole[name][-len(kept) :]), name


def test_sinks_and_trace_share_rows_that_nobody_can_change(tmp_path):
    class Vandal(McapLog):
        def write(self, rows):
            rows[:] = 0.0

    with pytest.raises(SinkError, match="read-only"):
        simulate(Scenario.load("push_wall", {"simulation.duration": 0.1}), sinks=[Vandal(tmp_path / "x.mcap")])


def test_a_trace_can_be_copied_and_sent_to_another_process():
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.1}))
    for copied in (copy.deepcopy(trace), pickle.loads(pickle.dumps(trace))):
        same(trace, copied)
        assert copied.scenario == trace.scenario
        assert copied.outcome == trace.outcome


def test_a_trace_without_its_beginning_is_not_saved_as_if_it_had_it(tmp_path):
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.5}), keep_s=0.1, engine="mujoco")
    assert trace.t[0] > 0.0
    with pytest.raises(InputError, match="begins at"):
        trace.save(tmp_path / "x.mcap")
    assert not (tmp_path / "x.mcap").exists()


SHORT = {"simulation.duration": 0.005}


def test_an_unknown_signal_gets_a_suggestion():
    trace = simulate(Scenario.load("push_wall", SHORT))
    with pytest.raises(KeyError) as caught:
        trace["f_contact"]
    assert str(caught.value) == "no signal 'f_contact'; did you mean 'f_contact_W'?"
    with pytest.raises(AttributeError, match="did you mean 'f_contact_W'"):
        _ = trace.f_contact
