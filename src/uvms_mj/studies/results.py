"""The folder of a study: study.toml, version.json, rows/part-00000.parquet, check.parquet and logs/.

A part has the rows of one block of consecutive runs. The plan alone decides the blocks. A file gets its name when it is
whole and on the disk, so that a part that exists is done, and an interrupted study goes on with the missing ones.
:func:`dataset` has the rows as an xarray Dataset.
"""

import contextlib
import hashlib
import json
import math
import operator
import os
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import tomli_w

from ..errors import InputError
from ..files import parsed_toml, tables_of, text_of
from ..quantities import leaves
from .bundle import changed_files
from .plan.metrics import AFTER, BEFORE, COMPLETED, columns_of, number_of, unit_of_column

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from .bundle import StudyBundle
    from .plan import Plan

STUDY, TUNING, VERSION = "study.toml", "tune.toml", "version.json"
_NOUNS = {STUDY: "study", TUNING: "tuning"}
_MOST_PARTS = 1000
_TYPES = {float: pa.float64(), int: pa.int64(), bool: pa.bool_(), str: pa.string()}


def blocks(runs: int) -> list[range]:
    """The runs of each part."""
    size = max(1, math.ceil(runs / _MOST_PARTS))
    return [range(start, min(start + size, runs)) for start in range(0, runs, size)]


def schema_of(plan: "Plan") -> pa.Schema:
    """The columns of the rows, without the columns of a user's metrics, whose names are known when they have run."""
    varied = {key: _type([point[i] for point in plan.points]) for i, key in enumerate(plan.varied)}
    metrics = {
        column: number.kind for place in plan.metrics if (number := number_of(place)) for column in columns_of(place)
    }
    kinds = {**BEFORE, **varied, **AFTER, **metrics}
    return pa.schema([(column, _TYPES.get(kind, kind)) for column, kind in kinds.items()])


def _type(values: list[Any]) -> pa.DataType:
    """The type of a column with these values; numbers are float64 unless all are integers. Values of several kinds,
    lists and tables are texts."""
    try:
        found = pa.array(values).type
    except pa.ArrowException:  # of several kinds
        return pa.string()
    return found if found in _TYPES.values() else pa.string()


def in_a_column(value: Any) -> Any:
    """A value as a column of texts has it: a text as it is, anything else as JSON, ``[1.0, 0.0]``. Lists as such would
    be of no use in groups, axes and CSV, and Arrow names what is inside them otherwise when it reads them again."""
    return value if value is None or isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)


