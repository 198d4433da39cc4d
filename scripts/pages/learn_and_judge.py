"""docs/how_to/learn_and_judge.md: three seeds of examples/ppo.py, from the data that ``scripts/ppo_runs.py`` writes."""

import functools
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.stats import binomtest

from page_look import written
from uvms_mj.views.figures.style import COLOURS, PAGE_IN, styled

DATA = Path(__file__).parents[2] / "docs/evidence/learning"
LOOKS = (("x", "-", "o"), ("y", "--", "s"), ("z", "-.", "^"))
"""Colour, line and mark of each seed."""
LARGE = ("font.size", "axes.labelsize", "xtick.labelsize", "ytick.labelsize", "legend.fontsize")
"""Sizes of text that a narrow screen needs larger."""


@functools.cache
def curves() -> pd.DataFrame:
    """Of each seed the control steps, the CPU time [s] and the share of successes in the episodes of the curve."""
    return pd.read_csv(DATA / "ppo_curves.csv")


@functools.cache
def seeds() -> pd.DataFrame:
    """Of each seed how many of the judged episodes its last policy holds, and how many episodes a curve has."""
    return pd.read_csv(DATA / "ppo.csv", index_col="seed")


def interval(held: int, episodes: int) -> np.ndarray:
    """Share of successes, and its 95 % interval (Wilson's) [%]: (3,)."""
    return 100.0 * np.array([held / episodes, *binomtest(held, episodes).proportion_ci(0.95, "wilson")])


def numbers() -> Iterator[tuple]:
    for seed, row in seeds().iterrows():
        mine = curves().query("seed == @seed")
        never = mine["steps"][mine["success"].cumsum() == 0].max()
        seconds = mine["cpu_s"].iloc[-1]
        share = interval(row["held"], row["judged"])
        yield f"| {seed} | {{}} % | {{}} to {{}} % | {{}} million | {{}} s |", *share, never / 1e6, seconds
    failed = seeds()["judged"] - seeds()["held"]
    yield f"Seed {failed.idxmax()} is the worst: it fails in {{}} of the {{}}", failed.max(), seeds()["judged"].max()
    yield "{} blind episodes", float(seeds()["judged"].unique().item())
    yield "after {} million control steps", float(curves().groupby("seed")["steps"].max().unique().item()) / 1e6
    yield "the {} episodes of `LOOKED`", float(seeds()["looked"].unique().item())


def main() -> None:
    with styled(), plt.rc_context(dict.fromkeys(LARGE, 10.0)):
        figure, ax = plt.subplots(figsize=(PAGE_IN, 3.4), layout="constrained")
        for (seed, row), (colour, line, mark) in zip(seeds().iterrows(), LOOKS, strict=True):
            mine, episodes = curves().query("seed == @seed"), int(row["looked"])
            bands = np.array([interval(round(share * episodes), episodes) for share in mine["success"]])
            x = mine["steps"] / 1e6
            ax.fill_between(x, bands[:, 1], bands[:, 2], color=COLOURS[colour], alpha=0.13, lw=0.0)
            ax.plot(x, bands[:, 0], line, marker=mark, ms=4.5, color=COLOURS[colour], lw=1.6, label=f"seed {seed}")
        ax.set(xlabel="control steps [million]", ylabel="episodes with success [%]")
        ax.set(xlim=(0.0, 1.4), ylim=(-3.0, 103.0))
        ax.legend(loc="upper left")
        written(figure, "ppo", colours=256)
