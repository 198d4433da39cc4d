"""The least-squares problem: free coefficients, the unknowns of each experiment, and residuals."""

import functools
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...plant.changed_coefficients import changed, places, unit_of, value_of
from ...plant.mjcf import Mjcf
from ...plant.vehicle import Vehicle
from .data import Data, load
from .file import LONGEST_DELAY, File, Free
from .plant import FAR, Plant, Postures, euler_of, plant_of, towing, trim

_STATE = (
    *((f"start.{axis}", "m", 0.05) for axis in "xyz"),
    *((f"start.{axis}", "rad", 0.05) for axis in ("roll", "pitch", "yaw")),
    *((f"start.{axis}", "m/s", 0.1) for axis in "uvw"),
    *((f"start.{axis}", "rad/s", 0.1) for axis in "pqr"),
)
"""Name, unit and scale of each part of the state at the start of a motion."""
_UNKNOWNS = {
    "current": (("current.x", "m/s", 0.1, -3.0, 3.0), ("current.y", "m/s", 0.1, -3.0, 3.0)),
    "delay": (("delay", "s", 0.05, 0.0, LONGEST_DELAY),),
    "clock": (("clock", "1", 0.01, -0.04, 0.04),),
}
_SMALL = {"kg": 1.0, "m": 0.01}
"""Scale of a coefficient that begins at zero, by its unit; 1 of any other unit."""


@dataclass(frozen=True)
class Unknown:
    """A number that is fitted: x = start + scale z. ``of`` is the experiment of an unknown, None of a coefficient."""

    name: str
    unit: str
    start: float
    scale: float
    low: float = -np.inf
    high: float = np.inf
    of: int | None = None
    prior: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Problem:
    """Measurements and the plant that predicts them."""

    file: File
    mjcf: Mjcf
    data: tuple[Data, ...]
    coefficients: tuple[Unknown, ...]
    unknowns: tuple[Unknown, ...]

    @classmethod
    def load(cls, file: File, folder: Path, place: str) -> "Problem":
        """Read the vehicle and all data. Raises InputError."""
        path = folder / file.vehicle
        mjcf = Mjcf.find(str(path) if path.is_file() else file.vehicle)
        data = tuple(load(each, folder, place, mjcf.vehicle) for each in file.experiment)
        return cls.of(file, mjcf, data)

    @classmethod
    def of(cls, file: File, mjcf: Mjcf, data: Sequence[Data]) -> "Problem":
        """The problem of data in memory. Raises InputError for a start that no vehicle can have, or is beyond its
        bounds."""
        coefficients = tuple(_coefficient(each, mjcf.vehicle) for each in file.free)
        changed(mjcf.vehicle, {each.name: each.start for each in coefficients})
        unknowns = tuple(unknown for i, each in enumerate(data) for unknown in _unknowns(i, each))
        return cls(file, mjcf, tuple(data), coefficients, unknowns)

    @functools.cached_property
    def digest(self) -> str:
        """Everything that the residuals depend on, as a short text."""
        found = hashlib.sha256(repr((self.file, self.coefficients, self.unknowns)).encode())
        for name, content in sorted(self.mjcf.files.items()):
            found.update(name.encode() + content)
        for each in self.data:
            inputs = () if each.inputs is None else (each.inputs.t, each.inputs.values)
            attitude = () if each.quat is None else (each.quat,)
            arrays = [array for channel in each.channels for array in (channel.t, channel.y)]
            for array in (*arrays, *attitude, *inputs, *each.given.values()):
                found.update(np.ascontiguousarray(array).tobytes())
        return found.hexdigest()[:16]

    @functools.cached_property
    def all(self) -> tuple[Unknown, ...]:
        """Coefficients and unknowns, in the order of a vector."""
        return (*self.coefficients, *self.unknowns)

    def vehicle(self, x: np.ndarray) -> Vehicle:
        """The vehicle with the coefficients of a vector. Raises InputError if it is not physical."""
        return changed(self.mjcf.vehicle, {each.name: float(v) for each, v in zip(self.coefficients, x, strict=False)})

    def predicted(self, i: int, x: np.ndarray) -> list[np.ndarray]:
        """The values of each channel of experiment i with a vector of coefficients and unknowns."""
        data = self.data[i]
        try:
            vehicle = self.vehicle(x)
        except InputError:
            return [np.full(len(each.t), FAR) for each in data.channels]
        plant = _plants(self)[i]
        if isinstance(plant, Plant):
            named = {each.name: v for each, v in zip(self.all, x, strict=True) if each.of == i}
            start = np.array([named.get(name, fixed) for (name, _, _), fixed in zip(_STATE, _start(data), strict=True)])
            given = data.experiment
            current = np.array([named.get(f"current.{axis}", v) for axis, v in zip("xyz", given.current, strict=True)])
            return plant.predicted(vehicle, start, current, named.get("delay", given.delay), named.get("clock", 0.0))
        if isinstance(plant, Postures):
            tau = data.given.get("tau", np.zeros((len(data.channels[0].t), 6)))
            angles = trim(vehicle, plant, tau)
            return [angles[:, ("roll", "pitch").index(each.name)] for each in data.channels]
        force = towing(vehicle, data.given["nu"])
        return [force[:, "XYZKMN".index(each.name[-1])] for each in data.channels]

    def errors(self, i: int, x: np.ndarray) -> list[np.ndarray]:
        """Measured less predicted, of each channel of experiment i."""
        return [c.y - p for c, p in zip(self.data[i].channels, self.predicted(i, x), strict=True)]

    def fitted(self, i: int) -> list[np.ndarray]:
        """Which samples of each channel of experiment i are fitted; the others are held out."""
        data = self.data[i]
        if data.experiment.kind != "motion":
            return [np.full(len(each.t), not data.experiment.held_out) for each in data.channels]
        return [each.t < data.held_from for each in data.channels]

    def weights(self) -> list[list[float]]:
        """The standard deviation of the noise of each channel: as given, or from the second differences, which see
        noise and little of a smooth motion."""
        found = []
        for i, data in enumerate(self.data):
            own = list[float]()
            for channel, error in zip(data.channels, self.errors(i, self.start), strict=True):
                y = error if channel.name.startswith("attitude") else channel.y
                rough = (
                    np.sqrt(np.mean(np.diff(y, 2) ** 2) / 6.0) if data.experiment.kind == "motion" else np.ptp(y) / 20.0
                )
                floor = 1e-3 * max(float(np.std(channel.y)), float(np.std(y)) if np.std(y) < FAR / 2 else 0.0, 1e-6)
                own.append(channel.sigma or max(float(rough), floor))
            found.append(own)
        return found

    @functools.cached_property
    def start(self) -> np.ndarray:
        """The vector with which the fit begins."""
        return np.array([each.start for each in self.all])


