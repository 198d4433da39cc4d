"""Laws that misbehave: each run ends with a message that names the law, and the samples up to then are correct.

These tests run a few laws of each kind, most of them in this process. ``scripts/misbehave.py`` runs all of them, each
in a separate process.
"""

import re
import warnings

import numpy as np
import pytest
from numpy.lib.stride_tricks import as_strided
from uvms_mj.engine.native.arena import MARGIN, Arena

from misbehave import trouble
from misbehaving_laws import LATE, SET, cases, law
from uvms_mj import Gsta, InputError, LawError, McapLog, Scenario, Trace, simulate
from uvms_mj.engine.run import PlainPythonWarning
from uvms_mj.records.header import Status
from uvms_mj.stages.signals import GIVEN, record_dtype

ALL = cases()
SIGNALS, TAU_CMD = record_dtype(GIVEN), np.dtype(("f8", (6,)))
HERE = [
    "overruns: tau_cmd[131071]",
    "overruns: gains.three[7]",
    "helpers: put(state.xi, 100)",
    "helpers: compiled at once",
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
]
APART = ["exceptions: exit", "numbers: too large", "endless: while", "endless: plain Python"]


def scenario(tmp_path, text, name="my_law.py"):
    (tmp_path / name).write_text(text)
    return Scenario.load("push_wall", {"simulation.duration": 0.05}, f"{tmp_path / name}:Law")


@pytest.fixture(scope="module")
def quiet_run(tmp_path_factory):
    """The trace of a law without a mistake."""
    return simulate(scenario(tmp_path_factory.mktemp("quiet"), law(SET)))


@pytest.mark.slow
@pytest.mark.parametrize("name", HERE)
@pytest.mark.filterwarnings("ignore::uvms_mj.engine.run.PlainPythonWarning")
def test_a_law_that_misbehaves_is_named_with_what_it_did(tmp_path, quiet_run, name):
    case, log = ALL[name], tmp_path / "run.mcap"
    with pytest.raises((InputError, LawError)) as caught:
        simulate(scenario(tmp_path, case.text), sinks=[McapLog(log)])
    assert re.search(case.said, str(caught.value))
    if isinstance(caught.value, LawError):
        assert caught.value.trace.status is Status.failed
        trace = Trace.load(log)
        assert trace.status is Status.failed
        assert trace.message == str(caught.value)
        for each in ("p_WB", "nu", "tau", "tau_cmd"):  # equal to the run of a law without the mistake
            assert np.array_equal(trace[each], quiet_run[each][: len(trace)]), each


@pytest.mark.slow
@pytest.mark.parametrize("name", APART)
def test_a_process_ends_with_a_sentence_and_a_status(name):
    assert trouble(ALL[name]) == ""


EVERYWHERE = [
    "tau_cmd -= np.ones(({n}, 6))",
    "tau_cmd *= np.ones((1, {n}))",
    "signals.M_hat /= np.ones(({n}, 1))",
    "np.add(np.ones({n}), 1.0, tau_cmd)",
    "tau_cmd[:] = np.ones({n})",
    "tau_cmd.flat[-{n}] = 1.0",
    "signals.M_hat.T.flat[{n} * {n}] = 1.0",
    "tau_cmd[np.array([0, {n}])] = 1.0",
]


def everything(tmp_path) -> Scenario:
    """A law with all these statements: its gain k is ten times the index of the one that it executes, plus n."""
    body = f"{SET}n = int(gains.k) % 10\n"
    for i, statement in enumerate(EVERYWHERE):
        body += f"if int(gains.k) // 10 == {i}:\n    {statement.format(n='n')}\n"
    return scenario(tmp_path, law(body)).updated({"simulation.duration": 1e-3})


@pytest.mark.slow
def test_compiled_code_raises_where_numpy_does_and_nowhere_else(tmp_path):
    """Operands of 1, 5, 6 and 7 numbers, as compiled code and as the equivalent plain Python."""

    class Record:
        M_hat, xi = np.eye(6), np.zeros(6)

    case, raised = everything(tmp_path), {}
    for i, statement in enumerate(EVERYWHERE):
        space = {"np": np}
        exec(f"def plain(n, tau_cmd, signals, state):\n    {statement.format(n='n')}", space)
        for n in (1, 5, 6, 7):
            try:
                space["plain"](n, np.ones(6), Record, Record)
                plain = False
            except (ValueError, IndexError):
                plain = True
            with warnings.catch_warnings():
                warnings.simplefilter("error", PlainPythonWarning)
                try:
                    simulate(case.updated({"controller.k": 10.0 * i + n}))
                    compiled = False
                except LawError:
                    compiled = True
            raised[statement, n] = (plain, compiled)
    assert all(plain == compiled for plain, compiled in raised.values()), raised
    assert {plain for plain, _ in raised.values()} == {True, False}


