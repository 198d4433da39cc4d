"""How often the 95 % intervals of ``uvms-mj identify`` have the true coefficient, for synthetic vehicles.

Each vehicle is a BlueROV2 Heavy with 19 coefficients within 30 % of the file's: added mass, linear and quadratic
damping of all axes, and the height of the centre of buoyancy. Two motions are sampled with noise: a decay of 15 s, and
40 s with wrenches that are held for 0.4 s. In the second there is a current, the wrenches act later than the data
say, and the clock of the data is wrong; all four are fitted with the coefficients and the starts. Vehicle k has the
seed k.

python scripts/identify_coverage.py 100
"""

import sys
import time
from pathlib import Path

import numpy as np

from uvms_mj.plant.changed_coefficients import value_of
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.studies.identify.data import Channel, Data, Inputs
from uvms_mj.studies.identify.file import Experiment, File, Free, Start
from uvms_mj.studies.identify.fit import Z_95, fit
from uvms_mj.studies.identify.problem import Problem

NAMES = (
    *(f"{wrench}_{v}dot" for wrench, v in zip("XYZKMN", "uvwpqr", strict=True)),
    *(f"{wrench}_{v}" for wrench, v in zip("XYZKMN", "uvwpqr", strict=True)),
    *(f"{wrench}_{v}{v}" for wrench, v in zip("XYZKMN", "uvwpqr", strict=True)),
    "center_of_buoyancy.z",
)
NOISE = (0.01,) * 3 + (0.004,) * 3
"""Standard deviation of the measured velocity [m/s, rad/s]."""
SPACING = 0.1
STRONG = np.array([25.0, 25.0, 30.0, 2.5, 2.5, 4.0])
"""Standard deviation of the wrenches [N, N m]."""


def motion(name: str, span: float, start: Start, inputs: Inputs | None, fitted: tuple[str, ...]) -> Data:
    """A motion whose velocities are not known yet."""
    t = np.arange(0.0, span, SPACING)
    channels = tuple(
        Channel(f"nu.{axis}", "m/s" if axis in "uvw" else "rad/s", t, np.zeros(len(t))) for axis in "uvwpqr"
    )
    driven = None if inputs is None else {inputs.name: {}}
    experiment = Experiment(data=f"{name}.csv", signals={"nu": {}}, inputs=driven, fit=fitted, start=start)
    return Data(experiment, name, Path(f"{name}.csv"), channels, None, {}, inputs, 0.0, float(t[-1]))


def synthetic(seed: int) -> tuple[Problem, np.ndarray]:
    """A problem with the measurements of a vehicle, and the true coefficients and unknowns."""
    random = np.random.default_rng(seed)
    mjcf = Mjcf.find("bluerov2_heavy")
    times = np.arange(0.0, 40.4, 0.4)
    wrenches = Inputs("tau", times, random.normal(size=(len(times), 6)) * STRONG, False)
    deep, moving = (0.0, 0.0, -5.0), (0.4, 0.3, -0.2, 0.3, -0.3, 0.8)
    tilted = Start(position=deep, attitude_deg=(25.0, -15.0, 0.0), velocity=moving)
    level = Start(position=deep)
    motions = [
        motion("decay", 15.0, tilted, None, ()),
        motion("pushed", 40.0, level, wrenches, ("current", "delay", "clock")),
    ]
    free = tuple(Free(name) for name in NAMES)
    file = File("synthetic", "bluerov2_heavy", free, tuple(each.experiment for each in motions))
    problem = Problem.of(file, mjcf, motions)
    true = problem.start.copy()
    for k, unknown in enumerate(problem.all):
        if unknown.of is None:
            true[k] = value_of(mjcf.vehicle, unknown.name) * random.uniform(0.7, 1.3)
        elif unknown.name.startswith("start."):
            i = "uvwpqr".index(unknown.name[-1])
            true[k] = motions[unknown.of].experiment.start.velocity[i]
        else:
            true[k] = {"current": random.uniform(-0.2, 0.2), "delay": random.uniform(0.02, 0.15)}.get(
                unknown.name.partition(".")[0], random.normal() * 0.01
            )
    measured = []
    for i, each in enumerate(motions):
        clean = problem.predicted(i, true)
        channels = tuple(
            Channel(c.name, c.unit, c.t, y + random.normal(size=len(y)) * sigma)
            for c, y, sigma in zip(each.channels, clean, NOISE, strict=True)
        )
        measured.append(Data(each.experiment, each.name, each.path, channels, None, {}, each.inputs, 0.0, each.span))
    return Problem.of(file, mjcf, measured), true


def main(vehicles: int) -> None:
    inside, scaled, begin = [], [], time.perf_counter()
    for seed in range(vehicles):
        problem, true = synthetic(seed)
        found = fit(problem)
        n = len(NAMES)
        errors = (found.x[:n] - true[:n]) / found.deviation(problem)[:n]
        inside.append(np.where(found.given[:n], np.abs(errors) <= Z_95, np.nan))
        scaled.append(errors)
        print(
            f"vehicle {seed}: {np.nansum(inside[-1]):.0f} of {int(found.given[:n].sum())} inside, "
            f"{found.iterations} iterations, {time.perf_counter() - begin:.0f} s",
            flush=True,
        )
    table = np.array(inside)
    given = int(np.isfinite(table).sum())
    print(f"{int(np.nansum(table))} of {given} intervals have the true value: {100.0 * np.nanmean(table):.1f} %")
    print(f"not given: {table.size - given}")
    for name, share, spread in zip(NAMES, np.nanmean(table, axis=0), np.nanstd(scaled, axis=0), strict=True):
        print(f"  {name}: {100.0 * share:.0f} %, spread of the errors over the deviation {spread:.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
