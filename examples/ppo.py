"""A policy learns to push by proximal policy optimisation (PPO), in one file of NumPy.

pip install 'uvms-mj[gym]'
python examples/ppo.py --out ppo              learns for a minute: ppo/policy.npz, curve.csv and curve.png
python examples/ppo.py --out ppo --video      records an episode of that policy (needs the extra video)

The policy pushes with a wrench on walls and in currents that it does not know. The network is behind a PI filter, u = a
+ z with z' = a / T_I, so that a rest has a = 0 in any current. The vehicle has a bumper of rubber: on stiff walls that
give back all energy, a policy at 25 Hz bounces.

Sources: J. Schulman et al., "Proximal policy optimization algorithms", 2017; "High-dimensional continuous control using
generalized advantage estimation", 2016. The learning rate follows the divergence of the new policy from the old one.
"""

import argparse
import os
import time
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small matrices: more threads wait for one another

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import binomtest

import uvms_mj.envs  # noqa: F401  # registers the environment

WALLS = [  # the [[vary]] of a study: what an episode draws, and the policy can't know
    {"key": "wall.stiffness", "distribution": "loguniform", "low": 2e3, "high": 1e5},
    {
        "keys": ["wall.position", "reference.target[0]"],  # the reference is 1 cm behind the face of the wall
        "distribution": "uniform",
        "low": [0.3, 0.31],
        "high": [0.7, 0.71],
    },
    {"key": "current.speed", "distribution": "uniform", "low": 0.0, "high": 0.5},
    {"key": "current.direction_deg", "distribution": "uniform", "low": 0.0, "high": 360.0},
]
SCENARIO = {
    "simulation.timestep": 1e-3,
    "simulation.duration": 7.0,
    "reference.step_time": 0.0,
    "bumper.stiffness": 5e3,  # N/m, in series with the wall's
    "bumper.damping": 100.0,  # N s/m
}
RATE, T_I = 25.0, 0.5  # Hz, s
STEPS = round(SCENARIO["simulation.duration"] * RATE)  # of an episode
LEARNED = 2**30  # seeds of episodes below it are learned on
LOOKED = range(LEARNED, LEARNED + 32)  # for the learning curve, and to choose settings
JUDGED = range(LEARNED + 32, LEARNED + 232)  # for the last number alone: nothing is chosen on them

SIZES = (22, 32, 32)  # numbers that the networks see, and their hidden layers
RUNS, EPOCHS, BATCH = 64, 5, 1120  # episodes of an iteration, passes over them, samples of a step of Adam
GAMMA, LAMBDA = 1.0 - 1.0 / (2.0 * RATE), 0.95  # a horizon of 2 s
CLIP, DIVERGENCE = 0.2, 0.02  # of the ratio of probabilities; wanted divergence of an iteration [nat]
NOISE = 0.1  # standard deviation of the first actions


def observe(seen):
    """(n, 16), from -1 to 1: pose error and velocity, along the push also in centimetres, and the relative error of the
    push at the end of the step and of its mean."""
    push = np.column_stack([-seen.f_contact_m_W[:, 0], seen.force]) / seen.force_d[:, None] - 1.0
    e, nu = seen.eta_e, seen.nu
    return np.tanh(np.column_stack([2.0 * e, 30.0 * e[:, :1], 2.0 * nu, 30.0 * nu[:, :1], push]))


def reward(seen):
    """(n,): at most 1, which is the demanded force at the reference. A hard touch costs no more than none: if first
    touches are punished, a policy keeps away. Errors of the pose count up to 2 m and rad in sum, so that
    lost runs don't decide a step."""
    off = np.abs(seen.force - seen.force_d) / seen.force_d
    return 1.0 - np.minimum(off, 1.0) - np.minimum(np.abs(seen.eta_e).sum(axis=1), 2.0) / 3.0


def make(n, **pictures):
    """n environments on all cores."""
    chosen = {"control_rate": RATE, "overrides": SCENARIO, "randomise": WALLS, "observe": observe, "reward": reward}
    return gymnasium.make_vec("uvms_mj/PushWall-v0", n, **chosen, **pictures)


def network(dice, sizes, last=1.0):
    """Weights (in, out) and offsets (out,) of each layer, one after another; the last layer's are times ``last``."""
    layers = [(dice.normal(size=shape) / np.sqrt(shape[0]), np.zeros(shape[1])) for shape in pairwise(sizes)]
    layers[-1][0][:] *= last
    return [array for layer in layers for array in layer]


