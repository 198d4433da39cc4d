"""docs/physics/sensors.md: a noisy, late force against the truth, spectra of the noise, and the push's deviation."""

import functools
import warnings
from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import welch

from page_look import written
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.setup.base import set_up
from uvms_mj.setup.linear_loop import Deviations, deviations
from uvms_mj.views.figures.style import BLACK, COLOURS, PAGE_IN, styled

INK, BLUE, RED = BLACK, COLOURS["x"], COLOURS["force"]
PUSHING = {  # as in tests/setup/test_noise.py
    "navigation.name": "sensors",
    "simulation.timestep": 2e-3,
    "simulation.duration": 800.0,
    "wall.stiffness": 2e3,
    "wall.damping": 150.0,
    "reference.target": [1.4, 0.0, 0.0],
    "initial.position": [1.02, 0.0, 0.0],
    "current.speed": 0.1,
    "impedance.M_d": [10.0, 20.0, 20.0, 0.3, 0.3, 0.3],
}
LEVELS = {  # of the noise, from the least to the greatest
    "force": ("N", np.array([0.5, 1.0, 2.0, 5.0, 10.0]), BLUE),
    "position": ("mm", np.array([0.5, 1.0, 2.0, 5.0, 10.0]) * 1e-3, RED),
    "velocity": ("mm/s", np.array([0.5, 1.0, 2.0, 5.0, 10.0]) * 1e-3, INK),
}


def run(settings: dict, law: str = "impedance", rate: float | str = 100.0) -> Trace:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return simulate(Scenario.load("push_wall", settings, law), engine="free_body", log_rate=rate)


def force(ax: Axes) -> None:
    sensor = {"period": 0.02, "delay": 0.05, "noise": 0.5, "quantum": 0.1}
    settings = {f"navigation.force_{name}": value for name, value in sensor.items()}
    more = {"initial.position": [0.98, 0.0, 0.0], "simulation.duration": 4.0, "simulation.timestep": 1e-3}
    trace = run(PUSHING | settings | more, rate="full")
    ax.plot(
        trace.t,
        -trace.f_contact_m_W[:, 0],
        color=RED,
        lw=0.8,
        label="measured: 50 Hz, 50 ms late,\n0.5 N, steps of 0.1 N",
    )
    ax.plot(trace.t, trace.push, color=INK, lw=1.2, label="truth")
    ax.set(xlabel="time [s]", title="pushing force [N]", xlim=(1.3, 2.1), ylim=(-2.0, 52.0))
    ax.legend(loc="upper left")


def spectra(ax: Axes) -> None:
    h, T, sigma, walk = 1e-3, 0.02, 0.01, 0.005
    noise = {"navigation.velocity_noise": sigma, "navigation.velocity_period": T, "navigation.position_walk": walk}
    away = {"wall.position": 50.0, "initial.position": [0.0] * 3, "reference.target": [0.0] * 3}
    trace = run(PUSHING | away | noise | {"simulation.timestep": h, "simulation.duration": 400.0}, rate="full")
    held = (
        (trace.nu_m - trace.nu)[:, :3]
        + trace.nu[:, :3]
        - trace.nu[:: round(T / h), :3].repeat(20, axis=0)[: len(trace)]
    )
    f, power = welch(held, fs=1.0 / h, nperseg=2**14, axis=0)
    ax.loglog(f[1:], power[1:].mean(axis=1), color=BLUE, lw=0.5, label="white noise, held for 20 ms")
    ax.loglog(
        f[1:], 2.0 * sigma**2 * T * np.sinc(f[1:] * T) ** 2, color=INK, lw=1.0, label=r"$2\sigma^2 T\,$sinc$^2(f T)$"
    )
    f, power = welch(trace.p_WB_m - trace.p_WB, fs=1.0 / h, nperseg=2**16, axis=0, detrend="linear")
    inside = (f > 0.05) & (f < 200.0)
    ax.loglog(f[inside], power[inside].mean(axis=1), color=RED, lw=0.5, label="random walk")
    ax.loglog(
        f[inside],
        2.0 * walk**2 / (2.0 * np.pi * f[inside]) ** 2,
        color=INK,
        lw=1.0,
        ls="--",
        label=r"$2\rho^2/(2\pi f)^2$",
    )
    ax.set(xlabel="frequency [Hz]", title="one-sided density [SI/Hz]", xlim=(0.05, 200.0), ylim=(1e-13, 3e-3))
    ax.legend(loc="lower left")


@functools.cache
def compared(quantity: str, level: float) -> tuple[float, float]:
    """Deviation of the push in closed form and in a run of 800 s [N], with the noise of a quantity."""
    settings = PUSHING | {f"navigation.{quantity}_noise": level}
    found = deviations(set_up(Scenario.load("push_wall", settings, "impedance")))
    assert isinstance(found, Deviations), found
    trace = run(settings)
    return found.push, float(trace.push[trace.t > 20.0].std())


def numbers() -> Iterator[tuple]:
    pairs = np.array([compared(quantity, float(levels[-1])) for quantity, (_, levels, _) in LEVELS.items()])
    yield "the push's deviation differs by at most {} %", 100.0 * np.abs(pairs[:, 1] / pairs[:, 0] - 1.0).max()


def push(ax: Axes) -> None:
    for quantity, (unit, levels, colour) in LEVELS.items():
        predicted, measured = np.array([compared(quantity, float(level)) for level in levels]).T
        scale = {"N": 1.0, "mm": 1e-3, "mm/s": 1e-3}[unit]
        ax.loglog(levels / scale, predicted, color=colour, label=f"{quantity} [{unit}]")
        ax.loglog(levels / scale, measured, "o", color=colour, ms=4)
    ax.set(xlabel="deviation of a sample", title="deviation of the push [N]")
    ax.legend(loc="upper left", title="closed form, runs as dots")


def main() -> None:
    with styled():
        figure = Figure(figsize=(PAGE_IN, 3.0))
        for ax, draw in zip(figure.subplots(1, 3), (force, spectra, push), strict=True):
            draw(ax)
        written(figure, "sensors", 64)
