"""A user's laws: compiled, as plain Python, with errors, and edited between runs."""

import re
import warnings

import numpy as np
import pytest

from forked import done as forked
from law_files import HEADER, law_file, one_liner
from page_numbers import page
from uvms_mj import InputError, LawError, Scenario, simulate
from uvms_mj.engine.native import compilation
from uvms_mj.engine.vehicle_run import PlainPythonWarning
from uvms_mj.setup.checks import SamplingWarning

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
def test_the_law_of_the_first_pages_reaches_its_own_closed_form(tmp_path):
    """Integral action makes K_d eta_e = tau_c exactly, as GSTA does: F = K_x (x_d - x_c)/(1 + K_x/k_c)."""
    example = re.search(r"```python\n(# my_law\.py\n.*?)```", page("your_own_law").read_text(), re.DOTALL)
    assert example is not None
    assert len([line for line in example[1].splitlines() if line.strip() and not line.startswith("#")]) <= 20
    path = law_file(tmp_path, example[1], header="")
    name = re.search(r"class (\w+)\(Controller\)", example[1])[1]
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 40.0}, f"{path}:{name}"), engine="free_body")
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


def test_a_gain_may_have_any_name_that_numpy_uses_too(tmp_path, monkeypatch):
    """In `gains.T`, T is the gain, compiled or not."""
    names = ("T", "mean", "shape", "dtype", "view", "itemsize")
    gains = "".join(f"    {name}: float = gain({k + 1}.0, '1', 'gain')\n" for k, name in enumerate(names))
    body = "".join(f"        tau_cmd[{k}] = gains.{name}\n" for k, name in enumerate(names))
    head = "@dataclass(frozen=True)\nclass Law(Controller):\n"
    step = "    @staticmethod\n    def law(gains, state, signals, state_dot, tau_cmd):\n"
    file = law_file(tmp_path, f"{head}{gains}{step}{body}")
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.002}, f"{file}:Law")
    compiled = simulate(scenario)
    assert compiled.notes == ()
    monkeypatch.setenv(compilation.PLAIN, "1")
    with pytest.warns(PlainPythonWarning, match=f"{compilation.PLAIN} is set"):
        plain = simulate(scenario)
    for trace in (compiled, plain):
        assert (trace.tau_cmd == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).all()


def test_a_law_beyond_the_language_runs_and_says_why(tmp_path):
    body = one_liner("Odd", "tau_cmd[:] = eval('1.0') * signals.tau_nom")
    path = law_file(tmp_path, body)
    with pytest.warns(PlainPythonWarning, match=r"the language has no .* \(my_law.py, line 9: tau_cmd"):
        trace = simulate(Scenario.load("push_wall", SHORT, f"{path}:Odd"))
    ours = simulate(Scenario.load("push_wall", SHORT, "impedance"))
    assert np.allclose(trace.p_WB, ours.p_WB, atol=1e-12)


def test_all_that_a_law_has_beyond_the_language_is_said_at_once(tmp_path):
    """Also of a function that it calls. What follows from one of them is none: y and z depend on x."""
    body = (
        "x = eval('1.0')\ny = x + 1.0\nif y > 0.0:\n    z = y\n"
        "for i in range(2):\n    with np.errstate(all='ignore'):\n        pass\n"
        "q = odd(signals.t)\nr = q + z\ntau_cmd[:] = signals.tau_nom + 0.0 * np.nonzero(signals.s)[0].sum()"
    )
    header = f"{HEADER}import numpy as np\n\n\ndef odd(t):\n    d = {{t: 1.0}}\n    return [1.0, t][::-1].pop()\n\n\n"
    path = law_file(tmp_path, one_liner("Odd", body), header=header)
    with pytest.warns(PlainPythonWarning) as caught:
        simulate(Scenario.load("push_wall", {"simulation.duration": 0.001}, f"{path}:Odd"))
    (said,) = (str(each.message) for each in caught if each.category is PlainPythonWarning)
    lines = [int(each) for each in re.findall(r"line (\d+): ", said)]
    source = path.read_text().splitlines()
    assert [source[each - 1].split(" #")[0].strip() for each in lines] == [
        "x = eval('1.0')",
        "with np.errstate(all='ignore'):",
        "d = {t: 1.0}",
        "return [1.0, t][::-1].pop()",
        "tau_cmd[:] = signals.tau_nom + 0.0 * np.nonzero(signals.s)[0].sum()",
    ]


