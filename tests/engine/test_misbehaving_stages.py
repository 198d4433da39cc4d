"""Stages that misbehave: each run ends with a message that names the stage, and the samples up to then are correct.

These tests run a few of each kind, most of them in this process. ``scripts/misbehave.py`` runs all of them, each
in a separate process.
"""

import re

import numpy as np
import pytest

from misbehave import trouble
from misbehaving_laws import SET, law
from misbehaving_stages import cases
from uvms_mj import InputError, LawError, McapLog, Scenario, Trace, simulate
from uvms_mj.records.header import Status

ALL = cases()
HERE = [
    "overruns: tau_cmd[131071]",
    "overruns: gains.three[7]",
    "helpers: put(state.xi, 100)",
    "shapes: tau_cmd += np.ones(7)",
    "shapes: tau_cmd += np.ones((2, 6))",
    "flats: signals.M_hat.T.flat[36] = 0.0",
    "numbers: unused state",
    "numbers: numpy root",
    "numbers: solve",
    "numbers: returned",
    "numbers: gain",
    "exceptions: raise Base('x')",
    "exceptions: compiled recursion",
    "memory: np.zeros(1 << 45)",
    *(name for name in ALL if name.startswith("declarations: ")),
    *(name for name in ALL if name.startswith("files: ")),
    "navigation: matrix",
    "reference: root",
    "observer: setting",
    "thrusters: late index",
    "actuation: root",
]
APART = ["exceptions: exit", "endless: plain Python", "metrics: base"]


def scenario(tmp_path, text, name="my_law.py", table="controller"):
    (tmp_path / name).write_text(text)
    return Scenario.load("push_wall", {"simulation.duration": 0.05, f"{table}.name": f"{tmp_path / name}:Law"})


@pytest.fixture(scope="module")
def quiet_run(tmp_path_factory):
    """The trace of a law without a mistake."""
    return simulate(scenario(tmp_path_factory.mktemp("quiet"), law(SET)))


@pytest.mark.slow
@pytest.mark.parametrize("name", HERE)
@pytest.mark.filterwarnings("ignore::uvms_mj.engine.run.PlainPythonWarning")
def test_a_stage_that_misbehaves_is_named_with_what_it_did(tmp_path, quiet_run, name):
    case, log = ALL[name], tmp_path / "run.mcap"
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


@pytest.mark.slow
@pytest.mark.parametrize("name", APART)
def test_a_process_ends_with_a_sentence_and_a_status(name):
    assert trouble(ALL[name]) == ""


def test_a_law_may_set_its_states(tmp_path):
    """A law may reset an integrator: the state continues from the value that the law sets."""
    reset = law(f"{SET}state_dot.xi[:] = 1.0\nif signals.t == 0.02:\n    state.xi[:] = 0.0")
    trace = simulate(scenario(tmp_path, reset))
    assert np.allclose(trace.xi[-1], 0.03, atol=1e-9)


def test_a_law_marked_with_njit_is_a_law(tmp_path):
    text = law(SET)
    marked = scenario(tmp_path, text.replace("@staticmethod", "@staticmethod\n    @njit"), "marked.py")
    ours, theirs = simulate(scenario(tmp_path, text)), simulate(marked)
    assert theirs.notes == ()
    assert np.array_equal(ours.p_WB, theirs.p_WB)
