"""Theory beside the law: closed forms, warnings and certificates of a user's law; nothing is solved unasked."""

import copy
import inspect
import json
import pickle
import re
import shutil
import textwrap
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from uvms_mj import Gsta, McapLog, Scenario, Trace, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.analysis.summary import summary
from uvms_mj.cli.certify import certify
from uvms_mj.cli.run import run
from uvms_mj.control.base import NoClosedForm, SteadyState
from uvms_mj.control.theory import predictions
from uvms_mj.control.theory.predictions import TheoryWarning
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import SamplingWarning, warnings_of
from uvms_mj.views.figures import panels

ROOT = Path(__file__).parents[2]
SHORT = {"simulation.duration": 1e-3}
HEADER = """
from dataclasses import dataclass

import numpy as np

from uvms_mj import Controller, Gsta, Impedance, gain
from uvms_mj.control.theory.balance import static_balance
from uvms_mj.control.base import SteadyState

"""
NOMINAL = """
@dataclass(frozen=True)
class Mine(Controller):
    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.tau_nom

"""


@pytest.fixture
def write(tmp_path):
    """A function that writes a law with methods and returns its source."""

    def to_file(methods: str, law: str = NOMINAL) -> str:
        (tmp_path / "mine.py").write_text(HEADER + law + textwrap.indent(textwrap.dedent(methods), "    "))
        return f"{tmp_path / 'mine.py'}:Mine"

    return to_file


@pytest.fixture
def pd(tmp_path):
    """The example, as a file elsewhere."""
    shutil.copy(ROOT / "examples" / "pd.py", tmp_path)
    return f"{tmp_path / 'pd.py'}:Pd"


@pytest.mark.parametrize("k_c", [1e5, 2e3])
def test_the_closed_form_of_the_guide_is_where_its_law_rests(pd, tmp_path, k_c):
    settings = ("current.speed=0", f"wall.stiffness={k_c}", "simulation.duration=15")
    done = CliRunner().invoke(run, ["-c", pd, *settings, "--json", "--out", str(tmp_path / "out")])
    contact = json.loads(done.stdout)["contact"]
    assert contact["analytic_N"] == pytest.approx(2.0 / (1.0 + 200.0 / k_c), rel=1e-12)
    assert contact["settled"]
    assert abs(contact["relative_error"]) < 1e-6
    trace = Trace.load(tmp_path / "out" / "run.mcap")
    assert trace.analytic.force == contact["analytic_N"]
    assert trace.analytic.position is None


def test_a_users_closed_form_is_in_table_and_figure_and_its_reason_as_well(pd, tmp_path):
    settings = ("current.speed=0", "simulation.duration=0.01")
    done = CliRunner().invoke(run, ["-c", pd, *settings, "--out", str(tmp_path / "still")])
    assert "1.996008 N" in done.stdout
    assert "analytic position" not in done.stdout
    trace = Trace.load(tmp_path / "still" / "run.mcap")
    assert ("analytic", trace.analytic.force) in panels.expected_forces(trace)
    done = CliRunner().invoke(run, ["-c", pd, "simulation.duration=0.01", "--out", str(tmp_path / "flowing")])
    assert "none: the current pushes a PD law off the reference" in done.stdout
    assert not done.stderr


