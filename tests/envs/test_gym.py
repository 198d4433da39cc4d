"""The environment for Gymnasium."""

import warnings

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")
from gymnasium.utils.env_checker import check_env  # noqa: E402  # after the skip

import uvms_mj.envs  # noqa: E402, F401  # registers the environment
from uvms_mj import InputError  # noqa: E402

SHORT = {"simulation.duration": 0.2, "simulation.timestep": 1e-3}


def make(**settings):
    return gymnasium.make("uvms_mj/PushWall-v0", overrides=SHORT, **settings)


@pytest.mark.parametrize("action", ["wrench", "thrusts", "gains"])
def test_gymnasiums_own_check(action):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
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


MODES = [mode.value for mode in gymnasium.vector.AutoresetMode]
RANDOM = {"current.speed": (0.0, 0.5), "vehicle.mass": (0.9, 1.1)}


def own(seen):
    """A reward of one's own."""
    return -np.abs(seen.force - seen.force_d)


def vector(mode, kind=None, n=3, **settings):
    """A vector environment of this package, or with ``kind`` one that Gymnasium makes of single environments."""
    settings = {"overrides": SHORT, "randomise": RANDOM} | settings
    if kind is None:
        return gymnasium.make_vec("uvms_mj/PushWall-v0", n, autoreset_mode=mode, **settings)
    given = {"vectorization_mode": kind, "vector_kwargs": {"autoreset_mode": mode}}
    return gymnasium.make_vec("uvms_mj/PushWall-v0", n, **given, **settings)


def same(one, other):
    """Whether two observations, infos or results are the same, bit for bit."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, tuple) or getattr(one, "dtype", np.dtype(float)).hasobject:
        return len(one) == len(other) and all(map(same, one, other))
    return np.array_equal(one, other)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    "settings", [{"engine": "mujoco"}, {"action": "gains"}, {"reward": own, "wrench_scale": (1e6,) * 6}]
)
def test_a_vector_is_what_gymnasium_makes_of_single_environments(mode, settings):
    """Observations, rewards, ends and infos, through ends, divergences and resets, bit for bit."""
    ours, theirs = vector(mode, **settings), vector(mode, "sync", **settings)
    assert ours.single_observation_space == theirs.single_observation_space
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert same(ours.reset(seed=5)[0], theirs.reset(seed=5)[0])
    dice, ends = np.random.default_rng(0), 0
    for _ in range(25):
        actions = dice.uniform(-1.0, 1.0, ours.action_space.shape)
        results = ours.step(actions), theirs.step(actions)
        assert same(*results)
        over = results[0][2] | results[0][3]
        ends += over.sum()
        if mode == "Disabled" and over.any():
            again = [each.reset(options={"reset_mask": over.copy()})[0] for each in (ours, theirs)]
            assert same(*again)
    assert ends >= 6
    ours.close()
    theirs.close()


def test_neither_the_number_of_environments_nor_of_threads_changes_an_episode():
    def velocities(n, threads, seed):
        env = vector("NextStep", n=n, threads=threads, overrides=SHORT | {"simulation.timestep": 1e-4})
        env.reset(seed=seed)
        found = [env.step(np.full((n, 6), 0.3))[0]["nu"] for _ in range(12)]
        env.close()
        return np.array(found)

    many = velocities(16, 4, 5)
    assert np.array_equal(many, velocities(16, 1, 5))
    assert np.array_equal(many[:, 7:9], velocities(2, 2, 12))
    assert len(set(many[0, :, 0])) == 16


def test_seeds_and_options_of_a_vector():
    env = vector("Disabled")
    first, _ = env.reset(seed=[7, 5, 5], options={"wall.stiffness": 2e3, "initial.position": [1.001, 0.0, 0.0]})
    assert first["f_contact_m_W"][:, 0] == pytest.approx(-2.0)
    assert first["force_d"] == pytest.approx(np.full((3, 1), 1.5 / (1.0 + 150.0 / 2e3)))
    acted = env.step(np.zeros((3, 6)))[0]["nu"]
    assert np.array_equal(acted[1], acted[2])
    assert not np.array_equal(acted[0], acted[1])
    seen, _ = env.reset(options={"reset_mask": np.array([False, True, False])})
    assert (seen["nu"] == 0.0).all(axis=1).tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: vector("Never"), "autoreset_mode: 'Never': must be one of NextStep, SameStep, Disabled"),
        (lambda: vector("NextStep", n=0), "n: 0: must be a positive number"),
        (lambda: vector("NextStep", threads=0), "threads: 0: must be a positive integer"),
        (lambda: vector("NextStep").step(np.zeros((3, 6))), "reset environments"),
        (lambda: vector("NextStep").reset(seed=[1, 2]), "has 2 seeds for 3"),
        (lambda: vector("NextStep").reset(options={"reset_mask": [True] * 3}), "reset_mask"),
        (lambda: vector("NextStep").reset(options={"wall.stifness": 1.0}), "did you mean 'stiffness'"),
    ],
)
def test_a_wrong_use_of_a_vector_is_named(wrong, message):
    with pytest.raises((InputError, gymnasium.error.ResetNeeded), match=message):
        wrong()


def test_an_action_without_a_value_is_refused():
    env = vector("NextStep")
    env.reset(seed=0)
    with pytest.raises(InputError, match="must be 3 x 6 finite numbers"):
        env.step(np.full((3, 6), np.nan))
