"""Measure fleets on a GPU: bits, speed over the number of runs, a law from a file, and a million pushes.

    python scripts/gpu.py --out gpu                  all of it, about ten minutes
    python scripts/gpu.py --out gpu --only speed     one part: bits, speed, law, million

Each part writes NAME.json into the folder, and `million` the figure tail.png. `--device cpu` runs the same code on this
machine's processor, for a look without a GPU; give fewer --runs then.
"""

import contextlib
import importlib
import json
import os
import re
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import click
import numpy as np

from uvms_mj import Scenario, Simulation
from uvms_mj.engine.fleet import Fleet, Starts
from uvms_mj.stages.loader import load_file
from uvms_mj.studies.plan import Plan

SIGNALS = ("p_WB", "quat_WB", "nu", "tau_cmd", "tau", "force_peak", "touches", "impulse", "effort", "first_contact")
MINE = """
from uvms_mj import Gsta


class Mine(Gsta):
    name = "mine"

    @staticmethod
    def step(gains, state, signals, state_dot, tau_cmd):
        Gsta.step(gains, state, signals, state_dot, tau_cmd)
"""
KINDS: dict[str, dict[str, Any]] = {
    "gsta": {},
    "fosm": {"controller.name": "fosm"},
    "admittance": {"controller.name": "admittance", "controller.period": 5e-3},
    "real": {
        "vehicle.model": "bluerov2_heavy",
        "controller.name": "dob_impedance",
        "controller.period": 5e-3,
        "thrusters.name": "t200",
        "navigation.name": "rov",
    },
}
"""Scenarios whose runs are compared: ideal ones, and one with thrusters, sensors and a filter."""


def drawn(rng: np.random.Generator) -> dict[str, Any]:
    """Numbers of a run that a fleet can vary."""
    weight = float(rng.uniform(0.8, 1.2))
    return {
        "current.speed": float(rng.uniform(0.0, 0.5)),
        "current.direction_deg": float(rng.uniform(-180.0, 180.0)),
        "vehicle.mass": weight,
        "vehicle.displaced_mass": weight,
        "vehicle.added_mass": float(rng.uniform(0.5, 1.5)),
        "vehicle.quadratic_damping": float(rng.uniform(0.5, 2.0)),
        "wall.stiffness": float(10.0 ** rng.uniform(4.3, 5.7)),
        "initial.position": [float(rng.uniform(0.80, 0.97)), 0.0, 0.0],
        "simulation.seed": int(rng.integers(1 << 40)),
    }


def words_of(law: dict[str, Any], seeds: range) -> np.ndarray:
    """The starts of some runs of a kind, in a process of their own."""
    base = Scenario.load("push_wall", law)
    starts = Starts(base)
    return np.array([starts.of(base.updated(drawn(np.random.default_rng([7, seed])))) for seed in seeds])


def many_words(law: dict[str, Any], n: int, pool: ProcessPoolExecutor) -> np.ndarray:
    parts = [range(start, min(start + 250, n)) for start in range(0, n, 250)]
    return np.concatenate(list(pool.map(words_of, [law] * len(parts), parts)))


