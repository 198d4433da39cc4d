"""The net: faults that are put into the compiler are caught at an instant of a run, and the run goes on as Python."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from uvms_mj import Scenario, Simulation, simulate
from uvms_mj.compiler import arrays, builtin
from uvms_mj.compiler.values import whole
from uvms_mj.engine.batch import Batch
from uvms_mj.engine.native import compilation, net
from uvms_mj.engine.native.net import NetWarning

LAW = """
from dataclasses import dataclass
import numpy as np
from uvms_mj import Controller, gain

TABLE = np.arange(12.0).reshape(3, 4)

def turned(A, back):
    if back:
        return A.T
    return A

def with_sum(x):
    return x[:3], x.sum()

@dataclass(frozen=True)
class Law(Controller):
    uses_task = False
    states = {{"seen": 6, "x": 6, "n": 1}}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.g_hat - 200.0 * signals.eta_e - 150.0 * signals.nu_e
        state.x[:] = signals.eta_e + np.arange(6.0)
        state.seen[:] = 0.0
{body}
"""


@pytest.fixture(autouse=True)
def nothing_is_kept(monkeypatch, tmp_path):
    """Machine code with a fault is kept nowhere."""
    monkeypatch.setattr(compilation, "recall", lambda name: None)
    monkeypatch.setattr(compilation, "remember", lambda *_: None)
    monkeypatch.setattr(net, "_accounts", {})


def file_of(tmp_path, body):
    path = tmp_path / "law.py"
    path.write_text(LAW.format(body="\n".join(f"        {line}" for line in body.splitlines())))
    return f"{path}:Law"


def run(law, engine="free_body", seconds=0.01):
    return simulate(Scenario.load("push_wall", {"simulation.duration": seconds}, law), engine=engine, log_rate="full")


def plain(law, monkeypatch, **keywords):
    with monkeypatch.context() as patch:
        patch.setenv("UVMS_MJ_PLAIN", "1")
        return run(law, **keywords)


FAULTS = {  # a fault of the compiler, and a law that meets it
    "a function that is another one": (
        lambda patch: patch.setitem(builtin.FUNCTIONS, abs, builtin.FUNCTIONS[float]),
        "state.seen[0] = abs(-2.0 * signals.t - 1.0)",
    ),
    "a copy in place of a view": (
        lambda patch: patch.setattr(arrays.Arrays, "read", _copies),
        "y = state.x[1:4]\ny[0] = 7.0\nstate.seen[0] = state.x[1]",
    ),
    "no copy before a store": (
        lambda patch: patch.setattr(arrays.Arrays, "apart", lambda self, value: self.as_array(value)),
        "state.x[1:] = state.x[:-1]\nstate.seen[:] = state.x",
    ),
    "an index from the front": (
        lambda patch: patch.setattr(arrays.Arrays, "known_index", lambda self, i, n: whole(max(i, 0)).llvm[0]),
        "state.seen[0] = state.x[-1]",
    ),
    "the lesser for the greater": (
        lambda patch: patch.setitem(builtin.FUNCTIONS, np.maximum, builtin.FUNCTIONS[np.minimum]),
        "state.seen[:] = np.maximum(state.x, 2.5)",
    ),
}
_read = arrays.Arrays.read


def _copies(self, place):
    found = _read(self, place)
    return self.copied(found) if found.kind.is_array and found.kind.shape == (3,) else found


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_compiler_is_caught_and_the_run_goes_on_as_python(fault, tmp_path, monkeypatch):
    put, body = FAULTS[fault]
    law = file_of(tmp_path, body)
    expected = plain(law, monkeypatch)
    with monkeypatch.context() as patch:
        put(patch)
        with pytest.warns(NetWarning, match=r"law.py.* goes on as plain Python.*state.* as machine code") as caught:
            trace = run(law)
        assert len([each for each in caught if each.category is NetWarning]) == 1
        with pytest.warns(UserWarning, match="runs as plain Python"):  # a further run knows it from the start
            again = run(law)
    for each in (trace, again):
        np.testing.assert_array_equal(each.seen, expected.seen)
        np.testing.assert_allclose(each.p_WB, expected.p_WB, rtol=0, atol=1e-14)
    with monkeypatch.context() as patch:
        patch.setenv(net.SWITCH, "0")
        monkeypatch.setattr(net, "_accounts", {})
        put(patch)
        assert not np.array_equal(run(law).seen, expected.seen)  # the fault is one


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_where_machine_code_ends_early_python_goes_on(engine, tmp_path, monkeypatch):
    """An integer grows beyond 64 bits at 0.03 s, long after the first instants."""
    law = file_of(
        tmp_path, "k = int(signals.instant)\nn = 2 ** 40 * (1 + (k // 300) * 2 ** 30)\nstate.seen[0] = n % 1000003"
    )
    expected = plain(law, monkeypatch, engine=engine, seconds=0.05)
    with pytest.warns(NetWarning, match=r"at t = 0.03 s machine code ended early \(law.py, line \d+: an integer has"):
        trace = run(law, engine=engine, seconds=0.05)
    np.testing.assert_array_equal(trace.seen, expected.seen)
    np.testing.assert_allclose(trace.p_WB, expected.p_WB, rtol=0, atol=1e-12)


def test_no_false_alarm_and_no_other_bits(tmp_path, monkeypatch):
    """A cost that is the difference of large numbers, products and functions of C, each instant compared."""
    body = (
        "A = signals.M_hat + 0.1 * np.outer(state.x, state.x)\nb = A @ state.x\n"
        "state.seen[0] = (b @ np.linalg.solve(A, b) - state.x @ b) > 0.0\n"
        "state.seen[1:4] = np.tanh(state.x[:3]) * np.exp(-state.x[3:]) ** 1.7\nstate.seen[4] = np.linalg.norm(b)"
    )
    law = file_of(tmp_path, body)
    monkeypatch.setattr(net, "START_S", 100.0)
    monkeypatch.setattr(net, "FIRST", 10_000)
    watched = run(law, seconds=0.05)
    (account,) = net._accounts.values()
    assert account.instants == 500
    with monkeypatch.context() as patch:
        patch.setenv(net.SWITCH, "0")
        free = run(law, seconds=0.05)
    for signal in watched.signals:
        np.testing.assert_array_equal(getattr(watched, signal.name), getattr(free, signal.name))


def test_a_batch_is_compared_at_its_start_and_then_native(tmp_path, monkeypatch):
    put, body = FAULTS["the lesser for the greater"]
    law = file_of(tmp_path, body)
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.1}, law)
    with Simulation(scenario, engine="free_body") as alone:
        alone.step(600)
        expected = alone.signals.p_WB.copy()
    for faulty in (False, True):
        monkeypatch.setattr(net, "_accounts", {})
        with monkeypatch.context() as patch, warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            if faulty:
                put(patch)
            batch = Batch([Simulation(scenario, engine="free_body") for _ in range(3)], threads=1)
            for _ in range(6):
                batch.step(100, np.arange(3))
            assert any(each.category is NetWarning for each in caught) == faulty
            np.testing.assert_allclose(batch.read(("p_WB",))["p_WB"], [expected] * 3, rtol=0, atol=1e-14)
            assert batch[0].all_native != faulty
            assert not batch[0].compares
            batch.close()


def test_a_slow_stage_is_compared_when_it_is_due_and_takes_no_more(tmp_path):
    law = file_of(tmp_path, "state.seen[0] = signals.t")
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.5, "controller.period": 0.05}, law)
    with Simulation(scenario, engine="free_body") as sim:
        sim.step(5000)
    (account,) = net._accounts.values()
    assert 0 < account.instants <= 11


def test_the_pages_name_the_switch():
    page = Path(__file__).parents[2] / "docs" / "inside" / "language.md"
    assert f"`{net.SWITCH}=0`" in page.read_text()
