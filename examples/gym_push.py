"""A hand-written policy on the Gymnasium environment: hold the pose in an unknown current, then find the force.

pip install 'uvms-mj[gym]'
python examples/gym_push.py
"""

import gymnasium
import numpy as np

import uvms_mj.envs  # noqa: F401  # registers the environment

K = np.array([150.0, 150.0, 150.0, 10.0, 10.0, 10.0])  # N/m, N m
D = np.array([80.0, 80.0, 80.0, 4.0, 4.0, 4.0])  # N s/m, N m s
SCALE = np.array([40.0, 40.0, 40.0, 10.0, 10.0, 10.0])  # wrench_scale of the environment [N, N m]


def main(seconds: float = 20.0, rate: float = 100.0) -> list[float]:
    """Run one episode. Returns the reward of each control step; 1 is the demanded force at no effort."""
    env = gymnasium.make(
        "uvms_mj/PushWall-v0",
        overrides={"simulation.duration": seconds, "simulation.timestep": 5e-4},
        control_rate=rate,
        randomise={"current.speed": (0.2, 0.5), "current.direction_deg": (90.0, 150.0)},
    )
    seen, _ = env.reset(seed=1)
    integral, rewards, touched, over = np.zeros(6), [], False, False
    while not over:
        error = np.concatenate([seen["p_d"] - seen["p_WB"], -2.0 * seen["quat_WB"][1:]])  # of a small turn
        force = -seen["f_contact_m_W"][0]
        touched = touched or force > 0.0
        rates = 0.5 * K * error
        if touched:  # along the wall's normal, control the force in place of the position
            error[0], rates[0] = 0.0, seen["force_d"][0] - force
        integral += rates / rate
        seen, reward, ended, truncated, _ = env.step((K * error + integral - D * seen["nu"]) / SCALE)
        rewards.append(float(reward))
        over = ended or truncated
    env.close()
    return rewards


if __name__ == "__main__":
    import matplotlib.pyplot as plt

    rewards = main()
    print(f"mean reward of the last second: {np.mean(rewards[-100:]):.3f}")
    figure, axes = plt.subplots(figsize=(6.0, 3.2), layout="constrained")
    axes.plot(np.arange(1, len(rewards) + 1) / 100.0, rewards)
    axes.set(xlabel="time [s]", ylabel="reward", ylim=(0.0, 1.05))
