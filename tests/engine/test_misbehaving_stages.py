"""Stages that misbehave: each run ends with a message that names the stage, and the samples up to then are correct."""

import re

import numpy as np
import pytest

from misbehaving import SET, cases, law
from uvms_mj import InputError, LawError, McapLog, Scenario, Trace, simulate
from uvms_mj.records.header import Status

CASES = {name: case for name, case in cases().items() if case.status == 2 and case.table != "metric"}


def scenario(tmp_path, text, name="my_law.py", table="controller"):
    (tmp_path / name).write_text(text)
    return Scenario.load("push_wall", {"simulation.duration": 0.05, f"{table}.name": f"{tmp_path / name}:Law"})


@pytest.fixture(scope="module")
def quiet_run(tmp_path_factory):
    """The trace of a law without a mistake."""
    return simulate(scenario(tmp_path_factory.mktemp("quiet"), law(SET)))


@pytest.mark.parametrize("name", CASES)
@pytest.mark.filterwarnings("ignore::uvms_mj.engine.vehicle_run.PlainPythonWarning")
def test_a_stage_that_misbehaves_is_named_with_what_it_did(tmp_path, quiet_run, name):
    case, log = CASES[name], tmp_path / "run.mcap"
    with pytest.raises((InputError, LawError)) as caught:
        simulate(scenario(tmp_path, case.text, table=case.table), sinks=[McapLog(log)])
    assert re.search(case.said, str(caught.value))
    if isinstance(caught.value, LawError):
        assert caught.value.trace.status is Status.failed
        trace = Trace.load(log)
        assert trace.status is Status.failed
        assert trace.message == str(caught.value)
        if case.table != "controller":
            return
        for each in ("p_WB", "nu", "tau", "tau_cmd"):  # equal to the run of a law without the mistake
            assert np.array_equal(trace[each], quiet_run[each][: len(trace)]), each


def test_a_law_may_set_its_states(tmp_path):
    """A law may reset an integrator: the state continues from the value that the law sets."""
    reset = law(f"{SET}state_dot.xi[:] = 1.0\nif signals.t == 0.02:\n    state.xi[:] = 0.0")
    trace = simulate(scenario(tmp_path, reset))
    assert np.allclose(trace.xi[-1], 0.03, atol=1e-9)


def test_what_a_law_does_not_set_again_stays(tmp_path):
    """tau_cmd and state_dot keep what the law set before."""
    once = law("if signals.instant == 0:\n    tau_cmd[:] = 0.0\n    tau_cmd[0] = 3.0\n    state_dot.xi[:] = 1.0")
    trace = simulate(scenario(tmp_path, once))
    assert trace.notes == ()
    assert np.array_equal(np.unique(trace.tau_cmd, axis=0), [[3.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    assert np.allclose(trace.xi[:, 0], trace.t, atol=1e-9)


def test_a_law_marked_with_njit_is_a_law(tmp_path):
    text = law(SET)
    marked = scenario(tmp_path, text.replace("@staticmethod", "@staticmethod\n    @njit"), "marked.py")
    ours, theirs = simulate(scenario(tmp_path, text)), simulate(marked)
    assert theirs.notes == ()
    assert np.array_equal(ours.p_WB, theirs.p_WB)
