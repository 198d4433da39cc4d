"""docs/physics/surface.md: a sphere that heaves at the surface beside its formula, and a vehicle that leaps."""

import functools
import math
from collections.abc import Iterator

import matplotlib.pyplot as plt
import numpy as np

from page_look import written
from uvms_mj import Scenario, Simulation
from uvms_mj.views.figures.style import BLACK, COLOURS, PAGE_IN, line, styled

RADIUS, SHARE, G, RHO, H = 0.15, 0.5, 9.81, 1000.0, 1e-3
STILL = {
    "wall.present": False,
    "controller.name": "external",
    "simulation.timestep": H,
    "simulation.duration": 100.0,
    "current.speed": 0.0,
    "sea.surface": 0.0,
}
"""Nobody commands."""
LEAP = {
    "vehicle.model": "bluerov2_heavy",
    "buoyancy.shapes": [{"shape": "box", "edges": [0.457, 0.338, 0.254]}],
    "initial.position": [0.0, 0.0, -0.2],
}


@functools.cache
def sphere() -> tuple[Scenario, float]:
    """A vehicle that is a sphere, half of which is below the surface at rest, without drag; and its period [s] by
    formula."""
    setup = Simulation(Scenario.load("push_wall", STILL), engine="free_body").setup
    nominal, displaced = setup.nominal, RHO * 4.0 / 3.0 * math.pi * RADIUS**3
    mass = SHARE * displaced
    over = {
        "buoyancy.shapes": [{"shape": "sphere", "radius": RADIUS}],
        "vehicle.mass": mass / nominal.mass,
        "vehicle.displaced_mass": displaced / nominal.displaced_mass,
        "vehicle.added_mass": 0.5 * displaced / float(nominal.M_A[2, 2]),
        **{"vehicle.linear_damping": 0.0, "vehicle.quadratic_damping": 0.0},
    }
    period = 2.0 * math.pi * math.sqrt((mass + SHARE * 0.5 * displaced) / (RHO * G * math.pi * RADIUS**2))
    return Scenario.load("push_wall", STILL | over), period


def motion(scenario: Scenario, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], heights [m] and shares below the surface of a run (n,)."""
    n, rows = round(seconds / H), []
    with Simulation(scenario, engine="free_body") as sim:
        for _ in range(n):
            rows.append((sim.signals.p_WB[2], float(sim.signals.wet_fraction)))
            sim.step(1)
    z, wet = np.array(rows).T
    return H * np.arange(n), z, wet


@functools.cache
def heave(amplitude: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Times [s] and heave [m] of the sphere let go so high above its rest, and its period [s]."""
    scenario, _ = sphere()
    t, z, _ = motion(scenario.updated({"initial.position": [0.0, 0.0, amplitude]}), 6.0)
    i = np.flatnonzero((z[:-1] < 0.0) & (z[1:] >= 0.0))
    rises = t[i] - z[i] * H / (z[i + 1] - z[i])
    return t, z, float(np.diff(rises).mean())


@functools.cache
def leap(drag: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """:func:`motion` of a BlueROV2 Heavy that rises through the surface at 3 m/s, with a factor of its drag."""
    factors = {"vehicle.linear_damping": drag, "vehicle.quadratic_damping": drag}
    thrown = {"initial.velocity": [0.0, 0.0, 3.0, 0.0, 0.0, 0.0]}
    return motion(Scenario.load("push_wall", STILL | LEAP | factors | thrown), 1.5)


def numbers() -> Iterator[tuple]:
    yield "by formula {} s, and let go 1 mm above its rest it takes {} s", sphere()[1], heave(0.001)[2]
    yield "from 0.1 m it takes {} s", heave(0.1)[2]
    for drag, words in ((1.0, "with its drag it rises to {} m"), (0.0, "without drag to {} m")):
        yield words, leap(drag)[1].max()


def main() -> None:
    with styled():
        figure, (left, right) = plt.subplots(1, 2, figsize=(PAGE_IN, 2.6))
        t, z, _ = heave(0.02)
        line(left, t, 1e3 * z, "run", color=COLOURS["x"], lw=1.4, label="run")
        line(
            left,
            t,
            20.0 * np.cos(2.0 * np.pi * t / sphere()[1]),
            "formula",
            color=BLACK,
            lw=1.0,
            ls="--",
            label="formula",
        )
        left.set(xlabel="time [s]", ylabel="heave of a sphere [mm]", xlim=(0.0, 3.0), ylim=(-30.0, 36.0))
        left.legend(loc="upper right", ncols=2)
        for drag, colour, words in ((0.0, COLOURS["z"], "without drag"), (1.0, COLOURS["x"], "with drag")):
            t, z, wet = leap(drag)
            line(right, t, z, words, color=colour, lw=1.2, label=words)
            dry = np.where(wet == 0.0, z, np.nan)
            right.plot(t, dry, color=colour, lw=3.0)
        right.axhline(0.0, color=BLACK, lw=0.8)
        right.set(xlabel="time [s]", ylabel="z of a vehicle [m]", xlim=(0.0, 1.5))
        right.legend(loc="upper right")
        written(figure, "surface", 64)
