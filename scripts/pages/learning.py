"""docs/evidence/learning.md, from the data in docs/evidence/learning, which ``scripts/learning_runs.py`` writes: five
learning curves, and the runs of the policies beside GSTA and PD."""

import functools
import sys
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from page_look import written
from uvms_mj.views.figures.style import BLACK, COLOURS, PAGE_IN, styled

DATA = Path(__file__).parents[2] / "docs/evidence/learning"
EXAMPLES = Path(__file__).parents[2] / "examples"
LEARNED = {"stiffness_N_per_m": 1e5, "current_m_per_s": 0.5}
"""The largest values that an episode drew."""
FAMILIES = {
    "another force": "as learned on, 7.5 N demanded",
    "all laws at 100 Hz": "as learned on, all laws at 100 Hz",
}
CHOSEN = "policy 0"
"""The policy of examples/learned_push.py."""
BANDS = np.geomspace(2e3, 1e6, 9)


@functools.cache
def curves() -> pd.DataFrame:
    return pd.read_csv(DATA / "curves.csv")


@functools.cache
def runs() -> pd.DataFrame:
    found = pd.read_csv(DATA / "runs.csv")
    within = (found[key] <= most for key, most in LEARNED.items())
    force_d = found["final_N"] - found["error_N"]
    relative = (found["error_N"] / force_d).abs()
    success = (found["status"] == "completed") & (relative <= 0.1) & (found["range_N"] <= 0.2 * force_d)
    return found.assign(known=functools.reduce(np.logical_and, within), relative=relative, success=success)


def percent(rows: pd.DataFrame) -> float:
    return float(100.0 * rows["success"].mean())


def of(family: str, law: str) -> pd.DataFrame:
    """The runs of a law; of "policies", of all five."""
    rows = runs()[runs()["family"] == family]
    return rows[rows["law"].str.startswith("policy") if law == "policies" else rows["law"] == law]


def limits(family: str, law: str) -> tuple[float, float]:
    """Stiffness of the softest wall on which a law fails, and of the stiffest one on which it holds [N/m]."""
    rows = of(family, law)
    rows = rows[rows["current_m_per_s"] <= LEARNED["current_m_per_s"]]
    stiffness = rows["stiffness_N_per_m"]
    return float(stiffness[~rows["success"]].min()), float(stiffness[rows["success"]].max())


@functools.cache
def levels() -> pd.DataFrame:
    """The levels on Contact-10 by policy and task; NaN where a policy can't run."""
    return pd.read_csv(DATA / "bench.csv", index_col="policy")


@functools.cache
def bench_curves() -> pd.DataFrame:
    return pd.read_csv(DATA / "bench_curves.csv")


def success_of_the_shipped() -> float:
    """Share of the episodes of learn_push.JUDGED that the policy of examples/learned_push.py ends with success."""
    sys.path.insert(0, str(EXAMPLES))
    try:
        import learn_push
        import learned_push
    finally:
        sys.path.remove(str(EXAMPLES))
    return learn_push.judged(np.array(learned_push.WEIGHTS.split(), float), learn_push.JUDGED)


