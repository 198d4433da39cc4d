"""The environment for dm_control, with dm_env's own tests."""

import unittest

import numpy as np
import pytest

pytest.importorskip("dm_control", reason="needs the extra dm (Python up to 3.12)")
from dm_env import test_utils

from uvms_mj import InputError, envs
from uvms_mj.envs.push import Push

SHORT = {"simulation.duration": 0.2, "simulation.timestep": 1e-3}


@pytest.mark.parametrize("action", ["wrench", "thrusts", "gains"])
def test_dm_envs_own_tests(action):
    class Case(test_utils.EnvironmentTestMixin, unittest.TestCase):
        def make_object_under_test(self):
            return envs.load("push_wall", overrides=SHORT, action=action, seed=0)

        def make_action_sequence(self):
            dice = np.random.default_rng(0)
            return [dice.uniform(-1.0, 1.0, self.environment.action_spec().shape) for _ in range(30)]

    result = unittest.TestResult()
    unittest.defaultTestLoader.loadTestsFromTestCase(Case).run(result)
    assert result.testsRun >= 4
    assert not result.errors + result.failures, (result.errors + result.failures)[0][1]


def test_both_interfaces_are_the_same_task_bit_for_bit():
    settings = {"overrides": SHORT, "randomise": {"current.speed": (0.0, 0.5)}, "seed": 7}
    env, push = envs.load("push_wall", **settings), Push("push_wall", **settings)
    step, seen = env.reset(), push.reset()
    for k in range(10):
        assert all(np.array_equal(step.observation[name], seen[name]) for name in seen)
        action = np.sin(np.arange(6.0) + k)
        step = env.step(action)
        push.apply(action)
        assert step.reward == push.advance(push.steps_each)
        seen = push.observation()
    assert step.last()
    assert step.discount == 1.0


def test_an_episode_with_another_vehicle_has_its_data():
    env = envs.load(overrides=SHORT, randomise={"vehicle.mass": (0.9, 1.1)}, seed=1)
    for _ in range(2):
        env.reset()
        env.step(np.ones(6))
        assert np.array_equal(env.physics.data.qvel, env.physics.push.simulation.data.qvel)
        assert env.physics.data.time == pytest.approx(0.02)


def test_the_physics_has_the_water():
    """A free vehicle in a current drifts with it."""
    drifting = SHORT | {"simulation.duration": 30.0, "simulation.timestep": 5e-3, "wall.position": 50.0}
    env = envs.load("push_wall", overrides=drifting, control_rate=1.0, force_d=1.0)
    step = env.reset()
    while not step.last():
        step = env.step(np.zeros(6))
    velocity = env.physics.data.qvel[:3]
    assert velocity == pytest.approx(env.physics.push.scenario.current.velocity_W, abs=0.02)


def test_a_divergence_ends_an_episode_with_discount_zero():
    env = envs.load("push_wall", overrides=SHORT, wrench_scale=(1e6,) * 6)
    step = env.reset()
    while not step.last():
        step = env.step(np.ones(6))
    assert (step.reward, step.discount) == (-1.0, 0.0)


def test_a_picture_shows_the_vehicle_and_what_else_is_asked_for_is_refused(driver):
    env = envs.load("push_wall", overrides=SHORT | {"initial.position": [0.6, 0.0, 0.0]})
    env.reset()
    first = env.physics.render(180, 320, camera_id="close")
    assert first.shape == (180, 320, 3)
    assert first.mean() > 40.0
    for _ in range(8):
        env.step(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    moved = np.abs(env.physics.render(180, 320, camera_id="close").astype(int) - first).sum(axis=2) > 60
    assert 0.002 < moved[60:].mean() < 0.5  # the vehicle, below the text with the time
    with pytest.raises(InputError, match="depth: can't be drawn"):
        env.physics.render(depth=True)
    with pytest.raises(InputError, match="render_view: 0: must be the name"):
        env.physics.render(camera_id=0)
    env.close()


def test_the_info_is_beside_the_task():
    env = envs.load("push_wall", overrides=SHORT)
    env.reset()
    env.step(np.zeros(6))
    info = env.physics.push.info()
    assert (info["t"], info["force"], info["contact"]) == (0.02, 0.0, False)
