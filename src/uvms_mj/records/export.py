"""Export of a trace to CSV, Parquet, NPZ and MAT, with units."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files import whole
from .trace import Trace

_MATLAB_LENGTH = 63


def _csv(trace: Trace, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.csv

    table = pa.table({f"{column.name} [{column.unit}]": column.values for column in trace.columns()})
    pyarrow.csv.write_csv(table, path, pyarrow.csv.WriteOptions(quoting_style="needed"))


def _parquet(trace: Trace, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    columns = list(trace.columns())
    fields = [
        pa.field(c.name, pa.float64(), metadata={"unit": c.unit, "frame": c.signal.frame, "meaning": c.signal.meaning})
        for c in columns
    ]
    pyarrow.parquet.write_table(pa.table([column.values for column in columns], schema=pa.schema(fields)), path)


def _npz(trace: Trace, path: Path) -> None:
    with open(path, "wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            **trace.arrays,
            signals=np.array(json.dumps(_about(trace))),
            scenario=np.array(trace.scenario.to_toml()),
        )


def _mat(trace: Trace, path: Path) -> None:
    from scipy.io import savemat

    # a MATLAB name can't begin with an underscore; scipy would omit such a variable silently
    names = {name: name for name in trace}
    for name in trace:
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
    variables = {names[name]: np.asarray(trace[name]) for name in trace}
    about = {names[name]: facts for name, facts in _about(trace).items()}
    extra = {"signals": about, "scenario": trace.scenario.to_toml()}
    with open(path, "wb") as file:
        savemat(file, variables | extra, long_field_names=True, do_compression=True, oned_as="column")


def _about(trace: Trace) -> dict[str, dict[str, str]]:
    """Unit, frame, meaning and components of each signal."""
    parts = trace.header.components
    return {
        s.name: {"unit": s.unit, "frame": s.frame, "meaning": s.meaning, "components": " ".join(parts(s))}
        for s in trace.signals
    }


WRITERS: dict[str, Callable[[Trace, Path], None]] = {"csv": _csv, "parquet": _parquet, "npz": _npz, "mat": _mat}
"""Writers by format. CSV has the units in the column names. Parquet has the unit, frame and meaning in each field's
metadata. NPZ and MAT have one array per signal, the units, frames and meanings in ``signals`` (JSON in NPZ, a struct in
MAT), and ``scenario`` in TOML."""


def export(trace: Trace, kind: str, path: Path, replace: bool = False) -> None:
    """Write a trace to a file in a format of :data:`WRITERS`. If writing fails, no file is left. Raises InputError if
    the file exists or can't be written, or the format does not allow the name of a state."""
    if os.path.lexists(path) and not replace:
        raise InputError(f"{path}: exists; choose another name, or --force")
    with whole(path) as part:
        WRITERS[kind](trace, part)
