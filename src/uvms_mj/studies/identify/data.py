"""The measurements of an experiment, from its file: in SI units, in the frames of a run, and checked.

Refused is what a least-squares fit would swallow: a signal that never changes, a speed that is a wrong unit, an input
that is missing for a while.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError, suggestion
from ...physics.frames import rotation_matrix
from ...plant.vehicle import Vehicle
from ...records.measured import LogTable, Series
from ...stages.signals import Signal, joint_signals, pulse_signal, thruster_signal
from .file import LONGEST_DELAY, Experiment, name_of

_WRENCH = Signal("tau", (6,), "N, N m", "B", "wrench on the vehicle")
_MOTION = (
    Signal("p_WB", (3,), "m", "W", "position of B's origin"),
    Signal("quat_WB", (4,), "1", "W", "attitude"),
    Signal("nu", (6,), "m/s, rad/s", "B", "velocity"),
)
_PULSES = 1100.0, 1900.0
_FEWER = "write fewer samples a second; 20 show the motion of a vehicle"
_FASTEST, _STRONGEST = (50.0, 50.0), (1e5, 1e5)
_LONGEST, _SHORTEST = 5.0, 1e-4
"""Distances of samples of a motion beyond which the unit of the time is wrong [s]."""
_GAP = 5.0
"""Times the median distance of the samples of an input from which on it is unknown in between."""
LEAST = 4
"""Samples that a channel needs at least."""
LATER = 0.05
"""Share of a motion that is simulated beyond its end, for a clock that is fast."""
MOST = 200_000
"""Samples of a channel or an input at most. A motion is simulated once an iteration for each unknown, which takes some
10 s for as many pulses, and the derivatives of six channels by twelve unknowns are 115 MB."""


@dataclass(frozen=True)
class Channel:
    """Measured values of one component: y (n,) at times t (n,), which begin with the experiment [s]; rows of a towing
    or trim are numbered instead. ``sigma`` is the standard deviation of its noise, or None."""

    name: str
    unit: str
    t: np.ndarray
    y: np.ndarray
    sigma: float | None = None


@dataclass(frozen=True)
class Inputs:
    """An input: its name, tau, u or pwm, values (n, m) at times t (n,) [s], and whether it is linear between them."""

    name: str
    t: np.ndarray
    values: np.ndarray
    linear: bool


@dataclass(frozen=True)
class Data:
    """The measurements of an experiment.

    Attributes:
        channels: columns to compare with the plant. A measured attitude has three, of the turn from the plant's to it.
        quat: (n, 4) the measured attitude, at the times of its channels.
        given: (n, m) arrays by name that are no channel: velocities of a towing, joints and wrenches of a trim.
        inputs: of a motion, or None.
        t_0: time in the file at which the motion begins [s].
        span: length of the motion [s].
        held_from: time since the beginning from which on samples are held out [s]; infinite: none.
        notes: warnings.
    """

    experiment: Experiment
    name: str
    path: Path
    channels: tuple[Channel, ...]
    quat: np.ndarray | None = None
    given: Mapping[str, np.ndarray] = field(default_factory=dict)
    inputs: Inputs | None = None
    t_0: float = 0.0
    span: float = 0.0
    held_from: float = np.inf
    notes: tuple[str, ...] = ()


class _Table(LogTable):
    """Signals, or inputs, of an experiment."""

    def __init__(
        self, label: Path, tables: Mapping[str, Any], file: Path, known: Sequence[Signal], timed: bool
    ) -> None:
        super().__init__(label, tables, file, {each.name: each for each in known}, timed)

    def read(self, name: str) -> list[Series]:
        if not isinstance(self.table["signals"][name], Mapping):
            raise InputError(f"{self.path}: signals.{name}: is not a table; write {{column = ...}}")
        return self.series(name)


def load(experiment: Experiment, folder: Path, place: str, vehicle: Vehicle) -> Data:
    """Read and check the data of an experiment. Raises InputError that names the file, the column and the row."""
    name = name_of(experiment)
    path, label = folder / experiment.data, Path(f"{place}: experiment {name!r}")
    reader = {"motion": _motion, "towing": _towing, "trim": _trim}[experiment.kind]
    data = reader(experiment, name, path, label, vehicle)
    n = max(len(each.t) for each in (*data.channels, *filter(None, [data.inputs])))
    if n > MOST:
        way = "cut it with between into experiments of the parts in which the vehicle is moved"
        if experiment.kind != "motion":
            way = "take means of its rows"
        wrong = f"has {n} samples in the part that is used, and a fit takes {MOST}"
        raise InputError(f"{path}: {wrong}: {way}, or {_FEWER}")
    return data


def _tables(experiment: Experiment, signals: Mapping[str, Any] | None) -> dict[str, Any]:
    return {"signals": signals or {}} | ({"time": experiment.time} if experiment.time is not None else {})


def _motion(experiment: Experiment, name: str, path: Path, label: Path, vehicle: Vehicle) -> Data:
    if vehicle.arm.links:
        raise InputError(f"{label}: a motion is simulated by the engine free_body, which has no joints; use kind trim")
    table = _Table(label, _tables(experiment, experiment.signals), path, _MOTION, True)
    series = _all(table, label)
    low, high = experiment.between or (-np.inf, np.inf)
    notes, cut = list[str](), dict[str, list[Series]]()
    for key, parts in series.items():
        cut[key] = [(t[(t >= low) & (t <= high)], y[(t >= low) & (t <= high)]) for t, y in parts]
        for (t, _), column in zip(cut[key], _columns(experiment.signals[key]), strict=True):
            if not column:
                continue
            if len(t) < LEAST:
                raise InputError(
                    f"{path}: column {column!r} has {len(t)} samples in the part that is used; {LEAST} are needed"
                )
            spacing = float(np.median(np.diff(t)))
            if not _SHORTEST <= spacing <= _LONGEST:
                raise InputError(f"{path}: column {column!r}: its samples are {spacing:.3g} s apart; check time.unit")
            if (widest := np.diff(t).max()) > _GAP * spacing:
                at = t[int(np.argmax(np.diff(t)))]
                notes.append(f"{path.name}: column {column!r} has a gap of {widest:.3g} s after {at:.6g} s")
    t_0 = min(t[0] for parts in cut.values() for t, _ in parts if len(t))
    channels, quat = list[Channel](), None
    for key, parts in cut.items():
        signal = table.signals[key]
        if key == "quat_WB":
            quat = np.stack([y for _, y in parts], axis=1)
            t = parts[0][0] - t_0
            if not np.ptp(quat, axis=0).any():
                raise InputError(f"{path}: the attitude never changes: nothing can be fitted to it; leave it out")
            sigmas = _sigmas(label, experiment, key, 3)
            channels += [
                Channel(f"attitude.{axis}", "rad", t, np.zeros(len(t)), sigma)
                for axis, sigma in zip(("roll", "pitch", "yaw"), sigmas, strict=True)
            ]
            continue
        sigmas = _sigmas(label, experiment, key, signal.size)
        for (t, y), component, unit, column, sigma in zip(
            parts, _short(signal), signal.units, _columns(experiment.signals[key]), sigmas, strict=True
        ):
            if column:
                _refuse_constant(path, column, y)
                if key == "nu":
                    _refuse_large(path, column, y, _FASTEST[unit == "rad/s"], unit)
                channels.append(Channel(component, unit, t - t_0, y, sigma))
    span = max(each.t[-1] for each in channels)
    held = np.inf if experiment.held_out_from is None else experiment.held_out_from - t_0
    if experiment.held_out:
        held = 0.25 * span
    if not 0.1 * span < held and np.isfinite(held):
        raise InputError(f"{label}: held_out_from: less than a tenth of the data would be fitted")
    if span < held < np.inf:
        raise InputError(f"{label}: held_out_from: nothing is held out: the data end at {t_0 + span:.6g} s")
    inputs = _inputs(experiment, path, label, vehicle, t_0, t_0 + span)
    return Data(experiment, name, path, tuple(channels), quat, {}, inputs, t_0, span, held, tuple(notes))


def _inputs(
    experiment: Experiment, path: Path, label: Path, vehicle: Vehicle, begin: float, end: float
) -> Inputs | None:
    if not experiment.inputs:
        return None
    n = len(vehicle.thrusters)
    table = _Table(
        label, _tables(experiment, experiment.inputs), path, (_WRENCH, thruster_signal(n), pulse_signal(n)), True
    )
    if len(experiment.inputs) != 1:
        raise InputError(f"{label}: inputs: give one of tau, u and pwm")
    series = _all(table, label, "inputs")
    ((name, parts),) = series.items()
    columns = _columns(experiment.inputs[name])
    times = [t for t, _ in parts if len(t)]
    if any(len(t) != len(times[0]) or (t != times[0]).any() for t in times):
        raise InputError(f"{path}: the columns of {name} must have the same samples; an input has no missing ones")
    t = times[0]
    lead = LONGEST_DELAY if "delay" in experiment.fit else experiment.delay
    low = max(0, int(np.searchsorted(t, begin - lead, side="right")) - 1)
    high = int(np.searchsorted(t, end + LATER * (end - begin))) + 1
    t = t[low:high]
    if len(t) < 2:
        raise InputError(f"{path}: the input {name} has fewer than two samples in the part that is used")
    spacing = np.diff(t)
    if (gaps := np.flatnonzero(spacing > _GAP * np.median(spacing))).size:
        i = int(gaps[0])
        raise InputError(
            f"{path}: column {next(filter(None, columns))!r}: has a gap of {spacing[i]:.3g} s after {t[i]:.6g} s, "
            "in which the input is unknown; cut the log there with between"
        )
    if t[0] > begin + 1e-9 or t[-1] < end - np.median(spacing) - 1e-9:
        raise InputError(
            f"{path}: the input {name} is known from {t[0]:.6g} to {t[-1]:.6g} s, and the motion lasts from "
            f"{begin:.6g} to {end:.6g} s; cut it with between"
        )
    neutral = 1500.0 if name == "pwm" else 0.0
    values = np.full((len(t), len(parts)), neutral)
    for k, ((_, y), column) in enumerate(zip(parts, columns, strict=True)):
        if not column:
            continue
        y = values[:, k] = y[low:high]
        if name == "pwm" and (wrong := np.flatnonzero((y < _PULSES[0]) | (y > _PULSES[1]))).size:
            raise InputError(
                f"{path}: column {column!r}, sample {low + wrong[0] + 1}: {y[wrong[0]]:g} us is no pulse width from "
                f"{_PULSES[0]:g} to {_PULSES[1]:g} us; check its unit"
            )
        if name != "pwm":
            _refuse_large(path, column, y, _STRONGEST[0], "N or N m", low)
    return Inputs(name, t - begin, values, experiment.hold == "linear")


def _towing(experiment: Experiment, name: str, path: Path, label: Path, vehicle: Vehicle) -> Data:
    if vehicle.arm.links or vehicle.products:
        what = "joints" if vehicle.arm.links else "products of velocities"
        raise InputError(f"{label}: a towing of a vehicle with {what} is not computed")
    table = _Table(label, _tables(experiment, experiment.signals), path, (_MOTION[2], _WRENCH), False)
    series = _all(table, label)
    if {*series} != {"nu", "tau"}:
        raise InputError(
            f"{label}: signals: a towing needs nu, the velocity through the water, and tau, the force that holds it"
        )
    rows = _rows(series, experiment.signals, path)
    nu = np.zeros((len(rows), 6))
    for i, ((t, y), column) in enumerate(zip(series["nu"], _columns(experiment.signals["nu"]), strict=True)):
        if column:
            _refuse_large(path, column, y, _FASTEST[0], "m/s or rad/s")
            nu[:, i] = y[np.isin(t, rows)]
    sigmas = _sigmas(label, experiment, "tau", 6)
    channels = []
    for (t, y), component, unit, column, sigma in zip(
        series["tau"], _short(_WRENCH), _WRENCH.units, _columns(experiment.signals["tau"]), sigmas, strict=True
    ):
        if column:
            _refuse_constant(path, column, y)
            channels.append(Channel(component, unit, np.arange(len(rows), dtype=float), y[np.isin(t, rows)], sigma))
    if not np.ptp(np.abs(nu), axis=0).any():
        raise InputError(f"{path}: the velocity never changes: one speed does not tell linear from quadratic damping")
    held = 0.0 if experiment.held_out else np.inf
    return Data(experiment, name, path, tuple(channels), None, {"nu": nu}, None, 0.0, 0.0, held)


def _trim(experiment: Experiment, name: str, path: Path, label: Path, vehicle: Vehicle) -> Data:
    joints = joint_signals(len(vehicle.arm.links))[:1] if vehicle.arm.links else ()
    known = (_MOTION[1], *joints, _WRENCH)
    table = _Table(label, _tables(experiment, experiment.signals | (experiment.inputs or {})), path, known, False)
    series = _all(table, label)
    if "quat_WB" not in series or (joints and "q" not in series):
        raise InputError(f"{label}: signals: a trim needs quat_WB{', and q of the joints' if joints else ''}")
    rows = _rows(series, experiment.signals | (experiment.inputs or {}), path)
    given = dict[str, np.ndarray]()
    for key, parts in series.items():
        given[key] = np.zeros((len(rows), len(parts)))
        for i, (t, y) in enumerate(parts):
            if len(t):
                given[key][:, i] = y[np.isin(t, rows)]
    up = np.array([rotation_matrix(quat)[2] for quat in given["quat_WB"]])
    sigmas, t = _sigmas(label, experiment, "quat_WB", 2), np.arange(len(rows), dtype=float)
    roll, pitch = np.arctan2(up[:, 1], up[:, 2]), -np.arcsin(np.clip(up[:, 0], -1.0, 1.0))
    channels = Channel("roll", "rad", t, roll, sigmas[0]), Channel("pitch", "rad", t, pitch, sigmas[1])
    return Data(experiment, name, path, channels, None, given, None, 0.0, 0.0, 0.0 if experiment.held_out else np.inf)


def _all(table: _Table, label: Path, word: str = "signals") -> dict[str, list[Series]]:
    """The parts of all signals of a table. Raises InputError for a signal that the kind does not take."""
    if not table.table["signals"]:
        raise InputError(f"{label}: {word}: needs a table of each signal; choose from {', '.join(table.signals)}")
    for name in table.table["signals"]:
        if name not in table.signals:
            raise InputError(f"{label}: {word}.{name}: is not taken here; {suggestion(name, table.signals)}")
    return {name: table.read(name) for name in table.table["signals"]}


def _columns(table: Mapping[str, Any]) -> list[str]:
    return [table["column"]] if "column" in table else list(table["columns"])


def _short(signal: Signal) -> list[str]:
    """Names of components: nu.u, tau.X, p_WB.x."""
    parts = {"nu": "uvwpqr", "tau": "XYZKMN"}.get(signal.name, "xyz")
    return [f"{signal.name}.{part}" for part in parts]


def _rows(series: Mapping[str, list[Series]], tables: Mapping[str, Any], path: Path) -> np.ndarray:
    """The rows in which all columns have a number."""
    rows: np.ndarray | None = None
    for parts in series.values():
        for t, _ in parts:
            if len(t):
                rows = t if rows is None else np.intersect1d(rows, t)
    if rows is None or len(rows) < 2:
        raise InputError(f"{path}: has fewer than two rows in which all columns of {', '.join(tables)} have a number")
    return rows


def _sigmas(label: Path, experiment: Experiment, key: str, n: int) -> list[float | None]:
    """The standard deviations of the components of a signal, in SI units. Raises InputError."""
    given = (experiment.sigma or {}).get(key)
    for word in experiment.sigma or {}:
        if word not in experiment.signals:
            raise InputError(
                f"{label}: sigma.{word}: is no signal of the experiment; {suggestion(word, experiment.signals)}"
            )
    if given is None:
        return [None] * n
    values = given if isinstance(given, list | tuple) else [given] * n
    good = [isinstance(x, int | float) and not isinstance(x, bool) and np.isfinite(x) and x > 0.0 for x in values]
    if len(values) != n or not all(good):
        raise InputError(f"{label}: sigma.{key}: {given!r} must be a number greater than 0, or a list of {n}")
    return [float(x) for x in values]


def _refuse_constant(path: Path, column: str, y: np.ndarray) -> None:
    if not np.ptp(y):
        raise InputError(
            f"{path}: column {column!r} is {y[0]:.6g} in all its samples: nothing can be fitted to it; leave it out"
        )


def _refuse_large(path: Path, column: str, y: np.ndarray, most: float, unit: str, before: int = 0) -> None:
    if (wrong := np.flatnonzero(np.abs(y) > most)).size:
        i = int(wrong[0])
        raise InputError(
            f"{path}: column {column!r}, sample {before + i + 1}: {y[i]:g} is beyond {most:g} {unit}; check its unit"
        )
