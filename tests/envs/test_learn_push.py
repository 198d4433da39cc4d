"""The example that learns to push: its search, and the law that it writes."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="needs the extra gym")

from uvms_mj import Scenario, simulate  # after the skip
from uvms_mj.control.design import demanded_force

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def example(monkeypatch):
    spec = importlib.util.spec_from_file_location("learn_push", EXAMPLES / "learn_push.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setitem(module.SHORT, "simulation.duration", 0.5)
    return module


def test_a_policy_is_the_law_that_it_is_written_as(example, tmp_path):
    """The motion of the environment with the policy, and of a run with the law, up to the digits of its weights."""
    dice = np.random.default_rng(0)
    theta = np.round(example.first(dice) + 0.1 * dice.normal(size=example.first(dice).size), 4)
    example.export(theta, tmp_path / "policy.py", "of a test.")
    env = example.make(1)
    start = {"initial.position": [0.49, 0.02, 0.0], "wall.stiffness": 5e3, "wall.position": 0.5}
    current = {"current.speed": 0.3, "current.direction_deg": 120.0, "reference.target": [0.51, 0.0, 0.0]}
    seen, _ = env.reset(seed=0, options=start | current)
    layers, z = example.layers_of(theta[None]), np.zeros((1, 6))
    for _ in range(50):
        a = example.actions(layers, seen)
        z = np.clip(z + a / (example.T_I * example.RATE), -1.0, 1.0)
        seen = env.step(a + z)[0]
    scenario = Scenario.load("push_wall", example.SHORT | start | current, f"{tmp_path / 'policy.py'}:LearnedPush")
    trace = simulate(scenario, engine="free_body")
    assert np.abs(trace.nu_e[-1]).max() > 0.01
    assert seen[0, 6:] / 10.0 == pytest.approx(trace.nu_e[-1], rel=1e-6, abs=1e-9)
    env.close()


def test_a_seed_decides_what_is_learned(example):
    def learned(seed):
        return [(mean, theta) for _, mean, theta in example.learn(seed, 2)]

    first, again, other = learned(3), learned(3), learned(4)
    assert [mean for mean, _ in first] == [mean for mean, _ in again]
    assert np.array_equal(first[1][1], again[1][1])
    assert first[1][0] != other[1][0]
    assert not np.array_equal(first[0][1], first[1][1])


def test_a_step_goes_towards_better_policies(example, monkeypatch):
    """With the return -|theta - goal|^2 / d, a generation comes nearer to the goal."""
    size = example.first(np.random.default_rng(0)).size
    goal = 0.3 * np.ones(size)
    monkeypatch.setattr(example, "returns", lambda env, theta, seeds: -((theta - goal) ** 2).mean(axis=1))
    means = [mean for _, mean, _ in example.learn(0, 40)]
    assert means[-1] > means[0]
    assert np.polyfit(np.arange(40), means, 1)[0] > 0.0


@pytest.mark.parametrize("stiffness", [5e3, 2e4])
def test_the_policy_that_ships_holds_the_force_in_a_current(stiffness):
    settings = {"simulation.timestep": 1e-3, "wall.stiffness": stiffness, "current.speed": 0.3}
    scenario = Scenario.load("push_wall", settings, f"{EXAMPLES / 'learned_push.py'}:LearnedPush")
    trace = simulate(scenario, engine="free_body")
    force_d = demanded_force(scenario, stiffness)
    assert trace.between(19.0, 20.0).push == pytest.approx(force_d, rel=0.1)
    assert abs(trace.eta_e[-1, 1:3]).max() < 0.01


def test_what_is_judged_on_is_neither_learned_nor_chosen_on(example, monkeypatch):
    """Seeds of learning, looking and judging have none in common, and so have the draws of their episodes."""
    used = []
    monkeypatch.setattr(example, "returns", lambda env, theta, seeds: used.extend(seeds) or np.arange(len(theta)))
    for seed in (0, 1):
        list(example.learn(seed, 30))
    learned, looked, judged = set(used), set(example.LOOKED), set(example.JUDGED)
    assert len(learned) == 2 * 30 * example.PAIRS
    assert max(learned) < example.LEARNED <= min(looked | judged)
    assert not looked & judged
    env = example.make(1)
    draws = set()
    for seed in (*used[:20], *list(looked)[:10], *list(judged)[:10]):
        env.reset(seed=[seed])
        draws.add(env.pushes.batch[0].scenario.wall.stiffness)
    assert len(draws) == len({*used[:20]}) + 20
    env.close()


def test_success_is_what_the_law_does_in_a_run_of_the_same_draw(example, monkeypatch):
    """Of the mean force by the trapezoidal rule of a trace, for each control step of the last second."""
    monkeypatch.setitem(example.SHORT, "simulation.duration", 7.0)
    policy = importlib.util.spec_from_file_location("learned_push", EXAMPLES / "learned_push.py")
    module = importlib.util.module_from_spec(policy)
    policy.loader.exec_module(module)
    theta, seeds = np.array(module.WEIGHTS.split(), float), list(example.JUDGED)[16:24]
    env, held = example.make(1), []
    for seed in seeds:
        env.reset(seed=[seed])
        scenario = env.pushes.batch[0].scenario
        law = scenario.updated({"controller.name": f"{EXAMPLES / 'learned_push.py'}:LearnedPush"})
        push = simulate(law, engine="free_body", log_rate=1000.0).push[-1002:-1]
        means = (0.5 * (push[1:] + push[:-1])).reshape(100, 10).mean(axis=1)
        force_d = demanded_force(scenario, scenario.wall.stiffness)
        held.append(bool((np.abs(means / force_d - 1.0) <= 0.1).all()))
    assert example.judged(theta, seeds) == np.mean(held)
    assert set(held) == {False, True}
    assert example.judged(example.first(np.random.default_rng(0)), seeds) == 0.0