def bits(device: str, runs: int, pool: ProcessPoolExecutor) -> dict[str, Any]:
    """Runs on the device against the same code on this processor, and against free_body."""
    found: dict[str, Any] = {}
    for kind, law in KINDS.items():
        base = Scenario.load("push_wall", law)
        words = many_words(law, runs // len(KINDS), pool)
        n, steps = len(words), (1000, 20_000, 60_000)
        answers = []
        for each in (device, "cpu"):
            fleet = Fleet.of(Starts(base), n, signals=SIGNALS, device=each)
            fleet.start(words)
            rows, begun = [], time.perf_counter()
            for before, step in zip((0, *steps), steps, strict=False):
                fleet.step(step - before)
                rows.append(fleet.table())
            answers.append((rows, time.perf_counter() - begun, fleet.compile_s))
            fleet.close()
        pairs = [(a.view(np.int64), b.view(np.int64)) for a, b in zip(answers[0][0], answers[1][0], strict=True)]
        same = [np.array_equal(a, b) for a, b in pairs]
        differ = (pairs[-1][0] != pairs[-1][1]).any(axis=0).sum()
        touched = float((answers[0][0][-1][_row("touches")] > 0.0).mean())
        some = against_free_body(base, answers[0][0], steps, min(n, 200))
        found[kind] = {
            "runs": n, "steps": steps, "touched": touched, "bits_equal": same, "runs_that_differ": int(differ),
            "device_s": answers[0][1], "cpu_s": answers[1][1], "compile_s": answers[0][2], "free_body": some,
        }  # fmt: skip
        print(kind, json.dumps(found[kind]), flush=True)
    return found


def against_free_body(base: Scenario, tables: list[np.ndarray], steps: tuple[int, ...], n: int) -> dict[str, float]:
    """The largest differences of p_WB and of the peak force from the engine free_body, before the first contact of a
    run and after it."""
    worst = {"before_p": 0.0, "after_p": 0.0, "after_peak": 0.0, "touches_differ": 0.0}
    for i in range(n):
        scenario = base.updated(drawn(np.random.default_rng([7, i])))
        with Simulation(scenario, engine="free_body", looks=False) as sim:
            for before, step, table in zip((0, *steps), steps, tables, strict=False):
                sim.step(step - before)
                p = float(np.abs(np.array(sim.signals.p_WB) - table[:3, i]).max())
                peak, touches = float(sim.signals.force_peak), float(sim.signals.touches)
                if touches == 0.0 == table[_row("touches"), i]:
                    worst["before_p"] = max(worst["before_p"], p)
                    continue
                worst["after_p"] = max(worst["after_p"], p)
                if touches != table[_row("touches"), i]:
                    worst["touches_differ"] += 1.0 / (n * len(steps))
                    continue
                error = abs(peak - table[_row("force_peak"), i]) / max(1.0, peak)
                worst["after_peak"] = max(worst["after_peak"], error)
    return worst


def _row(name: str) -> int:
    sizes = dict.fromkeys(SIGNALS, 1) | {"p_WB": 3, "quat_WB": 4, "nu": 6, "tau_cmd": 6, "tau": 6, "effort": 6}
    return sum(sizes[each] for each in SIGNALS[: SIGNALS.index(name)])


def flops(code: bytes) -> dict[str, int]:
    """Operations of float64 in a kernel's text, each counted once."""
    text = code.decode()
    body = text[text.index(".entry uvms_mj_fleet_steps") :]
    body = body[: body.index("\n}")]
    names = ("add", "sub", "mul", "fma", "div", "sqrt")
    return {name: len(re.findall(rf"\b{name}[\w.]*\.f64", body)) for name in names}


def speed(device: str, runs: int, pool: ProcessPoolExecutor) -> dict[str, Any]:
    """Steps a second over the number of runs, of runs that differ, in free motion and with the wall."""
    base = Scenario.load("push_wall")
    words = many_words({}, min(runs, 20_000), pool)
    found: dict[str, Any] = {"runs": []}
    for n in (1000, 3000, 10_000, 30_000, 67_584, 135_168, 300_000, 1_000_000):
        if n > runs:
            break
        fleet = Fleet.of(Starts(base), n, signals=("force_peak", "touches", "f_contact_W"), device=device)
        begun = time.perf_counter()
        fleet.start(np.resize(words, (n, words.shape[1])))
        fleet.step(200)
        row = {"n": n, "start_s": time.perf_counter() - begun - fleet.compile_s, "compile_s": fleet.compile_s}
        for name, steps in (("free", 2000), ("touching", 20_000), ("pressing", 20_000)):
            begun = time.perf_counter()
            fleet.step(steps)
            row[name] = n * steps / (time.perf_counter() - begun)
        row["touched"] = float((np.asarray(fleet.signals["touches"]) > 0).mean())
        row["simulated_s_per_s"] = row["pressing"] * base.simulation.timestep
        if device == "gpu":
            found["about"], found["flops"] = fleet.describe(), flops(fleet.code)
        found["runs"].append(row)
        print(json.dumps(row), flush=True)
        fleet.close()
    begun = time.perf_counter()
    with Simulation(base, engine="free_body", looks=False) as sim:
        sim.run(1000, np.inf)
        begun = time.perf_counter()
        sim.run(100_000, np.inf)
        found["free_body_one_core"] = 100_000 / (time.perf_counter() - begun)
    return found


def law(device: str, runs: int, pool: ProcessPoolExecutor) -> dict[str, Any]:
    """A law from a user's file against the shipped one that computes the same, interleaved."""
    n, found = min(runs, 135_168), dict[str, Any](n=0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "mine.py")
        path.write_text(MINE)
        mine = load_file(path, "").Mine
        fleets = []
        for controller in (None, mine()):
            scenario = Scenario.load("push_wall", {"initial.position": [0.9, 0.0, 0.0]})
            scenario = scenario if controller is None else Scenario(**(vars(scenario) | {"controller": controller}))
            fleet = Fleet(scenario, n, signals=("force_peak",), device=device)
            fleet.step(2000)
            fleets.append(fleet)
        times: list[list[float]] = [[], []]
        for _ in range(5):
            for k, fleet in enumerate(fleets):
                begun = time.perf_counter()
                fleet.step(5000)
                times[k].append(time.perf_counter() - begun)
        shipped, own = (np.asarray(fleet.signals["force_peak"]) for fleet in fleets)
        found = {
            "n": n, "shipped_s": float(np.median(times[0])), "users_s": float(np.median(times[1])),
            "ratio": float(np.median(times[1]) / np.median(times[0])), "same_bits": bool(np.array_equal(shipped, own)),
            "compile_s": [fleet.compile_s for fleet in fleets],
        }  # fmt: skip
    print(json.dumps(found), flush=True)
    return found


def draws_of(first: int, last: int, runs: int) -> np.ndarray:
    """The starts of some draws of the shipped study monte_carlo with GSTA, in a process of their own."""
    plan = _plan(runs)
    starts = Starts(plan.scenario(2))
    words = np.array([starts.of(plan.scenario(3 * draw + 2)) for draw in range(first, last)])
    columns = np.flatnonzero((words != starts.template).any(axis=0))
    return columns, words[:, columns]  # type: ignore[return-value]


_plans: dict[int, Plan] = {}
QUANTILES = (0.5, 0.9, 0.99, 0.999, 0.9999, 0.99999)


def _plan(runs: int) -> Plan:
    if runs not in _plans:
        _plans[runs] = Plan.load("monte_carlo", {"design.runs": runs})
    return _plans[runs]


def million(device: str, runs: int, pool: ProcessPoolExecutor) -> dict[str, Any]:
    """The shipped study monte_carlo with GSTA and so many draws, 20 s each: the tail of the peak force."""
    begun = time.perf_counter()
    plan = _plan(runs)
    plan_s = time.perf_counter() - begun
    starts, begun = Starts(plan.scenario(2)), time.perf_counter()
    fleet = Fleet.of(starts, runs, signals=("force_peak", "touches"), device=device)
    edges = [*range(0, runs, 2000), runs]
    parts = list(pool.map(draws_of, edges[:-1], edges[1:], [runs] * (len(edges) - 1)))
    columns = sorted({int(c) for own, _ in parts for c in own})
    small = np.tile(starts.template[columns], (runs, 1))
    place, at = {c: k for k, c in enumerate(columns)}, 0
    for own, values in parts:
        small[at : at + len(values), [place[int(c)] for c in own]] = values
        at += len(values)
    prepare_s = time.perf_counter() - begun
    begun = time.perf_counter()
    fleet.start_columns(columns, small)
    fleet.step(1)
    load_s = time.perf_counter() - begun
    steps = plan.base.steps
    with energy_of(device) as energy:
        begun = time.perf_counter()
        fleet.step(steps - 1, lambda done: None)
        fleet.finish()
        run_s = time.perf_counter() - begun
    peak, touches = fleet.table()
    stopped = fleet.stopped
    tail = np.sort(peak[~stopped])[::-1]
    found = {
        "runs": runs, "steps": runs * steps, "plan_s": plan_s, "prepare_s": prepare_s, "load_s": load_s, "run_s": run_s,
        "compile_s": fleet.compile_s, "steps_per_s": runs * steps / run_s, "energy_J": energy.get("J"),
        "stopped": int(stopped.sum()), "processes": os.cpu_count(), "about": fleet.describe(),
        "untouched": int((touches == 0.0).sum()), "worst_N": tail[:10].tolist(),
        "quantiles_N": {f"{q:g}": float(np.quantile(peak[~stopped], q)) for q in QUANTILES},
    }  # fmt: skip
    print(json.dumps(found), flush=True)
    np.savez_compressed(OUT / "peaks.npz", peak=tail[: min(len(tail), 20_000)].astype(np.float32), runs=len(tail))
    figure(tail, OUT / "tail.png")
    return found


@contextlib.contextmanager
def energy_of(device: str) -> Any:
    """Energy of the GPU in a context [J], if its driver tells it."""
    found: dict[str, float] = {}
    try:
        pynvml: Any = importlib.import_module("pynvml")
        pynvml.nvmlInit()
        handle = pynvml.nvmlDeviceGetHandleByIndex(0)
        before = pynvml.nvmlDeviceGetTotalEnergyConsumption(handle)
    except Exception as error:  # any: without it there is no number
        print(f"no energy: {error}", file=sys.stderr)
        yield found
        return
    yield found
    if device == "gpu":
        found["J"] = (pynvml.nvmlDeviceGetTotalEnergyConsumption(handle) - before) / 1e3


def figure(tail: np.ndarray, path: Path) -> None:
    """The share of runs whose peak force is larger, with the interval that holds it with 95 % confidence (Clopper and
    Pearson)."""
    import matplotlib as mpl
    from scipy.stats import beta

    mpl.use("agg")
    import matplotlib.pyplot as plt

    n = len(tail)
    ranks = np.unique(np.round(np.geomspace(1, n, 400)).astype(int))
    share = ranks / n
    low, high = beta.ppf(0.025, ranks, n - ranks + 1), beta.ppf(0.975, ranks + 1, np.maximum(n - ranks, 1e-9))
    with plt.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        drawn, axes = plt.subplots(figsize=(6.3, 3.4), layout="constrained")
        axes.fill_between(tail[ranks - 1], low, high, alpha=0.25, color="C0", lw=0, label="95 % confidence")
        axes.step(tail[ranks - 1], share, color="C0", where="post", label=f"{n:,} runs".replace(",", " "))
        axes.set(yscale="log", ylim=(0.3 / n, 1.3))
        axes.set(xlabel="largest push of a run [N]", ylabel="share of runs with a larger one")
        axes.grid(alpha=0.25)
        axes.legend(frameon=False)
        drawn.savefig(path, dpi=180)


PARTS = {"bits": bits, "speed": speed, "law": law, "million": million}
OUT = Path()


@click.command(help=__doc__)
@click.option("--out", type=click.Path(path_type=Path), default=Path("gpu"))
@click.option("--only", type=click.Choice(list(PARTS)), multiple=True)
@click.option("--device", type=click.Choice(["gpu", "cpu"]), default="gpu")
@click.option("--runs", type=int, default=0, help="Of bits, of the largest fleet, and of the million.")
def main(out: Path, only: tuple[str, ...], device: str, runs: int) -> None:
    global OUT
    OUT = out
    out.mkdir(parents=True, exist_ok=True)
    usual = {"bits": 10_000, "speed": 1_000_000, "law": 135_168, "million": 1_000_000}
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for name in only or PARTS:
            begun = time.perf_counter()
            found = PARTS[name](device, runs or usual[name], pool)
            found["wall_s"] = time.perf_counter() - begun
            (out / f"{name}.json").write_text(json.dumps(found, indent=1))
            print(f"{name}: {found['wall_s']:.1f} s", flush=True)


if __name__ == "__main__":
    main()
