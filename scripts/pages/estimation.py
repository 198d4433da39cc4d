"""docs/physics/estimation.md: errors of the Kalman filter within 3 sigma, its NEES, and the observed contact force."""

import warnings
from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter, SymmetricalLogLocator
from scipy.stats import chi2

from page_look import written
from uvms_mj import Scenario, Simulation, Trace, simulate
from uvms_mj.control.theory.loop import ForceAge
from uvms_mj.setup.base import set_up
from uvms_mj.views.figures.style import BLACK, COLOURS, PAGE_IN, line, styled

BLUE, RED, PALE = COLOURS["x"], COLOURS["force"], "#dfe5ea"
SOFT = {"wall.stiffness": 2e3, "reference.target": [1.05, 0.0, 0.0]}
EKF = SOFT | {"navigation.name": "ekf"}
OBSERVER = {
    "observer.name": "momentum_observer",
    "observer.time_constant": 0.01,
    "observer.calibrate_from": 6.0,
    "observer.calibrate_until": 7.0,
    "reference.step_time": 7.0,
}
SEEDS = 50


CASES: dict[str, dict] = {
    "perfect | 2e3": SOFT,
    "observer, T = 10 ms | 2e3": OBSERVER | SOFT,
    "Kalman filter | 2e3": EKF,
    "Kalman filter and observer, T = 20 ms | 2e3": EKF | OBSERVER | {"observer.time_constant": 0.02},
    "Kalman filter and observer, T = 100 ms | 2e3": EKF | OBSERVER | {"observer.time_constant": 0.1},
    "Kalman filter | 1e5": {"navigation.name": "ekf"},
    "observer, T = 10 ms | 1e5": OBSERVER,
}
"""Rows of the table."""
HEAVY = (
    EKF
    | {"observer.name": "momentum_observer", "observer.time_constant": 0.02, "observer.threshold": 2.0}
    | {"vehicle.model": "bluerov2_heavy", "current.speed": 0.0, "thrusters.name": "t200", "controller.period": 0.01}
    | {"controller.k_1": 1.0, "controller.k_2": 1.0, "controller.beta": 2.0, "task.A": -20.0}
)


def run(settings: dict, rate: float = 1000.0) -> Trace:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the picture shows what they warn of
        return simulate(Scenario.load("push_wall", settings), engine="free_body", log_rate=rate)


def bounds(ax: Axes, t: np.ndarray, error: np.ndarray, sigma: np.ndarray, label: str) -> None:
    """An error of the filter and three of its standard deviations; linear within the last ones, logarithmic beyond."""
    ax.fill_between(t, -3.0 * sigma, 3.0 * sigma, color=PALE, lw=0, label=r"$\pm 3\sigma$")
    line(ax, t, error, label, color=BLUE, lw=0.8)
    ax.set_yscale("symlog", linthresh=6.0 * sigma[-1], linscale=2.0)
    ax.set(title=label, xlim=(0.0, t[-1]))
    ax.yaxis.set_major_locator(SymmetricalLogLocator(base=10.0, linthresh=6.0 * sigma[-1], subs=(1.0,)))
    ax.yaxis.set_major_formatter(ScalarFormatter())
    ax.legend(loc="upper right")


def nees(ax: Axes) -> None:
    times = np.arange(0.2, 12.01, 0.4)
    for factor, colour in ((1.0, BLUE), (0.8, RED), (1.25, BLACK)):
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
    ax.axhspan(*chi2.ppf([0.025, 0.975], 15 * SEEDS) / SEEDS, color=PALE, lw=0, label="95 % band")
    ax.set(title="mean NEES of 15 states, 50 runs", xlim=(0.0, 12.0), ylim=(0.0, 35.0))
    ax.legend(loc="upper right", ncols=2)


def force(ax: Axes, settings: dict, title: str) -> None:
    trace = run(OBSERVER | settings)
    line(ax, trace.t, trace.push, "true", color=BLACK, lw=1.2, label="true")
    line(ax, trace.t, -trace.f_contact_m_W[:, 0], "observed", color=RED, lw=0.8, label="observed")
    ax.set(title=title, xlim=(7.0, 15.0))
    ax.legend(loc="upper right")


def numbers() -> Iterator[tuple]:
    for row, settings in CASES.items():
        trace = run(settings)
        late = trace.push[trace.t > 15.0]
        many = trace.touches[-1] > 1.0
        touches = (trace.touches[-1], 0.2 * trace.touches[-1]) if many else trace.touches[-1]
        yield f"| {row} | {{}}, {{}} | {{}} |", (late.mean(), 0.03), (late.std(), 0.03 * late.std() + 5e-3), touches
        if row.startswith("perfect"):
            yield "force sensor: {} N for both", late.mean()
            yield "{} | 1 | closed form {} |", late.std(), trace.analytic.force
        elif row == "observer, T = 10 ms | 2e3":
            yield "up to {} N appear as a contact", -trace.f_contact_m_W[(trace.t > 7.0) & (trace.t < 10.0), 0].min()
    limits = [ForceAge.of(set_up(Scenario.load("push_wall", {"wall.stiffness": k}))).limit for k in (1e5, 2e3)]
    yield "{} ms at the default wall of 1e5 N/m and {} ms at 2e3 N/m", *(1e3 * limit for limit in limits)
    trace = run(HEAVY)
    late, found = trace.push[trace.t > 15.0], ForceAge.of(set_up(trace.scenario))
    yield (
        "pushes the wall of 2e3 N/m with {} N, deviation {} N, in {} touch",
        late.mean(),
        late.std(),
        trace.touches[-1],
    )
    yield "Its force is {} ms old", 1e3 * found.age
    yield "at {} ms all damping would be lost", 1e3 * found.limit
    yield "its command is {} ms late", 1e3 * found.chain.command_latency


def main() -> None:
    with styled():
        figure = Figure(figsize=(PAGE_IN, 6.0))
        axes = figure.subplots(3, 2)
        trace = run(EKF, 200.0)
        x, surge, bias = (
            (trace.p_WB_m - trace.p_WB)[:, 0],
            (trace.nu_m - trace.nu)[:, 0],
            trace["b_g"] - trace["b_g_true"],
        )
        bounds(axes[0, 0], trace.t, 1e3 * x, 1e3 * trace["sigma_p"][:, 0], "error of x [mm]")
        bounds(axes[0, 1], trace.t, 1e3 * surge, 1e3 * trace["sigma_v"][:, 0], "error of surge [mm/s]")
        bounds(
            axes[1, 0],
            trace.t,
            1e3 * bias[:, 0],
            1e3 * trace["sigma_b_g"][:, 0],
            "error of the roll gyro's bias [mrad/s]",
        )
        nees(axes[1, 1])
        force(axes[2, 0], SOFT, "push [N]: observer, T = 10 ms, wall of 2e3 N/m")
        force(axes[2, 1], {}, "push [N]: observer, T = 10 ms, wall of 1e5 N/m")
        for ax in axes[2]:
            ax.set_xlabel("time [s]")
        written(figure, "estimation", 64)
