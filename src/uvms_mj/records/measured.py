"""The log of a real vehicle as a trace: a table in TOML maps the columns of a file to signals, and names the run that
it is compared with::

    log = "dive.csv"              # .csv, .parquet, or .mcap: a log of uvms-mj, or messages in JSON
    run = "results/run.mcap"      # gives the vehicle, the scenario, the reference and the closed form
    time = {column = "time", unit = "ms"}
    clock = {signal = "push"}     # or {events = [[12.3, 1.5]]}, times of the log and of the run [s], or {offset = 1.5}

    [signals.push]
    column = "load_cell"
    unit = "N"
    sign = -1

    [signals.p_WB]
    columns = ["north", "east", "down"]
    unit = "m"
    frame = "NED"

A signal has the name, the components and the frame of the run's own one; ``push`` is the pushing force. Its numbers are
interpolated at equal times. An empty cell is a missing sample. Rows in which a signal has a gap are left out.

The clock of the log is ``offset`` behind the clock of the run: t_run = t_log + offset. A shared signal gives the offset
of the greatest correlation of the samples that both have, refined by a parabola.
"""

import dataclasses
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..control.base import NoClosedForm
from ..errors import InputError, suggestion
from ..files import tables_of
from ..physics.frames import quat_from_euler_deg
from ..stages.signals import FINAL_WINDOW_S, RUNNING, Signal, pulse_signal
from .clocks import LEAST, aligned, in_gap
from .columns import Series, columns_of
from .header import MEASURED, Header, Outcome, Status
from .mcap import read

_TOUCH = 0.5
"""Push from which a measured one counts as a touch [N], by default."""
_UNITS: Mapping[str, Mapping[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "kn": 1852.0 / 3600.0},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180.0},
    "N": {"N": 1.0, "kN": 1e3, "gf": 9.80665e-3, "kgf": 9.80665, "lbf": 4.4482216152605},
    "N m": {"N m": 1.0, "kgf m": 9.80665},
    "us": {"us": 1.0, "ms": 1e3, "s": 1e6},
}
"""Factors to SI by the unit of a signal."""
_FLIP = np.array([1.0, -1.0, -1.0])
_PUSH = Signal("push", (), "N", "-", "pushing force of the vehicle on the wall")
_REFERENCE = ("p_d", "quat_d")
"""Signals that the log takes from the run: what was demanded of both."""


def load(path: str | os.PathLike) -> tuple[Header, np.ndarray, Outcome]:
    """Header, rows (n, width) and outcome of the log that a table in TOML describes. Raises InputError, with file,
    column and row."""
    return _Log(Path(path)).trace()


