"""A policy learns to push with Stable-Baselines3: PPO on the walls and in the currents of learn_push.py.

pip install 'uvms-mj[gym]' stable-baselines3
python examples/sb3_push.py --steps 300000    and judges the policy on walls of other seeds
"""

import argparse
import time

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

import uvms_mj.envs  # noqa: F401  # registers the environment
from learn_push import JUDGED, RATE, SHORT, T_I, WALLS, observe, reward

SETTINGS = {"control_rate": RATE, "overrides": SHORT, "randomise": WALLS, "observe": observe, "reward": reward}


class PI(gymnasium.Wrapper):
    """The command a + z with z' = a / T_I, so that the vehicle rests where a = 0, in any current; z is observed."""

    def __init__(self, env):
        super().__init__(env)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (18,), np.float64)

    def reset(self, **given):
        self.z = np.zeros(6)
        seen, info = self.env.reset(**given)
        return np.append(seen, self.z), info

    def step(self, action):
        a = np.clip(action, -1.0, 1.0)
        self.z = np.clip(self.z + a / (T_I * RATE), -1.0, 1.0)
        seen, reward, ended, truncated, info = self.env.step(a + self.z)
        return np.append(seen, self.z), reward, ended, truncated, info


def judged(model, seeds):
    """Share of the episodes of some seeds that end with ``is_success``, and the mean return."""
    env, held, returns = PI(gymnasium.make("uvms_mj/PushWall-v0", **SETTINGS)), [], []
    for seed in seeds:
        seen, _ = env.reset(seed=seed)
        rewards, over = [], False
        while not over:
            seen, reward, ended, truncated, info = env.step(model.predict(seen, deterministic=True)[0])
            rewards.append(reward)
            over = ended or truncated
        held.append(info["is_success"])
        returns.append(np.mean(rewards))
    return float(np.mean(held)), float(np.mean(returns))


def learn(seed=0, steps=300_000):
    """Learn with eight environments for some control steps."""
    torch.set_num_threads(1)
    envs = make_vec_env("uvms_mj/PushWall-v0", 8, seed=seed, env_kwargs=SETTINGS, wrapper_class=PI)
    look = {"log_std_init": -2.0, "net_arch": [64, 64], "activation_fn": torch.nn.Tanh}
    model = PPO("MlpPolicy", envs, n_steps=700, batch_size=700, n_epochs=8, gae_lambda=0.95, gamma=0.99, seed=seed,
                learning_rate=lambda left: 3e-4 * left + 3e-5, policy_kwargs=look, device="cpu")  # fmt: skip
    return model.learn(steps)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Learn to push with Stable-Baselines3's PPO.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=300_000)
    parser.add_argument("--walls", type=int, default=len(JUDGED), help="walls on which it is judged")
    given = parser.parse_args()
    begun = time.process_time()
    found = learn(given.seed, given.steps)
    print(f"learned {given.steps} steps in {time.process_time() - begun:.0f} s of processor time")
    success, mean = judged(found, JUDGED[: given.walls])
    print(f"on {given.walls} other walls: success {success:.2f}, mean return {mean:.3f}")
    found.save("sb3_push")
