"""Export of samples to CSV, Parquet, NPZ and MAT, with units."""

import itertools
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files import atomic_write
from .header import Column, Header

_MATLAB_LENGTH = 63


@dataclass(frozen=True)
class Choice:
    """The signals to export, and of some the components alone; by default everything."""

    header: Header
    recorded: Mapping[str, np.ndarray]
    components: Mapping[str, tuple[int, ...] | None]

    @classmethod
    def of(cls, header: Header, recorded: Mapping[str, np.ndarray], names: Sequence[str]) -> "Choice":
        """The choice of names of signals and of components, ``tau.x``, with t; of everything without a name. Raises
        InputError for an unknown name."""
        if not names:
            return cls(header, recorded, dict.fromkeys(recorded))
        found: dict[str, list[int] | None] = {"t": None}
        for name in names:
            signal, i = header.part(name)
            before = found.setdefault(signal.name, [])
            found[signal.name] = None if i is None or before is None else [*before, i]
        return cls(header, recorded, {name: None if parts is None else tuple(parts) for name, parts in found.items()})

    def columns(self) -> Iterator[Column]:
        """One column for each component."""
        for name, group in itertools.groupby(self.header.columns(self.recorded), key=lambda column: column.signal.name):
            if name in self.components:
                parts = self.components[name]
                yield from (column for i, column in enumerate(group) if parts is None or i in parts)

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """One array for each signal. Raises InputError for a component alone."""
        if alone := [name for name, parts in self.components.items() if parts is not None]:
            raise InputError(f"--signals: this format has whole signals; name {alone[0]} without a component")
        return {name: values for name, values in self.recorded.items() if name in self.components}


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
            scenario=np.array(chosen.header.scenario.to_toml()),
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
    extra = {"signals": about, "scenario": chosen.header.scenario.to_toml()}
    with open(path, "wb") as file:
        savemat(file, variables | extra, long_field_names=True, do_compression=True, oned_as="column")


def _about(chosen: Choice) -> dict[str, dict[str, str]]:
    """Unit, frame, meaning and components of each signal."""
    parts = chosen.header.components
    return {
        s.name: {"unit": s.unit, "frame": s.frame, "meaning": s.meaning, "components": " ".join(parts(s))}
        for s in chosen.header.signals
        if s.name in chosen.components
    }


WRITERS: dict[str, Callable[[Choice, Path], None]] = {"csv": _csv, "parquet": _parquet, "npz": _npz, "mat": _mat}
"""Writers by format. CSV has the units in the column names. Parquet has the unit, frame and meaning in each field's
metadata. NPZ and MAT have one array per signal, the units, frames and meanings in ``signals`` (JSON in NPZ, a struct in
MAT), and ``scenario`` in TOML."""


def export(
    header: Header,
    arrays: Mapping[str, np.ndarray],
    kind: str,
    path: Path,
    replace: bool = False,
    signals: Sequence[str] = (),
) -> None:
    """Write samples to a file in a format of :data:`WRITERS`. If writing fails, no file is left.

    Args:
        header: the header of the run.
        arrays: the samples by signal, each (n, ...).
        kind: the format.
        path: the file.
        replace: whether an existing file is replaced.
        signals: names of signals, or in CSV and Parquet of components, ``tau.x``; t is always there. Default: all.

    Raises:
        InputError: the file exists or can't be written, a signal is unknown, or the format does not allow the name of a
            state.
    """
    chosen = Choice.of(header, arrays, signals)
    if os.path.lexists(path) and not replace:
        raise InputError(f"{path}: exists; choose another name, or --force")
    with atomic_write(path) as part:
        WRITERS[kind](chosen, part)
