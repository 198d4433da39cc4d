"""The environment for Gymnasium."""

import warnings

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")
from gymnasium.utils.env_checker import check_env  # noqa: E402  # after the skip

import uvms_mj.envs  # noqa: E402, F401  # registers the environment

SHORT = {"simulation.duration": 0.2, "simulation.timestep": 1e-3}


def make(**settings):
    return gymnasium.make("uvms_mj/PushWall-v0", overrides=SHORT, **settings)


@pytest.mark.parametrize("action", ["wrench", "thrusts", "gains"])
def test_gymnasiums_own_check(action):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*observation space m.* value is -?infinity")
        check_env(make(action=action).unwrapped)


def test_an_episode_is_truncated_at_the_scenarios_duration():
    env = make()
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[2:4] for _ in range(10)]
    assert ends == [(False, False)] * 9 + [(False, True)]
    with pytest.raises(gymnasium.error.ResetNeeded):
        make().step(np.zeros(6))


def test_a_divergence_terminates_with_its_reason():
    env = make(wrench_scale=(1e6,) * 6)
    env.reset(seed=0)
    for _ in range(10):
        _, reward, terminated, truncated, info = env.step(np.ones(6))
        if terminated:
            break
    assert (reward, terminated, truncated) == (-1.0, True, False)
    assert "velocity" in info["diverged"]
    env.reset()
    assert not env.step(np.zeros(6))[2]


def test_a_vector_of_environments_gives_each_its_own_episode():
    """Two environments in threads of one process, each as it is alone."""
    settings = {"overrides": SHORT, "randomise": {"current.speed": (0.0, 0.5)}}
    both = gymnasium.make_vec("uvms_mj/PushWall-v0", num_envs=2, vectorization_mode="sync", **settings)
    both.reset(seed=5)
    together = both.step(np.full((2, 6), 0.3))[0]["nu"]
    alone = []
    for seed in (5, 6):
        env = gymnasium.make("uvms_mj/PushWall-v0", **settings)
        env.reset(seed=seed)
        alone.append(env.step(np.full(6, 0.3))[0]["nu"])
    assert np.array_equal(together, alone)
    assert not np.array_equal(alone[0], alone[1])
