"""A user's laws: compiled, as plain Python, with errors, and edited between runs."""

import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from law_files import HEADER, law_file, one_liner
from uvms_mj import InputError, LawError, Scenario, Simulation, simulate
from uvms_mj.engine.native import compilation
from uvms_mj.engine.run import PlainPythonWarning, SamplingWarning

ROOT = Path(__file__).parents[2]
SHORT = {"simulation.duration": 0.2}
COPY_OF_GSTA = '''
@dataclass(frozen=True)
class MyGsta(Controller):
    """GSTA in array notation."""
    k_1: float = gain(5.0, "m^(1/2)/s^(3/2)", "gain of phi_1")
    k_2: float = gain(10.0, "m/s^3", "gain of phi_2")
    beta: float = gain(5.0, "(s/m)^(1/2)", "linear part")
    states = {"z": 6}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        s = signals.s
        root = np.sqrt(np.abs(s)) * np.sign(s)
        tau_gsta = -gains.k_1 * (root + gains.beta * s) + state.z
        state_dot.z[:] = -gains.k_2 * (0.5 * np.sign(s) + 1.5 * gains.beta * root + gains.beta**2 * s)
        tau_cmd[:] = signals.tau_nom + signals.M_hat @ (tau_gsta - signals.A * s)
'''


def test_a_users_law_is_compiled_and_does_what_ours_does(tmp_path):
    """The same law in array notation. Sums in another order give other rounding errors, which a switching law may
    amplify a little."""
    path = law_file(tmp_path, COPY_OF_GSTA)
    theirs = simulate(Scenario.load("push_wall", {"simulation.duration": 3.0}, f"{path}:MyGsta"))
    ours = simulate(Scenario.load("push_wall", {"simulation.duration": 3.0}))
    assert theirs.notes == ()
    assert np.abs(theirs.p_WB - ours.p_WB).max() < 1e-7
    switch = 10.0 * 1e-4 / 2.0  # change of z by sgn(s) in one step: k_2 h / 2
    assert np.abs(theirs.z - ours.z)[:, :2].max() < 10.0 * switch
    assert theirs.z.shape == ours.z.shape


@pytest.mark.slow
def test_the_readmes_law_reaches_its_own_closed_form(tmp_path):
    """Integral action makes K_d eta_e = tau_c exactly, as GSTA does: F = K_x (x_d - x_c)/(1 + K_x/k_c)."""
    example = re.search(r"```python\n(# my_law\.py\n.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert example is not None
    assert len([line for line in example[1].splitlines() if line.strip() and not line.startswith("#")]) <= 20
    path = law_file(tmp_path, example[1], header="")
    name = re.search(r"class (\w+)\(Controller\)", example[1])[1]
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 40.0}, f"{path}:{name}"))
    assert trace.notes == ()
    expected = 150.0 * 0.01 / (1.0 + 150.0 / 1e5)
    assert abs(trace.push[-1] - expected) <= 1e-4 * expected


def test_gains_take_settings_and_states_are_recorded_under_their_names(tmp_path):
    body = """
@dataclass(frozen=True)
class Leaky(Controller):
    rate: float = gain(2.0, "1/s", "leak")
    axes: tuple[float, float, float] = gain((1.0, 2.0, 3.0), "-", "weights")
    states = {"memory": 3, "clock": 1}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        state_dot.clock[0] = 1.0
        for i in range(3):
            state_dot.memory[i] = gains.axes[i] - gains.rate * state.memory[i]
        tau_cmd[:] = signals.tau_nom
"""
    path = law_file(tmp_path, body)
    scenario = Scenario.load("push_wall", {**SHORT, "controller.rate": 4.0}, f"{path}:Leaky")
    trace = simulate(scenario)
    t, h = trace.t, 1e-4
    assert np.allclose(trace.clock[:, 0], t, atol=1e-9)
    steps = np.round(t / h)
    exact = np.array([1.0, 2.0, 3.0]) / 4.0 * (1.0 - (1.0 - 4.0 * h) ** steps[:, None])  # explicit Euler
    assert np.allclose(trace.memory, exact, atol=1e-12)
    with pytest.raises(InputError, match="did you mean 'rate'"):
        Scenario.load("push_wall", {"controller.rat": 1.0}, f"{path}:Leaky")