class StudyFolder:
    """The folder of a study while it runs.

    Attributes:
        folder: the folder.
        damaged: names of the parts that were found damaged and are redone.
    """

    def __init__(self, folder: Path, plan: "Plan", bundle: "StudyBundle") -> None:
        """Raises InputError if the folder has another study."""
        self.folder, self._schema, self._digest = folder, schema_of(plan), bundle.digest
        self.damaged: list[str] = []
        self.blocks = blocks(plan.runs)
        self._begun = (folder / STUDY, plan.tables, about_of(plan, bundle))
        refuse_another(*self._begun)

    def begin(self) -> None:
        """Begin the study in the folder, or go on with it."""
        begin(*self._begun)
        for place in (self.folder / "rows", self.folder / "logs"):
            place.mkdir(parents=True, exist_ok=True)
            for left in place.glob(".*.new"):  # by a process that was killed
                left.unlink()

    def statuses(self, i: int) -> list[str]:
        """The statuses of the rows of a block that is done; empty without a sound part."""
        path = self.part(i)
        if not path.exists():
            return []
        with contextlib.suppress(OSError, ValueError, pa.ArrowException):
            table = read(path)
            mine = (table.schema.metadata or {}).get(b"study") == self._digest.encode()
            if mine and table["index"].to_pylist() == list(self.blocks[i]):
                return table["status"].to_pylist()
        self.damaged.append(path.name)
        return []

    def part(self, i: int) -> Path:
        return self.folder / "rows" / f"part-{i:05d}.parquet"

    def log(self, index: int, vehicle: str = "") -> Path:
        """The log of a run, in a world of one vehicle."""
        return self.folder / "logs" / f"row-{index:05d}{f'.{vehicle}' if vehicle else ''}.mcap"

    def write(self, i: int, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write the part of a block. Raises OSError, for example if the disk is full."""
        known = set(self._schema.names)
        own = dict.fromkeys(column for row in rows for column in row if column not in known)
        schema = pa.schema([*self._schema, *((column, pa.float64()) for column in own)])
        texts = [field.name for field in schema if field.type == pa.string()]
        whole = [{**row, **{column: in_a_column(row.get(column)) for column in texts}} for row in rows]
        table = pa.Table.from_pylist(whole, schema=schema)
        table = table.replace_schema_metadata({"study": self._digest, "rows": _checksum(table)})
        put(self.part(i), lambda file: pq.write_table(table, file, compression="zstd", write_page_checksum=True))

    def finish(self) -> None:
        """Give all parts the same columns: a part whose runs all failed lacks the columns of a user's metrics."""
        each = [pq.read_schema(self.part(i)).names for i in range(len(self.blocks))]
        names = dict.fromkeys(name for found in each for name in found)
        for i, found in enumerate(each):
            if found != list(names):
                rows = read(self.part(i)).to_pylist()
                self.write(i, [{name: row.get(name) for name in names} for row in rows])


def begin(path: Path, tables: Mapping[str, Any], about: Mapping[str, Any]) -> None:
    """Write the file of a study or of a tuning, and version.json before it: a folder that has the file was begun. The
    arguments are as for :func:`refuse_another`, which comes first."""
    for each, text in ((path.with_name(VERSION), json.dumps(about, indent=1)), (path, tomli_w.dumps(tables))):
        data = text.encode()
        if not each.exists() or each.read_bytes() != data:
            put(each, operator.methodcaller("write", data))


def refuse_another(path: Path, tables: Mapping[str, Any], about: Mapping[str, Any], *free: str) -> None:
    """Raise InputError if a folder was begun with another study or tuning.

    Args:
        path: the file of this one in the folder, study.toml or tune.toml.
        tables: its contents.
        about: the contents of version.json, of :func:`about_of`.
        free: keys that may differ.
    """
    folder = path.parent
    begun = [name for name in _NOUNS if (folder / name).exists()]
    if begun and path.name not in begun:
        raise InputError(f"{folder}: has the results of a {_NOUNS[begun[0]]}; choose another folder")
    if begun or any(folder.glob("rows/part-*.parquet")):
        check_same(path, tables, about, free)


def share_done(folder: Path, plan: "Plan") -> float:
    """Share of a study's blocks that have a part in a folder."""
    parts = len(list((folder / "rows").glob("part-*.parquet")))
    return min(1.0, parts / len(blocks(plan.runs)))


def about_of(plan: "Plan", bundle: "StudyBundle") -> dict[str, Any]:
    """The contents of version.json: what a folder was begun with."""
    files = {name: hashlib.sha256(data).hexdigest() for name, data in sorted(bundle.files.items())}
    return {
        "study": bundle.digest,
        "engine": plan.engine,
        "code": dict(bundle.code),
        "files": files,
        "units": {key: unit for key, unit in plan.units.items() if unit},
    }


def version_of(folder: Path) -> dict[str, Any]:
    """The contents of version.json. Raises InputError if they can't be read."""
    try:
        found = json.loads((folder / VERSION).read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(f"{folder}: has results that can't be read: {error}") from None
    tables = [found.get(name) for name in ("code", "files", "units")] if isinstance(found, dict) else [None]
    if not all(isinstance(each, dict) and all(isinstance(x, str) for x in each.values()) for each in tables):
        raise InputError(f"{folder / VERSION}: is of no study: it has no tables code, files and units of texts")
    if not isinstance(found.get("study"), str):
        raise InputError(f"{folder / VERSION}: is of no study: it has no digest, study")
    return dict(found)


def units_of(folder: Path, keys: Sequence[str]) -> dict[str, str]:
    """The units of keys that version.json of a folder has: units of gains of a user's law need its class."""
    try:
        found = version_of(folder)["units"]
    except InputError:
        return {}
    units = {key: found[key] for key in keys if key in found}
    return {key: unit for key, unit in units.items() if unit.isprintable() and len(unit) < 40}


def check_same(path: Path, tables: Mapping[str, Any], about: Mapping[str, Any], free: Sequence[str] = ()) -> None:
    """Raise InputError unless a folder has the same file, begun with the same code and files. The file at ``path`` was
    written from the tables of its study; nothing that it names is imported. Keys in ``free`` may differ."""
    folder, noun = path.parent, _NOUNS[path.name]
    then = version_of(folder)
    try:
        before = parsed_toml(text_of(path))
    except (OSError, ValueError) as error:
        raise InputError(f"{folder}: has results that can't be read: {error}; choose another folder") from None
    if not before:
        raise InputError(f"{path}: is empty; choose another folder")
    old, new = (dict(leaves(each)) for each in (before, tomllib.loads(tomli_w.dumps(tables))))
    keys = [key for key in {**old, **new} if key not in free and old.get(key) != new.get(key)]
    if keys:
        its_name = before.get("name")
        differs = f"contains the {noun} {its_name!r}, which differs in {', '.join(keys[:8])}"
        raise InputError(f"{folder}: {differs}; choose another folder")
    code, files = changes(then, about)
    if code:
        raise InputError(f"{folder}: was begun with other code: {'; '.join(code)}; choose another folder")
    if then["study"] != about["study"]:
        raise InputError(_changed(path, files))


def refuse_changed(path: Path) -> None:
    """Raise InputError if a file that the study or the tuning of a folder names is not what it was when it began, by
    study.toml or tune.toml in it. Nothing is imported."""
    then = version_of(path.parent)["files"]
    texts = {value for _, value in leaves(tables_of(path, _NOUNS[path.name])) if isinstance(value, str)}
    if files := sorted({file for text in texts for file in changed_files(text, then)}):
        raise InputError(_changed(path, files))


def _changed(path: Path, files: Sequence[str]) -> str:
    what = f"since its {_NOUNS[path.name]} began, {', '.join(files)} changed"
    return f"{path.parent}: {what}; choose another folder"


def changes(then: Mapping[str, Any], now: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Versions that differ between two version.json, each with both, and the names of the files that differ."""

    def differing(table: str) -> list[str]:
        return [name for name in {**then[table], **now[table]} if then[table].get(name) != now[table].get(name)]

    versions = [f"{x} {then['code'].get(x)} then, {now['code'].get(x)} now" for x in differing("code")]
    return versions, [Path(name).name for name in differing("files")]


def put(path: Path, write: Callable[[IO[bytes]], Any]) -> None:
    """Write a file that gets its name when it is whole and on the disk, also after a loss of power."""
    part = path.with_name(f".{path.name}.new")
    try:
        with part.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            part.unlink()
        raise
    place = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(place)
    finally:
        os.close(place)


def read(path: Path) -> pa.Table:
    """Read a part. Raises OSError, ValueError or pyarrow's errors, which are among them, if it is damaged."""
    with pq.ParquetFile(path, page_checksum_verification=True) as file:
        table = file.read(use_threads=False)
    if (table.schema.metadata or {}).get(b"rows") != _checksum(table).encode():
        raise ValueError("its rows do not have their checksum")
    return table


def _checksum(table: pa.Table) -> str:
    """Checksum of names, types and values. Parquet's own are of its pages alone, not of the names of the columns."""
    digest = hashlib.sha256(str(table.schema.remove_metadata()).encode())
    for column in table.columns:
        values = column.to_numpy()
        digest.update(repr(values.tolist()).encode() if values.dtype == object else values.tobytes())
    return digest.hexdigest()[:32]


def frame(folder: Path) -> "pd.DataFrame":
    """The rows that a study's folder has, sorted by index. Raises InputError if it has none, or a part is damaged, of
    another study, or a copy."""
    tables, study = [], None
    with contextlib.suppress(InputError):
        study = version_of(folder)["study"].encode()
    for path in sorted((folder / "rows").glob("part-*.parquet")):
        try:
            tables.append(read(path))
        except (OSError, ValueError, pa.ArrowException) as error:
            again = "without it the command that began the study computes its rows again"
            raise InputError(f"{path}: damaged ({error}); {again}") from None
        study = study or tables[-1].schema.metadata[b"study"]
        if tables[-1].schema.metadata[b"study"] != study:
            raise InputError(f"{path}: is a part of another study")
    if not tables:
        raise InputError(f"{folder}: has no rows yet")
    whole = pa.concat_tables(tables, promote_options="default").replace_schema_metadata().to_pandas()
    if (twice := whole["index"][whole["index"].duplicated()]).size:
        raise InputError(f"{folder / 'rows'}: two parts have the row {twice.iloc[0]}: one is a copy")
    return whole


NOT_DONE = "not done"
"""Status of a run without a row."""


def dataset(plan: "Plan", frame: "pd.DataFrame") -> "xr.Dataset":
    """The metrics, status, steps and engine of a study over its design, law and repeat.

    The dimensions of a grid are its varied keys; of keys that move together, the first is the dimension and the others
    are coordinates on it. Other designs have the dimension ``draw`` with the keys as coordinates. Units are attributes.
    A metric is nan, or None if it is a text, where the run did not complete or is not done; the status tells.
    """
    import xarray as xr

    axes, coordinates = _design(plan)
    dims = (*axes, "law", "repeat")
    shape = (*axes.values(), len(plan.laws), plan.repeats)
    rows = frame.set_index("index").drop(columns=[*(name for name in BEFORE if name != "index"), *plan.varied])
    completed = rows["status"] == COMPLETED
    rows = rows.apply(
        lambda column: column if column.name in AFTER and column.name != "success" else column.where(completed)
    )
    rows = rows.reindex(range(plan.runs)).fillna({"status": NOT_DONE})
    variables: dict[str, Any] = {name: (dims, _plain(column).reshape(shape)) for name, column in rows.items()}
    found = xr.Dataset(
        variables,
        coordinates | {"law": [law.label for law in plan.laws], "repeat": np.arange(plan.repeats)},
        {"name": plan.name, "description": plan.description, "design": plan.design, "seed": plan.seed},
    )
    for each in plan.variations:
        for key in each.places:
            found[key].attrs |= {"units": plan.units[key], "laws": list(each.laws or found["law"].values)}
    for name in variables:
        found[name].attrs["units"] = unit_of_column(name)
    return found


def _plain(column: "pd.Series") -> np.ndarray:
    """Texts with None for missing ones; numbers and flags as floats with nan."""
    if AFTER.get(column.name) is str or column.map(lambda value: isinstance(value, str)).any():
        return column.astype(object).where(column.notna(), None).to_numpy()
    return column.to_numpy(dtype=float, na_value=np.nan)


def _design(plan: "Plan") -> tuple[dict[str, int], dict[str, Any]]:
    """Sizes of the dimensions by name, and coordinates. The last dimension of a grid changes fastest."""
    if plan.design != "grid":
        keys = {key: ("draw", _coordinate([point[i] for point in plan.points])) for i, key in enumerate(plan.varied)}
        return {"draw": plan.draws}, keys | {"draw": np.arange(plan.draws)}
    coordinates = {
        key: (each.places[0], _coordinate([level[i] for level in each.levels]))
        for each in plan.variations
        for i, key in enumerate(each.places)
    }
    return {each.places[0]: len(each.levels) for each in plan.variations}, coordinates


def _coordinate(values: Sequence[Any]) -> np.ndarray:
    """Values as an array, as their column of the rows has them."""
    return np.array([in_a_column(value) for value in values] if _type(list(values)) == pa.string() else values)
