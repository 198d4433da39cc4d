"""docs/physics/water.md: a current with gusts, its spectrum against theory, and the push on a wall in it."""

import functools
from collections.abc import Iterator

import matplotlib.pyplot as plt
import mujoco
import numpy as np
from matplotlib.axes import Axes
from scipy.signal import welch

from page_look import written
from uvms_mj import Current, Scenario, Trace, attach, simulate
from uvms_mj.files import shipped
from uvms_mj.physics.varying import rate_deviation
from uvms_mj.views.figures.style import BLACK, COLOURS, PAGE_IN, line, styled

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
SETTLED = 10.0
"""The numbers of the push are from this time on [s]."""
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
    ax.set(xlabel="frequency [Hz]", ylabel="density of $v_c$ [m²/s²/Hz]", ylim=(1e-9, 1e1))
    ax.legend(loc="upper right")


@functools.cache
def in_gusts(law: str, shortest: float = 1.0) -> Trace:
    scenario = Scenario.load("push_wall_gusts", {"current.shortest_gust": shortest}, law)
    return simulate(scenario, engine="free_body", log_rate=1000)


def late(law: str, shortest: float = 1.0) -> np.ndarray:
    """The push after the impacts [N]."""
    trace = in_gusts(law, shortest)
    return trace.push[trace.t > SETTLED]


def variance_between(gust: float) -> float:
    """Variance of the cubic in the middle of two nodes, over the process's; ``gust`` is their spacing over T."""
    weights, phi = np.array([-1.0, 9.0, 9.0, -1.0]) / 16.0, np.exp(-gust)
    return float(weights @ phi ** np.abs(np.subtract.outer(range(4), range(4))) @ weights)


def order(rates: tuple[float, float, float]) -> float:
    """Observed order of the pose by MuJoCo's RK4 with the water, from time steps of 10, 5 and 2.5 ms: a vehicle that
    begins with an angular velocity [rad/s], in a vertical current that swings."""
    ends = []
    for steps in (80, 160, 320):
        model = mujoco.MjModel.from_xml_path(str(shipped("models")["bluerov2_heavy"]))
        model.opt.timestep, model.opt.integrator = 0.8 / steps, mujoco.mjtIntegrator.mjINT_RK4
        data = mujoco.MjData(model)
        data.qvel[2:] = -0.2, *rates
        with attach(model, data, current=Current(speed=0.0, amplitude=(0.0, 0.0, 0.1), frequency_hz=(0.0, 0.0, 0.8))):
            mujoco.mj_step(model, data, steps)
        ends.append(data.qpos.copy())
    coarse, fine = (np.abs(ends[k] - ends[k + 1]).max() for k in (0, 1))
    return float(np.log2(coarse / fine))


def numbers() -> Iterator[tuple]:
    held, fosm, touching = late("gsta"), late("fosm"), late("impedance") > 0.0
    yield "GSTA holds {} N, the demanded force, within {} N", held.mean(), np.abs(held - held.mean()).max()
    yield (
        "the push of FOSM has a standard deviation of {} N and a range of {} N from least to greatest",
        fosm.std(),
        np.ptp(fosm),
    )
    yield "impedance control touches the wall {} % of the time", (100.0 * touching.mean(), 1.0)
    off = late("gsta", 0.08) == 0.0
    yield "gusts down to 0.08 s push GSTA off the wall for {} % of the time", (100.0 * off.mean(), 3.0)
    loss = [100.0 * (1.0 - variance_between(gust)) for gust in (1.0 / 64.0, 1.0 / 8.0)]
    yield "{} % at most for T/64 and by {} % for T/8", *loss
    rates = [rate_deviation(np.ones(1), 1.0, gust)[0] for gust in (1.0 / 64.0, 1.0 / 8.0)]
    yield "RK4 converges at order {} where the vehicle does not turn", (order((0.0, 0.0, 0.0)), 0.2)
    yield "and at order {} where it turns", (order((0.8, -0.6, 0.4)), 0.2)
    yield r"a standard deviation of up to {} $\sigma/T$ for T/64 and {} $\sigma/T$ for T/8", *rates


def push(above: Axes, below: Axes) -> None:
    """The current along W, and the pushing force of two laws in it."""
    for law, colour in LAWS.items():
        trace = in_gusts(law)
        line(below, trace.t, trace.push, law, color=colour, lw=1.0, label=law)
    for i, axis in enumerate("xyz"):
        line(above, trace.t, trace.v_c_W[:, i], axis, color=COLOURS[axis], lw=1.0, label=axis)
    above.set(ylabel="current $v_c$ in W [m/s]", ylim=(-0.4, 0.6))
    below.set(xlabel="time [s]", ylabel="push on the wall [N]", ylim=(-0.4, 18.0))
    for ax in (above, below):
        ax.set_xlim(0.0, trace.t[-1])
        ax.legend(loc="upper right", ncols=3)


def main() -> None:
    with styled():
        figure, axes = plt.subplot_mosaic([["current", "spectrum"], ["push", "spectrum"]], figsize=(PAGE_IN, 3.2))
        push(axes["current"], axes["push"])
        spectrum(axes["spectrum"])
        written(figure, "water", 64)
