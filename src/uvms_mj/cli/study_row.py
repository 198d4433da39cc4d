"""``uvms-mj run --from DIR --row N``: the scenario and the engine of one run of a study."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import warn

if TYPE_CHECKING:
    from ..scenario import Scenario


def row_of(folder: str, row: int, overrides: dict[str, Any], controller: str | None) -> "tuple[Scenario, str]":
    """Scenario and engine of a run of a study, by the study's folder and the run's row.

    The engine is that of the row, or of a run that is not done yet the one that the study would choose. Of the files
    that the study names only those of the row are imported, and only if they have not changed. Warns if the code has
    changed. Raises InputError if there is no such run, or one of its files has changed, which is a warning if a law,
    another stage or the vehicle is named anew.
    """
    from ..errors import InputError
    from ..studies.plan import Plan
    from ..studies.pool.parcel import Parcel, changed_files
    from ..studies.results import STUDY, about_of, changes, version_of
    from ..studies.rows import chosen_engine
    from ..studies.study import Study

    if not Path(folder).is_dir():
        raise InputError(f"--row is a run of a study: --from {folder} must be the study's folder")
    plan = Study.load(folder).plan_of_results
    if not 0 <= row < plan.runs:
        raise InputError(f"--row {row}: the study in {folder} has the rows 0 to {plan.runs - 1}")
    named = {*overrides, *(("controller.name",) if controller else ())}
    names = {name for key, name in plan.names(row).items() if key not in named}
    then = version_of(Path(folder))
    if files := sorted({file for name in names for file in changed_files(name, then["files"])}):
        raise InputError(_changed(folder, row, files))
    plan = Plan.that_ran(Path(folder, STUDY), trusted=names)
    scenario = plan.scenario(row)
    if overrides or controller:
        scenario = scenario.updated(overrides, controller, place=f"row {row} of {folder}", note=warn)
    now = about_of(plan, Parcel.of(replace(plan, tables=scenario.to_dict())))
    of_row = {name: digest for name, digest in then["files"].items() if name in now["files"]}
    code, files = changes(then | {"files": of_row}, now)
    if files and not named:  # e.g. a file beside the law's that an import finds first
        raise InputError(_changed(folder, row, files))
    if code or files:
        warn(f"the run may differ from the row: {'; '.join([*code, *(f'{name} changed' for name in files)])}")
    engine = _engine_of(Path(folder), row) or plan.engine
    return scenario, chosen_engine(scenario) if engine == "auto" else engine


def _changed(folder: str, row: int, files: list[str]) -> str:
    return (
        f"row {row} of {folder}: since the study began, {', '.join(files)} changed; restore what it was, or name "
        "the file to run it as it is: -c path/to/law.py:Law, or a key, vehicle.model=path"
    )


def _engine_of(folder: Path, row: int) -> str:
    """The engine of a row; empty for a run that is not done yet or could not begin."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        found = pq.read_table(folder / "rows", columns=["engine"], filters=[("index", "==", row)])["engine"].to_pylist()
    except (OSError, pa.ArrowException):
        return ""
    return found[0] if found else ""
