"""The policy that learns on Contact-10: what it learns on, what a return is, and the law that it writes."""

import numpy as np
import pytest

import learning_bench as bench
from uvms_mj import simulate
from uvms_mj.reproduce.bench.draws import KNOWN, Draws
from uvms_mj.reproduce.bench.task import LEVELS, Entry, tasks


@pytest.fixture(scope="module")
def law(tmp_path_factory):
    """A policy that presses: random weights, small behind the hidden layer but for the surge."""
    path, dice = tmp_path_factory.mktemp("law") / "pressing.py", np.random.default_rng(0)
    theta = np.round(0.1 * dice.normal(size=bench.COUNT), 4)
    bench.written(path, theta, 0, 1)
    return path, theta


@pytest.fixture
def few(monkeypatch):
    """Two draws to learn on and one to look at, of one task and level."""
    monkeypatch.setattr(bench, "LEVELS", (1,))
    monkeypatch.setattr(bench, "LEARNED", range(2))
    monkeypatch.setattr(bench, "LOOKED", range(2, 3))
    monkeypatch.setattr(bench, "PAIRS", 2)
    monkeypatch.setattr(bench, "BEST", 1)
    monkeypatch.setattr(bench, "tasks", lambda: {"other_vehicle": tasks()["other_vehicle"]})


def test_no_blind_draw_is_learned_on():
    """The seeds of the designs differ, and so do the draws: of 60 blind ones none is a development draw."""
    blind, entry = Draws.parsed("seed:20261129"), Entry("gsta", "gsta")
    seeds = {each.seed(name, level) for each in (KNOWN, blind) for name in tasks() for level in LEVELS}
    assert len(seeds) == 2 * len(tasks()) * len(LEVELS)
    for task in tasks().values():
        known, other = (
            {str(plan.run(i).values) for i in range(plan.runs)}
            for plan in (entry.plan(task, 1, draws) for draws in (KNOWN, blind))
        )
        assert len(known) > 10
        assert not known & other
    assert not set(bench.LEARNED) & set(bench.LOOKED)


def test_a_return_is_that_of_the_runs_trace(law):
    """Its parts from the rows of a run with the written law: two ways to the same number."""
    path, theta = law
    for ground in bench.grounds(path, range(1)).values():
        if ground.scenario.simulation.timestep < 5e-4:
            continue
        assert ground.scenario.controller.theta == tuple(theta)
        trace = simulate(ground.scenario, engine="free_body", log_rate="full")
        assert trace.status.name == "completed"
        each = round(bench.CHUNK_S / ground.scenario.simulation.timestep)
        pairs = 0.5 * ground.scenario.simulation.timestep * (trace.push[1:] + trace.push[:-1])
        impulse = np.concatenate([[0.0], np.cumsum(pairs)])[each - 1 :: each]
        error = np.minimum(np.abs(np.diff(impulse, prepend=0.0) / bench.CHUNK_S / ground.push - 1.0), 2.0)
        beside = np.minimum(np.abs(trace.eta_e[each::each, 1:]).sum(axis=1), 1.0).mean()
        late = trace.push[-round(0.5 / ground.scenario.simulation.timestep) - 1 : -1]
        spread = min(np.ptp(late) / ground.push, 2.0)
        limits = 0.2 * min(trace.saturation_time[-1], 5.0) / 5.0
        expected = -0.3 * error.mean() - error[-60:].mean() - 0.3 * spread - beside - limits
        assert bench.value(ground, theta) == pytest.approx(expected, abs=1e-6)


def test_the_rest_is_where_the_push_is_the_demanded_one(law):
    """The network is zero there, whatever its weights: tau_cmd is the integral's."""
    path, _ = law
    (ground,) = (each for key, each in bench.grounds(path, range(1)).items() if key == ("landing", 1, 0))
    law_of = type(ground.scenario.controller)
    gains = ground.scenario.controller

    class Signals:
        F_d, tau_contact_m_B = np.array([-5.0, 0, 0, 0, 0, 0]), np.array([-5.0, 0.3, 0, 0, 0, 0])
        eta_e, nu_e, period = np.array([0.04, 0, 0, 0, 0, 0]), np.zeros(6), 0.01

    class State:
        z = np.full(6, 0.25)

    class Gains:
        theta, T_I = np.array(gains.theta), gains.T_I

    command = np.zeros(6)
    law_of.law(Gains, State, Signals, None, command)
    assert command == pytest.approx(0.25 * np.array([40.0, 40.0, 40.0, 10.0, 10.0, 10.0]))
    Signals.tau_contact_m_B = np.zeros(6)
    law_of.law(Gains, State, Signals, None, command)
    assert abs(command[0] - 10.0) > 0.01


def test_a_seed_decides_what_is_learned(few, tmp_path):
    def learned(name, seed):
        rows = list(bench.learn(tmp_path / name, seed, 2))
        return rows[-1][3], [row[1:3] for row in rows][-1], (tmp_path / name).read_text().replace(name, "")

    (one, told, text), (again, told_again, text_again) = learned("a.py", 0), learned("b.py", 0)
    assert np.array_equal(one, again)
    assert (told, text) == (told_again, text_again)
    assert not np.array_equal(one, learned("c.py", 1)[0])


def test_a_step_goes_towards_better_policies(few, tmp_path, monkeypatch):
    """With the return -|theta - goal|^2, generations come nearer to the goal."""
    goal = np.full(bench.COUNT, 0.3)
    monkeypatch.setattr(bench, "value", lambda ground, theta: -float(((theta - goal) ** 2).mean()))
    means = [mean for _, mean, _, _ in bench.learn(tmp_path / "law.py", 0, 40)]
    assert np.polyfit(np.arange(40), means, 1)[0] > 0.0
    assert means[-1] > means[0]
