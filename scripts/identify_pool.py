"""The height of the centre of buoyancy of the pool's vehicle by ``uvms-mj identify``, beside the fit of ``uvms-mj
validate pool``.

docs/evidence/validation.md describes the records. Here they are trims: at each instant the attitude in which weight
and buoyancy balance, at the measured angles of the joints, so that motion counts as an error.

python scripts/identify_pool.py ../shared/data/pool_2023
"""

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from uvms_mj.reproduce.validate.data import Record, records
from uvms_mj.reproduce.validate.vehicle import DISPLACED, GRAVITY, HEIGHT, Variant, vehicle
from uvms_mj.studies.identify.data import Channel, Data
from uvms_mj.studies.identify.file import Experiment, File, Free
from uvms_mj.studies.identify.fit import Z_95, fit
from uvms_mj.studies.identify.problem import Problem

EVERY = 0.1
"""Time from one row of a trim to the next [s]."""
NAME = "center_of_buoyancy.z"


def trim_of(record: Record, instrument: str, axes: tuple[str, ...]) -> Data:
    """A record as a trim."""
    motion = record.motion
    t = np.arange(motion.begin, motion.end, EVERY)
    angles = getattr(record, instrument).at(t)
    rows = np.arange(len(t), dtype=float)
    channels = tuple(Channel(axis, "rad", rows, angles[:, ("roll", "pitch").index(axis)]) for axis in axes)
    experiment = Experiment(data=record.name, signals={"quat_WB": {}}, kind="trim", name=record.name)
    return Data(experiment, record.name, Path(record.name), channels, None, {"q": motion.q(t)})


def height(trials: list[Record], instrument: str, axes: tuple[str, ...]) -> tuple[float, float, float]:
    """The height of the vehicle's own centre of buoyancy, half its 95 % interval [m], and the rms of the residuals
    [rad]. The coefficient is of vehicle, tube and foam together, and moves with it by their displaced masses."""
    given = vehicle(Variant(), np.zeros(4))
    plant: Any = SimpleNamespace(vehicle=given, files={}, gravity_W=np.array([0.0, 0.0, -GRAVITY]))
    data = [trim_of(record, instrument, axes) for record in trials]
    file = File("pool", "pool", (Free(NAME),), tuple(each.experiment for each in data))
    problem = Problem.of(file, plant, data)
    found = fit(problem)
    lever = given.displaced_mass / DISPLACED
    errors = np.concatenate([e for i in range(len(data)) for e in problem.errors(i, found.x)])
    moved = HEIGHT + lever * (found.x[0] - given.r_b[2])
    return moved, Z_95 * lever * float(found.deviation(problem)[0]), float(np.sqrt(np.mean(errors**2)))


def main(folder: str) -> None:
    trials, _ = records(folder)
    sets = {"the first three trials": trials[:3], "the other nine": trials[3:], "all twelve": trials}
    for name, chosen in sets.items():
        for instrument in ("mocap", "imu"):
            for axes in (("pitch",), ("roll", "pitch")):
                z, half, rms = height(chosen, instrument, axes)
                said = f"{1e3 * z:.1f} +- {1e3 * half:.1f} mm, rms {np.degrees(rms):.2f} deg"
                print(f"{name}, {instrument}, {' and '.join(axes)}: {said}")


if __name__ == "__main__":
    main(sys.argv[1])
