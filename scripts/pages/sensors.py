"""Draw docs/sensors.png: a noisy, late force against the truth, spectra of the noise, and the push's deviation.

python scripts/pages/sensors.py
"""

import warnings
from pathlib import Path

import click
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image
from scipy.signal import welch

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.analysis.noise import Deviations, deviations
from uvms_mj.analysis.setup import set_up

PICTURE = Path(__file__).parents[2] / "docs" / "sensors.png"
INK, BLUE, RED, GREY = "#1f2933", "#0b5cad", "#d02a1e", "#8a97a5"
PUSHING = {  # as in tests/analysis/test_noise.py
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
    ax.set(xlabel="t [s]", ylabel="pushing force [N]", xlim=(1.3, 2.1), ylim=(-2.0, 46.0))
    ax.legend(loc="upper left", frameon=False)


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
    ax.set(xlabel="f [Hz]", ylabel="one-sided density [SI/Hz]", xlim=(0.05, 200.0), ylim=(1e-11, 3e-3))
    ax.legend(loc="lower left", frameon=False, fontsize=7)


def push(ax: Axes) -> None:
    for quantity, (unit, levels, colour) in LEVELS.items():
        scale = {"N": 1.0, "mm": 1e-3, "mm/s": 1e-3}[unit]
        predicted, measured = [], []
        for level in levels:
            settings = PUSHING | {f"navigation.{quantity}_noise": float(level)}
            found = deviations(set_up(Scenario.load("push_wall", settings, "impedance")))
            assert isinstance(found, Deviations), found
            trace = run(settings)
            predicted.append(found.push)
            measured.append(trace.push[trace.t > 20.0].std())
        ax.loglog(levels / scale, predicted, color=colour, lw=1.0, label=f"{quantity} [{unit}]")
        ax.loglog(levels / scale, measured, "o", color=colour, ms=4)
        click.echo(f"{quantity}: largest difference {np.abs(np.array(measured) / predicted - 1.0).max():.2%}")
    ax.set(xlabel="deviation of a sample", ylabel="deviation of the push [N]")
    ax.legend(loc="upper left", frameon=False, title="closed form, runs as dots")


@click.command()
@click.argument("picture", type=click.Path(path_type=Path), default=PICTURE)
def main(picture: Path) -> None:
    """Draw the picture of the page about sensors."""
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    for ax, draw in zip(figure.subplots(1, 3), (force, spectra, push), strict=True):
        draw(ax)
        ax.spines[["top", "right"]].set_visible(False)
    figure.savefig(picture, dpi=110)
    with Image.open(picture) as image:  # fewer colours, a third of the bytes
        image.convert("RGB").quantize(64).save(picture, optimize=True)
    click.echo(f"{picture}: {picture.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
