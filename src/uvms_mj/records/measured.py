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

The clock of the log is ``offset`` behind that of the run: t_run = t_log + offset. A shared signal gives the offset of
the greatest correlation of the samples that both have, refined by a parabola.
"""

import csv
import dataclasses
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..control.base import NoClosedForm
from ..errors import InputError, suggestion
from ..files import tables_of
from ..physics.frames import quat_from_euler_deg
from ..stages.signals import FINAL_WINDOW_S, RUNNING, Signal, pulse_signal
from .header import MEASURED, Header, Outcome, Status
from .mcap import read

_GAP = 2.5
"""Times the median distance of two samples from which there is a gap between them."""
_LEAST = 0.5
"""Least correlation of a shared signal with which clocks are aligned, and least share of the shorter record that both
must have."""
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
Series = tuple[np.ndarray, np.ndarray]
"""Times and values of a column, without missing samples."""


def load(path: str | os.PathLike) -> tuple[Header, np.ndarray, Outcome]:
    """Header, rows (n, width) and outcome of the log that a table in TOML describes. Raises InputError, with file,
    column and row."""
    return _Log(Path(path)).trace()


@dataclass
class _Columns:
    """The columns of a file by name: each a function that reads it."""

    path: Path
    names: Sequence[str]
    of: Callable[[str], Series]

    def __getitem__(self, name: str) -> Series:
        if name not in self.names:
            raise InputError(f"{self.path}: has no column {name!r}; {suggestion(name, self.names)}")
        if (n := list(self.names).count(name)) > 1:
            raise InputError(f"{self.path}: {n} columns are called {name!r}; rename them")
        t, values = self.of(name)
        if len(t) < 2:
            raise InputError(f"{self.path}: column {name!r} has fewer than two samples")
        return t, values


def _columns(path: Path, time: str, scale: float) -> _Columns:
    kind = path.suffix.lower()
    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    if kind == ".mcap":
        return _of_mcap(path)
    if kind not in (".csv", ".parquet"):
        raise InputError(f"{path}: the name of a log must end in .csv, .parquet or .mcap")
    names, cells, rows = _csv(path) if kind == ".csv" else _parquet(path)
    if time not in names:
        raise InputError(f"{path}: has no column {time!r} of the time; {suggestion(time, names)}")
    if list(names).count(time) > 1:
        raise InputError(f"{path}: {list(names).count(time)} columns are called {time!r}; rename them")
    numbers: dict[str, np.ndarray] = {}

    def column(name: str) -> np.ndarray:
        if name not in numbers:
            numbers[name] = np.array(
                [_number(path, name, *each) for each in zip(rows, cells(name), strict=True)], float
            )
        return numbers[name]

    t = column(time) * scale
    if (gone := np.flatnonzero(np.isnan(t))).size:
        raise InputError(f"{path}: column {time!r}, row {rows[gone[0]]}: the time is missing")
    if (back := np.flatnonzero(np.diff(t) <= 0.0)).size:
        i = int(back[0]) + 1
        raise InputError(
            f"{path}: column {time!r}, row {rows[i]}: the time goes back or stands still, {t[i]:.9g} s after "
            f"{t[i - 1]:.9g} s"
        )

    def of(name: str) -> Series:
        values = column(name)
        there = ~np.isnan(values)
        return t[there], values[there]

    return _Columns(path, names, of)


def _number(path: Path, name: str, row: int, cell: Any) -> float:
    """The number in a cell; NaN for a missing sample. A NaN that is written there is an error."""
    if cell is None or (isinstance(cell, str) and not cell.strip()):
        return math.nan
    try:
        value = float(cell if "_" not in str(cell) else "")  # Python reads 1_0 as ten
    except (TypeError, ValueError):
        raise InputError(f"{path}: column {name!r}, row {row}: {str(cell)[:40]!r} is not a number") from None
    if not math.isfinite(value):
        raise InputError(f"{path}: column {name!r}, row {row}: {value:g} is not finite; leave a missing sample empty")
    return value


def _csv(path: Path) -> tuple[Sequence[str], Callable[[str], Sequence[Any]], Sequence[int]]:
    """Names of columns, a function for the cells of one, and the numbers of its rows in the file, from 1. Blank
    lines are left out."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            lines = enumerate(csv.reader(file), 1)
            table = [(i, row) for i, row in lines if row and (len(row) > 1 or row[0].strip())]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: can't read it as CSV: {error}") from None
    if len(table) < 3:
        raise InputError(f"{path}: has fewer than two rows below its names of columns")
    rows, (first, *body) = zip(*table, strict=True)
    names = [name.strip() for name in first]
    if len(names) == 1 and (other := next((each for each in ";\t|" if each in names[0]), "")):
        raise InputError(f"{path}: its cells are separated by {other!r}; write it with commas, and points in numbers")
    for i, row in zip(rows[1:], body, strict=True):
        if len(row) != len(names):
            raise InputError(f"{path}: row {i}: has {len(row)} cells, and the first row names {len(names)} columns")
    return names, lambda name: [row[names.index(name)] for row in body], rows[1:]


