"""A policy learns to push on walls that it does not know, in currents that it does not know: augmented random search.

pip install 'uvms-mj[gym]'
python examples/learn_push.py                 learns for a minute or two and writes learned_push.py
uvms-mj run --controller learned_push.py:LearnedPush

The policy is a network of two hidden layers of 64 without offsets behind a PI filter: u = a + z, where z' = a / T_I.
The vehicle rests where a = 0, in any current. The network is zero where its inputs are, the errors of the impedance.

Source: H. Mania, A. Guy and B. Recht, "Simple random search of static policies is competitive for reinforcement
learning", NeurIPS 2018; here with steps and perturbations that shrink.
"""

import argparse
import time
from itertools import pairwise
from pathlib import Path

import gymnasium
import numpy as np

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
SHORT = {"simulation.timestep": 1e-3, "simulation.duration": 7.0, "reference.step_time": 0.0}
RATE, T_I = 100.0, 0.5  # Hz, s
SIZES = (12, 64, 64, 6)
PAIRS, BEST = 16, 8  # perturbations of a generation, and how many decide its step
STEP, NOISE = 0.01, 0.03  # of the first generation
LEAST = 0.1  # of both at the end, times the values at the beginning
LEARNED = 2**30  # seeds of episodes below it are learned on
LOOKED = range(LEARNED, LEARNED + 32)  # for the learning curve, and to choose among policies
JUDGED = range(LEARNED + 32, LEARNED + 232)  # for the last number alone: nothing is chosen on them


def observe(seen):
    """(n, 12): errors of the desired impedance at rest, paper eq. (7), in 5 N, and of the velocity in 0.1 m/s."""
    off = seen.K_d * seen.eta_e - seen.K_f * (seen.tau_contact_m_B - seen.F_d)
    return np.concatenate([np.arcsinh(off / 5.0), 10.0 * seen.nu_e], axis=1)


def reward(seen):
    """(n,): at most 1, which is the demanded force at the reference."""
    off = np.minimum(np.abs(seen.force - seen.force_d) / seen.force_d, 2.0)
    return 1.0 - off / 2.0 - np.abs(seen.eta_e).sum(axis=1) / 3.0


def first(dice):
    """Parameters (d,) of a policy that does nothing: random hidden layers, and zeros behind them."""
    layers = [dice.normal(size=shape) / np.sqrt(shape[0]) for shape in pairwise(SIZES)]
    layers[-1][:] = 0.0
    return np.concatenate([W.ravel() for W in layers])


def layers_of(theta):
    """Weights (n, in, out) of each layer, from the parameters (n, d) of n policies. There are no offsets: a network is
    zero where its inputs are."""
    shapes = list(pairwise(SIZES))
    parts = np.split(theta, np.cumsum([rows * columns for rows, columns in shapes])[:-1], axis=1)
    return [part.reshape(-1, *shape) for part, shape in zip(parts, shapes, strict=True)]


def actions(layers, x):
    """(n, 6) outputs of n policies for their observations (n, 12)."""
    W_1, W_2, W_3 = layers
    return (np.tanh(np.tanh(x[:, None, :] @ W_1) @ W_2) @ W_3)[:, 0, :]


def returns(env, theta, seeds):
    """(n,) mean rewards of one episode each of n policies (n, d)."""
    return episodes(env, theta, seeds)[0]


def judged(theta, seeds):
    """Share of the episodes of some seeds at whose end a policy (d,) has held the force: ``is_success``, which is 1 s
    within a tenth of the demanded force."""
    env = make(len(seeds))
    _, held = episodes(env, np.tile(theta, (len(seeds), 1)), list(seeds))
    env.close()
    return float(held.mean())


def episodes(env, theta, seeds):
    """(n,) mean rewards, and (n,) successes, of one episode each of n policies (n, d)."""
    layers, steps = layers_of(theta), round(SHORT["simulation.duration"] * RATE)
    seen, _ = env.reset(seed=seeds)
    z, total, going = np.zeros((len(theta), 6)), np.zeros(len(theta)), np.ones(len(theta), bool)
    for _ in range(steps):
        a = actions(layers, seen)
        z = np.clip(z + a / (T_I * RATE), -1.0, 1.0)
        seen, rewards, ended, _, infos = env.step(a + z)
        total += np.where(going, rewards, -1.0)  # an episode that has diverged is lost
        going &= ~ended
    return total / steps, going & infos["is_success"]


def make(n):
    """n environments on all cores."""
    return gymnasium.make_vec(
        "uvms_mj/PushWall-v0", n, control_rate=RATE, overrides=SHORT, randomise=WALLS, observe=observe, reward=reward
    )