@pytest.mark.parametrize(
    ("body", "line", "words"),
    [
        ("tau_cmd[:] = signals.M_hat @ signals.t", 9, "@ takes vectors and matrices"),
        ("state.z = signals.p_d", 9, r"an array of shape \(3,\) does not fit into one of shape \(2,\)"),
        ("if signals.t >= 0.0:\n    tau_cmd[0] = gainz.k", 10, "gainz is not defined"),
        ("tau_cmd[:] = signals.zta", 9, "signals has no 'zta'; did you mean 'zeta'?"),
        ("tau_cmd[6] = 0.0", 9, "index 6 is out of bounds for size 6"),
        ("signals.M_hat[:] = 0.0", 9, "signals can only be read; change a copy"),
        ("tau = signals.tau_nom\ntau -= signals.s", 10, "signals can only be read; change a copy"),
        ("gains.x = 1.0", 9, "gains has no 'x'|a gain is constant during a run"),
    ],
)
def test_a_law_that_is_wrong_is_refused_before_the_run_with_its_line(tmp_path, body, line, words):
    path = law_file(tmp_path, one_liner("Odd", body) + "    states = {'z': 2, 'x': 1}\n")
    source = body.splitlines()[-1].strip()
    with pytest.raises(InputError) as caught:
        simulate(Scenario.load("push_wall", SHORT, f"{path}:Odd"))
    assert re.search(rf"Odd .*my_law.py, line {line}: ", str(caught.value))
    assert source in str(caught.value) or "has no" in words
    assert re.search(words, str(caught.value))


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ("if signals.t > 0.01:\n    tau_cmd[0] = signals.nu[int(signals.t * 1e3)]", "IndexError"),
        ("if signals.t > 0.01:\n    raise ValueError('too late')", "ValueError: too late"),
        ("tau_cmd[0] = 0.0 if signals.t < 0.01 else 1.0 / signals.f_contact_m_W[0]", "set tau_cmd[0] to inf"),
        ("if signals.t > 0.01:\n    raise KeyError(eval('1'))", "KeyError: 1"),
    ],
)
@pytest.mark.filterwarnings("ignore::uvms_mj.engine.vehicle_run.PlainPythonWarning")
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
RAISES = "tau_cmd[:] = signals.tau_nom\nfor i in range(7 if signals.t > 0.01 else 6):\n    tau_cmd[i] = 0.0"
INSTANT = ("run", "-q", "simulation.duration=0.05")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "status", "said"), [(SPEAKS, 0, "Speaks prints nothing where it is compiled"), (RAISES, 2, "IndexError")]
)
def test_a_law_that_prints_or_raises_does_so_from_disk_too(here, tmp_path, body, status, said):
    """A process that loads the machine code says and raises what the process that compiled it does."""
    arguments = (*INSTANT, "-c", f"{law_file(tmp_path, one_liner('Speaks', body))}:Speaks", "-o")
    compiled, loaded = here(*arguments, "a"), forked(*arguments, "b", cwd=tmp_path)
    assert compiled.exit_code == loaded.exit_code == status
    assert said in loaded.stdout + loaded.stderr


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


def test_a_plain_law_can_not_write_on_its_signals(tmp_path):
    slip = "tau = signals.tau_nom\ntau -= eval('3.0') * signals.s"
    path = law_file(tmp_path, one_liner("Careless", slip))
    with pytest.warns(PlainPythonWarning), pytest.raises(LawError, match="read-only"):
        simulate(Scenario.load("push_wall", {"simulation.duration": 0.01}, f"{path}:Careless"))


def test_a_plain_law_may_give_its_signals_to_a_library_that_asks_for_memory_to_write(tmp_path):
    """A function in C may take a buffer that can be written, and only read it, as SciPy's Rotation does."""
    body = one_liner("Turned", "tau_cmd[:] = signals.g_hat\ntau_cmd[:3] -= turned(signals.quat_WB, signals.nu[:3])")
    turned = """
import ctypes

def turned(quat, v):
    taken = (ctypes.c_double * 3).from_buffer(v)  # raises for memory that can only be read
    return np.array(taken[:])
"""
    path = law_file(tmp_path, body + turned)
    with pytest.warns(PlainPythonWarning):
        trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.01}, f"{path}:Turned"))
    assert trace.status.name == "completed"


@pytest.mark.filterwarnings("ignore::uvms_mj.engine.vehicle_run.PlainPythonWarning")
def test_a_plain_law_that_changes_its_signals_is_refused_also_where_no_array_tells(tmp_path):
    slip = "tau_cmd[:] = signals.g_hat\nmemoryview(signals.nu).cast('B').cast('d')[0] = eval('3.0')"
    path = law_file(tmp_path, one_liner("Hidden", slip))
    with pytest.raises(LawError, match="wrote on its settings or signals, which it may only read"):
        simulate(Scenario.load("push_wall", {"simulation.duration": 0.01}, f"{path}:Hidden"))