def _parquet(path: Path) -> tuple[Sequence[str], Callable[[str], Sequence[Any]], Sequence[int]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path}: can't read it as Parquet: {error}") from None
    return table.column_names, lambda name: table.column(name).to_pylist(), range(1, table.num_rows + 1)


def _of_mcap(path: Path) -> _Columns:
    """A log of this project by the components of its signals, ``p_WB.x``; another one by topic and field of its
    messages in JSON, ``/load.force.x``, at their log time."""
    from mcap.exceptions import McapError
    from mcap.reader import make_reader

    with open(path, "rb") as file:
        try:
            reader = make_reader(file)
            if reader.get_header().library.startswith("uvms-mj") or reader.get_header().profile == "ros2":
                header, rows, *_ = read(path)
                arrays = {s.name: rows[:, header.places[s.name]].reshape(-1, *s.shape) for s in header.signals}
                own = {column.name: column.values for column in header.columns(arrays)}
                return _Columns(path, list(own), lambda name: (own["t"], own[name]))
            found: dict[str, tuple[list[float], list[float]]] = {}
            for _, channel, message in reader.iter_messages():
                if channel.message_encoding != "json":
                    encoding = f"the messages of {channel.topic} are in {channel.message_encoding or 'no encoding'}"
                    raise InputError(f"{path}: {encoding}, and only JSON is read; export them as CSV or Parquet")
                for name, value in _leaves(json.loads(message.data), channel.topic):
                    t, values = found.setdefault(name, ([], []))
                    t.append(1e-9 * message.log_time)
                    values.append(_number(path, name, len(t), value))
        except (McapError, ValueError, OSError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"{path}: can't read it as MCAP: {error}") from None
    for name, (t, _) in found.items():
        if (back := np.flatnonzero(np.diff(t) <= 0.0)).size:
            raise InputError(f"{path}: column {name!r}, row {back[0] + 2}: the time goes back or stands still")
    return _Columns(path, list(found), lambda name: (np.array(found[name][0]), np.array(found[name][1])))


def _leaves(value: Any, name: str) -> Iterator[tuple[str, float]]:
    """The numbers in a message by dotted names."""
    if isinstance(value, Mapping):
        for key, each in value.items():
            yield from _leaves(each, f"{name}.{key}")
    elif isinstance(value, list):
        for i, each in enumerate(value):
            yield from _leaves(each, f"{name}.{i}")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield name, value


