"""A policy learns on the development draws of Contact-10: augmented random search, as in examples/learn_push.py.

python scripts/learning_bench.py FOLDER             learns three seeds, judges them on blind draws, and writes
                                                    docs/evidence/learning/bench.csv and bench_curves.csv
python scripts/learning_bench.py FOLDER --seed 0    learns one of them: FOLDER/bench_0.py
uvms-mj bench FOLDER/bench_0.py:Learned --draws seed:20261129 --out FOLDER/blind_0

It learns on the nine tasks of a rigid vehicle, at levels 1 to 3, on the development draws 0 to 19, in episodes of 8 s.
Draw 20 is for the learning curve alone: nothing is chosen on it. The policy is a law whose weights are a setting, so
that an episode is a run at native speed with another setting. The last policy of a seed is the seed's result.
"""

import itertools
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd

from uvms_mj import Diverged, Scenario, Simulation
from uvms_mj.reproduce.bench import bench
from uvms_mj.reproduce.bench.task import Entry, tasks

ROOT = Path(__file__).parents[1]
DATA = ROOT / "docs/evidence/learning"
SEEDS, BLIND = range(3), 20261129
SIZES = (13, 32, 6)
COUNT = sum(rows * columns for rows, columns in itertools.pairwise(SIZES))
LEVELS, LEARNED, LOOKED = (1, 2, 3), range(20), range(20, 21)
PAIRS, BEST = 16, 8
STEP, NOISE, LEAST = 0.02, 0.04, 0.1  # of the first generation; the step shrinks to LEAST times in SCHEDULE generations
SCHEDULE = 100
EPISODE_S, CHUNK_S, HOLD_S = 8.0, 0.05, 3.0
LAW = '''"""A policy that has learned to push on draws of Contact-10: seed {seed}, {generations} generations.

uvms-mj bench {name}:Learned --draws seed:NUMBER

Written by scripts/learning_bench.py, which says what it has learned on.
"""

from dataclasses import dataclass

import numpy as np

from uvms_mj import Controller, setting
from uvms_mj.quantities import Positive

WEIGHTS = """
{numbers}
"""  # of the two layers one after another, row by row
SCALE = np.array([40.0, 40.0, 40.0, 10.0, 10.0, 10.0])  # wrench at 1 [N, N m]


@dataclass(frozen=True)
class Learned(Controller):
    """A hidden layer of 32 without offsets behind a PI filter. It is zero where the push is the demanded one, the pose
    beside the push is the reference's, and the vehicle rests: so its rest has the demanded push on any wall."""

    theta: tuple[float, ...] = setting(tuple(map(float, WEIGHTS.split())), "", "weights of the two layers")
    T_I: Positive = setting(0.5, "s", "time constant of the integral")

    uses_task = False
    states = {{"z": 6}}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        F, off = signals.F_d[:3], signals.eta_e[:3]
        P = np.sqrt(np.sum(F * F))
        n = F / P
        e = np.sum(n * (signals.tau_contact_m_B[:3] - F)) / P  # -1 without contact
        beside = off - n * np.sum(n * off)
        turned, moving = 10.0 * signals.eta_e[3:], 10.0 * signals.nu_e
        x = np.concatenate((np.array([np.arcsinh(5.0 * e)]), 30.0 * beside, turned, moving))
        W_1, W_2 = gains.theta[:416].reshape(13, 32), gains.theta[416:].reshape(32, 6)
        a = np.tanh(x @ W_1) @ W_2
        state.z[:] = np.clip(state.z + a * signals.period / gains.T_I, -1.0, 1.0)
        tau_cmd[:] = SCALE * np.clip(a + state.z, -1.0, 1.0)
'''


@dataclass(frozen=True)
class Ground:
    """A draw of a level of a task: the scenario with the law, and the demanded push [N]."""

    scenario: Scenario
    push: float


def grounds(law: Path, draws: range) -> dict[tuple[str, int, int], Ground]:
    """The development draws of some numbers by task, level and number."""
    found, entry = {}, Entry("learned", f"{law}:Learned")
    for (name, task), level in itertools.product(tasks().items(), LEVELS):
        plan = entry.plan(task, level)
        if plan.engine != "free_body":  # the arm's
            continue
        for draw in draws:
            scenario = plan.scenario(draw).updated({"simulation.duration": EPISODE_S})
            found[name, level, draw] = Ground(scenario, float(np.linalg.norm(scenario.impedance.F_d[:3])))
    return found