def forward(net, x):
    """The outputs (n, out) for inputs (n, in), and the inputs of every layer."""
    inputs = [x]
    for W, b in zip(net[:-2:2], net[1:-2:2], strict=True):
        inputs.append(np.tanh(inputs[-1] @ W + b))
    return inputs[-1] @ net[-2] + net[-1], inputs


def backward(net, inputs, slope):
    """The gradient of a loss by every array of a network, from its slope (n, out) by the outputs."""
    gradient = []
    for k in reversed(range(len(inputs))):
        gradient[:0] = [inputs[k].T @ slope, slope.sum(axis=0)]
        slope = (slope @ net[2 * k].T) * (1.0 - inputs[k] ** 2)
    return gradient


def log_density(policy, mean, a):
    """(n,) logarithm of the density of actions (n, 6) around their means, but for a constant. A policy is a network and
    behind it the logarithm of the standard deviation (6,)."""
    return -0.5 * (((a - mean) / np.exp(policy[-1])) ** 2).sum(axis=1) - policy[-1].sum()


def clipped_loss(policy, x, a, old, advantage):
    """The clipped objective of PPO with the opposite sign, and its gradient by every array of the policy."""
    mean, inputs = forward(policy[:-1], x)
    ratio = np.exp(log_density(policy, mean, a) - old)
    cut = np.clip(ratio, 1.0 - CLIP, 1.0 + CLIP)
    slope = np.where(ratio * advantage <= cut * advantage, -ratio * advantage, 0.0)[:, None] / len(x)  # by log density
    off = (a - mean) / np.exp(policy[-1])
    gradient = backward(policy[:-1], inputs, slope * off / np.exp(policy[-1]))
    return -np.minimum(ratio * advantage, cut * advantage).mean(), [*gradient, (slope * (off**2 - 1.0)).sum(axis=0)]


def value_loss(value, x, target):
    """Half the mean square error of the values of x (n, in), and its gradient."""
    out, inputs = forward(value, x)
    off = out - target[:, None]
    return 0.5 * (off**2).mean(), backward(value, inputs, off / len(x))


class Adam:
    """Steps along a gradient, which change the arrays in place (Kingma and Ba, 2015)."""

    def __init__(self, arrays):
        self.arrays, self.steps = arrays, 0
        self.mean, self.square = [np.zeros_like(x) for x in arrays], [np.zeros_like(x) for x in arrays]

    def step(self, gradient, rate):
        self.steps += 1
        for x, g, m, s in zip(self.arrays, gradient, self.mean, self.square, strict=True):
            m += 0.1 * (g - m)
            s += 0.001 * (g * g - s)
            x -= rate * m / (1.0 - 0.9**self.steps) / (np.sqrt(s / (1.0 - 0.999**self.steps)) + 1e-8)


def advantages(rewards, values, going, gamma, lam):
    """(T, n) generalised advantages of rewards (T, n). Values and ``going``, whether a run has not diverged, are
    (T + 1, n): a run that diverges has no value, and at the end of an episode's time the value counts."""
    found, later = np.zeros_like(rewards), np.zeros_like(rewards[0])
    for k in reversed(range(len(rewards))):
        ahead = gamma * going[k + 1]
        found[k] = later = rewards[k] + ahead * values[k + 1] - values[k] + ahead * lam * later
    return found


def episodes(env, policy, seeds, dice=None):
    """One episode of each seed, with noise from ``dice``: observations (T + 1, n, 22), actions (T, n, 6),
    rewards (T, n), whether a run has not diverged (T + 1, n), and successes (n,), 1 s within a tenth of the demanded
    force at the end."""
    seen, infos = env.reset(seed=list(seeds))
    z, xs, actions, rewards, going = np.zeros((len(seen), 6)), [], [], [], [np.ones(len(seen), bool)]
    for _ in range(STEPS):
        xs.append(np.column_stack([seen, 4.0 * z]))
        a = forward(policy[:-1], xs[-1])[0]
        if dice is not None:
            a += np.exp(policy[-1]) * dice.normal(size=a.shape)
        z = np.clip(z + a / (T_I * RATE), -1.0, 1.0)
        seen, reward, ended, _, infos = env.step(a + z)
        actions.append(a)
        rewards.append(reward)
        going.append(going[-1] & ~ended)
    xs.append(np.column_stack([seen, 4.0 * z]))
    return *(np.array(each) for each in (xs, actions, rewards, going)), going[-1] & infos["is_success"]