class LogTable:
    """A table of signals with the file that has their columns.

    Attributes:
        path: of the table, for messages.
        table: its keys, ``signals`` among them.
        file: the file.
        columns: its columns.
        signals: the signals that it may have by name.
    """

    def __init__(
        self, path: Path, table: Mapping[str, Any], file: Path, signals: Mapping[str, Signal], timed: bool = True
    ) -> None:
        """``timed``: whether the table may name a column of times; otherwise the rows are numbered. Raises InputError
        if the file or its column of times can't be read."""
        self.path, self.table, self.file, self.signals = path, table, file, signals
        time = table.get("time", {"column": "t"})
        self._known("time", time, ("column", "unit"))
        scale = self._factor("time.unit", time.get("unit", "s"), "s")
        self.columns = columns_of(file, str(time.get("column", "t")) if timed else None, scale)

    def _known(self, name: str, table: Any, keys: Sequence[str]) -> None:
        if not isinstance(table, Mapping):
            raise InputError(f"{self.path}: {name}: {table!r} is not a table")
        for key in table:
            if key not in keys:
                raise InputError(
                    f"{self.path}: {f'{name}.' if name else ''}{key}: no such key; {suggestion(key, keys)}"
                )

    def _factor(self, key: str, unit: Any, of: str) -> float:
        known = _UNITS.get(of, {of: 1.0})
        if not isinstance(unit, str) or unit not in known:
            raise InputError(f"{self.path}: {key}: {unit!r} is no unit of it; choose from {', '.join(known)}")
        return known[unit]

    def series(self, name: str) -> list[Series]:
        """The components of a signal in its unit and frame, each with its times; none of a missing one."""
        key, table, path = f"signals.{name}", self.table["signals"][name], self.path
        self._known(key, table, ("column", "columns", "unit", "frame", "sign", "offset"))
        known = self.signals
        if name not in known:
            raise InputError(f"{path}: {key}: is no signal of the run; {suggestion(name, known)}")
        signal = known[name]
        if "column" in table and "columns" in table:
            raise InputError(f"{path}: {key}: give column or columns, not both")
        columns = [table["column"]] if "column" in table else table.get("columns")
        angles = signal.components[0] == "w" and table.get("unit") in ("rad", "deg")
        size = 3 if angles else signal.size
        named = isinstance(columns, list) and all(isinstance(each, str) for each in columns)
        if not named or len(columns) != size:
            wanted = f"{size} names, one of each of {', '.join(signal.components)}" if size > 1 else "one name"
            raise InputError(f"{path}: {key}.columns: needs {wanted}; an empty name is a missing component")
        series: list[Series] = []
        units = ["rad"] * 3 if angles else signal.units
        given = [str(each) for each in self._halves(table.get("unit", ", ".join(dict.fromkeys(units))), size)]
        for column, unit, of in zip(columns, given, units, strict=True):
            factor = 1.0 if angles else self._factor(f"{key}.unit", unit, of)
            t, values = self.columns[column] if column else (np.zeros(0), np.zeros(0))
            series.append((t, factor * values))
        turned = self._turned(key, signal, series, table.get("frame", signal.frame), table.get("unit") == "deg", angles)
        signs, offsets = (
            self._each(f"{key}.{word}", table.get(word, x), len(turned)) for word, x in (("sign", 1), ("offset", 0))
        )
        if signal.components[0] == "w" and any(offsets):
            raise InputError(f"{path}: {key}.offset: an attitude has none; a sum of quaternions is no turn")
        if any(sign not in (1, -1) for sign in signs):
            raise InputError(f"{path}: {key}.sign: {table['sign']!r} must be 1 or -1, or a list of them")
        return [(t, s * v + o) for (t, v), s, o in zip(turned, signs, offsets, strict=True)]

    @staticmethod
    def _halves(unit: Any, size: int) -> list[str]:
        first, comma, second = str(unit).partition(", ")
        return [first] * (size // 2) + [second] * (size - size // 2) if comma else [first] * size

    def _each(self, key: str, value: Any, n: int) -> list[float]:
        values = value if isinstance(value, list) else [value] * n
        numbers = all(isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x) for x in values)
        if len(values) != n or not numbers:
            raise InputError(
                f"{self.path}: {key}: {value!r} must be a finite number{f', or a list of {n}' if n > 1 else ''}"
            )
        return [float(x) for x in values]

    def _turned(
        self, key: str, signal: Signal, series: list[Series], frame: Any, degrees: bool, angles: bool
    ) -> list[Series]:
        """The components in the frame of the signal, with x north, y west, z up, or forward, left, up."""
        known = {"W": ("W", "NED", "ENU"), "B": ("B", "FRD")}.get(signal.frame, (signal.frame,))
        if frame not in known:
            raise InputError(f"{self.path}: {key}.frame: {frame!r} is no frame of it; choose from {', '.join(known)}")
        if signal.components[0] == "w":
            return self._attitude(key, series, frame, degrees, angles)
        if frame == "ENU" and signal.size == 3:
            (t_e, east), north, up = series
            return [north, (t_e, -east), up]
        if frame in ("NED", "FRD") and signal.size in (3, 6):
            signs = np.tile(_FLIP, signal.size // 3)
            return [(t, s * v) for (t, v), s in zip(series, signs, strict=True)]
        if frame != signal.frame:
            raise InputError(f"{self.path}: {key}.frame: {frame} is not known for a signal of {signal.size} numbers")
        return series

    def _attitude(self, key: str, series: list[Series], frame: str, degrees: bool, angles: bool) -> list[Series]:
        if frame == "ENU":
            raise InputError(f"{self.path}: {key}.frame: give the attitude from W, or from NED to FRD")
        t = series[0][0]
        if any(len(each) != len(t) or (each != t).any() for each, _ in series):
            raise InputError(f"{self.file}: the columns of {key} must have the same samples")
        values = np.stack([v for _, v in series], axis=1)
        if angles:
            values = values if degrees else np.degrees(values)
            values = np.array([quat_from_euler_deg(*row) for row in values])
        sizes = np.linalg.norm(values, axis=1)
        if (wrong := np.flatnonzero(np.abs(sizes - 1.0) > 0.01)).size:
            raise InputError(f"{self.file}: {key}, sample {wrong[0] + 1}: has the length {sizes[wrong[0]]:.4g}, not 1")
        values = values / sizes[:, None]
        if frame == "NED":
            values = values * np.array([1.0, *_FLIP])
        same = np.sign(np.einsum("ij,ij->i", values[1:], values[:-1]))
        values[1:] *= np.cumprod(np.where(same < 0.0, -1.0, 1.0))[:, None]
        return [(t, values[:, i]) for i in range(4)]


class _Log(LogTable):
    """A table with its file and its run."""

    def __init__(self, path: Path) -> None:
        self.path = path
        table = tables_of(path, "table of a log")
        self._known("", table, ("name", "log", "run", "time", "clock", "signals", "touch_above"))
        for key in ("log", "run", "signals"):
            if key not in table:
                raise InputError(f"{path}: the key {key} is missing")
        if not isinstance(table["signals"], Mapping) or not table["signals"]:
            raise InputError(f"{path}: signals: needs a table of each signal, [signals.push]")
        header, rows, *_ = read(path.parent / str(table["run"]))
        self.header = header
        self.run = {s.name: rows[:, header.places[s.name]].reshape(-1, *s.shape) for s in header.signals}
        n = header.by_name["u"].size
        signals = {"push": _PUSH, "pwm": pulse_signal(n)} | {
            name: s for name, s in header.by_name.items() if s.kind == "f8" and s not in RUNNING and name != "t"
        }
        super().__init__(path, table, path.parent / str(table["log"]), signals)

    def trace(self) -> tuple[Header, np.ndarray, Outcome]:
        series = {name: self.series(name) for name in self.table["signals"]}
        offset, said = self._offset(series)
        h = self.header.scenario.simulation.timestep
        spacing = min(float(np.median(np.diff(t))) for parts in series.values() for t, _ in parts if len(t))
        steps = max(1, round(spacing / h))
        first = max(max(t[0] for parts in series.values() for t, _ in parts if len(t)) + offset, 0.0)
        last = min(t[-1] for parts in series.values() for t, _ in parts if len(t)) + offset
        grid = steps * h * np.arange(math.ceil(first / (steps * h) - 1e-9), math.floor(last / (steps * h) + 1e-9) + 1)
        if len(grid) < 2 or grid[0] > self.run["t"][-1]:
            raise InputError(
                f"{self.path}: the log and the run have no time in common with an offset of {offset:.6g} s"
            )
        there, gaps = np.ones(len(grid), bool), dict[str, float]()
        arrays: dict[str, np.ndarray] = {}
        for name, parts in series.items():
            values = []
            for t, each in parts:
                at = grid - offset
                values.append(np.interp(at, t, each) if len(t) else np.full(len(grid), np.nan))
                missing = in_gap(t, at)
                if missing.any():
                    gaps[name] = float(missing.sum() * steps * h)
                    there &= ~missing
            arrays[name] = np.stack(values, axis=1)
        if there.sum() < 2:
            raise InputError(f"{self.file}: the signals have no two samples in common between their gaps")
        arrays = {name: values[there] for name, values in arrays.items()}
        header, rows = self._filled(grid[there], arrays, steps, self._notes(said, offset, series, gaps, there, arrays))
        return header, rows, Outcome(Status.completed, "", round(float(grid[there][-1]) / h), 0.0)

    def _offset(self, series: Mapping[str, list[Series]]) -> tuple[float, str]:
        """The offset of the clocks [s], and how it was found."""
        clock = self.table.get("clock", {"offset": 0.0})
        self._known("clock", clock, ("signal", "events", "offset"))
        if len(clock) != 1:
            raise InputError(f"{self.path}: clock: needs one of signal, events and offset")
        if "offset" in clock:
            (offset,) = self._each("clock.offset", clock["offset"], 1)
            return (
                offset,
                f"offset {_seconds(offset)} s, as {'given' if 'clock' in self.table else 'no clock is given'}",
            )
        if "events" in clock:
            events = clock["events"]
            if not isinstance(events, list) or not events or not all(isinstance(each, list) for each in events):
                raise InputError(f"{self.path}: clock.events: needs a list of [time of the log, time of the run] in s")
            pairs = np.array([self._each("clock.events", each, 2) for each in events])
            found = pairs[:, 1] - pairs[:, 0]
            spread = f", which differ by {np.ptp(found):.3g} s" if len(found) > 1 else ""
            by = f"by {len(found)} event{'s' if spread else ''}{spread}"
            return float(found.mean()), f"offset {_seconds(found.mean())} s, {by}"
        name, _, component = str(clock["signal"]).partition(".")
        if name not in series:
            raise InputError(f"{self.path}: clock.signal: {name} is not in signals; {suggestion(name, series)}")
        parts = self.signals[name].components
        if component not in parts:
            raise InputError(f"{self.path}: clock.signal: needs a component, {name}.{parts[0]}")
        i = parts.index(component)
        theirs = self._of_run(name)
        if theirs is None:
            raise InputError(f"{self.path}: clock.signal: the run has not recorded {name}; choose another one")
        if not len(series[name][i][0]):
            raise InputError(f"{self.path}: clock.signal: {clock['signal']} is missing in the log; choose another one")
        offset, correlation, other = aligned(series[name][i], (self.run["t"], theirs[:, i]))
        if math.isnan(correlation):
            raise InputError(
                f"{self.path}: clock.signal: {clock['signal']} does not move, or too few samples of it are in a stretch"
                " as long as half of the shorter record; is time.unit right? Else give events or offset"
            )
        if not correlation >= LEAST:
            raise InputError(
                f"{self.path}: clock.signal: {clock['signal']} of the log and of the run do not agree, their greatest "
                f"correlation is {correlation:.2f}; choose another signal, or give events"
            )
        if not math.isnan(other):
            raise InputError(
                f"{self.path}: clock.signal: the offsets {_seconds(offset)} and {_seconds(other)} s are as good for "
                f"{clock['signal']}: it repeats itself, or the log is short; choose another signal, or give events"
            )
        return offset, f"offset {_seconds(offset)} s, by the correlation of {clock['signal']}, {correlation:.3f}"

    def _of_run(self, name: str) -> np.ndarray | None:
        """A signal (n, size) of the run."""
        if name == "push":
            if "f_normal" in self.run:
                return self.run["f_normal"].reshape(-1, 1)
            return np.maximum(0.0, -self.run["f_contact_W"][:, :1])
        return self.run[name].reshape(len(self.run["t"]), -1) if name in self.run else None

    def _notes(
        self,
        clock: str,
        offset: float,
        series: Mapping[str, list[Series]],
        gaps: Mapping[str, float],
        there: np.ndarray,
        arrays: Mapping[str, np.ndarray],
    ) -> tuple[str, ...]:
        notes = [f"measured: {self.file.name}, beside {Path(str(self.table['run'])).name}; its clock: {clock}"]
        if (early := -min(t[0] for parts in series.values() for t, _ in parts if len(t)) - offset) > 0.0:
            notes.append(f"the log begins {early:.4g} s before the run; this part is left out")
        if gaps:
            each = ", ".join(f"{name} {time:.3g} s" for name, time in gaps.items())
            notes.append(f"gaps: {each}; {np.count_nonzero(~there)} of {len(there)} rows are left out")
        empty = [
            f"{name}.{self.signals[name].components[i]}"
            for name, values in arrays.items()
            for i in np.flatnonzero(np.isnan(values).all(axis=0))
        ]
        if empty:
            notes.append(f"missing components: {', '.join(empty)}")
        notes.append(f"measured signals: {', '.join(arrays)}; the reference is the run's, and nothing else is known")
        return tuple(notes)

    def _filled(
        self, t: np.ndarray, arrays: dict[str, np.ndarray], steps: int, notes: tuple[str, ...]
    ) -> tuple[Header, np.ndarray]:
        """Header and rows with the measured signals, the reference, and the running signals of the push."""
        kept = {"t": t[:, None]} | {name: values for name, values in arrays.items() if name != "push"}
        if "push" in arrays and "f_contact_W" not in arrays:
            kept["f_contact_W"] = arrays["push"] * np.array([-1.0, 0.0, 0.0])
            if "f_normal" in self.header.by_name:
                kept["f_normal"] = np.maximum(0.0, arrays["push"])
        for name in _REFERENCE:
            of_run = self._of_run(name)
            if of_run is not None and name not in kept:
                kept[name] = np.stack([np.interp(t, self.run["t"], part) for part in of_run.T], axis=1)
        if "quat_WB" in kept:
            kept["quat_WB"] = kept["quat_WB"] / np.linalg.norm(kept["quat_WB"], axis=1, keepdims=True)
        if "f_contact_W" in kept or "f_normal" in kept:
            push = kept["f_normal"][:, 0] if "f_normal" in kept else np.maximum(0.0, -kept["f_contact_W"][:, 0])
            (above,) = self._each("touch_above", self.table.get("touch_above", _TOUCH), 1)
            kept |= running(t, push, above)
        known = dict(self.signals) | {s.name: s for s in RUNNING} | dict(self.header.by_name)
        signals = tuple(known[name] for name in kept)
        rest = self.header.rest if "f_contact_W" in kept else NoClosedForm("the log has no contact force")
        header = dataclasses.replace(
            self.header, signals=signals, row_steps=steps, notes=notes, engine=MEASURED, rest=rest
        )
        return header, np.concatenate(list(kept.values()), axis=1)


def _seconds(offset: float) -> str:
    """An offset [s] to a tenth of a millisecond."""
    return f"{round(float(offset), 4):.15g}"


def running(t: np.ndarray, push: np.ndarray, above: float) -> dict[str, np.ndarray]:
    """The running signals (n, 1) of a push (n,) [N] at times (n,) [s]; it touches above a push [N]."""
    touching = push > above
    begins = touching & ~np.concatenate([[False], touching[:-1]])
    first = np.where(np.cumsum(begins) > 0, t[int(np.argmax(begins))], -1.0)
    impulse = np.concatenate([[0.0], np.cumsum(0.5 * (push[1:] + push[:-1]) * np.diff(t))])
    late = t > t[-1] - FINAL_WINDOW_S - 1e-9
    found = {
        "force_peak": np.maximum.accumulate(push),
        "impulse": impulse,
        "touches": np.cumsum(begins).astype(float),
        "first_contact": first,
        "final_impulse": np.full(len(t), FINAL_WINDOW_S * float(push[late].mean())),
        "final_low": np.full(len(t), push[late].min()),
        "final_high": np.full(len(t), push[late].max()),
    }
    return {name: values[:, None] for name, values in found.items()}