def test_a_law_may_predict_its_whole_state(write):
    """The impedance law, written again, rests where the static balance with K = 0 says."""
    source = write("def at_rest(self, setup):\n    return static_balance(setup, 0.0)\n")
    settings = {"reference.target": [1.2, 0.0, 0.0]}
    trace = simulate(Scenario.load("push_wall", settings, source))
    shipped = simulate(Scenario.load("push_wall", settings | SHORT, "impedance")).analytic
    force, settled = final_force(trace)
    assert settled
    assert force == pytest.approx(trace.analytic.force, rel=1e-4)
    assert np.abs(trace.p_WB[-1] - trace.analytic.position).max() < 1e-5
    assert np.abs(trace.s[-1] - trace.analytic.s).max() < 1e-5
    for name in ("force", "position", "quat", "s", "tau"):
        assert np.array_equal(getattr(trace.analytic, name), getattr(shipped, name))


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ("def at_rest(self, setup): return -1.0", "returned -1.0"),
        ("def at_rest(self, setup): return float('nan')", "returned nan"),
        ("def at_rest(self, setup): return None", "returned None"),
        ("def at_rest(self, setup): return True", "returned True"),
        ("def at_rest(self, setup): return 1j", "returned 1j"),
        ("def at_rest(self, setup): return [1.0, 2.0]", r"returned \[1.0, 2.0\]"),
        ("def at_rest(self, setup): return SteadyState('x')", "returned SteadyState"),
        ("def at_rest(self, setup): return SteadyState(1.0, position=np.zeros(2))", "returned SteadyState"),
        ("def at_rest(self, setup): return SteadyState(1.0, tau=np.full(6, np.inf))", "returned SteadyState"),
        ("def at_rest(self, setup): return 1.0 / 0", r"failed: mine.py, line 17: ZeroDivisionError: float division"),
        ("def at_rest(self, setup): return setup.nothing", "failed: mine.py, line 17: AttributeError"),
        ("def at_rest(self, setup): raise SystemExit(3)", "failed: mine.py, line 17: SystemExit: 3"),
        ("def at_rest(self): return 1.0", "failed: TypeError"),
        ("at_rest = 3.0", "failed: TypeError"),
    ],
)
def test_a_wrong_theory_is_one_sentence(write, method, words):
    setup = set_up(Scenario.load("push_wall", SHORT, write(method)))
    with pytest.warns(TheoryWarning, match=rf"^Mine.at_rest {words}.*; the run has no closed form$") as given:
        found = predictions.steady_state(setup)
    assert len(given) == 1
    assert isinstance(found, NoClosedForm)
    assert re.match(f"Mine.at_rest {words}", found.reason)


def test_the_force_of_no_closed_form_is_an_error_that_gives_the_reason(write):
    trace = simulate(Scenario.load("push_wall", SHORT, write("def at_rest(self, setup): return 'it sways'")))
    for rest in (trace.analytic, pickle.loads(pickle.dumps(trace.analytic))):
        with pytest.raises(AttributeError, match=r"^no closed form: it sways$"):
            print(rest.force)


def test_thrusters_that_are_too_weak_for_a_users_force_are_named(pd):
    """The four horizontal thrusters, at 45 deg, share F = k_p depth / (1 + k_p/k_c): each needs F / (4 cos 45 deg)."""
    settings = {"current.speed": 0.0, "vehicle.model": "bluerov2_heavy", "reference.target": [1.05, 0.0, 0.0]}
    limit = 39.9 * 4.0 * np.cos(np.pi / 4.0)
    for force, fits in ((0.98 * limit, True), (1.02 * limit, False)):
        k_p = force / (0.05 - force / 1e5)
        found = predictions.steady_state(set_up(Scenario.load("push_wall", settings | {"controller.k_p": k_p}, pd)))
        assert isinstance(found, SteadyState) == fits
        assert fits or "too weak" in found.reason


def test_a_wrong_theory_does_not_stop_the_run_and_is_said_once(write, tmp_path):
    done = CliRunner().invoke(
        run,
        [
            "-c",
            write("def at_rest(self, setup): return 1.0 / 0"),
            "simulation.duration=0.001",
            "--out",
            str(tmp_path / "out"),
        ],
    )
    assert done.exit_code == 0
    assert done.stderr.count("warning: Mine.at_rest failed: mine.py, line 17: ZeroDivisionError") == 1
    assert "Traceback" not in done.output


@pytest.mark.parametrize(
    ("method", "notes"),
    [
        ("def notes(self, setup): yield f'K_x is {setup.scenario.impedance.K_d[0]:g} N/m'", ("K_x is 150 N/m",)),
        ("def notes(self, setup): return 'one text'", ("one text",)),
        ("def notes(self, setup): return []", ()),
        ("def notes(self, setup): return [1]", ("Mine.notes must give warnings as texts, not [1]",)),
        (
            "def notes(self, setup): raise ValueError('no')",
            ("Mine.notes failed: mine.py, line 17: ValueError: no",),
        ),
        ("def notes(self, setup): return None", ("Mine.notes failed: TypeError: 'NoneType' object is not iterable",)),
    ],
)
def test_the_notes_of_a_users_law_are_warnings(write, method, notes):
    assert tuple(warnings_of(set_up(Scenario.load("push_wall", SHORT, write(method))))) == notes


def test_the_notes_are_given_before_the_run_and_recorded(write):
    scenario = Scenario.load("push_wall", SHORT, write("def notes(self, setup): yield 'beware'"))
    with pytest.warns(SamplingWarning, match="^beware$"):
        assert simulate(scenario).notes == ("beware",)