class _Log:
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
        self.table, self.file = table, path.parent / str(table["log"])
        time = table.get("time", {"column": "t"})
        self._known("time", time, ("column", "unit"))
        scale = self._factor("time.unit", time.get("unit", "s"), "s")
        header, rows, *_ = read(path.parent / str(table["run"]))
        self.header = header
        self.run = {s.name: rows[:, header.places[s.name]].reshape(-1, *s.shape) for s in header.signals}
        self.columns = _columns(self.file, str(time.get("column", "t")), scale)

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

    def trace(self) -> tuple[Header, np.ndarray, Outcome]:
        series = {name: self._series(name) for name in self.table["signals"]}
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
                missing = _in_gap(t, at)
                if missing.any():
                    gaps[name] = float(missing.sum() * steps * h)
                    there &= ~missing
            arrays[name] = np.stack(values, axis=1)
        if there.sum() < 2:
            raise InputError(f"{self.file}: the signals have no two samples in common between their gaps")
        arrays = {name: values[there] for name, values in arrays.items()}
        header, rows = self._filled(grid[there], arrays, steps, self._notes(said, offset, series, gaps, there, arrays))
        return header, rows, Outcome(Status.completed, "", round(float(grid[there][-1]) / h), 0.0)

    def _series(self, name: str) -> list[Series]:
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
        angles = signal.size == 4 and table.get("unit") in ("rad", "deg")
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
        if signal.size == 4 and any(offsets):
            raise InputError(f"{path}: {key}.offset: an attitude has none; a sum of quaternions is no turn")
        if any(sign not in (1, -1) for sign in signs):
            raise InputError(f"{path}: {key}.sign: {table['sign']!r} must be 1 or -1, or a list of them")
        return [(t, s * v + o) for (t, v), s, o in zip(turned, signs, offsets, strict=True)]

    @property
    def signals(self) -> dict[str, Signal]:
        """The signals that a log may have by name: those of the run, ``push`` and the pulse widths."""
        n = self.header.by_name["u"].size
        return {"push": _PUSH, "pwm": pulse_signal(n)} | {
            name: s for name, s in self.header.by_name.items() if s.kind == "f8" and s not in RUNNING and name != "t"
        }

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
        if signal.size == 4:
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
        offset, correlation = aligned(series[name][i], (self.run["t"], theirs[:, i]))
        if math.isnan(correlation):
            raise InputError(
                f"{self.path}: clock.signal: {clock['signal']} does not move, or too few samples of it are in a stretch"
                " as long as half of the shorter record; is time.unit right? Else give events or offset"
            )
        if not correlation >= _LEAST:
            raise InputError(
                f"{self.path}: clock.signal: {clock['signal']} of the log and of the run do not agree, their greatest "
                f"correlation is {correlation:.2f}; choose another signal, or give events"
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
        notes.append(
            f"measured signals: {', '.join(arrays)}; the reference is that of the run, and nothing else is known"
        )
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
        known = self.signals | {s.name: s for s in RUNNING} | dict(self.header.by_name)
        signals = tuple(known[name] for name in kept)
        rest = self.header.rest if "f_contact_W" in kept else NoClosedForm("the log has no contact force")
        header = dataclasses.replace(
            self.header, signals=signals, row_steps=steps, notes=notes, engine=MEASURED, rest=rest
        )
        return header, np.concatenate(list(kept.values()), axis=1)


def _seconds(offset: float) -> str:
    """An offset [s] to a tenth of a millisecond."""
    return f"{round(float(offset), 4):.15g}"


def _in_gap(t: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Whether times lie between two samples that are further apart than :data:`_GAP` of them usually are."""
    if len(t) < 2:
        return np.zeros(len(at), bool)
    apart = np.diff(t)
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(apart) - 1)
    on = (np.abs(at - t[k]) < 1e-9) | (np.abs(at - t[k + 1]) < 1e-9)
    return (apart[k] > _GAP * np.median(apart)) & ~on


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


def aligned(ours: Series, theirs: Series) -> tuple[float, float]:
    """The offset [s] that is added to our times, with the greatest correlation of two records, and this correlation.

    Both are sampled at the smaller of their usual distances; samples in gaps do not count. At least half of the shorter
    record must be in both, and eight samples of each. NaN if no offset has a correlation.
    """
    dt, coarse = sorted(float(np.median(np.diff(t))) for t, _ in (ours, theirs))
    if min(t[-1] - t[0] for t, _ in (ours, theirs)) < 7.0 * coarse:
        return 0.0, math.nan
    (x, m), (y, w) = (_sampled(t, v, dt) for t, v in (ours, theirs))
    size = 1 << (len(x) + len(y) - 1).bit_length()
    X, M, Y, W, XX, YY = (np.fft.rfft(each, size) for each in (x, m, y, w, x * x, y * y))

    def crossed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.fft.irfft(np.conj(a) * b, size)

    n = np.maximum(crossed(M, W), 0.0)
    enough = n >= max(_LEAST * min(m.sum(), w.sum()), 8.0 * coarse / dt)
    n = np.where(enough, n, 1.0)
    sum_x, sum_y = crossed(X, W), crossed(M, Y)
    variance = np.maximum((crossed(XX, W) - sum_x**2 / n) * (crossed(M, YY) - sum_y**2 / n), 0.0)
    scale = np.sqrt(variance)
    whole = np.sqrt((x * x).sum() * (y * y).sum())
    usable = enough & (scale > 1e-6 * whole)
    r = np.where(usable, (crossed(X, Y) - sum_x * sum_y / n) / np.where(usable, scale, 1.0), -np.inf)
    k = int(np.argmax(r))
    if not np.isfinite(r[k]):
        return 0.0, math.nan
    before, at, after = r[k - 1], r[k], r[(k + 1) % size]
    bend = before - 2.0 * at + after
    fine = 0.5 * (before - after) / bend if np.isfinite(bend) and bend < 0.0 else 0.0
    lag = (k if k < len(y) else k - size) + fine
    return float(theirs[0][0] - ours[0][0] + lag * dt), float(min(r[k], 1.0))


def _sampled(t: np.ndarray, values: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """A record at equal times from its first one on, about its mean, and 1 where it is known; 0 in gaps."""
    at = t[0] + dt * np.arange(int((t[-1] - t[0]) / dt + 1e-9) + 1)
    known = np.where(_in_gap(t, at), 0.0, 1.0)
    return (np.interp(at, t, values) - values.mean()) * known, known
