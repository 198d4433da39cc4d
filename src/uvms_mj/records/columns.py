"""The columns of a file that a real vehicle or another program wrote: a CSV, a Parquet file, or a log in MCAP. Each is
a series of times and numbers without missing samples."""

import csv
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, suggestion
from .mcap import read

Series = tuple[np.ndarray, np.ndarray]
"""Times and values of a column, without missing samples."""


@dataclass
class Columns:
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


def columns_of(path: Path, time: str | None, scale: float) -> Columns:
    """The columns of a file, whose column ``time`` has times that ``scale`` turns into seconds. Without a time, the
    rows of a table are numbered instead. Raises InputError, with file, column and row."""
    kind = path.suffix.lower()
    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    if kind == ".mcap":
        return _of_mcap(path)
    if kind not in (".csv", ".parquet"):
        raise InputError(f"{path}: the name of a log must end in .csv, .parquet or .mcap")
    plain = _plain(path) if kind == ".csv" else None
    names, cells, rows = plain or (_csv(path) if kind == ".csv" else _parquet(path))
    if time is not None and time not in names:
        raise InputError(f"{path}: has no column {time!r} of the time; {suggestion(time, names)}")
    if time is not None and list(names).count(time) > 1:
        raise InputError(f"{path}: {list(names).count(time)} columns are called {time!r}; rename them")
    numbers: dict[str, np.ndarray] = {}

    def column(name: str) -> np.ndarray:
        if name not in numbers:
            found = cells(name)
            if not isinstance(found, np.ndarray):
                found = np.array([_number(path, name, *each) for each in zip(rows, found, strict=True)], float)
            numbers[name] = found
        return numbers[name]

    t = np.arange(len(cells(names[0])), dtype=float) if time is None else column(time) * scale
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

    return Columns(path, names, of)


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


_Read = tuple[Sequence[str], Callable[[str], Sequence[Any] | np.ndarray], Sequence[int]]


def _plain(path: Path) -> _Read | None:
    """The same as :func:`_csv` of a file whose lines are one of names and then finite numbers, in a tenth of the time;
    None of any other file, in which something is missing, quoted or wrong, and has a place."""
    try:
        text = path.read_bytes()
        names = [name.strip() for name in text[: text.index(b"\n")].decode("utf-8-sig").split(",")]
        table = np.loadtxt(path, delimiter=",", skiprows=1, comments=None, encoding="utf-8-sig", ndmin=2)
    except (OSError, ValueError):
        return None
    lines = text.count(b"\n") + (not text.endswith(b"\n"))
    whole = len(table) > 1 and table.shape == (lines - 1, len(names)) and '"' not in "".join(names)
    if not (whole and np.isfinite(table).all()):
        return None
    return names, lambda name: table[:, names.index(name)].copy(), range(2, lines + 1)


def _csv(path: Path) -> _Read:
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


def _parquet(path: Path) -> _Read:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path}: can't read it as Parquet: {error}") from None
    return table.column_names, lambda name: table.column(name).to_pylist(), range(1, table.num_rows + 1)


def _of_mcap(path: Path) -> Columns:
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
                return Columns(path, list(own), lambda name: (own["t"], own[name]))
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
    return Columns(path, list(found), lambda name: (np.array(found[name][0]), np.array(found[name][1])))


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
