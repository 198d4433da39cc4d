"""The net: faults that are put into the compiler are caught at an instant of a run, and the run goes on as Python."""

import ast
import inspect
import textwrap
import warnings
from pathlib import Path

import numpy as np
import pytest

from compiler_faults import FAULTS, MET
from uvms_mj import InputError, Scenario, Simulation, simulate
from uvms_mj.compiler import builtin, function, unit
from uvms_mj.engine.batch import Batch
from uvms_mj.engine.native import compilation, net, pipeline, twin
from uvms_mj.engine.native.net import NetWarning
from uvms_mj.engine.plant_fmu import write_fmu

LAW = """
from dataclasses import dataclass
import functools
import numpy as np
from uvms_mj import Controller, gain

{met}
@dataclass(frozen=True)
class Law(Controller):
    uses_task = False
    states = {{"seen": 6, "x": 6, "n": 1}}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.g_hat - 200.0 * signals.eta_e - 150.0 * signals.nu_e
        state.x[:] = signals.eta_e + np.arange(6.0) + 1.0
        state.seen[:] = 0.0
{body}
"""


@pytest.fixture(scope="module", autouse=True)
def sound_kernels():
    """No fault comes into the package's own machine code, which is kept: it is made before, whichever test is first."""
    for engine in ("free_body", "mujoco"):
        simulate(Scenario.load("push_wall", {"simulation.duration": 1e-3}), engine=engine)


@pytest.fixture(autouse=True)
def nothing_is_kept(monkeypatch, tmp_path):
    """Machine code with a fault is kept nowhere."""
    monkeypatch.setattr(compilation, "recall", lambda name: None)
    monkeypatch.setattr(compilation, "remember", lambda *_: None)
    monkeypatch.setattr(net, "_accounts", {})


def file_of(tmp_path, body, imports=""):
    path = tmp_path / "law.py"
    text = LAW.format(body="\n".join(f"        {line}" for line in body.splitlines()), met=MET)
    path.write_text(f"{imports}\n{text}")
    return f"{path}:Law"


def run(law, engine="free_body", seconds=0.01):
    return simulate(Scenario.load("push_wall", {"simulation.duration": seconds}, law), engine=engine, log_rate="full")


def plain(law, monkeypatch, **keywords):
    with monkeypatch.context() as patch:
        patch.setenv("UVMS_MJ_PLAIN", "1")
        return run(law, **keywords)


def plain_law(law, monkeypatch):
    """The run with the law alone as plain Python."""

    def refused(*arguments):
        raise pipeline.NotCompiled("it is left to Python")

    with monkeypatch.context() as patch:
        patch.setattr(pipeline, "compile_user_stage", refused)
        return run(law)


def bits(trace):
    return {signal.name: getattr(trace, signal.name).tobytes() for signal in trace.signals}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_compiler_is_caught_and_the_run_goes_on_as_python(fault, tmp_path, monkeypatch):
    put, body = FAULTS[fault]
    law = file_of(tmp_path, body)
    expected = plain_law(law, monkeypatch)
    with monkeypatch.context() as patch:
        put(patch)
        with pytest.warns(
            NetWarning, match=r"law.py.* goes on as plain Python.*at t = 0 s state.* as machine code"
        ) as caught:
            trace = run(law)
        assert len([each for each in caught if each.category is NetWarning]) == 1
        assert bits(trace) == bits(expected)
        monkeypatch.setattr(net, "_accounts", {})
        patch.setenv(net.SWITCH, "0")
        assert bits(run(law)) != bits(expected)  # the fault is one


def test_a_further_run_knows_a_fault_from_the_start(tmp_path, monkeypatch):
    put, body = FAULTS["A2: a list times a number is a product"]
    law = file_of(tmp_path, body)
    put(monkeypatch)
    with pytest.warns(NetWarning):
        first = run(law)
    with pytest.warns(UserWarning, match="runs as plain Python"):
        assert bits(run(law)) == bits(first)


def test_a_fault_is_found_before_an_fmu_is_written(tmp_path, monkeypatch):
    put, body = FAULTS["A2: a list times a number is a product"]
    scenario = Scenario.load("push_wall", controller=file_of(tmp_path, body))
    put(monkeypatch)
    with pytest.warns(NetWarning), pytest.raises(InputError, match=r"can't be in an FMU, .* as machine code"):
        write_fmu(scenario, tmp_path / "law.fmu", with_law=True)
    assert not (tmp_path / "law.fmu").exists()


