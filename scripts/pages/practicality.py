"""docs/evidence/practicality.md, from the folder of `uvms-mj practicality --out FOLDER`: its maps and its claims."""

import functools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from page_look import written
from uvms_mj.reproduce.claims import judged
from uvms_mj.reproduce.practicality import page
from uvms_mj.reproduce.practicality.results import AXES, CLAIMS, MAPS, RETUNED, Results, plans
from uvms_mj.studies.results import frame


@functools.cache
def results(folder: str | Path) -> Results:
    planned = plans({})
    return Results(planned, {name: frame(Path(folder) / name) for name in planned})


def ratios(found: Results) -> list[float]:
    """Delays up to which GSTA works over the limit of the force's age, by stiffness: the map's second row."""
    name = "force_delay_and_stiffness"
    x, y = MAPS[name]
    table = found.frames[name].assign(works=found.works(name))
    limits = {stiffness: delay for delay, stiffness in found.limits(name, "gsta")}
    out = []
    for stiffness, limit in limits.items():
        rows = table[(table["law"] == "gsta") & (table[y.key] == stiffness)].sort_values(x.key)
        works, delays = rows["works"].to_numpy(), rows[x.key].to_numpy(float)
        if works[0] and not works.all():
            first = int(np.argmin(works))
            out.append(float(np.sqrt(delays[first - 1] * delays[first])) / limit)
    return out


def last(found: Results, name: str, law: str = "gsta") -> float:
    """The last value of an axis at which a law works."""
    value = found.boundaries[name, law].last
    assert value is not None
    return value


def numbers(folder: str) -> Iterator[tuple]:
    found = results(folder)
    claims = {row.claim.id: row.measured.value or 0.0 for row in judged(CLAIMS, found)}
    yield "There are {} runs of 8 s", sum(len(table) for table in found.frames.values())
    yield "does not press with the demanded force | {} N: the current", claims["impedance"]
    yield "| GSTA presses with the demanded force | {} % wrong |", claims["gsta_ideal"]
    yield "is wrong by a few per cent | {} % |", claims["fosm_ideal"]
    for name, words in (
        ("control_period", "| to {} ms; predicted {} ms. Boundary over prediction: {} |"),
        ("force_delay", "the delay of the force sensor | to {} ms; predicted {} ms. {} |"),
    ):
        yield words, 1e3 * last(found, name), 1e3 * (found.predicted(AXES[name], "gsta") or 0.0), claims[name]
    shares = ratios(found)
    yield "median {} of the prediction, from {} to {}", claims["stiffness"], min(shares), max(shares)
    yield "to {} ms, {} times the delay", 1e3 * last(found, "thruster_lag"), claims["lag"]
    yield "| period {} times as long |", claims["rate"]
    yield "the noise of a force sensor | to {} N |", claims["noise"]
    harmless = [claims[name] for name in ("voltage", "dead_band", "friction", "added_mass")]
    yield "at their real values | {} to {} % wrong |", min(harmless), max(harmless)
    retuned, gsta = (last(found, "added_mass", law) for law in (RETUNED, "gsta"))
    yield "to {} times the model's, the paper's gains to {} times: factor {}", retuned, gsta, claims["retuned_model"]
    yield "100 Hz alone stops GSTA | the push varies by {} N |", found.step("gsta", False, 1)["force_range_N"]
    held, stopped = found.step(RETUNED, True, 1), found.step(RETUNED, True, 1 + int(claims["pool"]))
    yield "| {} N wrong, varies by {} N |", abs(held["force_error_N"]), held["force_range_N"]
    yield (
        "works for {} steps; it stops at the sensors of a small ROV, where the worst of eight runs presses with {} N",
        claims["pool"],
        stopped["contact.final_N"],
    )

    high, retuned = found.along(AXES["wave_height"], "fosm"), found.along(AXES["wave_height"], RETUNED)
    on_water = [found.along(AXES[name], "gsta") for name in ("near_wall", "wave_height", "wave_period")]
    yield "and varies by at most {} N, first-order", max(rows["force_range_N"].max() for rows in on_water)
    yield "in waves of up to {} m; at", last(found, "wave_height", "fosm")
    yield "it presses with {} N too little", -high["force_error_N"].iloc[-1]
    yield "it works up to waves of {} m and", last(found, "wave_height", RETUNED)
    yield "vibrates by {} N at 0.2 m", (retuned["force_range_N"][retuned["sea.height"] == 0.2].iloc[0], 1.0)
    yield "and up to a hull of {} m at the wall", last(found, "near_wall", RETUNED)


def main(folder: str) -> None:
    written(page.maps(results(folder)), "practicality")
