"""docs/physics/sampling.md: where a sampled law holds at the wall, and how much a late command makes it vibrate."""

import functools
import warnings
from collections.abc import Iterator
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from page_look import written
from uvms_mj import Gsta, Scenario, Trace, simulate
from uvms_mj.control.base import SteadyState
from uvms_mj.control.theory.stability import ForceAge, Stability
from uvms_mj.setup.base import Setup, set_up
from uvms_mj.views.figures.style import BLACK, COLOURS, PAGE_IN, styled

QUIET_N = 0.05
"""Largest peak-to-peak force of a run that holds [N]."""
PAPER = {"current.speed": 0.0, "simulation.duration": 20.0}
RETUNED = {"controller.k_1": 1.0, "controller.k_2": 1.0, "controller.beta": 2.0, "task.A": -20.0, "wall.stiffness": 2e3}
RATE = {"controller.period": 0.01, "simulation.timestep": 1e-3}
Case = tuple[str, dict[str, float], tuple[float, ...], str]
"""Label, settings, delays of the command [s] and colour."""
HOLDS, FAILS = COLOURS["x"], COLOURS["force"]
PAPERS_GAINS: Case = ("paper's gains, 10 kHz, 1e5 N/m", {}, (1e-3, 2e-3, 4e-3, 6e-3, 8e-3, 1e-2), COLOURS["x"])
RETUNED_GAINS: Case = ("retuned, 100 Hz, 2e3 N/m", RETUNED | RATE, (5e-3, 1e-2, 2e-2, 3e-2, 4e-2), COLOURS["z"])


@functools.cache
def run(name: str, engine: str = "free_body", **overrides: Any) -> Trace:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        settings = {key.replace("__", "."): value for key, value in overrides.items()}
        return simulate(Scenario.load(name, settings), log_rate=1000, engine=engine)


def last(trace: Trace, seconds: float) -> np.ndarray:
    """The push in the last seconds of a run [N]."""
    return trace.push[trace.t > trace.t[-1] - seconds]


@functools.cache
def late_commands(case: int) -> tuple[list[float], list[float], list[float]]:
    """Ages of the command [s], measured vibrations [N] and vibrations in theory [N]: the force is of the instant."""
    _, overrides, delays, _ = (PAPERS_GAINS, RETUNED_GAINS)[case]
    ages, found, predicted = [], [], []
    for delay in delays:
        force, setup = measured(overrides | {"controller.delay": delay})
        ages.append(ForceAge.of(setup).chain.command_latency)
        found.append(force)
        predicted.append(Stability(setup, layer=0.0).at_wall[0])
    return ages, found, predicted


def measured(overrides: dict[str, Any]) -> tuple[float, Setup]:
    """Peak-to-peak force in the last 0.5 s of a run [N], and its setup."""
    scenario = Scenario.load("push_wall", PAPER | overrides)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        trace = simulate(scenario, log_rate=100, engine="free_body")
    found = float(trace.final_high[-1] - trace.final_low[-1]) if trace.final_low[-1] > 0.0 else np.inf  # no contact
    return found, set_up(scenario)