def test_a_law_as_plain_python_gives_what_it_gives_compiled(monkeypatch):
    scenario = Scenario.load(
        "push_wall", {"simulation.duration": 0.05, "wall.position": 1e-4, "reference.step_time": 0.0}
    )
    compiled = simulate(scenario)

    def refuse(*_, **__):
        raise compilation.NotCompiled("for the test")

    monkeypatch.setattr("uvms_mj.engine.native.entry.compile_stage", refuse)
    with pytest.warns(PlainPythonWarning, match="for the test"):
        plain = simulate(scenario)
    assert plain.touches[-1] > 0
    for name in compiled:
        assert np.allclose(plain[name], compiled[name], rtol=1e-9, atol=1e-12, equal_nan=True), name


def test_a_law_that_numba_cannot_compile_runs_and_says_why(tmp_path):
    body = one_liner("Odd", "tau_cmd[:] = eval('1.0') * signals.tau_nom")
    path = law_file(tmp_path, body)
    with pytest.warns(PlainPythonWarning, match="plain Python"):
        trace = simulate(Scenario.load("push_wall", SHORT, f"{path}:Odd"))
    ours = simulate(Scenario.load("push_wall", SHORT, "impedance"))
    assert np.allclose(trace.p_WB, ours.p_WB, atol=1e-12)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("tau_cmd[:] = signals.M_hat @ signals.t", r"signature: matmul\(.*\) \(.*\.py, line \d+\)"),
        ("state.z = signals.p_d", r"state\.z is an array: write state\.z\[:\] = \.\.\. \(my_law\.py, line 9\)$"),
        ("state.x = signals.p_d", r"state\.x is an array: write state\.x\[0\] = \.\.\. \(my_law\.py, line 9\)$"),
        ("signals.t = 1.0\nstate_dot.x = 2.0", r"state_dot\.x is an array: write .* \(my_law\.py, line 10\)$"),
        (
            "state.z[:] = np.array(signals.p_d)[:2]",
            r"No impl.* \(my_law\.py, line 9\); in the function a tuple is an array already, and x\.copy\(\) copies",
        ),
        ("if signals.t > 9.0:\n    tau_cmd[0] = gainz.k", r"name 'gainz' is not defined \(my_law\.py, line 10\)$"),
    ],
)
def test_numbas_reason_is_a_whole_sentence(tmp_path, body, words):
    path = law_file(tmp_path, one_liner("Odd", body) + "    states = {'z': 2, 'x': 1}\n")
    with Simulation(Scenario.load("push_wall", SHORT, f"{path}:Odd")) as sim:
        assert re.search(f"because numba can't compile it: .*{words}", " ".join(sim.notes))


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ("if signals.t > 0.01:\n    tau_cmd[0] = signals.nu[7]", "IndexError"),
        ("if signals.t > 0.01:\n    raise ValueError('too late')", "ValueError: too late"),
        ("tau_cmd[0] = 0.0 if signals.t < 0.01 else 1.0 / signals.f_contact_m_W[0]", "divide by zero"),
        ("if signals.t > 0.01:\n    raise KeyError(eval('1'))", "KeyError: 1"),
    ],
)
@pytest.mark.filterwarnings("ignore::uvms_mj.engine.run.PlainPythonWarning")
def test_an_exception_in_a_law_names_the_users_line_and_keeps_the_trace(tmp_path, body, what):
    body = f"tau_cmd[:] = 0.0\n{body}"
    path = law_file(tmp_path, one_liner("Wrong", body))
    with pytest.raises(LawError) as caught:
        simulate(Scenario.load("push_wall", SHORT, f"{path}:Wrong"))
    line = len((HEADER + one_liner("Wrong", body)).rstrip().splitlines())
    assert f"my_law.py, line {line}" in str(caught.value)
    assert what in str(caught.value)
    assert 10 <= len(caught.value.trace) <= 12


SPEAKS = "tau_cmd[:] = 0.0\nif signals.t < 0.00015:\n    print(signals.t, signals.s)"
RAISES = "tau_cmd[:] = signals.tau_nom[: 5 if signals.t > 0.01 else 6]"
INSTANT = ("run", "-q", "simulation.duration=0.05")


