"""Tuning by trial on the dm_control environment: an action scales two gains of GSTA while it pushes.

pip install 'uvms-mj[dm]'      (Python up to 3.12)
python examples/dm_push.py
"""

import numpy as np

from uvms_mj import envs


def main(episodes: int = 5, seconds: float = 8.0) -> list[float]:
    """Run episodes with one random pair of gains each. Returns the mean rewards."""
    env = envs.load(
        "push_wall",
        action="gains",
        gains=("k_1", "k_2"),
        overrides={"simulation.duration": seconds, "simulation.timestep": 5e-4},
        randomise={"wall.stiffness": (2e4, 2e5)},
        seed=1,
    )
    dice, returns = np.random.default_rng(1), []
    for _ in range(episodes):
        action = dice.uniform(-1.0, 1.0, env.action_spec().shape)
        step, rewards = env.reset(), []
        while not step.last():
            step = env.step(action)
            rewards.append(step.reward)
        returns.append(float(np.mean(rewards)))
        print(f"k_1 x {4 ** action[0]:.2f}, k_2 x {4 ** action[1]:.2f}: mean reward {returns[-1]:.3f}")
    return returns


if __name__ == "__main__":
    import matplotlib.pyplot as plt

    returns = main()
    figure, axes = plt.subplots(figsize=(6.0, 3.2), layout="constrained")
    axes.bar(range(1, len(returns) + 1), returns)
    axes.set(xlabel="episode, each with its own gains and wall", ylabel="mean reward", ylim=(0.0, 1.0))
