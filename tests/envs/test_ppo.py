"""The example of PPO: its gradients, its advantages, and the seed that decides what it learns."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="needs the extra gym")

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def example():
    spec = importlib.util.spec_from_file_location("ppo", EXAMPLES / "ppo.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def differences(loss, arrays, step=1e-6):
    """Central differences of a loss by every number of some arrays."""
    found = []
    for array in arrays:
        slopes = np.zeros_like(array)
        for place in np.ndindex(array.shape):
            kept, ends = array[place], []
            for number in (kept + step, kept - step):
                array[place] = number
                ends.append(loss())
            array[place] = kept
            slopes[place] = (ends[0] - ends[1]) / (2.0 * step)
        found.append(slopes)
    return found


def test_the_gradients_are_the_slopes_of_the_losses(example):
    """On both sides of the clip, for advantages of both signs."""
    dice = np.random.default_rng(0)
    policy = [*example.network(dice, (5, 4, 3, 6)), dice.normal(-0.5, 0.2, 6)]
    x, advantage = dice.normal(size=(40, 5)), dice.normal(size=40)
    a = example.forward(policy[:-1], x)[0] + 0.5 * dice.normal(size=(40, 6))
    old = example.log_density(policy, example.forward(policy[:-1], x)[0], a) + dice.normal(0.0, 0.4, 40)
    ratio = np.exp(example.log_density(policy, example.forward(policy[:-1], x)[0], a) - old)
    for side in (ratio > 1.0 + example.CLIP, ratio < 1.0 - example.CLIP):
        assert (side & (advantage > 0.0)).any()
        assert (side & (advantage < 0.0)).any()
    _, gradient = example.clipped_loss(policy, x, a, old, advantage)
    slopes = differences(lambda: example.clipped_loss(policy, x, a, old, advantage)[0], policy)
    value, target = example.network(dice, (5, 4, 3, 1)), dice.normal(size=40)
    gradient += example.value_loss(value, x, target)[1]
    slopes += differences(lambda: example.value_loss(value, x, target)[0], value)
    for mine, slope in zip(gradient, slopes, strict=True):
        assert np.abs(mine).max() > 1e-4
        assert mine == pytest.approx(slope, rel=1e-5, abs=1e-8)


def test_advantages_are_the_sum_of_the_discounted_errors(example):
    """Each error of the values, times (gamma lambda)^k, up to the end of the time or of the run."""
    dice = np.random.default_rng(1)
    T, gamma, lam = 9, 0.9, 0.7
    rewards, values, going = dice.normal(size=(T, 2)), dice.normal(size=(T + 1, 2)), np.ones((T + 1, 2), bool)
    going[5:, 1] = False  # the second run diverges in its step 4
    found = example.advantages(rewards, values, going, gamma, lam)
    for run, end in enumerate((T, 5)):
        ahead = values[1:, run] * going[1:, run]
        errors = rewards[:, run] + gamma * ahead - values[:-1, run]
        closed = [sum((gamma * lam) ** (k - t) * errors[k] for k in range(t, end)) for t in range(end)]
        assert found[:end, run] == pytest.approx(closed, rel=1e-12)


def test_a_seed_decides_what_is_learned(example, monkeypatch):
    monkeypatch.setattr(example, "RUNS", 4)
    monkeypatch.setattr(example, "STEPS", 10)

    def learned(seed):
        return [(mean, [array.copy() for array in policy]) for mean, policy in example.learn(seed, 2)]

    first, again, other = learned(3), learned(3), learned(4)
    assert [mean for mean, _ in first] == [mean for mean, _ in again]
    assert all(np.array_equal(*pair) for pair in zip(first[1][1], again[1][1], strict=True))
    assert first[1][0] != other[1][0]
    assert not np.array_equal(first[0][1][0], first[1][1][0])


def test_no_episode_is_learned_on_and_judged(example):
    assert max(example.LOOKED) < min(example.JUDGED)
    assert min(example.LOOKED) >= example.LEARNED
