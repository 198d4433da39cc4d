"""Draw docs/water.png: a current with gusts, its spectrum against theory, and the push on a wall in it.

python scripts/pages/water.py
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from PIL import Image
from scipy.signal import welch

from uvms_mj import Scenario, simulate
from uvms_mj.views.figures.style import BLACK, COLOURS, PAGE_IN, line, save, styled

DOCS = Path(__file__).parents[2] / "docs"
SIGMA, T = 0.1, 1.0
LONG = {
    "simulation.duration": 1000.0,
    "simulation.timestep": 1e-3,
    "wall.position": 50.0,
    "reference.target": [0.0, 0.0, 0.0],
    "current.speed": 0.0,
    "current.deviation": [SIGMA] * 3,
    "current.correlation_time": T,
}
LAWS = {"impedance": COLOURS["roll"], "gsta": COLOURS["x"]}


def theory(f: np.ndarray) -> np.ndarray:
    """One-sided spectral density of the process [m^2/s^2/Hz]."""
    return 4.0 * SIGMA**2 * T / (1.0 + (2.0 * np.pi * f * T) ** 2)


def spectrum(ax: Axes) -> None:
    """The spectrum of a run of 1000 s."""
    for gust, colour in ((T / 64.0, COLOURS["x"]), (T / 8.0, COLOURS["y"])):
        scenario = Scenario.load("push_wall", LONG | {"current.shortest_gust": gust}, "impedance")
        trace = simulate(scenario, engine="free_body", log_rate=500)
        f, density = welch(trace.v_c_W, fs=500.0, nperseg=2**14, axis=0)
        keep = (f > 0.0) & (f < 200.0)
        ax.loglog(
            f[keep],
            density[keep].mean(axis=1),
            color=colour,
            lw=0.8,
            label=f"run of 1000 s, shortest gust T/{T / gust:g}",
        )
    ax.loglog(f[keep], theory(f[keep]), color=BLACK, lw=1.0, ls="--", label=r"$4\sigma^2 T/(1 + (2\pi f T)^2)$")
    ax.set(xlabel="frequency [Hz]", ylabel="density of $v_c$ [m$^2$/s$^2$/Hz]", ylim=(1e-9, 1e0))
    ax.legend(loc="lower left")


def push(above: Axes, below: Axes) -> None:
    """The current along W, and the pushing force of two laws in it."""
    for law, colour in LAWS.items():
        trace = simulate(Scenario.load("push_wall_gusts", controller=law), engine="free_body", log_rate=200)
        line(below, trace.t, trace.push, law, color=colour, lw=1.0, label=law)
    for i, axis in enumerate("xyz"):
        line(above, trace.t, trace.v_c_W[:, i], axis, color=COLOURS[axis], lw=1.0, label=axis)
    above.set(ylabel="current $v_c$ in W [m/s]", ylim=(-0.4, 0.6))
    below.set(xlabel="time [s]", ylabel="push on the wall [N]", ylim=(0.0, 6.0))
    for ax in (above, below):
        ax.set_xlim(0.0, trace.t[-1])
        ax.legend(loc="upper right", ncols=3)


def main() -> None:
    with styled():
        figure, axes = plt.subplot_mosaic(
            [["current", "spectrum"], ["push", "spectrum"]], figsize=(PAGE_IN, 3.0), layout="constrained"
        )
        push(axes["current"], axes["push"])
        spectrum(axes["spectrum"])
        (file,) = save(figure, DOCS / "water", ("png",))
    small = Image.open(file).quantize(64)
    small.save(file, optimize=True)
    print(file, file.stat().st_size)


if __name__ == "__main__":
    main()
