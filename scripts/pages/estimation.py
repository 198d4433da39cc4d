"""Draw docs/estimation.png: errors of the Kalman filter within 3 sigma, its NEES, and the observed contact force.

python scripts/pages/estimation.py
"""

import warnings
from pathlib import Path

import click
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image
from scipy.stats import chi2

from uvms_mj import Scenario, Simulation, Trace, simulate

PICTURE = Path(__file__).parents[2] / "docs" / "estimation.png"
INK, BLUE, RED, GREY = "#1f2933", "#0b5cad", "#d02a1e", "#b8c2cc"
SOFT = {"wall.stiffness": 2e3, "reference.target": [1.05, 0.0, 0.0]}
EKF = SOFT | {"navigation.name": "ekf"}
OBSERVER = {
    "observer.name": "momentum_observer",
    "observer.time_constant": 0.01,
    "observer.calibrate_from": 6.0,
    "observer.calibrate_until": 7.0,
    "reference.step_time": 7.0,
    "simulation.duration": 15.0,
}
SEEDS = 50


def run(settings: dict) -> Trace:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the picture shows what they warn of
        return simulate(Scenario.load("push_wall", settings), engine="free_body", log_rate=200.0)


def bounds(ax: Axes, t: np.ndarray, error: np.ndarray, sigma: np.ndarray, label: str) -> None:
    ax.fill_between(t, -3.0 * sigma, 3.0 * sigma, color=GREY, alpha=0.5, lw=0, label=r"$\pm 3\sigma$")
    ax.plot(t, error, color=BLUE, lw=0.8)
    ax.set(ylabel=label, ylim=1.6 * np.array([-3.0, 3.0]) * np.quantile(sigma, 0.9), xlim=(0.0, t[-1]))
    ax.legend(loc="upper right", frameon=False)


def nees(ax: Axes) -> None:
    times = np.arange(0.2, 12.01, 0.4)
    for factor, colour in ((1.0, BLUE), (0.7, RED), (1.4, INK)):
        found = np.zeros((SEEDS, len(times)))
        with Simulation(
            Scenario.load("push_wall", EKF | {"navigation.assumed_noise": factor}), engine="free_body"
        ) as sim:
            for seed in range(SEEDS):
                sim.reset(seed=seed)
                for k, t in enumerate(times):
                    sim.step(round(t / 1e-4) + 1 - sim.steps)
                    found[seed, k] = sim.signals["nees"][0]
        ax.plot(times, found.mean(axis=0), color=colour, lw=1.0, label=f"assumed noise x {factor:g}")
    ax.axhspan(*chi2.ppf([0.025, 0.975], 15 * SEEDS) / SEEDS, color=GREY, alpha=0.6, lw=0, label="95 % band")
    ax.set(ylabel="mean NEES of 15 states", xlim=(0.0, 12.0), ylim=(0.0, 45.0))
    ax.legend(loc="upper right", frameon=False, ncols=2)


def force(ax: Axes, settings: dict, title: str) -> None:
    trace = run(OBSERVER | settings)
    ax.plot(trace.t, trace.push, color=INK, lw=1.2, label="true")
    ax.plot(trace.t, -trace.f_contact_m_W[:, 0], color=RED, lw=0.8, label="observed")
    ax.set(title=title, ylabel="push [N]", xlim=(7.0, 15.0))
    ax.legend(loc="upper right", frameon=False)


@click.command()
def main() -> None:
    """Draw docs/estimation.png."""
    figure = Figure(figsize=(11.0, 9.0), layout="constrained")
    axes = figure.subplots(3, 2)
    trace = run(EKF)
    bounds(
        axes[0, 0], trace.t, 1e3 * (trace.p_WB_m - trace.p_WB)[:, 0], 1e3 * trace["sigma_p"][:, 0], "error of x [mm]"
    )
    v = trace.nu_m - trace.nu
    bounds(axes[0, 1], trace.t, 1e3 * v[:, 0], 1e3 * trace["sigma_v"][:, 0], "error of surge [mm/s]")
    b = 1e3 * (trace["b_g"] - trace["b_g_true"])
    bounds(axes[1, 0], trace.t, b[:, 0], 1e3 * trace["sigma_b_g"][:, 0], "error of the roll gyro's bias [mrad/s]")
    nees(axes[1, 1])
    force(axes[2, 0], SOFT, "observer, T = 10 ms, wall of 2e3 N/m")
    force(axes[2, 1], {}, "observer, T = 10 ms, wall of 1e5 N/m")
    for ax in axes.ravel():
        ax.set_xlabel("t [s]")
        ax.grid(color="#eceff2", lw=0.6)
        ax.set_axisbelow(True)
    figure.savefig(PICTURE, dpi=80)
    with Image.open(PICTURE) as picture:
        few = picture.convert("P", palette=Image.Palette.ADAPTIVE, colors=48)
    few.save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
