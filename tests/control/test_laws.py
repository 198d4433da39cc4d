"""The shipped laws: documented gains, and identities between laws."""

from dataclasses import dataclass

import numpy as np
import pytest

from law_files import law_file, one_liner
from uvms_mj import Gsta, InputError, Scenario, simulate
from uvms_mj.control import BUILT_IN, Ideal, Impedance, ImpedanceTask

SHORT = {"simulation.duration": 0.2}


@pytest.mark.parametrize("law", BUILT_IN)
def test_built_in_laws_have_documented_gains(law):
    for field in BUILT_IN[law].setting_fields():
        assert field.metadata["unit"], field.name
        assert field.metadata["meaning"], field.name


def test_the_truth_is_given_to_the_yardstick_alone(tmp_path):
    peek = one_liner("Peek", "tau_cmd[:] = signals.tau_nom + 0.0 * signals.tau_dist")
    path = law_file(tmp_path, peek)
    with pytest.raises(InputError, match=r"tau_dist.*yardstick"):
        Scenario.load("push_wall", SHORT, f"{path}:Peek")
    greedy = peek.replace("    @staticmethod", "    uses_truth = True\n    @staticmethod")
    path = law_file(tmp_path, greedy, name="greedy.py")
    with pytest.raises(InputError, match="yardstick"):
        simulate(Scenario.load("push_wall", SHORT, f"{path}:Peek"))

    @dataclass(frozen=True)
    class Greedy(Ideal):
        law = staticmethod(Impedance.law)

    @dataclass(frozen=True)
    class Peek(Gsta):
        uses_truth = True

    for law in (Greedy, Peek):
        with pytest.raises(InputError, match="yardstick"):
            law()


def test_ideal_without_the_truth_is_no_law_of_ours():
    @dataclass(frozen=True)
    class Blind(Ideal):
        uses_truth = False

    simulate(Scenario.load("push_wall", SHORT, "ideal"))
    with pytest.raises(InputError, match="C_nu_r"):
        simulate(Scenario.load("push_wall", SHORT), controller=Blind())


def test_the_yardstick_says_that_it_uses_the_truth(here, tmp_path):
    done = here("run", "-c", "ideal", "simulation.duration=0.1", "-o", "x")
    assert done.exit_code == 0
    assert "the truth" in done.stdout
    assert b"the truth" in (tmp_path / "x" / "run.mcap").read_bytes()


def test_standard_super_twisting_is_gsta_without_linear_terms():
    trace = {}
    for law, gains in (("sta", {}), ("gsta", {"controller.beta": 0.0})):
        trace[law] = simulate(Scenario.load("push_wall", {"simulation.duration": 2.0, **gains}, law))
    assert np.abs(trace["sta"].p_WB - trace["gsta"].p_WB).max() < 1e-9


@pytest.mark.parametrize("A", [0.0, [0.0] * 6])
def test_the_integral_sliding_variable_has_no_pole(A):
    assert ImpedanceTask(integral=True, A=A).A == (0.0,) * 6
    assert ImpedanceTask(integral=True) == ImpedanceTask(integral=True, A=A)
    with pytest.raises(InputError, match="if integral is true"):
        ImpedanceTask(integral=True, A=-50.0)