DERIVED = """
@dataclass(frozen=True)
class Mine(Gsta):
    k_1: float = 6.0
"""
OWN_LAW = """
    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.tau_nom
"""


@pytest.mark.parametrize(
    ("law", "methods", "closed"),
    [
        (DERIVED, "", True),
        (DERIVED + OWN_LAW, "", False),
        (DERIVED + OWN_LAW, "def at_rest(self, setup): return 1.5", True),
        (DERIVED, "states = {'z': 6, 'more': 1}", False),
    ],
)
def test_a_theory_holds_for_the_law_beside_which_it_is_defined(write, law, methods, closed):
    late = {"wall.stiffness": 1e6, "controller.period": 1e-3}  # gsta limit-cycles
    scenario = Scenario.load("push_wall", SHORT, write(methods, law))
    setup = set_up(scenario)
    assert isinstance(predictions.steady_state(setup), SteadyState) == closed
    own = "def law" in law or "states" in methods
    setup = set_up(scenario.updated(late))
    assert bool(predictions.stage_notes(setup.scenario.controller, setup)) != own
    assert (predictions.certificate(setup) is None) == own


def test_a_users_law_may_have_a_certificate(write, tmp_path):
    body = inspect.getsource(Gsta.law)
    head = """
from uvms_mj.control.laws.terms import add_product
from uvms_mj.control.theory.certificate import Certificate

@dataclass(frozen=True)
class Mine(Controller):
    k_1: float = 5.0
    k_2: float = 10.0
    beta: float = 5.0
    nominal: bool = True
    states = {"z": 6}

"""
    source = write("def certificate(self, setup): return Certificate.of(self.k_1, self.k_2, self.beta)", head + body)
    settings = ("simulation.duration=0.2", "wall.position=50", "--json")
    mine, shipped = (json.loads(CliRunner().invoke(certify, ["-c", law, *settings]).stdout) for law in (source, "gsta"))
    assert mine["controller"] == "Mine"
    assert mine["gains"] == shipped["gains"]
    assert mine["certified"] == shipped["certified"]
    assert mine["is_certified"] == shipped["is_certified"]
    assert mine["experienced"]["rate"] == pytest.approx(shipped["experienced"]["rate"], abs=1e-6)


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ("def certificate(self, setup): return 5.0", "Mine.certificate must return a Certificate or None, not 5.0"),
        ("def certificate(self, setup): return 1 / 0", "Mine.certificate failed: mine.py, line 17: ZeroDivisionError"),
    ],
)
def test_a_wrong_certificate_is_bad_input(write, method, words):
    done = CliRunner().invoke(certify, ["-c", write(method), "simulation.duration=0.001"])
    assert done.exit_code == 2
    assert words in done.stderr
    assert "Traceback" not in done.output


COUNTED = """
def at_rest(self, setup):
    with open(__file__ + ".calls", "a") as file:
        file.write("x")
    return 1.5
"""


def test_the_rest_is_solved_when_it_is_asked_for_and_once(write, tmp_path):
    calls = tmp_path / "mine.py.calls"
    scenario = Scenario.load("push_wall", SHORT, write(COUNTED))
    trace = simulate(scenario)
    assert not calls.exists()
    assert trace.analytic.force == summary(trace, {})["contact"]["analytic_N"] == 1.5
    assert calls.read_text() == "x"
    simulate(scenario, sinks=[McapLog(tmp_path / "run.mcap")])
    assert calls.read_text() == "xx"
    assert Trace.load(tmp_path / "run.mcap").analytic.force == 1.5
    assert calls.read_text() == "xx"


def test_a_copied_trace_has_its_rest():
    trace = simulate(Scenario.load("push_wall", SHORT))
    for again in (pickle.loads(pickle.dumps(trace)), copy.deepcopy(trace)):
        assert again.analytic.force == trace.analytic.force


def test_the_table_of_a_run_that_diverged_does_not_compare_it_with_a_closed_form(tmp_path):
    done = CliRunner().invoke(run, ["controller.period=0.1", "--out", str(tmp_path / "out")])
    assert done.exit_code == 3
    assert re.search(r"analytic force +│ not compared: the run diverged", done.stdout)
    assert "analytic position" not in done.stdout
    assert "relative error" not in done.stdout