def numbers() -> Iterator[tuple]:
    paper, soft = (ForceAge.of(set_up(Scenario.load("push_wall", {"wall.stiffness": k}))) for k in (1e5, 2e3))
    yield "At 1e5 N/m, whose limit is {} ms", 1e3 * paper.limit
    (_, found, predicted), (_, others, theirs) = late_commands(0), late_commands(1)
    yield "4 ms late leaves a vibration of {} N peak to peak", found[PAPERS_GAINS[2].index(4e-3)]
    shares = np.array([*predicted, *theirs]) / [*found, *others]
    yield "This describing function gives {} to {} of the measured force", (shares.min(), 0.03), (shares.max(), 0.03)
    runs = [run("push_soft_wall_100hz", engine) for engine in ("free_body", "mujoco")]
    runs.append(run("push_soft_wall_100hz", simulation__timestep=1e-4))
    forces = [float(trace.final_impulse[-1]) / 0.5 for trace in runs]
    retuned = ForceAge.of(set_up(runs[0].scenario))
    yield (
        "(`push_soft_wall_100hz`) | {} ms, {} ms | {} N to {} N; closed form 1.5 N/1.075 = {} N |",
        1e3 * retuned.age,
        1e3 * soft.limit,
        (min(forces), 1e-5),
        (max(forces), 1e-5),
        runs[0].analytic.force,
    )
    yield "super-twisting chatters at 100 Hz in a band of {} N", np.ptp(last(runs[0], 0.5))
    late = [last(run("push_soft_wall_100hz", controller__delay=delay), 5.0) for delay in (0.01, 0.04)]
    yield "vibrates by {} N, by {} N", np.ptp(late[0]), (np.ptp(late[1]), 0.02)
    fine = run("push_soft_wall_100hz", simulation__timestep=1e-4, controller__delay=0.04)
    yield (
        "the vibration with 40 ms differs by {} % with the time step",
        100.0 * abs(np.ptp(last(fine, 5.0)) / np.ptp(late[1]) - 1.0),
    )
    bounces = run("push_wall", simulation__duration=30.0, **{k.replace(".", "__"): v for k, v in RATE.items()})
    age = ForceAge.of(set_up(bounces.scenario))
    yield (
        "| {} ms, {} ms | bounces, {} contacts in 30 s; it takes a wall of less than {} N/m |",
        1e3 * age.age,
        1e3 * age.limit,
        (bounces.touches[-1], 5.0),
        age.limit * 1e5 / age.age,
    )
    assert isinstance(runs[0].analytic, SteadyState)
    assert isinstance(runs[0].scenario.controller, Gsta)
    yield "{} ms for the paper's $A = -100$ and {} ms for $-20$", 2e3 / 100.0, 2e3 / 20.0


def old_forces(axes: Axes) -> None:
    """The force sensor is late, at walls of several stiffnesses. All else is of the instant."""
    for stiffness in (2e3, 5e3, 1e4, 3e4, 1e5, 2e5):
        limit = ForceAge.of(set_up(Scenario.load("push_wall", {"wall.stiffness": stiffness}))).limit
        for factor in (0.4, 0.65, 0.9, 1.1, 1.5, 2.5):
            h = 1e-4 if limit < 0.02 else 1e-3
            late = {"navigation.name": "sensors", "navigation.force_delay": round(factor * limit / h) * h}
            late["simulation.timestep"] = h
            found, setup = measured({"wall.stiffness": stiffness, "simulation.duration": 40.0, **late})
            holds = found < QUIET_N
            style: dict[str, Any] = {"marker": "o", "color": HOLDS} if holds else {"marker": "x", "color": FAILS}
            axes.plot(1e3 * ForceAge.of(setup).age, stiffness, linestyle="none", markersize=4.5, **style)
    ages = np.geomspace(1e-4, 0.08, 50)
    D_d = set_up(Scenario()).design.D_d[0, 0]
    axes.fill_between(1e3 * ages, 1e3, D_d / ages, color=HOLDS, alpha=0.12, linewidth=0.0)
    axes.plot(1e3 * ages, D_d / ages, color=BLACK, label=r"limit $D_d/(K_f\,T)$")
    axes.plot([], [], "o", color=HOLDS, label="run holds")
    axes.plot([], [], "x", color=FAILS, label="run vibrates or bounces")
    axes.set(xscale="log", yscale="log", xlim=(0.1, 80), ylim=(1e3, 1e6))
    axes.set(xlabel="mean age $T$ of the contact force [ms]", ylabel="stiffness of the wall $k_c$ [N/m]")
    axes.set_title("An old force: GSTA with the paper's gains")
    axes.legend(loc="lower left")


def late(axes: Axes) -> None:
    """The command is late."""
    for case, (label, _, _, colour) in enumerate((PAPERS_GAINS, RETUNED_GAINS)):
        ages, found, predicted = late_commands(case)
        axes.plot(1e3 * np.array(ages), found, "o", color=colour, markersize=4.5, label=f"run: {label}")
        axes.plot(1e3 * np.array(ages), predicted, color=colour, label="describing function")
    axes.set(xscale="log", yscale="log", xlabel="mean age of the command [ms]", ylabel="peak-to-peak force at rest [N]")
    axes.set(ylim=(1e-4, 3.0), xlim=(0.8, 60.0))
    axes.set_title("A late command")
    axes.legend(loc="lower right")


def main() -> None:
    with styled():
        figure, (left, right) = plt.subplots(1, 2, figsize=(PAGE_IN, 3.2))
        old_forces(left)
        late(right)
        written(figure, "sampling", 64)
