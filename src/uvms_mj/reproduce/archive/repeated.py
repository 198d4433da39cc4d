"""Differences between a repetition and its archive."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ...records.mcap import read
from ...studies.results import frame
from ..bench import results
from ..bench.task import RESULT
from .contents import LOG, RESULTS, ROWS, bare_rows

UNPACKED = "archive"
"""Folder of the output in which an archive is unpacked."""


def differences(kind: str, out: Path) -> list[str]:
    """The differences of the results in a folder from its unpacked archive of a kind; empty if they are equal."""
    then = out / UNPACKED / RESULTS
    if kind == "run":
        return _of_logs(then / LOG, out / LOG)
    if kind == "study":
        found = of_rows(pd.read_parquet(out / UNPACKED / ROWS), bare_rows(frame(out)))
        return found + _of_folders(then / "logs", out / "logs")
    if kind == "bench":
        return _of_bench((then / RESULT).read_bytes(), (out / RESULT).read_bytes())
    claims = [out / name for name in ("claims.json", "claims.csv") if (then / name).is_file()]
    found = [each.name for each in claims if each.read_bytes() != (then / each.name).read_bytes()]
    return found + _of_folders(then / "logs", out / "logs")


def _of_folders(then: Path, now: Path) -> list[str]:
    found = list[str]()
    for log in sorted(then.glob("*.mcap")):
        other = now / log.name
        each = _of_logs(log, other) if other.is_file() else ["is missing"]
        found += [f"{log.name}: {what}" for what in each]
    return found


def _of_logs(then: Path, now: Path) -> list[str]:
    """Samples are compared bit for bit, and the files of the logs, all but the wall time and the versions."""
    a, x, _, files = read(then)
    b, y, _, others = read(now)
    found = list[str]()
    if a.signals != b.signals or x.shape != y.shape:
        found.append("other signals or another number of samples")
    else:
        bits = x.view(np.uint64) != y.view(np.uint64)
        found += [_by(name, x[:, place], y[:, place]) for name, place in a.places.items() if bits[:, place].any()]
    names = sorted({*files, *others})
    return found + [name for name in names if _compared(name, files.get(name)) != _compared(name, others.get(name))]


def _by(name: str, then: np.ndarray, now: np.ndarray) -> str:
    """The name of a signal that differs, and by which part of its largest magnitude: rounding has some 1e-15."""
    size = np.abs(then[np.isfinite(then)]).max(initial=0.0)
    apart = np.abs(now - then)[then.view(np.uint64) != now.view(np.uint64)]  # a missing number equals itself
    if not np.isfinite(apart).all() or size == 0.0:
        return name
    return f"{name} by {apart.max() / size:.1g} of its largest magnitude"


def _compared(name: str, data: bytes | None) -> Any:
    """The part of a log's file that a repetition has again."""
    free = {"outcome.json": "wall_time_s", "run.json": "versions"}.get(name)
    if data is None or free is None:
        return data
    return {key: value for key, value in json.loads(data).items() if key != free}


def of_rows(then: pd.DataFrame, now: pd.DataFrame) -> list[str]:
    """Numbers are compared bit for bit."""
    if len(then) != len(now):
        return [f"{len(then)} rows then, {len(now)} now"]
    names = dict.fromkeys([*then.columns, *now.columns])
    return [
        _by(name, then[name].to_numpy(), now[name].to_numpy())
        if all(name in each.columns and each[name].dtype == np.float64 for each in (then, now))
        else name
        for name in names
        if name not in then.columns or name not in now.columns or _values(then[name]) != _values(now[name])
    ]


def _values(column: pd.Series) -> Any:
    """The values of a column, in which a missing one equals itself."""
    if column.dtype.kind == "f":
        return column.to_numpy().tobytes()
    return [None if pd.isna(value) else value for value in column]


def _of_bench(then: bytes, now: bytes) -> list[str]:
    """The differences in bench.json, but for the versions and for the digest, which covers them."""
    if then == now:
        return []
    a, b = results.parsed(then, RESULT), results.parsed(now, RESULT)
    found = [name for name in a if name not in ("digest", "laws", "code") and a[name] != b.get(name)]
    theirs: Mapping[str, Any] = {law["label"]: law for law in b["laws"]}
    for law in a["laws"]:
        other = theirs.get(law["label"], {})
        tasks = other.get("tasks", {})
        found += [
            f"{law['label']} on {task}: {_of_task(each, tasks.get(task, {}))}"
            for task, each in law["tasks"].items()
            if tasks.get(task) != each
        ]
        if {**law, "tasks": None} != {**other, "tasks": None}:
            found.append(f"{law['label']}: its settings or files")
    return found or (["its bytes, though no number"] if a["code"] == b["code"] else [])


def _of_task(then: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """What differs between two ladders of a law on a task: the level, or the numbers of draws alone."""
    if then.get("level") != now.get("level"):
        return f"level {then.get('level', '-')} then, {now.get('level', '-')} now"
    draws, others = ({} if not each.get("runs") else results.rows_of(each) for each in (then, now))
    other = sum(others.get(key) != row for key, row in draws.items())
    return f"the same level, other numbers in {other} of {len(draws)} draws"
