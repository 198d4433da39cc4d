"""Export of a trace to CSV, Parquet, NPZ and MAT, with units."""

import itertools
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files import atomic_write
from ..stages.signals import BAND
from .trace import Column, Trace

_MATLAB_LENGTH = 63


@dataclass(frozen=True)
class Choice:
    """The signals to export, and of some the components alone; by default everything."""

    trace: Trace
    components: Mapping[str, tuple[int, ...] | None]

    @classmethod
    def of(cls, trace: Trace, names: Sequence[str]) -> "Choice":
        """The choice of names of signals and of components, ``tau.x``, with t; of everything without a name. Raises
        InputError for an unknown name."""
        if not names:
            return cls(trace, dict.fromkeys(trace))
        found: dict[str, list[int] | None] = {"t": None}
        for name in names:
            signal, i = trace.header.part(name)
            before = found.setdefault(signal.name, [])
            found[signal.name] = None if i is None or before is None else [*before, i]
        return cls(trace, {name: None if parts is None else tuple(parts) for name, parts in found.items()})

    def columns(self) -> Iterator[Column]:
        """One column for each component."""
        for name, group in itertools.groupby(self.trace.columns(), key=lambda column: column.signal.name):
            if name in self.components:
                parts = self.components[name]
                yield from (column for i, column in enumerate(group) if parts is None or i in parts)

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """One array for each signal. Raises InputError for a component alone."""
        if alone := [name for name, parts in self.components.items() if parts is not None]:
            raise InputError(f"--signals: this format has whole signals; name {alone[0]} without a component")
        return {name: self.trace[name] for name in self.trace if name in self.components}


def _csv(chosen: Choice, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.csv

    table = pa.table({f"{column.name} [{column.unit}]": column.values for column in chosen.columns()})
    pyarrow.csv.write_csv(table, path, pyarrow.csv.WriteOptions(quoting_style="needed"))


def _parquet(chosen: Choice, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    columns = list(chosen.columns())
    fields = [
        pa.field(c.name, pa.float64(), metadata={"unit": c.unit, "frame": c.signal.frame, "meaning": c.signal.meaning})
        for c in columns
    ]
    pyarrow.parquet.write_table(pa.table([column.values for column in columns], schema=pa.schema(fields)), path)


def _npz(chosen: Choice, path: Path) -> None:
    with open(path, "wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            **chosen.arrays,
            signals=np.array(json.dumps(_about(chosen))),
            scenario=np.array(chosen.trace.scenario.to_toml()),
        )


def _mat(chosen: Choice, path: Path) -> None:
    from scipy.io import savemat

    # a MATLAB name can't begin with an underscore; scipy would omit such a variable silently
    arrays = chosen.arrays
    names = {name: name for name in arrays}
    for name in arrays:
        if name.startswith("_"):
            other = f"state{name}"
            while other in names.values():
                other += "_"
            names[name] = other
        if not name.isascii() or len(names[name]) > _MATLAB_LENGTH:
            raise InputError(
                f"the state {name!r} is not a MATLAB name (ASCII, at most {_MATLAB_LENGTH} characters); "
                "export to csv, parquet or npz"
            )
    variables = {names[name]: values for name, values in arrays.items()}
    about = {names[name]: facts for name, facts in _about(chosen).items()}
    extra = {"signals": about, "scenario": chosen.trace.scenario.to_toml()}
    with open(path, "wb") as file:
        savemat(file, variables | extra, long_field_names=True, do_compression=True, oned_as="column")


def _about(chosen: Choice) -> dict[str, dict[str, str]]:
    """Unit, frame, meaning and components of each signal."""
    parts = chosen.trace.header.components
    return {
        s.name: {"unit": s.unit, "frame": s.frame, "meaning": s.meaning, "components": " ".join(parts(s))}
        for s in chosen.trace.signals
        if s.name in chosen.components
    }


WRITERS: dict[str, Callable[[Choice, Path], None]] = {"csv": _csv, "parquet": _parquet, "npz": _npz, "mat": _mat}
"""Writers by format. CSV has the units in the column names. Parquet has the unit, frame and meaning in each field's
metadata. NPZ and MAT have one array per signal, the units, frames and meanings in ``signals`` (JSON in NPZ, a struct in
MAT), and ``scenario`` in TOML."""


_EXTREMES = (np.minimum, np.maximum)


def at_rate(trace: Trace, rate: float) -> Trace:
    """The rows of a trace at a rate [Hz] that divides its own, from t = 0 on, with the bands over all steps between
    them. Raises InputError for another rate."""
    recorded = 1.0 / (trace.header.row_steps * trace.scenario.simulation.timestep)
    every = round(recorded / rate) if rate > 0.0 else 0
    if every < 1 or abs(every * rate - recorded) > 1e-6 * recorded:
        above = max(1, int(recorded / rate)) if rate > 0.0 else 1
        near = [f"{recorded / n:.6g}" for n in (above + 1, above)] if 0.0 < rate < recorded else [f"{recorded:.6g}"]
        raise InputError(f"{rate:g} Hz does not divide the log's {recorded:.6g} Hz; the nearest: {' and '.join(near)}")
    steps = np.rint(trace.t / trace.scenario.simulation.timestep).astype(int)
    rows, kept = trace.rows(), np.flatnonzero(steps % (every * trace.header.row_steps) == 0)
    starts = np.concatenate([[0], kept[:-1] + 1])
    for name, extreme in ((edge, each) for edges in BAND.values() for edge, each in zip(edges, _EXTREMES, strict=True)):
        if name in trace.arrays and len(kept):
            place = trace.header.places[name]
            rows[kept, place] = extreme.reduceat(rows[: kept[-1] + 1, place], starts)
    return Trace.of(trace.header, rows[kept], trace.outcome)


def export(trace: Trace, kind: str, path: Path, replace: bool = False, signals: Sequence[str] = ()) -> None:
    """Write a trace to a file in a format of :data:`WRITERS`. If writing fails, no file is left.

    Args:
        trace: the trace.
        kind: the format.
        path: the file.
        replace: whether an existing file is replaced.
        signals: names of signals, or in CSV and Parquet of components, ``tau.x``; t is always there. Default: all.

    Raises:
        InputError: the file exists or can't be written, a signal is unknown, or the format does not allow the name of a
            state.
    """
    chosen = Choice.of(trace, signals)
    if os.path.lexists(path) and not replace:
        raise InputError(f"{path}: exists; choose another name, or --force")
    with atomic_write(path) as part:
        WRITERS[kind](chosen, part)
