"""docs/evidence/learning.md, from the data in docs/evidence/learning, which ``scripts/learning_runs.py`` writes: five
learning curves, and the runs of the policies beside GSTA and PD."""

import functools
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from page_look import written
from uvms_mj.views.figures.style import BLACK, COLOURS, PAGE_IN, styled

DATA = Path(__file__).parents[2] / "docs/evidence/learning"
LEARNED = {"stiffness_N_per_m": 1e5, "current_m_per_s": 0.5}
"""The largest values that an episode drew."""
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
    return found.assign(known=functools.reduce(np.logical_and, within))


def percent(rows: pd.DataFrame) -> float:
    return float(100.0 * rows["success"].mean())


def of(family: str, law: str) -> pd.DataFrame:
    """The runs of a law; of "policies", of all five."""
    rows = runs()[runs()["family"] == family]
    return rows[rows["law"].str.startswith("policy") if law == "policies" else rows["law"] == law]


def shares(family: str) -> list[float]:
    """Least and largest share of the five policies within what they have learned on [%]."""
    rows = of(family, "policies")
    found = sorted(percent(mine) for _, mine in rows[rows["known"]].groupby("law"))
    return [found[0], found[-1]]


def numbers() -> Iterator[tuple]:
    last = curves().groupby("seed").last()
    first = curves().groupby("seed").first()
    yield "rises from {} (mean of the seeds)", float(first["mean_return"].mean())
    yield "to {} to {} at the end", *(float(each) for each in (last["mean_return"].min(), last["mean_return"].max()))
    yield "took {} to {} minutes", *(float(each) / 60.0 for each in (last["time_s"].min(), last["time_s"].max()))
    known = {law: of("as it learned", law).query("known") for law in ("gsta", "PD", CHOSEN)}
    stiff = {law: of("as it learned", law).query("stiffness_N_per_m > 1e5") for law in known}
    fast = {
        law: of("as it learned", law).query("stiffness_N_per_m <= 2.5e4 and current_m_per_s > 0.5") for law in known
    }
    groups = (("walls and currents as learned on", known), ("stiffer, 1e5 to 1e6 N/m", stiff))
    for what, rows in (*groups, ("faster, 0.5 to 0.8 m/s, to 2.5e4 N/m", fast)):
        yield f"| {what} | {{}} % | {{}} % | {{}} % |", *(percent(rows[law]) for law in known)
    for what, family in (("7.5 N demanded", "another force"), ("all laws at 100 Hz", "all laws at 100 Hz")):
        rows = {law: of(family, law).query("known") for law in known}
        yield f"| {what} | {{}} % | {{}} % | {{}} % |", *(percent(rows[law]) for law in known)
    yield "The five seeds hold it in {} to {} %", *shares("as it learned")
    peaks = (float(known[law]["peak_N"].median()) for law in ("gsta", CHOSEN))
    yield "GSTA presses with up to {} N (median), the policy with {} N", *peaks
    held = known[CHOSEN][known[CHOSEN]["success"]]
    failed = known[CHOSEN][~known[CHOSEN]["success"]]
    yield "its mean error is {} % (median)", 100.0 * float(held["mean_error"].median())
    yield "GSTA's {} %", 100.0 * float(known["gsta"]["mean_error"].median())
    yield "The softest wall on which it fails has {} N/m", float(failed["stiffness_N_per_m"].min())
    yield "touches it {} times (median)", float(failed["touches"].median())


def main() -> None:
    with styled():
        figure, (left, right) = plt.subplots(1, 2, figsize=(PAGE_IN, 2.6), layout="constrained")
        for _, mine in curves().groupby("seed"):
            smooth = mine["mean_return"].rolling(10, min_periods=1).mean()
            left.plot(mine["time_s"] / 60.0, smooth, color=COLOURS["x"], lw=0.9, alpha=0.8)
        left.set(xlabel="time on two cores [min]", ylabel="mean return of a generation")
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
        right.set(xlabel="stiffness of the wall [N/m]", ylabel="within a tenth [% of runs]", ylim=(-3.0, 103.0))
        right.set_title("force held in the last second")
        right.legend(loc="center left")
        written(figure, "learning")
