"""docs/evidence/studies.md, from the folders of the shipped studies, mc of ``monte_carlo``, gm of ``gain_map`` and wv
of ``waves``: their figures and findings."""

import functools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from page_look import stacked
from uvms_mj.studies.plan import Plan
from uvms_mj.studies.report import figures
from uvms_mj.studies.report.data import StudyRows
from uvms_mj.studies.report.statistics import sensitivities
from uvms_mj.studies.results import frame


@functools.cache
def study(folder: Path) -> StudyRows:
    return StudyRows(Plan.load(folder / "study.toml"), frame(folder))


def rows(data: StudyRows, law: str) -> pd.DataFrame:
    """The rows of a law, with whether each succeeds."""
    table = data.frame.assign(succeeds=data.success)
    return table[table["law"] == law]


def percent(chosen: pd.Series) -> float:
    return float(100.0 * chosen.mean())


def bend(table: pd.DataFrame) -> float:
    """k_1^2 over k_2 at which the chattering index begins to grow with k_1: the median over the rows of the map without
    bouncing runs. There it leaves the value of the least k_1."""
    found = []
    for k_2, row in table.groupby("controller.k_2"):
        row = row.sort_values("controller.k_1")
        index, k_1 = row["chattering_N_per_s"].to_numpy(), row["controller.k_1"].to_numpy()
        if row["succeeds"].all():
            after = int(np.argmax(index > 1.5 * np.median(index[:5])))
            found.append(k_1[after - 1] * k_1[after] / k_2)
    return float(np.median(found))


def numbers(folder: str) -> Iterator[tuple]:
    draws, gains = study(Path(folder) / "mc"), study(Path(folder) / "gm")
    impedance, fosm, gsta = (rows(draws, law) for law in ("impedance", "fosm", "gsta"))
    yield "presses with the right force in {} % of the draws", percent(impedance["succeeds"])
    yield "in {} % it never reaches the wall", percent(impedance["contact.touches"] == 0)
    yield "First-order sliding mode succeeds in {} %", percent(fosm["succeeds"])
    quiet = fosm["chattering_N_per_s"] < 1.0
    yield "In {} % it is quiet, with at most {} N/s", percent(quiet), fosm["chattering_N_per_s"][quiet].max()
    yield "and then {} % succeed", percent(fosm["succeeds"][quiet])
    yield "in the others it chatters with {} N/s (median)", fosm["chattering_N_per_s"][~quiet].median()
    added = fosm["vehicle.added_mass"]
    yield "with less than {} times the model's it always chatters", added[quiet].min()
    yield "more than {} times never", added[~quiet].max()
    bounces = ~gsta["contact.settled"].astype(bool)
    yield "GSTA presses as demanded in {} %", (percent(gsta["succeeds"]), 0.2)
    yield "at some {} N/s", (gsta["chattering_N_per_s"].median(), 20.0)
    yield "{} of its runs still bounce after 20 s", int(bounces.sum())
    yield "all with an added mass above {} and", (gsta["vehicle.added_mass"][bounces].min(), 0.01)
    yield "walls above {} N/m", (gsta["wall.stiffness"][bounces].min(), 1e4)
    found = rows(gains, "gsta")
    yield "$k_1^2$ = {} $k_2$: left of it", (bend(found), 0.15)
    corner = (found["controller.k_1"] + found["controller.k_2"]).idxmax()
    yield "falls to the {} N of the desired impedance", found["contact.peak_N"][corner]
    yield "still bounces after 20 s, up to {} times", (found["contact.touches"].max(), 3.0)
    yield from of_waves(study(Path(folder) / "wv"))


def of_waves(data: StudyRows) -> Iterator[tuple]:
    impedance, sta, admittance, gsta = (rows(data, law) for law in ("impedance", "sta", "admittance", "gsta"))
    yield "impedance control holds {} of the", int(impedance["succeeds"].sum())
    yield "of the {} sea states, up to", len(impedance)
    yield "sea states, up to a height of {} m; then the waves", highest_held(impedance)
    yield "Super-twisting holds {}, admittance", int(sta["succeeds"].sum())
    yield "admittance control {} and GSTA", int(admittance["succeeds"].sum())
    yield "and GSTA {}. GSTA holds", int(gsta["succeeds"].sum())
    yield "GSTA holds every sea up to {} m at each period", highest_held(gsta)
    limited = gsta.groupby("succeeds")["saturated_s"].median()
    yield "GSTA is at a limit for {} s of the 60 s", limited[False]
    yield "and for {} s where it holds", limited[True]


def highest_held(table: pd.DataFrame) -> float:
    """The greatest height [m] up to which every height succeeds at each period."""
    held = table.groupby("sea.height")["succeeds"].all()
    return float(held.index[held.to_numpy().cumprod().astype(bool)].max())


def main(folder: str) -> None:
    draws, gains, waves = (study(Path(folder) / name) for name in ("mc", "gm", "wv"))
    below = figures.distributions(draws)
    assert below is not None
    stacked([figures.overview(draws, figures.success_rates(draws)), below], "monte_carlo")
    found = sensitivities(gains)
    (pair,) = figures.pairs(found)
    stacked([figures.maps(gains, pair, figures.shown(found, pair, True))], "gain_map")
    found = sensitivities(waves)
    (pair,) = figures.pairs(found)
    stacked([figures.maps(waves, pair, figures.shown(found, pair, True)[:2])], "waves")