EDITED = {
    "moved": lambda text: "def zero(x):\n    return 5.0 * x\n" + text,
    "changed": lambda text: text.replace("2.0", "4.0"),
}


@pytest.mark.parametrize("edit", EDITED)
@pytest.mark.parametrize("where", [(unit,), (unit, twin)], ids=["in the compiler", "in the twin, too"])
def test_a_text_that_is_not_the_functions_is_caught(edit, where, tmp_path, monkeypatch):
    """A5: a helper is edited between loading and compiling, and the text on disk is compiled."""
    helper, text = (
        tmp_path / "helper_of_law.py",
        "def first(x):\n    return 2.0 * x\n\n\ndef second(x):\n    return x\n",
    )
    helper.write_text(text)
    law = file_of(tmp_path, "state.seen[:] = helper_of_law.first(signals.t + 1.0)", "import helper_of_law")
    expected = plain_law(law, monkeypatch)
    compiled = pipeline.compile_user_stage

    def late(*arguments):
        helper.write_text(EDITED[edit](text))
        return compiled(*arguments)

    def text_on_disk(function):
        lines = Path(function.__code__.co_filename).read_text().splitlines(True)[function.__code__.co_firstlineno - 1 :]
        source = textwrap.dedent("".join(inspect.getblock(lines)))
        return ast.parse(source).body[0], source.splitlines()

    monkeypatch.setattr(pipeline, "compile_user_stage", late)
    for each in where:
        monkeypatch.setattr(each, "function_tree", text_on_disk)
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.01}, law)
    with pytest.warns(NetWarning, match=r"at t = 0 s state.seen\[0\] is [45].0 as machine code, and 2.0 as Python"):
        trace = simulate(scenario, engine="free_body", log_rate="full")
    assert bits(trace) == bits(expected)


def test_a_helper_that_is_edited_during_a_run_does_not_end_it(tmp_path):
    """It is called for the first time after it was edited, and its machine code is right."""
    helper = tmp_path / "helper_of_law.py"
    helper.write_text("def late(x):\n    return 2.0 * x\n")
    body = "if signals.t > 0.002:\n    state.seen[:] = helper_of_law.late(signals.t)"
    law = file_of(tmp_path, body, "import helper_of_law")
    with Simulation(Scenario.load("push_wall", {"simulation.duration": 0.01}, law), engine="free_body") as sim:
        helper.write_text("def late(x):\n    return 3.0 * x\n")
        sim.step(40)
        assert sim.signals.seen[0] == pytest.approx(2.0 * 0.0039)


def test_a_store_into_what_is_only_read_is_caught(tmp_path, monkeypatch):
    """Machine code stores into the run's signals where Python stores into a copy."""
    law = file_of(tmp_path, "c = signals.eta_e.copy()\nc[3] = 0.5\nstate.seen[0] = c[0]")
    expected = plain_law(law, monkeypatch)
    monkeypatch.setitem(builtin.FUNCTIONS, "copy", lambda at, nodes, keywords: at.value(nodes[0]))
    monkeypatch.setattr(function.Function, "_refuse_readonly", lambda self, place: None)
    with pytest.warns(NetWarning, match="signals.eta_e is changed by machine code, and not by Python"):
        trace = run(law)
    assert bits(trace) == bits(expected)


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_where_machine_code_ends_early_python_goes_on(engine, tmp_path, monkeypatch):
    """An integer grows beyond 64 bits at 6 ms, long after the first instants."""
    law = file_of(
        tmp_path, "k = int(signals.instant)\nn = 2 ** 40 * (1 + (k // 60) * 2 ** 30)\nstate.seen[0] = n % 1000003"
    )
    expected = plain(law, monkeypatch, engine=engine, seconds=0.01)
    with pytest.warns(NetWarning, match=r"at t = 0.006 s machine code ended early \(law.py, line \d+: an integer has"):
        trace = run(law, engine=engine, seconds=0.01)
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
    put, body = FAULTS["A2: a list times a number is a product"]
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