@pytest.mark.parametrize("name", ["gains", "signals", "state", "state_dot", "tau_cmd"])
@pytest.mark.parametrize("places", [(0,), (0, 1, 5), (100_000,), (131_071,)])
@pytest.mark.parametrize("before", [True, False])
def test_an_overrun_is_measured(name, places, before):
    """Written zeros are detected too, because the margins are not filled with zeros."""
    gains = Gsta()
    arena = Arena(Gsta.room, gains.record(), gains.state_record(), SIGNALS, TAU_CMD)
    assert arena.overrun() == ""
    part = next(part for part, called in arena.names.items() if called == name)
    start = arena.offsets[part] // 8
    first = start - 1 if before else start + arena.sizes[part] // 8
    for place in places:
        arena._words[first - place if before else first + place] = 0
    said = arena.overrun()
    assert name in said
    assert f"{len(places)} number" in said
    assert f"up to {8 * (max(places) + 1)} bytes" in said
    assert ("before the beginning" in said) == before
    assert MARGIN >= 8 * 131_072


def test_a_law_may_write_on_its_signals_and_set_its_states(tmp_path):
    """A law may reset an integrator: the state continues from the value that the law sets."""
    reset = law(f"{SET}signals.s[:] = 9.0\nstate_dot.xi[:] = 1.0\nif signals.t == 0.02:\n    state.xi[:] = 0.0")
    trace = simulate(scenario(tmp_path, reset))
    assert np.allclose(trace.xi[-1], 0.03, atol=1e-9)
    assert np.abs(trace.s).max() < 9.0


def test_a_number_from_beyond_an_array_is_not_one(tmp_path):
    """A number that a law reads from a margin is NaN, and so is its result."""
    with pytest.raises(LawError, match="set tau_cmd"):
        simulate(scenario(tmp_path, law(f"{LATE}tau_cmd[0] = as_strided(tau_cmd, (100,), (8,))[70]")))


def test_a_law_marked_with_njit_is_a_law(tmp_path):
    text = law(SET)
    marked = scenario(tmp_path, text.replace("@staticmethod", "@staticmethod\n    @numba.njit"), "marked.py")
    ours, theirs = simulate(scenario(tmp_path, text)), simulate(marked)
    assert theirs.notes == ()
    assert np.array_equal(ours.p_WB, theirs.p_WB)


def test_a_write_from_one_state_into_the_next_is_found():
    """Each state has margins of its own, and both its neighbours keep their values."""
    state = np.zeros(1, np.dtype([("xi", "f8", (6,)), ("yo", "f8", (3,)), ("w", "f8", (1,))], align=True))
    state["yo"], state["w"] = 2.0, 3.0
    arena = Arena(Gsta.room, Gsta().record(), state, SIGNALS, TAU_CMD)
    arena.fill(np.zeros(1, SIGNALS), state)
    assert arena.overrun() == ""
    assert all(np.array_equal(arena.arrays["state"][name], state[name]) for name in ("xi", "yo", "w"))
    beyond = as_strided(arena.arrays["state"]["xi"][0], (131_078,), (8,))
    for place in (6, 131_077):
        kept, beyond[place] = beyond[place : place + 1].copy(), 7.0
        said = arena.overrun()
        assert "state.xi" in said
        assert "beyond the end" in said
        beyond[place : place + 1] = kept
        assert arena.overrun() == ""
    as_strided(arena.arrays["state_dot"]["yo"][0], (2,), (-8,))[1] = 7.0
    assert "before the beginning of state_dot.yo" in arena.overrun()


TWO_STATES = """
from dataclasses import dataclass
import numpy as np
from uvms_mj import Controller

@dataclass(frozen=True)
class Law(Controller):
    states = {"xi": 6, "yo": 3}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.tau_nom
        state_dot.xi[:], state_dot.yo[:] = 1.0, 2.0
        if signals.t > 0.01:
            MORE
"""


@pytest.mark.parametrize("more", ["pass", "np.lib.stride_tricks.as_strided(state.xi, (9,), (8,))[6:] = 7.0"])
def test_a_compiled_law_keeps_its_states_apart(tmp_path, more):
    (tmp_path / "my_law.py").write_text(TWO_STATES.replace("MORE", more))
    settings = {"simulation.duration": 0.1}
    short = Scenario.load("push_wall", settings, controller=f"{tmp_path / 'my_law.py'}:Law")
    if more == "pass":
        trace = simulate(short)
        assert trace.notes == ()
        assert np.allclose(trace.xi, trace.t[:, None])
        assert np.allclose(trace.yo, 2.0 * trace.t[:, None])
    else:
        with pytest.raises(LawError, match=r"t = 0\.01\d* s: your law Law .* wrote 3 numbers beyond the end of"):
            simulate(short)