def learn(seed=0, generations=300):
    """Learn. Yields the time [s], the mean return of a generation's policies, and the parameters (d,) after it."""
    dice, env, begun = np.random.default_rng(seed), make(2 * PAIRS), time.perf_counter()
    theta = first(dice)
    for k in range(generations):
        share = 1.0 - (1.0 - LEAST) * k / max(1, generations - 1)
        noise = NOISE * (0.5 + 0.5 * share)
        ways = dice.normal(size=(PAIRS, theta.size))
        walls = dice.integers(LEARNED, size=PAIRS).tolist()
        found = returns(env, np.concatenate([theta + noise * ways, theta - noise * ways]), walls * 2)
        plus, minus = found.reshape(2, PAIRS)  # both on the same wall, in the same current
        best = np.argsort(-np.maximum(plus, minus))[:BEST]
        spread = np.concatenate([plus[best], minus[best]]).std()
        theta = theta + STEP * share / (BEST * spread + 1e-9) * (plus - minus)[best] @ ways[best]
        yield time.perf_counter() - begun, float(found.mean()), theta
    env.close()


LAW = '''"""A policy that has learned to push, as a law: {about}

uvms-mj run --controller {name}:LearnedPush

Written by learn_push.py, which says what it has learned on.{result}

The network has 12 inputs, two hidden layers of 64 with tanh and 6 outputs, without offsets. Its weights are W_1
(64, 12), W_2 (64, 64) and W_3 (6, 64), 5248 numbers, at the end of this file.
"""

from dataclasses import dataclass

import numpy as np

from uvms_mj import Controller, setting
from uvms_mj.quantities import Positive, Step

SCALE = np.array([40.0, 40.0, 40.0, 10.0, 10.0, 10.0])  # wrench at 1 [N, N m]


@dataclass(frozen=True)
class LearnedPush(Controller):
    """Two hidden layers of 64 without offsets behind a PI filter; the weights are constants."""

    period: Step = setting({period}, "s", "control period; it has learned at {period} s")
    T_I: Positive = setting({T_I}, "s", "time constant of the integral; it has learned with {T_I} s")

    uses_task = False
    states = {{"z": 6}}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        off = signals.K_d * signals.eta_e - signals.K_f * (signals.tau_contact_m_B - signals.F_d)
        x = np.concatenate((np.arcsinh(off / 5.0), 10.0 * signals.nu_e))
        a = W_3 @ np.tanh(W_2 @ np.tanh(W_1 @ x))
        state.z[:] = np.clip(state.z + a * signals.period / gains.T_I, -1.0, 1.0)
        tau_cmd[:] = SCALE * np.clip(a + state.z, -1.0, 1.0)


# %%
# The weights of the three layers one after another, row by row.

WEIGHTS = """
{numbers}
"""
_LAYERS = np.split(np.array(WEIGHTS.split(), float), {places})
W_1, W_2, W_3 = (each.reshape(-1, n).T.copy() for each, n in zip(_LAYERS, {sizes}, strict=True))

if __name__ == "__main__":
    from uvms_mj import Scenario, simulate

    scenario = Scenario.load("push_wall", {{"wall.stiffness": 2e4, "current.speed": 0.3}})
    trace = simulate(scenario, controller=LearnedPush())
    print("shapes of the weights:", W_1.shape, W_2.shape, W_3.shape)
    print(f"push {{trace.push[-1]:.3f}} N in a current of 0.3 m/s")
    figure = trace.plot(["force", "position"], width=6.5)
'''


def export(theta, path, about, result=""):
    """Write the policy as the file of a law, with five digits of each number, and with its result in words."""
    words = [f"{x:.5g}" for x in theta]
    text = LAW.format(
        about=about,
        result=result,
        name=path.name,
        numbers="\n".join(" ".join(words[k : k + 10]) for k in range(0, len(words), 10)),
        places=np.cumsum([rows * columns for rows, columns in pairwise(SIZES)])[:-1].tolist(),
        sizes=SIZES[1:],
        period=1.0 / RATE,
        T_I=T_I,
    )
    path.write_text(text)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Learn to push, and write the policy as a law.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--generations", type=int, default=300)
    parser.add_argument("--out", type=Path, default=Path("learned_push.py"))
    parser.add_argument("--curve", type=Path, help="a CSV file for generation, time [s], mean return, success")
    given = parser.parse_args()
    rows = ["seed,generation,time_s,mean_return,success"]
    for k, (seconds, mean, theta) in enumerate(learn(given.seed, given.generations)):
        success = ""
        if k % 10 == 0 or k == given.generations - 1:
            success = f"{judged(theta, LOOKED):.3f}"
            print(
                f"generation {k}: mean return {mean:.3f}, success {success} on other walls, {seconds:.0f} s", flush=True
            )
            about = f"seed {given.seed}, {k + 1} generations."
            export(theta, given.out, about)
        rows.append(f"{given.seed},{k},{seconds:.2f},{mean:.5f},{success}")
        if given.curve:
            given.curve.write_text("\n".join(rows) + "\n")
    share = judged(theta, JUDGED)
    print(f"success on {len(JUDGED)} walls on which nothing was learned or chosen: {share:.3f}")
    others = f" Of {len(JUDGED)} episodes on which\nnothing was learned or chosen,"
    export(theta, given.out, about, f"{others} it ends {100.0 * share:.0f} % with success.")