def numbers() -> Iterator[tuple]:
    seeds = levels().filter(like="seed", axis=0)
    rows = {"walls": levels().loc["walls"], "Contact-10, mean of three seeds": seeds.mean()}
    for what, row in (rows | {"least": seeds.min(), "greatest": seeds.max()}).items():
        yield f"| {what} |" + " {} |" * len(row), *(float(each) for each in row)
    looked = bench_curves().dropna().groupby("seed")
    first, last = (getattr(looked, each)() for each in ("first", "last"))
    seconds = last["cpu_s"]
    rise = float(first["held_out_return"].mean()), float(last["held_out_return"].mean())
    yield (
        "on other draws rises from {} to {} in {} to {} s of one core",
        *rise,
        float(seconds.min()),
        float(seconds.max()),
    )
    yield "it ends {} % with", (100.0 * success_of_the_shipped(), 1.0)
    first, last = (getattr(curves().groupby("seed"), each)() for each in ("first", "last"))
    yield "rises from {} (mean of five seeds)", float(first["mean_return"].mean())
    yield "to between {} and {},", *(float(each) for each in (last["mean_return"].min(), last["mean_return"].max()))
    yield "in {} to {} s on two cores", *(float(each) for each in (last["time_s"].min(), last["time_s"].max()))
    laws = ("gsta", "PD", CHOSEN)
    seen = {law: of("as it learned", law) for law in laws}
    chosen = {
        "as learned on": "known",
        "stiffer, 1e5 to 1e6 N/m": "stiffness_N_per_m > 1e5",
        "faster, 0.5 to 0.8 m/s, to 2.5e4 N/m": "stiffness_N_per_m <= 2.5e4 and current_m_per_s > 0.5",
    }
    for what, query in chosen.items():
        rates = (percent(rows.query(query)) for rows in seen.values())
        yield f"| {what} | {{}} % | {{}} % | {{}} % |", *rates
    for family, what in FAMILIES.items():
        rates = (percent(of(family, law).query("known")) for law in laws)
        yield f"| {what} | {{}} % | {{}} % | {{}} % |", *rates
    known = of("as it learned", "policies").query("known")
    others = sorted(percent(rows) for law, rows in known.groupby("law") if law != CHOSEN)
    yield "the other four seeds hold it in {} to {} %", others[0], others[-1]
    peaks = (float(rows.query("known")["peak_N"].median()) for rows in (seen["gsta"], seen[CHOSEN]))
    yield "The largest force is {} N with GSTA (median), {} N with the policy", *peaks
    held = seen[CHOSEN].query("known and success")["relative"]
    yield "is {} % (median) and at most {} %", 100.0 * float(held.median()), 100.0 * float(held.max())
    fails, holds = limits("as it learned", CHOSEN)
    yield "holds up to {}e4 N/m and fails from {}e4 N/m on", holds / 1e4, fails / 1e4
    fails, holds = limits("all laws at 100 Hz", "gsta")
    yield "GSTA at 100 Hz holds up to {}e4 N/m", holds / 1e4
    failed = seen[CHOSEN].query("known and not success")
    yield "it touches the wall {} times (median)", float(failed["touches"].median())
    yield "swings by {} N", float(failed["range_N"].median())
    yield "PD misses the force by {} % (median)", 100.0 * float(seen["PD"].query("known")["relative"].median())


def main() -> None:
    with styled():
        figure, (left, right) = plt.subplots(1, 2, figsize=(PAGE_IN, 2.6), layout="constrained")
        for _, mine in curves().groupby("seed"):
            smooth = mine["mean_return"].rolling(10, min_periods=1).mean()
            left.plot(mine["time_s"], smooth, color=COLOURS["x"], lw=0.9, alpha=0.8)
        left.set(xlabel="time on two cores [s]", ylabel="mean return of a generation")
        left.set_title("learning curves of five seeds")
        middle = np.sqrt(BANDS[:-1] * BANDS[1:])
        rows = runs()[(runs()["family"] == "as it learned") & (runs()["current_m_per_s"] <= LEARNED["current_m_per_s"])]
        looks = {"gsta": (BLACK, 1.8, "GSTA"), "PD": (COLOURS["z"], 1.8, "PD")}
        for law, mine in rows.groupby("law"):
            bands = np.digitize(mine["stiffness_N_per_m"], BANDS[1:-1])
            share = [100.0 * mine["success"][bands == k].mean() for k in range(len(middle))]
            colour, width, label = looks.get(law, (COLOURS["x"], 0.9, "policies" if law == CHOSEN else ""))
            right.semilogx(middle, share, "o-", ms=2.5, color=colour, lw=width, label=label or None)
        right.axvspan(LEARNED["stiffness_N_per_m"], BANDS[-1], color="0.93", zorder=0)
        right.text(3.2e5, 50.0, "never seen", ha="center", color="0.4")
        right.set(xlabel="stiffness of the wall [N/m]", ylabel="share of runs [%]", ylim=(-3.0, 103.0))
        right.set_title("runs that hold the demanded force")
        right.legend(loc="center left")
        written(figure, "learning")
        figure, ax = plt.subplots(figsize=(PAGE_IN, 2.4), layout="constrained")
        for seed, mine in bench_curves().groupby("seed"):
            smooth, looked = mine["mean_return"].rolling(5, min_periods=1).mean(), mine.dropna()
            names = ("policies of a generation", "other draws") if seed == 0 else (None, None)
            ax.plot(mine["generation"], smooth, color=COLOURS["x"], lw=0.9, label=names[0])
            ax.plot(looked["generation"], looked["held_out_return"], "o", ms=3.0, color=BLACK, label=names[1])
        ax.set(xlabel="generation", ylabel="return", title="learning on Contact-10, three seeds")
        ax.legend(loc="lower right")
        written(figure, "learning_bench")