@pytest.mark.slow
@pytest.mark.parametrize(("body", "status", "said"), [(SPEAKS, 0, "0.0001"), (RAISES, 2, "could not broadcast")])
def test_a_law_that_prints_or_raises_does_so_from_disk_too(tmp_path, body, status, said):
    """A process that loads the machine code prints and raises like the process that compiled it, although numba keeps
    printed texts as Python objects."""
    path = law_file(tmp_path, one_liner("Speaks", body))
    for n in range(3):
        done = subprocess.run(
            [sys.executable, "-m", "uvms_mj", *INSTANT, "-c", f"{path}:Speaks", "-o", str(n)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=100.0,
        )
        assert done.returncode == status, done.stderr
        assert said in done.stdout + done.stderr


def test_a_law_derived_from_one_of_ours_is_a_users_law(tmp_path):
    body = "from uvms_mj import Gsta\n" + one_liner("Mine", "tau_cmd[:] = signals.tau_nom").replace(
        "Controller", "Gsta"
    )
    path = law_file(tmp_path, body)
    scenario = Scenario.load("push_wall", SHORT, f"{path}:Mine")
    assert scenario.controller.label() == "Mine"
    assert simulate(scenario).analytic.reason == "no closed form is known for this law"
    late = scenario.updated({"wall.stiffness": 1e6, "controller.period": 1e-3})  # of gsta, "limit-cycles"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(late)
    with pytest.warns(SamplingWarning, match="gsta limit-cycles"):
        simulate(late.updated({}, "gsta").updated({"controller.period": 1e-3}))
    (tmp_path / "again.toml").write_text(scenario.to_toml())
    assert Scenario.load(tmp_path / "again.toml").controller.label() == "Mine"


@pytest.mark.slow
@pytest.mark.parametrize("compiled", [True, False])
def test_what_a_law_writes_on_its_signals_is_not_recorded_nor_kept(tmp_path, monkeypatch, compiled):
    """``tau = signals.tau_nom; tau -= ...`` writes on a signal. The run's own s, zeta and estimates do not change."""
    careful = one_liner("Careful", "tau_cmd[:] = signals.tau_nom - 3.0 * signals.s")
    slip = (
        "tau = signals.tau_nom\ntau -= 3.0 * signals.s\ntau_cmd[:] = tau\nsignals.zeta[:] = 9.0\nsignals.M_hat[:] = 0.0"
    )
    path = law_file(tmp_path, careful + "\n\n" + one_liner("Careless", slip))
    duration = {"simulation.duration": 0.2 if compiled else 0.05}
    if not compiled:

        def refuse(*_, **__):
            raise compilation.NotCompiled("for the test")

        monkeypatch.setattr("uvms_mj.engine.native.entry.compile_stage", refuse)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PlainPythonWarning)
        ours, theirs = (simulate(Scenario.load("push_wall", duration, f"{path}:{n}")) for n in ("Careful", "Careless"))
    for name in ours:
        assert np.array_equal(ours[name], theirs[name]), name


@pytest.mark.parametrize("body", ["tau = -200.0 * signals.eta_e", "return -200.0 * signals.eta_e", "tau_cmd[:3] = 1.0"])
def test_a_law_that_leaves_tau_cmd_as_it_was_is_told_so(tmp_path, body):
    path = law_file(tmp_path, one_liner("Forgets", body))
    with pytest.raises(LawError, match="unset: a law must fill all six entries of tau_cmd") as caught:
        simulate(Scenario.load("push_wall", SHORT, f"{path}:Forgets"))
    assert caught.value.trace.status.name == "failed"


def test_a_law_that_gives_no_number_stops_the_run(tmp_path):
    path = law_file(tmp_path, one_liner("Nan", "tau_cmd[:] = np.nan if signals.t > 0.01 else 0.0"))
    with pytest.raises(LawError, match=r"set tau_cmd\[0\] to nan.*my_law.py, line 9: tau_cmd") as caught:
        simulate(Scenario.load("push_wall", SHORT, f"{path}:Nan"))
    assert np.isfinite(caught.value.trace.tau).all()