def value(ground: Ground, theta: np.ndarray) -> float:
    """The return of a policy in a run: at most 0, where the push is the demanded one from the start. Its parts are the
    relative error of the push, of the whole run and of its last 3 s, its range in the last half second, the pose beside
    the push, and the time at thrusters' limits."""
    scenario = ground.scenario.updated({"controller.theta": theta.tolist()})
    each = max(1, round(CHUNK_S / scenario.simulation.timestep))
    chunks, hold = scenario.steps // each, round(HOLD_S / CHUNK_S)
    impulse, off = np.zeros(chunks + 1), np.zeros((chunks, 6))
    with Simulation(scenario, engine="free_body", looks=False) as sim:
        try:
            for k in range(chunks):
                sim.step(each)
                impulse[k + 1], off[k] = sim.signals.impulse, sim.signals.eta_e
        except Diverged:
            return -4.0
        spread = sim.signals.final_high - sim.signals.final_low
        limits = sim.signals.saturation_time
    error = np.minimum(np.abs(np.diff(impulse) / CHUNK_S / ground.push - 1.0), 2.0)
    beside = np.minimum(np.abs(off[:, 1:]).sum(axis=1), 1.0)
    parts = 0.3 * error.mean() + error[-hold:].mean() + 0.3 * min(spread / ground.push, 2.0)
    return float(-parts - beside.mean() - 0.2 * min(limits, 5.0) / 5.0)


def written(path: Path, theta: np.ndarray, seed: int, generations: int) -> None:
    """Write a policy as a law, with five digits of each number."""
    words = [f"{x:.5g}" for x in theta]
    lines = "\n".join(" ".join(words[k : k + 10]) for k in range(0, len(words), 10))
    path.write_text(LAW.format(seed=seed, generations=generations, name=path.name, numbers=lines))


def learn(path: Path, seed: int, generations: int) -> Iterator[tuple[float, float, float, np.ndarray]]:
    """Learn, and write the last policy. Yields of each generation the time [s], the mean return of its policies, and,
    of every tenth one, the share of the policy after it on draws that it does not learn on, otherwise NaN; and its
    parameters (d,)."""
    dice, begun = np.random.default_rng(seed), time.process_time()
    layers = [dice.normal(size=shape) / np.sqrt(shape[0]) for shape in itertools.pairwise(SIZES)]
    layers[-1][:] = 0.0
    theta = np.concatenate([W.ravel() for W in layers])
    written(path, theta, seed, 0)
    learned, looked = grounds(path, LEARNED), grounds(path, LOOKED)
    names = list(learned)
    for k in range(generations):
        share = 1.0 - (1.0 - LEAST) * min(1.0, k / (SCHEDULE - 1))
        noise = NOISE * (0.5 + 0.5 * share)
        ways = dice.normal(size=(PAIRS, theta.size))
        chosen = [learned[names[i]] for i in dice.choice(len(names), PAIRS, replace=False)]
        both = [[theta + sign * noise * way for way in ways] for sign in (1.0, -1.0)]
        found = np.array([[value(*each) for each in zip(chosen, thetas, strict=True)] for thetas in both])
        best = np.argsort(-found.max(axis=0))[:BEST]
        spread = found[:, best].std()
        theta = theta + STEP * share / (BEST * spread + 1e-9) * (found[0] - found[1])[best] @ ways[best]
        seen = np.nan
        if k % 10 == 9 or k == generations - 1:
            seen = float(np.mean([value(ground, theta) for ground in looked.values()]))
            written(path, theta, seed, k + 1)
        yield time.process_time() - begun, float(found.mean()), seen, theta


def judged(folder: Path, name: str, law: str, workers: int | None) -> dict[str, Any]:
    """The levels that a law holds on blind draws, by task; None where it can't run."""
    found = bench([law], folder / f"blind_{name}", draws=f"seed:{BLIND}", workers=workers)
    ladders = found["laws"][0]["tasks"]
    return {"policy": name} | {task: each["level"] if each["runs"] else None for task, each in ladders.items()}


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--seed", type=int, help="Learn this one alone, and judge nothing.")
@click.option("--generations", type=int, default=SCHEDULE)
@click.option("--workers", type=int, help="Processes of the benchmark; default: one a core.")
def main(folder: Path, seed: int | None, generations: int, workers: int | None) -> None:
    """Learn, judge on blind draws, and write the data of the page. What is learned is not learned again."""
    warnings.simplefilter("ignore")
    folder.mkdir(parents=True, exist_ok=True)
    for each in SEEDS if seed is None else [seed]:
        law, curve, rows = folder / f"bench_{each}.py", folder / f"bench_curve_{each}.csv", []
        for k, (seconds, mean, seen, _) in enumerate(() if curve.exists() else learn(law, each, generations)):
            rows.append((each, k, round(seconds, 2), mean, seen))
            if np.isfinite(seen):
                click.echo(f"generation {k}: return {mean:.3f}, on other draws {seen:.3f}, {seconds:.0f} s")
        if rows:
            names = ["seed", "generation", "cpu_s", "mean_return", "held_out_return"]
            pd.DataFrame(rows, columns=names).to_csv(curve, index=False, float_format="%.5g")
    if seed is None:
        curves = pd.concat([pd.read_csv(folder / f"bench_curve_{each}.csv") for each in SEEDS])
        curves.to_csv(DATA / "bench_curves.csv", index=False)
        laws = {"walls": f"{ROOT / 'examples/learned_push.py'}:LearnedPush"}
        laws |= {f"seed {each}": f"{folder / f'bench_{each}.py'}:Learned" for each in SEEDS}
        levels = [judged(folder, name, law, workers) for name, law in laws.items()]
        pd.DataFrame(levels).to_csv(DATA / "bench.csv", index=False)


if __name__ == "__main__":
    main()
