"""Start values of states: where a class declares them, a run begins and a reset returns to them."""

import re

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, Simulation

FILE = """
from dataclasses import dataclass
from uvms_mj import Actuation, Controller, Guidance, Navigation, Observer
from uvms_mj.actuation import Thrusters, pseudo_inverse
from uvms_mj.guidance import station_keep
from uvms_mj.navigation import perfect

@dataclass(frozen=True)
class Own({base}):
    states = {{"decays": {size}, "zero": 2}}
    memory = {{"kept": 2}}
    start_values = {starts}

    @staticmethod
    def {method}:
        {body}
        {plain}
        for i in range(len(state.decays)):
            state_dot.decays[i] = -2.0 * state.decays[i]
        for i in range(2):
            state_dot.zero[i] = state.kept[i]
"""
ROOMS = {
    "controller": ("Controller", "law(gains, state, signals, state_dot, tau_cmd)", "tau_cmd[:] = 0.0"),
    "navigation": ("Navigation", "step(settings, state, given, state_dot, out)", "perfect(given, out)"),
    "reference": ("Guidance", "step(settings, state, given, state_dot, out)", "station_keep(settings, given, out)"),
    "actuation": ("Actuation", "step(settings, state, given, state_dot, u)", "pseudo_inverse(given, u)"),
    "thrusters": ("Thrusters", "step(settings, state, given, state_dot, u)", "u[:] = given.u_cmd"),
}
STARTS = '{"decays": [1.0, -2.0, 3.0], "kept": 0.5}'


def own(tmp_path, table, starts=STARTS, size=3, plain=False):
    base, method, body = ROOMS[table]
    python = "repr(state)" if plain else ""  # which is not in the language
    text = FILE.format(base=base, method=method, body=body, starts=starts, size=size, plain=python)
    (tmp_path / "own.py").write_text(text)
    settings = {f"{table}.name": f"{tmp_path / 'own.py'}:Own", "simulation.timestep": 1e-3}
    return Scenario.load("push_wall", settings)


@pytest.mark.parametrize(
    ("table", "plain"), [("controller", False), ("navigation", False), ("thrusters", False), ("controller", True)]
)
def test_states_and_memory_begin_at_their_values_and_return_to_them(tmp_path, table, plain):
    """Explicit Euler of x' = -2 x from the start, and of y' = 0.5 from zero, with the memory that stays as it was."""
    start, h = np.array([1.0, -2.0, 3.0]), 1e-3
    with Simulation(own(tmp_path, table, plain=plain), engine="free_body") as sim:
        assert bool(sim.slow_stages) == plain
        for steps in (10, 7):
            assert np.array_equal(sim.signals["decays"], start)
            assert not sim.signals["zero"].any()
            sim.step(steps)
            n = steps if table in ("navigation", "reference") else steps - 1  # the law's instant is in the next step
            assert sim.signals["decays"] == pytest.approx(start * (1.0 - 2.0 * h) ** n, rel=1e-14)
            assert sim.signals["zero"] == pytest.approx(np.full(2, 0.5 * h * n), rel=1e-14)
            sim.reset()


def test_a_list_for_the_thrusters_has_their_number(tmp_path):
    six, five = ('{"decays": [1, 2, 3, 4, 5, 6], "kept": 0.5}', '{"decays": [1, 2, 3, 4, 5], "kept": 0.5}')
    with Simulation(own(tmp_path, "actuation", six, '"thrusters"'), engine="free_body") as sim:
        assert sim.signals["decays"].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    scenario = own(tmp_path, "actuation", five, '"thrusters"')
    with pytest.raises(
        InputError, match=r"^actuation.name: Own: start_values\['decays'\] has 5 numbers; the state has 6"
    ):
        Simulation(scenario, engine="free_body")


@pytest.mark.parametrize(
    ("starts", "said"),
    [
        ('{"decayz": 1.0}', "start_values has 'decayz', which is not a state; did you mean 'decays'?"),
        ('{"decays": [1.0, 2.0]}', "start_values['decays'] has 2 numbers; the state has 3"),
        ('{"kept": [1.0, float("nan")]}', "start_values.kept: [1.0, nan] must be a finite number or a list of them"),
        ('{"zero": "one"}', "start_values.zero: 'one' must be a finite number or a list of them"),
        ('{"zero": [[1.0, 2.0]]}', "start_values.zero: [[1.0, 2.0]] must be a finite number or a list of them"),
        ('{"zero": True}', "start_values.zero: True must be a finite number or a list of them"),
        ("[1.0]", "start_values: [1.0] is not a table"),
    ],
)
def test_wrong_start_values_are_named(tmp_path, starts, said):
    with pytest.raises(InputError, match=rf"controller.name: Own in .*own\.py: {re.escape(said)}"):
        own(tmp_path, "controller", starts)
