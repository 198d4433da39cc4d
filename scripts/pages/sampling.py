"""Draw docs/sampling.png: where a sampled law holds at the wall, and how much a late command makes it vibrate.

python scripts/pages/sampling.py
"""

import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from uvms_mj import Scenario, simulate
from uvms_mj.analysis.setup import set_up
from uvms_mj.control.late_command import swing
from uvms_mj.control.sampled import Vibration

TARGET = Path(__file__).parents[2] / "docs" / "sampling.png"
QUIET_N = 0.05
"""Largest peak-to-peak force of a run that holds [N]."""
PAPER = {"current.speed": 0.0, "simulation.duration": 20.0}
RETUNED = {"controller.k_1": 1.0, "controller.k_2": 1.0, "controller.beta": 2.0, "task.A": -20.0, "wall.stiffness": 2e3}
RATE = {"controller.period": 0.01, "simulation.timestep": 1e-3}


def measured(overrides):
    """Peak-to-peak force in the last 0.5 s [N], and the vibration in theory, of a run."""
    scenario = Scenario.load("push_wall", PAPER | overrides)
    trace = simulate(scenario, log_rate=100, engine="free_body")
    found = float(trace.final_high[-1] - trace.final_low[-1]) if trace.final_low[-1] > 0.0 else np.inf  # no contact
    return found, Vibration.of(set_up(scenario)), scenario.controller


def held_forces(axes):
    """The force sensor is late, at walls of several stiffnesses. All else is of the instant."""
    for stiffness in (2e3, 5e3, 1e4, 3e4, 1e5, 2e5):
        limit = Vibration.of(set_up(Scenario.load("push_wall", {"wall.stiffness": stiffness}))).limit
        for factor in (0.4, 0.65, 0.9, 1.1, 1.5, 2.5):
            h = 1e-4 if limit < 0.02 else 1e-3
            late = {"navigation.name": "sensors", "navigation.force_delay": round(factor * limit / h) * h}
            late["simulation.timestep"] = h
            found, vibration, _ = measured({"wall.stiffness": stiffness, "simulation.duration": 40.0, **late})
            holds = found < QUIET_N
            style = {"marker": "o", "color": "tab:blue"} if holds else {"marker": "x", "color": "tab:red"}
            axes.plot(1e3 * vibration.age, stiffness, linestyle="none", **style)
    ages = np.geomspace(1e-4, 0.08, 50)
    D_d = set_up(Scenario()).design.D_d[0, 0]
    axes.fill_between(1e3 * ages, 1e3, D_d / ages, color="tab:blue", alpha=0.12)
    axes.plot(1e3 * ages, D_d / ages, color="black", label=r"limit $D_d/(K_f\,T)$")
    axes.plot([], [], "o", color="tab:blue", label="measured: holds")
    axes.plot([], [], "x", color="tab:red", label="measured: limit cycle or bouncing")
    axes.set(xscale="log", yscale="log", xlim=(0.1, 80), ylim=(1e3, 1e6))
    axes.set(xlabel="mean age T of the contact force [ms]", ylabel="stiffness of the wall k_c [N/m]")
    axes.set_title("An old force: GSTA with the paper's gains")
    axes.legend(loc="lower left", fontsize=8)


def late_commands(axes):
    """The force is of the instant, and the command is late."""
    cases = [
        ("paper's gains, 10 kHz, 1e5 N/m", {}, (1e-3, 2e-3, 4e-3, 6e-3, 8e-3, 1e-2), "tab:blue"),
        ("retuned, 100 Hz, 2e3 N/m", RETUNED | RATE, (5e-3, 1e-2, 2e-2, 3e-2, 4e-2), "tab:orange"),
    ]
    for label, overrides, delays, colour in cases:
        found = [measured(overrides | {"controller.delay": delay}) for delay in delays]
        ages = [1e3 * vibration.chain.command_age for _, vibration, _ in found]
        predicted = [swing(vibration, law.slopes)[0] for _, vibration, law in found]
        axes.plot(ages, [force for force, *_ in found], "o", color=colour, label=f"measured: {label}")
        axes.plot(ages, predicted, color=colour, label="describing function")
    axes.set(xscale="log", yscale="log", xlabel="mean age of the command [ms]", ylabel="peak-to-peak force at rest [N]")
    axes.set_title("A late command")
    axes.legend(fontsize=8)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 4.4), layout="constrained")
    held_forces(left)
    late_commands(right)
    for each in (left, right):
        each.grid(alpha=0.3, which="both", linewidth=0.4)
    figure.savefig(TARGET, dpi=90)