def learn(seed=0, iterations=120):
    """Learn. Yields after each iteration the mean reward of its episodes, and the policy."""
    dice, env = np.random.default_rng(seed), make(RUNS)
    policy = [*network(dice, (*SIZES, 6), last=0.01), np.full(6, np.log(NOISE))]
    value = network(dice, (*SIZES, 1))
    adam_policy, adam_value, rate = Adam(policy), Adam(value), 1e-3
    for _ in range(iterations):
        x, a, rewards, going, _ = episodes(env, policy, dice.integers(LEARNED, size=RUNS).tolist(), dice)
        values = forward(value, x)[0][..., 0]
        # rewards times 1 - gamma: a reward of 1 for ever has the return 1
        advantage = advantages((1.0 - GAMMA) * rewards, values, going, GAMMA, LAMBDA)
        kept = going[:-1]  # a run that has diverged begins another episode, which is left out
        x, a, target, advantage = x[:-1][kept], a[kept], (advantage + values[:-1])[kept], advantage[kept]
        advantage = (advantage - advantage.mean()) / advantage.std()
        old = log_density(policy, forward(policy[:-1], x)[0], a)
        for _ in range(EPOCHS):
            for some in np.array_split(dice.permutation(len(x)), max(1, len(x) // BATCH)):
                adam_policy.step(clipped_loss(policy, x[some], a[some], old[some], advantage[some])[1], rate)
                adam_value.step(value_loss(value, x[some], target[some])[1], rate)
            moved = (old - log_density(policy, forward(policy[:-1], x)[0], a)).mean()
            rate *= 1.3 if moved < DIVERGENCE / 1.5 else 1.0 / 1.3 if moved > 1.5 * DIVERGENCE else 1.0
        yield float(rewards.mean()), policy
    env.close()


def judged(policy, seeds):
    """Judge a policy without noise. Returns its share of success, and the 95 % interval of it (Wilson's)."""
    env = make(len(seeds))
    held = int(episodes(env, policy, seeds)[-1].sum())
    env.close()
    return held / len(seeds), *binomtest(held, len(seeds)).proportion_ci(0.95, "wilson")


def draw(curve, path):
    """Draw the success and the mean reward over the control steps."""
    steps, _, rewards, success = np.transpose(curve)
    figure, axes = plt.subplots(figsize=(6.0, 3.5), layout="constrained")
    axes.plot(steps / 1e6, success, label=f"share of success in {len(LOOKED)} other episodes")
    axes.plot(steps / 1e6, rewards, label="mean reward while learning")
    axes.set(xlabel="control steps [million]")
    axes.legend()
    figure.savefig(path, dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Learn to push by PPO.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--iterations", type=int, default=120)
    parser.add_argument("--out", type=Path, default=Path("ppo"), help="folder of policy and curve")
    parser.add_argument("--video", action="store_true", help="record the policy that is there; learn nothing")
    given = parser.parse_args()
    if given.video:
        pictures = make(1, render_mode="rgb_array", render_view="follow")
        env = gymnasium.wrappers.vector.RecordVideo(pictures, str(given.out), name_prefix="push")
        episodes(env, list(np.load(given.out / "policy.npz").values()), JUDGED[:1])
        raise SystemExit(env.close())
    given.out.mkdir(parents=True, exist_ok=True)
    curve, begun = [], time.perf_counter()
    for k, (mean, policy) in enumerate(learn(given.seed, given.iterations), 1):
        if k % 10 == 0 or k == given.iterations:
            curve.append((k * RUNS * STEPS, time.process_time(), mean, judged(policy, LOOKED)[0]))
            left = (time.perf_counter() - begun) * (given.iterations - k) / k
            steps, spent, _, success = curve[-1]
            print(f"{steps} steps, {spent:.0f} s of CPU: reward {mean:.3f}, success {success:.2f}; {left:.0f} s left")
            np.savez(given.out / "policy.npz", *policy)
            header = "steps,cpu_s,mean_reward,success"
            np.savetxt(given.out / "curve.csv", curve, "%.10g", ",", header=header, comments="")
            draw(curve, given.out / "curve.png")
    share, low, high = judged(policy, JUDGED)
    print(f"success {share:.3f} ({low:.3f} to {high:.3f}) in {len(JUDGED)} episodes on which nothing was chosen")