@functools.lru_cache(maxsize=4)
def _plants_of(digest: str, holder: "_Held") -> "list[Plant | Postures | None]":
    problem = holder.problem
    file = problem.file
    return [plant_of(each, problem.mjcf, file.timestep, file.thrusters) for each in problem.data]


class _Held:
    """A problem that is equal to another one with the same digest, so that a worker makes its Simulations once."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Held) and other.problem.digest == self.problem.digest

    def __hash__(self) -> int:
        return hash(self.problem.digest)


def _plants(problem: Problem) -> "list[Plant | Postures | None]":
    return _plants_of(problem.digest, _Held(problem))


def _coefficient(free: Free, vehicle: Vehicle) -> Unknown:
    start = value_of(vehicle, free.name) if free.start is None else free.start
    whole, i, j = places().get(free.name, ("", 0, 1))
    low, high = free.bounds or ((-np.inf, 0.0) if whole and i == j else (-np.inf, np.inf))
    if free.name == "displaced_mass" and free.bounds is None:
        low = 0.0
    if not low <= start <= high:
        raise InputError(f"free {free.name}: the start {start:g} is not within its bounds {low:g} to {high:g}")
    unit = unit_of(free.name)
    scale = free.scale or (abs(start) if abs(start) > 1e-9 else 0.0) or _SMALL.get(unit, 1.0)
    if free.prior is not None and free.scale is None:
        scale = free.prior.sigma
    if unit == "m" and free.scale is None and free.prior is None:
        scale = max(scale, _SMALL["m"])
    prior = None if free.prior is None else (free.prior.mean, free.prior.sigma)
    return Unknown(free.name, unit, start, scale, low, high, None, prior)


def _start(data: Data) -> np.ndarray:
    """(12,) the state at the first sample: the measured parts, and the rest by the file."""
    given = data.experiment.start
    found = np.concatenate([given.position, np.radians(given.attitude_deg), given.velocity])
    by_name = {each.name: each for each in data.channels}
    for i, axis in enumerate("xyz"):
        if (channel := by_name.get(f"p_WB.{axis}")) is not None:
            found[i] = channel.y[0]
            found[6 + i] = np.polyfit(channel.t[:5], channel.y[:5], 1)[0]
    if data.quat is not None:
        found[3:6] = euler_of(data.quat[0])
    for i, axis in enumerate("uvwpqr"):
        if (channel := by_name.get(f"nu.{axis}")) is not None:
            found[6 + i] = channel.y[0]
    return found


def _unknowns(i: int, data: Data) -> list[Unknown]:
    """The unknowns of an experiment: its start where it is measured, and the file's further unknowns."""
    experiment, found = data.experiment, list[Unknown]()
    if experiment.kind != "motion":
        return found
    names = {each.name for each in data.channels}
    posed = [f"p_WB.{axis}" in names for axis in "xyz"]
    turned = data.quat is not None
    known = [*posed, *(turned,) * 3]
    known += [f"nu.{axis}" in names or all(posed) for axis in "uvw"]
    known += [f"nu.{axis}" in names or turned for axis in "pqr"]
    if experiment.fit_start:
        found += [
            Unknown(name, unit, float(start), scale, of=i)
            for (name, unit, scale), start, there in zip(_STATE, _start(data), known, strict=True)
            if there
        ]
    for word in dict.fromkeys(experiment.fit):
        starts = {"current": experiment.current[:2], "delay": (experiment.delay,), "clock": (0.0,)}[word]
        found += [
            Unknown(name, unit, float(start), scale, low, high, i)
            for (name, unit, scale, low, high), start in zip(_UNKNOWNS[word], starts, strict=True)
        ]
    return found
