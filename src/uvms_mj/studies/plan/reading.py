"""A study file is read: its tables become the fields of a plan, or errors."""

import contextlib
import dataclasses
from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...errors import Fault, InputError
from ...files import plain
from ...scenario import Scenario
from .draws import design_faults, points, variation
from .entries import Law, absolute, base_of, laws_of, split_overrides, with_absolute_values
from .key_checks import KeyChecks, combination_faults
from .metric import COMPONENTS, column_is_taken, kept_column, metric_of
from .places import unit_of
from .study_file import Keep, Logs, StudyFile, read
from .success import limits

MOST_RUNS = 10_000_000
DEFAULT_WORST = 5
"""Number of logs of the worst runs."""


def fields_of(
    tables: Mapping[str, Any],
    folder: Path,
    overrides: Mapping[str, Any] | None,
    place: str,
    trusted: Container[str] | None = None,
) -> dict[str, Any]:
    """The fields of a :class:`.plan.Plan`, by name. The arguments are those of its ``from_dict`` and ``that_ran``; of a
    study that ran, which has ``trusted``, what needs its files is not checked again. Raises InputError with every error
    of the tables and the overrides."""
    ran = trusted is not None
    faults: list[Fault] = []
    changed, of_base = split_overrides(tables, overrides, faults)
    study = _completed(read(changed, faults), folder)
    base = base_of(study.base, folder, of_base, faults, trusted)
    left_out: list[str] = []
    laws = laws_of(study.laws, base, folder, faults, left_out, trusted) if base is not None else []
    variations = _variations(study.vary, faults)
    faults += combination_faults(variations, laws, of_base, _none(faults, "laws"))
    draws = 0
    notes: list[str] = []
    if len(variations) == len(study.vary) and _none(faults, "design"):
        draws, wrong, notes = design_faults(str(study.design.kind), variations, study.design.runs)
        faults += wrong
    runs = draws * len(laws) * study.design.repeats
    if runs > MOST_RUNS:
        faults.append(Fault("design", f"{runs} runs; at most {MOST_RUNS} are allowed"))
    varied = tuple(key for each in variations for key in each.keys)
    faults += [] if ran else _keep_faults(study.keep, runs, varied)
    success = limits(study.success, study.keep.metrics, folder, faults)
    drawn: tuple[tuple[Any, ...], ...] = ()
    if draws and _none(faults, "design"):
        drawn = points(str(study.design.kind), variations, draws, study.design.seed)
    faults += [] if ran else KeyChecks(variations, laws, drawn).faults()
    if faults or base is None:
        raise InputError(faults, place)
    design = study.design
    return {
        "name": study.name,
        "description": study.description,
        "tables": {**_tables(study, base, laws), "success": plain(success)},
        "base": base,
        "laws": tuple(laws),
        "variations": tuple(variations),
        "varied": varied,
        "units": {key: next((u for law in laws if (u := unit_of(key, law.scenario))), "") for key in varied},
        "points": drawn,
        "design": design.kind,
        "repeats": design.repeats,
        "seed": design.seed,
        "metrics": tuple(study.keep.metrics),
        "logs": study.keep.logs,
        "engine": study.run.engine,
        "tolerance": study.run.tolerance,
        "time_limit_s": study.run.time_limit_s,
        "success": success,
        "notes": (*left_out, *notes),
        "trusted": trusted,
    }


def _variations(tables: Sequence[Any], faults: list[Fault]) -> list[Any]:
    """The variations of ``[[vary]]`` that have no error."""
    variations = []
    for i, each in enumerate(tables):
        if not any(fault.key.startswith(f"vary[{i}]") for fault in faults):
            found = variation(each, f"vary[{i}]", faults)
            variations += [found] if found is not None else []
    return variations


def _none(faults: list[Fault], table: str) -> bool:
    """Whether no error is of a table."""
    return not any(fault.key.replace("[", ".").partition(".")[0] == table for fault in faults)


def _completed(study: StudyFile, folder: Path) -> StudyFile:
    """A study file with absolute paths, the kind of its design, and the number of the worst logs."""
    vary = [with_absolute_values(each, folder) for each in study.vary]
    grid = all(each.values is not None or each.number is not None for each in vary)
    design = dataclasses.replace(study.design, kind=study.design.kind or ("grid" if grid else "random"))
    metrics, logs = [absolute(name, folder) for name in study.keep.metrics], study.keep.logs
    if logs.kind == "worst" and logs.k is None:
        logs = dataclasses.replace(logs, k=DEFAULT_WORST)
    if logs.metric is not None:
        with contextlib.suppress(InputError):  # said with the other errors of keep
            logs = dataclasses.replace(logs, metric=kept_column(logs.metric, metrics, folder)[1])
    return dataclasses.replace(study, vary=vary, design=design, keep=Keep(metrics=metrics, logs=logs))


def _keep_faults(keep: Keep, runs: int, varied: Sequence[str]) -> Iterator[Fault]:
    """Errors of the table keep."""
    metrics, logs = keep.metrics, keep.logs
    for i, name in enumerate(metrics):
        try:
            if name in metrics[:i]:
                raise InputError(f"{name!r} is given twice")
            metric_of(name)
            if name not in COMPONENTS and column_is_taken(name, metrics[:i], varied):
                raise InputError(f"{name!r}: a column of the rows has this name already; rename the function")
        except InputError as error:
            yield from (Fault(f"keep.metrics[{i}]", fault.message) for fault in error.faults)
    used = {"worst": ("k", "metric"), "listed": ("indices",)}.get(logs.kind, ())
    for field in dataclasses.fields(Logs)[1:]:
        value = getattr(logs, field.name)
        if field.name not in used and value not in (None, []):
            yield Fault(f"keep.logs.{field.name}", f"has no effect for logs of kind {logs.kind!r}")
    if logs.kind == "worst":
        try:
            kept_column(str(logs.metric), metrics, Path())
        except InputError as error:
            yield from (Fault("keep.logs.metric", f"{logs.metric!r} {fault.message}") for fault in error.faults)
    if logs.kind == "listed" and not logs.indices:
        yield Fault("keep.logs.indices", "lists no run")
    for i, index in enumerate(logs.indices):
        if runs and index >= runs:
            yield Fault(f"keep.logs.indices[{i}]", f"no run {index}: the study has {runs} runs, from 0 to {runs - 1}")


def _tables(study: StudyFile, base: Scenario, laws: list[Law]) -> dict[str, Any]:
    """The tables of a plan, complete, with absolute paths."""
    return {
        "name": study.name,
        "description": study.description,
        "base": base.to_dict(),
        "laws": [{"name": law.source, "label": law.label, **plain(law.overrides)} for law in laws],
        **{table: plain(getattr(study, table)) for table in ("vary", "design", "keep", "run")},
    }
